"""`excite`: an experiment designed for a robot, beside the square that one would drive without it, and tried."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.references import square
from ballbot.experiments.excite.design import Design, Effort, design
from ballbot.experiments.excite.deviations import deviations_in
from ballbot.experiments.excite.information import expected_errors
from ballbot.experiments.excite.limits import Limits
from ballbot.experiments.excite.task import Law, Run, Task, run, task
from ballbot.experiments.excite.trial import Trial, follow_on_twin, try_reference
from ballbot.fitting.checkpoint import Memoize, no_checkpoint
from ballbot.fitting.run import check_seed
from ballbot.identification.parameters import Bounds
from ballbot.log import Log
from ballbot.robot import Robot
from ballbot.twin.scenario import Scenario

#: the square that the design is held against: its side [m], where the floor has room for it, and its period [s]
_SIDE, _PERIOD = 0.5, 32.0
#: the twin's seed
_SEED = 1

#: told the share that is done, what is being done, and a note
Tell = Callable[[float, str, str], None]
#: stages and their part of the work, by and large
_STAGES = (
    ("square on the twin", 0.06),
    ("design", 0.6),
    ("design on the twin", 0.06),
    ("identification", 0.28),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Plain:
    """The square, on the model."""

    run: Run
    errors: NDArray[np.float64]  #: (f,), expected, scaled; infinite where it says nothing


@dataclass(frozen=True, kw_only=True, eq=False)
class Excitation:
    """A designed experiment and what is expected and known of it."""

    task: Task
    design: Design
    square: Plain
    trials: Mapping[str, Trial]  #: "square" and "designed" on the twin; empty where not tried

    @property
    def limits_held(self) -> bool | None:
        """Whether the twin kept within the limits along the design; None where not tried."""
        if not self.trials:
            return None
        trial = self.trials["designed"]
        return trial.log.ended is None and not self.task.limits.exceeded(trial.peaks)

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds; SI units, and errors also in shares of the bounds' width ("scaled")."""
        question, made = self.task.question, self.design
        believed = question.coordinates.physical(question.point)[question.coordinates.free]
        return {
            "limits": self.task.limits.to_dict(),
            "duration": self.task.duration,
            "believed": _by_label(question.labels, believed),
            "deviations": question.deviations.tolist(),
            "expected": {
                "square": self._expected(self.square.errors),
                "designed": self._expected(made.errors),
            },
            "peaks_on_model": {
                "square": self.square.run.peaks.to_dict(),
                "designed": made.peaks.to_dict(),
            },
            "on_twin": {name: self._tried(trial) for name, trial in self.trials.items()},
            "limits_held_on_twin": self.limits_held,
            "criterion_after_each_generation": [_number(one) for one in made.history],
            "sines": {
                "axes": ["x", "y", "psi"],
                "frequencies": made.frequencies.tolist(),
                "amplitudes": made.amplitudes.tolist(),
                "phases": made.phases.tolist(),
            },
        }

    def _expected(self, scaled: NDArray[np.float64]) -> dict[str, object]:
        question = self.task.question
        return {
            "standard_errors": _by_label(question.labels, question.in_units(scaled)),
            "scaled": _by_label(question.labels, scaled),
            "worst": _number(float(scaled.max())),
        }

    def _tried(self, trial: Trial) -> dict[str, object]:
        return {
            "ended": trial.log.ended,
            "peaks": trial.peaks.to_dict(),
            "exceeded": self.task.limits.exceeded(trial.peaks),
            "scaled": _by_label(self.task.question.labels, trial.errors),
            "parameters": trial.found.to_dict()["parameters"],
            "standard_errors": trial.found.to_dict()["standard_errors"],
            "warnings": list(trial.found.warnings),
        }


def excite(
    robot: Robot,
    controller: Controller,
    *,
    limits: Limits,
    duration: float,
    scenario: Scenario,
    deviations: NDArray[np.float64] | None = None,
    on_twin: bool = True,
    law: Law = "stribeck",
    bounds: Bounds | None = None,
    window: float = 0.25,
    effort: Effort | None = None,
    seed: int = 0,
    recall: Memoize = no_checkpoint,
    tell: Tell | None = None,
) -> Excitation:
    """Design an experiment, hold it against a square of the same length, and try both on the twin.

    Parameters
    ----------
    robot : Robot
        With the friction believed, or none.
    controller : Controller
    limits : Limits
    duration : float
        [s]
    scenario : Scenario
        Of the twin.
    deviations : ndarray (10,), optional
        See `task`; where not given, those of the twin around the square.
    on_twin : bool
        Whether both are tried on the twin and identified from.
    law, bounds, window
        Identification's.
    effort : Effort, optional
    seed : int
        Of the design and of identification.
    recall : Recall, optional
        A checkpoint's, for work that can be resumed; the twin's runs, seconds each, are made again.
    tell : callable, optional
        Told how far the work is.

    Raises
    ------
    InputError
        Where no reference keeps within the limits, none that does tells every parameter, or a run cannot be made.
    """
    check_seed(seed)
    told = _Told(tell)
    plain = square(side=min(_SIDE, limits.floor / math.sqrt(2.0)), period=min(_PERIOD, duration))
    follow = partial(follow_on_twin, robot, scenario, controller, duration=duration, seed=_SEED)
    logs: dict[str, Log] = {}
    if on_twin or deviations is None:
        logs["square"] = follow(plain, progress=told.of(0))
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
    made = design(asked, effort=effort, seed=seed, recall=recall, report=told.design)
    if on_twin:
        logs["designed"] = follow(made.reference, progress=told.of(2))
    trials: dict[str, Trial] = {}
    for number, (name, log) in enumerate(logs.items() if on_twin else ()):
        share = told.of(3, first=number / len(logs), last=(number + 1) / len(logs))
        trials[name] = try_reference(
            robot, log, law=law, bounds=bounds, window=window, seed=seed, recall=recall, progress=share
        )
    driven = run(asked, plain)
    return Excitation(
        task=asked,
        design=made,
        square=Plain(run=driven, errors=expected_errors(asked.question, [driven.log])),
        trials=trials,
    )


class _Told:
    """Turns a stage's share into one of the whole."""

    def __init__(self, tell: Tell | None) -> None:
        self._tell = tell

    def of(self, stage: int, *, first: float = 0.0, last: float = 1.0) -> Callable[[float], None]:
        """Return what to tell the share of a part of a stage, from `first` to `last` of it."""
        return lambda share: self._show(stage, first + (last - first) * share, "")

    def design(self, share: float, criterion: float) -> None:
        """Tell how far the design is, and its errors by and large."""
        self._show(1, share, f"errors about {100.0 * criterion:.1f} %" if np.isfinite(criterion) else "")

    def _show(self, stage: int, share: float, note: str) -> None:
        if self._tell:
            before = sum(part for _, part in _STAGES[:stage])
            name, part = _STAGES[stage]
            self._tell(before + part * share, name, note)


def _by_label(labels: Sequence[str], values: NDArray[np.float64]) -> dict[str, float | None]:
    return {label: _number(float(value)) for label, value in zip(labels, values, strict=True)}


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
