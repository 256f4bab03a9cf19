"""What a policy sees, what it is asked for and what it is paid: the four tasks.

Observation, of the estimated state x and the reference r in the heading frame, scaled:

    position error, clipped; lean and heading error; error of the velocity and of the rates; the last torques asked for

The reward of a sample of h seconds is h / (1 + cost), of the true state: at most 1 a second, and a robot that balances
longer earns more. cost is a weighted sum of squares of the errors and of the change of the torques (`Weights`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, suggest
from ballbot.mechanics.engine.compiled import compiled
from ballbot.robot.checks import check_parameters
from ballbot.robot.parameters import parameter, parameter_class

#: samples of torques in an observation
HISTORY = 3
#: entries of an observation before the torques
ERRORS = 10
#: size that counts as 1: of position [m], lean, heading [rad], velocity [m/s], lean rate and turning rate [rad/s]
SCALES = np.array([0.25, 0.25, 0.1, 0.1, 0.5, 0.5, 0.5, 0.5, 0.5, 1.0])
#: at most so much of each scaled entry is shown
MOST = 4.0
#: beyond which a place's distance costs no more [m]
FARTHEST = 0.5
#: position errors are shown up to two scales: farther away only the direction matters
MOST_POSITION = 2.0


def observation_size(wheels: int) -> int:
    """Return the length of an observation of a robot with so many wheels."""
    return ERRORS + HISTORY * wheels


@parameter_class
class Weights:
    """Weights of the cost, each of a squared quantity: 1 makes that quantity's scale cost 1."""

    position: float = parameter("per square of 0.05 m", least=0.0, default=0.1)
    velocity: float = parameter("per square of 0.1 m/s", least=0.0, default=0.1)
    heading: float = parameter("per square of 0.1 rad", least=0.0, default=0.1)
    lean_rate: float = parameter("per square of 0.1 rad/s", least=0.0, default=0.02)
    turning: float = parameter("per square of 0.2 rad/s", least=0.0, default=0.05)
    torque_change: float = parameter("per square of a tenth of the torque limit", least=0.0, default=0.01)

    def __post_init__(self) -> None:
        check_parameters(self)

    def per_si(self) -> NDArray[np.float64]:
        """Return the weights (6,) per squared SI unit, the torques' change in parts of the limit."""
        sizes = np.array([0.05, 0.1, 0.1, 0.1, 0.2, 0.1])
        names = ("position", "velocity", "heading", "lean_rate", "turning", "torque_change")
        return np.array([getattr(self, name) for name in names]) / sizes**2


@parameter_class
class Task:
    """A task: what a robot starts with, what it is asked for, and how long it goes on."""

    name: str = parameter("name of the task")
    duration: float = parameter("of an episode", "s", default=10.0)
    lean: float = parameter("largest at the start, about each axis", "rad", default=0.05, least=0.0)
    speed: float = parameter("largest at the start, along each axis", "m/s", default=0.2, least=0.0)
    offset: float = parameter("largest from the reference at the start, along each axis", "m", default=0.1, least=0.0)
    turn: float = parameter("largest from the reference's heading at the start", "rad", default=0.2, least=0.0)
    fallen: float = parameter("lean at which an episode terminates", "rad", default=0.35, most=0.6)
    reach: float = parameter("largest change of the place asked for, along each axis", "m", default=0.0, least=0.0)
    reach_heading: float = parameter("largest change of the heading asked for", "rad", default=0.0, least=0.0)
    drive: float = parameter("largest velocity asked for, along each axis", "m/s", default=0.0, least=0.0)
    interval: float = parameter("longest time until something else is asked for", "s", default=3.0)
    impulse: float = parameter("largest push, at most one every interval", "N s", default=0.0, least=0.0)
    weights: Weights = field(default_factory=Weights)

    def __post_init__(self) -> None:
        check_parameters(self)


TASKS = MappingProxyType(
    {
        task.name: task
        for task in (
            Task(name="Balance"),
            Task(name="Track", reach=0.5, reach_heading=0.8),
            Task(
                name="Drive",
                drive=0.5,
                interval=6.0,
                # a place that was left behind while the robot speeds up does not matter much
                weights=Weights(position=0.002, lean_rate=0.002, torque_change=0.003),
            ),
            Task(name="Push", impulse=8.0),
        )
    }
)


def task_named(name: str) -> Task:
    """Return the task of that name, however it is capitalised; InputError if there is none."""
    if name.capitalize() not in TASKS:
        raise InputError(f"There is no task {name!r}; {suggest(name, TASKS, otherwise='the tasks are')}")
    return TASKS[name.capitalize()]


@compiled
def observe(begin, end, states, references, history, limit, scales, out):
    """Fill the observations (robots, size) of robots begin .. end - 1, of what their estimators show.

    references (robots, 10) have the velocity asked for; history (robots, HISTORY, n) the last torques, newest first.
    """
    for robot in range(begin, end):
        x, r, o = states[robot], references[robot], out[robot]
        c, s = np.cos(x[4]), np.sin(x[4])
        for i in (0, 2, 5, 7):
            a, b = r[i] - x[i], r[i + 1] - x[i + 1]
            o[i], o[i + 1] = (c * a + s * b) / scales[i], (c * b - s * a) / scales[i]
        o[4], o[9] = (r[4] - x[4]) / scales[4], (r[9] - x[9]) / scales[9]
        for i in range(10):
            most = 2.0 if i < 2 else 4.0
            o[i] = min(max(o[i], -most), most)
        k = 10
        for past in range(history.shape[1]):
            for i in range(history.shape[2]):
                o[k] = history[robot, past, i] / limit
                k += 1


@compiled
def pay(begin, end, running, truths, references, torques, last, limit, weights, h, out):
    """Add the rewards of those of robots begin .. end - 1 that are running, for a sample of h seconds.

    It ends in the true states.
    """
    for robot in range(begin, end):
        if running[robot] == 0:
            continue
        x, r = truths[robot], references[robot]
        # beyond what is shown a place is no farther away, so that a velocity still matters there
        cost = weights[0] * min((r[0] - x[0]) ** 2 + (r[1] - x[1]) ** 2, FARTHEST**2)
        cost += weights[1] * ((r[5] - x[5]) ** 2 + (r[6] - x[6]) ** 2)
        cost += weights[2] * (r[4] - x[4]) ** 2
        cost += weights[3] * (x[7] ** 2 + x[8] ** 2) + weights[4] * x[9] ** 2
        for i in range(torques.shape[1]):
            cost += weights[5] * ((torques[robot, i] - last[robot, i]) / limit) ** 2
        out[robot] += 0.3 * h + 0.7 * h / (1.0 + cost)
