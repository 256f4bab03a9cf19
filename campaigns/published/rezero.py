"""Rezero (ETH Zurich, 2010): its three-dimensional linearisation and gain, and its planar model.

P. Fankhauser and C. Gwerder, Modeling and Control of a Ballbot. State of the three-dimensional model: the body's
angles and the ball's, each followed by its rate, (theta_x theta_y theta_z phi_x phi_y); the ball's angles are ours as
phi_x = -y/r_b, phi_y = x/r_b. Of the planar one: (phi, theta, their rates).

Its convention: wheel and rotor count as one inertia Theta_W that turns with the *absolute* spin (relative speed plus
the body's turning about the axle). A rotor's speed is n times the wheel's relative one, and the body's inertia holds
the locked wheels already. Torques do act relative to the body, as they should.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.control.lqr import LqrDesign, lqr
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.model import LinearModel, Model
from ballbot.robot import Robot
from ballbot.robot.derived import reflected_rotor_inertia
from campaigns.published.printed import (
    Entry,
    SourceModel,
    entry_table,
    in_state,
    mixture_model,
    unstable_poles,
)
from campaigns.reproduce import markdown_table
from tests.support.lagrangian import corrections_of

#: the exact equations, but for rotors of their own and for the locked wheels in the body's inertia
ABSOLUTE_WHEELS = replace(corrections_of("exact"), locked_wheels_once=False, reflected_rotors=False)

_ANGLES = ("theta_x", "theta_y", "theta_z", "phi_x", "phi_y")
_PRINTED_A = {
    ("theta_x", "theta_x"): "37.69",
    ("theta_y", "theta_y"): "37.73",
    ("phi_x", "theta_x"): "-73.02",
    ("phi_y", "theta_y"): "-73.09",
}
_PRINTED_B = {
    "theta_x": ("4.02", "-2.01", "-2.01"),
    "theta_y": ("0.000", "3.485", "-3.485"),
    "theta_z": ("-10.76", "-10.76", "-10.76"),
    "phi_x": ("-13.48", "6.738", "6.738"),
    "phi_y": ("0.00", "-11.68", "11.68"),  # the figure has -11.68 twice; see MISPRINTED
}
#: the entry of B whose sign the figure misprints
MISPRINTED = ("phi_y", 2)

STATE_WEIGHTS = (100.0, 50.0, 100.0, 50.0, 40.0, 20.0, 20.0, 10.0, 20.0, 10.0)
TORQUE_WEIGHT = 100.0
#: K, first row, as printed: the source cuts digits off and does not round
PRINTED_GAIN = (22.34, 4.63, 0.0, 0.0, -0.36, -0.29, 0.36, 0.53, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Planar:
    """The planar model, state (phi, theta, their rates): accelerations by theta and by the torque."""

    ball_by_lean: float = -31.4603
    lean_by_lean: float = 16.3333
    ball_by_torque: float = 13.4993
    lean_by_torque: float = -2.8567
    state_weights: tuple[float, ...] = (20.0, 100.0, 10.0, 50.0)
    torque_weight: float = 200.0
    gain: tuple[float, ...] = (-0.3162, -22.8608, -0.5359, -6.5726)
    wheel_mass: float = 3.0  #: m_W of Table 2.1, at r_K + r_W above the ball's centre
    body_mass: float = 9.2  #: m_A of Table 2.1


def as_modelled(robot: Robot) -> Robot:
    """Return the robot with wheel and rotor as one inertia, Theta_W, and no rotor (with `ABSOLUTE_WHEELS`)."""
    drive = robot.drive
    rotor = reflected_rotor_inertia(
        gear_ratio=drive.gear_ratio, motor_inertia=drive.motor_inertia, gear_inertia=drive.gear_inertia
    )
    return robot.replace(
        wheels=replace(robot.wheels, inertia=robot.wheels.inertia + rotor),
        drive=replace(drive, motor_inertia=0.0, gear_inertia=0.0),
    )


def in_source_state(model: LinearModel, robot: Robot) -> SourceModel:
    """Return a model in the source's state (10,): its five angles, each followed by its rate."""
    T = np.zeros((10, 10))
    r_b = robot.ball.radius
    ours = {
        "theta_x": (2, 1.0),
        "theta_y": (3, 1.0),
        "theta_z": (4, 1.0),
        "phi_x": (1, -1.0 / r_b),
        "phi_y": (0, 1.0 / r_b),
    }
    for index, name in enumerate(_ANGLES):
        place, scale = ours[name]
        T[2 * index, place] = T[2 * index + 1, 5 + place] = scale
    return in_state(model, T)


def printed_model(*, misprinted: bool = False) -> SourceModel:
    """Return the printed three-dimensional A (10, 10) and B (10, 3).

    Parameters
    ----------
    misprinted : bool
        With the figure's own sign of the last entry instead of the right one.
    """
    A, B = np.zeros((10, 10)), np.zeros((10, 3))
    A[::2, 1::2] = np.eye(5)
    for (row, column), printed in _PRINTED_A.items():
        A[_rate(row), _rate(column) - 1] = float(printed)
    for row, printed_row in _PRINTED_B.items():
        B[_rate(row)] = [float(one) for one in printed_row]
    if misprinted:
        row, wheel = MISPRINTED
        B[_rate(row), wheel] *= -1.0
    return SourceModel(A=A, B=B)


def entries(robot: Robot) -> list[Entry]:
    """Return every number of the printed three-dimensional A and B that is not zero."""
    reproduced = in_source_state(mixture_model(as_modelled(robot), ABSOLUTE_WHEELS), robot)
    right = in_source_state(Model(robot).linearize(), robot)
    found = []
    for (row, column), printed in _PRINTED_A.items():
        place = _rate(row), _rate(column) - 1
        name = f"{row} dd/{column}"
        found.append(Entry(name=name, printed=printed, reproduced=reproduced.A[place], right=right.A[place]))
    for row, printed_row in _PRINTED_B.items():
        for wheel, printed in enumerate(printed_row):
            place = _rate(row), wheel
            name = f"{row} dd/T{wheel + 1}"
            if float(printed):
                found.append(
                    Entry(name=name, printed=printed, reproduced=reproduced.B[place], right=right.B[place])
                )
    return found


def balance_lqr(model: SourceModel) -> LqrDesign:
    """Return the three-dimensional model's gain (3, 10) with the source's weights."""
    return lqr(model, STATE_WEIGHTS, (TORQUE_WEIGHT,) * 3)


def planar_lqr(planar: Planar) -> LqrDesign:
    """Return the planar gain (1, 4) from the printed planar A and B with the source's weights."""
    A, B = np.zeros((4, 4)), np.zeros((4, 1))
    A[:2, 2:] = np.eye(2)
    A[2:, 1] = planar.ball_by_lean, planar.lean_by_lean
    B[2:, 0] = planar.ball_by_torque, planar.lean_by_torque
    return lqr(SourceModel(A=A, B=B), planar.state_weights, (planar.torque_weight,))


def implied_tipping(
    *, lean_by_lean: float, ball_by_lean: float, lean_by_torque: float, ratio: float
) -> float:
    """Return gravity's torque for each radian of lean [N m/rad] that a planar A and B must have come from.

    With M (phi_dd, theta_dd) = (0, G theta) + ratio (1, -1) T, whatever the mass matrix M,

        theta_dd/theta - phi_dd/theta = G (m11 + m12)/det M,      -theta_dd/T = ratio (m11 + m12)/det M.

    Parameters
    ----------
    lean_by_lean, ball_by_lean, lean_by_torque : float
        Entries of A and B [1/s^2, 1/s^2, 1/(kg m^2)].
    ratio : float
        Torque on the ball for each N m of the wheel.
    """
    return ratio * (lean_by_lean - ball_by_lean) / abs(lean_by_torque)


def tipping_of_table(robot: Robot, planar: Planar) -> float:
    """Return gravity's torque for each radian of lean [N m/rad] by the parts of Table 2.1."""
    wheel_height = robot.ball.radius + robot.wheels.radius
    first_moment = planar.body_mass * robot.body.center_of_mass + planar.wheel_mass * wheel_height
    return robot.gravity * first_moment


def section(robot: Robot) -> str:
    """Return the source's part of the page, computed."""
    source = mixture_model(as_modelled(robot), ABSOLUTE_WHEELS)
    right = Model(robot).linearize()
    poles = [
        ["printed", f"{np.sqrt(float(_PRINTED_A['theta_y', 'theta_y'])):.4f}"],
        ["by the source's convention", f"{unstable_poles(source)[0]:.4f}"],
        ["right", f"{unstable_poles(right)[0]:.4f}"],
    ]
    worst = max(abs(entry.difference) for entry in entries(robot))
    return f"""\
## Rezero (ETH Zurich, 2010)

Source: P. Fankhauser and C. Gwerder, *Modeling and Control of a Ballbot*, doi 10.3929/ethz-a-010056685; preset
`rezero`. Its torques act relative to the body, with the counter-torque, as they should (and as Kugle's do).

### The three-dimensional model

**What it does.** Wheel and rotor count as one inertia, Theta_W = {as_modelled(robot).wheels.inertia:.5f} kg m^2,
that turns with the wheel's absolute spin. But the rotor, most of it, turns n times as fast as the wheel turns
*relative* to the body; and the body's inertia holds the locked wheels already, whose spin about the axle so counts
twice.

**How it is switched on.** The rotor's inertia moves to the wheel (data), and of the thesis's corrections "reflected
rotors" and "locked wheels once" stay off. The heading then comes out to its last digit, and only then; the lean comes
within {100.0 * worst:.1f} %:

{entry_table(entries(robot))}

What is left of the lean we cannot explain. Printed A and B agree with each other (see the table on gravity's torque
below), and lead back to a planar mass matrix whose first entry is {_implied_first(robot):.4f} kg m^2, where its own
parameters give {_own_first(robot):.4f}: the printed matrices were made with other numbers than are printed.

{markdown_table(["", "fastest pole [rad/s]"], poles)}

LQR with the source's Q and R = 100 I, first wheel. The figure prints the last entry of B with the sign of the one
before ({float(_PRINTED_B["phi_y"][1]):.2f}); the gain shows that it is a misprint. The source truncates the gain's
digits and does not round them; the remaining difference is the rounding of the printed A and B.

{_gain_table(robot, source, right)}

### The planar model

The printed gain follows from the printed A and B:

{_planar_gain_table()}

But the printed A and B do not follow from the source's Table 2.1. Whatever the mass matrix, A and B together determine
gravity's torque for each radian of lean:

{_tipping_table(robot)}
"""


def _gain_table(robot: Robot, source: LinearModel, right: LinearModel) -> str:
    designs = {
        "printed A, B with the sign mended": balance_lqr(printed_model()),
        "printed A, B as in the figure": balance_lqr(printed_model(misprinted=True)),
        "the source's convention": balance_lqr(in_source_state(source, robot)),
        "right": balance_lqr(in_source_state(right, robot)),
    }
    states = [text for angle in _ANGLES for text in (angle, "its rate")]
    rows = [["printed", *(f"{value:g}" for value in PRINTED_GAIN)]]
    rows += [
        [name, *(f"{value + 0.0:.4g}" for value in _clean(design.gain[0]))]
        for name, design in designs.items()
    ]
    return markdown_table(["gain on", *states], rows)


def _planar_gain_table() -> str:
    planar = Planar()
    rows = [
        ["printed", *(f"{value:.4f}" for value in planar.gain)],
        ["from the printed A, B", *(f"{value:.4f}" for value in planar_lqr(planar).gain[0])],
    ]
    return markdown_table(["gain on", "phi", "theta", "phi rate", "theta rate"], rows)


def _tipping_table(robot: Robot) -> str:
    planar, body = Planar(), robot.body
    from_planar = implied_tipping(
        lean_by_lean=planar.lean_by_lean,
        ball_by_lean=planar.ball_by_lean,
        lean_by_torque=planar.lean_by_torque,
        ratio=robot.ball.radius / robot.wheels.radius,
    )
    from_table = tipping_of_table(robot, planar)
    from_three = printed_tipping(robot)
    from_body = body.mass * robot.gravity * body.center_of_mass
    rows = [
        [
            "planar",
            f"{from_planar:.3f}",
            f"{from_table:.3f}",
            f"{100 * (from_planar / from_table - 1):+.1f} %",
        ],
        [
            "three-dimensional",
            f"{from_three:.3f}",
            f"{from_body:.3f}",
            f"{100 * (from_three / from_body - 1):+.2f} %",
        ],
    ]
    return markdown_table(["model", "from A and B [N m/rad]", "from its parameters", "difference"], rows)


def printed_tipping(robot: Robot) -> float:
    """Return gravity's torque [N m/rad] that the printed three-dimensional A and B lead back to."""
    printed = printed_model()
    lean, ball = _rate("theta_x"), _rate("phi_x")
    return implied_tipping(
        lean_by_lean=printed.A[lean, lean - 1],
        ball_by_lean=printed.A[ball, lean - 1],
        lean_by_torque=printed.B[lean, 0],
        ratio=abs(float(transforms(robot).T_owb[0, 0])),
    )


def _implied_first(robot: Robot) -> float:
    """Return m11 [kg m^2], what the ball's turning about x has to move, that the printed A and B lead back to."""
    printed, w = printed_model(), abs(float(transforms(robot).T_owb[0, 0]))
    lean, ball = _rate("theta_x"), _rate("phi_x")
    G = printed_tipping(robot)
    # the inverse of M: A is its second column times G, and B its columns' difference times w
    inverse_12, inverse_22 = printed.A[ball, lean - 1] / G, printed.A[lean, lean - 1] / G
    inverse_11 = abs(printed.B[ball, 0]) / w + inverse_12
    return float(np.linalg.inv([[inverse_11, inverse_12], [inverse_12, inverse_22]])[0, 0])


def _own_first(robot: Robot) -> float:
    """Return the same by the source's parameters: (m_K + m_A) r_K^2 + Theta_K + Theta_W times the wheels' ratio."""
    w = transforms(robot).T_owb[:, 0]
    moved = (robot.ball.mass + robot.body.mass) * robot.ball.radius**2
    return float(moved + robot.ball.inertia + as_modelled(robot).wheels.inertia * (w @ w))


def _rate(angle: str) -> int:
    """Return the place of an angle's rate in the source's state."""
    return 2 * _ANGLES.index(angle) + 1


def _clean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(np.abs(values) < 1e-9, 0.0, values)
