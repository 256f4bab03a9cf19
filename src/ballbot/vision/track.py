"""Following the ball's orientation through a video, frame by frame.

Each frame's fit starts where the last angular velocity leads. A frame is lost where too little of the seam's pixels
is explained, or too little of the curve is seen. Where it cannot be followed the orientation is sought anew, at once
and then in every fourth frame.
Frames belong to one stretch as long as each follows from the one before; from one stretch to the next the ball may
be another of its symmetric selves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.vision.ball_pixels import SeamFinder
from ballbot.vision.fit import Fit, SeamPoints, fit_rotation
from ballbot.vision.localise import Judge, Judged
from ballbot.vision.rotations import exponential, logarithm

#: distances from the curve from which on pixels count nothing, by iteration [rad]: first where the start may be off
_REACHES = (0.28, 0.2, 0.14, 0.12, 0.12)
#: quality from which a frame is tracked, and from which one found anew is believed
_TRACKED, _FOUND = 0.55, 0.7
#: fewer seam pixels are no seam
_LEAST_PIXELS = 60
#: while lost, the orientation is sought in one frame of so many
_SOUGHT_EVERY = 4
#: what a ball turns at most beyond what was predicted [rad]
_LARGEST_JUMP = 0.35


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """The ball's orientation in every frame."""

    R: NDArray[np.float64]  #: (n, 3, 3) ball frame to camera frame; NaN where lost
    information: NDArray[np.float64]  #: (n, 3, 3) from `Fit`, camera frame
    bias: NDArray[np.float64]  #: (n, 3, 3) from `Fit`, camera frame [rad^2]
    quality: NDArray[np.float64]  #: (n,) 0 to 1
    stretch: NDArray[np.int64]  #: (n,) number of the stretch; -1 where lost

    @property
    def tracked(self) -> NDArray[np.bool_]:
        """Which frames (n,) were tracked."""
        return self.stretch >= 0


class _Follower:
    """The state between frames."""

    def __init__(self, finder: SeamFinder, judge: Judge) -> None:
        self._finder, self._judge = finder, judge
        self._last: NDArray[np.float64] | None = None
        self._turn = np.zeros(3)  # over the last frame, camera frame [rad]
        self._settled = False  # whether that is known
        self._lost = 0  # frames since the last that was tracked
        self._stretch = -1

    def next(self, frame: NDArray[np.uint8]) -> tuple[Fit, float, int] | None:
        """Return the orientation, its quality and its stretch; None where it is lost."""
        seen, seam = self._finder.find(frame)
        judged = None
        if len(seen.p) >= _LEAST_PIXELS:
            judged = self._followed(seen, seam) or self._sought(seen, seam)
        if judged is None:
            self._lost += 1
            self._settled = False
            return None
        self._lost = 0
        return judged.fit, judged.quality, self._stretch

    def _followed(self, seen: SeamPoints, seam: NDArray[np.float32]) -> Judged | None:
        if self._last is None or self._lost > 1:
            return None
        turn = self._turn * (1.0 + self._lost)
        predicted = exponential(turn) @ self._last
        judged = self._judge.judge(fit_rotation(self._judge.table, seen, predicted, reaches=_REACHES), seam)
        jump = float(np.linalg.norm(logarithm(judged.fit.R @ predicted.T)))
        if judged.quality < _TRACKED or jump > _LARGEST_JUMP:
            if self._settled:
                return None
            # the second frame of a stretch: how fast the ball turns is not known yet
            judged = self._judge.localise(seen, seam, near=self._last)
            if judged.quality < _FOUND:
                return None
        whole = logarithm(judged.fit.R @ self._last.T) / (1.0 + self._lost)
        if np.linalg.norm(whole) > 1.0:  # another of the symmetric selves
            return None
        self._turn, self._last, self._settled = whole, judged.fit.R, True
        return judged

    def _sought(self, seen: SeamPoints, seam: NDArray[np.float32]) -> Judged | None:
        if self._last is not None and self._lost % _SOUGHT_EVERY:
            return None
        judged = self._judge.localise(seen, seam, near=self._last)
        if judged.quality < _FOUND:
            return None
        self._last, self._turn, self._settled = judged.fit.R, np.zeros(3), False
        self._stretch += 1
        return judged


def follow(
    frames: Iterable[NDArray[np.uint8]],
    finder: SeamFinder,
    judge: Judge,
    *,
    progress: Callable[[int], None] | None = None,
) -> Track:
    """Return the orientation in every frame.

    Parameters
    ----------
    frames : iterable of ndarray (height, width, 3) uint8
    finder : SeamFinder
    judge : Judge
    progress : function, optional
        Told how many frames are done.
    """
    follower = _Follower(finder, judge)
    nothing = np.full((3, 3), np.nan)
    R, information, bias, quality, stretch = [], [], [], [], []
    for count, frame in enumerate(frames, start=1):
        found = follower.next(frame)
        fit, score, number = found or (None, 0.0, -1)
        R.append(fit.R if fit else nothing)
        information.append(fit.information if fit else nothing)
        bias.append(fit.bias if fit else nothing)
        quality.append(score)
        stretch.append(number)
        if progress is not None:
            progress(count)
    return Track(
        R=np.array(R).reshape(-1, 3, 3),
        information=np.array(information).reshape(-1, 3, 3),
        bias=np.array(bias).reshape(-1, 3, 3),
        quality=np.array(quality),
        stretch=np.array(stretch, dtype=np.int64),
    )
