"""Whether an identification is usable: the first sentence of its results.

It is not usable

- unless windows that the fit did not see are predicted better with friction than without. The whole 95 % interval of
  the gain (`ballbot.fitting.model_selection`) is above zero, over the states counted and all logs; and so is the gain
  in the lean, which balancing depends on, and that on each log, as logs of one robot agree on its friction;
- if b or c of a wheel ends at the end of its usual range: that is no estimate;
- if the logs disagree on the dry friction: from log to log it varies by half of its size or more, beyond their errors.
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

#: neighbouring windows drawn together; of a quarter held out, four are some 4 s of the robot's way
BLOCK = 4


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Whether an identification is usable, and by what."""

    gain: Gain  #: of the prediction with friction over that without, on windows held out
    windows: int  #: of them
    reasons: tuple[str, ...]  #: why it is not usable; empty if it is

    @reported
    def usable(self) -> bool:
        """Whether nothing speaks against it."""
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
    """Return the verdict on windows that were held out.

    `squares` and `without` (w, k) are sums of squared errors of each window and state that counts, with friction and
    without; `lean` (k,) marks the states that are the lean; `at_end` are the labels of friction at the end of its usual
    range, `disagree` those on which the logs disagree.
    """

    logs = sorted({span.log for span in spans})
    whole = gain_between(squares, without, window_blocks(spans))
    of_lean, by_log = whole, dict[str, Gain]()
    if lean is not None and lean.any():
        of_lean = gain_between(squares[:, lean], without[:, lean], window_blocks(spans))
    for log in logs if len(logs) > 1 else ():
        rows = np.flatnonzero([span.log == log for span in spans])
        blocks = window_blocks([spans[row] for row in rows.tolist()])
        by_log[f"log {log + 1}"] = gain_between(squares[rows], without[rows], blocks)
    seen = f"on {counted(len(spans), 'window')} that the fit did not see"
    worse = [f"{name} ({_times(one)})" for name, one in by_log.items() if not one.share > 0.0]
    reasons = []
    if not whole.lower > 0.0:
        reasons.append(
            f"{seen}, the prediction is no better with friction than without ({_times(whole)}, 95 % interval "
            f"{digits(1.0 - whole.upper, 2)} to {digits(1.0 - whole.lower, 2)})"
        )
    elif not of_lean.share > 0.0:
        reasons.append(
            f"{seen}, the lean is predicted no better with friction than without ({_times(of_lean)})"
        )
    elif worse:
        reasons.append(f"the logs disagree: {every(worse)} is predicted no better with friction than without")
    if at_end:
        reasons.append(f"{every(at_end)} {'is' if len(at_end) == 1 else 'are'} at the end of the usual range")
    if disagree:
        reasons.append(f"the logs disagree on {every(disagree)}, by half of the friction or more")
    return Verdict(gain=whole, windows=len(spans), reasons=tuple(reasons))


def window_blocks(spans: Sequence[Span]) -> list[NDArray[np.int64]]:
    """Return the numbers of windows, `BLOCK` neighbours of one log at a time."""
    groups = []
    for log in sorted({span.log for span in spans}):
        rows = [row for row, span in enumerate(spans) if span.log == log]
        rows.sort(key=lambda row: spans[row].start)
        groups += neighbours(rows, block=BLOCK)
    return groups


def _times(gain: Gain) -> str:
    return f"{digits(1.0 - gain.share, 2)} times the error"
