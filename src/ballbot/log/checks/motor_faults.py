"""Faults of a motor within a log: no torque, less, the opposite, or another motor's, from one time to another.

The balance of torques (`ballbot.log.torque_balance`) leaves at every row

    r = (u - f) P - n           n: torques that the motion needs, P: projection on those that act on the ball

f is the friction of turning wheels, by one law for all motors and a fit that a faulty part of the log does not move; a
wheel that sticks may have any friction up to break-away, and r is what that leaves. A fault multiplies u_i by a factor,
or exchanges u_i and u_j, and leaves r_f. Its evidence in a quarter of a second is 1/2 log (|r|^2 + s^2) / (|r_f|^2 +
s^2), with errors of friction and of the torques' scale in s; all wheels are in r, so that a push, which no single motor
explains, gives little. A fault lasts over the blocks with the largest sum. The wheels' speeds are those of the states:
encoders may be exchanged together with motors.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import nnls

from ballbot.arrays import Floats
from ballbot.errors import every
from ballbot.findings import Finding
from ballbot.log.balancing_motion import EVERY, Motion
from ballbot.log.checks.table import judged
from ballbot.log.columns import wheel_speed_names
from ballbot.log.log import Log
from ballbot.log.signals import INTERVAL
from ballbot.log.torque_balance import TURNED_POWER, Driving, driving_of
from ballbot.mechanics.geometry import transforms
from ballbot.robot import Robot

#: length of the blocks [s], the filter's memory; evidence that one must have; and factors of a torque that are tried
BLOCK, DRIFT, FACTORS = 0.25, 0.1, (0.5, 0.0, -1.0)
#: errors of the friction of all wheels, over break-away, and of the torques; break-away over the law's friction
FRICTION_ERROR, SCALE_ERROR, BREAKAWAY = 0.3, 0.15, 1.2
#: part of r that a fault explains, at least (a push in the plane is up to 67 % one wheel's); and that of the torques
#: which motion and friction explain in the other rows
EXPLAINED, SOUND = 0.7, 0.5
#: factors up to this are no torque; and evidence against a fault in the other rows that confines it to its own
NO_TORQUE, ELSEWHERE = 0.25, 1.0


@dataclass(frozen=True, kw_only=True)
class MotorFault:
    """The likeliest fault of a part of a log."""

    motors: tuple[int, ...]  #: one, or the two that are exchanged (from 0)
    factor: float  #: of the one motor's torque
    start: float | None  #: [s]; None if it is there from the first usable row
    end: float | None  #: [s]; None if it lasts to the last usable row
    evidence: float  #: sum over its blocks
    explained: float  #: part of r
    elsewhere: (
        float  #: part of the torques that is explained in the other rows, without it; 0 if there are none
    )
    within: bool  #: whether the other rows contradict it


def fault_findings(fault: MotorFault | None, *, names: Sequence[str]) -> list[Finding]:
    """Return the error of a fault that is clear: the motor, or the two, and the time."""
    if fault is None or fault.explained < EXPLAINED or fault.elsewhere < SOUND:
        return []
    columns, gives = [names[i] for i in fault.motors], f"Motor {fault.motors[0] + 1} gives"
    key, text = "torque-scale", f"{gives} {fault.factor:.2g} times the torque {columns[0]}"
    if len(columns) > 1:
        key, text = "torque-order", f"{every(columns)} drive each other's wheels"
    elif fault.factor < -NO_TORQUE:
        key, text = "torque-sign", f"{columns[0]} has the opposite sign"
    elif fault.factor <= NO_TORQUE:
        key, text = "dead-motor", f"{gives} no torque"
    since = "" if fault.start is None else f" from {fault.start:.1f} s"
    until = " on" if fault.end is None else f" to {fault.end:.1f} s"
    numbers = {"fault": text + since + until, "percent": 100.0 * fault.explained}
    return judged(f"{key}: within", columns, fault.evidence, fault.start or 0.0, **numbers)


def motor_fault(log: Log, motion: Motion, robot: Robot) -> MotorFault | None:
    """Return the fault of a part of a log with the most evidence; None without any, or without every torque."""
    speeds, n = wheel_speed_names(robot.wheel_count), robot.wheel_count
    driving = driving_of(Log({name: log[name] for name in log if name not in speeds}), motion, robot)
    if driving is None:
        return None
    t, law, T = motion.even[motion.usable], _friction(driving), transforms(robot).T_owb
    friction, breakaway, P = driving.friction @ law, float(law[0] + law[2]), T @ np.linalg.pinv(T)
    stuck = BREAKAWAY * breakaway * (1.0 - driving.turning)
    block = np.unique(np.floor((t - t[0]) / BLOCK), return_inverse=True)[1]
    rows = np.bincount(block)

    def mean(values: Floats) -> Floats:
        return np.bincount(block, weights=np.square(values).sum(axis=1)) / rows

    def left(motors: tuple[int, ...] = (), factor: float = 1.0) -> Floats:
        """Return |r_f|^2 of each block."""
        way = np.eye(n)[[dict(zip(motors, motors[::-1], strict=True)).get(i, i) for i in range(n)]]
        way[:, motors[:1]] *= factor
        residual = np.abs((driving.torque @ way - friction) @ P - driving.needed)
        return mean(np.maximum(residual - stuck, 0.0))

    logged, power = left(), mean(driving.torque)
    noise = np.median(logged) + n * (FRICTION_ERROR * breakaway) ** 2 + SCALE_ERROR**2 * power
    lasting, found = 0.5 * EVERY * INTERVAL / BLOCK * rows, []
    pairs: list[tuple[tuple[int, ...], float]] = [(pair, 1.0) for pair in combinations(range(n), 2)]
    for motors, factor in [*(((i,), factor) for i in range(n) for factor in FACTORS), *pairs]:
        remaining = left(motors, factor)
        evidence = lasting * np.log((logged + noise) / (remaining + noise))
        sums = np.concatenate([[0.0], np.cumsum(evidence - DRIFT * lasting)])
        last = int(np.argmax(sums - np.minimum.accumulate(sums)))
        part = slice(int(np.argmin(sums[: last + 1])), last)
        found.append((float(evidence[part].sum()), motors, factor, part, evidence, remaining))
    total, motors, factor, part, evidence, remaining = max(found, key=lambda one: one[0])
    if total <= 0.0:
        return None
    if len(motors) == 1:
        tried = sorted(np.linspace(-1.0, 0.75, 36).tolist(), key=abs)
        factor = min(tried, key=lambda one: float((left(motors, one) * rows)[part].sum()))
    inside, weight = t[(block >= part.start) & (block < part.stop)], 1.0 / (logged + noise)[part]
    others = np.delete(logged / np.maximum(power, 1e-30), np.r_[part])
    return MotorFault(
        motors=motors, factor=factor, evidence=total, within=total - float(evidence.sum()) > ELSEWHERE,
        start=float(inside[0]) if part.start else None, end=float(inside[-1]) if part.stop < len(rows) else None,
        explained=1.0 - float(weight @ remaining[part] / max(weight @ logged[part], 1e-30)),
        elsewhere=1.0 - float(np.median(others)) if len(others) else 0.0,
    )  # fmt: skip


def _friction(driving: Driving) -> Floats:
    """Return the factors (3,) of the friction's terms, none negative, of all wheels: a fit with Cauchy's weights."""
    X, y = driving.friction.reshape(-1, 3), (driving.torque - driving.needed).ravel()
    turned, law = driving.turning.ravel() ** TURNED_POWER, np.zeros(3)
    for _ in range(20):
        squares = np.square(y - X @ law)
        order = np.argsort(squares)
        share = np.cumsum(turned[order])
        middle = squares[order[min(np.searchsorted(share, 0.5 * share[-1]), len(order) - 1)]]
        weight = np.sqrt(turned / (1.0 + squares / (4.0 * middle + 1e-12)))
        law = nnls(X * weight[:, None], y * weight)[0]
    return law
