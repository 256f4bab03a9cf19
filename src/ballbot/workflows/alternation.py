"""Two controllers compared on one robot by alternating runs, A B A B, so that drift is not counted as a gain.

A drift that is steady from run to run, as of a battery, is estimated together with the gain:

    log q_k = a + d k + g b_k + e_k        k: number of the run;  b_k = 1 with the new controller, else 0

by least squares, for each quantity q of `LogScore` that is a size (of the torque margin, for the share of the torque
limit that is used). exp(g) is the factor by which the new controller changes the quantity. Its 95 % interval is
Student's, with n - 3 degrees of freedom; of four runs that is one, and the interval is wide. Each run of the new
controller is also compared with the study's prediction (`controller_prediction`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.results import reported
from ballbot.summary import counted
from ballbot.workflows.controller_prediction import ControllerVerdict, Recommendation
from ballbot.workflows.metrics import QUANTITIES, LogScore
from ballbot.workflows.statistics import student_quantile

#: fewest runs: gain, drift and offset are estimated, and one run is left for the scatter
MIN_RUNS = 4
_WORST_FIRST: tuple[Recommendation, ...] = ("revert", "weaken", "keep")


@dataclass(frozen=True, kw_only=True)
class PairedGain:
    """The factor by which the new controller changes a quantity, without the drift."""

    factor: float
    low: float  #: of the 95 % interval
    high: float
    drift: float  #: factor from one run to the next that is due to neither controller

    @reported
    def verdict(self) -> Literal["smaller", "larger", "undecided"]:
        """Whether the quantity is significantly smaller or larger with the new controller."""
        if self.high < 1.0:
            return "smaller"
        return "larger" if self.low > 1.0 else "undecided"


@dataclass(frozen=True, kw_only=True)
class Alternation:
    """The result of alternating runs."""

    performances: tuple[LogScore, ...]  #: of every run, in order; the old controller's first
    gains: Mapping[str, PairedGain]  #: by quantity; without those that a run did not show
    verdicts: tuple[ControllerVerdict, ...]  #: of the new controller's runs

    @property
    def recommendation(self) -> Recommendation:
        """The worst of the recommendations of the new controller's runs."""
        given = {verdict.recommendation for verdict in self.verdicts}
        return next(recommendation for recommendation in _WORST_FIRST if recommendation in given)


def alternate(performances: Sequence[LogScore], verdicts: Sequence[ControllerVerdict]) -> Alternation:
    """Compare two controllers by alternating runs: all performances, A B A B and so on, and the verdicts of B's runs.

    Raise InputError if there are fewer than four runs, or more of one controller than of the other.
    """
    if len(performances) < MIN_RUNS or len(performances) % 2:
        raise InputError(
            f"{counted(len(performances), 'run')} cannot be compared. Make {MIN_RUNS} or more, the same number with "
            "each controller, alternately."
        )
    sizes = {
        name: np.array([performance.sizes()[name] for performance in performances]) for name in QUANTITIES
    }
    shown = {name: each for name, each in sizes.items() if (np.isfinite(each) & (each > 0.0)).all()}
    gains = {name: paired_gain(each) for name, each in shown.items()}
    return Alternation(performances=tuple(performances), gains=gains, verdicts=tuple(verdicts))


def paired_gain(values: Floats) -> PairedGain:
    """Return the factor between two controllers whose positive values (n,) alternate: A B A B, four or more."""
    number = np.arange(len(values), dtype=np.float64)
    X = np.column_stack([np.ones(len(values)), number, number % 2])
    estimate = np.linalg.pinv(X) @ np.log(values)
    left = np.log(values) - X @ estimate
    freedom = len(values) - X.shape[1]
    deviation = np.sqrt(left @ left / freedom * np.linalg.inv(X.T @ X)[2, 2])
    half = student_quantile(freedom + 1) * deviation
    drift, factor, low, high = np.exp([estimate[1], *(estimate[2] + half * np.array([0.0, -1.0, 1.0]))])
    return PairedGain(factor=float(factor), low=float(low), high=float(high), drift=float(drift))
