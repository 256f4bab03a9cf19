"""The columns of a foreign file that have a role: their smooth signals on even rows, and the axes of the gyro.

A gyro is compared with the rates of the angles: which of its columns is about which axis, with which sign and unit, and
by how much the angles are later. Where the heading turns, it also shows the handedness of roll, pitch and yaw
(`ballbot.log.mapping_inference.gyro_handedness`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.columns import FACTORS, direction_sign
from ballbot.log.imu_angles import integral_of, less_half_a_turn
from ballbot.log.mapping_inference.evidence import (
    CONFIDENT,
    TINY,
)
from ballbot.log.mapping_inference.gyro_handedness import LEAST_ROWS, angles_after_gyro, handedness_by_gyro
from ballbot.log.mapping_inference.roles import Roles
from ballbot.log.mapping_inference.units import Scale
from ballbot.log.mapping_inference.wheel_response import held_commands
from ballbot.log.signals import INTERVAL, Smooth, balancing_rows, even_rows, new_messages, smooth


@dataclass(frozen=True, kw_only=True, eq=False)
class Signals:
    """The log on even rows: what was tested."""

    rows: NDArray[np.float64]  #: (N,) [s]
    wheels: Smooth  #: (N, n)
    lean: Smooth | None  #: (N, 2)
    heading: Smooth | None  #: (N, 1)
    commands: NDArray[np.float64] | None  #: (N, n), held
    usable: NDArray[np.bool_]  #: (N,), moving and not fallen


@dataclass(frozen=True, kw_only=True, eq=False)
class Raw:
    """The columns that have a role, as the file has them; the time in seconds."""

    t: NDArray[np.float64]
    angles: NDArray[np.float64]  #: (M, n) of the wheels; of speeds alone, their integrals over t
    attitude: NDArray[np.float64] | None
    commands: NDArray[np.float64] | None
    gyro: NDArray[np.float64] | None
    gyro_unit: str | None  #: by its name
    pitch_factor: float = (
        1.0  #: what turned the pitch into the roll's unit, if their names have different ones
    )
    #: (M, n) the wheels' speeds, if the file has no angles
    speeds: NDArray[np.float64] | None = None
    gyro_counts: bool = False  #: whether it may be a register's numbers: whole, or called raw, without a unit

    @staticmethod
    def of(columns: dict[str, NDArray[np.float64]], roles: Roles, time: Scale) -> Raw:
        """Return the columns of a file."""

        def stacked(names: tuple[str, ...]) -> NDArray[np.float64] | None:
            return np.column_stack([filled(columns[name]) for name in names]) if names else None

        angles, named = stacked(roles.angles), roles.reading(roles.gyro)
        if angles is None:
            raise InputError("No wheel angles were found.")
        t, speeds = columns[roles.time or ""] * time.factor, None
        if roles.of_speeds:
            speeds = angles
            angles = np.column_stack([integral_of(t, speed) for speed in speeds.T])
        if roles.half_turn is not None:
            roll = roles.attitude[0]
            columns = {**columns, roll: less_half_a_turn(columns[roll], roles.half_turn)}
        attitude, pitch_factor = stacked(roles.attitude), pitch_in_rolls_unit(roles)
        if attitude is not None:
            attitude[:, 1] *= pitch_factor
        return Raw(
            t=t,
            angles=angles,
            speeds=speeds,
            attitude=attitude,
            commands=_with_signs(stacked(roles.commands), stacked(roles.directions), roles),
            gyro=stacked(roles.gyro),
            gyro_unit=named.unit if named else None,
            pitch_factor=pitch_factor,
            gyro_counts=_may_be_counts(columns, roles),
        )


def _with_signs(
    commands: NDArray[np.float64] | None, directions: NDArray[np.float64] | None, roles: Roles
) -> NDArray[np.float64] | None:
    """Return commands (M, n) from their zero and with their directions, if the file has them without a sign."""
    if commands is None:
        return None
    if roles.zero is not None:
        commands = commands - roles.zero.value
    return commands if directions is None else commands * direction_sign(directions)


def pitch_in_rolls_unit(roles: Roles) -> float:
    """Return what turns the pitch into the roll's unit, if their names have different ones; else 1."""
    if len(roles.attitude) < 2 or roles.quaternion:
        return 1.0
    roll, pitch = (one.unit if (one := roles.reading((name,))) else None for name in roles.attitude[:2])
    factors = FACTORS["rad"]
    return factors[pitch] / factors[roll] if roll in factors and pitch in factors else 1.0


def _may_be_counts(columns: dict[str, NDArray[np.float64]], roles: Roles) -> bool:
    readings = [roles.reading((name,)) for name in roles.gyro]
    if any(one is None or one.unit is not None for one in readings):
        return False
    whole = all(np.all(filled(columns[name]) == np.round(filled(columns[name]))) for name in roles.gyro)
    return bool(whole or all("raw" in name.lower() for name in roles.gyro))


def filled(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a column with missing values interpolated; counts stay whole numbers."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.where(known, values, 0.0)
    places = np.arange(len(values))
    found = np.interp(places, places[known], values[known])
    return np.round(found) if np.array_equal(values[known], np.round(values[known])) else found


def signals_of(
    raw: Raw,
    angles: NDArray[np.float64],
    sampled: NDArray[np.float64],
    attitude: NDArray[np.float64] | None,
    *,
    width: float,
    gyro: GyroTest | None = None,
) -> Signals:
    """Return the file's signals on even rows.

    Parameters
    ----------
    raw : Raw
    angles : ndarray (M, n)
        Of the wheels [rad], continued across resets.
    sampled : ndarray (M,)
        When the rows were sampled [s].
    attitude : ndarray (M, 2) or (M, 3), optional
        Roll, pitch and, if there is one, yaw [rad].
    width : float
        Standard deviation of the filter [s].
    gyro : GyroTest, optional
        If given, the lean's rates are the gyro's, and the heading too if there is no yaw.
    """
    rows, kept = even_rows(raw.t), new_messages(sampled)
    wheels = smooth(rows, sampled[kept], angles[kept], width=width)
    commands = held_commands(rows, raw.t, raw.commands) if raw.commands is not None else None
    tilt, heading = None, None
    if attitude is not None:
        tilt = smooth(rows, sampled[kept], attitude[kept, :2], width=width)
        if attitude.shape[1] > 2:
            heading = smooth(rows, sampled[kept], np.unwrap(attitude[kept, 2:], axis=0), width=width)
        if gyro is not None and raw.gyro is not None:
            # brought to the angles' time
            turned = raw.gyro[:, list(gyro.order[:2])] * gyro.factor * np.asarray(gyro.signs[:2])
            rates = smooth(rows, sampled[kept] + gyro.lag, turned[kept], width=width)
            tilt = Smooth(value=tilt.value, rate=rates.value, acceleration=rates.rate)
            if heading is None:
                about = raw.gyro[kept, gyro.order[2]][:, None] * gyro.factor * gyro.signs[2]
                turning = smooth(rows, sampled[kept] + gyro.lag, about, width=width)
                angle = INTERVAL * np.cumsum(turning.value, axis=0)
                heading = Smooth(value=angle, rate=turning.value, acceleration=turning.rate)
    return Signals(
        rows=rows,
        wheels=wheels,
        lean=tilt,
        heading=heading,
        commands=commands,
        usable=balancing_rows(tilt.value if tilt else None, wheels.rate, commands),
    )


#: filter of the yaw for its rate [s]: the heading turns slowly
YAW_WIDTH = 0.1
#: error of the angles' lag behind the gyro: this many times the estimate's standard error, and so much more [s]. In 51
#: recordings of four development halves and of other twins, whose angles are in time, it is 2.9 ms (root mean square)
GYRO_LAG_ERRORS, GYRO_LAG_ERROR = 1.5, 0.002
#: standard errors from which on the angles are taken to be late
CLEAR_LAG = 2.0
#: filters of gyro and angles [s]: the next wider one if noise of the angles hides that they belong together
GYRO_WIDTHS = (0.05, 0.1, 0.2)


def gyro_of(
    raw: Raw, signals: Signals, sampled: NDArray[np.float64], attitude: NDArray[np.float64] | None
) -> GyroTest | None:
    """Return how the gyro belongs to the angles; None without one, or if it does not follow them.

    Parameters
    ----------
    raw : Raw
    signals : Signals
        Of which the times and the usable rows are taken.
    sampled : ndarray (M,)
        When the rows were sampled [s].
    attitude : ndarray (M, 2) or (M, 3), optional
        Roll, pitch and, if there is one, yaw [rad].
    """
    if raw.gyro is None or signals.lean is None or attitude is None:
        return None
    kept = new_messages(sampled)
    with_yaw = attitude.shape[1] > 2
    angles = np.column_stack([attitude[:, :2], np.unwrap(attitude[:, 2]) if with_yaw else 0.0 * raw.t])
    if signals.usable.sum() < LEAST_ROWS:
        return None
    found = None
    for width in GYRO_WIDTHS:
        seen = smooth(signals.rows, sampled[kept], angles[kept], width=width)
        gyro = smooth(signals.rows, sampled[kept], raw.gyro[kept], width=width)
        tested = _gyro_test(gyro, seen, signals.usable, raw.gyro_unit, with_yaw=with_yaw)
        if tested is not None and (found is None or tested.confidence > found.confidence):
            found = tested
        if found is not None and found.confidence >= CONFIDENT:
            break
    if found is not None and raw.gyro_counts and found.confidence < CONFIDENT:
        wide = smooth(signals.rows, sampled[kept] + found.lag, raw.gyro[kept], width=COUNTS_WIDTH)
        seen_wide = smooth(signals.rows, sampled[kept], angles[kept], width=COUNTS_WIDTH)
        found = _in_counts(found, wide, seen_wide, signals, with_yaw=with_yaw)
    if found is None:
        return None
    return _integrated_test(found, sampled[kept], angles[kept], raw.gyro[kept], signals, with_yaw=with_yaw)


def _integrated_test(
    found: GyroTest,
    t: NDArray[np.float64],
    angles: NDArray[np.float64],
    gyro: NDArray[np.float64],
    signals: Signals,
    *,
    with_yaw: bool,
) -> GyroTest:
    """Return a test of a gyro (N, 3) with what its integral shows: how late the angles are, and the handedness."""
    rates = gyro[:, list(found.order)] * found.factor * np.asarray(found.signs)
    turning = rates[:, 2]
    if with_yaw:
        yaw = smooth(signals.rows, t, angles[:, 2:], width=YAW_WIDTH).rate[:, 0]
        turning = np.interp(t, signals.rows, yaw)
    usable = np.interp(t, signals.rows, signals.usable) == 1.0
    lag, error = angles_after_gyro(t, angles, rates[:, :2], turning, usable)
    error = math.hypot(GYRO_LAG_ERRORS * error, GYRO_LAG_ERROR)
    found = replace(found, lag=lag if lag > CLEAR_LAG * error else 0.0, lag_error=error)
    if not with_yaw:
        return found
    in_time = np.column_stack([np.interp(t, t + found.lag, column) for column in rates[:, :2].T])
    sigma, error = handedness_by_gyro(t, angles, in_time, turning, usable)
    return replace(found, handedness=sigma, handedness_error=error)


@dataclass(frozen=True, kw_only=True)
class GyroTest:
    """How the columns of a gyro belong to roll, pitch and yaw."""

    order: tuple[int, ...]  #: for x, y, z in turn, the place of its column (from 0) among the gyro's
    signs: tuple[int, ...]  #: of x, y, z, relative to the angles
    gain: float  #: gyro over rates of the angles, of the axis that agrees best, in the unit that follows
    unit: str
    factor: float  #: what turns the file's number into rad/s
    scale: float = 1.0  #: part of the factor that the unit does not have: of raw counts
    correlations: tuple[float, ...]  #: of x, y, z
    lag: float  #: by which the angles are later than the gyro [s]; zero if they are not clearly later
    lag_error: float = math.inf  #: its standard error [s]
    confidence: float
    reason: str
    unusable: str = ""  #: why it is not used though its rates fit
    handedness: float = math.nan  #: sigma of `gyro_handedness`; nan without a yaw
    handedness_error: float = math.inf  #: its standard error


def _gyro_test(
    gyro: Smooth, attitude: Smooth, usable: NDArray[np.bool_], named: str | None, *, with_yaw: bool
) -> GyroTest | None:
    """Compare a gyro with the rates of the angles.

    Parameters
    ----------
    gyro : Smooth (N, 3)
        As the file has it.
    attitude : Smooth (N, 3)
        Roll, pitch and yaw [rad]; yaw zero if there is none.
    usable : ndarray (N,)
    named : str, optional
        The unit in the names.
    with_yaw : bool
        Whether there is a yaw; if not, the last column is believed by its name.

    Returns
    -------
    GyroTest or None
        None if the gyro does not follow the angles.
    """
    lags = np.arange(-4, 9)
    rates = _body_rates(attitude)
    best = max(lags, key=lambda lag: _strength(gyro.value, np.roll(rates, -lag, axis=0), usable, with_yaw))
    shifted = np.roll(rates, -int(best), axis=0)
    R = _correlations(gyro.value[usable], shifted[usable])
    count = 3 if with_yaw else 2
    order = max(permutations(range(3)), key=lambda p: sum(abs(R[p[axis], axis]) for axis in range(count)))
    slopes = [_slope(gyro.value[usable, order[axis]], shifted[usable, axis]) for axis in range(count)]
    strength = [abs(float(R[order[axis], axis])) for axis in range(count)]
    if min(strength[:2]) < 0.5:
        return None
    # differences of angles are mostly noise, which makes slopes too small, least so on the axis that agrees best
    gain = abs(slopes[int(np.argmax(strength))])
    unit, factor, fits = _gyro_unit(gain, named)
    signs = tuple(1 if slope > 0.0 else -1 for slope in slopes)
    heading = 1.0 if len(strength) < 3 or strength[2] > 0.6 else 0.85
    return GyroTest(
        order=tuple(order),
        # without a yaw, axes of one handedness
        signs=signs
        if len(signs) == 3
        else (*signs, signs[0] * signs[1] * (1 if order[:2] == (0, 1) else -1)),
        gain=gain * factor,
        unit=unit,
        factor=factor,
        correlations=tuple(strength),
        lag=float(best) * INTERVAL,
        confidence=fits * heading * (0.99 if min(strength[:2]) > 0.75 else 0.92),
        reason=f"correlations with the rates of the angles {', '.join(f'{r:.2f}' for r in strength)}; "
        f"gain {gain * factor:.2f}",
    )


#: counts per deg/s of common gyros: MPU-6050, MPU-9250, ICM-20948 and BMI160 count 32768 for 250 to 2000 deg/s,
#: LSM6DS3, LSM9DS1 and L3GD20 in 8.75 to 70 mdeg/s
GYRO_COUNTS = (131.0, 65.5, 32.8, 16.4, 1000.0 / 8.75, 1000.0 / 17.5, 1000.0 / 35.0, 1000.0 / 70.0)
#: a scale this far [log] outside of the two regressions fits no more: less than half of the least ratio of two scales
COUNTS_DEVIATION = 0.06
#: filter of gyro and angles before their scale is estimated [s]: noise of the angles, and what is late, matter less
COUNTS_WIDTH = 0.16
#: a gyro's offset that turns the heading by more than this over the log [rad] is not integrated: half of what the
#: lean's direction may be off
LARGEST_DRIFT = 0.1


def _in_counts(
    found: GyroTest, gyro: Smooth, attitude: Smooth, signals: Signals, *, with_yaw: bool
) -> GyroTest:
    """Return a gyro in counts of the only common scale that fits the rates of the angles; as it is if none does.

    Noise of the angles makes the regression on their rates too small, noise of the gyro makes the other one too large:
    the scale is between them. Without a yaw, a gyro whose offset would turn the heading is not taken either.
    """
    usable, rates = signals.usable, _body_rates(attitude)
    axes = range(3 if with_yaw else 2)
    x = np.concatenate([rates[usable, axis] - rates[usable, axis].mean() for axis in axes])
    turned = gyro.value[:, list(found.order)] * np.asarray(found.signs)
    y = np.concatenate([turned[usable, axis] - turned[usable, axis].mean() for axis in axes])
    product = float(x @ y)
    if product <= 0.0:
        return found
    least, largest = product / max(float(x @ x), TINY), float(y @ y) / product
    margin = math.exp(COUNTS_DEVIATION)
    factors = [math.pi / 180.0 / counts for counts in GYRO_COUNTS]
    fitting = [one for one in factors if least * one < margin and largest * one > 1.0 / margin]
    if len(fitting) != 1:
        return found
    factor = fitting[0]
    per_degree = math.pi / 180.0 / factor
    drift = 0.0 if with_yaw else _drift(turned[:, 2] * factor, signals)
    if drift > LARGEST_DRIFT:
        return replace(
            found,
            unusable=f"its offset about the vertical would turn the heading by {math.degrees(drift):.0f} deg",
        )
    return replace(
        found,
        gain=math.sqrt(least * largest) * factor,
        unit="deg/s",
        factor=factor,
        scale=1.0 / per_degree,
        confidence=0.99 if min(found.correlations[:2]) > 0.75 else 0.92,
        reason=f"raw counts, {per_degree:.4g} per deg/s: by the rates of the angles "
        f"{least * math.pi / 180.0:.4g} to {largest * math.pi / 180.0:.4g}",
    )


def _drift(rate: NDArray[np.float64], signals: Signals) -> float:
    """Return by how much [rad] the offset of the heading's rate (N,) turns the heading over the log.

    The heading turns as the wheels do: of its integral, the offset is what grows with time and not with their angles.
    """
    t = signals.rows - signals.rows.mean()
    heading, angles = INTERVAL * np.cumsum(rate), signals.wheels.value
    X = np.column_stack([angles - angles.mean(axis=0), t, np.ones(len(t))])
    return abs(float(np.linalg.lstsq(X, heading, rcond=None)[0][-2])) * float(np.ptp(t))


def _gyro_unit(gain: float, named: str | None) -> tuple[str, float, float]:
    """Return the unit nearest to a gain over rad/s, its factor, and how far it is believed.

    Thousandths of a unit are only taken for a gyro whose name says so.
    """
    known = FACTORS["rad/s"]
    named = named if named in known else None  # a name in turns or counts says nothing of a gyro's unit
    units = {unit: known[unit] for unit in dict.fromkeys(("rad/s", "deg/s", named)) if unit}
    unit = min(units, key=lambda one: abs(math.log(gain * units[one])))
    off = abs(math.log(gain * units[unit]))
    fits = 1.0 if off < 0.3 else 0.93 if off < 0.6 else 0.4
    return unit, units[unit], fits if named in (None, unit) else 0.5


def _body_rates(attitude: Smooth) -> NDArray[np.float64]:
    """Return the angular velocity (N, 3) about the IMU's axes from roll, pitch, yaw and their rates."""
    roll, pitch, _ = attitude.value.T
    roll_dot, pitch_dot, yaw_dot = attitude.rate.T
    return np.column_stack(
        [
            roll_dot - yaw_dot * np.sin(pitch),
            pitch_dot * np.cos(roll) + yaw_dot * np.sin(roll) * np.cos(pitch),
            -pitch_dot * np.sin(roll) + yaw_dot * np.cos(roll) * np.cos(pitch),
        ]
    )


def _strength(
    gyro: NDArray[np.float64], rates: NDArray[np.float64], usable: NDArray[np.bool_], with_yaw: bool
) -> float:
    R = np.abs(_correlations(gyro[usable], rates[usable]))
    axes: Sequence[int] = (0, 1, 2) if with_yaw else (0, 1)
    return float(max(sum(R[p[axis], axis] for axis in axes) for p in permutations(range(3))))


def _correlations(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the correlations (3, 3) of columns of `a` with columns of `b`; zero of a column that is still."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    size = np.outer(np.linalg.norm(a, axis=0), np.linalg.norm(b, axis=0))
    return np.divide(a.T @ b, size, out=np.zeros_like(size), where=size > 1e-12)


def _slope(y: NDArray[np.float64], x: NDArray[np.float64]) -> float:
    """Return the slope between two noisy signals: the ratio of their sizes, with the sign of their correlation."""
    x, y = x - x.mean(), y - y.mean()
    product, size = float(x @ y), float(x @ x)
    # the angles' rates are the noisier: the mean of both regressions
    forward, reverse = product / max(size, TINY), float(y @ y) / product if product else TINY
    return math.copysign(math.sqrt(abs(forward * reverse)), product)
