"""A figure or table of the thesis beside ours, and the numbers that decide whether they agree.

Numbers over several seeds are their median with an interval that assumes nothing about their distribution.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Literal

import numpy as np
from matplotlib.figure import Figure

from ballbot.report.blocks import Sheet
from ballbot.report.series import TimeSeries
from ballbot.results import reported
from ballbot.workflows.statistics import median_with_interval

#: runs that a verdict on the twin or on a model with friction is taken over
RUNS = 9
#: three-minute runs on which the sensors are evaluated; the fewest whose whole range is an interval of 95 %
LONG_RUNS = 6


def run_seed(seed: int, number: int) -> int:
    """Return the seed of a run by the command's seed and the run's number."""
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0])


Verdict = Literal["agrees", "agrees in part", "does not agree", "undecided"]
#: the verdicts in a summary of several items, in its order
VERDICTS: Mapping[Verdict, str] = MappingProxyType(
    {
        "agrees": "agree",
        "agrees in part": "agree in part",
        "does not agree": "do not agree",
        "undecided": "are undecided",
    }
)
#: below this a number is rounding, which differs from machine to machine, and is printed as zero
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class ClaimCheck:
    """A claim, and our number that decides it.

    It agrees if `lowest` <= `value` <= `highest`. A number over several runs is their median; then all of its
    `interval` must be within the bounds.
    """

    claim: str  #: a clause: "without friction the ball reaches the reference"
    quantity: str  #: what is measured, in words
    value: float
    unit: str
    lowest: float
    highest: float
    interval: tuple[float, float] | None = None  #: of the median, 95 %; None for a number without randomness
    runs: int = 1

    @reported
    def agrees(self) -> bool:
        """Whether the number is within the criterion; one that is not a number is not."""
        lower, upper = self.interval or (self.value, self.value)
        return self.lowest <= lower and upper <= self.highest

    @reported
    def undecided(self) -> bool:
        """Whether only part of the interval is within the criterion."""
        lower, upper = self.interval or (self.value, self.value)
        return not self.agrees and lower <= self.highest and upper >= self.lowest

    @property
    def cells(self) -> tuple[str, str, str, str, str]:
        """Claim, quantity, number with unit and interval, criterion, and yes, no or undecided."""
        unit, number = f" {self.unit}" if self.unit else "", _digits(self.value)
        measured, lowest, highest = f"{number}{unit}", _written(self.lowest), _written(self.highest)
        if self.interval:
            measured = f"{spread_text(self.value, self.interval)}{unit}, {self.runs} runs"
        criterion = f"{lowest} to {highest}"
        if math.isinf(self.lowest) or math.isinf(self.highest):
            criterion = f"at most {highest}" if math.isinf(self.lowest) else f"at least {lowest}"
        outcome = "yes" if self.agrees else "undecided" if self.undecided else "no"
        return self.claim, self.quantity, measured, f"{criterion}{unit}", outcome


def check(
    claim: str,
    quantity: str,
    value: float | Sequence[float],
    unit: str = "",
    lowest: float = -math.inf,
    highest: float = math.inf,
) -> ClaimCheck:
    """Return the check of a number, or of the median of several runs' numbers, with its 95 % interval by rank."""
    made = partial(ClaimCheck, claim=claim, quantity=quantity, unit=unit, lowest=lowest, highest=highest)
    if isinstance(value, float | int):
        return made(value=value)
    estimate = median_with_interval(value)
    return made(value=estimate.median, interval=(estimate.low, estimate.high), runs=len(value))


def spread_text(value: float, interval: tuple[float, float]) -> str:
    """Return a median with its interval, three digits each: "0.343 (0.31 to 0.38)"."""
    middle, lower, upper = (f"{0.0 if abs(part) < _ROUNDING else part:.3g}" for part in (value, *interval))
    return f"{middle} ({lower} to {upper})"


def over_runs(values: Sequence[float]) -> str:
    """Return the median of several runs' values with its interval, in words."""
    estimate = median_with_interval(values)
    return spread_text(estimate.median, (estimate.low, estimate.high))


@dataclass(frozen=True, kw_only=True, eq=False)
class Item:
    """A figure or table of the thesis beside ours."""

    title: str
    thesis: str  #: what the thesis shows, a sentence
    ours: str  #: what ours shows, a sentence or two
    checks: tuple[ClaimCheck, ...]
    table: Sheet | None = None
    figure: Callable[[], Figure] | None = None
    series: Callable[[], TimeSeries] | None = None

    @property
    def verdict(self) -> Verdict:
        """The verdict of all checks together."""
        if all(check.agrees for check in self.checks):
            return "agrees"
        if all(check.agrees or check.undecided for check in self.checks):
            return "undecided"
        return "agrees in part" if any(check.agrees for check in self.checks) else "does not agree"

    @property
    def sentence(self) -> str:
        """The verdict in words, with what does not agree."""
        if self.verdict == "agrees":
            return "Ours agrees."
        missing = [_missing(check) for check in self.checks if not check.agrees and not check.undecided]
        undecided = [_missing(check) for check in self.checks if check.undecided]
        parts = ["Ours is undecided" if self.verdict == "undecided" else f"Ours {self.verdict}"]
        if missing:
            parts.append(f"it does not show that {'; nor that '.join(missing)}")
        if undecided:
            parts.append(f"its runs do not decide whether {'; and whether '.join(undecided)}")
        return f"{parts[0]}: {'; '.join(parts[1:])}."


@dataclass(frozen=True, kw_only=True)
class Mistake:
    """A misprint or mistake of the thesis, with the number that shows it."""

    where: str  #: the equation or section
    thesis: str  #: what it states
    right: str  #: what is right
    shown_by: tuple[ClaimCheck, ...]  #: numbers that would differ if the thesis were right

    @reported
    def proven(self) -> bool:
        """Whether every number shows it."""
        return all(check.agrees for check in self.shown_by)


def _missing(check: ClaimCheck) -> str:
    claim, quantity, measured, criterion, _ = check.cells
    return f"{claim} ({quantity}: {measured}; required: {criterion})"


def _digits(value: float) -> str:
    return "0" if abs(value) < _ROUNDING else _written(value)


def _written(value: float) -> str:
    return f"{value:.5g}" if abs(value) >= 10.0 else f"{value:.4g}"
