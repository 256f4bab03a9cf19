"""Torques of a robot that is held: a sweep of its free wheels, and torques that stir the ball upside down.

The firmware's safety layer stays on, with two differences while the robot is held (`held_parameters`): the lean is not
limited, because the robot may lie on its side or upside down, and the estimator is the on-board state, which any
attitude suits. The command restores the robot's own parameters at the end. If it is killed before that, the robot keeps
these until it is switched off, and `check_balancing_parameters` refuses to balance with them.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.firmware.records import ESTIMATORS
from ballbot.link.live import LiveRobot, TorqueProgram
from ballbot.log import Log
from ballbot.log.columns import STATE_NAMES
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.simulation.held_robot import multisine_at, sweep_at

#: larger than any attitude [rad]
_ANY_LEAN = 10.0


def sweep_of(
    robot: LiveRobot,
    torque: float,  # the largest [N m]
) -> TorqueProgram:
    """Return the sweep of a robot's wheels.

    InputError if it is not above zero, or beyond the robot's torque limit.
    """
    if not 0.0 < torque <= robot.torque_limit:
        raise InputError(
            f"The sweep's torque is {torque:g} N m; it must be above zero and at most the robot's torque limit, "
            f"{robot.torque_limit:g} N m."
        )
    count = robot.wheel_count
    return TorqueProgram(lambda t: torque * sweep_at(np.array([t]), count)[0], sample_time=robot.sample_time)


def stir(robot: LiveRobot, seed: int) -> TorqueProgram:
    """Return torques that stir the ball on a robot upside down; the seed gives their phases."""

    def torques(t: float) -> NDArray[np.float64]:
        return multisine_at(np.array([t]), robot.wheel_count, seed=seed)[0]

    return TorqueProgram(torques, sample_time=robot.sample_time)


@contextmanager
def held_parameters(robot: LiveRobot) -> Iterator[None]:
    """Lift the lean limit and select the on-board state while the block runs, then restore the robot's parameters."""
    original = robot.parameters
    changed = original.copy()
    changed["safety"]["lean"] = _ANY_LEAN
    changed["estimator"] = ESTIMATORS["onboard"]
    robot.use_parameters(changed)
    try:
        yield
    finally:
        if robot.session.connected:
            robot.use_parameters(original)


def check_balancing_parameters(parameters: NDArray[np.void]) -> None:
    """Raise InputError if parameters (1,) have no limit of the lean, as those of a held robot."""
    lean = float(parameters["safety"]["lean"][0])
    if lean > LARGEST_LEAN:
        raise InputError(
            f"The robot's limit of the lean is {lean:g} rad, as while it is held for a sweep. Switch the robot off and "
            "on, or send a controller with --controller and --robot."
        )


def bench_log(log: Log) -> Log:
    """Return the log of a held robot: without the state and the reference of a balancing one."""
    dropped = {*STATE_NAMES, "ref_x", "ref_y", "ref_psi"}
    return Log({name: values for name, values in log.columns.items() if name not in dropped}, log.ended)
