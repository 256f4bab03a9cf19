"""The thesis's misprints and mistakes, each with a computed number that shows it; here 9, 11 to 15 and 19.

`mistaken_equations` has 1 to 8, 10 and 16 to 18: printed equations and physics of the model.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ballbot.control.lqr import held
from ballbot.mechanics.friction_laws.classical import Classical
from ballbot.mechanics.model import Model
from ballbot.robot.derived import shell_wall, thick_shell_inertia, thin_shell_inertia, wheel_speed_limit
from ballbot.simulation.driveline import Driveline, SpeedClamp, simulate_drivelines, speed_clamp
from ballbot.simulation.run import simulate
from ballbot.thesis.reproduce import mistaken_equations
from ballbot.thesis.reproduce.appendices import RUBBER
from ballbot.thesis.reproduce.bench import Bench
from ballbot.thesis.reproduce.item import Check, Mistake
from ballbot.thesis.reproduce.recordings import CHANGE
from ballbot.validation.models import thesis_error
from ballbot.validation.statistics import Correlations

#: the thesis's sweep: amplitude [N m], period [s]; the limit [rad/s]
_AMPLITUDE, _PERIOD, _LIMIT = 1.0, 62.83, 27.7
_SAMPLE_TIME = 0.01
#: rpm in rad/s
_RPM = np.pi / 30.0


def speed_clamp_printed(bench: Bench) -> Mistake:
    """(3.2) with l = -27.7, and the integrated speed that runs on."""
    t = np.arange(0.0, _PERIOD, _SAMPLE_TIME)
    bare = Classical(viscous=0.0, coulomb=0.0, stribeck=0.0, stribeck_speed=1.0, stribeck_exponent=1.0)
    line = Driveline(inertia=bench.robot.wheels.inertia, friction=bare, speed_limit=SpeedClamp(limit=_LIMIT))
    torque = _AMPLITUDE * np.sin(2.0 * np.pi * t / _PERIOD)
    motion = simulate_drivelines(line, torque, sample_time=_SAMPLE_TIME, step=_SAMPLE_TIME)
    speed = motion.speeds[0]
    limited = motion.t[speed >= _LIMIT]
    # torque brakes from half the period on; a wheel of 1 g m^2 would leave the limit within milliseconds
    late = float(limited[-1]) - 0.5 * _PERIOD
    printed = float(np.ptp(speed_clamp(np.linspace(-100.0, 100.0, 11), -_LIMIT)))
    return Mistake(
        number=9,
        where="(3.2)",
        thesis="x_1_dot = max(min(x_2, l), -l) with l = -27.7 rad/s.",
        right="With l = -27.7 it is +27.7 whatever x_2 is. With l = 27.7 it limits the output and not the "
        "state, which winds up and leaves the limit late; the state itself must stop.",
        shown_by=(
            Check(
                claim="with l = -27.7 all speeds are one",
                quantity="its range over speeds from -100 to 100 rad/s, l = -27.7",
                value=printed,
                unit="rad/s",
                highest=0.0,
            ),
            Check(
                claim="with l = 27.7 the state winds up",
                quantity="largest x_2 of the free wheel in the sweep, l = 27.7",
                value=float(motion.integrated_speeds[0].max()),
                unit="rad/s",
                lowest=1000.0,
            ),
            Check(
                claim="and leaves the limit late",
                quantity="after the torque has turned",
                value=late,
                unit="s",
                lowest=1.0,
            ),
        ),
    )


def ball_inertia(bench: Bench) -> Mistake:
    """The ball's inertia is a thin shell's."""
    ball = bench.robot.ball
    wall = shell_wall(mass=ball.mass, radius=ball.radius, density=RUBBER)
    thin = thin_shell_inertia(mass=ball.mass, radius=ball.radius)
    thick = thick_shell_inertia(mass=ball.mass, radius=ball.radius, wall=wall)
    return Mistake(
        number=11,
        where="Appendix III, jb",
        thesis="The ball's inertia is 0.0242 kg m^2, calculated.",
        right=f"That is a thin shell's; with the wall of {100.0 * wall:.1f} cm that Appendix I computes it "
        f"is {thick:.4f}.",
        shown_by=(
            Check(
                claim="0.0242 is a thin shell's",
                quantity="2/3 m r^2",
                value=thin,
                unit="kg m^2",
                lowest=0.02415,
                highest=0.02425,
            ),
            Check(
                claim="the wall makes a difference",
                quantity="thin shell over thick",
                value=thin / thick,
                lowest=1.2,
            ),
        ),
    )


def rounded_constants(bench: Bench) -> Mistake:
    """31.7 rad/s/V, 761.5, 27.59 and 27.7 rad/s, and the wheel's radius."""
    drive = bench.robot.drive
    fastest = max(float(np.abs(sweep.speed).max()) for sweep in bench.sweeps)
    limit = wheel_speed_limit(
        supply_voltage=drive.supply_voltage, speed_constant=drive.speed_constant, gear_ratio=drive.gear_ratio
    )
    return Mistake(
        number=12,
        where="Appendix I and III",
        thesis="31.7 rad/s/V times 24 V is 761.5 rad/s, hence 27.59 rad/s at the wheel; r_w is 63 mm.",
        right="31.7 is rounded from 303 rpm/V, from which 761.5 follows; the sweep shows 27.7 rad/s; the "
        "data sheet's wheel is 127 mm across, r_w = 63.5 mm.",
        shown_by=(
            Check(
                claim="31.7 times 24 is not 761.5",
                quantity="761.5 less it",
                value=761.5 - 31.7 * 24.0,
                unit="rad/s",
                lowest=0.5,
            ),
            Check(
                claim="303 rpm/V times 24 V is",
                quantity="761.5 less 303 rpm/V times 24 V, its size",
                value=abs(761.5 - 303.0 * _RPM * 24.0),
                unit="rad/s",
                highest=0.05,
            ),
            Check(
                claim="the sweep went beyond the computed limit",
                quantity="the sweep's 27.7 over the computed limit, less 1",
                value=100.0 * (_LIMIT / limit - 1.0),
                unit="%",
                lowest=0.2,
            ),
            Check(
                claim="where the twin's, whose supply is the computed one, does not",
                quantity="its largest speed over the limit",
                value=fastest / limit,
                lowest=0.99,
                highest=1.01,
            ),
            Check(
                claim="r_w is less than half of 127 mm",
                quantity="63.5 mm less r_w",
                value=63.5 - 1e3 * bench.robot.wheels.radius,
                unit="mm",
                lowest=0.4,
            ),
        ),
    )


def error_over_count(bench: Bench) -> Mistake:
    """(4.1) divides the norm by n."""
    h = bench.robot.sensors.sample_time
    # a model that is off by a sine of 1 mm, over 4 s as over 48 s
    short, long = (
        1e-3 * np.sin(2.0 * np.pi * 0.5 * h * np.arange(round(seconds / h)))[:, None]
        for seconds in (4.0, 48.0)
    )
    errors = [float(thesis_error(one)[0]) for one in (short, long)]
    roots = [error * np.sqrt(len(one)) for error, one in zip(errors, (short, long), strict=True)]
    return Mistake(
        number=15,
        where="(4.1), Tables 4.1 and 4.2",
        thesis="e = |x - x_hat| / n.",
        right="The norm of n differences grows with sqrt(n), so that e shrinks with the length of the log; "
        "the root mean square error e sqrt(n) does not. The tables cannot be compared with other logs', nor "
        "with each other.",
        shown_by=(
            Check(
                claim="e depends on the length",
                quantity="e of a model that is off by a sine of 1 mm, over 4 s by over 48 s",
                value=errors[0] / errors[1],
                lowest=3.46,
                highest=3.47,
            ),
            Check(
                claim="the root mean square error does not",
                quantity="the same of e sqrt(n)",
                value=float(roots[0] / roots[1]),
                lowest=0.999,
                highest=1.001,
            ),
        ),
    )


#: of velocity over ground and rate of lean that kinematics joins: residuals (6, 9) and (7, 8)
LEANING_PAIRS = (("x_dot", "phi_dot"), ("y_dot", "theta_dot"))
#: that the thesis names beside (6, 9): (7, 9)
NAMED_PAIRS = (("y_dot", "phi_dot"),)
#: a commanded lean, which is no equilibrium [rad], and the time after which the loop has settled [s]
_ASKED_LEAN, _SETTLING = float(np.radians(2.0)), 60.0


def clear_correlation(found: Correlations) -> float:
    """Return from what size on a residual's correlation with another is clear: four of its standard errors."""
    place = found.labels.index("e_y_dot"), found.labels.index("e_phi_dot")
    return 4.0 / float(np.sqrt(found.counts[place]))


class FixedFrame:
    """u = K (r - x) with the gain of psi = 0 and no turn into the heading's frame, as the thesis has it."""

    def __init__(self, gain: NDArray[np.float64], sample_time: float) -> None:
        self.gain, self.sample_time = gain, sample_time

    def reset(self) -> None:
        """Forget the past; this controller has none."""

    def update(
        self,
        t: float,  # noqa: ARG002
        state: NDArray[np.float64],
        reference: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return the wheel torques (n,) [N m]."""
        return self.gain @ (reference - state)


def residual_pairs(bench: Bench) -> Mistake:
    """Section 4.2 names the residual pairs (7, 9) and (6, 9)."""
    found = [one.correlations for one in bench.validations]
    clear = max(clear_correlation(one) for one in found)
    first, second, named = (
        [one.between(f"e_{a}", f"e_{b}")[0] for one in found] for a, b in LEANING_PAIRS + NAMED_PAIRS
    )
    return Mistake(
        number=13,
        where="section 4.2",
        thesis="Residual 7 goes with residual 9, and residual 6 with residual 9 negatively.",
        right="Leaning about y moves the ball along x, leaning about x along y the other way: the pairs are "
        "(6, 9) and (7, 8), with opposite signs.",
        shown_by=(
            Check.over(
                [abs(one) for one in named],
                claim="residual 7 does not go with 9",
                quantity="their correlation on the twin, its size",
                highest=clear,
            ),
            Check.over(
                first, claim="6 goes with 9, and not oppositely", quantity="their correlation", lowest=clear
            ),
            Check.over(
                second, claim="7 goes with 8, oppositely", quantity="their correlation", highest=-clear
            ),
        ),
    )


def gain_at_other_headings(bench: Bench) -> Mistake:
    """The gain is designed at psi = 0 and applied up to psi = pi."""
    limit = _last_stable_heading(bench)
    run = simulate(
        Model(bench.robot),
        FixedFrame(bench.design.gain, bench.robot.sensors.sample_time),
        CHANGE,
        duration=20.0,
        initial_state=np.zeros(10),
    )
    fell = float(run.t[-1]) if run.ended else float("nan")
    turned = bench.frictionless("exact", CHANGE)
    return Mistake(
        number=14,
        where="sections 5.1 and 5.2",
        thesis="The reference goes to psi = pi under u = K (r - x) with one gain.",
        right="The wheels turn with the body, so that the error must be turned into the heading's frame "
        "first, u = K S(psi) (r - x); the thesis has no word on it. Without, the robot falls on the "
        "thesis's own reference.",
        shown_by=(
            Check(
                claim="one gain does not balance at every heading",
                quantity="largest heading at which it does",
                value=float(np.degrees(limit)),
                unit="deg",
                highest=179.0,
            ),
            Check(
                claim="the change to [1 -1 pi] ends in a fall",
                quantity="when the model falls, the change at t = 3 s",
                value=fell,
                unit="s",
                highest=20.0,
            ),
            Check(
                claim="with the error turned it does not",
                quantity="largest lean of the same run with S(psi)",
                value=float(np.degrees(np.abs(turned.states[:, 2:4]).max())),
                unit="deg",
                highest=10.0,
            ),
        ),
    )


def reference_and_stability(bench: Bench) -> Mistake:
    """Section 5.1 asks A r = 0 of a reference for the sake of stability."""
    robot, gain = bench.robot, bench.design.gain
    linear = Model(robot).linearize()
    reference = np.zeros(10)
    reference[3] = _ASKED_LEAN
    F, G = held(linear.A, linear.B, robot.sensors.sample_time)
    largest = float(np.abs(np.linalg.eigvals(F - G @ gain)).max())
    # where x_dot = A x + B K (r - x) is zero
    rest = np.linalg.solve(linear.A - linear.B @ gain, -linear.B @ gain @ reference)
    run = simulate(
        Model(robot),
        FixedFrame(gain, robot.sensors.sample_time),
        lambda _: reference,
        duration=_SETTLING,
        initial_state=np.zeros(10),
    )
    last = run.states[-1] if not run.ended else np.full(10, np.nan)
    return Mistake(
        number=19,
        where="section 5.1, (5.3)",
        thesis="A r = 0 is needed for (5.3) to be stable.",
        right="A r is a constant input to (5.3): it moves the point of rest, e = (A - B K)^-1 A r, and nothing "
        "else. The eigenvalues of A - B K hold no r.",
        shown_by=(
            Check(
                claim="the reference has A r other than 0",
                quantity=f"largest entry of A r, phi = {np.degrees(_ASKED_LEAN):g} degrees, its size",
                value=float(np.abs(linear.A @ reference).max()),
                lowest=0.1,
            ),
            Check(
                claim="the loop is stable whatever r is",
                quantity="largest eigenvalue of the sampled loop, its size",
                value=largest,
                highest=1.0,
            ),
            Check(
                claim="the nonlinear model comes to rest under it",
                quantity=f"largest rate after {_SETTLING:g} s, of all ten states' rates",
                value=float(np.abs(last[5:]).max()),
                highest=1e-4,
            ),
            Check(
                claim="away from the reference",
                quantity="x at rest",
                value=float(last[0]),
                unit="m",
                lowest=0.01,
            ),
            Check(
                claim="as (5.3) says",
                quantity="the same over that of (5.3)",
                value=float(last[0] / rest[0]),
                lowest=0.99,
                highest=1.01,
            ),
        ),
    )


def _last_stable_heading(bench: Bench) -> float:
    """Return the largest heading [rad] up to which the gain, not turned, keeps the sampled linear model stable."""
    linear = Model(bench.robot).linearize()
    F, G = held(linear.A, linear.B, bench.robot.sensors.sample_time)
    last = 0.0
    for psi in np.radians(np.arange(0.0, 180.5, 0.5)):
        # in the heading's frame the model is the same, and the error that the gain sees is turned by psi
        closed = F - G @ bench.design.gain @ _turn(psi)
        if np.abs(np.linalg.eigvals(closed)).max() >= 1.0 + 1e-9:
            break
        last = float(psi)
    return last


def _turn(psi: float) -> NDArray[np.float64]:
    """Return the matrix (10, 10) that takes an error from the heading's frame back to the world's."""
    c, s = np.cos(psi), np.sin(psi)
    pair = np.array([[c, -s], [s, c]])
    matrix = np.eye(10)
    for place in (0, 2, 5, 7):
        matrix[place : place + 2, place : place + 2] = pair
    return matrix


#: in the order of the list
MISTAKES: tuple[Callable[[Bench], Mistake], ...] = (
    mistaken_equations.rotation_about_y,
    mistaken_equations.velocity_over_ground,
    mistaken_equations.derivative_of_angles,
    mistaken_equations.rates_of_angles,
    mistaken_equations.inertia_counted_twice,
    mistaken_equations.no_counter_torque,
    mistaken_equations.rotors_left_out,
    mistaken_equations.friction_on_absolute_spin,
    speed_clamp_printed,
    mistaken_equations.seam_curve,
    ball_inertia,
    rounded_constants,
    residual_pairs,
    gain_at_other_headings,
    error_over_count,
    mistaken_equations.nonholonomic_rates,
    mistaken_equations.locked_wheels_twice,
    mistaken_equations.undefined_inverses,
    reference_and_stability,
)
