"""What the sensors of a foreign log show, with the units that their motion supports."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.log.checks.stuck_encoders import Balancing, stuck_encoders
from ballbot.log.columns import FACTORS, Columns
from ballbot.log.imu_angles import integral_of, less_half_a_turn
from ballbot.log.mapping_search.evidence import CONFIDENT
from ballbot.log.mapping_search.found import Continued, Gyro, Signals, Stated
from ballbot.log.mapping_search.frame import HeadingTest, heading_test
from ballbot.log.mapping_search.placement import LeanTest, lean_test
from ballbot.log.mapping_search.roles import Roles
from ballbot.log.mapping_search.units import (
    MotionGains,
    Unit,
    fastest,
    heading_units,
    lean_units,
    likeliest_units,
    wheel_units,
)
from ballbot.log.signals import (
    INTERVAL,
    Smooth,
    balancing_rows,
    even_rows,
    new_messages,
    repaired_noise,
    sampling_times,
    smooth,
    speed_noise,
    unwrapped,
    without_resets,
)
from ballbot.robot import Robot

#: a wheel faster than this many times the drive's own limit was not turning: its encoder was reset
IMPOSSIBLE_SPEED = 3.0
#: filters that the test of the lean tries [s]
LEAN_WIDTHS = (0.05, 0.12, 0.2)
#: times are repaired if that leaves less than this part of the speed's noise, judged by so many rows
WORTH_REPAIRING, REPAIR_ROWS = 0.7, 6000
#: rows whose intervals differ by less than this part need no repair
EVEN_TIMES = 0.01
#: correlations of a gyro with the rates of the angles from which it is taken, and how far its gain may be off [log]
GYRO_CORRELATION, GYRO_GAIN = 0.75, 0.3
#: an encoder or counter begins again after so many counts
PERIODS = tuple(2.0**bits for bits in (8, 10, 12, 13, 14, 16, 24, 32))


@dataclass(frozen=True, kw_only=True, eq=False)
class Columned:
    """The columns that have a role."""

    path: Path
    cut: Columns
    roles: Roles
    time: Unit
    robot: Robot
    stated: Stated

    def stacked(self, names: tuple[str, ...]) -> NDArray[np.float64]:
        return np.column_stack([filled(self.cut[name]) for name in names])

    @property
    def t(self) -> NDArray[np.float64]:
        return self.cut[self.roles.time] * self.time.factor

    @property
    def attitude(self) -> NDArray[np.float64]:
        """Roll, pitch and, if there is one, yaw (M, 2 or 3) in the roll's unit, upright."""
        values = self.stacked(self.roles.attitude)
        if self.roles.half_turn is not None:
            values[:, 0] = less_half_a_turn(values[:, 0], self.roles.half_turn)
        units, table = [self.roles.unit((name,)) for name in self.roles.attitude[:2]], FACTORS["rad"]
        if units[0] in table and units[1] in table and not self.roles.quaternion:
            values[:, 1] *= table[units[1] or ""] / table[units[0] or ""]
        return values


def filled(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a column with missing values interpolated; counts stay whole numbers."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.where(known, values, 0.0)
    places = np.arange(len(values))
    found = np.interp(places, places[known], values[known])
    return np.round(found) if np.array_equal(values[known], np.round(values[known])) else found


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What the sensors show with the units that the motion supports."""

    units: tuple[Unit, Unit, Unit]  #: of lean, wheels and heading
    likely: dict[tuple[Unit, Unit, Unit], float]
    angles: NDArray[np.float64]  #: (M, n) [rad]
    sampled: NDArray[np.float64]  #: (M,) [s]
    continued: Continued
    signals: Signals
    gyro: Gyro | None
    tested: LeanTest | None
    heading: HeadingTest | None


def motion_of_file(base: Columned) -> Motion:
    """Return the likeliest units and what the sensors show with them."""
    roles, robot, t = base.roles, base.robot, base.t
    raw, wrap = _continued(base.stacked(roles.angles), of_speeds=roles.of_speeds)
    named = roles.unit(roles.angles)
    wheels = wheel_units(
        t, raw, robot, named, of_speeds=roles.of_speeds, counts_per_turn=base.stated.counts_per_turn
    )
    if roles.of_speeds:
        raw = np.column_stack([integral_of(t, speed) for speed in raw.T])
    none = Unit(name="rad", factor=1.0, named=True)
    leans, headings = [none], [none]
    if roles.attitude:
        leans = [none] if roles.quaternion else lean_units(base.attitude[:, :2], roles.unit(roles.attitude))
    if len(roles.attitude) > 2 and not roles.quaternion:
        headings = heading_units(base.attitude[:, 2], roles.unit(roles.attitude[2:]))
    likely = likeliest_units(leans, wheels, headings, None)
    units = next(iter(likely))
    found = _with_units(base, raw, wrap, units)
    for _ in range(3):
        tested, heading = found.tested, found.heading
        turns = heading is not None and abs(heading.correlation) > 0.9 and heading.confidence >= CONFIDENT
        gains = MotionGains(
            assumed=units,
            gain=tested.gain if tested else None,
            turning=heading.gain if heading and turns else None,
        )
        likely = likeliest_units(leans, wheels, headings, gains)
        if next(iter(likely)) == units:
            break
        units = next(iter(likely))
        found = _with_units(base, raw, wrap, units)
    return replace(found, likely=likely)


def _continued(angles: NDArray[np.float64], *, of_speeds: bool) -> tuple[NDArray[np.float64], float | None]:
    """Return whole-numbered angles (M, n) without the jumps of a full counter, and its period if there is one."""
    whole = bool(np.all(angles == np.round(angles)))
    jump, extent = float(np.abs(np.diff(angles, axis=0)).max(initial=0.0)), float(np.ptp(angles))
    period = next((one for one in PERIODS if 0.6 * one < extent < one + 0.5), None)
    if of_speeds or not whole or period is None or jump < 0.6 * period:
        return angles, None
    return np.column_stack([unwrapped(column, period=period) for column in angles.T]), period


def _with_units(
    base: Columned, raw: NDArray[np.float64], wrap: float | None, units: tuple[Unit, Unit, Unit]
) -> Motion:
    roles, robot, t = base.roles, base.robot, base.t
    lean, wheel, yaw = units
    angles, limit = raw * wheel.factor, IMPOSSIBLE_SPEED * fastest(robot)
    carried = angles if roles.of_speeds else without_resets(t, angles, limit)
    sampled, noise = (t, None) if roles.of_speeds else _sampled(t, carried)
    attitude = None
    if roles.attitude:
        attitude = base.attitude * np.array([lean.factor, lean.factor, yaw.factor])[: len(roles.attitude)]
    gyro = _gyro(base, sampled, attitude) if attitude is not None and roles.gyro else None
    tried = [_signals(base, carried, sampled, attitude, gyro, width) for width in LEAN_WIDTHS]
    if attitude is not None:
        stuck = stuck_encoders(balancing_of(t, carried, attitude))
        near = [(one.start - 1.0, one.end + 1.0) for one in stuck]
        for signals in tried:
            for start, end in near:
                signals.usable[(signals.rows > start) & (signals.rows < end)] = False
    tests = [
        (one, lean_test(robot, one.lean, one.wheels, one.heading, one.usable))
        for one in tried
        if one.lean is not None
    ]
    known = [(one, test) for one, test in tests if test is not None]
    signals, tested = min(known, key=lambda one: _doubt(one[1])) if known else (tried[0], None)
    heading = (
        heading_test(robot, signals.wheels, signals.heading, tested)
        if tested is not None and signals.heading is not None
        else None
    )
    return Motion(
        units=units,
        likely={},
        angles=carried,
        sampled=sampled,
        continued=Continued(
            noise=noise,
            largest_speed=None if np.allclose(carried, angles, atol=1e-6) else limit,
            wrap=wrap,
        ),
        signals=signals,
        gyro=gyro,
        tested=tested,
        heading=heading,
    )


def balancing_of(
    t: NDArray[np.float64], angles: NDArray[np.float64], attitude: NDArray[np.float64]
) -> Balancing:
    """Return times (N,) [s], wheel angles (N, n) and roll, pitch and perhaps yaw (N, 2 or 3) [rad], named."""
    yaw = np.unwrap(attitude[:, 2]) if attitude.shape[1] > 2 else None
    return Balancing(t=t, wheels=angles, lean=attitude[:, :2], heading=yaw)


def _doubt(tested: LeanTest) -> float:
    """Return how little a test shows: the error of the phase, more if the placement is in doubt."""
    error = tested.phase_error if tested.phase_error is not None else math.pi
    return error / max(tested.confidence, 0.05)


def _sampled(
    t: NDArray[np.float64], angles: NDArray[np.float64]
) -> tuple[NDArray[np.float64], tuple[float, float] | None]:
    """Return when the rows were sampled [s], and the speeds' noise before and after if that was estimated."""
    judged = slice(0, REPAIR_ROWS)
    steps = np.diff(t[judged])
    before = speed_noise(t[judged], angles[judged])
    if before is None or float(np.ptp(steps)) < EVEN_TIMES * float(np.median(steps)):
        return t, None
    after = repaired_noise(t[judged], angles[judged])
    if after is None or after > WORTH_REPAIRING * before:
        return t, None
    return sampling_times(t, angles), (before, after)


def _signals(
    base: Columned,
    angles: NDArray[np.float64],
    sampled: NDArray[np.float64],
    attitude: NDArray[np.float64] | None,
    gyro: Gyro | None,
    width: float,
) -> Signals:
    """Return the signals on even rows; with a gyro, the lean's rates are the gyro's, and the heading without a yaw."""
    rows, kept = even_rows(base.t), new_messages(sampled)
    wheels = smooth(rows, sampled[kept], angles[kept], width=width)
    tilt, heading, commands = None, None, None
    if base.roles.commands:
        latest = np.searchsorted(base.t, rows, side="right") - 1
        commands = base.stacked(base.roles.commands)[np.maximum(latest, 0)]
    if attitude is not None:
        tilt = smooth(rows, sampled[kept], attitude[kept, :2], width=width)
        if attitude.shape[1] > 2:
            heading = smooth(rows, sampled[kept], np.unwrap(attitude[kept, 2:], axis=0), width=width)
    if gyro is not None and tilt is not None:
        rates = base.stacked(base.roles.gyro)[:, list(gyro.order)] * gyro.unit.factor * np.asarray(gyro.signs)
        found = smooth(rows, sampled[kept], rates[kept], width=width)
        tilt = Smooth(value=tilt.value, rate=found.value[:, :2], acceleration=found.rate[:, :2])
        if heading is None:
            turning = found.value[:, 2:]
            heading = Smooth(
                value=INTERVAL * np.cumsum(turning, axis=0), rate=turning, acceleration=found.rate[:, 2:]
            )
    usable = balancing_rows(tilt.value if tilt else None, wheels.rate, commands)
    return Signals(rows=rows, wheels=wheels, lean=tilt, heading=heading, usable=usable)


def _gyro(base: Columned, sampled: NDArray[np.float64], attitude: NDArray[np.float64]) -> Gyro | None:
    """Return which of the 48 ways of a cube a gyro's columns fit the rates of the angles; None if none fits them."""
    rows, kept, with_yaw = even_rows(base.t), new_messages(sampled), attitude.shape[1] > 2
    yaw = np.unwrap(attitude[:, 2]) if with_yaw else np.zeros(len(attitude))
    angles = np.column_stack([attitude[:, :2], yaw])
    gyro = base.stacked(base.roles.gyro)
    best: Gyro | None = None
    for width in (0.05, 0.1, 0.2):
        seen = smooth(rows, sampled[kept], angles[kept], width=width)
        x = smooth(rows, sampled[kept], gyro[kept], width=width).value
        found = _gyro_fit(x, _body_rates(seen), base.roles.unit(base.roles.gyro), with_yaw=with_yaw)
        if found is not None and (best is None or min(found.correlations[:2]) > min(best.correlations[:2])):
            best = found
    return best


def _gyro_fit(
    gyro: NDArray[np.float64], rates: NDArray[np.float64], named: str | None, *, with_yaw: bool
) -> Gyro | None:
    a, b = gyro - gyro.mean(axis=0), rates - rates.mean(axis=0)
    size = np.outer(np.linalg.norm(a, axis=0), np.linalg.norm(b, axis=0))
    R = np.divide(a.T @ b, size, out=np.zeros_like(size), where=size > 1e-12)
    axes = (0, 1, 2) if with_yaw else (0, 1)
    order = max(permutations(range(3)), key=lambda p: sum(abs(R[p[axis], axis]) for axis in axes))
    found = [abs(float(R[order[axis], axis])) for axis in axes]
    if min(found[:2]) < GYRO_CORRELATION:
        return None
    signs = [1 if R[order[axis], axis] > 0.0 else -1 for axis in axes]
    if not with_yaw:  # axes of one handedness
        signs.append(signs[0] * signs[1] * (1 if order in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1))
    # noise makes a slope too small: least so on the axis that agrees best
    best = int(np.argmax(found))
    gain = float(np.linalg.norm(a[:, order[best]]) / np.linalg.norm(b[:, best]))
    table = FACTORS["rad/s"]
    names = (named,) if named in table else ("rad/s", "deg/s")
    name = min(names, key=lambda one: abs(math.log(gain * table[one or ""]))) or "rad/s"
    if abs(math.log(gain * table[name])) > GYRO_GAIN:
        return None
    unit = Unit(name=name, factor=table[name], named=named is not None)
    return Gyro(order=order, signs=tuple(signs), unit=unit, correlations=tuple(found))


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
