"""The rows of the report's tables, as texts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from markupsafe import Markup

from ballbot.fitting.intervals import Interval
from ballbot.identification.quantities import BY_NAME
from ballbot.identification.result import Identification
from ballbot.log import STATE_NAMES
from ballbot.report.blocks import Cell, Sheet
from ballbot.report.words import interval_text, millimetres, state_mark, with_error
from ballbot.rounding import digits
from ballbot.summary import counted
from ballbot.validation import ErrorPair, StateErrors
from ballbot.workflows.comparison import MedianEstimate
from ballbot.workflows.controller_choice import ControllerChoice, Step, Trial
from ballbot.workflows.controller_prediction import MIN_RUNS

#: candidates and on-board states in words
CANDIDATE_NAMES = {
    "none": "nominal, no compensation",
    "full": "nominal, full compensation",
    "partial": "nominal, partial compensation",
    "precise": "precise",
    "precise_without_compensation": "precise without compensation",
}
STATE_WORDS = {"onboard": "the on-board state by integration", "kalman": "the Kalman filter's state"}
ESTIMATOR_NAMES = {"onboard": "integration", "kalman": "Kalman filter"}


@dataclass(frozen=True, kw_only=True)
class ErrorRow:
    """A line of Table 4.1 or 4.2, with what they lack."""

    state: str
    unit: str
    first: str  #: 1000 times the norm over the samples, of the first model
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


def parameter_sheet(found: Identification) -> Sheet:
    """Return the parameters with their standard errors, both intervals and what the robot file has.

    Each wheel has a column. A number that is not of a wheel has a line to itself.
    """
    wheels = found.layout.wheel_count
    labels, before = found.labels, found.layout.nominal(found.predictor.robot)
    values, errors = (
        np.concatenate([np.atleast_1d(one) for one in numbers.values()])
        for numbers in (found.parameters, found.standard_errors)
    )
    both = (
        ("95 %", found.intervals),
        ("95 %, another log", found.another_log),
    )
    rows: list[list[str | Cell]] = []
    for name in found.names:
        quantity, columns = BY_NAME[name], found.layout.columns(name)
        assert columns is not None
        places = range(columns.start, columns.stop)
        for line in (places,) if quantity.each == "wheels" else ((place,) for place in places):
            span = wheels // len(line)

            def cells(texts: Iterable[str], *, span: int = span) -> list[Cell]:
                return [Cell(text=text, span=span) for text in texts]

            symbol = quantity.symbol if quantity.each == "wheels" else labels[line[0]]
            numbers = cells(_value(values[i], errors[i], found.intervals.get(labels[i])) for i in line)
            rows.append([Cell(text=_symbol(symbol), below=quantity.meaning), quantity.unit or "1", *numbers])
            for which, intervals in both:
                ends = [interval_text(intervals.get(labels[i])) for i in line]
                if any(ends):
                    rows.append([Cell(text="", below=which), "", *cells(ends)])
            if found.other is not None:
                there = cells(digits(float(found.other.values[i])) for i in line)
                rows.append([Cell(text="", below="at the other optimum"), "", *there])
            stated = cells(digits(float(before[i])) for i in line)
            rows.append([Cell(text="", below="in the robot file"), "", *stated])
    return Sheet(headings=("parameter", "unit", *(f"wheel {i}" for i in range(1, wheels + 1))), rows=rows)


def _symbol(symbol: str) -> str:
    """Return a symbol as it is printed: v_s with a subscript, delta as the letter."""
    if symbol == "delta":
        return "δ"
    letter, _, index = symbol.partition("_")
    return Markup("{}<sub>{}</sub>").format(letter, index) if index else symbol


def _value(value: float, error: float, interval: Interval | None) -> str:
    """Return a value with its error, or with what it has in place of one; its interval stands below it."""
    if interval is not None and interval.method in ("profile", "at bound"):
        shown = digits(value, beside=interval.upper if math.isfinite(interval.upper) else 0.0)
        return f"{shown} ({'interval only' if interval.method == 'profile' else 'at its bound'})"
    return with_error(value, error)


def error_rows(pair: ErrorPair, units: dict[str, str]) -> list[ErrorRow]:
    """Return the errors of each state: norm over samples, their ratio with a 95 % interval and its meaning, RMSE."""
    lower, upper = pair.ratio_interval()
    normalised, verdicts = pair.normalised_rmse, pair.verdicts()

    def written(errors: StateErrors, place: int) -> tuple[str, str]:
        """Return 1000 times the error, and the RMSE; no digits of what is only rounding."""
        rmse = errors.rmse[place]
        if rmse <= pair.floor[place]:
            return "≈ 0", "≈ 0"
        return digits(1e3 * errors.error[place]), digits(rmse)

    rows = []
    for i, name in enumerate(STATE_NAMES):
        known = bool(np.isfinite(lower[i]))
        (first, rmse_first), (second, rmse_second) = written(pair.first, i), written(pair.second, i)
        rows.append(
            ErrorRow(
                state=state_mark(name),
                unit=units[name],
                first=first,
                second=second,
                ratio=digits(pair.ratio[i]),
                interval=f"{digits(lower[i])} – {digits(upper[i])}" if known else "too few runs",
                verdict=verdicts[i] if known else "–",
                rmse_first=rmse_first,
                rmse_second=rmse_second,
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


STEP_HEADINGS = (
    *("added", "to", "course", "before [mm]", "after [mm]", "before / after", "roughness [N m]", "falls"),
    "reading",
)


def step_rows(steps: Mapping[Step, tuple[Trial, Trial]], course: str) -> list[tuple[str, ...]]:
    """Return what each step from the soft gain to the precise controller does; the candidates ran on `course`."""
    rows = []
    for step, (before, after) in steps.items():
        ratio = before.ratio_to(after)
        rows.append(
            (
                *(step.adds, step.to, step.course.name if step.course else course),
                *(millimetres(one.peak.median) if one.peak.runs else "–" for one in (before, after)),
                f"{digits(ratio.median)} ({digits(ratio.low)} – {digits(ratio.high)})" if ratio.runs else "–",
                f"{digits(before.roughness.median)} and {digits(after.roughness.median)}",
                f"{before.falls} and {after.falls} of {len(before.scores)}",
                _READINGS.get(effect_of(before, after), too_few(ratio.runs)),
            )
        )
    return rows


#: what a change does to the peak error, by its falls and the 95 % interval of the ratio
Effect = Literal["needed", "harmful", "smaller", "larger", "unclear", "too few"]


def effect_of(before: Trial, after: Trial) -> Effect:
    """Return what a change does on the same plants."""
    ratio = before.ratio_to(after)
    if before.falls != after.falls:
        return "needed" if before.falls > after.falls else "harmful"
    if not has_confidence(ratio):
        return "too few"
    if ratio.low > 1.0:
        return "smaller"
    return "larger" if ratio.high < 1.0 else "unclear"


_READINGS: Mapping[Effect, str] = {
    "needed": "needed: falls without",
    "harmful": "falls with it",
    "smaller": "lowers the error",
    "larger": "raises the error",
    "unclear": "no clear difference",
}


def too_few(robots: int) -> str:
    """Return that these are too few for an interval of 95 %."""
    return f"{counted(robots, 'robot')} {'is' if robots == 1 else 'are'} too few to tell"


def interval_words(estimate: MedianEstimate) -> str:
    """Return a median's interval in words; of fewer than six values the range, which is no 95 % interval."""
    bounds = f"{digits(estimate.low)} to {digits(estimate.high)}"
    return f"95 % interval {bounds}" if has_confidence(estimate) else f"{bounds} in {estimate.runs} draws"


def has_confidence(estimate: MedianEstimate) -> bool:
    """Return whether the interval is one of 95 %: the range of fewer than six values is not."""
    return estimate.runs >= MIN_RUNS
