"""What a policy sees, what it is asked for and what it is paid: the four tasks.

An observation is that of `ballbot.control.parts.policy`, of the estimated state x and the reference r, over `SCALES`:

    S(psi) (r - x): position, lean and heading error, error of the velocity and of the rates; the last actions' torques

The reward of a sample of h seconds is, of the true state at its end and the torques asked for in it,

    h (a + (1 - a) / (1 + cost)),      cost = sum_i w_i e_i^2

at most h, so that an episode's return is at most its duration in seconds, and a robot that balances longer earns more.
The errors e_i and weights w_i are those of `Weights`, a is `Weights.upright`.
"""

from __future__ import annotations

from dataclasses import field
from itertools import product
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.control.parts.policy import ERRORS, SHOWN
from ballbot.control.parts.policy import SCALES as SIZES
from ballbot.errors import check_known
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.model import Model
from ballbot.mechanics.traction import pack_contacts
from ballbot.robot import Robot
from ballbot.robot.checks import check_parameters
from ballbot.robot.parameters import parameter, parameter_class
from ballbot.simulation.model_plant import friction_needed_along

#: size that counts as 1: of position [m], lean, heading [rad], velocity [m/s], lean rate and turning rate [rad/s]
SCALES = np.array(SIZES)
#: entries of an observation are limited to so many of these sizes
LIMITS = np.array(SHOWN)
#: what a weight's quantity is divided by: 0.05 m, 0.1 m/s, 0.1 rad, 0.1 rad/s, 0.2 rad/s, a tenth of the torque limit
_UNITS = {
    "position": 0.05,
    "velocity": 0.1,
    "heading": 0.1,
    "lean_rate": 0.1,
    "turning": 0.2,
    "torque_change": 0.1,
}
#: beyond which a place's distance costs no more [m]
FARTHEST = 0.5
#: how long a push lasts [s]
PUSH = 0.1


@parameter_class
class Weights:
    """Weights of the cost, each of a squared quantity, and the part of the reward that the cost does not lessen."""

    position: float = parameter(
        "of the distance from the reference, per square of 0.05 m", least=0.0, default=0.1
    )
    velocity: float = parameter("of the velocity's error, per square of 0.1 m/s", least=0.0, default=0.1)
    heading: float = parameter("of the heading's error, per square of 0.1 rad", least=0.0, default=0.1)
    lean_rate: float = parameter("of the lean's rate, per square of 0.1 rad/s", least=0.0, default=0.02)
    turning: float = parameter("of the heading's rate, per square of 0.2 rad/s", least=0.0, default=0.05)
    torque_change: float = parameter(
        "of each wheel's change of torque in a sample, per square of a tenth of the limit",
        least=0.0,
        default=0.01,
    )
    upright: float = parameter(
        "part of the reward that is paid for staying up", least=0.0, most=1.0, default=0.3
    )

    def __post_init__(self) -> None:
        check_parameters(self)

    def per_si(self) -> NDArray[np.float64]:
        """Return the weights (6,) per squared SI unit, of the torques' change in parts of the limit, and `upright`."""
        costs = [getattr(self, name) / unit**2 for name, unit in _UNITS.items()]
        return np.array([*costs, self.upright])


@parameter_class
class Task:
    """A task: what a robot starts with, what it is asked for, and how long it goes on."""

    name: str = parameter("name of the task")
    duration: float = parameter("of an episode", "s", default=10.0)
    lean: float = parameter("largest at the start, about each axis", "rad", default=0.05, least=0.0)
    speed: float = parameter("largest at the start, along each axis", "m/s", default=0.2, least=0.0)
    offset: float = parameter(
        "largest from the origin at the start, along each axis", "m", default=0.1, least=0.0
    )
    turn: float = parameter("largest heading at the start", "rad", default=0.2, least=0.0)
    fallen: float = parameter(
        "lean about either axis at which an episode terminates", "rad", default=0.35, most=0.6
    )
    reach: float = parameter(
        "largest change of the place asked for, along each axis", "m", default=0.0, least=0.0
    )
    reach_heading: float = parameter("largest change of the heading asked for", "rad", default=0.0, least=0.0)
    drive: float = parameter("largest velocity asked for, along each axis", "m/s", default=0.0, least=0.0)
    interval: float = parameter("longest time until something else is asked for", "s", default=3.0)
    impulse: float = parameter("largest push, at most one every interval", "N s", default=0.0, least=0.0)
    grip: float = parameter(
        "friction coefficient that a wheel of a robot at rest may need by an action, which limits torques (1e9: not)",
        default=0.75,
        most=1e9,
    )
    weights: Weights = field(default_factory=Weights)

    def __post_init__(self) -> None:
        check_parameters(self)


TASKS = MappingProxyType(
    {
        task.name: task
        for task in (
            Task(name="Balance"),
            Task(
                name="Track",
                reach=0.5,
                reach_heading=0.8,
                interval=6.0,
                weights=Weights(
                    position=0.02, velocity=0.01, heading=0.02, lean_rate=0.002, torque_change=0.003
                ),
            ),
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


def task_named(name: Task | str) -> Task:
    """Return the task itself, or the one of that name, in upper or lower case; InputError if there is no such task.

    >>> task_named("drive").drive
    0.5
    """
    if isinstance(name, Task):
        return name
    check_known(name.capitalize(), TASKS, f"There is no task {name!r}", otherwise="the tasks are")
    return TASKS[name.capitalize()]


def action_limit(task: Task, robot: Robot) -> float:
    """Return the largest torque of an action [N m], at most the drives' limit, in hundredths of it.

    Up to it no wheel of a robot at rest needs more friction than `task.grip`, whatever the others do: each wheel's
    torque presses some wheels on the ball and unloads others, and a wheel without load slips.

    >>> from ballbot.robot import as_robot
    >>> round(action_limit(TASKS["Drive"], as_robot("alten")), 3)
    1.5
    """
    model, limit = Model(robot), robot.drive.torque_limit
    signs = np.array(list(product((-1.0, 1.0), repeat=robot.wheel_count)))
    sizes = limit * np.linspace(0.01, 1.0, 100)
    torques = (sizes[:, None, None] * signs).reshape(-1, robot.wheel_count)
    states, needed = np.zeros((len(torques), 10)), np.empty(len(torques))
    friction_needed_along(model.selected, model.packed, pack_contacts(robot), states, torques, needed)
    too_large = needed.reshape(len(sizes), -1).max(axis=1) > task.grip
    return float(sizes[max(too_large.argmax() - 1, 0)]) if too_large.any() else limit


class TaskNumbers(NamedTuple):
    """A task as compiled code reads it: `Task`'s numbers, times in samples, and those of the robot that it needs."""

    samples: int  #: in an episode
    sample_time: float  #: [s]
    offset: float
    speed: float
    lean: float
    turn: float
    fallen: float
    reach: float
    reach_heading: float
    drive: float
    interval: float  #: in samples
    impulse: float
    push_samples: int  #: in a push
    push_height: float  #: above the ball's centre [m]
    torque_limit: float  #: of an action [N m]
    sensing: bool  #: whether sensors are read
    weights: NDArray[np.float64]  #: of `Weights.per_si`

    @staticmethod
    def of(task: Task, robot: Robot, *, torque_limit: float, sensing: bool) -> TaskNumbers:
        """Return a task's numbers for a robot, by `action_limit`; a push acts at its body's centre of mass."""
        h, weights = robot.sensors.sample_time, task.weights.per_si()
        weights[5] *= (torque_limit / robot.drive.torque_limit) ** 2  # of the drives' limit
        stated = {name: value for name, value in vars(task).items() if name in TaskNumbers._fields}
        own = {
            "samples": max(1, round(task.duration / h)),
            "sample_time": h,
            "interval": task.interval / h,
            "push_samples": max(1, round(PUSH / h)),
            "push_height": robot.body.center_of_mass,
            "torque_limit": torque_limit,
            "sensing": sensing,
            "weights": weights,
        }
        return TaskNumbers(**{**stated, **own})


@inlined
def observe(state, reference, history, torque_limit, out):
    """Fill an observation of a state (10,) and a reference (10,) with the velocity asked for.

    history (HISTORY, n) are the torques of the last actions, newest first.
    """
    c, s = np.cos(state[4]), np.sin(state[4])
    for i in range(10):
        error = reference[i] - state[i]
        if i in (0, 2, 5, 7):
            error = c * error + s * (reference[i + 1] - state[i + 1])
        elif i in (1, 3, 6, 8):
            error = c * error - s * (reference[i - 1] - state[i - 1])
        out[i] = min(max(error / SCALES[i], -LIMITS[i]), LIMITS[i])
    k = ERRORS
    for past in range(history.shape[0]):
        for i in range(history.shape[1]):
            out[k] = history[past, i] / torque_limit
            k += 1


@inlined
def reward(task, truth, reference, torques, last):
    """Return the reward of a sample that ends in a true state (10,), for torques (n,) after the `last` ones."""
    x, r, w = truth, reference, task.weights
    # beyond what is shown a place is no farther away, so that a velocity still matters there
    cost = w[0] * min((r[0] - x[0]) ** 2 + (r[1] - x[1]) ** 2, FARTHEST**2)
    cost += w[1] * ((r[5] - x[5]) ** 2 + (r[6] - x[6]) ** 2)
    cost += w[2] * (r[4] - x[4]) ** 2
    cost += w[3] * (x[7] ** 2 + x[8] ** 2) + w[4] * x[9] ** 2
    for i in range(len(torques)):
        cost += w[5] * ((torques[i] - last[i]) / task.torque_limit) ** 2
    return task.sample_time * (w[6] + (1.0 - w[6]) / (1.0 + cost))
