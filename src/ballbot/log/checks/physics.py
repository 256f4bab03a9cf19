"""Check logs against the robot's equations: one log by itself, several logs with each other.

`examine` runs the checks of one log in the order in which they depend on each other: the delay of the torques, the lean
axes against the ball's acceleration, the torques against those that the motion needs. They use neither friction nor the
controller. `different_robots` compares several logs: the scale of a log's torques over those that its motion needs is
that of its robot over the robot file's. It need not be one, but it must be the same in every log of a robot.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import nnls

from ballbot.errors import every
from ballbot.findings import Finding
from ballbot.log.checks.lean import check_lean_axes
from ballbot.log.checks.motor_faults import check_motors
from ballbot.log.checks.table import judged
from ballbot.log.columns import STATE_NAMES, torque_names
from ballbot.log.log import Log
from ballbot.log.signals import INTERVAL
from ballbot.log.torque_balance import (
    EVERY,
    SURE,
    TURNED_POWER,
    UNLIKE,
    CommandOrder,
    Driving,
    Gains,
    assign,
    by_wheel,
    driving_of,
    gains_of,
    motion_of,
)
from ballbot.robot import Robot


@dataclass(frozen=True, kw_only=True, eq=False)
class PhysicsOfLog:
    """Results of one log by itself."""

    findings: Sequence[Finding]
    gains: Gains | None = None  #: of torques that have no other fault; None if an earlier check failed


def examine(log: Log, robot: Robot) -> PhysicsOfLog:
    """Check a log of balancing with the robot's equations, and return findings and the scales of its torques.

    Order, sign and scale of the torques are checked only against a motion that the lean confirms: not if the lean
    contradicts the ball's acceleration or is not conclusive. Faults within the log need only that it does not
    contradict it.
    Checks whose columns the log lacks are skipped. The robot's friction is not used.
    """
    names = torque_names(robot.wheel_count)
    late, motion = delay_findings(log, robot), motion_of(log, robot)
    if motion is None:
        return PhysicsOfLog(findings=late)
    wrong = check_lean_axes(motion, robot)
    # the balance of torques holds with a motor that fails, and whether or not the lean is conclusive
    if not late and all(item.severity != "error" for item in wrong):
        wrong += check_motors(log, motion, robot)
    driving = None if late or wrong else driving_of(log, motion, robot)
    wrong = [*late, *wrong] or (torque_findings(driving, names=names) if driving else [])
    if wrong or driving is None:
        return PhysicsOfLog(findings=wrong)
    gains = gains_of(driving)
    return PhysicsOfLog(findings=gain_findings(gains, names=names), gains=gains)


LONGEST_DELAY = 0.5  #: [s], in either direction
#: lags of a controller and a filter [s]
USUAL_DELAY = 0.03
#: fraction of the torques' changes that the lag must explain, and its excess over any usual lag
DELAY_EXPLAINED, DELAY_MARGIN = 0.4, 0.2
#: changes beyond this many times the median are due to an event, a saturation or a gap
LARGE_CHANGE = 5.0
#: rows that are needed, and that are used from the log's start: a few hundred are enough for the lag
FEWEST_ROWS, ENOUGH_ROWS = 400, 20000


def delay_findings(log: Log, robot: Robot) -> list[Finding]:
    """Return the error of torques that come clearly too late, or too early, for the states beside them.

    Every feedback passes the noise of its state on to its torques. From row to row most of the change of a measured
    state is noise, to which a controller responds at once. A regression of the torques' changes on earlier changes of
    the states explains them at one lag only: that between the two in the log. The robot's own delay, from torque to
    motion, has no effect here.
    """
    names = torque_names(robot.wheel_count)
    if not {*STATE_NAMES, *names} <= set(log.names):
        return []
    # in the heading frame, in which a feedback is constant
    pairs = (("x", "y"), ("theta", "phi"), ("x_dot", "y_dot"), ("theta_dot", "phi_dot"))
    turned = [(log[a] + 1j * log[b]) * np.exp(-1j * log["psi"]) for a, b in pairs]
    parts = [part for signal in turned for part in (signal.real, signal.imag)]
    table = np.column_stack([*parts, *(log[name] for name in ("psi", "psi_dot", *names))])[:ENOUGH_ROWS]
    table = np.diff(table[np.isfinite(table).all(axis=1)], axis=0)
    size = LARGE_CHANGE * np.median(np.abs(table), axis=0) if len(table) >= FEWEST_ROWS else np.zeros(1)
    moved = int((size[len(STATE_NAMES) :] > 0.0).sum())
    if not moved or not (size[: len(STATE_NAMES)] > 0.0).any():
        return []
    table = np.clip(table, -size, size)[:, size > 0.0]
    table -= table.mean(axis=0)
    states, torques = table[:, :-moved], table[:, -moved:]
    # whitened states, so that explained fractions are sums of squares
    factor = np.linalg.cholesky(states.T @ states + 1e-30 * np.eye(states.shape[1]))
    states = states @ np.linalg.pinv(factor).T
    reach = min(max(1, round(LONGEST_DELAY / log.sample_time)), len(states) // 4)
    rows, lags = len(states), np.arange(-reach, reach + 1)
    ends = [(max(lag, 0), max(-lag, 0)) for lag in lags]
    products = [states[early : rows - late].T @ torques[late : rows - early] for late, early in ends]
    explained = np.square(products).sum(axis=(1, 2)) / max(float(np.sum(torques**2)), 1e-30)
    delays, best = lags * log.sample_time, int(np.argmax(explained))
    usual = float(explained[np.abs(delays) <= USUAL_DELAY].max())
    if explained[best] < max(DELAY_EXPLAINED, usual + DELAY_MARGIN):
        return []
    late, before = ("late", "before") if delays[best] > 0.0 else ("early", "after")
    delay = abs(delays[best])
    return judged("torque-delay", names, delay, ms=1000.0 * delay, late=late, before=before)


#: fraction of the torques that must be explained to conclude an order or sign: torques of another run of the same robot
#: reach 0.68, as both follow the limit cycle; and below which torques are unrelated to the motion
EXPLAINED, UNRELATED = 0.75, 0.15
#: an order or sign needs this much turning for certain, of all wheels together [s]
LEAST_TURNING = 5.0


def _explained(driving: Driving, i: int) -> float:
    """Return the fraction of a torque's variance that its wheel's motion explains."""
    columns = np.column_stack([driving.needed[:, i], driving.friction[:, i]])
    columns = columns - columns.mean(axis=0)
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-30)
    u = driving.torque[:, i] - driving.torque[:, i].mean()
    # neither the motion's torque nor friction can be negative
    return max(1.0 - float(nnls(columns / size, u)[1]) ** 2 / max(float(u @ u), 1e-30), 0.0)


def gain_findings(gains: Gains, *, names: tuple[str, ...]) -> list[Finding]:
    """Return the error of a torque that is scaled unlike the others, or of all that are scaled."""
    factors, errors = gains.unlike()
    off = np.nan_to_num(np.abs(np.log(factors)))
    i = int(np.argmax(np.where(off > np.maximum(SURE * errors, np.log(UNLIKE)), off / errors, 0.0)))
    if off[i] > max(SURE * errors[i], np.log(UNLIKE)):
        return judged("torque-scale: one", [names[i]], name=names[i], factor=factors[i])
    factor, uncertain = gains.common()
    sure, heavier = abs(np.log(factor)) - SURE * uncertain, "heavier" if factor > 1.0 else "lighter"
    return judged("torque-scale", names, sure, factor=factor, heavier=heavier)


def torque_findings(driving: Driving, *, names: tuple[str, ...]) -> list[Finding]:
    """Return the error of torques of another order or sign than the motion's, or without a relation to it."""
    own = tuple(range(len(names)))
    order = assign(driving, [1] * len(names))
    corrected = replace(driving, torque=by_wheel(driving.torque, (order.wheels, order.signs)))
    explained, after = (np.array([_explained(motion, i) for i in own]) for motion in (driving, corrected))
    turned = EVERY * INTERVAL * float(np.sum(driving.turning**TURNED_POWER))
    enough = turned > LEAST_TURNING and order.explained > EXPLAINED and after.min() > UNRELATED
    if enough and (order.wheels != own or min(order.signs) < 0):
        fault, key = _fault(names, order), "torque-sign" if order.wheels == own else "torque-order"
        after, before = 100.0 * order.explained, 100.0 * explained.mean()
        if wrong := judged(key, names, order.confidence, fault=fault, after=after, before=before):
            return wrong
    unrelated = np.full(len(names), True) if explained.mean() < UNRELATED else explained < UNRELATED
    columns = [name for name, is_unrelated in zip(names, unrelated, strict=True) if is_unrelated]
    if not columns or (len(columns) < len(names) and explained.max() <= EXPLAINED):
        return []
    percent = 100.0 * explained[unrelated].max()
    return judged("torque-unrelated", columns, names=every(columns), percent=percent)


def _fault(names: tuple[str, ...], order: CommandOrder) -> str:
    """Return the fault of torques with this order and these signs, in words."""
    moved = [f"{names[j]} drives wheel {wheel + 1}" for j, wheel in enumerate(order.wheels) if wheel != j]
    negated = [name for name, sign in zip(names, order.signs, strict=True) if sign < 0]
    have = f"{every(negated)} {'have' if len(negated) > 1 else 'has'} the opposite sign" if negated else ""
    return " and ".join(text for text in (", ".join(moved), have) if text)


#: two scales are of different robots if they differ by more than this factor and by more than their uncertainty, and by
#: this relative uncertainty in addition
APART, MARGIN = 1.18, 0.03


def different_robots(examined: Mapping[str, PhysicsOfLog]) -> list[Finding]:
    """Return the error of logs, by their names, whose torques' scales differ more than logs of one robot can.

    It is on the two that differ most clearly, in the one that is farther from the robot file.
    """
    common = {name: log_physics.gains.common() for name, log_physics in examined.items() if log_physics.gains}
    scales = {name: (k, 3.0 * error) for name, (k, error) in common.items() if np.isfinite(error)}
    margins = {
        (one, other): abs(np.log(a / b)) - max(a_error + b_error + MARGIN, np.log(APART))
        for (one, (a, a_error)), (other, (b, b_error)) in combinations(scales.items(), 2)
    }
    pair = max(margins, key=lambda pair: margins[pair], default=None)
    if pair is None:
        return []
    other, odd = sorted(pair, key=lambda name: abs(np.log(scales[name][0])))
    of_odd, of_other = (f"{k:.2f} +- {k * error:.2f}" for k, error in (scales[odd], scales[other]))
    numbers = {"factor": scales[odd][0] / scales[other][0], "of_odd": of_odd, "of_other": of_other}
    found = judged("robots", [], margins[pair], odd=odd, other=other, **numbers)
    return [replace(finding, where=replace(finding.where, file=odd)) for finding in found]
