"""Whether an identification is usable: the first sentence of its results.

It is usable if

- held-out windows are predicted better with friction than without: the 95 % interval of the gain over all logs and the
  states that count (`ballbot.fitting.model_selection`) is above zero, and the gain is positive for the lean, on which
  balancing depends, and on each log by itself;
- no b or c of a wheel is at the upper end of its usual range, which is not an estimate;
- the logs agree on the Coulomb friction: between logs it varies by less than half of its size, or within their errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import every
from ballbot.fitting.model_selection import Gain, gain_between, neighbours
from ballbot.identification.windows import Span
from ballbot.results import reported
from ballbot.rounding import digits
from ballbot.summary import counted

#: neighbouring windows drawn together: 1 s of motion
BLOCK = 4


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Whether an identification is usable, and why."""

    gain: Gain  #: of the prediction with friction over that without, on held-out windows
    windows: int  #: number of held-out windows
    reasons: tuple[str, ...]  #: why it is not usable; empty if it is

    @reported
    def usable(self) -> bool:
        """Whether there is no reason against it."""
        return not self.reasons

    @reported
    def sentence(self) -> str:
        """The verdict: usable and how much better the prediction is, or not usable and why."""
        if self.reasons:
            return f"Not usable: {'; '.join(self.reasons)}."
        gain = self.gain
        return (
            f"Usable: on {counted(self.windows, 'window')} that the fit did not see, the error with this friction is "
            f"{digits(1.0 - gain.share, 2)} times that without (95 % interval {digits(1.0 - gain.upper, 2)} to "
            f"{digits(1.0 - gain.lower, 2)})."
        )


def verdict_of(
    squares: NDArray[np.float64],
    without: NDArray[np.float64],
    spans: Sequence[Span],
    *,
    lean: NDArray[np.bool_] | None = None,
    at_end: Sequence[str] = (),
    disagree: Sequence[str] = (),
) -> Verdict:
    """Return the verdict from held-out windows.

    `squares` and `without` (w, k) are sums of squared errors of each window and state that counts, with friction and
    without; `lean` (k,) marks the states of the lean; `at_end` are labels of friction at the end of its usual range,
    `disagree` those on which the logs disagree.
    """
    logs = np.array([span.log for span in spans])

    def gain_on(rows: NDArray[np.intp], states: NDArray[np.bool_] | slice = slice(None)) -> Gain:
        blocks = window_blocks([spans[row] for row in rows.tolist()])
        return gain_between(squares[rows][:, states], without[rows][:, states], blocks)

    everywhere = np.arange(len(spans))
    overall = gain_on(everywhere)
    of_lean = overall if lean is None or not lean.any() else gain_on(everywhere, lean)
    by_log = {int(log): gain_on(np.flatnonzero(logs == log)) for log in np.unique(logs)}
    worse = [f"log {log + 1} ({_times(gain)})" for log, gain in by_log.items() if not gain.share > 0.0]
    seen = f"on {counted(len(spans), 'window')} that the fit did not see"
    reasons = []
    if not overall.lower > 0.0:
        reasons.append(
            f"{seen}, the prediction is no better with friction than without ({_times(overall)}, 95 % interval "
            f"{digits(1.0 - overall.upper, 2)} to {digits(1.0 - overall.lower, 2)})"
        )
    elif not of_lean.share > 0.0:
        reasons.append(
            f"{seen}, the lean is predicted no better with friction than without ({_times(of_lean)})"
        )
    elif worse and len(by_log) > 1:
        reasons.append(f"the logs disagree: {every(worse)} is predicted no better with friction than without")
    if at_end:
        reasons.append(f"{every(at_end)} {'is' if len(at_end) == 1 else 'are'} at the end of the usual range")
    if disagree:
        reasons.append(f"the logs disagree on {every(disagree)}, by half of the friction or more")
    return Verdict(gain=overall, windows=len(spans), reasons=tuple(reasons))


def window_blocks(spans: Sequence[Span]) -> list[NDArray[np.int64]]:
    """Return the rows of windows in blocks of `BLOCK` neighbours of one log."""
    groups = []
    for log in sorted({span.log for span in spans}):
        rows = [row for row, span in enumerate(spans) if span.log == log]
        rows.sort(key=lambda row: spans[row].start)
        groups += neighbours(rows, block=BLOCK)
    return groups


def _times(gain: Gain) -> str:
    return f"{digits(1.0 - gain.share, 2)} times the error"
