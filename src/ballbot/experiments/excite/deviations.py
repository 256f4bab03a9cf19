"""How far states are from their prediction over a window, friction known: what an experiment must stand above."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.parameters import scale_between
from ballbot.identification.prediction import Predictor
from ballbot.identification.windows import cut_windows
from ballbot.inputs import read_json
from ballbot.log import STATE_NAMES, Log
from ballbot.robot import Robot


def deviations_in(log: Log, robot: Robot, *, window: float) -> NDArray[np.float64]:
    """Return the deviation of each state's prediction (10,) over the windows of a log.

    What a perfect identification would be left with: sensors, rollers, play and torque noise together.

    Parameters
    ----------
    log : Log
    robot : Robot
        With the friction that is true of the log.
    window : float
        [s]

    Raises
    ------
    InputError
        Where the log has no window, as when the robot fell at once.
    """
    coordinates = scale_between(robot)
    windows = cut_windows([log], wheel_count=robot.wheel_count, duration=window)
    if not len(windows):
        raise InputError(f"The run is shorter than one window of {window:g} s; make it longer.")
    predictor = Predictor(robot=robot, formulation="exact", step=1e-3, layout=coordinates.layout)
    residuals = predictor.residuals(coordinates.before[None], windows, every=windows.comparison_interval)
    return np.sqrt((residuals**2).mean(axis=(0, 1, 2)))


def deviations_found(path: str | Path) -> NDArray[np.float64]:
    """Return the deviations (10,) that an identification's results.json has: those on windows held out.

    Raises
    ------
    InputError
        Where the file cannot be read or is not such a file.
    """
    results = cast("dict[str, dict]", read_json(path))
    try:
        errors = results["held_out"]["rmse_with_friction"]
        values = np.array([errors[name] for name in STATE_NAMES], dtype=np.float64)
    except (ValueError, KeyError, TypeError):
        raise InputError(
            f"{path} is not a results.json of `ballbot identify`. Give that file with --found."
        ) from None
    if not np.all(np.isfinite(values) & (values > 0.0)):
        raise InputError(f"{path} has no held-out errors for some states; identify from more logs.")
    return values
