"""The verdict of the next log on a controller: each predicted quantity inside or outside; keep, weaken or revert.

    revert   the run ended early, or its error is not clearly smaller than that predicted for the nominal gain without
             compensation, or a quantity is worse than predicted and the controller compensates nothing
    weaken   a quantity is worse than predicted, but the error is still clearly smaller
    keep     nothing is worse than predicted; better than predicted also means keep

"Clearly smaller" is below the prediction interval of the run without compensation.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.errors import InputError, every
from ballbot.findings import Finding, warning
from ballbot.log import STATE_NAMES, Log
from ballbot.log.columns import torque_names
from ballbot.robot import Robot
from ballbot.rounding import percent
from ballbot.workflows.controller_causes import Cause, ranked_causes, signature_of
from ballbot.workflows.controller_choice import CANDIDATES
from ballbot.workflows.controller_prediction import Prediction, PredictionInterval, checksum_of
from ballbot.workflows.metrics import QUANTITIES, Performance, rms

Recommendation = Literal["keep", "weaken", "revert"]

#: what is better, by quantity
BETTER: Mapping[str, Literal["below", "above"]] = MappingProxyType(
    {
        "peak_error": "below",
        "rms_error": "below",
        "roughness": "below",
        "lean": "below",
        "torque_margin": "above",
    }
)
#: names of the quantities in sentences
QUANTITY_NAMES: Mapping[str, str] = MappingProxyType(
    {
        "peak_error": "peak error",
        "rms_error": "RMS error",
        "roughness": "torque roughness",
        "lean": "lean",
        "torque_margin": "torque margin",
    }
)
#: a log's reference may differ from the course's by this [m, rad]
_SAME_POSE = 0.005
#: share of the rows in which it may; jumps fall between samples
_OTHER_ROWS = 0.005
#: jumps of a log's reference that may be the beginning of the course
_MAX_JUMPS = 100
#: a run that ends this much before the course has ended early [s]
_SHORT = 0.05
#: largest fraction of rows with missing values
_MAX_MISSING = 0.02
#: lean in the last half second of a log that ends early, from which it is a fall [rad]
_FALLING, _LAST = 0.2, 0.5
#: duration from which a run separates gain, friction and constants of the torque [s]. On three runs of the twin around
#: the square the gain, truly 1, came out as 0.55 to 0.68 of 8 s, 0.80 to 0.88 of 16 s and 0.995 to 0.999 of 24 s
SEPARABLE = 24.0
#: duration of a fall, which is left out [s]
_FALL = 2.0
#: relative difference of sample times that is rounding
_SAME_TIME = 0.01
#: RMS difference from the controller's torques, over the RMS of the torques, from which they are not its own
_NOT_ITS_OWN = 0.2


@dataclass(frozen=True, kw_only=True)
class QuantityResult:
    """A quantity of the new log beside its prediction."""

    name: str
    predicted: PredictionInterval
    value: float  #: NaN if the run ended too early to show it
    place: Literal["inside", "below", "above"]

    @property
    def worse(self) -> bool:
        """Whether it is outside its interval, on the worse side."""
        return self.place not in ("inside", BETTER[self.name])


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The verdict of one log on a controller."""

    recommendation: Recommendation
    reason: str  #: one sentence with the numbers that decide
    quantities: tuple[QuantityResult, ...]
    none: Mapping[str, PredictionInterval] | None  #: predicted without compensation; None if that falls
    ended: str | None  #: why the run ended before the course, or None
    causes: tuple[Cause, ...]  #: of quantities outside their intervals, the likeliest first
    findings: tuple[Finding, ...]  #: limits of the verdict

    @property
    def outside(self) -> tuple[QuantityResult, ...]:
        """The quantities that lie outside their intervals."""
        return tuple(one for one in self.quantities if one.place != "inside")


def evaluate_log(
    prediction: Prediction,
    log: Log,
    robot: Robot,
    controller: Controller,
    *,
    codes: Sequence[str] = (),
) -> Verdict:
    """Return the verdict of a log that was made with a study's controller.

    Parameters
    ----------
    prediction : Prediction
    log : Log
        Of the course, with states, torques and reference; rows before the course are left out.
    robot : Robot
        As identified by the study.
    controller : Controller
        The study's.
    codes : sequence of str
        Of errors that the checks found in the log and the user accepted.

    Raises
    ------
    InputError
        If the controller is not the one that was predicted, the log lacks a column, follows another course or has
        another sample time, has many rows with missing values, or ends before the course without a fall.
    """
    check_controller(prediction, controller)
    log = _complete(log, robot)
    run = course_of(log, prediction, sample_time=controller.sample_time)
    ended = why_ended(run, prediction)
    seen = Performance.of(run, torque_limit=prediction.torque_limit)
    values = dict(zip(QUANTITIES, seen.to_array().tolist(), strict=True))
    quantities = tuple(_quantity_result(name, prediction.chosen[name], values[name]) for name in QUANTITIES)
    recommendation, reason = _recommended(prediction, quantities, ended)
    outside = ended is not None or any(one.place != "inside" for one in quantities)
    causes = causes_in(run, robot, prediction, ended=ended is not None, codes=codes) if outside else ()
    return Verdict(
        recommendation=recommendation,
        reason=reason,
        quantities=quantities,
        none=prediction.none,
        ended=ended,
        causes=causes,
        findings=(*_warnings(log, controller), *(_short_run(run, ended is not None) if outside else ())),
    )


def causes_in(
    run: Log, robot: Robot, prediction: Prediction, *, ended: bool, codes: Sequence[str] = ()
) -> tuple[Cause, ...]:
    """Return likely causes of a run that is not as predicted, the likeliest first.

    Parameters
    ----------
    run : Log
    robot : Robot
        As identified.
    prediction : Prediction
    ended : bool
        Whether it ended early: its last two seconds, in a fall, are then left out.
    codes : sequence of str
        Of errors that the log's checks found; of a fall, they are its effects, and do not count.
    """
    rows = _rows_before_a_fall(run, ended)
    signature = signature_of(run.select(slice(0, rows)), robot) if rows > 1 else None
    return ranked_causes(signature, prediction.signature, codes=() if ended else codes)


def course_of(log: Log, prediction: Prediction, *, sample_time: float) -> Log:
    """Return the rows of a log that follow the predicted course, from its start to its end or the log's.

    Raises
    ------
    InputError
        If the log lacks a column, has another sample time or follows another course.
    """
    course = prediction.course
    how = f"record {course.duration:g} s of `{course.name}` from its start with this controller"
    if abs(log.sample_time / sample_time - 1.0) > _SAME_TIME:
        raise InputError(
            f"The log's sample time is {log.sample_time:g} s and the controller's {sample_time:g} s; {how}, a row for "
            "each update."
        )
    wanted = _reference_poses(prediction, sample_time)
    runs = {
        begin: log.between(begin - 0.5 * sample_time, begin + course.duration - 0.5 * sample_time)
        for begin in _start_candidates(log, wanted, sample_time)
    }
    apart = {
        begin: _mismatch_fraction(run, wanted, begin, sample_time)
        for begin, run in runs.items()
        if len(run) > 1
    }
    # the most rows that fit: one that begins near the log's end has few, and they fit easily
    fitting = [begin for begin, share in apart.items() if share <= _OTHER_ROWS]
    best = max(fitting, key=lambda begin: (1.0 - apart[begin]) * len(runs[begin]), default=None)
    if best is None:
        raise InputError(
            f"The log's reference is not the course {course.name!r} for which the performance is predicted; {how}."
        )
    return runs[best]


def why_ended(run: Log, prediction: Prediction) -> str | None:
    """Return why a run ended before its course did; None if it did not.

    Raises
    ------
    InputError
        If it ends early without a sign of a fall or a stop: the log is a part of a run.
    """
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


def foreign_torque(log: Log, controller: Controller) -> float:
    """Return the RMS difference between the logged torques and the controller's, over the RMS of the torques.

    The controller is replayed on the logged states and references from the start of the log.
    """
    replayed = copy.deepcopy(controller)
    replayed.reset()
    reference = np.zeros((len(log), 10))
    reference[:, [0, 1, 4]] = np.column_stack([log["ref_x"], log["ref_y"], log["ref_psi"]])
    given = np.array(
        [
            replayed.update(t, state, wanted)
            for t, state, wanted in zip(log.t.tolist(), log.states, reference, strict=True)
        ]
    )
    return rms(log.torques - given) / max(rms(log.torques), 1e-12)


def check_controller(prediction: Prediction, controller: Controller) -> None:
    """Raise InputError if the controller is not the one whose performance is predicted."""
    if checksum_of(controller) != prediction.checksum:
        raise InputError(
            "The controller's file is not the one whose performance is predicted: it was changed, or belongs to "
            "another study. Give the controller.toml that stands beside the results.json, as `ballbot study` wrote it."
        )


def _complete(log: Log, robot: Robot) -> Log:
    """Return the rows of a log in which no needed value is missing."""
    names = ("ref_x", "ref_y", "ref_psi", *STATE_NAMES, *torque_names(robot.wheel_count))
    complete = log.complete(*names)
    missing = len(log) - len(complete)
    if missing > _MAX_MISSING * len(log):
        raise InputError(
            f"{missing} of {len(log)} rows of the log lack a state, a torque or the reference; at most "
            f"{percent(_MAX_MISSING)} may. Record the course again."
        )
    return complete


def _reference_poses(prediction: Prediction, sample_time: float) -> NDArray[np.float64]:
    """Return x, y and psi (N, 3) that the course asks for, a row for each sample."""
    reference = prediction.course.reference_spec.reference()
    count = round(prediction.course.duration / sample_time)
    return np.array([reference(k * sample_time)[[0, 1, 4]] for k in range(count)])


def _start_candidates(log: Log, wanted: NDArray[np.float64], sample_time: float) -> list[float]:
    """Return times at which the course may begin in a log: its first row, and where the first jump fits [s]."""
    begins = [float(log.t[0])]
    jumps = np.flatnonzero(np.abs(np.diff(wanted, axis=0)).max(axis=1) > _SAME_POSE)
    if jumps.size:
        logged = log.reference[:, [0, 1, 4]]
        rows = np.flatnonzero(np.abs(np.diff(logged, axis=0)).max(axis=1) > _SAME_POSE) + 1
        begins += [
            float(log.t[row]) - float(jumps[0] + 1) * sample_time for row in rows.tolist()[:_MAX_JUMPS]
        ]
    return [begin for begin in begins if begin >= float(log.t[0]) - 0.5 * sample_time]


def _mismatch_fraction(run: Log, wanted: NDArray[np.float64], begin: float, sample_time: float) -> float:
    """Return the share of a run's rows whose reference is not the course's."""
    rows = np.clip(np.round((run.t - begin) / sample_time).astype(int), 0, len(wanted) - 1)
    apart = np.abs(run.reference[:, [0, 1, 4]] - wanted[rows]).max(axis=1)
    return float(np.mean(apart > _SAME_POSE))


def _quantity_result(name: str, predicted: PredictionInterval, value: float) -> QuantityResult:
    return QuantityResult(name=name, predicted=predicted, value=value, place=predicted.place(value))


def _recommended(
    prediction: Prediction, quantities: Sequence[QuantityResult], ended: str | None
) -> tuple[Recommendation, str]:
    if ended is not None:
        return "revert", f"The run ended before the course did ({ended})."
    by_name = {one.name: one for one in quantities}
    peak = by_name["peak_error"]
    without = None if prediction.controller == "none" else prediction.none
    none = without["peak_error"] if without else None
    if none is not None and not peak.value < none.low:
        return "revert", (
            f"The peak error is {1e3 * peak.value:.3g} mm, not clearly smaller than with the nominal gain "
            f"without compensation ({1e3 * none.median:.3g} mm predicted, 95 % interval from {1e3 * none.low:.3g} mm)."
        )
    worse = [one for one in quantities if one.worse]
    better = [one for one in quantities if one.place != "inside" and not one.worse]
    if worse:
        still = (
            ", and the peak error is still clearly smaller than with the nominal gain without compensation"
            if none
            else ""
        )
        return "revert" if CANDIDATES[prediction.controller][1] == "none" else "weaken", (
            f"The {_listed(worse)} {'is' if len(worse) == 1 else 'are'} worse than predicted{still}."
        )
    if better:
        are = "is" if len(better) == 1 else "are"
        return "keep", f"Nothing is worse than predicted, and the {_listed(better)} {are} better."
    return "keep", "All quantities lie inside their prediction intervals."


def _listed(quantities: Sequence[QuantityResult]) -> str:
    return every(QUANTITY_NAMES[one.name] for one in quantities)


def _rows_before_a_fall(run: Log, ended: bool) -> int:
    return int(np.searchsorted(run.t, float(run.t[-1]) - _FALL)) if ended else len(run)


def _short_run(run: Log, ended: bool) -> tuple[Finding, ...]:
    """Return a warning if the rows compared are too short to separate the parts of the torque."""
    duration = _rows_before_a_fall(run, ended) * run.sample_time
    if duration > SEPARABLE - _SHORT:
        return ()
    text = (
        f"The causes come from {duration:.3g} s of the run. So short a run does not separate gain, friction and "
        f"constants of the torque, so that a cause from one of them is not reliable; {SEPARABLE:g} s do. Predict and "
        "record a longer course."
    )
    return (warning("short-run", text),)


def _warnings(log: Log, controller: Controller) -> tuple[Finding, ...]:
    share = foreign_torque(log, controller)
    if share <= _NOT_ITS_OWN:
        return ()
    text = (
        f"The torques are not those that the controller gives for the logged states (RMS difference {100 * share:.0f} "
        "% of the torques): the log may have been made with another controller, or begin in the middle of a run."
    )
    return (warning("foreign-torque", text),)
