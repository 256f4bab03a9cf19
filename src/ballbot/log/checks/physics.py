"""Whether logs agree with the robot's own equations: one log by itself, several logs with each other.

`examine` runs the checks of one log in the order in which they depend on each other: the delay of the torques, the lean
axes against the ball's acceleration, the torques against those that the motion needs. They use neither friction nor the
controller. `different_robots` compares several logs: a log's scales (torque over the needed torque, ball acceleration
over that of the lean) are those of its robot over the robot file's. They need not be one, but they must be the same in
every log of a robot.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import nnls

from ballbot.errors import every
from ballbot.findings import Finding, Place, error, warning
from ballbot.log.checks.lean import EVERY, LeanEvidence, lean_evidence, lean_findings, motion_of, usable_rows
from ballbot.log.checks.torque_balance import (
    TURNED_POWER,
    USUAL,
    Driving,
    Gains,
    bound_findings,
    driving_of,
    gain_findings,
    gains_of,
    motor_sums,
    together,
)
from ballbot.log.columns import STATE_NAMES, Floats, torque_names
from ballbot.log.log import Log
from ballbot.log.mapping_search.commands import assign, by_wheel
from ballbot.log.signals import INTERVAL
from ballbot.robot import Robot


@dataclass(frozen=True, kw_only=True, eq=False)
class PhysicsOfLog:
    """Results of one log by itself; None if it is not conclusive or an earlier check failed."""

    findings: tuple[Finding, ...] = ()
    lean: LeanEvidence | None = None
    gains: Gains | None = None  #: of torques that have no other fault


def examine(log: Log, robot: Robot) -> PhysicsOfLog:
    """Check a log of balancing with the robot's equations, and return findings and the scales of the log.

    Order, sign and scale of the torques are checked only against a motion that the lean confirms: not if the lean
    contradicts the ball's acceleration or is not conclusive.
    Checks whose columns the log lacks are skipped. The robot's friction is not used.
    """
    names = torque_names(robot.wheel_count)
    found = PhysicsOfLog(findings=tuple(delay_findings(log, robot)))
    rows = usable_rows(log, robot)
    if rows is None:
        return found
    motion = motion_of(log, rows)
    lean = lean_evidence(motion, robot)
    found = replace(found, lean=lean)
    wrong = lean_findings(lean)
    if wrong or found.findings:
        return replace(found, findings=(*found.findings, *wrong))
    if not lean.conclusive:
        text = (
            "The signs and scales of lean and torques cannot be checked: the acceleration of the ball does not follow "
            "the lean clearly enough (too little motion, slipping wheels, or a robot that is held)."
        )
        return replace(found, findings=(warning("physics", text),), lean=None)
    driving = driving_of(log, rows, motion, robot)
    fit = torque_findings(driving, names=names) if driving else []
    if fit or driving is None:
        return replace(found, findings=tuple(fit))
    gains = gains_of(motor_sums(driving, motion, robot))
    return replace(found, findings=tuple(gain_findings(gains, names=names)), gains=gains)


LONGEST_DELAY = 0.5  #: [s], in either direction
#: longer lags are an error [s]; the computing time of a controller and the group delay of a filter are below
LARGEST_DELAY = 0.03
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
    turn = np.exp(-1j * log["psi"])
    pairs = (("x", "y"), ("theta", "phi"), ("x_dot", "y_dot"), ("theta_dot", "phi_dot"))
    turned = [(log[a] + 1j * log[b]) * turn for a, b in pairs]
    parts = [part for one in turned for part in (one.real, one.imag)]
    table = np.column_stack([*parts, log["psi"], log["psi_dot"], *(log[name] for name in names)])[
        :ENOUGH_ROWS
    ]
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
    products = [
        states[max(-lag, 0) : rows - max(lag, 0)].T @ torques[max(lag, 0) : rows - max(-lag, 0)]
        for lag in lags
    ]
    explained = np.square(products).sum(axis=(1, 2)) / max(float(np.sum(torques**2)), 1e-30)
    delays = lags * log.sample_time
    usual = float(explained[np.abs(delays) <= LARGEST_DELAY].max())
    best = int(np.argmax(explained))
    if abs(delays[best]) <= LARGEST_DELAY or explained[best] < max(DELAY_EXPLAINED, usual + DELAY_MARGIN):
        return []
    milliseconds, is_late = 1000.0 * abs(delays[best]), delays[best] > 0.0
    text = (
        f"The torques are {milliseconds:.0f} ms too {'late' if is_late else 'early'} in the log: they respond to the "
        f"states {milliseconds:.0f} ms {'before' if is_late else 'after'}. The times of the torques or of the sensors "
        "are wrong; shift one of them ([input] delay or [attitude] delay in a mapping)."
    )
    return [error("torque-delay", text, *names)]


def torque_bounds(examined: Iterable[PhysicsOfLog], robot: Robot) -> list[Finding]:
    """Return how well a robot's logs together bound the scale of its torques, unless they bound it well."""
    known = [one.gains for one in examined if one.gains is not None]
    return bound_findings(together(known), names=torque_names(robot.wheel_count)) if known else []


def torque_scale_errors(logs: Iterable[Log], robot: Robot) -> Floats:
    """Return the relative standard error (n,) that a motor's friction has because logs do not bound its torque's scale.

    Zero where they bound it; what is usual where they do not show it at all.
    """
    known = [one.gains for log in logs if (one := examine(log, robot)).gains is not None]
    return together(known).scale_errors() if known else np.full(robot.wheel_count, USUAL)


#: confidence in another order or other signs from which it is an error
CONFIDENT = 0.9
#: fraction of the torques that must be explained to conclude an order or sign: torques of another run of the same robot
#: reach 0.68, as both follow the limit cycle
EXPLAINED = 0.75
#: explained fraction below which torques are unrelated to the motion
UNRELATED = 0.15
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


def torque_findings(driving: Driving, *, names: tuple[str, ...]) -> list[Finding]:
    """Return the error of torques of another order or sign than the motion's, or without a relation to it."""
    own = tuple(range(len(names)))
    found = assign(driving, [1] * len(names))
    corrected = replace(driving, torque=by_wheel(driving.torque, (found.wheels, found.signs)))
    explained, after = (np.array([_explained(one, i) for i in own]) for one in (driving, corrected))
    changed = found.wheels != own or min(found.signs) < 0
    turned = EVERY * INTERVAL * float(np.sum(driving.turning**TURNED_POWER))
    enough = turned > LEAST_TURNING and found.explained > EXPLAINED and after.min() > UNRELATED
    if changed and enough and found.confidence > CONFIDENT:
        text = (
            f"The torques do not fit the motion as logged: {_fault(names, found.wheels, found.signs)}. With this "
            f"correction they explain {100.0 * found.explained:.0f} % of the torque that the motion needs, as logged "
            f"{100.0 * explained.mean():.0f} %. Correct the columns or the mapping."
        )
        return [error("torque-sign" if found.wheels == own else "torque-order", text, *names)]
    unrelated = np.full(len(names), True) if explained.mean() < UNRELATED else explained < UNRELATED
    if unrelated.all() or (unrelated.any() and explained.max() > EXPLAINED):
        columns = [name for name, one in zip(names, unrelated, strict=True) if one]
        text = (
            f"{every(columns)}: the motion explains at most {100.0 * explained[unrelated].max():.0f} %, and no other "
            "order or signs fit. The torque is of another log, shifted in time, random, or not that of the motor."
        )
        return [error("torque-unrelated", text, *columns)]
    return []


def _fault(names: tuple[str, ...], wheels: tuple[int, ...], signs: tuple[int, ...]) -> str:
    """Return what is wrong with torques of which each drives that wheel (from 0) with that sign."""
    moved = [j for j, wheel in enumerate(wheels) if wheel != j]
    negated = [name for name, sign in zip(names, signs, strict=True) if sign < 0]
    parts = []
    if len(moved) == 2:
        parts.append(f"{names[moved[0]]} and {names[moved[1]]} are swapped")
    elif moved:
        order = ", ".join(f"{names[j]} drives wheel {wheels[j] + 1}" for j in moved)
        parts.append(f"the torques are in another order ({order})")
    if len(negated) == len(names):
        parts.append("all torques have the opposite sign")
    elif negated:
        parts.append(f"{' and '.join(negated)} {'have' if len(negated) > 1 else 'has'} the opposite sign")
    return " and ".join(parts)


#: two scales are of different robots if they differ by more than this factor and by more than their uncertainty, and by
#: this relative uncertainty in addition
APART, MARGIN = 1.18, 0.03
SURE = 3.0  #: standard errors
#: widest bracket (of the two regressions of the lean) that is compared
WIDEST = 1.6
_TORQUE, _LEAN = "the torque that the motion needs", "the ball's acceleration at a lean"
#: why a scale differs
_CAUSES = {
    _TORQUE: "One is heavier, or has another gear ratio or torque constant.",
    _LEAN: "They differ in wheel or ball radius, gear ratio, encoder counts or height of the centre of mass.",
}


def different_robots(examined: Mapping[str, PhysicsOfLog]) -> list[Finding]:
    """Return an error for each scale in which logs, by their names, differ more than logs of one robot can."""
    scales = {name: _scales(one) for name, one in examined.items()}
    return [
        finding
        for quantity in _CAUSES
        for finding in _compared({n: own[quantity] for n, own in scales.items() if quantity in own}, quantity)
    ]


def _scales(one: PhysicsOfLog) -> dict[str, tuple[float, float]]:
    """Return the scales that a log shows, relative to the robot file's, with their relative uncertainties."""
    found: dict[str, tuple[float, float]] = {}
    if one.gains is not None and np.isfinite(one.gains.common()[1]):
        middle, uncertain = one.gains.common()
        found[_TORQUE] = middle, SURE * uncertain
    if one.lean is not None and one.lean.conclusive and not one.lean.misread:
        forward, reverse = abs(one.lean.gravity_gain), one.lean.reverse_gain
        if forward > 0.0 and np.isfinite(reverse) and reverse < WIDEST * forward:
            # all of the bracket: how the noise divides between lean and acceleration is unknown
            half = 0.5 * abs(float(np.log(reverse / forward)))
            found[_LEAN] = float(np.sqrt(forward * reverse)), half + SURE * one.lean.gravity_error / forward
    return found


def _compared(scales: Mapping[str, tuple[float, float]], quantity: str) -> list[Finding]:
    """Return the finding on the two logs that differ most clearly, in the one that is farther from the robot file."""

    def margin(pair: tuple[str, str]) -> float:
        """Return the excess of the difference of two scales' logarithms over its tolerance."""
        (one, uncertain), (other, also_uncertain) = scales[pair[0]], scales[pair[1]]
        return abs(np.log(one / other)) - max(uncertain + also_uncertain + MARGIN, np.log(APART))

    apart = max(combinations(scales, 2), key=margin, default=None)
    if apart is None or margin(apart) <= 0.0:
        return []
    other, odd = sorted(apart, key=lambda name: abs(np.log(scales[name][0])))
    odd_words, other_words = (
        f"{scales[n][0]:.2f} +- {scales[n][0] * scales[n][1]:.2f}" for n in (odd, other)
    )
    text = (
        f"{odd} and {other} are of different robots: {quantity} is {scales[odd][0] / scales[other][0]:.2f} times as "
        f"large in {odd} (relative to the robot file it is {odd_words} in {odd} and {other_words} in {other}). "
        f"{_CAUSES[quantity]} Use logs of one robot in one condition."
    )
    return [Finding(code="robots", severity="error", text=text, where=Place(file=odd))]
