"""The rows of the report's tables, as texts."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from ballbot.fitting.intervals import Interval
from ballbot.identification.quantities import BY_NAME
from ballbot.identification.result import Identification
from ballbot.log import STATE_NAMES
from ballbot.validation import ErrorPair
from ballbot.workflows.comparison import MedianEstimate
from ballbot.workflows.controller_choice import ControllerChoice

#: what a friction parameter is, by its symbol: name in words and unit
_MEANINGS = {
    "b": ("viscous", "N m s/rad"),
    "c": ("Coulomb (dry, at speed)", "N m"),
    "s": ("Stribeck (break-away above Coulomb)", "N m"),
    "v_s": ("Stribeck speed", "rad/s"),
    "delta": ("Stribeck exponent", "1"),
    "C_rr": ("rolling, ball on floor", "1"),
}
#: candidates and on-board states in words
CANDIDATE_NAMES = {
    "none": "nominal, no compensation",
    "full": "nominal, full compensation",
    "partial": "nominal, partial compensation",
    "precise": "precise",
}
STATE_WORDS = {"onboard": "the thesis's on-board state", "kalman": "the Kalman filter's state"}
ESTIMATOR_NAMES = {"onboard": "the thesis's", "kalman": "Kalman filter"}
SYMBOL_MARKS = {"v_s": "v<sub>s</sub>", "delta": "δ", "C_rr": "C<sub>rr</sub>"}

_STATE_NAME = re.compile(r"\b(?P<residual>e_)?(?P<state>(?:theta|phi|psi|x|y)(?:_dot)?)\b")

STATE_MARKS = {
    "x": "x",
    "y": "y",
    "theta": "θ",
    "phi": "φ",
    "psi": "ψ",
}


@dataclass(frozen=True, kw_only=True)
class ParameterRow:
    """A line of the table of friction parameters."""

    symbol: str  #: HTML
    meaning: str
    unit: str
    values: tuple[str, ...]  #: one, or one for each wheel
    intervals: tuple[str, ...]  #: 95 %, under the conditions of these logs
    predictions: tuple[str, ...]  #: 95 %, for the estimate from another log


@dataclass(frozen=True, kw_only=True)
class ErrorRow:
    """A line of Table 4.1 or 4.2, with what they lack."""

    state: str
    unit: str
    first: str  #: 1000 times (4.1), of the first model
    second: str
    ratio: str
    interval: str
    verdict: str  #: of the first model; a dash with too few runs
    rmse_first: str
    rmse_second: str
    normalised_first: str
    normalised_second: str


@dataclass(frozen=True, kw_only=True)
class CandidateRow:
    """A controller on the perturbed plants; errors in millimetres."""

    name: str
    estimator: str
    peak: str  #: median
    interval: str  #: of the median, 95 %
    worst: str
    rms: str
    roughness: str
    falls: str
    gain: str  #: how many times smaller than the first candidate's


@dataclass(frozen=True, kw_only=True)
class AblationRow:
    """The precise controller without one part."""

    part: str
    peak: str  #: median [mm]
    ratio: str  #: to the whole controller's, with its interval
    roughness: str
    falls: str
    reading: str  #: its meaning, in a word or two


def parameter_rows(found: Identification) -> list[ParameterRow]:
    """Return the friction parameters with their standard errors and both intervals."""
    rows = []
    for name, (symbol, value) in zip(found.layout.names, found.parameters.items(), strict=True):
        meaning, unit = _MEANINGS[symbol]
        values, errors = np.atleast_1d(value), np.atleast_1d(found.standard_errors[symbol])
        labels = BY_NAME[name].labels(found.layout.wheel_count)
        rows.append(
            ParameterRow(
                symbol=SYMBOL_MARKS.get(symbol, symbol),
                meaning=meaning,
                unit=unit,
                values=tuple(with_error(float(v), float(e)) for v, e in zip(values, errors, strict=True)),
                intervals=tuple(interval_text(found.intervals.get(label)) for label in labels),
                predictions=tuple(interval_text(found.variation.predictions.get(label)) for label in labels),
            )
        )
    return rows


def interval_text(interval: Interval | None) -> str:
    """Return an interval's ends; "open" for a side that the logs do not limit, empty without an interval."""
    if interval is None:
        return ""
    lower, upper = (digits(end) if math.isfinite(end) else "open" for end in (interval.lower, interval.upper))
    return f"{lower} .. {upper}"


def error_rows(pair: ErrorPair, units: dict[str, str]) -> list[ErrorRow]:
    """Return the errors of each state: (4.1), their ratio with a 95 % interval and its meaning, and RMSE."""
    lower, upper = pair.ratio_interval()
    normalised, verdicts = pair.normalised_rmse, pair.verdicts()
    rows = []
    for i, name in enumerate(STATE_NAMES):
        known = bool(np.isfinite(lower[i]))
        rows.append(
            ErrorRow(
                state=state_mark(name),
                unit=units[name],
                first=digits(1e3 * pair.first.error[i]),
                second=digits(1e3 * pair.second.error[i]),
                ratio=digits(pair.ratio[i]),
                interval=f"{digits(lower[i])} – {digits(upper[i])}" if known else "too few runs",
                verdict=verdicts[i] if known else "–",
                rmse_first=digits(pair.first.rmse[i]),
                rmse_second=digits(pair.second.rmse[i]),
                normalised_first=digits(normalised[0, i], 2),
                normalised_second=digits(normalised[1, i], 2),
            )
        )
    return rows


def candidate_rows(choice: ControllerChoice) -> list[CandidateRow]:
    """Return the candidates' errors, roughness and falls."""
    first = choice.trials["none"]
    rows = []
    for name, trial in choice.trials.items():
        peak = trial.peak
        gain = first.ratio_to(trial)
        rows.append(
            CandidateRow(
                name=CANDIDATE_NAMES[name],
                estimator=ESTIMATOR_NAMES[trial.controller.estimator],
                peak=millimetres(peak.median),
                interval=f"{millimetres(peak.low)} – {millimetres(peak.high)}",
                worst=millimetres(float(np.nan_to_num(trial.peaks, nan=-np.inf).max())),
                rms=millimetres(trial.rms.median),
                roughness=digits(trial.roughness.median),
                falls=f"{trial.falls} of {len(trial.scores)}",
                gain="–" if name == "none" else f"{digits(gain.median)} ×",
            )
        )
    return rows


def ablation_rows(choice: ControllerChoice) -> list[AblationRow]:
    """Return what the precise controller is without each of its parts."""
    rows = []
    for part, trial in choice.ablation.items():
        ratio = choice.share_of(part)
        rows.append(
            AblationRow(
                part=part,
                peak=millimetres(trial.peak.median),
                ratio=f"{digits(ratio.median)} ({digits(ratio.low)} – {digits(ratio.high)})",
                roughness=digits(trial.roughness.median),
                falls=f"{trial.falls} of {len(trial.scores)}",
                reading=_reading(trial.falls > _falls_of_whole(choice), ratio),
            )
        )
    return rows


def _falls_of_whole(choice: ControllerChoice) -> int:
    """Return the falls of the whole precise controller on the plants of the ablation."""
    plants = max(len(trial.scores) for trial in choice.ablation.values())
    return sum(one.ended is not None for one in choice.trials["precise"].scores[:plants])


def _reading(falls_more: bool, ratio: MedianEstimate) -> str:
    if falls_more:
        return "needed: it falls without"
    if not has_confidence(ratio):
        return "too few draws for a verdict"
    if ratio.low > 1.0:
        return "lowers the error"
    return "raises the error" if ratio.high < 1.0 else "no clear difference"


def interval_words(estimate: MedianEstimate) -> str:
    """Return a median's interval in words; of fewer than six values the range, which is no 95 % interval."""
    bounds = f"{digits(estimate.low)} to {digits(estimate.high)}"
    return f"95 % interval {bounds}" if has_confidence(estimate) else f"{bounds} in {estimate.runs} draws"


def has_confidence(estimate: MedianEstimate) -> bool:
    """Return whether the interval is one of 95 %: the range of fewer than six values is not."""
    return estimate.runs >= 6


def millimetres(metres: float) -> str:
    """Return a length in millimetres with three digits; a dash if it is not a number."""
    return digits(1e3 * metres)


def digits(value: float, count: int = 3) -> str:
    """Return a number with that many significant digits and no exponent; a dash where it is none."""
    if not np.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    leading = int(np.floor(np.log10(abs(value))))
    places = max(0, count - 1 - leading)
    return f"{round(value, count - 1 - leading):.{places}f}"


def with_error(value: float, error: float) -> str:
    """Return a value and its standard error, both to the error's second digit."""
    if not np.isfinite(value):
        return "not identified by these logs"
    if not (np.isfinite(error) and error > 0.0):
        return f"{digits(value)} (no standard error)"
    places = max(0, 1 - int(np.floor(np.log10(error))))
    return f"{value:.{places}f} ± {error:.{places}f}"


def with_symbols(words: str) -> str:
    """Return a sentence with the log's names of states (theta_dot, e_x) as the thesis's symbols."""
    return _STATE_NAME.sub(_symbol, words)


def _symbol(match: re.Match[str]) -> str:
    mark = state_mark(match["state"])
    return f"ε({mark})" if match["residual"] else mark


def state_mark(name: str) -> str:
    """Return a state as the thesis prints it, in Unicode: a rate has a dot above."""
    base = name.removesuffix("_dot")
    return STATE_MARKS[base] + ("\u0307" if name.endswith("_dot") else "")
