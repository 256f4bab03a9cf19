"""The verdict of the next log on a prediction: confirmed or refuted, by how much and in which quantity, and what to do.

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
from ballbot.results import reported
from ballbot.robot import Robot
from ballbot.rounding import percent
from ballbot.workflows.controller_choice import CANDIDATES
from ballbot.workflows.controller_differences import Difference, differences, signature_of
from ballbot.workflows.controller_prediction import Prediction, PredictionInterval, checksum_of
from ballbot.workflows.metrics import QUANTITIES, Performance, rms

Recommendation = Literal["keep", "weaken", "revert"]


@dataclass(frozen=True)
class Quantity:
    """A number of `Performance` as sentences and tables show it."""

    words: str
    scale: float  #: from SI to the unit
    unit: str
    decimals: int
    better: Literal["below", "above"] = "below"

    def shown(self, value: float) -> str:
        """Return a value in the unit, without it."""
        return f"{self.scale * value:.{self.decimals}f}" if np.isfinite(value) else "–"


SHOWN: Mapping[str, Quantity] = MappingProxyType(
    {
        "peak_error": Quantity("peak error", 1e3, "mm", 1),
        "rms_error": Quantity("RMS error", 1e3, "mm", 1),
        "roughness": Quantity("torque roughness", 1.0, "N m", 3),
        "lean": Quantity("lean", 1.0, "rad", 3),
        "torque_margin": Quantity("torque margin", 1e2, "%", 0, better="above"),
    }
)
#: errors of a log's checks that describe the robot's motion: the verdict is about them, and is given all the same
EXPLAINED_CODES = frozenset(
    {
        *(
            "ball-axes",
            "degrees",
            "heading-sign",
            "lean-axes",
            "lean-scale",
            "scale",
            "sign",
            "swapped",
            "wheels",
        ),
        *("torque-order", "torque-scale", "torque-sign", "torque-unrelated", "torque-clipped", "dead-motor"),
        *("constant", "held", "lean-offset", "reset", "spike", "stuck", "torque-delay"),
        *("fall", "hands", "saturation", "disturbance"),
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
        return self.place not in ("inside", SHOWN[self.name].better)

    @reported
    def factor(self) -> float:
        """Its size over that at the end of the interval that it is beyond; of the torque margin, the size is the share
        of the torque limit that is used. One inside the interval, NaN without a value.
        """
        ends = {"inside": self.value, "below": self.predicted.low, "above": self.predicted.high}
        size, end = self.value, ends[self.place]
        if self.name == "torque_margin":
            size, end = 1.0 - size, 1.0 - end
        return size / end if end > 0.0 else np.nan


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The verdict of one log on a controller."""

    recommendation: Recommendation
    reason: str  #: in sentences: confirmed or refuted, by how much and in which quantity
    quantities: tuple[QuantityResult, ...]
    none: Mapping[str, PredictionInterval] | None  #: predicted without compensation; None if that falls
    ended: str | None  #: why the run ended before the course, or None
    differences: tuple[Difference, ...]  #: from the predicted run, the largest first
    findings: tuple[Finding, ...]  #: limits of the verdict

    @property
    def confirmed(self) -> bool:
        """Whether the whole course was run, and no quantity is worse than predicted."""
        return self.ended is None and not any(one.worse for one in self.quantities)

    @property
    def outside(self) -> tuple[QuantityResult, ...]:
        """The quantities that lie outside their intervals."""
        return tuple(one for one in self.quantities if one.place != "inside")


def evaluate_log(prediction: Prediction, log: Log, robot: Robot, controller: Controller) -> Verdict:
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
    quantities = tuple(
        QuantityResult(name=name, predicted=one, value=values[name], place=one.place(values[name]))
        for name, one in ((name, prediction.chosen[name]) for name in QUANTITIES)
    )
    rows = len(run) if ended is None else int(np.searchsorted(run.t, float(run.t[-1]) - _FALL))
    measured = signature_of(run.select(slice(0, rows)), robot) if rows > 1 else {}
    recommendation, reason = _recommended(prediction, quantities, ended)
    return Verdict(
        recommendation=recommendation,
        reason=reason,
        quantities=quantities,
        none=prediction.none,
        ended=ended,
        differences=differences(measured, prediction.signature),
        findings=_warnings(log, controller),
    )


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
    reference = course.reference_spec.reference()
    wanted = np.array(
        [reference(k * sample_time)[[0, 1, 4]] for k in range(round(course.duration / sample_time))]
    )
    logged = log.reference[:, [0, 1, 4]]
    begins = [float(log.t[0])]
    jumps = _jumps(wanted)
    if jumps.size:  # the course may begin later, where its first jump is the log's
        begins += (log.t[_jumps(logged)[:_MAX_JUMPS]] - float(jumps[0]) * sample_time).tolist()
    best, most = None, 0.0
    for begin in begins:
        first, last = np.searchsorted(log.t, begin + np.array([-0.5, len(wanted) - 0.5]) * sample_time)
        rows = np.round((log.t[first:last] - begin) / sample_time).astype(int)
        if len(rows) < 2 or begin < float(log.t[0]) - 0.5 * sample_time:
            continue
        apart = np.abs(logged[first:last] - wanted[np.clip(rows, 0, len(wanted) - 1)]).max(axis=1)
        share = float(np.mean(apart > _SAME_POSE))
        # the most rows that fit: one that begins near the log's end has few, and they fit easily
        if share <= _OTHER_ROWS and (1.0 - share) * len(rows) > most:
            best, most = log.select(slice(first, last)), (1.0 - share) * len(rows)
    if best is None:
        raise InputError(
            f"The log's reference is not the course {course.name!r} for which the performance is predicted; {how}."
        )
    return best


def _jumps(poses: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the rows of poses (N, 3) at which they have jumped."""
    return np.flatnonzero(np.abs(np.diff(poses, axis=0)).max(axis=1) > _SAME_POSE) + 1


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


def _recommended(
    prediction: Prediction, quantities: Sequence[QuantityResult], ended: str | None
) -> tuple[Recommendation, str]:
    """Return what to do, and whether the prediction is confirmed, by how much and in which quantity."""
    if ended is not None:
        return "revert", f"Refuted: the run ended before the course did ({ended})."
    worse = [one for one in quantities if one.worse]
    better = [one for one in quantities if one.place != "inside" and not one.worse]
    peak = quantities[QUANTITIES.index("peak_error")].value
    none = prediction.none["peak_error"] if prediction.none and prediction.controller != "none" else None
    if worse:
        reason = f"Refuted: {every([_amount(one) for one in worse])}."
    elif better:
        names, are = every([SHOWN[one.name].words for one in better]), "is" if len(better) == 1 else "are"
        reason = f"Confirmed: nothing is worse than predicted, and the {names} {are} better."
    else:
        reason = "Confirmed: all quantities lie inside their 95 % prediction intervals."
    if none is not None and not peak < none.low:
        return "revert", (
            f"{reason} The peak error of {1e3 * peak:.3g} mm is not clearly smaller than with the nominal gain without "
            f"compensation ({1e3 * none.median:.3g} mm predicted, 95 % interval from {1e3 * none.low:.3g} mm)."
        )
    if worse and CANDIDATES[prediction.controller][1] == "none":
        return "revert", reason
    if worse and none:
        reason += " The peak error is still clearly smaller than with the nominal gain without compensation."
    return ("weaken" if worse else "keep"), reason


def _amount(one: QuantityResult) -> str:
    """Return by how much a quantity is worse than predicted, in words."""
    shown, interval = SHOWN[one.name], one.predicted
    value = f"the {shown.words} is {shown.shown(one.value)} {shown.unit}"
    if one.name == "torque_margin":
        return f"{value}, predicted {shown.shown(interval.low)} {shown.unit} or more"
    return f"{value}, {one.factor:.2g} times the upper end of its interval"


def _warnings(log: Log, controller: Controller) -> tuple[Finding, ...]:
    share = foreign_torque(log, controller)
    if share <= _NOT_ITS_OWN:
        return ()
    text = (
        f"The torques are not those that the controller gives for the logged states (RMS difference {100 * share:.0f} "
        "% of the torques): the log may have been made with another controller, or begin in the middle of a run."
    )
    return (warning("foreign-torque", text),)
