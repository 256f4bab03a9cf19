"""An experiment tried on the twin before the robot: do its limits hold, and what does its log tell?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.references import Reference
from ballbot.experiments.excite.limits import Peaks, peaks_of
from ballbot.experiments.excite.task import Law
from ballbot.fitting.checkpoint import Memoize, no_checkpoint
from ballbot.identification import Bounds, Identification, identify
from ballbot.identification.identify import estimated_parameters
from ballbot.identification.parameters import Coordinates
from ballbot.log import Log
from ballbot.log.checked import CheckedLogs
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import Twin


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """A run of the twin and what its log told."""

    log: Log  #: with its truth
    peaks: Peaks  #: true lean and place, torques as commanded
    errors: NDArray[
        np.float64
    ]  #: (f,), standard errors of the parameters sought, scaled; NaN where there is none
    found: Identification


def follow_on_twin(
    robot: Robot,
    scenario: Scenario,
    controller: Controller,
    reference: Reference,
    *,
    duration: float,
    seed: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Log:
    """Run the twin along a reference and return its log, with what was true.

    Raises
    ------
    InputError
        Where it cannot be run, or falls at once.
    """
    return simulate(
        Twin(robot, scenario), controller, reference, duration=duration, seed=seed, progress=progress
    )


def try_reference(
    robot: Robot,
    log: Log,
    *,
    law: Law = "stribeck",
    bounds: Bounds | None = None,
    window: float = 0.25,
    seed: int = 0,
    recall: Memoize = no_checkpoint,
    progress: Callable[[float], None] | None = None,
) -> Trial:
    """Identify from a log of the twin, as from a robot's, and return what it told.

    Parameters
    ----------
    robot : Robot
        As it is believed to be; its friction is not used.
    log : Log
        From `follow_on_twin`.
    law, bounds, window
        Identification's.
    seed : int
        Of identification.
    recall : Recall, optional
        A checkpoint's.
    progress : callable, optional
        Told the share of the identification that is done.

    Raises
    ------
    InputError
        Where the log cannot be identified from, as when the robot fell early.
    """
    asked = bounds or Bounds()
    found = identify(
        robot,
        CheckedLogs.simulated(log.without_truth()),
        law=law,
        bounds=asked,
        window=window,
        seed=seed,
        recall=recall,
        progress=(lambda told: progress(told.share)) if progress else None,
    )
    coordinates = estimated_parameters(robot, free=("friction",), law=law, bounds=asked)
    return Trial(
        log=log,
        peaks=peaks_of(log.truth().states, log.torques),
        errors=_scaled_errors(coordinates, found)[coordinates.free],
        found=found,
    )


def _scaled_errors(coordinates: Coordinates, found: Identification) -> NDArray[np.float64]:
    """Return the standard errors (p,) in shares of the width of each parameter's bounds."""
    errors = np.concatenate([np.atleast_1d(one) for one in found.standard_errors.values()])
    with np.errstate(divide="ignore", invalid="ignore"):
        return errors / coordinates.slopes(coordinates.scaled(found.values))
