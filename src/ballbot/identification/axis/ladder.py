"""The ladder: which friction law earns its place, by windows that it was not fitted to.

Each rung is fitted to all windows but those of one fold, and predicts these; every window is held out once. A rung's
gain over the one below is the mean over windows of the squared errors' difference, with a 95 % interval by Student's
t over windows, which are taken for independent.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ballbot.errors import InputError
from ballbot.identification.axis.filtering import Motion
from ballbot.identification.axis.laws import RUNGS, Rung, Values
from ballbot.identification.axis.output_error import (
    Span,
    equal_spans,
    fit_output_error,
    open_loop_residuals,
)
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.checkpoint import Recall, afresh

FOLDS = 3
LEAST_WINDOWS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class RungVerdict:
    """How one rung does on windows held out."""

    rung: Rung
    rms: float  #: of all held-out position errors [m]
    square_sums: NDArray[np.float64]  #: (w,) mean square error of each window [m^2]
    gain: float  #: 1 - (mean square error over that of the rung below); NaN for the lowest
    interval: tuple[float, float]  #: of the gain, 95 %

    @property
    def earned(self) -> bool:
        """Whether the interval of the gain lies above zero."""
        return self.interval[0] > 0.0


def climb(
    record: AxisRecord,
    motion: Motion,
    starts: Mapping[str, Values],
    *,
    window: float,
    recall: Recall = afresh,
    progress: Callable[[float, str], None],
) -> tuple[RungVerdict, ...]:
    """Return the verdict on every rung.

    Parameters
    ----------
    record : AxisRecord
    motion : Motion
        The record's, filtered: windows start from it.
    starts : mapping of str to mapping
        By the rung's name, where its search starts.
    window : float
        Duration of the windows [s].
    recall : Recall, optional
        A checkpoint's: it answers for each rung.
    progress : callable
        Told a share and what is done.

    Raises
    ------
    InputError
        Where the record has too few such windows.
    """
    spans = equal_spans(record, window)
    if len(spans) < LEAST_WINDOWS:
        raise InputError(
            f"{record.name} has {len(spans)} windows of {window:g} s; model "
            f"selection needs {LEAST_WINDOWS}. Choose a shorter --window."
        )
    verdicts: dict[str, RungVerdict] = {}
    for number, (name, rung) in enumerate(RUNGS.items()):
        progress(number / len(RUNGS), f"law {name}")
        asked = np.array([starts[name][one] for one in rung.names])
        judge = partial(_held_out, record, motion, rung, starts[name], spans)
        squares = recall(f"ladder, {name}", asked, lambda judge=judge: [judge()])[0]
        below = verdicts[rung.below].square_sums if rung.below else None
        gain, interval = _gain(squares, below)
        verdicts[name] = RungVerdict(
            rung=rung, rms=float(np.sqrt(squares.mean())), square_sums=squares, gain=gain, interval=interval
        )
    return tuple(verdicts.values())


def chosen(verdicts: Sequence[RungVerdict]) -> Rung:
    """Return the symmetric rung of the least error on windows held out, of those that beat every rung below.

    An asymmetry is not taken from one record: windows of the same record share whatever made it, such as a
    temperature, and do not show that it is the machine's own.
    """
    by_name = {verdict.rung.name: verdict for verdict in verdicts}

    def earned(verdict: RungVerdict) -> bool:
        below = verdict.rung.below
        return below is None or (verdict.earned and earned(by_name[below]))

    candidates = [verdict for verdict in verdicts if verdict.rung.symmetric and earned(verdict)]
    return min(candidates, key=lambda verdict: verdict.rms).rung


def _held_out(
    record: AxisRecord, motion: Motion, rung: Rung, start: Values, spans: Sequence[Span]
) -> NDArray[np.float64]:
    """Return each window's mean square error (w,) [m^2] by the fit that did not see it."""
    squares = np.empty(len(spans))
    scale = float(np.ptp(record.position)) * 1e-3
    for fold in range(FOLDS):
        seen = [span for i, span in enumerate(spans) if i % FOLDS != fold]
        fit = fit_output_error(
            rung, start, open_loop_residuals(record, motion, seen, block=np.inf), scale=scale
        )
        for i in range(fold, len(spans), FOLDS):
            errors = open_loop_residuals(record, motion, [spans[i]], block=np.inf)(fit.axis).values
            squares[i] = np.mean(errors**2)
    return squares


def _gain(
    squares: NDArray[np.float64], below: NDArray[np.float64] | None
) -> tuple[float, tuple[float, float]]:
    if below is None:
        return np.nan, (np.nan, np.nan)
    difference = (below - squares) / below.mean()
    error = float(np.std(difference, ddof=1)) / np.sqrt(len(difference))
    half = float(stats.t.ppf(0.975, len(difference) - 1)) * error
    gain = float(difference.mean())
    return gain, (gain - half, gain + half)
