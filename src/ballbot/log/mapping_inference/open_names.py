"""What the columns of a foreign log are whose names leave a choice, by their values.

Series of columns whose names say no more than that there is one for each wheel (m1, e1, w1) are settled as columns
without names are (`ballbot.log.mapping_inference.column_values`): wheels follow from commands by integration, so that
angles are the slowest of them. Columns called wheel angles may be speeds, and x, y and z of an orientation may be
heading, roll and pitch.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ballbot.log.mapping_inference.column_values import (
    CLEAR_MARGIN,
    LARGEST_REST,
    LEAN_WIDTH,
    LEAST_EXPLAINED,
    Motion,
    lean_rest,
    moving_rows,
    unexplained_parts,
)
from ballbot.log.mapping_inference.evidence import TINY
from ballbot.log.mapping_inference.placement import torque_free_gains
from ballbot.log.mapping_inference.roles import Roles
from ballbot.log.mapping_inference.time_units import time_scale
from ballbot.log.mapping_inference.units import are_angles
from ballbot.log.signals import INTERVAL, Smooth, even_rows, smooth
from ballbot.robot import Robot

#: a speed and the rate of its angle correlate so well if the name may be that of a speed, and otherwise: a duty follows
#: the speed, too
NAMED_SPEED, SPEED = 0.9, 0.995


def settled(named: Roles, columns: Mapping[str, NDArray[np.float64]], robot: Robot) -> Roles:
    """Return roles by name in which the values decide what the series with open names are.

    A wheel's angle follows from its command by two integrations, so that it is slower than commands and lean, and the
    wheels explain the lean. A series that is the rate of the angles is their speeds. Of the others the commands are
    those that the motion explains. If the slowest series is not clearly slower, the columns are in doubt.

    Parameters
    ----------
    named : Roles
    columns : mapping of str to (M,) array
    robot : Robot
        Gives azimuths and the effect of gravity.
    """
    series = named.open_series
    # one series alone, of which no name says that they are angles, is left to `roles_by_data`
    if named.time is None or not series or (len(series) == 1 and not named.angles):
        return named
    signals = _open_signals(named, columns)
    if signals is None:
        return named
    rows, smoothed = signals
    lean, every = named.attitude[:2], [*series]
    rated = {
        one: _rest_of(lean, one, smoothed, robot) for one in every if all(name in smoothed for name in one)
    }
    able = [one for one in rated if rated[one] < LARGEST_REST] if lean else list(rated)
    if not able:
        return replace(named, confidence=0.6, alternatives=("other columns are the wheel angles",))
    angles = min(able, key=lambda one: _frequency(one, smoothed))
    elsewhere = () if named.speeds in every else named.speeds
    speeds = next((one for one in every if _are_rates(named, one, angles, smoothed)), elsewhere)
    others = [
        one for one in every if one not in (angles, speeds) and one in rated and not _is_any_rate(named, one)
    ]
    commands, clear = named.commands, True
    if not commands or commands in every:
        motion = Motion.of(rows, [smoothed[name] for name in lean], [smoothed[name] for name in angles])
        explained = {one: min(motion.explained(smoothed[name].value[:, 0]) for name in one) for one in others}
        fitting = [one for one in others if explained[one] > LEAST_EXPLAINED]
        motors = [one for one in others if _is_motor(named, one)]
        commands = max(fitting or motors, key=lambda one: explained[one], default=())
        clear = commands in fitting and len(fitting) == 1 if commands else True
    compared = [one for one in (*others, commands, lean) if one and all(name in smoothed for name in one)]
    alternatives = [f"{', '.join(one)} are the wheel angles" for one in others]
    if speeds in every and not commands and _likeness(speeds, angles, smoothed) < SPEED:
        # a duty follows the speed
        clear, alternatives = False, [f"{', '.join(speeds)} are the commands", *alternatives]
    slowest = min((_frequency(one, smoothed) for one in compared), default=np.inf)
    clear = clear and slowest > CLEAR_MARGIN * _frequency(angles, smoothed)
    return replace(
        named,
        angles=angles,
        speeds=speeds if speeds not in (angles, commands) else (),
        commands=commands,
        confidence=1.0 if clear else 0.6,
        alternatives=() if clear else tuple(alternatives) or (f"{', '.join(angles)} are no wheel angles",),
    )


#: stems of angular velocities, of a wheel, of the body or of the ball
_ANY_RATE = ("omega", "omegabody", "bodyomega", "angvel")
#: correlation of columns with the rates of roll and pitch from which they are a gyro's, though their names do not say
#: so: in eleven twin logs of five robots, with the angles' noise, 0.92 to 0.97 of the gyro, and at most 0.74 of speeds
NAMED_GYRO = 0.85


def _is_any_rate(named: Roles, series: tuple[str, ...]) -> bool:
    reading = named.reading(series)
    return reading is not None and reading.stem in _ANY_RATE


def with_rates_of(named: Roles, columns: Mapping[str, NDArray[np.float64]]) -> tuple[Roles, str]:
    """Return roles in which numbered angular velocities are those of wheels or of the IMU, and a note if of neither.

    A matrix `omega` of three columns, as MATLAB's structures have it, may be of the wheels, of the body or of the ball.
    """
    series = named.speeds
    if not (series and named.angles and _is_any_rate(named, series)):
        return named, ""
    signals = _open_signals(replace(named, open_series=(named.angles, series)), columns)
    without = replace(named, speeds=())
    note = f"{', '.join(series)} are the rates neither of the wheels nor of the lean, and are not used."
    if signals is None or not {*series, *named.angles} <= set(signals[1]):
        return without, f"{', '.join(series)} are not used: the log does not show whose rates they are."
    smoothed = signals[1]
    if _likeness(series, named.angles, smoothed) > NAMED_SPEED:
        return named, ""
    lean = [name for name in named.attitude[:2] if name in smoothed]
    if len(lean) == 2 and not named.gyro and len(series) == 3:
        R = np.abs(
            [[correlation_with_rate(smoothed[one], smoothed[other]) for other in lean] for one in series]
        )
        if max(min(R[i, 0], R[j, 1]) for i, j in permutations(range(3), 2)) > NAMED_GYRO:
            return replace(without, gyro=series), ""
    return without, note


#: taken for speeds, columns must leave so many times less of the lean than taken for angles: true angles leave up to 2
#: times less (80 variants of the development halves), counts a row and counts a second 5 and 10
AS_SPEEDS = 3.0


def seem_speeds(named: Roles, columns: Mapping[str, NDArray[np.float64]], robot: Robot) -> bool:
    """Return whether the lean follows from columns called wheel angles as from speeds, or from increments in a row."""
    as_angles, as_speeds = _rests_as_angles_and_speeds(named, columns, robot)
    return as_speeds < LARGEST_REST and AS_SPEEDS * as_speeds < as_angles


def seem_angles(named: Roles, columns: Mapping[str, NDArray[np.float64]], robot: Robot) -> bool:
    """Return whether the lean follows from columns called wheel speeds as from angles."""
    as_angles, as_speeds = _rests_as_angles_and_speeds(named, columns, robot)
    return as_angles < LARGEST_REST and AS_SPEEDS * as_angles < as_speeds


def _rests_as_angles_and_speeds(
    named: Roles, columns: Mapping[str, NDArray[np.float64]], robot: Robot
) -> tuple[float, float]:
    """Return the fractions of the lean's acceleration that the wheels' columns leave as angles and as speeds."""
    if len(named.attitude) < 2 or named.time is None:
        return 1.0, 1.0
    if are_angles(np.column_stack([columns[name] for name in named.angles]), robot):
        return 0.0, 1.0
    signals = _open_signals(replace(named, commands=(), open_series=(named.angles,)), columns)
    if signals is None or not {*named.angles, *named.attitude[:2]} <= set(signals[1]):
        return 1.0, 1.0
    smoothed = signals[1]
    integrals = {
        name: Smooth(
            value=INTERVAL * np.cumsum(smoothed[name].value, axis=0),
            rate=smoothed[name].value,
            acceleration=smoothed[name].rate,
        )
        for name in named.angles
    }
    lean = named.attitude[:2]
    as_speeds = _rest_of(lean, named.angles, {**smoothed, **integrals}, robot)
    return _rest_of(lean, named.angles, smoothed, robot), as_speeds


#: a compass jumps by this share of a turn at least
JUMP = 0.9


def with_heading_behind(named: Roles, columns: Mapping[str, NDArray[np.float64]], robot: Robot) -> Roles:
    """Return roles in which x or y of x, y and z is the heading if the values show it, and the others are the lean.

    A BNO055 has the heading first, a frame whose y points up second. Only the letters may be so: a column that is
    called roll is not taken for a heading. A column is the heading if the wheels explain the lean clearly better by the
    other two than by the first two and its rate better than the last one's, or if it jumps by a turn as a compass does
    and they explain the lean no worse. If it jumps and they do not say more, the columns are in doubt.
    """
    readings = [one for name in named.attitude if (one := named.reading((name,)))]
    if (
        named.time is None
        or not named.angles
        or len({one.stem for one in readings}) != 1
        or len(readings) < 3
    ):
        return named
    x, y, z = named.attitude
    least, found, doubted = _rest_by_names(named, (x, y), columns, robot), named, named
    usual = least
    for heading, lean in ((x, (y, z)), (y, (x, z))):
        rest = _rest_by_names(named, lean, columns, robot)
        jumps = _jumps(columns[heading]) and not _jumps(columns[z])
        turned = replace(named, attitude=(*lean, heading))
        lean_behind = rest < LARGEST_REST and rest * (1.0 if jumps else CLEAR_MARGIN) < usual
        if lean_behind and rest < least and (jumps or _turns_with_the_wheels(named, heading, columns)):
            least, found = rest, turned
        elif jumps:
            in_words = f"{x}, {y}, {z} are roll, pitch and yaw"
            doubted = replace(turned, confidence=0.6, alternatives=(in_words,))
    return doubted if found is named else found


def _turns_with_the_wheels(named: Roles, heading: str, columns: Mapping[str, NDArray[np.float64]]) -> bool:
    """Return whether the wheels' speeds leave less of the rate of one of three angles than of the last one's."""
    signals = smooth_columns(named, columns, (named.attitude, named.angles))
    if signals is None or not {*named.attitude, *named.angles} <= set(signals[1]):
        return False
    smoothed = signals[1]
    speeds = np.column_stack([smoothed[name].rate[:, 0] for name in named.angles])
    rates = np.column_stack([smoothed[name].rate[:, 0] for name in (heading, named.attitude[2])])
    first, last = unexplained_parts(speeds, rates)
    return bool(first < last)


def _jumps(values: NDArray[np.float64]) -> bool:
    """Return whether a column has only positive angles and jumps between none and a turn, in degrees or radians."""
    known = values[np.isfinite(values)]
    if not len(known) or known.min() < 0.0:
        return False
    largest = float(np.abs(np.diff(known)).max(initial=0.0))
    return any(JUMP * turn < largest <= known.max() <= 1.001 * turn for turn in (360.0, 2.0 * np.pi))


def _rest_by_names(
    named: Roles, lean: tuple[str, ...], columns: Mapping[str, NDArray[np.float64]], robot: Robot
) -> float:
    """Return the fraction of the acceleration of other columns taken for the lean that the named wheels leave."""
    signals = _open_signals(replace(named, attitude=lean, commands=(), open_series=(named.angles,)), columns)
    if signals is None or not {*named.angles, *lean} <= set(signals[1]):
        return 1.0
    return _rest_of(lean, named.angles, signals[1], robot)


def _is_motor(named: Roles, series: tuple[str, ...]) -> bool:
    reading = named.reading(series)
    return reading is not None and reading.kind == "wheel angle"


def _open_signals(
    named: Roles, columns: Mapping[str, NDArray[np.float64]]
) -> tuple[NDArray[np.float64], dict[str, Smooth]] | None:
    """Return even rows, and on them the smooth lean, commands and open series that move; None without a time."""
    return smooth_columns(named, columns, (named.attitude[:2], named.commands, *named.open_series))


def smooth_columns(
    named: Roles, columns: Mapping[str, NDArray[np.float64]], series: Iterable[Sequence[str]]
) -> tuple[NDArray[np.float64], dict[str, Smooth]] | None:
    """Return even rows [s], and on them those columns of series that move, smooth; None without a time."""
    time = columns[named.time or ""]
    reading = named.reading((named.time or "",))
    scale = time_scale(time, reading.unit if reading else None)
    if scale is None:
        return None
    names = dict.fromkeys(name for one in series for name in one)
    moving = [name for name in names if np.nanmax(columns[name]) > np.nanmin(columns[name])]
    kept = np.isfinite(time) & np.all([np.isfinite(columns[name]) for name in moving], axis=0)
    t = time[kept] * scale.factor
    rising = np.concatenate(([True], np.diff(np.maximum.accumulate(t)) > 0.0))
    if rising.sum() < FEWEST_ROWS:
        return None
    t = t[rising]
    rows = even_rows(t)
    return rows, {
        name: smooth(rows, t, columns[name][kept][rising, None], width=LEAN_WIDTH) for name in moving
    }


#: fewer rows show nothing
FEWEST_ROWS = 200


def _frequency(series: Sequence[str], smoothed: Mapping[str, Smooth]) -> float:
    """Return the root mean square of the rates over that of the values [1/s]."""
    rate = sum(float((smoothed[name].rate ** 2).mean()) for name in series)
    size = sum(float(smoothed[name].value.var()) for name in series)
    return float(np.sqrt(rate / max(size, TINY)))


def _rest_of(
    lean: tuple[str, ...], wheels: tuple[str, ...], smoothed: Mapping[str, Smooth], robot: Robot
) -> float:
    """Return the fraction of the lean's acceleration that columns taken for wheel angles leave; 1 without a lean."""
    if not all(name in smoothed for name in lean) or not lean:
        return 1.0
    speeds = np.column_stack([smoothed[name].rate[:, 0] for name in wheels])
    angles = np.column_stack([smoothed[name].value[:, 0] for name in wheels])
    accelerations = np.column_stack([smoothed[name].acceleration[:, 0] for name in wheels])
    return lean_rest(
        lean, smoothed, (angles, accelerations), moving_rows(speeds), robot, torque_free_gains(robot)[0]
    )


def _are_rates(
    named: Roles, series: tuple[str, ...], angles: tuple[str, ...], smoothed: Mapping[str, Smooth]
) -> bool:
    """Return whether each column is the rate of an angle, in any unit."""
    reading = named.reading(series)
    if series == angles or reading is None or any(name not in smoothed for name in series):
        return False
    least = NAMED_SPEED if reading.kind == "wheel speed" else SPEED
    return _likeness(series, angles, smoothed) > least


def _likeness(series: tuple[str, ...], angles: tuple[str, ...], smoothed: Mapping[str, Smooth]) -> float:
    """Return the least correlation of a column with the rate of its angle, whatever its sign."""
    return min(
        abs(correlation_with_rate(smoothed[one], smoothed[other]))
        for one, other in zip(series, angles, strict=True)
    )


def correlation_with_rate(one: Smooth, other: Smooth) -> float:
    """Return the correlation of a column with the rate of another."""
    return float(np.corrcoef(one.value[:, 0], other.rate[:, 0])[0, 1])
