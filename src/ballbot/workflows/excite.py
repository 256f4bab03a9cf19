"""Design an informative excitation for a robot, beside the square one would drive without it, and try both.

The excitation must stand above the deviations of states from their prediction over a window, friction known. Before
the robot, the experiment is tried on the twin: do its limits hold, and what does identification find in its log?
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.references import Reference, square
from ballbot.errors import InputError
from ballbot.file_formats import read_results
from ballbot.findings import finding_results
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.identification import Bounds, Identification, identify
from ballbot.identification.identify import estimated_parameters
from ballbot.identification.parameters import Coordinates, scale_between
from ballbot.identification.prediction import Predictor
from ballbot.identification.windows import cut_windows
from ballbot.log import STATE_NAMES, Log
from ballbot.log.checks import CheckedLogs
from ballbot.progress import Progress, ProgressCallback, ignore_progress, in_stage
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.simulation.run import simulate
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import Twin
from ballbot.workflows.excitation_design import DesignEffort, ExcitationDesign, design
from ballbot.workflows.excitation_task import (
    ExcitationTask,
    Law,
    ReferenceRun,
    RunLimits,
    RunPeaks,
    expected_errors,
    peaks_of,
    run_on_model,
    task,
)


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
        If the log has no window, as when the robot fell at once.
    """
    coordinates = scale_between(robot)
    windows = cut_windows([log], wheel_count=robot.wheel_count, duration=window)
    if not len(windows):
        raise InputError(f"The run is shorter than one window of {window:g} s; make it longer.")
    predictor = Predictor(robot=robot, formulation="exact", step=1e-3, layout=coordinates.layout)
    residuals = predictor.residuals(coordinates.nominal[None], windows, every=windows.comparison_interval)
    return np.sqrt((residuals**2).mean(axis=(0, 1, 2)))


def deviations_found(path: str | Path) -> NDArray[np.float64]:
    """Return the deviations (10,) that an identification's results.json has: those on windows held out.

    Raises
    ------
    InputError
        If the file cannot be read or is not such a file.
    """
    results = cast("dict[str, dict]", read_results(path))
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """A run of the twin and the identification from its log."""

    log: Log  #: with its truth
    peaks: RunPeaks  #: true lean and place, torques as commanded
    #: (f,), scaled standard errors of the estimated parameters; NaN if undetermined
    errors: NDArray[np.float64]
    found: Identification


def follow_on_twin(
    robot: Robot,
    scenario: Scenario,
    controller: Controller,
    reference: Reference,
    *,
    duration: float,
    seed: int = 1,
    progress: ProgressCallback = ignore_progress,
) -> Log:
    """Run the twin along a reference and return its log, with what was true.

    Raises
    ------
    InputError
        If it cannot be run, or falls at once.
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
    run: Run = DEFAULT_RUN,
) -> Trial:
    """Identify from a log of the twin, as from a robot's.

    Parameters
    ----------
    robot : Robot
        As it is believed to be; its friction is not used.
    log : Log
        From `follow_on_twin`.
    law, bounds, window
        Identification's.
    run : Run, optional
        Identification's.

    Raises
    ------
    InputError
        If the log cannot be identified from, as when the robot fell early.
    """
    asked = bounds or Bounds()
    found = identify(
        robot,
        CheckedLogs.simulated(log.without_truth()),
        law=law,
        bounds=asked,
        window=window,
        run=run,
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


#: the square that the design is compared with: its side [m], if the floor has room for it, and its period [s]
_SIDE, _PERIOD = 0.5, 32.0
#: the twin's seed
_SEED = 1


@dataclass(frozen=True, kw_only=True, eq=False)
class PlainSquare:
    """The square, on the model."""

    run: ReferenceRun
    errors: NDArray[np.float64]  #: (f,), expected, scaled; infinite without information


@dataclass(frozen=True, kw_only=True, eq=False)
class Excitation:
    """A designed experiment with its expected errors and its trials."""

    task: ExcitationTask
    design: ExcitationDesign
    square: PlainSquare
    trials: Mapping[str, Trial]  #: "square" and "designed" on the twin; empty where not tried

    @property
    def limits_held(self) -> bool | None:
        """Whether the twin kept within the limits along the design; None where not tried."""
        if not self.trials:
            return None
        trial = self.trials["designed"]
        return trial.log.ended is None and not self.task.limits.exceeded(trial.peaks)

    def results(self) -> dict[str, object]:
        """Return what results.json holds; SI units, and errors also in shares of the bounds' width ("scaled")."""
        question, made = self.task.question, self.design
        believed = question.coordinates.physical(question.point)[question.coordinates.free]
        return {
            "limits": self.task.limits,
            "duration": self.task.duration,
            "believed": _by_label(question.labels, believed),
            "deviations": question.deviations,
            "expected": {
                "square": self._expected(self.square.errors),
                "designed": self._expected(made.errors),
            },
            "peaks_on_model": {
                "square": self.square.run.peaks,
                "designed": made.peaks,
            },
            "on_twin": {name: self._tried(trial) for name, trial in self.trials.items()},
            "limits_held_on_twin": self.limits_held,
            "criterion_after_each_generation": made.history,
            "sines": {
                "axes": ["x", "y", "psi"],
                "frequencies": made.frequencies,
                "amplitudes": made.amplitudes,
                "phases": made.phases,
            },
        }

    def _expected(self, scaled: NDArray[np.float64]) -> dict[str, object]:
        question = self.task.question
        return {
            "standard_errors": _by_label(question.labels, question.in_units(scaled)),
            "scaled": _by_label(question.labels, scaled),
            "worst": scaled.max(),
        }

    def _tried(self, trial: Trial) -> dict[str, object]:
        return {
            "ended": trial.log.ended,
            "peaks": trial.peaks,
            "exceeded": self.task.limits.exceeded(trial.peaks),
            "scaled": _by_label(self.task.question.labels, trial.errors),
            "parameters": trial.found.to_dict()["parameters"],
            "standard_errors": trial.found.to_dict()["standard_errors"],
            "findings": finding_results(trial.found.findings),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class ExcitationOptions:
    """How an experiment is designed and tried."""

    #: (10,) see `task`; by default those of the twin around the square
    deviations: NDArray[np.float64] | None = None
    on_twin: bool = True  #: whether design and square are tried on the twin and identified from
    law: Law = "stribeck"  #: identification's
    bounds: Bounds | None = None  #: identification's
    window: float = 0.25  #: identification's [s]
    effort: DesignEffort | None = None  #: of the search


def excite(
    robot: RobotLike,
    controller: Controller,
    *,
    limits: RunLimits,
    duration: float,
    scenario: Scenario,
    options: ExcitationOptions | None = None,
    run: Run = DEFAULT_RUN,
) -> Excitation:
    """Design an experiment, compare it with a square of the same length, and try both on the twin.

    Parameters
    ----------
    robot : Robot, preset or robot file
        With the friction believed, or none.
    controller : Controller
    limits : RunLimits
    duration : float
        [s]
    scenario : Scenario
        Of the twin.
    options : ExcitationOptions, optional
    run : Run, optional
        Its seed is that of the design and of the identification.

    Raises
    ------
    InputError
        If no reference keeps within the limits, none within them identifies every parameter, or a run cannot be made.
    """
    robot, options = as_robot(robot), options or ExcitationOptions()
    law, bounds, window = options.law, options.bounds, options.window
    deviations, on_twin = options.deviations, options.on_twin
    plain = square(side=min(_SIDE, limits.floor / math.sqrt(2.0)), period=min(_PERIOD, duration))
    follow = partial(follow_on_twin, robot, scenario, controller, duration=duration, seed=_SEED)
    logs: dict[str, Log] = {}
    if on_twin or deviations is None:
        logs["square"] = follow(plain, progress=in_stage(run.progress, "square on the twin"))
    if deviations is None:
        true = robot.replace(friction=scenario.friction)
        deviations = deviations_in(logs["square"].without_truth(), true, window=window)
    asked = task(
        robot,
        controller,
        limits=limits,
        duration=duration,
        deviations=deviations,
        law=law,
        bounds=bounds,
        window=window,
    )

    def of_design(now: Progress) -> None:
        note = f"errors about {100.0 * now.cost:.1f} %" if np.isfinite(now.cost) else ""
        run.progress(replace(now, note=note))

    made = design(asked, effort=options.effort, run=replace(run, progress=of_design))
    if on_twin:
        logs["designed"] = follow(made.reference, progress=in_stage(run.progress, "design on the twin"))
    trials: dict[str, Trial] = {}
    for name, log in logs.items() if on_twin else ():
        trials[name] = try_reference(robot, log, law=law, bounds=bounds, window=window, run=run)
    driven = run_on_model(asked, plain)
    return Excitation(
        task=asked,
        design=made,
        square=PlainSquare(run=driven, errors=expected_errors(asked.question, [driven.log])),
        trials=trials,
    )


def _by_label(labels: Sequence[str], values: NDArray[np.float64]) -> dict[str, float]:
    return dict(zip(labels, values.tolist(), strict=True))
