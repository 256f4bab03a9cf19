"""The view made better on the first seconds of a video, before the whole of it is followed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.vision.ball_pixels import ball_pixels, seam_finder
from ballbot.vision.calibrate import Calibration, calibrate
from ballbot.vision.colour import SeamColour
from ballbot.vision.localise import make_judge
from ballbot.vision.seams import Seam
from ballbot.vision.sphere_table import SeamTable
from ballbot.vision.track import follow
from ballbot.vision.video import Video
from ballbot.vision.view import View, view_of_outline

#: so much of the video [s], by so many frames of it, or not with fewer than the least
_TIME, _FRAMES, _LEAST_FRAMES = 5.0, 24, 6
#: where less than this share of it is tracked, the distance may be other than assumed: the seam says which of these
#: closenesses is the best, in so many frames
_DOUBTED = 0.9
_CLOSENESSES = (0.04, 0.12, 0.22, 0.34)
_ASKED = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pass:
    """The first seconds followed under one view."""

    frames: list[NDArray[np.uint8]]  #: tracked ones, spread evenly
    orientations: list[NDArray[np.float64]]
    tracked: float  #: share


def calibrated_view(
    video: Video,
    points: NDArray[np.float64],
    closeness: float,
    samples: Sequence[NDArray[np.uint8]],
    *,
    colour: SeamColour,
    seam: Seam,
    table: SeamTable,
    found: bool,
    distance: float | None,
    progress: Callable[[float], None],
) -> Calibration | None:
    """Return the view by the video's first seconds, or None where too little of them is tracked.

    Parameters
    ----------
    video : Video
    points : ndarray (k, 2)
        Of the outline [pixels].
    closeness : float
        1/D, assumed where `distance` is not given.
    samples : sequence of ndarray
        Some frames, from `Video.samples`.
    colour, seam, table
        The seam's.
    found : bool
        That the outline was found in the picture and not given.
    distance : float, optional
        D, where it is known [ball radii].
    progress : function
        Told what share is done.
    """
    view = view_of_outline(points, size=video.size, closeness=closeness)
    first = _followed(video, view, colour, seam, table, progress)
    if first.tracked < _DOUBTED and distance is None:
        likelier = _likeliest(points, samples, colour, seam, table)
        if likelier.closeness != view.closeness:
            view = likelier
            first = _followed(video, view, colour, seam, table, progress)
    if len(first.frames) < _LEAST_FRAMES:
        return None
    return calibrate(
        view,
        points,
        first.frames,
        first.orientations,
        table=table,
        colour=colour,
        found=found,
        distance=distance,
    )


def _followed(
    video: Video,
    view: View,
    colour: SeamColour,
    seam: Seam,
    table: SeamTable,
    progress: Callable[[float], None],
) -> _Pass:
    wanted = max(2, round(_TIME * video.frame_rate))
    if video.stated_frames:
        wanted = min(wanted, video.stated_frames)
    every = max(1, wanted // _FRAMES)
    kept: list[NDArray[np.uint8]] = []

    def pictures() -> Iterator[NDArray[np.uint8]]:
        for count, (_, frame) in enumerate(video.frames()):
            if count == wanted:
                return
            if count % every == 0:
                kept.append(frame)
            yield frame

    pixels = ball_pixels(view, video.size)
    track = follow(
        pictures(), seam_finder(pixels, colour), make_judge(seam, table, pixels),
        progress=lambda count: progress(count / wanted),
    )  # fmt: skip
    rows = [row for row in range(len(kept)) if track.tracked[row * every]]
    return _Pass(
        frames=[kept[row] for row in rows],
        orientations=[track.R[row * every] for row in rows],
        tracked=float(np.mean(track.tracked)),
    )


def _likeliest(
    points: NDArray[np.float64],
    samples: Sequence[NDArray[np.uint8]],
    colour: SeamColour,
    seam: Seam,
    table: SeamTable,
) -> View:
    """Return the view with the closeness under which the seam fits some frames best, each by itself."""
    frames = samples[:: max(1, len(samples) // _ASKED)][:_ASKED]
    size = (frames[0].shape[1], frames[0].shape[0])

    def quality(view: View) -> float:
        pixels = ball_pixels(view, size)
        finder, judge = seam_finder(pixels, colour), make_judge(seam, table, pixels)
        total = 0.0
        for frame in frames:
            seen, share = finder.find(frame)
            total += judge.localise(seen, share, near=None).quality if len(seen.p) else 0.0
        return total

    return max((view_of_outline(points, size=size, closeness=one) for one in _CLOSENESSES), key=quality)
