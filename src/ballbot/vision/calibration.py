"""Find the camera's distance by the seam, on a video's first seconds, before the ball is tracked through all of it.

The outline gives the ball's position and size for any distance (`view.view_of_outline`). A wrong one narrows or widens
the visible cap, so that no rotation brings the seam onto its curve. Wanted is the closeness with the least

    sum_k sum_j w r^2        r: mean distance of the seam from its curve in piece j of frame k, at the best rotation

In a short piece the seam's width cancels: by single points, a view that narrows the seam would seem to fit better.
"""

from collections.abc import Iterator
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.progress import ProgressCallback
from ballbot.vision.seam import SeamTable, fit_rotation, matched, piece_of
from ballbot.vision.seam_pixels import SeamColour, SeamFinder, ball_pixels
from ballbot.vision.tracking import follow
from ballbot.vision.video import Video
from ballbot.vision.view import CLOSENESS, View, view_of_outline

#: part of the video that is used [s], number of frames from it, and fewest of them
_TIME, _FRAMES, _LEAST_FRAMES = 5.0, 24, 6
#: cells along a diameter of the ball, which divide its seam into short pieces
_CELLS = 16
_REACHES = (0.14, 0.12, 0.12)
#: of the closeness, at which the search ends: it finds that of twelve kinds of rendered videos to 0.002 to 0.013
_ACCURACY = 1e-3


def calibrated_view(
    video: Video,
    view: View,
    points: Floats,
    *,
    colour: SeamColour,
    table: SeamTable,
    progress: ProgressCallback,
) -> View:
    """Return the view by tracked frames of a video's first seconds, from that of the outline's points (k, 2) [pixels].

    InputError if too few frames are tracked.
    """
    wanted = max(2, round(_TIME * video.frame_rate))
    if video.stated_frames:
        wanted = min(wanted, video.stated_frames)
    every = max(1, wanted // _FRAMES)
    kept: list[NDArray[np.uint8]] = []

    def pictures() -> Iterator[tuple[float, NDArray[np.uint8]]]:
        for count, (time, frame) in enumerate(islice(video.frames(), wanted)):
            if count % every == 0:
                kept.append(frame)
            yield time, frame

    finder = SeamFinder(pixels=ball_pixels(view, video.size), colour=colour)
    track = follow(pictures(), finder, table, frame_count=wanted, progress=progress)
    rotations = {row: track.R[row * every] for row in range(len(kept)) if track.tracked[row * every]}
    if len(rotations) < _LEAST_FRAMES:
        raise InputError(
            f"{video.path}: the seam fits the curve {table.seam.name!r} in too few frames of the first {_TIME:g} s; "
            "check the kind of seam (--seam) and the circle of the ball (--circle), and cut what comes before the ball "
            "turns in view."
        )

    def misfit(closeness: float) -> float:
        tried = view_of_outline(points, size=video.size, closeness=closeness)
        finder = SeamFinder(pixels=ball_pixels(tried, video.size), colour=colour)
        squares, weight = 0.0, 0.0
        for row, start in rotations.items():
            seen, _ = finder.find(kept[row])
            R = rotations[row] = fit_rotation(table, seen, start, reaches=_REACHES).R
            r, n, q, w = matched(table, seen, R, _REACHES[-1])
            piece = piece_of(q - r[:, None] * n, _CELLS)
            area, pulls = (np.bincount(piece, weights=values) for values in (w, w * r))
            squares += float((pulls**2 / np.maximum(area, 1e-12)).sum())
            weight += float(area.sum())
        return squares / max(weight, 1e-12)

    found = minimize_scalar(misfit, bounds=CLOSENESS, method="bounded", options={"xatol": _ACCURACY})
    closeness = float(found.x)  # pyright: ignore[reportAttributeAccessIssue]
    return view_of_outline(points, size=video.size, closeness=closeness)
