"""Check that a robot's numbers are plausible together: sizes, masses, inertias, motors and rates.

`ballbot.robot.checks` refuses impossible robots. `robot_findings` finds improbable ones, each a finding: an error where
a result would be meaningless (a body of 17 g with 4.37 kg m^2), a warning where the value is unusual. The ranges are
wide: the presets, published robots of 0.6 to 52 kg, lie well within them. A single value is compared with the usual
values of its parameter.

A slip of units is searched for among the parameters of each error: one parameter that, had it been meant in another
unit, explains the findings on a robot.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ballbot.errors import InputError, every
from ballbot.findings import Finding, by_severity, error, note, warning
from ballbot.robot.components import BY_NAME, PARAMETERS
from ballbot.robot.parameters import DIMENSIONLESS, UNITS, Value, numbers_of, to_si, value_of
from ballbot.robot.robot import Robot, with_values

Range = tuple[float, float]
#: a number that follows from a robot's parameters: the code of its findings; the parameters that the sentence shows,
#: with blanks between; its value; its usual range; the range beyond which it is an error; and the number in words, {}
#: for itself, empty if it is the parameter's own
_Usual = tuple[str, str, float, Range, Range, str]

_ANY = (-math.inf, math.inf)
#: a single value this many times beyond the usual ones is an error; friction may be, after a poor identification
_FAR = 10.0


def _of_body(robot: Robot) -> list[_Usual]:
    ball, body = robot.ball, robot.body
    r_b, height = ball.radius, body.center_of_mass
    moments = np.diag(body.inertia_about_center_of_mass())
    xx, yy, zz = (math.sqrt(max(float(moment), 0.0) / body.mass) for moment in moments)
    density = ball.mass / (4.0 / 3.0 * math.pi * r_b**3)
    # a body of rods and plates rocks about its centre of mass like a mass at this fraction of l from it
    rocks = "the radius of gyration about the centre of mass is {} times that height"
    ratio = float(moments[:2].max() / moments[:2].min())
    return [
        # a basketball has 84 kg/m^3, a bowling ball 1300; an inflated film and solid steel are possible
        ("robot-ball", "ball.radius ball.mass", density, (30.0, 2500.0), (5.0, 9000.0),
         "a mean density of {} kg/m^3"),
        ("robot-ball", "ball.mass body.mass", body.mass / ball.mass, (0.7, 100.0), (0.1, 1000.0),
         "the body weighs {} times the ball"),
        ("robot-body", "body.center_of_mass ball.radius", height / r_b, (1.2, 10.0), (1.0, 25.0),
         "{} ball radii above its centre"),
        *(("robot-body", f"body.mass body.center_of_mass body.inertia.{axis}", arm / height, (0.15, 1.2),
           (0.04, 2.5), rocks) for axis, arm in (("xx", xx), ("yy", yy))),
        ("robot-body", "body.inertia.zz body.mass ball.radius", zz / r_b, (0.2, 4.0), (0.05, 12.0),
         "the body's mass lies {} ball radii from its vertical axis"),
        ("robot-body", "body.inertia.xx body.inertia.yy", ratio, (1.0, 3.0), (1.0, 40.0),
         "about the centre of mass they differ {} times; check that xx, yy and zz are in their order"),
    ]  # fmt: skip


def _of_wheels(robot: Robot) -> list[_Usual]:
    wheels, r_b, r_w = robot.wheels, robot.ball.radius, robot.wheels.radius
    azimuths = np.sort(np.mod(wheels.azimuths, 2.0 * math.pi))
    gap = float(np.diff(np.append(azimuths, azimuths[0] + 2.0 * math.pi)).min())
    room = (r_b + r_w) * math.sin(wheels.tilt) * math.tan(0.5 * min(gap, 3.0))
    # without inertia, wheels are light
    rims = robot.wheel_count * wheels.inertia / r_w**2 / robot.body.mass or math.nan
    rollers = ("radius", wheels.rollers.radius, 0.35), ("row_spacing", wheels.rollers.row_spacing, 1.0)
    return [
        ("robot-wheels", "wheels.radius ball.radius", r_w / r_b, (0.15, 0.9), (0.03, 1.5),
         "a wheel has {} times the ball's radius"),
        ("robot-wheels", "wheels.tilt", math.degrees(wheels.tilt), (25.0, 65.0), (10.0, 80.0),
         "{} deg from the ball's zenith"),
        ("robot-wheels", "wheels.radius wheels.tilt wheels.azimuths ball.radius", r_w / room, (0.0, 1.0), (0.0, 1.0),
         "neighbouring wheels cut into each other, with {} times the radius at which they touch"),
        *(("robot-wheels", f"wheels.rollers.{name} wheels.radius", size / r_w, (0.0, most), (0.0, 1.5 * most),
           "{} of the wheel's radius") for name, size, most in rollers),
        ("robot-wheels", "wheels.inertia wheels.radius body.mass", rims, (1e-4, 1.0), (0.0, 2.0),
         "even with all their mass at the rim, the wheels would weigh {} times the body with its wheels"),
    ]  # fmt: skip


def _of_drive(robot: Robot) -> list[_Usual]:
    body, wheels, drive, friction = robot.body, robot.wheels, robot.drive, robot.friction
    r_b, r_w = robot.ball.radius, robot.wheels.radius
    about_ball = np.diag(body.inertia_about_ball_center())[:2]
    weight = body.mass * robot.gravity * body.center_of_mass
    rotor = (drive.reflected_inertia + wheels.inertia) * (r_b / r_w) ** 2 / float(about_ball.min())
    current = drive.torque_limit / (drive.gear_ratio * drive.torque_constant)
    # (r_b / r_w) cos(tilt) sum |cos(beta - direction)| u, at its least over directions
    directions = np.linspace(0.0, math.pi, 61)[:, None]
    strongest = np.abs(np.cos(np.array(wheels.azimuths) - directions)).sum(axis=1).min()
    held = float(strongest) * r_b / r_w * math.cos(wheels.tilt) * drive.torque_limit
    lean = math.degrees(math.asin(min(1.0, held / weight)))
    fall = robot.sensors.sample_time * math.sqrt(weight / float(about_ball.max()))
    dry = max(friction.breakaway) / drive.torque_limit
    rim = drive.torque_limit / max(max(friction.viscous), 1e-300) * r_w
    return [
        ("robot-drive", "drive.gear_ratio drive.motor_inertia drive.gear_inertia wheels.inertia", rotor, (0.0, 0.5),
         (0.0, 3.0), "on the ball, a rotor and its wheel have {} times the body's inertia"),
        ("robot-drive", "drive.supply_voltage drive.speed_constant drive.gear_ratio wheels.radius",
         drive.top_speed * r_w, (0.2, 25.0), (0.05, 100.0), "the wheels reach {} m/s at their rim"),
        ("robot-drive", "drive.torque_limit drive.torque_constant drive.gear_ratio", current, (0.2, 120.0),
         (0.02, 600.0), "takes {} A"),
        ("robot-drive", "drive.backlash", math.degrees(drive.backlash), (0.0, 5.0), _ANY, "{} deg at the wheel"),
        ("robot-balance", "drive.torque_limit body.mass body.center_of_mass", lean, (2.0, 90.0), (0.5, 90.0),
         "holds a lean of {} deg"),
        ("robot-balance", "sensors.sample_time", fall, (0.0, 0.15), (0.0, 0.5),
         "{} of the time in which the body falls e-fold"),
        ("robot-friction", "friction.coulomb friction.stribeck drive.torque_limit", dry, (0.0, 0.5), (0.0, 0.999),
         "a wheel's dry friction c + s takes {} of the motor's largest torque"),
        ("robot-friction", "friction.viscous drive.torque_limit", rim, (0.3, math.inf), (0.03, math.inf),
         "against viscous friction alone a wheel's rim reaches {} m/s"),
    ]  # fmt: skip


def _single(robot: Robot) -> Iterator[_Usual]:
    """Yield each number that has usual values."""
    for parameter in PARAMETERS:
        value, (low, high) = value_of(robot, parameter), parameter.usual
        table = parameter.table.partition(".")[0]
        # the speed and the exponent of a term that no wheel has
        unused = parameter.key.startswith("stribeck_") and not any(robot.friction.stribeck)
        if isinstance(value, tuple) or math.isinf(low) or unused:
            continue
        possible = _ANY if table == "friction" else (low / _FAR if low > 0.0 else -math.inf, _FAR * high)
        in_file_units = value > high and parameter.written_in != parameter.unit
        slip = f"was it meant in {parameter.written_in}?" if in_file_units else ""
        code = f"robot-{table}" if table else "robot-gravity"
        yield code, parameter.name, value, parameter.usual, possible, slip


def _of_table(robot: Robot) -> Iterator[Finding]:
    """Yield a finding for each number outside the usual range of robots."""
    table = (*_single(robot), *_of_body(robot), *_of_wheels(robot), *_of_drive(robot))
    for code, columns, value, (least, most), possible, meaning in table:
        if math.isnan(value) or least <= value <= most:
            continue
        names = columns.split()
        said = every(f"{name} {_with_unit(name, value_of(robot, BY_NAME[name]))}" for name in names)
        words = f": {meaning.format(f'{value:.3g}')}" if meaning else ""
        usual = f"{least:g} to {most:g}" if math.isfinite(most) else f"{least:g} or more"
        make = warning if possible[0] <= value <= possible[1] else error
        yield make(code, f"{said}{words} (usual: {usual}).", *names)


def robot_findings(robot: Robot, *, file: str = "") -> tuple[Finding, ...]:
    """Return the unusual and impossible values of a robot, which `checks` has passed, as findings, errors first.

    Their place is `file`, for messages that are about files as well, and its columns name the parameters.
    """
    findings = _findings(robot)
    errors = [item for item in findings if item.severity == "error"]
    slip = _likeliest_slip(robot, errors) if errors else None

    def completed(finding: Finding) -> Finding:
        hint = ""
        if finding.severity == "error":
            hint = f" Check {every(finding.where.columns)}."
            if slip and all((item.code, item.where) != (finding.code, finding.where) for item in slip[1]):
                hint = f" Did you mean {slip[0]}?"
        return replace(finding, text=finding.text + hint, where=replace(finding.where, file=file))

    return by_severity(map(completed, findings))


def _findings(robot: Robot) -> list[Finding]:
    return [*_of_table(robot), *_exact_friction(robot), *_of_deviations(robot)]


def _exact_friction(robot: Robot) -> Iterator[Finding]:
    """Yield friction without a standard deviation: it counts as exact where it is compensated."""
    exact = [
        parameter.name
        for parameter in PARAMETERS
        if parameter.table == "friction"
        and np.any(value_of(robot, parameter))
        and parameter.name not in robot.standard_deviations
        and not (parameter.key.startswith("stribeck_") and not any(robot.friction.stribeck))
    ]
    if exact:
        text = f"No standard deviation of {every(exact)} is stated: compensation takes each value as exact."
        yield note("robot-deviation", text, *exact)


def _of_deviations(robot: Robot) -> Iterator[Finding]:
    """Yield standard deviations that leave a value all but open; friction's may, after a poor identification."""
    for name, deviation in robot.standard_deviations.items():
        if name.startswith("friction.") or (name.startswith("body.inertia.") and name[-2] != name[-1]):
            continue
        pair = value_of(robot, BY_NAME[name]), deviation
        values, deviations = (np.array(numbers_of(value), dtype=float) for value in pair)
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
_INERTIA = tuple(parameter.name for parameter in PARAMETERS if parameter.table == "body.inertia")


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
        units = [unit for unit in UNITS[parameter.unit] if unit != parameter.unit]
        factors = [to_si(1.0, unit, parameter.unit) for unit in units]
        for scale in [scale for factor in factors for scale in (factor, 1.0 / factor)]:
            changed: dict[str, Value] = {}
            for key in together:
                value = value_of(robot, BY_NAME[key])
                scaled = tuple(scale * number for number in numbers_of(value))
                changed[key] = scaled if isinstance(value, tuple) else scaled[0]
            try:
                meant = with_values(robot, changed)
            except InputError:
                continue
            left = _findings(meant)
            wrong = sum(item.severity == "error" for item in left)
            if len(left) - wrong <= others and (wrong, len(left)) < fewest:
                words = f"{name} {_with_unit(name, value_of(meant, parameter))}"
                best, fewest = (words, left), (wrong, len(left))
    return best


def _with_unit(name: str, value: Value) -> str:
    """Return a parameter's value with its unit, an angle in degrees as well."""
    unit, numbers = BY_NAME[name].unit, numbers_of(value)

    def text(factor: float, unit: str) -> str:
        listed = ", ".join(f"{factor * number:.4g}" for number in numbers)
        return f"{f'[{listed}]' if isinstance(value, tuple) else listed}{unit}"

    if unit == "rad":
        return f"{text(1.0, ' rad')} ({text(math.degrees(1.0), ' deg')})"
    return text(1.0, "" if unit == DIMENSIONLESS else f" {unit}")
