"""Wheel columns against the states: order, sign and gain; disturbances other than wheels and gravity.

The comparison (`ballbot.log.pose`) needs no torque and no model of friction. For a foreign log, which has no
states yet, see `ballbot.log.mapping_search`.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment

from ballbot.arrays import Bools, Floats
from ballbot.findings import Finding
from ballbot.log.checks.table import judged
from ballbot.log.columns import MAX_WHEELS, STATE_NAMES, wheel_angle_names, wheel_speed_names
from ballbot.log.evidence import SCALED
from ballbot.log.log import Log
from ballbot.log.pose import wheel_speeds_of_states
from ballbot.log.signals import WIDTH, Smooth, across_a_gap, balancing_rows, encoder_step, even_rows, smooth
from ballbot.log.units import unit_of_ratio
from ballbot.robot import Robot
from ballbot.summary import counted

if TYPE_CHECKING:
    from ballbot.log.placement import LeanTest

#: least standard deviation of the wheel speeds of the states for a conclusion [rad/s]
LEAST_MOTION = 0.05
#: an order must correlate better than the columns' own by this much on average to be preferred
CLEAR_MARGIN = 0.05
#: gains within these of one are right (slip, play and noise take a few percent)
GAIN_RANGE = (0.9, 1.1)
#: gains within the first factor of each other have one cause, which is an error beyond the second factor; and a gain
#: that slip cannot explain
ALIKE, WRONG_GAIN, IMPOSSIBLE_GAIN = 1.12, 1.2, 3.0
#: standard deviation of a heading that turns enough to show its sign [rad]: a heading that trembles about one value is
#: late in the gyro
TURNING_HEADING = 0.02
#: the fewest rows, and those that are used, at even intervals of the log
FEWEST_ROWS, ENOUGH_ROWS = 500, 1500
#: another reading of columns must leave at most this fraction unexplained, so many times less than the columns as
#: logged, and at most so many times as much as other wheels do
UNEXPLAINED, CLEARLY_LESS, AS_GOOD = 0.3, 1.8, 1.1


@dataclass(frozen=True, kw_only=True)
class WheelAgreement:
    """The order and signs under which the wheels' columns fit the states best, and how well."""

    order: tuple[int, ...]  #: Ballbot's wheel i is the log's wheel order[i-1]
    signs: tuple[int, ...]  #: of the log's wheel order[i-1]
    gains: tuple[float, ...]  #: logged speed over the states', by least squares; after order and sign
    correlations: tuple[float, ...]  #: after order and sign

    @property
    def own(self) -> bool:
        """Whether order and signs are those of the columns."""
        return self.order == tuple(sorted(self.order)) and min(self.signs) > 0


def _rolling(log: Log, robot: Robot) -> tuple[Floats, Floats] | None:
    """Return the states (N, 10) and the wheels' speeds (N, n) of complete rows; None without the columns or motion."""
    names = wheel_speed_names(robot.wheel_count)
    if not {*STATE_NAMES, *names} <= set(log.names):
        return None
    table = np.column_stack([log[name] for name in (*STATE_NAMES, *names)])
    table = table[np.isfinite(table).all(axis=1)]
    states, logged = np.split(table, [len(STATE_NAMES)], axis=1)
    return (states, logged) if len(table) >= 2 and logged.std(axis=0).min() > 0.0 else None


def wheel_agreement(log: Log, robot: Robot) -> WheelAgreement | None:
    """Compare the wheels' columns with the states; None if the log lacks them, or has too little motion."""
    rolling = _rolling(log, robot)
    if rolling is None:
        return None
    states, logged = rolling
    expected = wheel_speeds_of_states(states, robot)
    if expected.std(axis=0).min() < LEAST_MOTION:
        return None
    own = np.arange(robot.wheel_count)
    correlation = np.corrcoef(logged, expected, rowvar=False)[: len(own), len(own) :]  # [logged, expected]
    size = np.abs(correlation)
    # the logged column that fits each wheel of the robot; the columns' own order if none is clearly better
    order = np.argsort(linear_sum_assignment(size, maximize=True)[1])
    if size[order, own].mean() <= size[own, own].mean() + CLEAR_MARGIN:
        order = own
    signs = np.where(correlation[order, own] >= 0.0, 1, -1)
    gains = signs * np.sum(logged[:, order] * expected, axis=0) / np.sum(expected**2, axis=0)
    return WheelAgreement(
        order=tuple((order + 1).tolist()), signs=tuple(signs.tolist()),
        gains=tuple(gains.tolist()), correlations=tuple(size[order, own].tolist()),
    )  # fmt: skip


def _misread_axes(log: Log, robot: Robot, agreement: WheelAgreement | None) -> list[Finding]:
    """Return the error of ball or heading columns that must be negated or exchanged to fit the wheels.

    The wheel speeds determine the ball's velocity and the heading's rate in the body frame. x_dot, y_dot and psi are
    tried with every exchange and sign; one that fits clearly better than the columns as logged is the right one, unless
    another order or other signs of the wheels fit as well.
    """
    from ballbot.log.checks.lean import READINGS, fault, matrix_of

    rolling = _rolling(log, robot)
    if rolling is None or len(rolling[0]) < FEWEST_ROWS or rolling[1].std(axis=0).min() < LEAST_MOTION:
        return []
    states, logged = (part[:: max(1, len(part) // ENOUGH_ROWS)] for part in rolling)

    def left(states: Floats, logged: Floats) -> float:
        """Return the fraction of the squared wheel speed that the states leave; a common gain is fitted."""
        expected = wheel_speeds_of_states(states, robot)
        gain = max(float(np.vdot(expected, logged) / max(np.vdot(expected, expected), 1e-30)), 0.0)
        return float(np.square(logged - gain * expected).sum() / np.square(logged).sum())

    tried: list[tuple[float, str, tuple[str, ...], str]] = []
    for reading in READINGS[1:]:
        changed = np.column_stack([states[:, :5], states[:, 5:7] @ matrix_of(reading).T, states[:, 7:]])
        words = fault(reading, ("x", "y"), with_rates=True)
        tried.append((left(changed, logged), "ball-axes", ("x", "y", "x_dot", "y_dot"), words))
    if states[:, 4].std() >= TURNING_HEADING:
        changed = states * np.where(np.isin(np.arange(10), (4, 9)), -1.0, 1.0)
        words = "psi has the opposite sign, with its rate"
        tried.append((left(changed, logged), "heading-sign", ("psi", "psi_dot"), words))
    least, key, columns, words = min(tried)
    ordered = 1.0
    if agreement and not agreement.own:
        ordered = left(states, logged[:, [i - 1 for i in agreement.order]] * agreement.signs)
    if least > min(UNEXPLAINED, left(states, logged) / CLEARLY_LESS, AS_GOOD * ordered):
        return []
    if agreement and ordered < AS_GOOD * least:
        order, signs = list(agreement.order), list(agreement.signs)
        words += f", or the wheels are in the order {order} with signs {signs}"
    return judged(key, columns, fault=words)


def other_wheels(log: Log, wheel_count: int) -> list[Finding]:
    """Return the error of columns with values of wheels that a robot of so many does not have."""
    names = [
        name
        for number in range(wheel_count + 1, MAX_WHEELS + 1)
        for name in (f"u{number}", f"wheel{number}", f"wheel{number}_dot")
        if name in log and np.unique(log[name][np.isfinite(log[name])]).size > 1
    ]
    return judged("wheels: others", names, len(names), names=", ".join(names), count=wheel_count)


def check_sampling(log: Log, robot: Robot) -> list[Finding]:
    """Return a warning for a sample time or an encoder's counts in the robot file that the log contradicts."""
    if len(log) < 2:
        return []
    period, written = log.sample_time, robot.sensors.sample_time
    off = abs(np.log(period / written))
    findings = judged("robot-sensors: period", ["t"], off, period=1e3 * period, written=1e3 * written)
    names = [name for name in wheel_angle_names(robot.wheel_count) if name in log]
    step = encoder_step(np.column_stack([log[name] for name in names])) if names else None
    decimals = np.log10([step, np.degrees(step)]) if step else np.zeros(1)
    # a power of ten, in radians or degrees, is the rounding of the file
    if step and np.abs(decimals - np.round(decimals)).min() > 0.01:
        counts, ratio = robot.sensors.encoder_counts, robot.drive.gear_ratio
        seen = 2.0 * np.pi / (ratio * step)
        numbers = {"step": step, "seen": seen, "ratio": ratio, "counts": counts}
        findings += judged("robot-sensors: counts", names, abs(np.log(seen / counts)), **numbers)
    return findings


def check_wheels(log: Log, robot: Robot) -> list[Finding]:
    """Return findings on the wheels' columns for this robot: number, order, sign, gain, or that none can be checked."""
    columns, own = wheel_speed_names(robot.wheel_count), range(1, robot.wheel_count + 1)
    if others := other_wheels(log, robot.wheel_count):
        return others
    agreement = wheel_agreement(log, robot)
    if misread := _misread_axes(log, robot, agreement):
        return misread
    if agreement is None:
        return judged("wheels: unseen", [])
    follows = min(agreement.correlations) >= SCALED
    if follows and agreement.own:
        return _gain_findings(agreement.gains, robot)
    # states that were computed from the wheels have the wheels' own mistake
    tested = wheel_test(log, robot)
    if tested and (wheels := tested.reversed_wheels):
        named = f"{counted(len(wheels), 'wheel')} ({', '.join(map(str, wheels))})"
        return judged("encoders", columns, wheels=named, signs=[-1 if i in wheels else 1 for i in own])
    correlations = ", ".join(f"{value:.2f}" for value in agreement.correlations)
    order, signs = list(agreement.order), [agreement.signs[agreement.order.index(i)] for i in own]
    key = "wheels: order" if follows else "wheels: weak"
    return judged(key, columns, correlations=correlations, order=order, signs=signs)


def _gain_findings(gains: tuple[float, ...], robot: Robot) -> list[Finding]:
    """Return the finding on gains that are not one: an error if slip cannot explain them."""
    if all(GAIN_RANGE[0] < gain < GAIN_RANGE[1] for gain in gains):
        return []
    common, alike, ratio = float(np.median(gains)), max(gains) < ALIKE * min(gains), robot.drive.gear_ratio
    counts = robot.sensors.encoder_counts * ratio / (2.0 * np.pi)
    causes = {
        ratio: f"they are the motors' speeds; divide by the gear ratio {ratio:g}",
        1.0 / ratio: f"they were divided once too often by the gear ratio {ratio:g}",
        counts: f"they are encoder counts; multiply by 2 pi / (counts per turn x gear ratio) = {1.0 / counts:.4g} rad",
    }
    unit = unit_of_ratio(common, "rad/s", within=ALIKE) if alike else None
    known = f"their speeds are in {unit}, not in rad/s" if unit else None
    known = known or next(
        (causes[size] for size in causes if alike and 1.0 / ALIKE < common / size < ALIKE), None
    )
    cause = known or (
        "a radius, the tilt, the gear ratio or the encoder counts differ from the robot file or by wheel, x and y were "
        "computed with another radius, or the ball slips or pivots"
    )
    off = np.inf if known else max(max(gains), 1.0 / min(gains)) / (WRONG_GAIN if alike else IMPOSSIBLE_GAIN)
    listed = ", ".join(f"{gain:.4g}" for gain in gains)
    return judged("wheels: gain", wheel_speed_names(len(gains)), off, gains=listed, cause=cause)


def wheel_test(log: Log, robot: Robot) -> LeanTest | None:
    """Return how the wheels of a log sit, by theta, phi, psi and the encoders' angles; None if it does not show that.

    See `ballbot.log.placement`.
    """
    from ballbot.log.placement import lean_test

    moved = smoothed_motion(log, robot.wheel_count)
    if moved is None:
        return None
    _, usable, motion = moved
    parts = np.s_[:, :2], np.s_[:, 2:3], np.s_[:, 3:]
    lean, heading, wheels = (motion.each(itemgetter(part)) for part in parts)
    return lean_test(robot, lean, wheels, heading, usable)


def smoothed_motion(
    log: Log, wheel_count: int, *, width: float = WIDTH
) -> tuple[Floats, Bools, Smooth] | None:
    """Return even rows (N,), which of them are balancing, and the motion on them; None if a column is missing.

    The motion is the lean (2) in the frame that turns with the heading, the heading, and the wheels' angles.
    """
    names = ("theta", "phi", "psi", *wheel_angle_names(wheel_count))
    if wheel_count < 3 or not set(names) <= set(log.names):
        return None
    table = np.column_stack([log[name] for name in names])
    known = np.isfinite(table).all(axis=1)
    if known.sum() < 2:
        return None
    t, table = log.t[known], table[known]
    lean, rows = (table[:, 0] + 1j * table[:, 1]) * np.exp(-1j * table[:, 2]), even_rows(t)
    moved = smooth(rows, t, np.column_stack([lean.real, lean.imag, table[:, 2:]]), width=width)
    # rows interpolated across a gap of more than a twentieth of a second are not used
    usable = balancing_rows(moved.value[:, :2], moved.rate[:, 3:], None) & ~across_a_gap(rows, t, 0.05)
    return rows, usable, moved


def check_disturbance(log: Log, robot: Robot) -> list[Finding]:
    """Return a warning if the torque that neither wheels nor gravity explain is more than gravity's."""
    tested = wheel_test(log, robot)
    return judged("disturbance", [], tested.disturbance, times=tested.disturbance) if tested else []
