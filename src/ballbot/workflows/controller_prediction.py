"""What a controller will do on the robot's next run of a course: each quantity with its 95 % prediction interval.

A study runs its candidates on robots drawn from what identification leaves uncertain. The performances of one
candidate on those robots are taken as lognormal: the logarithm of a new one is Student's t about their mean,

    log q = m + t_{n-1} s sqrt(1 + 1/n).

A real robot is no such plant: it has faults that no draw has. What these do is a model discrepancy, a factor that was
calibrated on twins with faults that their study did not know (`DISCREPANCY`); it is added to the interval's half
widths in the root of the sum of squares. Without it the interval holds on the robots drawn, and on no real robot.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field, FiniteFloat, NonNegativeInt, PositiveFloat

from ballbot.control.controller import Controller
from ballbot.control.file import Table, controller_text
from ballbot.control.references import REFERENCES
from ballbot.errors import InputError
from ballbot.file_formats import read_results, without_format
from ballbot.log import Log
from ballbot.results import reported
from ballbot.schema import validate_table
from ballbot.summary import counted
from ballbot.workflows.controller_choice import CANDIDATES, ControllerChoice, NamedCourse
from ballbot.workflows.controller_differences import OF_FRICTION, signature_of
from ballbot.workflows.metrics import QUANTITIES, Performance

CONFIDENCE = 0.95
#: fewest performances that an interval can be made of
MIN_RUNS = 6
#: longest course that is read from a file [s]; a row for each sample is compared with the log
_MAX_COURSE = 3600.0

#: factors (lower, upper) by which a faulty twin's quantity differs from the median of the robots drawn, at the 2.5th
#: and 97.5th percentile of the faulty twins whose run did not end early, beyond the spread of the draws; of the torque
#: margin, by which the share of the torque limit that is used differs. `python -m campaigns.controller_prediction`
#: prints them: of the precise controller and of the nominal gain without compensation, which stand for all candidates
#: with their gain.
DISCREPANCY: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "precise": {
        "peak_error": (0.39, 4.5),
        "rms_error": (0.25, 3.8),
        "roughness": (0.56, 3.5),
        "lean": (0.92, 1.4),
        "torque_margin": (0.83, 2.0),
    },
    "none": {
        "peak_error": (0.72, 3.4),
        "rms_error": (0.54, 2.2),
        "roughness": (0.98, 9.0),
        "lean": (0.69, 3.6),
        "torque_margin": (0.8, 4.3),
    },
}


@dataclass(frozen=True, kw_only=True)
class PredictionInterval:
    """What a quantity will be in one new run."""

    median: float
    low: float
    high: float

    def place(self, value: float) -> Literal["inside", "below", "above"]:
        """Return where a value lies; what is not a number is above."""
        if value < self.low:
            return "below"
        return "inside" if value <= self.high else "above"


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """What the controller of a study, and none at all, will do on the next run of a course."""

    course: NamedCourse
    controller: str  #: name of the candidate
    checksum: str  #: SHA-256 of the controller's file
    torque_limit: float  #: of the controller, each wheel [N m]
    scenario: str  #: name of what is true of the robots
    draws: int  #: number of robots
    chosen: Mapping[str, PredictionInterval]  #: by quantity of `Performance`
    none: (
        Mapping[str, PredictionInterval] | None
    )  #: the same without friction compensation; None if that falls
    #: of the log of a predicted run; see `ballbot.workflows.controller_differences`
    signature: Mapping[str, float]

    @reported
    def confidence(self) -> float:
        """Of the intervals."""
        return CONFIDENCE


def predict(choice: ControllerChoice, *, logs: Sequence[Log] = ()) -> Prediction | None:
    """Return what the controller that was chosen will do on the next run of the course.

    Parameters
    ----------
    choice : ControllerChoice
    logs : sequence of Log
        Of the study: what they show of the friction is what the next log is compared with.

    Returns
    -------
    Prediction or None
        None if no controller was chosen or fewer than six robots were drawn.
    """
    chosen, controller = choice.chosen, choice.controller
    if chosen is None or controller is None or len(choice.plants) < MIN_RUNS:
        return None
    without = choice.trials["none"]
    return Prediction(
        course=choice.course,
        controller=chosen,
        checksum=checksum_of(controller),
        torque_limit=controller.torque_limit,
        scenario=choice.plants[0].scenario.name,
        draws=len(choice.plants),
        chosen=intervals_of(choice, chosen),
        none=intervals_of(choice, "none") if len(without.scores) - without.falls >= MIN_RUNS else None,
        signature=_expected_signature(choice, logs),
    )


def _expected_signature(choice: ControllerChoice, logs: Sequence[Log]) -> dict[str, float]:
    """Return the signature of a run with the chosen controller, but the study's logs' own friction.

    A simulated robot that is given the identified friction loses energy besides, as in its rollers.
    """
    known = choice.plants[0].known
    simulated = signature_of(choice.runs[choice.chosen or "none"].without_truth(), known)
    measured = [signature_of(log, known) for log in logs]
    of_friction = {name: [one[name] for one in measured if name in one] for name in OF_FRICTION}
    return simulated | {name: float(np.mean(values)) for name, values in of_friction.items() if values}


def checksum_of(controller: Controller) -> str:
    """Return the SHA-256 of a controller's file without the number of its format, in hexadecimal digits."""
    return hashlib.sha256(without_format(controller_text(controller)).encode()).hexdigest()


def intervals_of(choice: ControllerChoice, candidate: str) -> dict[str, PredictionInterval]:
    """Return the intervals of a candidate's quantities; runs that ended early do not count.

    Raises
    ------
    InputError
        If fewer than six runs did not end early.
    """
    trial = choice.trials[candidate]
    stood = [one for one, score in zip(trial.performances, trial.scores, strict=True) if score.ended is None]
    kind, _ = CANDIDATES[candidate]
    return performance_intervals(stood, discrepancy=DISCREPANCY["precise" if kind == "precise" else "none"])


def performance_intervals(
    performances: Sequence[Performance], *, discrepancy: Mapping[str, tuple[float, float]]
) -> dict[str, PredictionInterval]:
    """Return the prediction interval of each quantity for one new run on a robot with unknown faults.

    Parameters
    ----------
    performances : sequence of Performance
        On robots without these faults.
    discrepancy : mapping of str to tuple of two floats
        Of the model, by quantity; see `DISCREPANCY`.

    Raises
    ------
    InputError
        If there are fewer than six performances.
    """
    if len(performances) < MIN_RUNS:
        raise InputError(
            f"Only {counted(len(performances), 'run')} did not end early; a prediction needs {MIN_RUNS} or more."
        )
    table = np.array([one.to_array() for one in performances])
    return {
        name: _of_quantity(name, table[:, place], discrepancy[name]) for place, name in enumerate(QUANTITIES)
    }


def lognormal_interval(
    values: NDArray[np.float64], *, discrepancy: tuple[float, float] = (1.0, 1.0)
) -> PredictionInterval:
    """Return the 95 % prediction interval of one new value, lognormal like those of a sample.

    Parameters
    ----------
    values : ndarray (n,)
        Positive, two or more.
    discrepancy : tuple of two floats
        Factors (at most 1, at least 1) by which what is new may differ besides.
    """
    logs = np.log(np.maximum(values, np.finfo(np.float64).tiny))
    count = len(logs)
    center = float(logs.mean())
    quantile = float(scipy.stats.t.ppf(0.5 + 0.5 * CONFIDENCE, count - 1))
    half = quantile * float(logs.std(ddof=1)) * np.sqrt(1.0 + 1.0 / count)
    down, up = (float(np.hypot(half, np.log(factor))) for factor in discrepancy)
    return PredictionInterval(
        median=float(np.exp(center)), low=float(np.exp(center - down)), high=float(np.exp(center + up))
    )


def _of_quantity(
    name: str, values: NDArray[np.float64], discrepancy: tuple[float, float]
) -> PredictionInterval:
    if name != "torque_margin":
        return lognormal_interval(values, discrepancy=discrepancy)
    used = lognormal_interval(1.0 - values, discrepancy=discrepancy)
    # no motor gives more than its limit
    return PredictionInterval(
        median=1.0 - min(used.median, 1.0), low=1.0 - min(used.high, 1.0), high=1.0 - used.low
    )


class _IntervalTable(Table):
    median: FiniteFloat
    low: FiniteFloat
    high: FiniteFloat


class _QuantitiesTable(Table):
    peak_error: _IntervalTable
    rms_error: _IntervalTable
    roughness: _IntervalTable
    lean: _IntervalTable
    torque_margin: _IntervalTable


class _CourseTable(Table):
    name: str
    duration: float = Field(ge=1.0, le=_MAX_COURSE)


class _PredictionTable(Table):
    """The object "prediction" of a study's results.json."""

    course: _CourseTable
    controller: str
    checksum: str = Field(pattern="^[0-9a-f]{64}$")
    torque_limit: PositiveFloat
    plant: str = ""  # of earlier versions
    scenario: str
    draws: NonNegativeInt
    confidence: PositiveFloat
    chosen: _QuantitiesTable
    none: _QuantitiesTable | None
    signature: dict[str, FiniteFloat | None]


def read_prediction(path: str | Path) -> Prediction:
    """Return the prediction that a study's results.json holds.

    Raises
    ------
    InputError
        If the file cannot be read or holds no prediction.
    """
    tree = read_results(path)
    found = tree.get("prediction") if isinstance(tree, dict) else None
    if not isinstance(found, dict):
        raise InputError(
            f"{path} holds no prediction; give the results.json of `ballbot study`, which predicts what its controller "
            f"does if it draws {MIN_RUNS} robots or more."
        )
    try:
        table = validate_table(_PredictionTable, found, of="the prediction in a results.json")
    except InputError as error:
        raise InputError(f"{path}: prediction: {error}") from None
    _check_table(table, path)
    return Prediction(
        course=NamedCourse(name=table.course.name, duration=table.course.duration),
        controller=table.controller,
        checksum=table.checksum,
        torque_limit=table.torque_limit,
        scenario=table.scenario,
        draws=table.draws,
        chosen=_intervals(table.chosen),
        none=_intervals(table.none) if table.none else None,
        signature={name: one for name, one in table.signature.items() if one is not None},
    )


def _check_table(table: _PredictionTable, path: str | Path) -> None:
    """Raise InputError if course or controller is unknown, or an interval's bounds are not about its median."""
    where = f"{path}: prediction"
    if table.controller not in CANDIDATES:
        raise InputError(
            f"{where}: controller is {table.controller!r}; it must be one of {', '.join(CANDIDATES)}."
        )
    if table.course.name not in REFERENCES:
        raise InputError(
            f"{where}: course.name is {table.course.name!r}; it must be one of {', '.join(REFERENCES)}."
        )
    for key, intervals in (("chosen", table.chosen), ("none", table.none)):
        for name, one in _intervals(intervals).items() if intervals else ():
            if not one.low <= one.median <= one.high:
                raise InputError(
                    f"{where}: {key}.{name} is {one.low:g}, {one.median:g}, {one.high:g}; low, median and high must "
                    "ascend."
                )


def _intervals(table: _QuantitiesTable) -> dict[str, PredictionInterval]:
    return {name: PredictionInterval(**getattr(table, name).model_dump()) for name in QUANTITIES}
