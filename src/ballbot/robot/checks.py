"""The conditions that every robot satisfies; `Robot` checks them when it is made.

Each error is one sentence that names the parameter, its value and what would be right. The physical rules:
moments of inertia are positive and obey the triangle inequality about any point of the body; a ball's inertia
lies between a solid's (2/5 m r^2) and a thin shell's (2/3 m r^2); a motor's torque constant times its speed
constant is near one in SI units.
"""

import math
from collections.abc import Iterator
from itertools import combinations
from numbers import Integral, Real

import numpy as np

from ballbot.errors import InputError, nearest, suggest
from ballbot.robot.components import (
    BY_NAME,
    Ball,
    Body,
    Drive,
    Friction,
    RobotValues,
    Wheels,
    deviation_labels,
    parameters_of_robot,
)
from ballbot.robot.parameters import (
    DIMENSIONLESS,
    SOURCES,
    UNITS,
    Parameter,
    numbers_of,
    parameters_of,
    to_si,
    value_of,
)
from ballbot.robot.wheel_directions import axles

#: fraction by which a ball's inertia may leave the range of solid to thin shell: published ones do by 1 %
_BALL_MARGIN = 0.05

#: range of torque constant times speed constant; conventions for brushless motors differ by up to sqrt(3)
_MOTOR_CONSTANTS = (0.4, 2.5)

#: smallest fraction of its torque that the wheels must be able to give about every axis
_WEAKEST_AXIS = 0.01


def check_robot(robot: RobotValues) -> None:
    """Raise InputError, about the first wrong value, if a robot cannot exist."""
    _check_texts(robot)
    _check_law(robot)
    for parameter in parameters_of_robot(robot):
        for label, value in _numbers(robot, parameter):
            check_number(parameter, label, value)
    _check_ball(robot.ball)
    _check_body(robot.body)
    _check_wheels(robot.wheels)
    _check_drive(robot.drive)
    _check_friction(robot.friction)


def check_source(name: str, source: str) -> None:
    """Raise InputError unless a source begins with one of `SOURCES` (detail may follow a colon)."""
    kind = source.partition(":")[0].strip()
    if kind not in SOURCES or not source.isprintable():
        hint = suggest(kind, SOURCES, otherwise="write one of:")
        raise InputError(f"{name} has the unknown source {source!r}; {hint}")


#: least eigenvalue of correlations rounded to five decimals, of a few dozen numbers
_ROUNDED_CORRELATION = 1e-3


def check_deviations(robot: RobotValues) -> None:
    """Raise InputError if a standard deviation or an interval is invalid.

    A standard deviation is a number of zero or more for each number of a parameter, whole numbers excepted; one that is
    infinite needs an interval about the number.
    """
    for name, deviation in robot.standard_deviations.items():
        if name not in BY_NAME or BY_NAME[name].shape == "whole number":
            raise InputError(f"{name} has a standard deviation but is not a parameter that can have one.")
        value, numbers = value_of(robot, BY_NAME[name]), numbers_of(deviation)
        count = len(numbers_of(value))
        if isinstance(value, tuple) != isinstance(deviation, tuple) or len(numbers) != count:
            raise InputError(f"{name} has the standard deviation {deviation!r}; it needs {count} of them.")
        for number in numbers:
            if not isinstance(number, Real) or not number >= 0.0:
                raise InputError(
                    f"{name} has the standard deviation {number!r}; it must be zero or more, or inf if unknown."
                )
    unknown = {
        label: numbers_of(value_of(robot, BY_NAME[name]))[index]
        for label, name, index, size in deviation_labels(robot.standard_deviations)
        if math.isinf(size)
    }
    for label in {*unknown, *robot.intervals}:
        least, most = robot.intervals.get(label, (math.nan, math.nan))
        if not -math.inf < least <= float(unknown.get(label, math.nan)) <= most < math.inf:
            raise InputError(
                f"A standard deviation of inf, unknown, and an interval belong together: {label} has the interval "
                f"{least:g} to {most:g}, which must be finite and contain that number of the robot."
            )


def check_correlation(robot: RobotValues) -> None:
    """Raise InputError if the correlations are not those of numbers with standard deviations.

    InputError if a number has no finite standard deviation or is listed twice, a row has not one number for each column
    up to its own, the diagonal is not 1, or no errors can have such correlations.
    """
    labels, rows = robot.correlation.of, robot.correlation.lower
    known = {label for label, *_, size in deviation_labels(robot.standard_deviations) if math.isfinite(size)}
    if unknown := [label for label in labels if label not in known]:
        raise InputError(
            f"correlation.of has {unknown[0]!r}, which has no finite standard deviation above zero."
        )
    if len(set(labels)) < len(labels) or [len(row) for row in rows] != list(range(1, len(labels) + 1)):
        raise InputError(
            f"[correlation] must list a number once, and have rows of 1 to {len(labels)} numbers, one for each of them."
        )
    if not labels:
        return
    matrix = robot.correlation.matrix()
    impossible = not np.isfinite(matrix).all() or np.any(matrix.diagonal() != 1.0)
    if impossible or np.linalg.eigvalsh(matrix)[0] < -_ROUNDED_CORRELATION:
        raise InputError(
            "correlation.lower has correlations that no errors can have: the matrix has a negative eigenvalue, or no 1 "
            "at the end of a row. Remove the table [correlation], or identify again."
        )


def _check_texts(robot: RobotValues) -> None:
    if not robot.name or not robot.name.isprintable():
        raise InputError(f"name is {robot.name!r}; a robot needs a name on one line.")
    if robot.body.inertia_about not in ("ball_center", "center_of_mass"):
        raise InputError(
            f'body.inertia.about is {robot.body.inertia_about!r}; write "ball_center" or "center_of_mass".'
        )
    for name, source in robot.sources.items():
        if name not in BY_NAME:
            near = nearest(name, BY_NAME)
            hint = f"; did you mean {near[0]!r}" if near else ""
            raise InputError(f"sources names {name!r}, which is not a parameter{hint}.")
        check_source(name, source)


def _numbers(robot: RobotValues, parameter: Parameter) -> Iterator[tuple[str, object]]:
    """Yield label and value of each number of a parameter; refuse a list that does not fit the wheels."""
    if parameter.name == "body.inertia.xx" and len(robot.body.inertia) != 6:
        raise InputError(
            f"body.inertia has {len(robot.body.inertia)} numbers; it needs six: xx, yy, zz, xy, xz, yz."
        )
    value = value_of(robot, parameter)
    if parameter.shape != "list":
        yield parameter.name, value
        return
    if not isinstance(value, tuple):
        raise InputError(f"{parameter.name} is {value!r}; it must be a tuple with a number for each wheel.")
    if parameter.name == "wheels.azimuths" and len(value) not in (3, 4):
        raise InputError(f"wheels.azimuths lists {len(value)} wheels; a robot must have three or four.")
    if len(value) != robot.wheel_count and value != parameter.default:
        raise InputError(
            f"{parameter.name} has {len(value)} numbers, but wheels.azimuths lists "
            f"{robot.wheel_count} wheels; give one for each wheel."
        )
    yield from ((f"{parameter.name}[{index}]", number) for index, number in enumerate(value))


def check_number(
    parameter: Parameter,
    label: str,  # its name, with the place of the value in a list
    value: object,
) -> None:
    """Raise InputError if a value is not a finite number, has the wrong sign, or is larger than on any robot."""
    whole = parameter.shape == "whole number"
    if isinstance(value, bool) or not isinstance(value, Integral if whole else Real):
        raise InputError(f"{label} is {value!r}; it must be a {'whole ' if whole else ''}number.")
    number, least, most = float(value), parameter.least, parameter.most
    unit = "" if parameter.unit == DIMENSIONLESS else f" {parameter.unit}"
    statement = f"{label} is {number:g}{unit}"
    if not math.isfinite(number):
        raise InputError(f"{statement}; it must be finite.")
    if number < 0.0 <= least:
        raise InputError(f"{statement}; it cannot be negative.")
    if number < least or (number == least and not parameter.least_is_allowed):
        raise InputError(f"{statement}; it must be {f'at least {least:g}' if least else 'above zero'}.")
    if abs(number) > most:
        meant = _meant(number, parameter.unit, most)
        hint = f"did you mean {meant}?" if meant else f"it must be at most {most:g}."
        unlike = "" if parameter.unit == DIMENSIONLESS else ", more than any ball-balancing robot has"
        raise InputError(f"{statement}{unlike}; {hint}")


def check_parameters(record: object) -> None:
    """Raise InputError if a number of a class of parameters, or of the tables in it, is out of its bounds."""
    for parameter in parameters_of(type(record)):
        if parameter.shape not in ("text", "truth value"):
            for value in _values_at(record, parameter.name):
                check_number(parameter, parameter.name, value)


def _values_at(record: object, name: str) -> Iterator[object]:
    """Yield the numbers of a dotted name: nothing for a fault that is off, one or more for each push."""
    key, _, rest = name.partition(".")
    content = getattr(record, key)
    for value in content if isinstance(content, tuple) else (content,):
        if not rest:
            yield value
        elif value is not None:
            yield from _values_at(value, rest)


def _meant(number: float, si_unit: str, largest: float) -> str:
    """Return, as text, the number in the first unit that brings it below `largest` ("" if none does)."""
    for unit in UNITS.get(si_unit, ()):
        converted = to_si(number, unit, si_unit)
        if unit != si_unit and abs(converted) <= largest:
            return f"{number:g} {unit} ({converted:g} {si_unit})"
    return ""


def _check_ball(ball: Ball) -> None:
    m_r2 = ball.mass * ball.radius**2
    solid, shell = 0.4 * m_r2, 2.0 / 3.0 * m_r2
    if not (1.0 - _BALL_MARGIN) * solid <= ball.inertia <= (1.0 + _BALL_MARGIN) * shell:
        raise InputError(
            f"ball.inertia is {ball.inertia:g} kg m^2; with this mass and radius it "
            f"must lie between {solid:.3g} (solid) and {shell:.3g} kg m^2 (thin shell)."
        )


def _check_body(body: Body) -> None:
    moments = np.linalg.eigvalsh(body.inertia_about_center_of_mass())  # smallest first
    # a flat body meets the inequality with equality, up to rounding
    if moments[0] > 0.0 and moments[0] + moments[1] >= moments[2] * (1.0 - 1e-9):
        return
    listed = ", ".join(f"{moment:.4g}" for moment in moments)
    if body.inertia_about == "center_of_mass":
        raise InputError(
            f"body.inertia has the principal moments {listed} kg m^2 about the centre of mass; each must be above zero"
            ", and no body has one larger than the sum of the other two."
        )
    raise InputError(
        f"body.inertia less m l^2 = {body.mass * body.center_of_mass**2:.3g} kg m^2 leaves the principal moments "
        f"{listed} kg m^2 about the centre of mass, which no body has. The inertia may be about the centre of mass "
        'already (about = "center_of_mass"), or the mass or the height is too large.'
    )


def _check_wheels(wheels: Wheels) -> None:
    if not 0.0 < wheels.tilt < math.pi / 2.0:
        meant = f"; did you mean {wheels.tilt:g} deg?" if wheels.tilt < 90.0 else "."
        raise InputError(
            f"wheels.tilt is {wheels.tilt:g} rad; it must lie between 0 and 90 deg (1.571 rad){meant}"
        )
    for (i, first), (j, second) in combinations(enumerate(wheels.azimuths), 2):
        # two wheels less than a degree apart would be one inside the other
        if abs(math.remainder(second - first, 2.0 * math.pi)) < math.radians(1.0):
            raise InputError(
                f"wheels.azimuths[{i}] and [{j}] are both {math.degrees(first):g} deg; the "
                "wheels must be at different places to give three independent torques."
            )
    if np.linalg.svd(axles(wheels.azimuths, wheels.tilt), compute_uv=False)[-1] < _WEAKEST_AXIS:
        places = ", ".join(f"{math.degrees(azimuth):.4g}" for azimuth in wheels.azimuths)
        hint = "spread the azimuths, and keep the tilt away from 0 and 90 deg."
        # 0, 2.09 and 4.19 written as degrees
        if 0.0 < max(map(math.degrees, map(abs, wheels.azimuths))) <= 2.0 * math.pi:
            hint = f"did you mean azimuths of [{places}] rad?"
        raise InputError(
            f"wheels.tilt of {math.degrees(wheels.tilt):.3g} deg with azimuths of [{places}] deg cannot give three "
            f"independent torques; {hint}"
        )
    if wheels.rollers.radius >= wheels.radius:
        raise InputError(
            f"wheels.rollers.radius is {wheels.rollers.radius:g} m; it "
            f"must be below the radius of the wheel, {wheels.radius:g} m."
        )


def _check_law(robot: RobotValues) -> None:
    friction, law = robot.friction, robot.friction.own_law
    names = tuple(parameter.name for parameter in law.own) if law else ()
    if tuple(name for name, _ in friction.own) != names:
        raise InputError(
            f"The friction law {friction.law} has the parameters {list(names)} in friction.own; the robot states "
            f"{[name for name, _ in friction.own]}."
        )
    if law and any((*friction.stribeck_asymmetry, *friction.load)):
        raise InputError(
            f"friction.stribeck_asymmetry and friction.load are terms of the classical law; {law.name} has its own."
        )


def _check_friction(friction: Friction) -> None:
    if friction.own_law and not min(friction.breakaway) >= 0.0:
        least = f"{min(friction.breakaway):g} N m at rest"
        raise InputError(f"The friction law {friction.law} gives {least}; it must be zero or more.")
    for name in ("coulomb", "stribeck"):
        for index, difference in enumerate(getattr(friction, f"{name}_asymmetry")):
            size = getattr(friction, name)[index]
            if abs(difference) > size:
                raise InputError(
                    f"friction.{name}_asymmetry[{index}] is {difference:g} N m; it must be from {-size:g} to "
                    f"{size:g} N m (friction.{name}[{index}]), or the friction would drive the wheel in one direction."
                )


def _check_drive(drive: Drive) -> None:
    low, high = _MOTOR_CONSTANTS
    product = drive.torque_constant * drive.speed_constant
    if not low <= product <= high:
        hint = "one of the two is in another unit."
        if low <= drive.torque_constant * to_si(drive.speed_constant, "rpm/V", "rad/s/V") <= high:
            hint = f"did you mean {drive.speed_constant:g} rpm/V?"
        raise InputError(
            f"drive.torque_constant {drive.torque_constant:g} N m/A times drive.speed_constant "
            f"{drive.speed_constant:g} rad/s/V is {product:.3g}; for every motor it is near 1; {hint}"
        )
