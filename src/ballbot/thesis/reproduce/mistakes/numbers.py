"""Limits, parameters and error measures: the clamp (3.2), the ball's inertia, rounded constants, and (4.1)."""

from __future__ import annotations

import numpy as np

from ballbot.mechanics.friction_laws.classical import Classical
from ballbot.robot.derived import shell_wall, thick_shell_inertia, thin_shell_inertia, wheel_speed_limit
from ballbot.simulation.driveline import Driveline, SpeedClamp, simulate_drivelines, speed_clamp
from ballbot.thesis.reproduce.appendices import RUBBER
from ballbot.thesis.reproduce.bench import Bench
from ballbot.thesis.reproduce.item import Check, Mistake
from ballbot.validation.errors import thesis_error

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
