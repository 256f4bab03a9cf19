"""Faults of a motor within a log: no torque, less, the opposite, or another motor's, from one time to another.

The balance of torques (`ballbot.log.torque_balance`) leaves at every row

    r = (u - f) P - n           n: torques that the motion needs, P: projection on those that act on the ball

f is the friction of the wheels that turn, by one law for all motors and a fit that a faulty part of the log does not
move; a wheel that sticks may have any friction up to break-away, and r is what that leaves. Under a fault, u_i is
multiplied by a factor or exchanged with u_j, which leaves r_f. The fault's evidence in a quarter of a second is

    1/2 log (|r|^2 + s^2) / (|r_f|^2 + s^2)

bounded by s, which has the errors of friction and of the torques' scale and what is usual in the log. All wheels are in
it, so that a push, which no single motor explains, is none. A fault lasts over the blocks with the largest sum of it.
The wheels' speeds are those of the states: columns of encoders may be exchanged together with those of the torques.
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

#: length of the blocks [s]: the filter's memory
BLOCK = 0.25
#: factors of a torque that are tried
FACTORS = (0.5, 0.0, -1.0)
#: errors of the friction of all wheels, over break-away, and of the torques; break-away over the law's friction
FRICTION_ERROR, SCALE_ERROR, BREAKAWAY = 0.3, 0.15, 1.2
#: evidence that a block must have to be part of a fault
DRIFT = 0.1
#: part of what the torques leave that a fault explains, at least: a push in the plane is up to 67 % one wheel's
EXPLAINED = 0.7
#: part of the torques that the motion and friction explain in the other rows, at least
SOUND = 0.5
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
    explained: float  #: part of what the torques leave
    elsewhere: (
        float  #: part of the torques that is explained in the other rows, without it; 0 if there are none
    )
    within: bool  #: whether the other rows contradict it
    largest: float  #: torque that is commanded meanwhile [N m]

    @property
    def when(self) -> str:
        """When it is there, in words."""
        if self.end is None:
            return "throughout" if self.start is None else f"from {self.start:.4g} s on"
        begin = "until" if self.start is None else f"from {self.start:.4g} to"
        return f"{begin} {self.end:.4g} s"


def fault_findings(fault: MotorFault | None, *, names: Sequence[str]) -> list[Finding]:
    """Return the error of a fault that is clear: the motor, or the two, and the time."""
    if fault is None or fault.explained < EXPLAINED or fault.elsewhere < SOUND:
        return []
    columns = [names[i] for i in fault.motors]
    which, name, largest = f"Motor {fault.motors[0] + 1} gives", columns[0], f"{fault.largest:.2g} N m"
    key, text = "torque-scale", f"{which} {fault.factor:.2g} times the torque {name} {fault.when}"
    if len(columns) > 1:
        key, text = "torque-order", f"{every(columns)} drive each other's wheels {fault.when}"
    elif fault.factor < -NO_TORQUE:
        key, text = "torque-sign", f"{name} has the opposite sign {fault.when}"
    elif fault.factor <= NO_TORQUE:
        key, text = "dead-motor", f"{which} no torque {fault.when}, while {name} reaches {largest}"
    time, percent = fault.start or 0.0, 100.0 * fault.explained
    return judged(f"{key}: within", columns, fault.evidence, time, fault=text, percent=percent)


def motor_fault(log: Log, motion: Motion, robot: Robot) -> MotorFault | None:
    """Return the fault of a part of a log that explains its motion best; None without every wheel's torque."""
    speeds = wheel_speed_names(robot.wheel_count)
    driving = driving_of(Log({name: log[name] for name in log if name not in speeds}), motion, robot)
    return None if driving is None else likeliest(driving, motion.even[motion.usable], robot)


def likeliest(driving: Driving, t: Floats, robot: Robot) -> MotorFault | None:
    """Return the fault with the most evidence; its rows are at the times t (N,) [s]."""
    u, own = driving.torque, list(range(robot.wheel_count))
    law = _friction(driving)
    friction, breakaway = driving.friction @ law, float(law[0] + law[2])
    stuck = BREAKAWAY * breakaway * (1.0 - driving.turning)
    T = transforms(robot).T_owb
    P = T @ np.linalg.pinv(T)
    block = np.unique(np.floor((t - t[0]) / BLOCK), return_inverse=True)[1]
    rows = np.bincount(block)

    def mean(squares: Floats) -> Floats:
        return np.bincount(block, weights=squares.sum(axis=1)) / rows

    def left(torque: Floats) -> Floats:
        residual = np.abs((torque - friction) @ P - driving.needed) - stuck
        return mean(np.square(np.maximum(residual, 0.0)))

    def with_factor(i: int, factor: float) -> Floats:
        return u * np.where(np.arange(len(own)) == i, factor, 1.0)

    faults: dict[tuple[tuple[int, ...], float], Floats] = {
        ((i,), factor): with_factor(i, factor) for i in own for factor in FACTORS
    }
    for i, j in combinations(own, 2):
        order = [{i: j, j: i}.get(k, k) for k in own]
        faults[(i, j), 1.0] = u[:, order]
    logged, power = left(u), mean(u**2)
    noise = np.median(logged) + len(own) * (FRICTION_ERROR * breakaway) ** 2 + SCALE_ERROR**2 * power
    lasting = 0.5 * EVERY * INTERVAL / BLOCK * rows
    found = []
    for (motors, factor), torque in faults.items():
        remaining = left(torque)
        evidence = lasting * np.log((logged + noise) / (remaining + noise))
        first, last = _best_run(evidence - DRIFT * lasting)
        part = slice(first, last)
        found.append((float(evidence[part].sum()), motors, factor, part, evidence, remaining))
    if not any(one[0] for one in found):
        return None
    total, motors, factor, part, evidence, remaining = max(found, key=lambda one: one[0])
    inside = (block >= part.start) & (block < part.stop)
    others = np.delete(logged / np.maximum(power, 1e-30), np.r_[part])
    weight = 1.0 / (logged + noise)[part]
    if len(motors) == 1:
        tried = sorted(np.linspace(-1.0, 0.75, 36), key=abs)
        factor = min(tried, key=lambda one: float((left(with_factor(motors[0], one)) * rows)[part].sum()))
    return MotorFault(
        motors=motors, factor=float(factor),
        start=float(t[inside][0]) if part.start else None,
        end=float(t[inside][-1]) if part.stop < len(rows) else None,
        evidence=total, explained=1.0 - float(weight @ remaining[part] / max(weight @ logged[part], 1e-30)),
        elsewhere=1.0 - float(np.median(others)) if len(others) else 0.0,
        within=total - float(evidence.sum()) > ELSEWHERE, largest=float(np.abs(u[inside][:, motors]).max()),
    )  # fmt: skip


def _friction(driving: Driving) -> Floats:
    """Return the factors (3,) of the friction's terms, alike in all wheels, by a fit with Cauchy's weights.

    None is negative, as friction does not drive.
    """
    X, y = driving.friction.reshape(-1, 3), (driving.torque - driving.needed).ravel()
    turned, law = driving.turning.ravel() ** TURNED_POWER, np.zeros(3)
    for _ in range(20):
        squares = np.square(y - X @ law)
        order = np.argsort(squares)
        share = np.cumsum(turned[order])
        middle = squares[order[np.searchsorted(share, 0.5 * share[-1]).clip(max=len(order) - 1)]]
        weight = np.sqrt(turned / (1.0 + squares / (4.0 * middle + 1e-12)))
        law = nnls(X * weight[:, None], y * weight)[0]
    return law


def _best_run(values: Floats) -> tuple[int, int]:
    """Return the first index of the consecutive values with the largest sum, and the one behind the last."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    last = int(np.argmax(sums - np.minimum.accumulate(sums)))
    return int(np.argmin(sums[: last + 1])), last
