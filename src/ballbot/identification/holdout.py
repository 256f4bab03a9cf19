"""Validation of an identification on a log that it was not fitted to, by window and by horizon.

Windows are as long as those of the fit. The errors by horizon are those of wheel speeds, as the encoders have them, and
of the lean. The log also shows how much of the identified friction it needs: with e_0 the errors without friction and
d = e_0 - e the effect of friction on the prediction, the factor on d that minimises the squared errors is

    a = (sum e_0 d) / (sum d^2)

It is 1 if the log has the identified friction, and less if it has less. Errors without relation to friction do not
change it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.findings import Finding, by_severity, warning
from ballbot.identification.excitation import chatter_findings
from ballbot.identification.prediction import Predictor, WindowErrors, window_errors, windows_for
from ballbot.identification.result import Identification
from ballbot.identification.result_findings import prediction_findings
from ballbot.identification.rollers import as_its_friction
from ballbot.identification.windows import COMPARISONS, standstill_torques
from ballbot.log import STATE_NAMES, Log, LogLike, as_log
from ballbot.log.pose import measured_wheel_speeds, without_encoder_lag
from ballbot.mechanics.model import Model
from ballbot.results import key
from ballbot.rounding import plus_minus

#: [s]
HORIZONS = (0.1, 0.25, 0.5)

#: blocks of neighbouring starts in the jackknife
_BLOCKS = 10
_HALF = len(STATE_NAMES) // 2
_LEANS = [STATE_NAMES.index("theta"), STATE_NAMES.index("phi")]


@dataclass(frozen=True)
class FrictionErrors:
    """Root mean square errors of predictions, over all starts and wheels, or over both lean angles."""

    with_friction: float
    viscous_part: float  #: with the viscous part of the friction alone
    without_friction: float  #: with the back-EMF alone if motors are driven by voltage
    share: float  #: factor a on the effect of friction
    share_error: float  #: its standard error, by a jackknife over blocks of starts; NaN if there are too few


@dataclass(frozen=True, kw_only=True)
class FrictionAtHorizon:
    """Effect of friction on the errors at one horizon."""

    horizon: float = field(metadata=key("horizon_s"))  #: a whole number of rows [s]
    starts: int  #: number of predictions with a value there
    wheel_speed: FrictionErrors = field(metadata=key("wheel_speed_rmse"))  #: [rad/s]
    lean: FrictionErrors = field(metadata=key("lean_rmse"))  #: theta and phi [rad]


def friction_by_horizon(predictor: Predictor, values: Floats, log: Log) -> tuple[FrictionAtHorizon, ...]:
    """Return the effect of friction, by parameters (p,), on the errors at each horizon.

    The predictions start from the states in the log's rows, at intervals of the longest horizon, so that they do not
    overlap. The log has no lag of its encoders (`without_encoder_lag`). If motors are driven by voltage, its torques
    contain their back-EMF.
    """
    sample_time, layout = log.sample_time, predictor.layout
    # windows are rounded to a multiple of COMPARISONS samples; half of that more keeps the longest horizon inside
    duration = max(HORIZONS) + 0.5 * COMPARISONS * sample_time
    supplied = standstill_torques(log, predictor.robot, predictor.back_emf)
    windows = windows_for(predictor, values, [supplied], duration=duration)
    if not len(windows):
        return ()
    viscous = layout.without_friction(values, keep=("viscous",))
    sets = np.stack([values, viscous, layout.without_friction(values)])
    residuals = np.concatenate([*predictor.in_chunks(sets, windows)], axis=1)
    states, model = residuals + windows.measured, Model(predictor.robot)
    first = np.searchsorted(log.t, [span.start - 0.5 * sample_time for span in windows.spans])
    measured, effects = measured_wheel_speeds(log, predictor.robot), []
    for horizon in HORIZONS:
        after = max(1, round(horizon / sample_time))
        at = states[:, :, after - 1]
        speeds = model.wheel_speed(at[..., :_HALF], at[..., _HALF:]) - measured[first + after]
        leans = residuals[:, :, after - 1, _LEANS]
        # a prediction in which the robot falls has no value, and neither has an encoder that was not read
        known = np.isfinite(np.concatenate([speeds, leans], axis=2)).all(axis=(0, 2))
        if known.any():
            effect = FrictionAtHorizon(
                horizon=after * sample_time,
                starts=int(known.sum()),
                wheel_speed=_errors(speeds[:, known]),
                lean=_errors(leans[:, known]),
            )
            effects.append(effect)
    return tuple(effects)


def _errors(differences: Floats) -> FrictionErrors:
    """Return the errors from differences (3, w, k) with friction, with its viscous part, and without."""
    with_friction, viscous, without = np.sqrt((differences**2).mean(axis=(1, 2))).tolist()
    effect = differences[2] - differences[0]
    products, squares = (differences[2] * effect).sum(axis=1), (effect**2).sum(axis=1)
    share = error = float("nan")
    if squares.any():
        share = float(products.sum() / squares.sum())
        blocks = np.array_split(np.arange(len(squares)), _BLOCKS)
        left = np.array(
            [(products.sum() - products[b].sum(), squares.sum() - squares[b].sum()) for b in blocks]
        )
        if len(squares) >= 2 * _BLOCKS and left[:, 1].all():
            error = float(np.sqrt((_BLOCKS - 1) * (left[:, 0] / left[:, 1]).var()))
    return FrictionErrors(with_friction, viscous, without, share, error)


#: the friction differs if its factor differs from 1 by this much and by this many standard errors
_DIFFERS, _SIGNIFICANT = 0.2, 3.0


@dataclass(frozen=True, kw_only=True)
class HoldoutResult:
    """Errors of an identification on one log."""

    name: str  #: of the log
    errors: WindowErrors
    horizons: tuple[FrictionAtHorizon, ...]  #: empty if the log is too short
    findings: tuple[Finding, ...]  #: states that friction does not help to predict, and reasons

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "errors": self.errors,
            "with_over_without": self.errors.with_over_without,
            "horizons": {"errors": self.horizons},
            "findings": by_severity(self.findings),
        }


def cross_validate(found: Identification, log: LogLike, *, name: str) -> HoldoutResult:
    """Predict windows of a log, as long as those of the fit, with the identified parameters and without friction.

    InputError if the log lacks a column or has no window.

    Parameters
    ----------
    found : Identification
    log : Log or log file
    name : str
        The log's name in the results.

    Examples
    --------
    >>> import ballbot
    >>> robot = ballbot.Robot.load("alten").replace({"friction.coulomb": 0.1})
    >>> square, other = (ballbot.simulate(robot, "nominal", "square", duration=12.0, seed=seed) for seed in (1, 2))
    >>> found = ballbot.identify("alten", square, law="coulomb", window=0.1)
    >>> cross_validate(found, other, name="other").errors.with_over_without["theta"] < 0.01
    True
    """
    predictor, log = found.predictor, as_log(log)
    log = as_its_friction(without_encoder_lag(log, predictor.robot), found.robot)
    supplied = standstill_torques(log, predictor.robot, predictor.back_emf)
    windows = windows_for(predictor, found.values, [supplied], duration=found.window)
    if not len(windows):
        raise InputError(f"{name} has no window of {found.window:g} s without gaps or missing values.")
    errors = window_errors(predictor, windows, found.values)
    horizons = friction_by_horizon(predictor, found.values, log)
    return HoldoutResult(
        name=name,
        errors=errors,
        horizons=horizons,
        findings=(
            *prediction_findings(errors.with_over_without, of=name),
            *_share_findings(name, horizons),
            *chatter_findings(log, predictor.robot, name),
        ),
    )


def _share_findings(name: str, horizons: Sequence[FrictionAtHorizon]) -> list[Finding]:
    """Return a warning if a log needs clearly more or less friction than was identified, by the shortest horizon."""
    if not horizons:
        return []
    speed, lean = horizons[0].wheel_speed, horizons[0].lean
    off = abs(speed.share - 1.0)
    # the error is NaN with too few starts; then no comparison holds
    if not (off > _DIFFERS and off > _SIGNIFICANT * speed.share_error):
        return []
    word = "less" if speed.share < 1.0 else "more"
    text = (
        f"{name} needs {word} friction than was identified: over {horizons[0].horizon:.2g} s its wheel speeds "
        f"need {plus_minus(speed.share, speed.share_error)} times as much, its lean "
        f"{plus_minus(lean.share, lean.share_error)} times. The friction differed between the logs, or the times in "
        "one of them are wrong. Fit both logs together for a mean, or each by itself."
    )
    return [warning("friction-differs", text)]
