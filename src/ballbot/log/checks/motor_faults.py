"""Faults of a motor within a log: no torque, less, the opposite, or another motor's, from one time to another.

The balance of torques (`ballbot.log.torque_balance`) leaves at every row

    r = (u - f) P - n           n: torques that the motion needs, P: projection on those that act on the ball

f is the friction of turning wheels, by one law for all motors and a fit that a faulty part of the log does not move;
what holds a sticking wheel may be anything up to a few times that, and r is what it leaves. A fault multiplies u_i by a
factor, or exchanges u_i and u_j, and leaves r_f. Its evidence in a quarter of a second is

    1/2 log (|r|^2 + s^2) / (|r_f|^2 + s^2)

with the errors of friction and of the torques' scale in s. All wheels are in r, so that a push, which no single motor
explains, gives little. A fault lasts over the blocks with the largest sum. The wheels' speeds are those of the states,
as encoders may be exchanged together with motors.
"""

from itertools import combinations

import numpy as np
from scipy.optimize import nnls

from ballbot.arrays import Floats
from ballbot.errors import every
from ballbot.findings import Finding
from ballbot.log.checks.table import judged
from ballbot.log.columns import torque_names, wheel_speed_names
from ballbot.log.log import Log
from ballbot.log.signals import INTERVAL
from ballbot.log.torque_balance import EVERY, TURNED_POWER, Driving, Motion, driving_of
from ballbot.mechanics.geometry import transforms
from ballbot.robot import Robot

#: length of the blocks [s], the filter's memory; evidence that one must have; and factors of a torque that are tried
BLOCK, DRIFT, FACTORS = 0.25, 0.1, (0.5, 0.0, -1.0)
#: errors of the friction of all wheels, over break-away, and of the torques; what holds a sticking wheel over the law's
#: friction: the ball's own friction and the other wheels hold it, too
FRICTION_ERROR, SCALE_ERROR, BREAKAWAY = 0.4, 0.15, 3.0
#: part of r that a fault explains, at least (a push in the plane is up to 67 % one wheel's); and that of the torques
#: which motion and friction explain in the other rows
EXPLAINED, SOUND = 0.7, 0.5
#: factors up to this are no torque; and evidence that the other rows have against another sign or order: without it,
#: that is the whole log's
NO_TORQUE, ELSEWHERE = 0.25, 1.0


def check_motors(log: Log, motion: Motion, robot: Robot) -> list[Finding]:
    """Return the error of the fault of a part of a log that has the most evidence, if it is clear."""
    speeds, n = wheel_speed_names(robot.wheel_count), robot.wheel_count
    driving = driving_of(Log({name: log[name] for name in log if name not in speeds}), motion, robot)
    if driving is None:
        return []
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
    noise = np.median(logged) + n * (FRICTION_ERROR * breakaway) ** 2 + SCALE_ERROR**2 * power + 1e-30
    turned = np.bincount(block, weights=driving.turning.max(axis=1))  # a robot that stands shows nothing
    lasting, found = 0.5 * EVERY * INTERVAL / BLOCK * turned, []
    pairs: list[tuple[tuple[int, ...], float]] = [(pair, 1.0) for pair in combinations(range(n), 2)]
    for motors, factor in [*(((i,), factor) for i in range(n) for factor in FACTORS), *pairs]:
        remaining = left(motors, factor)
        evidence = lasting * np.log((logged + noise) / (remaining + noise))
        sums = np.concatenate([[0.0], np.cumsum(evidence - DRIFT * lasting)])
        last = int(np.argmax(sums - np.minimum.accumulate(sums)))
        part = slice(int(np.argmin(sums[: last + 1])), last)
        found.append((float(evidence[part].sum()), motors, factor, part, evidence, remaining))
    total, motors, factor, part, evidence, remaining = max(found, key=lambda one: one[0])
    weight, others = 1.0 / (logged + noise)[part], np.delete(logged / np.maximum(power, 1e-30), np.r_[part])
    explained = 1.0 - float(weight @ remaining[part] / max(weight @ logged[part], 1e-30))
    whole = (len(motors) > 1 or factor < 0.0) and total - evidence.sum() < ELSEWHERE
    if total <= 0.0 or explained < EXPLAINED or whole or not len(others) or np.median(others) > 1.0 - SOUND:
        return []
    if len(motors) == 1:
        tried = sorted(np.linspace(-1.0, 0.75, 36).tolist(), key=abs)
        factor = min(tried, key=lambda one: float((left(motors, one) * rows)[part].sum()))
    columns, gives = [torque_names(n)[i] for i in motors], f"Motor {motors[0] + 1} gives"
    key, fault = "torque-scale", f"{gives} {factor:.2g} times the torque {columns[0]}"
    if len(motors) > 1:
        key, fault = "torque-order", f"{every(columns)} drive each other's wheels"
    elif factor < -NO_TORQUE:
        key, fault = "torque-sign", f"{columns[0]} has the opposite sign"
    elif factor <= NO_TORQUE:
        key, fault = "dead-motor", f"{gives} no torque"
    inside = t[(block >= part.start) & (block < part.stop)]
    when = f"until {inside[-1]:.1f} s" if part.start == 0 else f"from {inside[0]:.1f} to {inside[-1]:.1f} s"
    when = f"from {inside[0]:.1f} s on" if part.stop == len(rows) else when
    numbers = {"fault": f"{fault} {when}", "percent": 100.0 * explained}
    return judged(f"{key}: within", columns, total, float(inside[0]), **numbers)


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
