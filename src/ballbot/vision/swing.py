"""The angle of a swinging body in a video, by how its picture turns.

First the moving region of the video is found: where pixels change. The body's picture there, in one frame, is the
pattern. In each frame the body's turn since the pattern is what it was a frame ago, and a little more: the frame is
turned back by the known part, corners of the pattern are followed in it (B. Lucas and T. Kanade, IJCAI 1981, with
pyramids), and a turn and a shift are fitted to those that move as one body (RANSAC). Corners that stayed behind where
the body was far away are the wall's; a second pass leaves them out. As it is always the same pattern that is followed,
the angle does not drift. The camera looks along the pivot's axis; from the side by an angle a, swings seem smaller by
about cos a, which leaves the frequency as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.swing import Swing, swing_of
from ballbot.vision.video import frame_times, open_video

_FRAMES_LOOKED_AT = 40  #: spread over the video, to find the moving region
_CORNERS = 300
_LEAST_CORNERS = 8
_LARGEST_PICTURE = 640  #: frames are made smaller until no side is longer [pixels]
_INLIER = 1.5  #: of RANSAC [pixels]
_LOST_SHARE = 0.2  #: of the frames, above which the video is refused


def swing_in_video(path: str | Path) -> Swing:
    """Return the free swing of the body that moves in a video.

    Parameters
    ----------
    path : str or Path
        Anything that OpenCV reads; the camera stands still and looks along the pivot's axis.

    Raises
    ------
    InputError
        If the file cannot be read, nothing with a pattern moves in it, or the body is lost.
    """
    t, frames = _frames(Path(path))
    chosen = [frames[k] for k in np.linspace(0, len(frames) - 1, _FRAMES_LOOKED_AT).astype(int)]
    pattern, corners = _pattern(chosen)
    if len(corners) < _LEAST_CORNERS:
        raise InputError(f"{path}: nothing with a pattern moves; fix stripes or a printed page to the body.")
    first = min(range(len(frames)), key=lambda k: float(cv2.absdiff(frames[k], pattern).mean()))
    rough = _followed(pattern, corners, frames, first)
    corners = corners[_on_body(rough, len(corners))]
    motions = [
        None if one is None else _moved(pattern, corners, frame, one.motion)
        for one, frame in zip(rough, frames, strict=True)
    ]
    seen = np.array([one is not None for one in motions])
    if seen.mean() < 1.0 - _LOST_SHARE:
        raise InputError(
            f"{path}: the body is lost in {100.0 * (1.0 - seen.mean()):.0f} % of the frames; record it in better "
            "light, faster, or with a pattern on it."
        )
    # pictures have y down
    turn = -np.unwrap(np.array([one.turn for one in motions if one is not None]))
    return swing_of(t[seen], turn, kind="angle", source=f"the turn of the picture in {path}")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Moved:
    """How the pattern moved to a frame."""

    motion: NDArray[np.float64]  #: (2, 3) from the pattern's pixels to the frame's
    inliers: NDArray[np.bool_]  #: (n,) the corners that moved so

    @property
    def turn(self) -> float:
        """The angle, in the picture's axes [rad]."""
        return float(np.arctan2(self.motion[1, 0], self.motion[0, 0]))


def _followed(
    pattern: NDArray[np.uint8], corners: NDArray[np.float32], frames: list[NDArray[np.uint8]], first: int
) -> list[_Moved | None]:
    """Return how the pattern moved to each frame, followed from the frame that is most like it; None where lost."""
    motions: list[_Moved | None] = [None] * len(frames)
    for order in (range(first, len(frames)), range(first, -1, -1)):
        motion = np.eye(2, 3)
        for k in order:
            found = _moved(pattern, corners, frames[k], motion)
            motions[k] = found
            motion = motion if found is None else found.motion
    return motions


def _on_body(motions: list[_Moved | None], count: int) -> NDArray[np.bool_]:
    """Return which corners (count,) move with the body: in most frames in which it is far from the pattern."""
    found = [one for one in motions if one is not None]
    if not found:
        return np.ones(count, dtype=bool)
    turns = np.abs([one.turn for one in found])
    far = [one.inliers for one, turn in zip(found, turns, strict=True) if turn >= np.median(turns)]
    return np.mean(far, axis=0) > 0.5


def _moved(
    pattern: NDArray[np.uint8],
    corners: NDArray[np.float32],
    frame: NDArray[np.uint8],
    known: NDArray[np.float64],
) -> _Moved | None:
    """Return how the pattern moved to a frame, near a known motion (2, 3); None where too few corners agree."""
    size = (frame.shape[1], frame.shape[0])
    turned_back = cv2.warpAffine(frame, known, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    moved, followed, _ = cv2.calcOpticalFlowPyrLK(
        pattern, turned_back, corners, corners.copy(), winSize=(21, 21), maxLevel=3
    )
    kept = followed.ravel() == 1
    if kept.sum() < _LEAST_CORNERS:
        return None
    cv2.setRNGSeed(0)
    rest, agree = cv2.estimateAffinePartial2D(
        corners[kept], moved[kept], method=cv2.RANSAC, ransacReprojThreshold=_INLIER
    )
    if rest is None or agree.sum() < _LEAST_CORNERS:
        return None
    bottom = np.array([[0.0, 0.0, 1.0]])
    motion = np.vstack([known, bottom]) @ np.vstack([np.asarray(rest, dtype=np.float64), bottom])
    inliers = np.zeros(len(corners), dtype=bool)
    inliers[np.flatnonzero(kept)[agree.ravel() == 1]] = True
    return _Moved(motion=motion[:2], inliers=inliers)


def _frames(path: Path) -> tuple[NDArray[np.float64], list[NDArray[np.uint8]]]:
    video = open_video(path)
    frames: list[NDArray[np.uint8]] = []
    stated = []
    for time, frame in video.frames():
        scale = min(1.0, _LARGEST_PICTURE / max(frame.shape[:2]))
        smaller = cv2.resize(frame, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        frames.append(np.asarray(cv2.cvtColor(smaller, cv2.COLOR_BGR2GRAY), dtype=np.uint8))
        stated.append(time)
    if len(frames) < _FRAMES_LOOKED_AT:
        raise InputError(f"{path} has {len(frames)} frames; a swing takes at least {_FRAMES_LOOKED_AT}.")
    return frame_times(np.array(stated), video), frames


def _pattern(chosen: list[NDArray[np.uint8]]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the frame that is most like all others, and the corners (n, 1, 2) on what moves."""
    stack = np.stack(chosen).astype(np.float32)
    changes = stack.std(axis=0)
    noise = float(np.median(changes))
    moving = cv2.dilate((changes > max(3.0 * noise, 0.15 * changes.max())).astype(np.uint8), np.ones((7, 7)))
    middle = int(np.argmin(np.abs(stack - stack.mean(axis=0)).mean(axis=(1, 2))))
    corners = cv2.goodFeaturesToTrack(chosen[middle], _CORNERS, 0.01, 5, mask=moving)
    empty = np.empty((0, 1, 2), dtype=np.float32)
    return chosen[middle], empty if corners is None else np.asarray(corners, dtype=np.float32)
