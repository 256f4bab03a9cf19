"""Validation of an identification on a log that it was not fitted to, by window and by horizon.

Windows are as long as those of the fit. The errors by horizon are those of the wheels' speeds and the lean after a
tenth, a quarter and half a second. The speeds are compared with the encoders' where the log has them, so that what the
model does not have, as a ball that pivots on the floor, counts as an error too.

Beside the errors it is estimated how much of the friction the log needs. With e_0 the errors without friction and d =
e_0 - e what friction makes of the prediction, the share of d that leaves the least squares is

    a = (sum e_0 d) / (sum d^2)

It is 1 if the log has the model's friction, and less if it has less. It separates a friction that has changed from one
log to the next, a < 1 for speeds and lean alike, from errors that have nothing to do with friction, which leave a as it
is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.findings import Finding, finding_results, warning
from ballbot.identification.excitation import chatter_findings
from ballbot.identification.prediction import Predictor, WindowErrors, window_errors, windows_for
from ballbot.identification.result import Identification
from ballbot.identification.result_findings import prediction_findings
from ballbot.identification.windows import COMPARISONS, standstill_torques
from ballbot.log import STATE_NAMES, Log, LogLike, as_log
from ballbot.log.checks.kinematics import measured_wheel_speeds
from ballbot.log.pose import without_encoder_lag
from ballbot.mechanics.model import Model
from ballbot.results import key
from ballbot.rounding import plus_minus

#: [s]
HORIZONS = (0.1, 0.25, 0.5)

#: from times of rows (m,) [s] to states (m, 10), NaN if unknown
InitialStates = Callable[[NDArray[np.float64]], NDArray[np.float64]]

#: blocks of neighbouring starts of the jackknife
_BLOCKS = 10
_HALF = len(STATE_NAMES) // 2
_LEANS = [STATE_NAMES.index("theta"), STATE_NAMES.index("phi")]


@dataclass(frozen=True, kw_only=True)
class FrictionErrors:
    """Root mean square errors of predictions, over all starts and all wheels, or both leans."""

    with_friction: float
    viscous_part: float  #: with the viscous part of the friction found alone
    without_friction: float  #: with the back-EMF alone, where motors are driven by voltage
    share: float  #: of the friction's effect that would leave the least error
    share_error: float  #: its standard error, by a jackknife over blocks of starts; NaN if there are too few


@dataclass(frozen=True, kw_only=True)
class FrictionAtHorizon:
    """Effect of friction on the errors at one horizon."""

    horizon: float = field(metadata=key("horizon_s"))  #: of a whole number of rows [s]
    starts: int  #: how many predictions have a value there
    wheel_speed: FrictionErrors = field(metadata=key("wheel_speed_rmse"))  #: [rad/s]
    lean: FrictionErrors = field(metadata=key("lean_rmse"))  #: theta and phi [rad]


def friction_by_horizon(
    predictor: Predictor, values: NDArray[np.float64], log: Log, *, starts: InitialStates | None = None
) -> tuple[FrictionAtHorizon, ...]:
    """Return the effect of friction (p,) on the errors at each horizon at which some prediction has a value.

    The predictions begin one longest horizon after another, so that they do not overlap, from the states in the log's
    rows or what `starts` gives. Where motors are driven by voltage, the log has the torques less the back-EMF's.
    """
    sample_time, layout = log.sample_time, predictor.layout
    # windows are cut to a multiple of so many samples: half of that more, so that the longest horizon is within
    duration = max(HORIZONS) + 0.5 * COMPARISONS * sample_time
    log = without_encoder_lag(log, predictor.robot)
    supplied = standstill_torques(log, predictor.robot, predictor.back_emf)
    windows = windows_for(predictor, values, [supplied], duration=duration)
    initial = windows.initial if starts is None else starts(np.array([span.start for span in windows.spans]))
    known = np.flatnonzero(np.isfinite(initial).all(axis=1))
    if not known.size:
        return ()
    windows, initial = windows.take(known), initial[known]
    viscous = layout.without_friction(values, keep=("viscous",))
    sets = np.stack([values, viscous, layout.without_friction(values)])
    residuals = np.concatenate([*predictor.in_chunks(sets, windows, starts=initial)], axis=1)
    states, model = residuals + windows.measured, Model(predictor.robot)
    first = np.searchsorted(log.t, [span.start - 0.5 * sample_time for span in windows.spans])
    measured, found = measured_wheel_speeds(log, predictor.robot), []
    for horizon in HORIZONS:
        after = max(1, round(horizon / sample_time))
        at = states[:, :, after - 1]
        speeds = model.wheel_speed(at[..., :_HALF], at[..., _HALF:]) - measured[first + after]
        leans = residuals[:, :, after - 1, _LEANS]
        # a robot that fell in a prediction has no value there, nor an encoder that was not read
        known = np.isfinite(np.concatenate([speeds, leans], axis=2)).all(axis=(0, 2))
        if known.any():
            found.append(
                FrictionAtHorizon(
                    horizon=after * sample_time,
                    starts=int(known.sum()),
                    wheel_speed=_errors(speeds[:, known]),
                    lean=_errors(leans[:, known]),
                )
            )
    return tuple(found)


def _errors(differences: NDArray[np.float64]) -> FrictionErrors:
    """Return what differences (3, w, k) with friction, with its viscous part and without make."""
    with_friction, viscous, without = np.sqrt((differences**2).mean(axis=(1, 2))).tolist()
    share, error = _share(differences[2], differences[2] - differences[0])
    return FrictionErrors(
        with_friction=with_friction,
        viscous_part=viscous,
        without_friction=without,
        share=share,
        share_error=error,
    )


def _share(without: NDArray[np.float64], effect: NDArray[np.float64]) -> tuple[float, float]:
    """Return the share of friction's effect (w, k) that explains most of the errors without it, and its error."""
    products, squares = (without * effect).sum(axis=1), (effect**2).sum(axis=1)
    if not squares.any():
        return float("nan"), float("nan")
    share = float(products.sum() / squares.sum())
    blocks = np.array_split(np.arange(len(squares)), _BLOCKS)
    left = np.array([[products.sum() - products[b].sum(), squares.sum() - squares[b].sum()] for b in blocks])
    if len(squares) < 2 * _BLOCKS or not left[:, 1].all():
        return share, float("nan")
    shares = left[:, 0] / left[:, 1]
    return share, float(np.sqrt((_BLOCKS - 1) * shares.var()))


#: a log needs another friction if its share differs from 1 by this much, and by this many standard errors
_DIFFERS, _SIGNIFICANT = 0.2, 3.0


@dataclass(frozen=True, kw_only=True)
class HoldoutResult:
    """How well an identification predicts one log."""

    name: str  #: of the log
    errors: WindowErrors
    horizons: tuple[FrictionAtHorizon, ...]  #: empty if no interval of the log is as long as the longest
    causal: bool  #: whether their predictions start from causal states, and not from the log's rows
    findings: tuple[Finding, ...]  #: the states that friction does not help to predict, and why

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "errors": self.errors.to_dict(),
            "with_over_without": self.errors.with_over_without,
            "horizons": {"causal_starts": self.causal, "errors": self.horizons},
            "findings": finding_results(self.findings),
        }


def cross_validate(
    found: Identification, log: LogLike, *, name: str, starts: InitialStates | None = None
) -> HoldoutResult:
    """Predict windows of a log with the identified parameters, as long as those of the fit, and without friction.

    InputError if the log lacks a column or has no window.

    Parameters
    ----------
    log : Log or log file
    name : str
        The log's name in the results.
    starts : callable, optional
        The states known at times of its rows, from which the predictions by horizon start, as
        `ballbot.log.pose.causal_states` gives them for a log from elsewhere; by default those of its rows.
    """
    predictor, log = found.predictor, as_log(log)
    log = without_encoder_lag(log, predictor.robot)
    supplied = standstill_torques(log, predictor.robot, predictor.back_emf)
    windows = windows_for(predictor, found.values, [supplied], duration=found.window)
    if not len(windows):
        raise InputError(f"{name} has no window of {found.window:g} s without gaps or missing values.")
    errors = window_errors(predictor, windows, found.values)
    horizons = friction_by_horizon(predictor, found.values, log, starts=starts)
    return HoldoutResult(
        name=name,
        errors=errors,
        horizons=horizons,
        causal=starts is not None,
        findings=(
            *prediction_findings(errors.with_over_without, of=name),
            *_share_findings(name, horizons),
            *chatter_findings(log, predictor.robot, name),
        ),
    )


def _share_findings(name: str, horizons: Sequence[FrictionAtHorizon]) -> list[Finding]:
    """Return a warning if a log needs clearly more or less friction than was found.

    It is taken from the shortest horizon: after it, whatever else moves an unstable robot has grown.
    """
    if not horizons:
        return []
    speed, lean = horizons[0].wheel_speed, horizons[0].lean
    off = abs(speed.share - 1.0)
    # NaN, where there are too few starts to be sure, is never beyond a bound
    if not (off > _DIFFERS and off > _SIGNIFICANT * speed.share_error):
        return []
    word = "less" if speed.share < 1.0 else "more"
    text = (
        f"{name} needs {word} friction than was identified: over {horizons[0].horizon:.2g} s its wheels "
        f"need {plus_minus(speed.share, speed.share_error)} times as much, its lean "
        f"{plus_minus(lean.share, lean.share_error)} times. The friction was different when the logs were made, or "
        "times in one of them are wrong. Fit both together for a mean, or each by itself."
    )
    return [warning("friction-differs", text)]
