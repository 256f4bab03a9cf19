"""Published ball-balancing robots: what each source prints, what comes out of our equations, and why they differ.

Each source's robot is its preset, with the source's own convention or mistake switched on: by data (a robot with other
inertias), or by a mixture of the thesis's corrections (`tests.support.lagrangian`). `python -m campaigns.published`
writes docs/generated/published_models.md.

Kugle: T. K. Jespersen, github.com/mindThomas/Kugle-MATLAB, Aalborg University, 2019. Rezero: P. Fankhauser and
C. Gwerder, Modeling and Control of a Ballbot, ETH Zurich, 2010. Of ROB 311 and CMU's ballbot only parameters are
published; CMU's planar equations are public (alpha, beta, gamma below) and with massless wheels they must be ours.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.files import write_text
from ballbot.mechanics.model import LinearModel, Model
from ballbot.robot import Friction, Robot
from ballbot.robot.derived import solid_sphere_inertia, thin_shell_inertia
from campaigns.section import markdown_table
from tests.support.lagrangian import corrections_of, equations

PAGE = Path(__file__).parents[1] / "docs" / "generated" / "published_models.md"


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A number that a source prints, with what our equations give for it."""

    name: str
    printed: str  #: digit by digit as in the source, so that its precision is known
    reproduced: float  #: with the source's own convention or mistake
    right: float  #: by the exact equations

    @property
    def difference(self) -> float:
        """What is reproduced less what is printed, relative to the latter."""
        return self.reproduced / float(self.printed) - 1.0

    @property
    def comes_out(self) -> bool:
        """Whether the reproduced number rounds to the printed one."""
        rounding = 0.5 * 10.0 ** -len(self.printed.partition(".")[2])
        return abs(self.reproduced - float(self.printed)) <= rounding * (1.0 + 1e-9)


def entry_table(entries: Sequence[Entry]) -> str:
    """Return a Markdown table of printed, reproduced and right numbers."""
    rows = [
        [
            entry.name,
            entry.printed,
            f"{entry.reproduced:.5g}",
            "to its last digit" if entry.comes_out else f"off by {100.0 * entry.difference:+.2f} %",
            f"{entry.right:.5g}",
        ]
        for entry in entries
    ]
    return markdown_table(["", "printed", "reproduced", "comes out", "right"], rows)


@dataclass(frozen=True, kw_only=True, eq=False)
class SourceModel:
    """x_dot = A x + B u in the state and order that a source has; such as `ballbot.lqr` takes."""

    A: NDArray[np.float64]  #: (m, m)
    B: NDArray[np.float64]  #: (m, n)


def in_state(model: LinearModel, T: NDArray[np.float64]) -> SourceModel:
    """Return the model in the state z = T x, T (m, 10), of as many states as act on each other."""
    back = np.linalg.pinv(T)
    return SourceModel(A=T @ model.A @ back, B=T @ model.B)


def entries_of(
    A: Mapping[tuple[str, str], str],
    B: Mapping[str, Sequence[str]],
    names: Sequence[str],
    *,
    reproduced: SourceModel,
    right: SourceModel,
) -> list[Entry]:
    """Return every number of a printed A and B that is not zero; `names` are of the models' states."""
    cells = [(row, column, "A", names.index(column)) for row, column in A]
    cells += [(row, f"T{k + 1}", "B", k) for row, printed in B.items() for k in range(len(printed))]
    entries = []
    for row, column, matrix, k in cells:
        printed = A[row, column] if matrix == "A" else B[row][k]
        if float(printed):
            ours, exact = (
                float(getattr(linear, matrix)[names.index(row), k]) for linear in (reproduced, right)
            )
            entries.append(Entry(name=f"{row}/{column}", printed=printed, reproduced=ours, right=exact))
    return entries


def unstable_poles(model: LinearModel) -> tuple[float, float]:
    """Return the poles [rad/s] with which the robot falls about its two horizontal axes, the faster first."""
    first, second = np.real(model.poles())[:2]
    return float(first), float(second)


# --- Kugle ------------------------------------------------------------------------------------------

#: acceleration by quaternion element and by wheel torque, as the source prints it (LinearizedModelMatrices)
_KUGLE_A = {
    ("ddx", "q3"): "-9.5964",
    ("ddy", "q2"): "9.6198",
    ("ddq2", "q2"): "14.0494",
    ("ddq3", "q3"): "14.0152",
}
_KUGLE_B = {
    "ddx": ("0.0000", "-1.0421", "1.0421"),
    "ddy": ("1.2045", "-0.6022", "-0.6022"),
    "ddq2": ("0.7007", "-0.3504", "-0.3504"),
    "ddq3": ("0.0000", "0.6054", "-0.6054"),
    "ddq4": ("-6.8957", "-6.8957", "-6.8957"),
}
#: the source's state: about upright (q2 q3 q4) is half of our (theta phi psi)
_KUGLE_STATE = ("x", "y", "q2", "q3", "q4", "ddx", "ddy", "ddq2", "ddq3", "ddq4")


def inertia_counted_twice(robot: Robot) -> Robot:
    """Return the robot with the inertia about the ball's centre taken for one about the centre of mass."""
    return robot.replace(body=replace(robot.body, inertia_about="center_of_mass"))


def all_on_relative_speed(robot: Robot) -> Robot:
    """Return the robot whose wheels have no inertia of their own and whose rotors have it in their stead."""
    n = robot.drive.gear_ratio
    total = robot.wheels.inertia + robot.drive.reflected_inertia
    return robot.replace(
        {"wheels.inertia": 0.0, "drive.motor_inertia": total / n**2, "drive.gear_inertia": 0.0}
    )


def kugle_as_modelled(robot: Robot) -> Robot:
    """Return the robot whose exact equations are the source's: both of its peculiarities, as data."""
    return inertia_counted_twice(all_on_relative_speed(robot))


def in_quaternion(model: Model) -> SourceModel:
    """Return a model in Kugle's state (x, y, q2, q3, q4, their rates)."""
    return in_state(model.linearize(), np.diag([1.0, 1.0, 0.5, 0.5, 0.5] * 2))


def kugle_entries(robot: Robot) -> list[Entry]:
    """Return every number of Kugle's printed A and B that is not zero."""
    ours, right = in_quaternion(Model(kugle_as_modelled(robot))), in_quaternion(Model(robot))
    return entries_of(_KUGLE_A, _KUGLE_B, _KUGLE_STATE, reproduced=ours, right=right)


def _kugle_section(robot: Robot) -> str:
    models = {
        "as printed": kugle_as_modelled(robot),
        "with the inertia right, wheels still on relative speed": all_on_relative_speed(robot),
        "right": robot,
    }
    poles_of = {name: unstable_poles(Model(model).linearize()) for name, model in models.items()}
    poles = [[name, *(f"{pole:.4f}" for pole in both)] for name, both in poles_of.items()]
    body, faster = robot.body, poles_of["right"][0] / poles_of["as printed"][0]
    return f"""\
## Kugle (Aalborg University, 2019)

Source: T. K. Jespersen, Kugle-MATLAB (MIT), `LinearizedModelMatrices`; preset `kugle`. The model is in quaternions;
about upright q2, q3, q4 are half of theta, phi, psi.

**What it does.** The body's inertia, {body.inertia[0]:.4f} kg m^2, is about the ball's centre. The kinetic energy adds
1/2 M_b |v_com|^2 to it, so that m_r l^2 = {body.mass * body.center_of_mass**2:.3f} kg m^2 counts twice, as in
the thesis. And wheels and rotors alike turn at the speed relative to the body, r_k/r_w (ball - body); the wheels' own
part of their inertia should turn with the absolute spin.

**How it is switched on.** By data: the preset with `about = "center_of_mass"` over the inertia about the ball's centre,
and the wheels' inertia moved to the rotors. The exact equations of that robot print the source's matrices:

{entry_table(kugle_entries(robot))}

The robot falls {faster:.2f} times as fast as the printed model:

{markdown_table(["", "unstable poles [rad/s]", ""], poles)}
"""


# --- Rezero -----------------------------------------------------------------------------------------

_REZERO_A = {
    ("theta_x dd", "theta_x"): "37.69",
    ("theta_y dd", "theta_y"): "37.73",
    ("phi_x dd", "theta_x"): "-73.02",
    ("phi_y dd", "theta_y"): "-73.09",
}
_REZERO_B = {
    "theta_x dd": ("4.02", "-2.01", "-2.01"),
    "theta_y dd": ("0.000", "3.485", "-3.485"),
    "theta_z dd": ("-10.76", "-10.76", "-10.76"),
    "phi_x dd": ("-13.48", "6.738", "6.738"),
    # the figure has -11.68 twice; the printed gain shows that one is a misprint
    "phi_y dd": ("0.00", "-11.68", "11.68"),
}
#: the body's angles and the ball's (phi_x = -y/r_b, phi_y = x/r_b), then their rates
_REZERO_ANGLES = ("theta_x", "theta_y", "theta_z", "phi_x", "phi_y")
_REZERO_STATE = (*_REZERO_ANGLES, *(f"{angle} dd" for angle in _REZERO_ANGLES))
#: the exact equations, but for rotors of their own and for the locked wheels in the body's inertia
_ABSOLUTE_WHEELS = replace(corrections_of("exact"), locked_wheels_once=False, reflected_rotors=False)


def rezero_as_modelled(robot: Robot) -> LinearModel:
    """Return Rezero's linear model about upright: wheel and rotor are one inertia that turns with the absolute spin.

    As `Model.linearize`, which has the two named formulations; M and the torques' generalised force at rest come
    from the symbolic Lagrangian, and gravity tips with m_r g l.
    """
    drive = robot.drive
    robot = robot.replace(
        wheels=replace(robot.wheels, inertia=robot.wheels.inertia + drive.reflected_inertia),
        drive=replace(drive, motor_inertia=0.0, gear_inertia=0.0),
    )
    derived, rest = equations(robot, _ABSOLUTE_WHEELS), np.zeros(5)
    forces = [derived.dynamics(rest, rest, u) for u in np.eye(robot.wheel_count)]
    tipping = robot.body.mass * robot.gravity * robot.body.center_of_mass
    A, B = np.zeros((10, 10)), np.zeros((10, robot.wheel_count))
    A[:5, 5:] = np.eye(5)
    A[5:, :5] = np.linalg.solve(forces[0][0], np.diag([0.0, 0.0, tipping, tipping, 0.0]))
    B[5:] = np.linalg.solve(forces[0][0], np.stack([Q for _, _, Q in forces], axis=1))
    return LinearModel(A=A, B=B)


def in_rezero_state(model: LinearModel, robot: Robot) -> SourceModel:
    """Return a model in Rezero's state: the body's angles and the ball's, then their rates."""
    r_b, T = robot.ball.radius, np.zeros((5, 5))
    T[range(5), (2, 3, 4, 1, 0)] = 1.0, 1.0, 1.0, -1.0 / r_b, 1.0 / r_b
    return in_state(model, np.kron(np.eye(2), T))


def rezero_entries(robot: Robot) -> list[Entry]:
    """Return every number of Rezero's printed three-dimensional A and B that is not zero."""
    ours, right = (
        in_rezero_state(linear, robot) for linear in (rezero_as_modelled(robot), Model(robot).linearize())
    )
    return entries_of(_REZERO_A, _REZERO_B, _REZERO_STATE, reproduced=ours, right=right)


def _rezero_section(robot: Robot) -> str:
    inertia = robot.wheels.inertia + robot.drive.reflected_inertia
    entries = rezero_entries(robot)
    poles = [
        ["printed", f"{np.sqrt(float(_REZERO_A['theta_y dd', 'theta_y'])):.4f}"],
        ["by the source's convention", f"{unstable_poles(rezero_as_modelled(robot))[0]:.4f}"],
        ["right", f"{unstable_poles(Model(robot).linearize())[0]:.4f}"],
    ]
    return f"""\
## Rezero (ETH Zurich, 2010)

Source: P. Fankhauser and C. Gwerder, *Modeling and Control of a Ballbot*, doi 10.3929/ethz-a-010056685; preset
`rezero`. Its torques act relative to the body, with the counter-torque, as they should (and as Kugle's do).

**What it does.** Wheel and rotor count as one inertia, Theta_W = {inertia:.5f} kg m^2,
that turns with the wheel's absolute spin. But the rotor, most of it, turns n times as fast as the wheel turns
*relative* to the body; and the body's inertia holds the locked wheels already, whose spin about the axle so counts
twice.

**How it is switched on.** The rotor's inertia moves to the wheel (data), and of the thesis's corrections "reflected
rotors" and "locked wheels once" stay off. The heading then comes out to its last digit, and only then; the lean comes
within {100.0 * max(abs(entry.difference) for entry in entries):.1f} %:

{entry_table(entries)}

What is left of the lean we cannot explain: the printed matrices were made with other numbers than are printed. The
figure prints the last entry of B with the sign of the one before; the printed gain shows that it is a misprint.

{markdown_table(["", "fastest pole [rad/s]"], poles)}
"""


# --- robots with published parameters ---------------------------------------------------------------


def planar_pole(robot: Robot) -> float:
    """Return the unstable pole [rad/s] of CMU's planar equations: ball and body, wheels without inertia.

    With the ball's angle relative to the body first and the lean second,

        M = [[alpha, alpha + beta], [alpha + beta, alpha + gamma + 2 beta]],   gravity on the lean m_r g l
        alpha = j_b + (m_b + m_r) r_b^2,   beta = m_r l r_b,   gamma = J_com + m_r l^2
    """
    ball, body = robot.ball, robot.body
    alpha = ball.inertia + (ball.mass + body.mass) * ball.radius**2
    beta = body.mass * body.center_of_mass * ball.radius
    gamma = float(body.inertia_about_ball_center()[0, 0])
    M = np.array([[alpha, alpha + beta], [alpha + beta, alpha + gamma + 2.0 * beta]])
    return float(np.sqrt(np.linalg.inv(M)[1, 1] * body.mass * robot.gravity * body.center_of_mass))


def without_wheel_inertia(robot: Robot) -> Robot:
    """Return the robot with wheels, rotors and gears that weigh nothing, and without friction."""
    return robot.replace(
        wheels=replace(robot.wheels, inertia=0.0),
        drive=replace(robot.drive, motor_inertia=0.0, gear_inertia=0.0),
        friction=Friction.none(robot.wheel_count),
    )


def _parameters_section(rob311: Robot, cmu: Robot) -> str:
    ours = unstable_poles(Model(without_wheel_inertia(cmu)).linearize())[0]
    ball, wheels = rob311.ball, rob311.wheels
    solid = solid_sphere_inertia(mass=ball.mass, radius=ball.radius)
    shell = thin_shell_inertia(mass=ball.mass, radius=ball.radius)
    return f"""\
## ROB 311 (University of Michigan) and CMU's ballbot

Only parameters are published; presets `rob311` and `cmu`.

**ROB 311.** The ball's inertia, {ball.inertia:g} kg m^2, is a solid ball's ({solid:.4f}); a basketball is a shell, at
most {shell:.4f}. The wheel's radius is {wheels.radius:g} m; one class script has .0048, another .096, the diameter. The
wheel's inertia, {wheels.inertia:g} kg m^2, is what the diameter gives for the radius: half of 0.29 kg times
(0.096 m)^2 is {0.5 * 0.29 * 0.096**2:.5f}.

**CMU.** The inertia {cmu.body.inertia[0]:g} kg m^2 is about the centre of mass, and the planar equations add m_r l^2
once: right. They give an unstable pole of {planar_pole(cmu):.4f} rad/s, and our equations, with wheels that weigh
nothing, {ours:.4f}. The rollers at the ball's equator are four omniwheels here, of assumed sizes.

The NXT ballbot is driven by two wheels, which no preset can have: a robot has three or four.
"""


_HEAD = """\
# Published models: what they print, what they should print, and why

Computed by `python -m campaigns.published`; nothing on this page is written by hand but the words.

Each table has what the source *prints*; what our equations give with the source's own convention or mistake switched on
(*reproduced*); and what is *right*, by the [exact equations](../mechanics.md). A number "comes out to its last digit"
where the reproduced one rounds to the printed one. The thesis has a page of its own:
[misprints and mistakes](reproduce.md#misprints-and-mistakes).
"""


def published_page() -> str:
    """Return the whole page in Markdown."""
    load = Robot.load
    parts = (_kugle_section(load("kugle")), _rezero_section(load("rezero")))
    return "\n".join([_HEAD, *parts, _parameters_section(load("rob311"), load("cmu"))])


if __name__ == "__main__":
    write_text(PAGE, published_page())
