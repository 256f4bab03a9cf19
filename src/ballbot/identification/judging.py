"""An identification judged on a log that it never saw: open-loop errors with its friction and without.

They are those of windows as long as those of the fit, all samples together; and, for the wheels' speeds and the lean,
those by how long ago the prediction began.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ballbot.errors import InputError
from ballbot.identification.back_emf import standstill_torques
from ballbot.identification.horizons import HorizonErrors, Starts, horizon_errors
from ballbot.identification.play import Chatter, chatter, chatter_remark
from ballbot.identification.result import Identification, WindowErrors
from ballbot.identification.stages import errors, windows_for
from ballbot.log import Log

#: a log asks for another friction where the share of it that it wants is off 1 by so much, and by so many errors
_DIFFERS, _SURE = 0.2, 3.0


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What an identification is worth on one log."""

    name: str  #: of the log
    errors: WindowErrors
    horizons: tuple[HorizonErrors, ...]  #: none where no stretch of the log is as long as the longest
    causal: bool  #: whether their predictions start from what was known by then, and not from the log's rows
    chatter: Chatter
    remarks: tuple[str, ...]  #: the states that friction does not help to predict, and why, in sentences

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        by_horizon = [one.to_dict() for one in self.horizons]
        return {
            "errors": self.errors.to_dict(),
            "ratios": self.errors.ratios,
            "horizons": {"causal_starts": self.causal, "errors": by_horizon},
            "remarks": list(self.remarks),
        }


def judge(found: Identification, log: Log, *, name: str, starts: Starts | None = None) -> Judged:
    """Predict windows of a log with what was found, as long as those of the fit, and without friction.

    Parameters
    ----------
    name : str
        What to call the log.
    starts : callable, optional
        The states known at times of its rows, from which the predictions by horizon start, as
        `ballbot.log.causal.causal_states` gives them for a log from elsewhere; by default those of its rows.

    Raises
    ------
    InputError
        Where the log lacks a column or has no window.
    """
    predictor = found.predictor
    windows = windows_for(
        predictor,
        found.values,
        [standstill_torques(log, predictor.robot, predictor.back_emf)],
        duration=found.window,
    )
    if not len(windows):
        raise InputError(f"{name} has no window of {found.window:g} s without gaps or missing values.")
    judged = errors(predictor, windows, found.values)
    worse = [state for state, ratio in judged.ratios.items() if not ratio < 1.0]
    moved = chatter(log, predictor.robot)
    horizons = horizon_errors(predictor, found.values, log, starts=starts)
    remarks = [
        f"In {name}, {state} is not predicted better with friction than without "
        f"(error ratio {judged.ratios[state]:.2f})."
        for state in worse
    ]
    remarks += _share_remarks(name, horizons)
    if moved.matters:
        remarks.append(chatter_remark(moved, predictor.robot, name))
    return Judged(
        name=name,
        errors=judged,
        horizons=horizons,
        causal=starts is not None,
        chatter=moved,
        remarks=tuple(remarks),
    )


def _share_remarks(name: str, horizons: Sequence[HorizonErrors]) -> list[str]:
    """Return a sentence where a log asks for clearly more or less friction than was found.

    The shortest horizon is asked: after it, whatever else moves an unstable robot has grown.
    """
    if not horizons:
        return []
    speed, lean = horizons[0].wheel_speed, horizons[0].lean
    off = abs(speed.share - 1.0)
    # NaN, where there are too few starts to be sure, is never beyond a bound
    if not (off > _DIFFERS and off > _SURE * speed.share_error):
        return []
    word = "less" if speed.share < 1.0 else "more"
    return [
        f"{name} needs {word} friction than was identified: over {horizons[0].horizon:.2g} s its wheels "
        f"need {speed.share:.2f} +- {speed.share_error:.2f} times as much, its lean {lean.share:.2f} +- "
        f"{lean.share_error:.2f} times. The friction was different when the logs were made, or times in "
        "one of them are wrong. Fit both together for a mean, or each by itself."
    ]
