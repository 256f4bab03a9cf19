"""What no controller of a robot passes on a course: the largest push and speed, the shortest stop and settling.

Linear programs over the samples of a motion of the robot linearised upright, so to first order in the lean:

    x' = A x + B u + b s        u: torques of the wheels and rolling friction, s: the impulse of a push

within the motors' torque over speed, the wheels' grip on the ball with the load that lean and torques shift between
them, and the lean at which a run ends. Each counts for the controller where it is not known: friction acts where it
helps, the heading may turn, and the torques are of one who knows a push, or the end of a motion, as it begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.linalg import expm
from scipy.optimize import linprog

from ballbot.arrays import Floats
from ballbot.control.lqr import frictionless_model
from ballbot.mechanics.model import Model
from ballbot.mechanics.traction import contact_forces
from ballbot.robot import Robot
from ballbot.robot.components import FALLING_PART
from ballbot.simulation.imperfections import Push
from ballbot.workflows.courses import DIRECTIONS, Course
from ballbot.workflows.limits import pushed_state
from ballbot.workflows.metrics import REST

#: steps of a push, of the time in which a robot is to be within its band, and of that in which it comes to rest [s]:
#: with twice as many, no bound of `alten` changes by a per cent
_PUSHED, _MOVING, _RESTING, _REST_TIME = 4, 40, 40, 4.0
#: between looks at the reference [s]
_LOOK = 0.05
#: sides of the polygon around a circle; the longest time [s], and how often it is halved
_SIDES, _LONGEST, _HALVINGS = 24, 16.0, 10


@dataclass(frozen=True, kw_only=True, eq=False)
class _Motions:
    """What a robot can do on a course; rows are of z = (x, u)."""

    model: Model
    A: Floats  #: (10, 10 + m) x' by z
    most: Floats  #: (10 + m,) of z
    rows: Floats  #: (k, 10 + m) motors' speed and wheels' grip
    limits: Floats  #: (k,) of the rows

    @staticmethod
    def of(robot: Robot, course: Course) -> _Motions:
        model, n, friction = frictionless_model(robot), robot.wheel_count, robot.friction
        linear, M = model.linearize(), model.mass_matrix(np.zeros(5))
        rolling = np.vstack([np.zeros((5, 2)), np.linalg.inv(M)[:, :2]])
        forces, grip = contact_forces(model), course.scenario.roller_grip
        breakaway, falling = np.array(friction.breakaway), FALLING_PART / robot.drive.torque_limit
        torques = np.eye(n, 10 + n + 2, k=10)
        curve = falling * torques
        curve[:, 5:10] = model.wheel_jacobian(np.zeros(5)) / robot.drive.top_speed
        traction, pressing = np.zeros((2, n, 10 + n + 2))
        lean_and_torques = [2, 3, *range(10, 10 + n)]
        traction[:, lean_and_torques], pressing[:, lean_and_torques] = forces.traction, forces.pressing
        most = np.full(10 + n + 2, np.inf)
        most[2:4] = course.scenario.fallen_lean
        most[10:-2] = robot.drive.torque_limit + breakaway
        most[-2:] = friction.rolling * robot.weight
        return _Motions(
            model=model,
            A=np.hstack([linear.A, linear.B, rolling]),
            most=most,
            rows=np.vstack([curve, -curve, traction - grip * pressing, -traction - grip * pressing]),
            limits=np.concatenate([*[1.0 + falling * breakaway] * 2, *[grip * forces.load] * 2]),
        )

    def solve(
        self,
        steps: Sequence[float],
        start: Floats,
        *,
        push: Floats | None = None,
        size: tuple[float, float | None] = (0.0, None),
        sign: float = 1.0,
        within: tuple[Floats, Floats, float] | None = None,
        first: int = 0,
    ) -> float:
        """Return the least s, or with a sign of -1 the largest, with which the robot comes to rest; NaN if none.

        `steps` [s]; `push` is the state (10,) after a push of s = 1, in the first ones; `size` bounds s. `within`
        (R, r, limit): R x + r s stays below the limit from the `first` sample on.
        """
        K, width, pushed = len(steps), len(self.most), 0 if push is None else _PUSHED
        rate = np.zeros((10, 1)) if push is None else push[:, None] / sum(steps[:pushed])
        full = np.vstack([np.hstack([self.A, rate]), np.zeros((width - 9, width + 1))])
        by_time = {h: expm(h * full)[:10] for h in set(steps)}
        moves = [by_time[h] for h in steps]
        last = sparse.csr_matrix((10 * K, width))
        change = sparse.hstack([sparse.block_diag([move[:, :-1] for move in moves]), last])
        change -= sparse.kron(sparse.eye(K, K + 1, k=1), np.eye(10, width))
        by_s = np.concatenate([move[:, -1] * (k < pushed) for k, move in enumerate(moves)])
        limits = np.tile(self.limits, (K + 1, 1))
        limits[:pushed, len(self.limits) // 2 :] = np.inf  # a push loads the wheels, too
        below = [sparse.kron(sparse.eye(K + 1), self.rows)]
        below_s, most = [np.zeros(limits.size)], [limits.ravel()]
        if within is not None:
            R, r, limit = within
            samples = K + 1 - first
            R_z = np.hstack([R, np.zeros((len(R), width - 10))])
            below.append(sparse.kron(sparse.eye(samples, K + 1, k=first), R_z))
            below_s.append(np.tile(r, samples))
            most.append(np.full(samples * len(R), limit))
        high = np.tile(self.most, (K + 1, 1))
        low = -high
        low[0, :10] = high[0, :10] = start
        low[-1, [2, 3, *range(5, 10)]] = high[-1, [2, 3, *range(5, 10)]] = 0.0
        values = np.concatenate(most)
        kept = np.isfinite(values)
        A_ub = sparse.hstack([sparse.vstack(below), np.concatenate(below_s)[:, None]], format="csr")
        found = linprog(
            np.append(np.zeros(high.size), sign),
            A_ub=A_ub[kept],
            b_ub=values[kept],
            A_eq=sparse.hstack([change, by_s[:, None]], format="csr"),
            b_eq=np.zeros(10 * K),
            bounds=[*zip(low.ravel(), high.ravel(), strict=True), size],
            method="highs-ipm",
        )
        return float(found.x[-1]) if found.status == 0 else np.nan

    def least_time(
        self, start: Floats, columns: list[int], band: float, *, push: Floats | None = None, lasts: float = 0.0
    ) -> float:
        """Return the shortest time [s] after which two states stay within a band; NaN if none is found.

        `push` is the state (10,) after a push that `lasts` some time [s].
        """
        angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES  # the polygon is around the circle
        circle = np.column_stack([np.cos(angles), np.sin(angles)]) @ np.eye(10)[columns]
        before, low, high = [lasts / _PUSHED] * (0 if push is None else _PUSHED), 0.0, np.nan
        for _ in range(_HALVINGS):
            time = 0.5 * (low + (high if high == high else _LONGEST))
            steps = [*before, *[time / _MOVING] * _MOVING, *[_REST_TIME / _RESTING] * _RESTING]
            within = (circle, np.zeros(_SIDES), band)
            found = self.solve(
                steps, start, push=push, size=(1.0, 1.0), within=within, first=len(before) + _MOVING
            )
            low, high = (time, high) if np.isnan(found) else (low, time)
        return lasts + high


def top_speed(robot: Robot) -> float:
    """Return the steady speed along x [m/s] at which a motor's torque is its friction."""
    turns = np.abs(frictionless_model(robot).wheel_jacobian(np.zeros(5))[:, 0])
    drive, friction = robot.drive, robot.friction
    falling = FALLING_PART / drive.torque_limit
    speeds = (1.0 - falling * np.array(friction.coulomb)) / (
        1.0 / drive.top_speed + falling * np.array(friction.viscous)
    )
    return float((speeds / np.maximum(turns, 1e-9)).min())


def push_bounds(robot: Robot, course: Course) -> Floats:
    """Return the largest impulses (8,) [N s] in the directions of `LargestPush`, for a course that searches for it."""
    motions, search = _Motions.of(robot, course), course.largest_push
    assert search is not None
    steps = [search.duration / _PUSHED] * _PUSHED + [_REST_TIME / _RESTING] * _RESTING
    pushes = [search.push(1.0, seed) for seed in range(DIRECTIONS)]
    return np.array(
        [motions.solve(steps, np.zeros(10), push=_after(motions.model, push), sign=-1.0) for push in pushes]
    )


def bounds_of(course: Course, robot: Robot, *, seeds: Sequence[int] = range(DIRECTIONS)) -> dict[str, float]:
    """Return the bounds of a course's own metrics, by their keys in SI units: those that have one.

    Parameters
    ----------
    course : Course
    robot : Robot
        With its friction.
    seeds : sequence of int, optional
        Each has a direction of the largest push, whose mean is returned; all directions if not given.

    Examples
    --------
    >>> from ballbot import Robot
    >>> from ballbot.workflows.courses import choose_courses
    >>> robot = Robot.load("alten")
    >>> (course,) = choose_courses("faster", robot, "model")
    >>> {key: round(value, 2) for key, value in bounds_of(course, robot).items()}
    {'top_speed': 3.1}
    """
    found = dict[str, float]()
    if "largest_impulse" in course.metrics:
        found["largest_impulse"] = float(push_bounds(robot, course)[np.array(seeds) % DIRECTIONS].mean())
    reference, rules = course.reference_spec.reference(), course.rules

    def velocity(before: float) -> Floats:
        places = [reference(before - later * _LOOK)[:2] for later in (1, 2)]
        return (places[0] - places[1]) / _LOOK

    if "top_speed" in course.metrics:
        found["top_speed"] = min(top_speed(robot), float(np.hypot(*velocity(course.duration))))
    if not {"stopping_time", "settling_time"} & {*course.metrics} or course.scenario.changes():
        return found
    motions, start = _Motions.of(robot, course), np.zeros(10)
    if rules.stop is not None:
        start[5:7] = velocity(rules.stop)
        found["stopping_time"] = motions.least_time(start, [5, 6], REST)
        along = np.zeros((1, 10))
        along[0, :2] = start[5:7] / np.hypot(*start[5:7])
        steps = [_REST_TIME / (2 * _RESTING)] * (2 * _RESTING)
        found["stopping_distance"] = motions.solve(steps, start, within=(along, np.array([-1.0]), 0.0))
    if "settling_time" in course.metrics:
        t = np.arange(0.0, course.duration, _LOOK)
        places = np.array([reference(at)[:2] for at in t])
        jumps = np.unique(np.diff(places, axis=0).round(3), axis=0)
        jumps = jumps[np.hypot(*jumps.T) > rules.band]
        times = [motions.least_time(np.append(jump, np.zeros(8)), [0, 1], rules.band) for jump in jumps]
        for push in course.scenario.pushes:
            after = _after(motions.model, push)
            times.append(motions.least_time(start, [0, 1], rules.band, push=after, lasts=push.duration))
        found["settling_time"] = max(times, default=np.nan)
    return {key: value for key, value in found.items() if np.isfinite(value)}


def _after(model: Model, push: Push) -> Floats:
    """Return the state (10,) after a push of a robot at rest, as if it were over at once."""
    x, y, _ = push.force
    impulse = push.duration * np.hypot(x, y)
    return pushed_state(model, np.arctan2(y, x), impulse, push.height)
