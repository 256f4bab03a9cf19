"""Whether logs move enough for friction to show in them: asked before anything is estimated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.windows import Windows
from ballbot.mechanics.model import Model
from ballbot.robot import Robot

#: a wheel turns in a window where its root mean square speed there is above this [rad/s]; encoder and gyro
#: noise of a robot at rest stay below
LEAST_SPEED = 0.1
#: the share of the windows in which a wheel must turn
LEAST_SHARE = 0.1
#: windows to fit, for each parameter sought; fewer make no standard error clustered by window
WINDOWS_PER_PARAMETER = 2


def check_count(windows: Windows, *, fitted: int, parameters: int) -> None:
    """Refuse too few windows.

    Raises
    ------
    InputError
        Where the windows to fit are fewer than `WINDOWS_PER_PARAMETER` times the parameters.
    """
    least = WINDOWS_PER_PARAMETER * parameters
    if fitted < least:
        length = windows.samples * windows.sample_time
        raise InputError(
            f"Of the logs' {len(windows)} windows of {length:g} s without gaps or missing values, {fitted} are to "
            f"fit {parameters} parameters, which takes {least}; log the robot balancing for longer."
        )


def check_excitation(windows: Windows, robot: Robot) -> tuple[str, ...]:
    """Refuse logs without motion; return a sentence for each wheel that alone hardly turns.

    Raises
    ------
    InputError
        Where no wheel turns in enough windows, or no torque is ever applied.
    """
    if not np.any(windows.torques):
        raise InputError(
            "The torques u are zero in every window of the logs; friction shows only while motors work."
        )
    turning = _turning(windows, robot)
    still = np.flatnonzero(turning.mean(axis=0) < LEAST_SHARE)
    if len(still) == robot.wheel_count:
        raise InputError(
            f"The robot stands still: in {turning.any(axis=1).sum()} of {len(windows)} windows a wheel turns faster "
            f"than {LEAST_SPEED:g} rad/s; log it while it moves about, as around a square."
        )
    return tuple(
        f"Wheel {i + 1} turns in {turning[:, i].sum()} of {len(windows)} windows only, so that b{i + 1}, c{i + 1} and "
        f"s{i + 1} rest on little; drive in another direction too."
        for i in still
    )


def _turning(windows: Windows, robot: Robot) -> NDArray[np.bool_]:
    """Return in which windows each wheel turns, (w, n), by the measured states."""
    speeds = Model(robot).wheel_speed(windows.measured[..., :5], windows.measured[..., 5:])
    return np.sqrt((speeds**2).mean(axis=1)) > LEAST_SPEED
