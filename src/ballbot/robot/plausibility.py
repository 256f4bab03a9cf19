"""Whether a robot's numbers go together: sizes, masses, inertias, motors and rates against one another.

`ballbot.robot.checks` refuses impossible robots. The table `_CHECKS` finds possible but improbable ones, each a
finding: an error where a result would be meaningless (a body of 17 g with 4.37 kg m^2), a warning where the value is
unusual. The ranges are wide: the presets, published robots of 0.6 to 52 kg, lie well within them.

A slip of units is searched for among the parameters of each error: one parameter that, had it been meant in another
unit, explains the findings on a robot.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from ballbot.errors import InputError, every
from ballbot.findings import Finding, by_severity, error, note, warning
from ballbot.robot.components import BY_NAME, PARAMETERS
from ballbot.robot.parameters import DIMENSIONLESS, UNITS, Value, numbers_of, to_si, value_of
from ballbot.robot.robot import Robot, with_values

Range = tuple[float, float]


@dataclass(frozen=True)
class _Check:
    """What a number that follows from a robot's parameters is on robots."""

    code: str  #: of its findings
    names: str  #: of the parameters that the sentence shows, with blanks between
    usual: Range
    possible: Range  #: a value beyond is an error
    meaning: str = ""  #: the number in words, {} for itself; empty if it is the parameter's own


_ANY = (-math.inf, math.inf)
_CHECKS = {
    # from the equator to the poles with a margin; from the Moon to Jupiter
    "gravity": _Check("robot-gravity", "gravity", (9.7, 9.9), (1.5, 26.0)),
    # a basketball has 84 kg/m^3, a bowling ball 1300; an inflated film and solid steel are possible
    "density": _Check(
        "robot-ball", "ball.radius ball.mass", (30.0, 2500.0), (5.0, 9000.0), "a mean density of {} kg/m^3"
    ),
    "ball.radius": _Check("robot-ball", "ball.radius", (0.03, 0.5), (0.01, 1.0)),
    "body_over_ball": _Check(
        "robot-ball", "ball.mass body.mass", (0.7, 100.0), (0.1, 1000.0), "the body weighs {} times the ball"
    ),
    "height": _Check(
        "robot-body",
        "body.center_of_mass ball.radius",
        (1.2, 10.0),
        (1.0, 25.0),
        "{} ball radii above its centre",
    ),
    # a body of rods and plates rocks about its centre of mass like a mass at this fraction of l from it
    **{
        f"gyration_{axis}": _Check(
            "robot-body",
            f"body.mass body.center_of_mass body.inertia.{axis}",
            (0.15, 1.2),
            (0.04, 2.5),
            "the radius of gyration about the centre of mass is {} times that height",
        )
        for axis in ("xx", "yy")
    },
    "gyration_zz": _Check(
        "robot-body",
        "body.inertia.zz body.mass ball.radius",
        (0.2, 4.0),
        (0.05, 12.0),
        "the body's mass lies {} ball radii from its vertical axis",
    ),
    "inequality": _Check(
        "robot-body",
        "body.inertia.xx body.inertia.yy",
        (1.0, 3.0),
        (1.0, 40.0),
        "about the centre of mass they differ {} times; check that xx, yy and zz are in their order",
    ),
    "wheel_over_ball": _Check(
        "robot-wheels",
        "wheels.radius ball.radius",
        (0.15, 0.9),
        (0.03, 1.5),
        "a wheel has {} times the ball's radius",
    ),
    "tilt": _Check(
        "robot-wheels", "wheels.tilt", (25.0, 65.0), (10.0, 80.0), "{} deg from the ball's zenith"
    ),
    "crowding": _Check(
        "robot-wheels",
        "wheels.radius wheels.tilt wheels.azimuths ball.radius",
        (0.0, 1.0),
        (0.0, 1.0),
        "neighbouring wheels cut into each other, with {} times the radius at which they touch",
    ),
    "roller": _Check(
        "robot-wheels",
        "wheels.rollers.radius wheels.radius",
        (0.0, 0.35),
        (0.0, 0.525),
        "{} of the wheel's radius",
    ),
    "spacing": _Check(
        "robot-wheels",
        "wheels.rollers.row_spacing wheels.radius",
        (0.0, 1.0),
        (0.0, 1.5),
        "{} of the wheel's radius",
    ),
    "wheels.rollers.per_row": _Check("robot-wheels", "wheels.rollers.per_row", (4.0, 60.0), (3.0, 1000.0)),
    "rims": _Check(
        "robot-wheels",
        "wheels.inertia wheels.radius body.mass",
        (1e-4, 1.0),
        (0.0, 2.0),
        "even with all their mass at the rim, the wheels would weigh {} times the body with its wheels",
    ),
    "drive.gear_ratio": _Check(
        "robot-drive", "drive.gear_ratio", (1.0, 200.0), (0.8, 600.0), "{} motor turns for a wheel turn"
    ),
    "rotor": _Check(
        "robot-drive",
        "drive.gear_ratio drive.motor_inertia drive.gear_inertia wheels.inertia",
        (0.0, 0.5),
        (0.0, 3.0),
        "on the ball, a rotor and its wheel have {} times the body's inertia",
    ),
    "rim_speed": _Check(
        "robot-drive",
        "drive.supply_voltage drive.speed_constant drive.gear_ratio wheels.radius",
        (0.2, 25.0),
        (0.05, 100.0),
        "the wheels reach {} m/s at their rim",
    ),
    "current": _Check(
        "robot-drive",
        "drive.torque_limit drive.torque_constant drive.gear_ratio",
        (0.2, 120.0),
        (0.02, 600.0),
        "takes {} A",
    ),
    "drive.supply_voltage": _Check("robot-drive", "drive.supply_voltage", (3.0, 120.0), (0.5, 800.0)),
    "play": _Check("robot-drive", "drive.backlash", (0.0, 5.0), _ANY, "{} deg at the wheel"),
    "lean": _Check(
        "robot-balance",
        "drive.torque_limit body.mass body.center_of_mass",
        (2.0, 90.0),
        (0.5, 90.0),
        "holds a lean of {} deg",
    ),
    "fall": _Check(
        "robot-balance",
        "sensors.sample_time",
        (0.0, 0.15),
        (0.0, 0.5),
        "{} of the time in which the body falls e-fold",
    ),
    "sensors.sample_time": _Check("robot-sensors", "sensors.sample_time", (2e-4, 1.0), (2e-5, 1.0)),
    # of poor sensors; more was meant in degrees
    "sensors.gyro_noise": _Check(
        "robot-sensors", "sensors.gyro_noise", (0.0, 0.1), _ANY, "was it meant in deg/s?"
    ),
    "sensors.attitude_noise": _Check(
        "robot-sensors", "sensors.attitude_noise", (0.0, 0.03), _ANY, "was it meant in degrees?"
    ),
    "sensors.heading_drift": _Check(
        "robot-sensors", "sensors.heading_drift", (-0.1, 0.1), _ANY, "was it meant in deg/s?"
    ),
    "dry_friction": _Check(
        "robot-friction",
        "friction.coulomb friction.stribeck drive.torque_limit",
        (0.0, 0.5),
        (0.0, 0.999),
        "a wheel's dry friction c + s takes {} of the motor's largest torque",
    ),
    "viscous_speed": _Check(
        "robot-friction",
        "friction.viscous drive.torque_limit",
        (0.3, math.inf),
        (0.03, math.inf),
        "against viscous friction alone a wheel's rim reaches {} m/s",
    ),
    "friction.rolling": _Check(
        "robot-friction",
        "friction.rolling",
        BY_NAME["friction.rolling"].usual,
        (0.0, 0.6),
        "it brakes as a floor that rises by {} in 1",
    ),
    **{
        name: _Check("robot-friction", name, BY_NAME[name].usual, (1e-9, math.inf))
        for name in ("friction.stribeck_speed", "friction.stribeck_exponent")
    },
}


def _of_body(robot: Robot) -> dict[str, float]:
    """Return the numbers of `_CHECKS` that follow from ball and body."""
    ball, body = robot.ball, robot.body
    moments = np.diag(body.inertia_about_center_of_mass())
    xx, yy, zz = (math.sqrt(max(float(moment), 0.0) / body.mass) for moment in moments)
    inertia = float(np.diag(body.inertia_about_ball_center())[:2].max())
    weight = body.mass * robot.gravity * body.center_of_mass
    # (r_b / r_w) cos(tilt) sum |cos(beta - direction)| u, at its least over directions
    directions = np.linspace(0.0, math.pi, 61)[:, None]
    strongest = np.abs(np.cos(np.array(robot.wheels.azimuths) - directions)).sum(axis=1).min()
    lever = ball.radius / robot.wheels.radius * math.cos(robot.wheels.tilt)
    held = float(strongest) * lever * robot.drive.torque_limit
    return {
        "density": ball.mass / (4.0 / 3.0 * math.pi * ball.radius**3),
        "body_over_ball": body.mass / ball.mass,
        "height": body.center_of_mass / ball.radius,
        "gyration_xx": xx / body.center_of_mass,
        "gyration_yy": yy / body.center_of_mass,
        "gyration_zz": zz / ball.radius,
        "inequality": float(moments[:2].max() / moments[:2].min()),
        "lean": math.degrees(math.asin(min(1.0, held / weight))),
        "fall": robot.sensors.sample_time * math.sqrt(weight / inertia),
    }


def _of_wheels(robot: Robot) -> dict[str, float]:
    """Return those that follow from the wheels and their places."""
    wheels, ball = robot.wheels, robot.ball
    azimuths = np.sort(np.mod(wheels.azimuths, 2.0 * math.pi))
    gap = float(np.diff(np.append(azimuths, azimuths[0] + 2.0 * math.pi)).min())
    room = (ball.radius + wheels.radius) * math.sin(wheels.tilt) * math.tan(0.5 * min(gap, 3.0))
    return {
        "wheel_over_ball": wheels.radius / ball.radius,
        "tilt": math.degrees(wheels.tilt),
        "crowding": wheels.radius / room,
        "roller": wheels.rollers.radius / wheels.radius,
        "spacing": wheels.rollers.row_spacing / wheels.radius,
        # without inertia, wheels are light
        "rims": robot.wheel_count * wheels.inertia / wheels.radius**2 / robot.body.mass or math.nan,
    }


def _of_drive(robot: Robot) -> dict[str, float]:
    """Return those that follow from motors, sensors and friction."""
    drive, wheels, friction = robot.drive, robot.wheels, robot.friction
    on_ball = (drive.reflected_inertia + wheels.inertia) * (robot.ball.radius / wheels.radius) ** 2
    return {
        "rotor": on_ball / float(np.diag(robot.body.inertia_about_ball_center())[:2].min()),
        "rim_speed": drive.top_speed * wheels.radius,
        "current": drive.torque_limit / (drive.gear_ratio * drive.torque_constant),
        "play": math.degrees(drive.backlash),
        "dry_friction": max(friction.breakaway) / drive.torque_limit,
        "viscous_speed": drive.torque_limit / max(max(friction.viscous), 1e-300) * wheels.radius,
    }


def _of_table(robot: Robot) -> Iterator[Finding]:
    """Yield a finding for each number that is beyond what robots have."""
    own = {name: attrgetter(name)(robot) for name in _CHECKS if name in BY_NAME}
    if not any(robot.friction.stribeck):  # the speed and the exponent of a term that no wheel has
        own |= {"friction.stribeck_speed": math.nan, "friction.stribeck_exponent": math.nan}
    numbers = own | _of_body(robot) | _of_wheels(robot) | _of_drive(robot)
    for key, check in _CHECKS.items():
        value, (least, most), names = numbers[key], check.usual, check.names.split()
        if math.isnan(value) or least <= value <= most:
            continue
        said = every(f"{name} {_with_unit(name, value_of(robot, BY_NAME[name]))}" for name in names)
        meaning = f": {check.meaning.format(f'{value:.3g}')}" if check.meaning else ""
        usual = f"{least:g} to {most:g}" if math.isfinite(most) else f"{least:g} or more"
        found = warning if check.possible[0] <= value <= check.possible[1] else error
        yield found(check.code, f"{said}{meaning} (usual: {usual}).", *names)


def robot_findings(robot: Robot, *, file: str = "") -> tuple[Finding, ...]:
    """Return the unusual and impossible values of a robot as findings, errors first.

    Parameters
    ----------
    robot : Robot
        One that `ballbot.robot.checks` has passed.
    file : str
        The place of the findings, for messages that are about files as well.

    Returns
    -------
    tuple of Finding
        The place's columns name the parameters.
    """
    findings = _findings(robot)
    errors = [one for one in findings if one.severity == "error"]
    slip = _likeliest_slip(robot, errors) if errors else None

    def completed(finding: Finding) -> Finding:
        text = finding.text
        if finding.severity == "error":
            mended = slip and all((one.code, one.where) != (finding.code, finding.where) for one in slip[1])
            text += (
                f" Did you mean {slip[0]}?" if slip and mended else f" Check {every(finding.where.columns)}."
            )
        return replace(finding, text=text, where=replace(finding.where, file=file))

    return by_severity(map(completed, findings))


def _findings(robot: Robot) -> list[Finding]:
    return [*_of_table(robot), *_exact_friction(robot), *_of_deviations(robot)]


def _exact_friction(robot: Robot) -> Iterator[Finding]:
    """Yield friction without a standard deviation: it counts as exact where it is compensated."""
    exact = [
        one.name
        for one in PARAMETERS
        if one.table == "friction"
        and np.any(value_of(robot, one))
        and one.name not in robot.standard_deviations
        and not (one.key.startswith("stribeck_") and not any(robot.friction.stribeck))
    ]
    if exact:
        text = f"No standard deviation of {every(exact)} is stated: compensation takes each value as exact."
        yield note("robot-deviation", text, *exact)


def _of_deviations(robot: Robot) -> Iterator[Finding]:
    """Yield standard deviations that leave a value all but open; friction's may, after a poor identification."""
    for name, deviation in robot.standard_deviations.items():
        if name.startswith("friction.") or (name.startswith("body.inertia.") and name[-2] != name[-1]):
            continue
        values, deviations = (
            np.atleast_1d(np.array(one, dtype=float)) for one in (value_of(robot, BY_NAME[name]), deviation)
        )
        # an azimuth of zero, say, is known by its own scale
        scale = np.where(BY_NAME[name].unit == "rad", np.maximum(np.abs(values), 1.0), np.abs(values))
        worst = int(np.argmax(deviations - 0.5 * scale))
        if deviations[worst] > 0.5 * scale[worst] > 0.0:
            text = (
                f"{name} is {values[worst]:.4g} with a standard deviation of {deviations[worst]:.4g} "
                f"{BY_NAME[name].unit}, which leaves it open; look at its unit."
            )
            yield warning("robot-deviation", text, name)


#: rescaled together: a file with one of them in another unit has all of them in it
_INERTIA = tuple(one.name for one in PARAMETERS if one.table == "body.inertia")


def _likeliest_slip(robot: Robot, errors: Sequence[Finding]) -> tuple[str, Sequence[Finding]] | None:
    """Return which parameter's unit, if changed, removes the most errors, as a sentence, and the findings that remain.

    None if none leaves fewer errors than there are. A unit that makes something else unusual explains nothing.
    """
    best, fewest = None, (len(errors), 0)
    others = len(_findings(robot)) - len(errors)
    for name in dict.fromkeys(name for finding in errors for name in finding.where.columns):
        parameter, together = BY_NAME[name], _INERTIA if name in _INERTIA else (name,)
        if parameter.shape == "whole number":
            continue
        factors = [
            to_si(1.0, unit, parameter.unit) for unit in UNITS[parameter.unit] if unit != parameter.unit
        ]
        for scale in [scale for factor in factors for scale in (factor, 1.0 / factor)]:
            try:
                meant = with_values(
                    robot, {one: _times(value_of(robot, BY_NAME[one]), scale) for one in together}
                )
            except InputError:
                continue
            left = _findings(meant)
            wrong = sum(one.severity == "error" for one in left)
            if len(left) - wrong <= others and (wrong, len(left)) < fewest:
                words = f"{name} {_with_unit(name, value_of(meant, parameter))}"
                best, fewest = (words, left), (wrong, len(left))
    return best


def _times(value: Value, scale: float) -> Value:
    return tuple(scale * one for one in value) if isinstance(value, tuple) else scale * value


def _with_unit(name: str, value: Value) -> str:
    """Return a parameter's value with its unit, an angle in degrees as well."""
    unit, numbers = BY_NAME[name].unit, numbers_of(value)

    def text(factor: float, unit: str) -> str:
        listed = ", ".join(f"{factor * one:.4g}" for one in numbers)
        return f"{f'[{listed}]' if isinstance(value, tuple) else listed}{unit}"

    if unit == "rad":
        return f"{text(1.0, ' rad')} ({text(math.degrees(1.0), ' deg')})"
    return text(1.0, "" if unit == DIMENSIONLESS else f" {unit}")
