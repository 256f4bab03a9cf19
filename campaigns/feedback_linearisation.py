"""Feedback linearisation of lean and heading around designed controllers: what it changes on the benchmark's courses.

.venv/bin/python -m campaigns.evidence feedback_linearisation

The thesis leaves it open whether nonlinear control pays at high speed. With M(q) q'' + h(q, q') = W(q)^T u,

    lean and heading accelerate by     f(x) + D(x) u,    D = (M^-1 W^T), rows of theta, phi, psi
    a controller is designed for       (M_0^-1 (k q + W_0^T u)), the same upright at rest, in the robot's heading
    so a torque u of it becomes        D^-1 ((M_0^-1 (k q + W_0^T u)) - f(x))

which is input-output linearisation: three outputs, three wheels, relative degree two. The ball's motion is the zero
dynamics that the controller stabilises. Upright nothing changes, so gain, parts, estimator and torque limit are the
controller's own, and any difference is the linearisation's. Results are kept in build/feedback_linearisation.
"""

from dataclasses import replace

import numpy as np

from ballbot.arrays import Floats
from ballbot.control.controller import Controller
from ballbot.control.lqr import frictionless_model
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.fitting.run import Processes
from ballbot.robot import Robot
from ballbot.twin.scenario import Scenario
from ballbot.workflows.courses import choose_courses
from ballbot.workflows.league import run_league, standing
from ballbot.workflows.metrics import METRIC_BY_KEY, values_of
from ballbot.workflows.statistics import Estimate, mean_with_interval
from campaigns.section import Section, finished

PRESET, SEEDS = "alten", 10
BASES = {"nominal": nominal_controller, "precise": precise_controller}
COURSES = ("largest_push", "stop", "velocity_steps", "benchmark_square")
_PUSHED_RUN = 6.5  # [s]
_SMALL = 1e-4  # part of a lean over which gravity is linear
_PACKAGES = ("mechanics", "simulation", "control", "estimation", "robot", "twin", "workflows")


class Linearised:
    """A controller whose torques act on lean and heading as on the linear model that it is designed for."""

    def __init__(self, base: Controller) -> None:
        self.base, self.sample_time, self.estimator = base, base.sample_time, base.estimator
        self._model = frictionless_model(base.robot)

    def reset(self) -> None:
        """A run starts."""
        self.base.reset()

    def update(self, t: float, state: Floats, reference: Floats) -> Floats:
        """Return the torques (3,) [N m]."""
        u = self.base.update(t, state, reference)
        n, turned = len(u), state[:5] * [1.0, 1.0, 0.0, 0.0, 1.0]
        # as it is, without torque and with that of each wheel; upright with u; and hardly leaning
        q = np.vstack([np.tile(state[:5], (1 + n, 1)), [turned, turned + _SMALL * (state[:5] - turned)]])
        q_dot = np.vstack([np.tile(state[5:], (1 + n, 1)), np.zeros((2, 5))])
        found = self._model.acceleration(q, q_dot, np.vstack([np.zeros(n), np.eye(n), u, np.zeros(n)]))[:, 2:]
        free, by_torque = found[0], (found[1 : 1 + n] - found[0]).T
        asked = found[-2] + found[-1] / _SMALL
        limit = self.base.torque_limit
        return np.clip(np.linalg.solve(by_torque, asked - free), -limit, limit)


def rows_of(course: str) -> list[list[str]]:
    """Return a row for each number of a course: each controller without and with linearisation, and the difference."""
    robot = Robot.load(PRESET)
    robot = robot.replace(friction=Scenario.nominal(robot).friction)
    controllers = {}
    for name, make in BASES.items():
        controllers |= {name: make(robot), f"{name}, linearised": Linearised(make(robot))}
    (chosen,) = choose_courses(course, robot, "model")
    if chosen.largest_push is not None:  # sooner, for a controller in Python
        sooner = chosen.largest_push.model_copy(update={"time": 1.0})
        chosen = replace(chosen, duration=_PUSHED_RUN, largest_push=sooner)
    league = run_league(robot, controllers, [chosen], seeds=range(1, 1 + SEEDS), workers=Processes(count=1))
    rows = []
    for key in league.courses[0].metrics:
        metric, row = METRIC_BY_KEY[key], []
        for name in BASES:
            one, other = (values_of(league.scores[course, of], key) for of in (name, f"{name}, linearised"))
            numbers = (mean_with_interval(one), mean_with_interval(other), mean_with_interval(other - one))
            row += [_shown(number, metric.scale) for number in numbers]
        rows.append([f"{course.replace('_', ' ')}: {metric.heading} [{metric.unit}]", *row])
    if not league.courses[0].until_fall:
        falls = [standing(league, course, name).falls for name in controllers]
        cells = [f"{falls[0]}", f"{falls[1]}", "", f"{falls[2]}", f"{falls[3]}", ""]
        rows.append([f"{course.replace('_', ' ')}: falls of {SEEDS}", *cells])
    return rows


def _shown(estimate: Estimate, scale: float) -> str:
    mean, low, high = (f"{scale * value:.3g}" for value in (estimate.mean, estimate.low, estimate.high))
    return f"{mean} ({low} to {high})"


def campaign() -> Section:
    """Run the missing courses and return the section of docs/generated/evidence.md."""
    done = finished(
        "feedback_linearisation",
        rows_of,
        {course: course for course in COURSES},
        packages=_PACKAGES,
        workers=Processes(count=1),
    )
    return Section(
        title="Feedback linearisation",
        before=f"`{PRESET}` with the nominal scenario's friction on the loop, {SEEDS} seeds: the nominal and the "
        "precise controller as they are, and with torques that act on lean and heading as on the linear model, "
        "whatever lean, speed and heading are: input-output linearisation by the exact equations (`campaigns/"
        "feedback_linearisation.py`). Gain, parts, estimator and torque limit are the same, and upright so are the "
        "torques. Means with 95 % intervals; the difference is seed by seed.",
        columns=["course", *(column for name in BASES for column in (name, "linearised", "difference"))],
        rows=[row for course in COURSES for row in done[course]],
    )
