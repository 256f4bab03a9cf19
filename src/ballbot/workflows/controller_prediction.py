"""Prediction of a controller's performance on the robot's next run of a course, and the verdict of that run's log.

A study runs its candidates on robots drawn from what identification leaves uncertain. Their performances are taken as
lognormal: the logarithm of a new one is Student's t about their mean,

    log q = m + t_{n-1} s sqrt(1 + 1/n).

A real robot has faults that no draw has. Their effect is a model discrepancy, a factor calibrated on twins with faults
that their study did not know (`DISCREPANCY`); it is added to the half widths in the root of the sum of squares.

The verdict says whether the prediction is confirmed, which quantities differ and by how much, and what to do:

    revert   the run ended early, or its error is not below the interval predicted for the nominal gain without
             compensation, or a quantity is worse than predicted and the controller compensates nothing
    weaken   a quantity is worse than predicted, but the error is still clearly smaller
    keep     nothing is worse than predicted
"""

import copy
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Floats
from ballbot.control.controller import Controller
from ballbot.control.file import controller_text
from ballbot.errors import InputError, every
from ballbot.file_formats import read_results, without_format
from ballbot.findings import Finding
from ballbot.log import STATE_NAMES, Log
from ballbot.log.columns import torque_names
from ballbot.results import reported
from ballbot.schema import validate_table
from ballbot.validation.closed_loop import delay_of
from ballbot.workflows.controller_choice import CANDIDATES, ControllerChoice, NamedCourse
from ballbot.workflows.metrics import QUANTITIES, LogScore, Metric
from ballbot.workflows.statistics import CONFIDENCE, student_quantile

#: fewest performances for an interval
MIN_RUNS = 6

#: factors (lower, upper) by which a faulty twin's quantity differs from the median of the robots drawn, at the 2.5th
#: and 97.5th percentile of the twins that did not fall, beyond the spread of the draws; of the torque margin, of the
#: share of the limit that is used. By kind of controller; from commit 1b7e17a9, `campaigns.strangers` prints new ones.
DISCREPANCY: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "precise": {
        "peak_error": (0.39, 4.5),
        "rms_error": (0.25, 3.8),
        "roughness": (0.56, 3.5),
        "lean": (0.92, 1.4),
        "torque_margin": (0.83, 2.0),
    },
    "nominal": {
        "peak_error": (0.72, 3.4),
        "rms_error": (0.54, 2.2),
        "roughness": (0.98, 9.0),
        "lean": (0.69, 3.6),
        "torque_margin": (0.8, 4.3),
    },
}


def discrepancy_of(candidate: str) -> Mapping[str, tuple[float, float]]:
    """Return a candidate's discrepancy; of a kind for which none is calibrated the widest of those that are."""
    kinds = tuple(DISCREPANCY.values())
    widest = {
        name: (min(kind[name][0] for kind in kinds), max(kind[name][1] for kind in kinds))
        for name in kinds[0]
    }
    return DISCREPANCY.get(CANDIDATES[candidate][0].name, widest)


#: the quantities of a `LogScore`
SHOWN: Mapping[str, Metric] = {
    metric.key: metric
    for metric in (
        Metric("peak_error", "peak error", "mm", 1e3, 1),
        Metric("rms_error", "RMS error", "mm", 1e3, 1),
        Metric("roughness", "torque roughness", "N m", 1.0, 3),
        Metric("lean", "lean", "rad", 1.0, 3),
        Metric("torque_margin", "torque margin", "%", 1e2, 0, better="above"),
    )
}


@dataclass(frozen=True, kw_only=True)
class PredictionInterval:
    """The prediction interval of a quantity in one new run."""

    median: float
    low: float
    high: float

    def place(self, value: float) -> Literal["inside", "below", "above"]:
        """Return where a value lies; NaN is above."""
        if value < self.low:
            return "below"
        return "inside" if value <= self.high else "above"


@dataclass(frozen=True, kw_only=True)
class ControllerPrediction:
    """Predicted performance of the chosen controller, and of the soft gain without compensation, on the next run."""

    course: NamedCourse
    controller: str  #: name of the candidate
    checksum: str  #: SHA-256 of the controller's file
    torque_limit: float  #: of the controller, each wheel [N m]
    scenario: str  #: name of the scenario of the robots
    draws: int  #: number of robots
    chosen: Mapping[str, PredictionInterval]  #: by quantity of `LogScore`
    none: Mapping[str, PredictionInterval] | None  #: the soft gain's; None if too few stood
    log_findings: tuple[str, ...] = ()  #: codes of the findings on the study's logs

    @reported
    def confidence(self) -> float:
        """Of the intervals."""
        return CONFIDENCE

    @property
    def calibration(self) -> str:
        """The sentence on a kind of controller whose discrepancy is not calibrated; empty if it is."""
        kind, _ = CANDIDATES[self.controller]
        if kind.name in DISCREPANCY:
            return ""
        return f" No model discrepancy is calibrated for {kind.name} controllers: the widest of other kinds is taken."


def predict(choice: ControllerChoice, *, log_findings: Sequence[Finding] = ()) -> ControllerPrediction | None:
    """Predict the chosen controller's next run on six robots drawn or more; None if none was chosen."""
    chosen, controller = choice.chosen, choice.controller
    if chosen is None or controller is None:
        return None

    def intervals(candidate: str) -> dict[str, PredictionInterval] | None:
        """Return the intervals of a candidate; runs that ended early do not count, and six others are needed."""
        trial = choice.trials[candidate]
        stood = [
            performance
            for performance, run in zip(trial.performances, trial.scores, strict=True)
            if run.ended is None
        ]
        if len(stood) < MIN_RUNS:
            return None
        return performance_intervals(stood, discrepancy=discrepancy_of(candidate))

    predicted = intervals(chosen)
    assert predicted is not None, "the chosen candidate falls nowhere"
    return ControllerPrediction(
        course=choice.course,
        controller=chosen,
        checksum=checksum_of(controller),
        torque_limit=controller.torque_limit,
        scenario=choice.plants[0].scenario.name,
        draws=len(choice.plants),
        chosen=predicted,
        none=intervals("none"),
        log_findings=tuple(dict.fromkeys(finding.code for finding in log_findings)),
    )


def checksum_of(controller: Controller) -> str:
    """Return the SHA-256 of a controller's file without the number of its format, in hexadecimal digits."""
    return hashlib.sha256(without_format(controller_text(controller)).encode()).hexdigest()


def performance_intervals(
    performances: Sequence[LogScore], *, discrepancy: Mapping[str, tuple[float, float]]
) -> dict[str, PredictionInterval]:
    """Return each quantity's prediction interval for a new run on a robot with unknown faults (`DISCREPANCY`)."""
    sizes = [performance.sizes() for performance in performances]
    intervals = {
        name: lognormal_interval(np.array([each[name] for each in sizes]), discrepancy=discrepancy[name])
        for name in QUANTITIES
    }
    # the share of the torque limit that is left; no motor gives more than its limit
    used = intervals["torque_margin"]
    intervals["torque_margin"] = PredictionInterval(
        median=1.0 - min(used.median, 1.0), low=1.0 - min(used.high, 1.0), high=1.0 - used.low
    )
    return intervals


def lognormal_interval(
    values: Floats, *, discrepancy: tuple[float, float] = (1.0, 1.0)
) -> PredictionInterval:
    """Return the 95 % prediction interval of one new lognormal value, which may differ by the discrepancy besides."""
    logs = np.log(np.maximum(values, np.finfo(np.float64).tiny))
    count, center = len(logs), float(logs.mean())
    half = student_quantile(count) * float(logs.std(ddof=1)) * np.sqrt(1.0 + 1.0 / count)
    down, up = (float(np.hypot(half, np.log(factor))) for factor in discrepancy)
    return PredictionInterval(
        median=float(np.exp(center)), low=float(np.exp(center - down)), high=float(np.exp(center + up))
    )


def read_prediction(path: str | Path) -> ControllerPrediction:
    """Return the prediction in a study's results.json; raise InputError if it cannot be read or holds none."""
    tree = read_results(path)
    if not (isinstance(tree, dict) and tree.get("prediction")):
        raise InputError(
            f"{path} holds no prediction; give the results.json of a `ballbot study` that chose a controller."
        )
    try:
        prediction = validate_table(
            ControllerPrediction, tree["prediction"], of="the prediction in a results.json"
        )
        prediction.course.reference_spec.reference()
    except InputError as error:
        raise InputError(f"{path}: prediction: {error} Run `ballbot study` again.") from None
    tables = (prediction.chosen, prediction.none or prediction.chosen)
    if prediction.controller not in CANDIDATES or any(set(table) != set(QUANTITIES) for table in tables):
        raise InputError(f"{path}: the prediction is of another version; run `ballbot study` again.")
    return prediction


Recommendation = Literal["keep", "weaken", "revert"]

#: errors of a log's checks that describe the robot's motion: the verdict is about them, so they do not stop it
EXPLAINED_CODES = frozenset(
    {
        *("ball-axes", "degrees", "heading-sign", "lean-axes", "lean-scale", "scale", "sign", "swapped"),
        *("torque-order", "torque-scale", "torque-sign", "torque-unrelated", "dead-motor", "wheels"),
        *("constant", "held", "lean-offset", "reset", "spike", "stuck", "torque-delay"),
        *("fall", "hands", "saturation", "disturbance"),
    }
)
#: a log's reference may differ from the course's by this [m, rad], in this share of the rows: at jumps
_SAME_POSE, _OTHER_ROWS = 0.005, 0.005
#: a run that ends this much before the course has ended early [s]
_SHORT = 0.05
#: largest fraction of rows with missing values
_MAX_MISSING = 0.02
#: lean in the last half second of a log that ends early, from which it is a fall [rad]
_FALLING, _LAST = 0.2, 0.5
#: relative difference of sample times that is rounding
_SAME_TIME = 0.01


@dataclass(frozen=True, kw_only=True)
class QuantityResult:
    """A quantity of the new log beside its prediction."""

    name: str
    predicted: PredictionInterval
    value: float  #: NaN if the run ended too early to show it

    @reported
    def place(self) -> Literal["inside", "below", "above"]:
        """Where the value lies."""
        return self.predicted.place(self.value)

    @reported
    def worse(self) -> bool:
        """Whether it is outside its interval, on the worse side."""
        return self.place not in ("inside", SHOWN[self.name].better)

    @reported
    def factor(self) -> float:
        """Its size over the nearest end of the interval, 1 if inside; for the torque margin, of the share used."""
        ends = {"inside": self.value, "below": self.predicted.low, "above": self.predicted.high}
        size, end = self.value, ends[self.place]
        if self.name == "torque_margin":
            size, end = 1.0 - size, 1.0 - end
        return size / end if end > 0.0 else np.nan


@dataclass(frozen=True, kw_only=True)
class ControllerVerdict:
    """The verdict of one log on a controller."""

    recommendation: Recommendation
    reason: str  #: in sentences: confirmed or refuted, by how much and in which quantity
    quantities: tuple[QuantityResult, ...]
    none: Mapping[str, PredictionInterval] | None  #: predicted without compensation; None if that falls
    ended: str | None  #: why the run ended before the course, or None
    differences: tuple[str, ...]  #: findings on this log but not on the study's logs, in sentences
    foreign: bool  #: whether the torques are not those that the controller gives for the logged states

    @reported
    def confirmed(self) -> bool:
        """Whether the whole course was run, and no quantity is worse than predicted."""
        return self.ended is None and not any(quantity.worse for quantity in self.quantities)


def evaluate_log(
    prediction: ControllerPrediction,
    log: Log,
    controller: Controller,
    *,
    log_findings: Sequence[Finding] = (),
) -> ControllerVerdict:
    """Return the verdict of a log that was made with a study's controller; rows before the course are left out.

    InputError if the controller is another, or the log lacks a column, many values or a part of the course.
    """
    check_controller(prediction, controller)
    complete = log.complete(
        "ref_x", "ref_y", "ref_psi", *STATE_NAMES, *torque_names(controller.robot.wheel_count)
    )
    missing = len(log) - len(complete)
    if missing > _MAX_MISSING * len(log):
        raise InputError(
            f"{missing} of {len(log)} rows of the log lack a state, a torque or the reference. Record the course again."
        )
    run = course_of(complete, prediction, sample_time=controller.sample_time)
    ended = _why_ended(run, prediction)
    seen = LogScore.of(run, torque_limit=prediction.torque_limit)
    quantities = tuple(
        QuantityResult(name=name, predicted=prediction.chosen[name], value=value)
        for name, value in vars(seen).items()
    )
    recommendation, reason = _recommended(prediction, quantities, ended)
    foreign = False
    try:
        delay_of(copy.deepcopy(controller), complete)
    except InputError:
        foreign = True
    return ControllerVerdict(
        recommendation=recommendation,
        reason=reason,
        quantities=quantities,
        none=prediction.none,
        ended=ended,
        differences=tuple(
            finding.text for finding in log_findings if finding.code not in prediction.log_findings
        ),
        foreign=foreign,
    )


def check_controller(
    prediction: ControllerPrediction, controller: Controller, *, file: Path | str = "The controller's file"
) -> None:
    """Raise InputError if the controller is not the one whose performance is predicted."""
    if checksum_of(controller) != prediction.checksum:
        raise InputError(
            f"{file} is not the one whose performance is predicted: it was changed, or belongs to another study. Give "
            "the controller.toml beside the results.json, as `ballbot study` wrote it."
        )


def course_of(log: Log, prediction: ControllerPrediction, *, sample_time: float) -> Log:
    """Return the rows of a log that follow the predicted course, from its start to its end or the log's.

    The course begins with the log, or where the log's first jump of the reference is the course's.
    """
    course = prediction.course
    how = f"record {course.duration:g} s of `{course.name}` from its start with this controller"
    if abs(log.sample_time / sample_time - 1.0) > _SAME_TIME:
        raise InputError(
            f"The log's sample time is {log.sample_time:g} s and the controller's {sample_time:g} s; {how}, a row for "
            "each update."
        )
    reference, asked = course.reference_spec.reference(), log.reference[:, [0, 1, 4]]
    samples = round(course.duration / sample_time)
    wanted = np.array([reference(k * sample_time)[[0, 1, 4]] for k in range(samples)])
    begins = [float(log.t[0])]
    (jumps, jumps_wanted) = _jumps(asked), _jumps(wanted)
    if jumps.size and jumps_wanted.size:
        begins.insert(0, max(float(log.t[jumps[0]] - jumps_wanted[0] * sample_time), begins[0]))
    for begin in begins:
        run = slice(*np.searchsorted(log.t, begin + sample_time * np.array([-0.5, samples - 0.5])).tolist())
        # by their times: missing rows shift the others
        numbers = np.clip(np.rint((log.t[run] - begin) / sample_time).astype(int), 0, samples - 1)
        if np.mean(np.abs(asked[run] - wanted[numbers]).max(axis=1) > _SAME_POSE) <= _OTHER_ROWS:
            return log.select(run)
    raise InputError(
        f"The log's reference is not the course {course.name!r} for which the performance is predicted; {how}."
    )


def _jumps(poses: Floats) -> NDArray[np.intp]:
    """Return the rows of poses (N, 3) at which they have jumped."""
    return np.flatnonzero(np.abs(np.diff(poses, axis=0)).max(axis=1, initial=0.0) > _SAME_POSE) + 1


def _why_ended(run: Log, prediction: ControllerPrediction) -> str | None:
    """Return why a run ended before its course did, None if it did not; InputError if the log is a part of a run."""
    duration = prediction.course.duration
    lasted = float(run.t[-1] - run.t[0]) + run.sample_time
    if lasted >= duration - _SHORT - run.sample_time:
        return None
    if run.ended is not None:
        return run.ended
    last = run.between(float(run.t[-1]) - _LAST, np.inf)
    lean = float(np.hypot(last["theta"], last["phi"]).max())
    if lean > _FALLING:
        return f"fallen: a lean of {lean:.2g} rad at t = {lasted:.3g} s of the course"
    raise InputError(
        f"The log has {lasted:.3g} s of the course {prediction.course.name!r} of {duration:g} s, and the robot is "
        "upright at its end; record the whole course, or go back to the previous controller if this one stops by "
        "itself."
    )


def _recommended(
    prediction: ControllerPrediction, quantities: Sequence[QuantityResult], ended: str | None
) -> tuple[Recommendation, str]:
    """Return what to do, and whether the prediction is confirmed, by how much and in which quantity."""
    if ended is not None:
        return "revert", f"Refuted: the run ended before the course did ({ended})."
    worse = [quantity for quantity in quantities if quantity.worse]
    better = [
        SHOWN[quantity.name].words
        for quantity in quantities
        if quantity.place != "inside" and not quantity.worse
    ]
    if worse:
        reason = f"Refuted: {every([_amount(quantity) for quantity in worse])}."
    elif better:
        verb = "is" if len(better) == 1 else "are"
        reason = f"Confirmed: nothing is worse than predicted, and the {every(better)} {verb} better."
    else:
        reason = "Confirmed: all quantities lie inside their 95 % prediction intervals."
    peak = quantities[QUANTITIES.index("peak_error")].value
    none = prediction.none["peak_error"] if prediction.none and prediction.controller != "none" else None
    if none is not None and not peak < none.low:
        return "revert", (
            f"{reason} The peak error of {1e3 * peak:.3g} mm is not clearly smaller than with the nominal gain without "
            f"compensation ({1e3 * none.median:.3g} mm predicted, 95 % interval from {1e3 * none.low:.3g} mm)."
        )
    if worse and CANDIDATES[prediction.controller][1] == "none":
        return "revert", reason
    return ("weaken" if worse else "keep"), reason


def _amount(quantity: QuantityResult) -> str:
    """Return by how much a quantity is worse than predicted, in words."""
    shown, interval = SHOWN[quantity.name], quantity.predicted
    value = f"the {shown.words} is {shown.shown(quantity.value)} {shown.unit}"
    if quantity.name == "torque_margin":
        return f"{value}, predicted {shown.shown(interval.low)} {shown.unit} or more"
    return f"{value}, {quantity.factor:.2g} times the upper end of its interval"
