"""What the sensors of a foreign log show, with the units that their motion supports."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from operator import itemgetter
from pathlib import Path

import numpy as np

from ballbot.arrays import Bools, Floats
from ballbot.log.columns import FACTORS, Columns
from ballbot.log.evidence import CONFIDENT, ERRORS_WEIGHT, RELATED, SCALED, confidence_in
from ballbot.log.formats.text import TextLayout
from ballbot.log.imu_angles import (
    AngleSequence,
    integral_of,
    turning_tilts,
    within_half_a_turn,
)
from ballbot.log.mapping_search.names import InputKind, Roles
from ballbot.log.placement import (
    STILL_HEADING,
    LeanTest,
    advantage,
    heading_of,
    lean_test,
    unexplained_by_readings,
)
from ballbot.log.signals import (
    INTERVAL,
    Smooth,
    balancing_rows,
    even_rows,
    frozen_rows,
    new_messages,
    sampling_times,
    smooth,
    speed_noise,
    unwrapped,
    without_resets,
)
from ballbot.log.torque_balance import block_sums
from ballbot.log.units import Unit, Units, lean_units, likeliest_units, wheel_units
from ballbot.log.wrapping import COUNTERS, TURNS, wrap_period
from ballbot.robot import Robot

#: a wheel faster than this many times the drive's own limit was not turning: its encoder was reset
IMPOSSIBLE_SPEED = 3.0
#: filters that the tests of the lean and of the gyro try [s]: the wheels of light robots move quickly, and encoders of
#: heavy ones are coarse
WIDTHS = (0.05, 0.12, 0.2)
#: times are repaired if that leaves less than this part of the speed's noise
WORTH_REPAIRING = 0.7
#: rows whose intervals differ by less than this part need no repair
EVEN_TIMES = 0.01
#: how far the gain of a gyro that follows the rates of the angles may be off [log]
GYRO_GAIN = 0.3
#: time [s] at each end, with a one-sided fit, that is not used for the handedness; its least standard error
GYRO_EDGE, LEAST_PRODUCT_ERROR = 0.3, 0.2
#: logarithm of the odds that roll and pitch turn with the heading, as those of most IMUs do, before a log is seen
TURNING_ODDS = 1.0


@dataclass(frozen=True, kw_only=True)
class Stated:
    """What the user states about the firmware that wrote the log."""

    command: InputKind | None = None
    full_scale: float | None = None  #: the file's number for full duty
    counts_per_turn: float | None = None  #: of a wheel's encoder
    columns: Sequence[str] | None = None  #: names in the file's order


@dataclass(frozen=True, eq=False)
class Columned:
    """The columns that have a role."""

    path: Path
    layout: TextLayout
    cut: Columns  #: the rows that are taken
    roles: Roles
    time: Unit
    robot: Robot
    stated: Stated

    @property
    def t(self) -> Floats:
        """Times (M,) [s]."""
        return self.cut[self.roles.time] * self.time.factor

    def stacked(self, names: Sequence[str]) -> Floats:
        """Return columns (M, k) with missing values interpolated; counts stay whole numbers."""
        table = np.column_stack([self.cut[name] for name in names])
        rows = np.arange(len(table))
        for column in table.T:
            known = np.isfinite(column)
            if not known.all():
                interpolated = np.interp(rows, rows[known], column[known]) if known.any() else 0.0 * rows
                whole = np.array_equal(column[known], np.round(column[known]))
                column[:] = np.round(interpolated) if whole else interpolated
        return table

    def held_commands(self, rows: Floats) -> Floats:
        """Return the latest command of each motor (N, n) at times (N,) [s]."""
        latest = np.searchsorted(self.t, rows, side="right") - 1
        return self.stacked(self.roles.commands)[np.maximum(latest, 0)]

    @property
    def frozen(self) -> Bools:
        """The rows (M,) at which roll or pitch froze: it repeats one value, and changes at nearly all other rows."""
        each = [frozen_rows(self.t, self.cut[name]) for name in self.roles.attitude[:2]]
        return np.asarray(np.any(each, axis=0)) if each else np.zeros(len(self.t), dtype=np.bool_)

    @property
    def raw_attitude(self) -> Floats:
        """Roll, pitch and, if there is one, yaw (M, 2 or 3) in the file's units, upright."""
        values = self.stacked(self.roles.attitude)
        if self.roles.half_turn is not None:
            values[:, 0] = within_half_a_turn(values[:, 0] - self.roles.half_turn, self.roles.half_turn)
        return values

    def angle_units(self, lean: str) -> list[str]:
        """Return the units of roll, pitch and yaw: a heading's, else that of the lean."""
        return [self.roles.unit((name,)) or lean for name in self.roles.attitude]


@dataclass(frozen=True, kw_only=True)
class Gyro:
    """How the columns of a gyro belong to roll, pitch and yaw."""

    order: tuple[int, ...]  #: for x, y, z in turn, the place of its column (from 0) among the gyro's
    signs: tuple[int, ...]
    unit: str
    correlations: tuple[float, ...]  #: with the rates of the angles
    #: logarithm of the odds that roll, pitch and yaw are of the gyro's handedness (`_shared_handedness`)
    handedness: float = 0.0

    def rates(self, values: Floats) -> Floats:
        """Return the rates (N, 3) [rad/s] of roll, pitch and yaw by the gyro's columns (N, 3)."""
        return values[:, list(self.order)] * (FACTORS["rad/s"][self.unit] * np.asarray(self.signs))


@dataclass(frozen=True, kw_only=True)
class Tilts:
    """Whether roll and pitch turn with the heading, ZYX, or are tilts that do not, XYZ."""

    sequence: AngleSequence = "ZYX"
    odds: float = (
        math.inf
    )  #: logarithm of those of the sequence over the other one; below zero without a yaw only
    handedness: float = 0.0  #: of XYZ, logarithm of the odds that tilts and yaw are of one handedness
    heading: float = 0.0  #: mean yaw [rad], by which the turns of the IMU differ by the two
    apart: float = (
        0.0  #: standard deviation of the yaw [rad], by which directions of the lean then still differ
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Signals:
    """A file's signals on even rows."""

    rows: Floats  #: (N,) [s]
    wheels: Smooth
    lean: Smooth | None
    heading: Smooth | None
    usable: Bools  #: moving and not fallen


@dataclass(frozen=True, kw_only=True, eq=False)
class SensedMotion:
    """What the sensors show with the units that the motion supports."""

    units: Units
    likely: dict[Units, float]
    angles: Floats  #: (M, n) [rad]
    sampled: Floats  #: (M,) [s]
    #: noise of the speeds [rad/s] with the file's times and with those of the encoders, if these are taken
    noise: tuple[float, float] | None
    largest_speed: float | None  #: [rad/s], if an encoder was reset
    wrap: float | None  #: period of the wheel angles in the file's numbers
    signals: Signals
    gyro: Gyro | None
    tested: LeanTest | None
    tilts: Tilts


def motion_of_file(base: Columned) -> SensedMotion:
    """Return the likeliest units and what the sensors show with them."""
    roles, t = base.roles, base.t
    raw, wrap = _continued(base.stacked(roles.angles), of_speeds=roles.of_speeds)
    named, counts = roles.unit(roles.angles), base.stated.counts_per_turn
    wheels = wheel_units(t, raw, base.robot, named, of_speeds=roles.of_speeds, per_turn=counts)
    if roles.of_speeds:
        raw = np.column_stack([integral_of(t, speed) for speed in raw.T])
    leans = [Unit(name="rad", factor=1.0, reason="of a quaternion")]
    if roles.attitude and not roles.quaternion:
        leans = lean_units(base.raw_attitude[:, :2], roles.unit(roles.attitude))
    likely, motion = likeliest_units(leans, wheels), None
    named_yaw = roles.unit(roles.attitude[2:]) is not None
    for _ in range(4):
        units = next(iter(likely))
        if motion is not None and motion.units == units:
            break
        motion = _with_units(base, raw, wrap, units)
        tested = motion.tested
        gain = tested.placements[0].gain if tested and tested.confidence > 0.5 else None
        heading = tested and tested.heading
        # the wheels may not plainly follow it
        plain = heading and abs(heading.correlation) > SCALED and heading.confidence >= CONFIDENT
        turning = heading.gain if heading and plain else None
        likely = likeliest_units(leans, wheels, units, gain=gain, turning=turning, heading_named=named_yaw)
    assert motion is not None
    return replace(motion, likely=likely)


def _continued(angles: Floats, *, of_speeds: bool) -> tuple[Floats, float | None]:
    """Return angles (M, n) without the jumps of a full counter or turn, and its period if there is one."""
    whole = bool(np.all(angles == np.round(angles)))
    period = None if of_speeds else wrap_period(angles, (TURNS[-1], *COUNTERS) if whole else TURNS)
    if period is None:
        return angles, None
    return np.column_stack([unwrapped(column, period=period) for column in angles.T]), period


def _with_units(base: Columned, raw: Floats, wrap: float | None, units: Units) -> SensedMotion:
    roles, robot, t = base.roles, base.robot, base.t
    lean, wheel = units
    angles, limit = raw * wheel.factor, IMPOSSIBLE_SPEED * robot.drive.top_speed
    carried = angles if roles.of_speeds else without_resets(t, angles, limit)
    sampled, noise = (t, None) if roles.of_speeds else _sampled(t, carried)
    rows, kept = even_rows(t), new_messages(sampled)

    def smoothed(values: Floats, width: float = WIDTHS[-1]) -> Smooth:
        return smooth(rows, sampled[kept], values[kept], width=width)

    attitude, tilts, with_yaw = None, Tilts(), len(roles.attitude) > 2
    named = roles.unit(roles.gyro)
    turning = base.stacked(roles.gyro) if roles.attitude and roles.gyro else None
    if roles.attitude:
        attitude = np.zeros((len(t), 3))
        attitude[:, : len(roles.attitude)] = base.raw_attitude * [
            FACTORS["rad"][unit] for unit in base.angle_units(lean.name)
        ]
        attitude[:, 2] = np.unwrap(attitude[:, 2])
        if with_yaw and not roles.quaternion and roles.half_turn is None:
            tilts = _tilts(base, smoothed, carried, attitude, turning)
        if tilts.sequence == "XYZ":
            attitude[:, :2] = turning_tilts(attitude, math.copysign(1.0, tilts.handedness))
    leans = [] if attitude is None else [smoothed(attitude, width) for width in WIDTHS]
    rates = [] if turning is None else [smoothed(turning, width) for width in WIDTHS]
    fits = [_gyro_fit(*pair, named, with_yaw=with_yaw) for pair in zip(leans, rates, strict=False)]
    gyro = max((fit for fit in fits if fit), key=lambda fit: min(fit.correlations[:2]), default=None)
    tried = [
        _signals(
            base,
            smoothed(carried, width),
            leans[k] if leans else None,
            rates[k].each(gyro.rates) if gyro else None,
        )
        for k, width in enumerate(WIDTHS)
    ]
    signals, tested = _best_tested(robot, tried)
    if tested and attitude is not None and len(roles.attitude) == 2 and roles.half_turn is None:
        heading = signals.heading or heading_of(robot, signals.wheels, tested.placements[0])
        attitude[:, 2] = np.interp(sampled, signals.rows, heading.value[:, 0])
        tilts = _tilts(base, smoothed, carried, attitude, turning)
        # without a yaw there is nothing to turn tilts by
        tilts = tilts if tilts.sequence == "ZYX" else replace(tilts, sequence="ZYX", odds=-tilts.odds)
    return SensedMotion(
        units=units,
        likely={},
        angles=carried,
        sampled=sampled,
        noise=noise,
        largest_speed=None if np.allclose(carried, angles, atol=1e-6) else limit,
        wrap=wrap,
        signals=signals,
        gyro=gyro,
        tested=tested,
        tilts=tilts,
    )


def _best_tested(robot: Robot, tried: Sequence[Signals]) -> tuple[Signals, LeanTest | None]:
    """Return the signals whose test of the lean has the smallest error of the phase, and that test; else the first.

    That error counts more if the placement is in doubt.
    """
    known: list[tuple[float, Signals, LeanTest]] = []
    for signals in tried:
        if test := signals.lean and lean_test(
            robot, signals.lean, signals.wheels, signals.heading, signals.usable
        ):
            error = math.pi if test.phase_error is None else test.phase_error
            known.append((error / max(test.confidence, 0.05), signals, test))
    _, best, tested = min(known, key=itemgetter(0), default=(0.0, tried[0], None))
    return best, tested


def _sampled(t: Floats, angles: Floats) -> tuple[Floats, tuple[float, float] | None]:
    """Return when the rows were sampled [s], and the speeds' noise before and after if that was estimated."""
    steps, before = np.diff(t), speed_noise(t, angles)
    if math.isnan(before) or float(np.ptp(steps)) < EVEN_TIMES * float(np.median(steps)):
        return t, None
    times = sampling_times(t, angles)
    # in every row its time takes up the error of one wheel
    after = speed_noise(times, angles) / math.sqrt(1.0 - 1.0 / angles.shape[1])
    return (times, (before, after)) if after <= WORTH_REPAIRING * before else (t, None)


def _signals(base: Columned, wheels: Smooth, angles: Smooth | None, rates: Smooth | None) -> Signals:
    """Return the signals on even rows; with a gyro, the lean's rates are the gyro's, and the heading without a yaw."""
    rows, lean, heading = even_rows(base.t), None, None
    if angles is not None:
        lean, heading = (angles.each(itemgetter(part)) for part in (np.s_[:, :2], np.s_[:, 2:]))
        heading = heading if len(base.roles.attitude) > 2 else None
    if lean is not None and rates is not None:
        lean = replace(lean, rate=rates.value[:, :2], acceleration=rates.rate[:, :2])
        if heading is None:
            value = INTERVAL * np.cumsum(rates.value[:, 2:], axis=0)
            heading = Smooth(value=value, rate=rates.value[:, 2:], acceleration=rates.rate[:, 2:])
    commands = base.held_commands(rows) if base.roles.commands else None
    usable = balancing_rows(lean.value if lean else None, wheels.rate, commands)
    usable &= np.interp(rows, base.t, base.frozen.astype(np.float64)) == 0.0
    return Signals(rows=rows, wheels=wheels, lean=lean, heading=heading, usable=usable)


def _tilts(
    base: Columned,
    smoothed: Callable[[Floats], Smooth],
    angles: Floats,
    attitude: Floats,
    turning: Floats | None,
) -> Tilts:
    """Return whether roll and pitch turn with the yaw (M, 3) [rad], by the law of the lean and by a gyro.

    Each sequence is tried with a yaw of either handedness, and the widest filter: headings turn slowly.
    """
    sigmas = (1.0, -1.0)
    still = [np.column_stack([turning_tilts(attitude, sigma), attitude[:, 2]]) for sigma in sigmas]
    wheels, turned, *tilts = map(smoothed, (angles, attitude, *still))
    heading, usable = turned.value[:, 2], balancing_rows(turned.value[:, :2], wheels.rate, None)
    if not usable.any() or float(np.std(heading[usable])) < STILL_HEADING:
        return Tilts()
    readings = [*((sigma, turned) for sigma in sigmas), *zip(sigmas, tilts, strict=True)]
    evidence = [unexplained_by_readings(base.robot, readings, wheels, usable)]
    if turning is not None:
        rates, named = smoothed(turning), base.roles.unit(base.roles.gyro)
        left = [_unexplained_by_gyro(reading, rates, named, usable) for _, reading in readings]
        evidence.append((left, usable.astype(np.float64)))

    def odds(one: int, other: int) -> float:
        z = [ERRORS_WEIGHT * advantage(left[one], left[other], weights) for left, weights in evidence]
        return sum(math.copysign(0.5 * each**2, each) for each in z)

    handedness = odds(2, 3)
    turns = odds(0 if odds(0, 1) >= 0.0 else 1, 2 if handedness >= 0.0 else 3) + TURNING_ODDS
    return Tilts(
        sequence="ZYX" if turns >= 0.0 else "XYZ",
        odds=abs(turns),
        handedness=handedness,
        heading=float(np.angle(np.exp(1j * heading[usable]).mean())),
        apart=float(np.std(heading[usable])),
    )


def _unexplained_by_gyro(angles: Smooth, rates: Smooth, named: str | None, usable: Bools) -> Floats:
    """Return the squares (B,) that a gyro (N, 3) leaves of the rates about x and y by angles (N, 3) [rad]."""
    gyro, body = _gyro_fit(angles, rates, named, with_yaw=True), _body_rates(angles)
    left = ((body if gyro is None else gyro.rates(rates.value) - body)[:, :2]) * usable[:, None]
    return block_sums((left**2).sum(axis=1), np.arange(len(left)) // round(1.0 / INTERVAL))


def _gyro_fit(angles: Smooth, gyro: Smooth, named: str | None, *, with_yaw: bool) -> Gyro | None:
    """Return which way of a cube a gyro (N, 3) fits the rates of angles (N, 3) [rad]; None if none fits."""
    a, b = gyro.value, _body_rates(angles)
    R, confidence = confidence_in(a, b)
    axes = (0, 1, 2) if with_yaw else (0, 1)
    order = max(permutations(range(3)), key=lambda p: sum(abs(R[p[axis], axis]) for axis in axes))
    shown = (np.abs(R) >= RELATED) & (confidence >= CONFIDENT)
    if not (shown[order[0], 0] and shown[order[1], 1]):
        return None
    # a heading that hardly turns shows no sign
    with_yaw = with_yaw and bool(shown[order[2], 2])
    axes = axes[: 3 if with_yaw else 2]
    agreement = [abs(float(R[order[axis], axis])) for axis in axes]
    signs = [1 if R[order[axis], axis] > 0.0 else -1 for axis in axes]
    if not with_yaw:  # axes of one handedness
        signs.append(signs[0] * signs[1] * (1 if order in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1))
    # noise makes a slope too small: least so on the axis that agrees best
    best = int(np.argmax(agreement))
    gain = float(np.std(a[:, order[best]]) / np.std(b[:, best]))
    table = FACTORS["rad/s"]
    names = (named,) if named in table else ("rad/s", "deg/s")
    unit = min(names, key=lambda name: abs(math.log(gain * table[name])))
    if abs(math.log(gain * table[unit])) > GYRO_GAIN:
        return None
    fit = Gyro(order=order, signs=tuple(signs), unit=unit, correlations=tuple(agreement))
    return replace(fit, handedness=_shared_handedness(angles, fit.rates(a), with_yaw=with_yaw))


def _shared_handedness(angles: Smooth, turning: Floats, *, with_yaw: bool) -> float:
    """Return the logarithm of the odds that angles (N, 3) and the gyro (N, 3) [rad/s] along them are right-handed.

    Besides the rates of the angles a gyro has products, to first order of the lean k (-psi_dot pitch, psi_dot roll,
    -pitch_dot roll), with k = 1. An axis that is reversed in both makes k = -1.
    """
    roll, pitch, _ = angles.value.T
    turn = angles.rate[:, 2] if with_yaw else turning[:, 2]
    products = np.column_stack([-turn * pitch, turn * roll, -angles.rate[:, 1] * roll])
    left = turning - angles.rate
    axes, inside = (3 if with_yaw else 2), slice(round(GYRO_EDGE / INTERVAL), -round(GYRO_EDGE / INTERVAL))
    left, products = left[inside, :axes], products[inside, :axes]
    block = np.arange(len(left)) // round(1.0 / INTERVAL)
    left = left - left.mean(axis=0)
    along, power = (block_sums((products * factor).sum(axis=1), block) for factor in (left, products))
    if len(along) < 3 or not power.any():
        return 0.0
    k = float(along.sum() / power.sum())
    error = float(np.linalg.norm(along - k * power) / power.sum())
    # over blocks, as any other standard error
    return 2.0 * k * (ERRORS_WEIGHT / max(error, LEAST_PRODUCT_ERROR)) ** 2


def _body_rates(attitude: Smooth) -> Floats:
    """Return the angular velocity (N, 3) about the IMU's axes from roll, pitch, yaw and their rates."""
    roll, pitch, _ = attitude.value.T
    roll_dot, pitch_dot, yaw_dot = attitude.rate.T
    about_x = roll_dot - yaw_dot * np.sin(pitch)
    about_y = pitch_dot * np.cos(roll) + yaw_dot * np.sin(roll) * np.cos(pitch)
    about_z = -pitch_dot * np.sin(roll) + yaw_dot * np.cos(roll) * np.cos(pitch)
    return np.column_stack([about_x, about_y, about_z])
