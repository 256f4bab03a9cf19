"""Design an informative excitation for a robot, beside the square one would drive without it, and run both.

The excitation must stand above the deviations of states from their prediction over a window, friction known: those of
the compiled loop around the square. There both are run with the sensors of a scenario, with its friction, less and more
of it: do the limits hold?
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.references import Reference, square
from ballbot.errors import InputError
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.identification import Bounds
from ballbot.identification.parameters import scale_between
from ballbot.identification.prediction import Predictor
from ballbot.identification.windows import cut_windows
from ballbot.log import Log
from ballbot.progress import Progress, in_stage
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.robot.components import scaled_friction
from ballbot.twin.scenario import Scenario
from ballbot.workflows.comparison import ComparedRun, LoopRobot, run_comparison
from ballbot.workflows.excitation_design import DesignEffort, ExcitationDesign, design
from ballbot.workflows.excitation_task import (
    FRICTIONS,
    WINDOW,
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


def deviations_in(log: Log, robot: Robot) -> NDArray[np.float64]:
    """Return the deviation of each state's prediction (10,) over the windows of a log.

    What a perfect identification would be left with: sensors, play and torque noise together.

    Parameters
    ----------
    log : Log
    robot : Robot
        With the friction that is true of the log.

    Raises
    ------
    InputError
        If the log has no window, as when the robot fell at once.
    """
    coordinates = scale_between(robot)
    windows = cut_windows([log], wheel_count=robot.wheel_count, duration=WINDOW)
    if not len(windows):
        raise InputError(f"The run is shorter than one window of {WINDOW:g} s; make it longer.")
    predictor = Predictor(robot=robot, formulation="exact", step=1e-3, layout=coordinates.layout)
    residuals = predictor.residuals(coordinates.nominal[None], windows, every=windows.comparison_interval)
    return np.sqrt((residuals**2).mean(axis=(0, 1, 2)))


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopRuns:
    """Runs of a reference on the loop: each friction (factors) with each seed."""

    log: Log  #: of the first run, with its truth
    peaks: RunPeaks  #: the worst of all runs: true lean and place, torques as commanded
    ended: str | None  #: why a run ended early


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
) -> LoopRuns:
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
    return LoopRuns(log=log, peaks=RunPeaks(lean=peaks[0], floor=peaks[1], torque=peaks[2]), ended=ended)


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
    """A designed experiment with its expected errors and its runs on the loop."""

    task: ExcitationTask
    design: ExcitationDesign
    square: PlainSquare
    on_loop: Mapping[str, LoopRuns]  #: "square" and "designed"

    @property
    def limits_held(self) -> bool:
        """Whether all runs on the loop kept within the limits along the design."""
        runs = self.on_loop["designed"]
        return runs.ended is None and not self.task.limits.exceeded(runs.peaks)

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
            "on_loop": {
                name: {
                    "ended": one.ended,
                    "peaks": one.peaks,
                    "exceeded": self.task.limits.exceeded(one.peaks),
                }
                for name, one in self.on_loop.items()
            },
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


@dataclass(frozen=True, kw_only=True, eq=False)
class ExcitationOptions:
    """How an experiment is designed."""

    law: Law = "stribeck"  #: identification's
    bounds: Bounds | None = None  #: identification's
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
    """Design an experiment, compare it with a square of the same length, and run both on the loop with sensors.

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
        Its seed is that of the design.

    Raises
    ------
    InputError
        If no reference keeps within the limits, none within them identifies every parameter, or a run cannot be made.
    """
    robot, options = as_robot(robot), options or ExcitationOptions()
    plain = square(side=min(_SIDE, limits.floor / math.sqrt(2.0)), period=min(_PERIOD, duration))

    def follow(reference: Reference) -> LoopRuns:
        return _on_loop(robot, scenario, controller, reference, duration=duration, run=run)

    along_square = follow(plain)
    true = robot.replace(friction=scenario.friction)
    asked = task(
        robot,
        controller,
        limits=limits,
        duration=duration,
        deviations=deviations_in(along_square.log.without_truth(), true),
        law=options.law,
        bounds=options.bounds,
    )

    def of_design(now: Progress) -> None:
        note = f"errors about {100.0 * now.cost:.1f} %" if np.isfinite(now.cost) else ""
        run.progress(replace(now, note=note))

    made = design(asked, effort=options.effort, run=replace(run, progress=of_design))
    driven = run_on_model(asked, plain)
    return Excitation(
        task=asked,
        design=made,
        square=PlainSquare(run=driven, errors=expected_errors(asked.question, [driven.log])),
        on_loop={"square": along_square, "designed": follow(made.reference)},
    )


def _by_label(labels: Sequence[str], values: NDArray[np.float64]) -> dict[str, float]:
    return dict(zip(labels, values.tolist(), strict=True))
