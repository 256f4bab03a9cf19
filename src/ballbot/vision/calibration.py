"""Calibrate the view by the seam: position, size and distance of the ball under which all frames fit the curve best.

    minimise over the view g and each frame's turn d_k    sum_k sum_j w (r - d_k . (q x n) + n . R_k^T (dp/dg) g)^2
                                                          + h^T P h s^2

h = g - g_outline(closeness): position and size are compared with the outline's for the same closeness, because the
estimate from the outline depends on it if the ball is not in the middle of the picture. r, q x n and the rest are
means over short pieces j of the seam, in which the seam's width cancels: by single points, a view that narrows the seam
would seem to fit better.

The d_k are eliminated frame by frame (Schur complement). The scatter of the frames' gradients gives s^2, and with it
the weight of the outline against the seam and the covariance of g.

A view is calibrated on a video's first seconds, before the ball is tracked through the whole video.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.progress import ProgressCallback
from ballbot.vision.seam import SeamTable, crossed, fit_rotation, matched, piece_of
from ballbot.vision.seam_pixels import SeamColour, SeamFinder, ball_pixels, moved
from ballbot.vision.tracking import follow
from ballbot.vision.video import Video
from ballbot.vision.view import CLOSENESS, View, view_of_outline

#: accuracy of the view from an outline: x, y as fractions of the radius, ln radius, and closeness
_OUTLINE = np.array([0.003, 0.003, 0.005, 0.08])
#: accuracy of a circle that the user gives
_GIVEN_CIRCLE = np.array([0.012, 0.012, 0.012, 0.08])
#: systematic error that is the same in all frames, so that their scatter does not show it: pixels move a seam's edges
#: [pixels]; standard errors of x, y and the radius, and of the closeness relative to the radius, calibrated on rendered
#: videos of balls of 20 to 135 pixels radius (`tests/vision/test_spin.py`)
_EDGES, _EDGES_CLOSENESS = 0.1, 0.2
_ROUNDS = 6
#: cells along a diameter of the ball, which divide its seam into short pieces
_CELLS = 16
_REACHES = (0.14, 0.12, 0.12)
_REACH = 0.12


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """A view and its standard errors."""

    view: View
    errors: Floats  #: (4,) standard errors of x, y [pixels], ln radius and closeness


def _calibrate(
    view: View, points: Floats, frames: Sequence[NDArray[np.uint8]],
    rotations: list[Floats], table: SeamTable, colour: SeamColour, outline_found: bool,
) -> Calibration:  # fmt: skip
    """Return the view under which frames, with their orientations (3, 3), fit the seam best."""
    size = (frames[0].shape[1], frames[0].shape[0])
    spread = (_OUTLINE if outline_found else _GIVEN_CIRCLE) * np.array([view.radius, view.radius, 1.0, 1.0])
    assumed = view.closeness
    covariance = np.diag(spread**2)
    for _ in range(_ROUNDS):
        finder = SeamFinder(pixels=ball_pixels(view, size), colour=colour)
        parts = [_pull(finder, table, frame, R) for frame, R in zip(frames, rotations, strict=True)]
        rotations = [part[2] for part in parts]
        S, pulls = np.sum([part[0] for part in parts], axis=0), np.array([part[1] for part in parts])
        scale = _scatter(S, pulls - pulls.mean(axis=0))
        off, slopes = _off_outline(view, points, size, assumed)
        prior = slopes.T / spread**2
        # Gauss-Newton with the outline as a prior of variance `spread`^2; s^2 scales the seam's normal equations
        covariance = np.linalg.inv(S / scale + prior @ slopes)
        step = -covariance @ (pulls.sum(axis=0) / scale + prior @ off)
        step[3] = np.clip(step[3], *(np.array(CLOSENESS) - view.closeness))
        view = moved(view, step)
        if np.all(np.abs(step) < 0.02 * np.sqrt(np.diag(covariance))):
            break
    edges = np.array([_EDGES, _EDGES, _EDGES / view.radius, _EDGES_CLOSENESS / view.radius])
    return Calibration(view=view, errors=np.sqrt(np.diag(covariance) + edges**2))


def _off_outline(view: View, points: Floats, size: tuple[int, int], assumed: float) -> tuple[Floats, Floats]:
    """Return h (4,), the view less that of the outline and the assumed closeness, and its derivatives (4, 4)."""

    def by_outline(closeness: float) -> Floats:
        outline = view_of_outline(points, size=size, closeness=closeness)
        return np.array([outline.x, outline.y, np.log(outline.radius)])

    here = np.array([view.x, view.y, np.log(view.radius)]) - by_outline(view.closeness)
    step = 0.25 * CLOSENESS[0]
    slopes = np.eye(4)
    slopes[:3, 3] = (by_outline(view.closeness - step) - by_outline(view.closeness + step)) / (2.0 * step)
    return np.append(here, view.closeness - assumed), slopes


def _pull(
    finder: SeamFinder, table: SeamTable, frame: NDArray[np.uint8], R: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return a frame's information (4, 4) and gradient (4,) for the view, rotation eliminated, and its orientation."""
    seen, _ = finder.find(frame)
    fit = fit_rotation(table, seen, R, reaches=_REACHES)
    r, n, q, w = matched(table, seen, fit.R, _REACH)
    by_view = np.einsum("kgi,ki->kg", finder.pixels.by_view[seen.indices], n @ fit.R.T.astype(np.float32))
    table_of = np.column_stack([-crossed(q, n), by_view, r]).astype(np.float64)
    # means over pieces of the seam, weighted by area: within a piece the seam's width cancels
    piece = piece_of(q - r[:, None] * n, _CELLS)
    weight = np.bincount(piece, weights=w)
    means = np.column_stack([np.bincount(piece, weights=w * column) for column in table_of.T])
    means /= np.maximum(weight, 1e-12)[:, None]
    J, r_mean = means[:, :7], means[:, 7]
    weighted = J * weight[:, None]
    normal, right = weighted.T @ J, weighted.T @ r_mean
    # Schur complement: the normal equations of the view with the frame's rotation d_k solved for; the small diagonal
    # term keeps them solvable if the visible seam does not determine d_k
    turn = normal[:3, :3] + 1e-6 * np.trace(normal[:3, :3]) * np.eye(3)
    across = np.linalg.solve(turn, np.column_stack([normal[:3, 3:], right[:3]]))
    S = normal[3:, 3:] - normal[3:, :3] @ across[:, :4]
    return S, right[3:] - normal[3:, :3] @ across[:, 4], fit.R


def _scatter(S: Floats, pulls: Floats) -> float:
    """Return s^2 for which the frames' gradients (k, 4) have the covariance s^2 S / k."""
    size = np.sqrt(np.maximum(np.diag(S), 1e-12))
    white = np.linalg.pinv(S / np.outer(size, size), rcond=1e-6)
    scaled = pulls / size
    return max(float(np.einsum("ki,ij,kj->", scaled, white, scaled)) / 4.0, 1e-12)


#: part of the video that is used [s], number of frames from it, and fewest of them
_TIME, _FRAMES, _LEAST_FRAMES = 5.0, 24, 6


def calibrated_view(
    video: Video, view: View, points: Floats, *, colour: SeamColour, table: SeamTable, outline_found: bool,
    progress: ProgressCallback,
) -> Calibration:  # fmt: skip
    """Return the view by tracked frames of a video's first seconds, from that of the outline's points (k, 2) [pixels].

    An outline given by hand (not `outline_found`) is less certain. InputError if too few frames are tracked.
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
    rows = [row for row in range(len(kept)) if track.tracked[row * every]]
    if len(rows) < _LEAST_FRAMES:
        raise InputError(
            f"{video.path}: the seam fits the curve {table.seam.name!r} in too few frames of the first {_TIME:g} s; "
            "check the kind of seam (--seam) and the circle of the ball (--circle), and cut what comes before the ball "
            "turns in view."
        )
    R = [track.R[row * every] for row in rows]
    return _calibrate(view, points, [kept[row] for row in rows], R, table, colour, outline_found)
