"""Design an informative excitation for a robot, beside the square one would drive without it, and try both.

The excitation must stand above the deviations of states from their prediction over a window, friction known. Before
the robot, both are tried on the compiled loop with the sensors of a scenario, with its friction, less and more of it:
do the limits hold, and what does identification find in the log?
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
from ballbot.identification.parameters import scale_between
from ballbot.identification.prediction import Predictor
from ballbot.identification.windows import cut_windows
from ballbot.log import STATE_NAMES, Log
from ballbot.log.checks import CheckedLogs
from ballbot.progress import Progress, in_stage
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.robot.components import scaled_friction
from ballbot.twin.scenario import Scenario
from ballbot.workflows.comparison import ComparedRun, LoopRobot, run_comparison
from ballbot.workflows.excitation_design import DesignEffort, ExcitationDesign, design
from ballbot.workflows.excitation_task import (
    FRICTIONS,
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

    What a perfect identification would be left with: sensors, play and torque noise together.

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
    """Runs of a reference on the loop, and the identification from the first one's log."""

    log: Log  #: of the first run, with its truth
    peaks: RunPeaks  #: the worst of all runs: true lean and place, torques as commanded
    ended: str | None  #: why a run ended early
    #: (f,), scaled standard errors of the estimated parameters; NaN if undetermined
    errors: NDArray[np.float64]
    found: Identification


#: runs of each reference with each friction, by their seeds
_SEEDS = (1, 2, 3)


def _on_loop(
    robot: Robot,
    scenario: Scenario,
    controller: Controller,
    reference: Reference,
    *,
    duration: float,
    run: Run,
) -> tuple[Log, RunPeaks, str | None]:
    """Return the first log, the largest peaks and why a run ended, of each friction (factors) with each seed."""
    made = run_comparison(
        [
            ComparedRun(
                candidate=f"{factor:g}",
                controller=controller,
                plant=LoopRobot.of(
                    robot.replace(friction=scaled_friction(scenario.friction, factor)), scenario, known=robot
                ),
                reference=lambda: reference,
                duration=duration,
                seed=seed,
                settle=0.0,
                measure=_peaks,
                logged=(factor, seed) == (FRICTIONS[0], _SEEDS[0]),
            )
            for factor in FRICTIONS
            for seed in _SEEDS
        ],
        run=replace(run, progress=in_stage(run.progress, "runs with sensors")),
    ).results
    log = made[0].log
    assert log is not None
    peaks = np.max([one.measured for one in made], axis=0).tolist()
    ended = next((one.score.ended for one in made if one.score.ended), None)
    return log, RunPeaks(lean=peaks[0], floor=peaks[1], torque=peaks[2]), ended


def _peaks(log: Log) -> NDArray[np.float64]:
    peaks = peaks_of(log.truth().states, log.torques)
    return np.array([peaks.lean, peaks.floor, peaks.torque])


#: the square that the design is compared with: its side [m], if the floor has room for it, and its period [s]
_SIDE, _PERIOD = 0.5, 32.0


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
    trials: Mapping[str, Trial]  #: "square" and "designed" on the loop; empty where not tried

    @property
    def limits_held(self) -> bool | None:
        """Whether all runs on the loop kept within the limits along the design; None where not tried."""
        if not self.trials:
            return None
        trial = self.trials["designed"]
        return trial.ended is None and not self.task.limits.exceeded(trial.peaks)

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
            "on_loop": {name: self._tried(trial) for name, trial in self.trials.items()},
            "limits_held_on_loop": self.limits_held,
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
            "ended": trial.ended,
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

    #: (10,) see `task`; by default those of the loop around the square
    deviations: NDArray[np.float64] | None = None
    tried: bool = True  #: whether design and square are tried on the loop and identified from
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
    """Design an experiment, compare it with a square of the same length, and try both on the loop with sensors.

    Parameters
    ----------
    robot : Robot, preset or robot file
        With the friction believed, or none.
    controller : Controller
    limits : RunLimits
    duration : float
        [s]
    scenario : Scenario
        Of the loop, whose friction is the true one.
    options : ExcitationOptions, optional
    run : Run, optional
        Its seed is that of the design and of the identification.

    Raises
    ------
    InputError
        If no reference keeps within the limits, none within them identifies every parameter, or a run cannot be made.
    """
    robot, options = as_robot(robot), options or ExcitationOptions()
    law, bounds, window = options.law, options.bounds or Bounds(), options.window
    plain = square(side=min(_SIDE, limits.floor / math.sqrt(2.0)), period=min(_PERIOD, duration))

    def follow(reference: Reference) -> tuple[Log, RunPeaks, str | None]:
        return _on_loop(robot, scenario, controller, reference, duration=duration, run=run)

    deviations = options.deviations
    runs = {"square": follow(plain)} if options.tried or deviations is None else {}
    if deviations is None:
        true = robot.replace(friction=scenario.friction)
        deviations = deviations_in(runs["square"][0].without_truth(), true, window=window)
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
    coordinates = estimated_parameters(robot, free=("friction",), law=law, bounds=bounds)
    if options.tried:
        runs["designed"] = follow(made.reference)
    trials: dict[str, Trial] = {}
    for name, (log, peaks, ended) in runs.items() if options.tried else ():
        logs = CheckedLogs.simulated(log.without_truth())
        found = identify(robot, logs, law=law, bounds=bounds, window=window, run=run)
        errors = np.concatenate([np.atleast_1d(one) for one in found.standard_errors.values()])
        with np.errstate(divide="ignore", invalid="ignore"):
            scaled = errors / coordinates.slopes(coordinates.scaled(found.values))
        trials[name] = Trial(log=log, peaks=peaks, ended=ended, errors=scaled[coordinates.free], found=found)
    driven = run_on_model(asked, plain)
    return Excitation(
        task=asked,
        design=made,
        square=PlainSquare(run=driven, errors=expected_errors(asked.question, [driven.log])),
        trials=trials,
    )


def _by_label(labels: Sequence[str], values: NDArray[np.float64]) -> dict[str, float]:
    return dict(zip(labels, values.tolist(), strict=True))
