"""What no controller of a robot passes on a course: the largest push, the largest speed, the shortest stop.

Linear programs over the samples of a motion of the robot linearised upright, so to first order in the lean:

    x' = A x + B u + b s        u: torques of the wheels and rolling friction, s: the impulse of a push

within the motors' torque over speed, the wheels' grip on the ball with the load that lean and torques shift between
them, and the lean at which a run ends. What is not known counts for the controller: friction acts where it helps, the
robot has turned the best of eight sides to where it is pushed or goes, and knows of a push or of the end as it begins.
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
from ballbot.mechanics.traction import contact_forces
from ballbot.robot import Robot
from ballbot.robot.components import FALLING_PART
from ballbot.workflows.courses import DIRECTIONS, Course, LargestPush
from ballbot.workflows.limits import pushed_state
from ballbot.workflows.metrics import REST

#: steps of a push, of a stop, and of the time in which the robot comes to rest [s]: with twice as many, no bound of
#: `alten` changes by a per cent
_PUSHED, _STOPPING, _RESTING, _REST_TIME = 4, 40, 40, 4.0
#: the longest stop [s], and how often it is halved
_LONGEST, _HALVINGS = 16.0, 11
#: before a course's stop, in which its speed is found [s]
_BEFORE = 0.05
#: (8, 2) directions from which a robot may be pushed, or go
_SIDES = np.column_stack([f(2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS) for f in (np.cos, np.sin)])


def bounds_of(course: Course, robot: Robot) -> dict[str, float]:
    """Return the bounds of a course's own metrics, by their keys in SI units: of those that have one.

    Parameters
    ----------
    course : Course
    robot : Robot
        With its friction.

    Examples
    --------
    >>> from ballbot.workflows.courses import choose_courses
    >>> robot = Robot.load("alten")
    >>> (course,) = choose_courses("faster", robot, "model")
    >>> {key: round(value, 2) for key, value in bounds_of(course, robot).items()}
    {'top_speed': 2.84}
    """
    found, stop = dict[str, float](), course.rules.stop
    if "top_speed" in course.metrics:
        found["top_speed"] = _top_speed(robot)
    if course.largest_push is not None:
        found["largest_impulse"] = _largest_impulse(robot, course, course.largest_push)
    if stop is not None:
        reference = course.reference_spec.reference()
        later, sooner = (reference(stop - count * _BEFORE)[:2] for count in (1, 2))
        speed = float(np.hypot(*(later - sooner))) / _BEFORE
        motions = _Motions.of(robot, course)
        stops = np.array([motions.stop(speed * side, side) for side in _SIDES[: DIRECTIONS // 2]])
        if speed > REST and np.isfinite(stops).any():
            found["stopping_time"], found["stopping_distance"] = np.nanmin(stops, axis=0).tolist()
    return found


def _top_speed(robot: Robot) -> float:
    """Return the steady speed [m/s] at which a motor's torque is its friction."""
    turns = np.abs(frictionless_model(robot).wheel_jacobian(np.zeros(5))[:, :2] @ _SIDES.T)
    falling = FALLING_PART / robot.drive.torque_limit
    viscous = 1.0 / robot.drive.top_speed + falling * np.array(robot.friction.viscous)
    speeds = (1.0 - falling * np.array(robot.friction.coulomb)) / viscous
    return float((speeds[:, None] / np.maximum(turns, 1e-9)).min(axis=0).max())


def _largest_impulse(robot: Robot, course: Course, search: LargestPush) -> float:
    """Return the largest impulse [N s] of a course's push."""
    motions = _Motions.of(robot, course)
    steps = [search.duration / _PUSHED] * _PUSHED + [_REST_TIME / _RESTING] * _RESTING
    after = pushed_state(frictionless_model(robot), np.arctan2(*_SIDES.T[::-1]), 1.0, search.height)
    pushes = zip(after / search.duration, motions.by_push / search.duration, strict=True)
    return max(motions.extreme(steps, np.zeros(10), push=push, sign=-1.0) for push in pushes)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Motions:
    """What a robot can do on a course; z = (x, u)."""

    A: Floats  #: (10, z) of x'
    most: Floats  #: (z,) of |z|
    rows: Floats  #: (k, z) of the motors' speed, then as many of the wheels' grip
    limits: Floats  #: (k,)
    by_push: Floats  #: (8, k) change of the rows by a push [N] in each of `_SIDES`

    @staticmethod
    def of(robot: Robot, course: Course) -> _Motions:
        model, n = frictionless_model(robot), robot.wheel_count
        linear, origin, grip = model.linearize(), np.zeros(5), course.scenario.roller_grip
        rolling = np.vstack([np.zeros((5, 2)), np.linalg.inv(model.mass_matrix(origin))[:, :2]])
        breakaway, falling = np.array(robot.friction.breakaway), FALLING_PART / robot.drive.torque_limit
        curve, traction, pressing = np.zeros((3, n, 12 + n))
        curve[:, 5:10] = model.wheel_jacobian(origin) / robot.drive.top_speed
        curve[:, 10 : 10 + n] = falling * np.eye(n)
        forces = contact_forces(model, course.largest_push.height if course.largest_push else 0.0)
        by = [2, 3, *range(10, 10 + n)]
        traction[:, by], pressing[:, by] = forces.traction[:, :-2], forces.pressing[:, :-2]
        # a wheel that the push unloads, or lifts, counts as loaded
        pushes, loads = (
            _SIDES @ forces.traction[:, -2:].T,
            grip * np.abs(_SIDES @ forces.pressing[:, -2:].T),
        )
        most = np.full(12 + n, np.inf)
        most[2:4], most[-2:] = course.scenario.fallen_lean, robot.friction.rolling * robot.weight
        most[10:-2] = robot.drive.torque_limit + breakaway
        return _Motions(
            A=np.asarray(np.hstack([linear.A, linear.B, rolling]), np.float64),
            most=most,
            rows=np.vstack([curve, -curve, traction - grip * pressing, -traction - grip * pressing]),
            limits=np.concatenate([*[1.0 + falling * breakaway] * 2, *[grip * forces.load] * 2]),
            by_push=np.hstack([np.zeros((DIRECTIONS, 2 * n)), pushes - loads, -pushes - loads]),
        )

    def extreme(
        self,
        steps: Sequence[float],
        start: Floats,
        *,
        push: tuple[Floats, Floats] | None = None,
        sign: float = 1.0,
        within: tuple[Floats, float, float] | None = None,
        first: int = 0,
    ) -> float:
        """Return the least s, or with a sign of -1 the largest, with which the robot comes to rest; NaN if none.

        `push`: x' (10,) and the rows (k,) by s in the first steps. `within` (R, r, limit): R x - r s is at most the
        limit from the `first` sample on.
        """
        K, width, pushed = len(steps), len(self.most), _PUSHED if push else 0
        rate, by_push = push or (np.zeros(10), np.zeros(len(self.limits)))
        full = np.vstack([np.column_stack([self.A, rate]), np.zeros((width - 9, width + 1))])
        by_time = {h: expm(h * full)[:10] for h in set(steps)}
        moves = [by_time[h] for h in steps]
        change = sparse.block_diag([move[:, :-1] for move in moves])
        change.resize(10 * K, width * (K + 1))
        change -= sparse.kron(sparse.eye(K, K + 1, k=1), np.eye(10, width))
        by_s = np.concatenate([move[:, -1] * (k < pushed) for k, move in enumerate(moves)])
        R, r, limit = within or (np.zeros((0, 10)), 0.0, 0.0)
        counted = K + 1 - first
        late = sparse.eye(counted, K + 1, k=first)
        below = sparse.vstack(
            [sparse.kron(sparse.eye(K + 1), self.rows), sparse.kron(late, R @ np.eye(10, width))]
        )
        below_s = np.append(np.outer(np.arange(K + 1) < pushed, by_push), np.full(counted * len(R), -r))
        values = np.append(np.tile(self.limits, K + 1), np.full(counted * len(R), limit))
        high = np.tile(self.most, (K + 1, 1))
        low, rest = -high, [2, 3, *range(5, 10)]
        low[0, :10] = high[0, :10] = start
        low[-1, rest] = high[-1, rest] = 0.0
        found = linprog(
            np.append(np.zeros(high.size), sign),
            A_ub=sparse.hstack([below, below_s[:, None]]),
            b_ub=values,
            A_eq=sparse.hstack([change, by_s[:, None]]),
            b_eq=np.zeros(10 * K),
            bounds=[*zip(low.ravel(), high.ravel(), strict=True), (0.0, None)],
            method="highs-ipm",
        )
        return float(found.x[-1]) if found.status == 0 else np.nan

    def stop(self, velocity: Floats, ahead: Floats) -> tuple[float, float]:
        """Return the shortest time [s] after which the speed ahead (2,) stays below that of rest, and the way [m]."""
        start, steps = np.zeros(10), [0.5 * _REST_TIME / _RESTING] * (2 * _RESTING)
        start[5:7] = velocity
        way = self.extreme(steps, start, within=(ahead[None] @ np.eye(2, 10), 1.0, 0.0))
        low, high, best, rest = 0.0, _LONGEST, np.nan, [_REST_TIME / _RESTING] * _RESTING
        along = np.array([ahead, -ahead]) @ np.eye(2, 10, k=5)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            steps = [middle / _STOPPING] * _STOPPING + rest
            if np.isnan(self.extreme(steps, start, within=(along, 0.0, REST), first=_STOPPING)):
                low = middle
            else:
                high = best = middle
        return best, way
