"""A picture to judge by eye: the ball's outline and the fitted seam drawn over frames."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ballbot.vision.spin import Spin

#: frames shown, and their width [pixels]
_SHOWN, _WIDTH = 6, 360
_SEAM, _OUTLINE, _LOST = (255, 0, 255), (0, 255, 0), (0, 0, 255)


def overlay(spin: Spin) -> bytes:
    """Return a PNG of six frames, spread evenly, outline and seam drawn over the ball; red about one that was lost."""
    wanted = set(np.linspace(0, len(spin.t) - 1, _SHOWN).astype(int).tolist())
    drawn = []
    for row, (_, frame) in enumerate(spin.video.frames()):
        if row in wanted:
            drawn.append(_drawn(spin, row, frame))
        if row >= max(wanted):
            break
    while len(drawn) % 3:
        drawn.append(np.full_like(drawn[0], 255))
    sheet = np.vstack([np.hstack(drawn[k : k + 3]) for k in range(0, len(drawn), 3)])
    return bytes(cv2.imencode(".png", sheet)[1])


def _drawn(spin: Spin, row: int, frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the ball's surroundings in a frame, enlarged to a common width, with what was found drawn over."""
    view = spin.view
    reach = 1.15 * view.radius
    height, width = frame.shape[:2]
    left, top = max(0, int(view.x - reach)), max(0, int(view.y - reach))
    right, bottom = min(width, int(view.x + reach) + 1), min(height, int(view.y + reach) + 1)
    factor = _WIDTH / max(right - left, bottom - top)
    cut = cv2.resize(frame[top:bottom, left:right], None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    picture = np.full((_WIDTH, _WIDTH, 3), 255, np.uint8)
    picture[: cut.shape[0], : cut.shape[1]] = cut[:_WIDTH, :_WIDTH]
    corner = np.array([left, top])
    _line(picture, (view.outline() - corner + 0.5) * factor - 0.5, _OUTLINE, closed=True)
    if spin.track.tracked[row]:
        for curve in spin.seam.curves:
            places, facing = view.project(curve[::8] @ spin.track.R[row].T)
            for part in np.split(np.arange(len(places)), np.flatnonzero(np.diff(facing > 0.0)) + 1):
                if facing[part[0]] > 0.0:
                    _line(picture, (places[part] - corner + 0.5) * factor - 0.5, _SEAM, closed=False)
    else:
        cv2.rectangle(picture, (0, 0), (_WIDTH - 1, _WIDTH - 1), _LOST, 4)
    cv2.putText(
        picture,
        f"{spin.t[row]:.2f} s",
        (8, _WIDTH - 10),
        cv2.FONT_HERSHEY_SIMPLEX,
        0.5,
        (0, 0, 0),
        1,
        cv2.LINE_AA,
    )
    return picture


def _line(
    picture: NDArray[np.uint8], places: NDArray[np.float64], colour: tuple[int, int, int], *, closed: bool
) -> None:
    fine = np.round(places * 16.0).astype(np.int32)[:, None]  # sixteenths of a pixel
    cv2.polylines(picture, [fine], closed, colour, 1, cv2.LINE_AA, 4)
