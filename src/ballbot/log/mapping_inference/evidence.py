"""Conclusions on a foreign log: each with its evidence, its alternatives and a confidence.

A confidence is the probability that the conclusion is right, from the weights of all explanations that were compared.
What turns standard errors into weights, here and beside the comparisons, was chosen on the development halves of
`campaigns/mapping_corpus.py`. Below `CONFIDENT` a conclusion is undetermined: the proposed mapping then has a line to
fill in, and `ballbot check-log` ends with exit code 2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

#: below this confidence a conclusion is undetermined
CONFIDENT = 0.9
#: no log gives more confidence than this
MOST = 0.999
#: smallest normal number: a denominator of at least this keeps the ratio of two zeros finite
TINY = float(np.finfo(np.float64).tiny)

Candidate = TypeVar("Candidate", bound=Hashable)


@dataclass(frozen=True, kw_only=True)
class Conclusion:
    """What was concluded on one question about a foreign log."""

    name: str  #: the question: "time unit", "command kind"
    value: str  #: the answer, as words or as the mapping file has it
    confidence: float  #: from 0 to 1, that the answer is right
    #: from 0 to 1, that its error does not matter in this log; 0 if only a right answer will do
    harmless: float = 0.0
    evidence: str  #: one sentence
    alternatives: tuple[str, ...] = ()  #: other answers that are not excluded, the likeliest first
    error: float | None = None  #: standard error of a number
    unit: str = ""  #: of the number and its error
    key: str = ""  #: where the answer stands in the mapping file: "[input] kind"

    @property
    def determined(self) -> bool:
        """Whether the answer is right, or its error harmless, with enough confidence to go on."""
        return max(self.confidence, self.harmless) >= CONFIDENT

    @property
    def percent(self) -> str:
        """The confidence in percent."""
        return in_percent(self.confidence)

    @property
    def error_text(self) -> str:
        """The standard error with its unit; nothing without one."""
        known = self.error is not None and math.isfinite(self.error)
        return f"{self.error:.2g} {self.unit}".rstrip() if known else ""

    @property
    def question(self) -> str:
        """What cannot be determined, with the alternatives: "kind of the command (torque or duty)"."""
        return f"{self.name} ({self.answers})"

    @property
    def answers(self) -> str:
        """The likeliest answers: "torque or duty"; without an alternative, what is to be confirmed."""
        if self.alternatives:
            return " or ".join([self.value, *self.alternatives][:4])
        error = f", standard error {self.error_text}" if self.error_text else ""
        return f"is it {self.value}{error}?"


def in_percent(confidence: float) -> str:
    """Return a confidence in percent, rounded down: no log makes a conclusion certain."""
    return "> 99" if confidence > 0.99 else f"{math.floor(100.0 * confidence + 1e-9)}"


def probabilities(log_weights: Mapping[Candidate, float]) -> dict[Candidate, float]:
    """Return the candidates' probabilities from the logarithms of their weights, the likeliest first."""
    largest = max(log_weights.values())
    weights = {one: math.exp(weight - largest) for one, weight in log_weights.items()}
    total = sum(weights.values())
    ranked = sorted(weights, key=lambda one: -weights[one])
    return {one: weights[one] / total for one in ranked}


def normal_log_weight(value: float, deviation: float, *, outlier: float = 0.02) -> float:
    """Return the logarithm of how well a value that should be zero fits; outliers keep the weight `outlier`."""
    if not math.isfinite(value):
        return math.log(outlier)
    return math.log(math.exp(-0.5 * min((value / deviation) ** 2, 1400.0)) + outlier)


def advantage_confidence(z: float, *, believed: float = 0.6) -> float:
    """Return the confidence in an explanation that is better than the next by z standard errors.

    Blocks of a second are not independent, and the best of several explanations is flattered: part of z is believed.
    """
    if math.isnan(z):
        return 0.5
    return min(0.5 * math.erfc(-believed * max(z, -10.0) / math.sqrt(2.0)), MOST)


def jackknife_error(estimates: NDArray[np.float64]) -> float:
    """Return the standard error of an estimate from its values (B,) with each block left out; nan below 3 blocks."""
    count = len(estimates)
    if count < 3:
        return math.nan
    return float(np.sqrt((count - 1) / count * np.square(estimates - estimates.mean()).sum()))


def without_each_block(
    sums: NDArray[np.float64], estimate: Callable[[NDArray[np.float64]], float]
) -> NDArray[np.float64]:
    """Return an estimate (B,) from sums (B, ...) over blocks, with each block left out in turn."""
    total = sums.sum(axis=0)
    return np.array([estimate(total - one) for one in sums])


def solved(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coefficients (k,) of normal equations [A b] (k, k + 1), each column scaled to its size."""
    normal, right = sums[:, :-1], sums[:, -1]
    size = np.sqrt(np.abs(np.diag(normal))) + 1e-12
    scaled = normal / np.outer(size, size)
    return np.linalg.lstsq(scaled, right / size, rcond=1e-9)[0] / size
