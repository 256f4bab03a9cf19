"""The seam's colour against the ball's: one number a pixel, 0 on the ball and 1 on the seam, whatever the light.

    score = w . (l - mean of l around, but for the seam),      l = log of blue, green, red

In logarithms light multiplies nothing but adds the same to all three, so that Fisher's discriminant w (R. A.
Fisher, Annals of Eugenics 7 (1936) 179-188), learned from the video itself, turns away from light and shadow by
itself where the seam has a colour, and uses brightness where it has none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError

#: grey levels added before the logarithm, so that the noise of dark pixels does not grow without bound
_FLOOR = 12.0
#: before anything else, standard deviation [pixels]
_BLUR = 0.8
#: what a video may have where its first seconds show less, as standard deviations: noise in each channel [grey
#: levels], shadow, as a share of the light, and reflected white [grey levels]
_NOISE, _SHADOW, _REFLECTION = 3.0, 0.3, 15.0
#: side of the surroundings that a pixel is compared with, in radii of the ball
_AROUND = 0.5
#: the seam and the ball differ by so many standard deviations of the ball's pixels, or there is no seam to be seen
_LEAST_SEPARATION = 1.7
#: a pixel with less than this score is surely not seam
_NOT_SEAM = 0.3
#: keeps a quotient finite where no ball is around
_LEAST_SHARE = np.float32(1e-3)
#: most of a ball that a seam covers
_MOST_SEAM = 0.35
#: most pixels that the discriminant is learned from
_MOST_PIXELS = 40_000
_LOGS = np.log(np.arange(256, dtype=np.float32) + np.float32(_FLOOR))


@dataclass(frozen=True, kw_only=True, eq=False)
class SeamColour:
    """What tells seam from ball."""

    table: NDArray[np.float32]  #: (256, 3) w log(level), by channel
    around: int  #: side of the surroundings [pixels]
    noise: float  #: standard deviation of the score on the ball
    separation: float  #: of the two, in standard deviations of both
    seam: tuple[int, int, int]  #: the seam's mean colour, red green blue
    ball: tuple[int, int, int]

    def score(self, picture: NDArray[np.uint8], share: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the score (rows, columns) of a picture (rows, columns, 3) of the ball.

        Parameters
        ----------
        picture : ndarray of uint8
        share : ndarray (rows, columns)
            From `surroundings`: what part of each pixel's surroundings is ball; 0 beside the ball.
        """
        logs = cv2.LUT(picture, self.table[:, None, :])
        value = np.asarray(cv2.GaussianBlur(cv2.transform(logs, np.ones((1, 3), np.float32)), (0, 0), _BLUR))
        inside = (share > 0.0).astype(np.float32)
        mean = _mean(value * inside, self.around) / np.maximum(share, _LEAST_SHARE)
        # a second time without the seam, which would pull the mean toward itself
        ball = inside * (value - mean < np.float32(_NOT_SEAM))
        mean = _mean(value * ball, self.around) / np.maximum(_mean(ball, self.around), _LEAST_SHARE)
        return np.asarray((value - mean) * inside, np.float32)


def surroundings(inside: NDArray[np.bool_], around: int) -> NDArray[np.float32]:
    """Return what part (rows, columns) of each pixel's surroundings is ball; 0 beside the ball."""
    return _mean(inside.astype(np.float32), around) * inside


def learn_colour(
    pictures: Sequence[NDArray[np.uint8]],
    inside: NDArray[np.bool_],
    *,
    radius: float,
    colour: tuple[int, int, int] | None = None,
) -> SeamColour:
    """Return what tells seam from ball in pictures (rows, columns, 3) of the ball.

    Parameters
    ----------
    pictures : sequence of ndarray of uint8
    inside : ndarray of bool (rows, columns)
        Where the ball is.
    radius : float
        The ball's [pixels].
    colour : tuple of int, optional
        The seam's, red green blue; without it, the seam is what stands out of its surroundings most.

    Raises
    ------
    InputError
        Where nothing stands out enough.
    """
    around = 2 * max(2, round(0.5 * _AROUND * radius)) + 1
    sample = _Sample.of(pictures, inside, around)
    found = [_best(sample.detail(None), sample.levels, colour)]
    for _ in range(2):  # again with surroundings that are free of the seam
        w, threshold, _ = found[-1]
        found.append(_best(sample.detail((w, threshold)), sample.levels, colour))
    w, threshold, separation = found[-1]
    if separation < _LEAST_SEPARATION:
        raise InputError(_no_seam(colour))
    along = sample.detail((w, threshold)) @ w
    is_seam = along > threshold
    seam, ball = along[is_seam], along[~is_seam]
    contrast = seam.mean() - ball.mean()
    return SeamColour(
        table=(_LOGS[:, None] * (w / contrast)).astype(np.float32),
        around=around,
        # the median, for the seam's blurred edges are no noise
        noise=1.4826 * float(np.median(np.abs(ball - np.median(ball)))) / contrast,
        separation=separation,
        seam=_mean_colour(sample.levels[is_seam]),
        ball=_mean_colour(sample.levels[~is_seam]),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sample:
    """What the discriminant is learned from."""

    logs: list[NDArray[np.float32]]  #: pictures (rows, columns, 3)
    inside: NDArray[np.float32]  #: (rows, columns)
    around: int
    chosen: NDArray[np.bool_]  #: (rows, columns)
    levels: NDArray[np.uint8]  #: (n, 3) of the pixels chosen, of all pictures

    @staticmethod
    def of(pictures: Sequence[NDArray[np.uint8]], inside: NDArray[np.bool_], around: int) -> _Sample:
        step = max(1, int(np.sqrt(inside.sum() * len(pictures) / _MOST_PIXELS)))
        chosen = np.zeros_like(inside)
        chosen[::step, ::step] = inside[::step, ::step]
        return _Sample(
            logs=[
                np.asarray(cv2.GaussianBlur(_LOGS[picture], (0, 0), _BLUR), np.float32)
                for picture in pictures
            ],
            inside=inside.astype(np.float32),
            around=around,
            chosen=chosen,
            levels=np.concatenate([picture[chosen] for picture in pictures]),
        )

    def detail(self, seam: tuple[NDArray[np.float64], float] | None) -> NDArray[np.float64]:
        """Return log colours less those around (n, 3); a seam known by direction and threshold is left out of these."""
        parts = []
        for values in self.logs:
            ball = self.inside
            detail = values - self._mean(values, ball)
            if seam is not None:
                ball = ball * (detail @ seam[0].astype(np.float32) < np.float32(0.7 * seam[1]))
                detail = values - self._mean(values, ball)
            parts.append(detail[self.chosen])
        return np.concatenate(parts).astype(np.float64)

    def _mean(self, values: NDArray[np.float32], ball: NDArray[np.float32]) -> NDArray[np.float32]:
        share = np.maximum(_mean(ball, self.around), _LEAST_SHARE)
        return np.asarray(_mean(values * ball[..., None], self.around) / share[..., None], np.float32)


def _best(
    detail: NDArray[np.float64], levels: NDArray[np.uint8], colour: tuple[int, int, int] | None
) -> tuple[NDArray[np.float64], float, float]:
    """Return the discriminant (3,), the seam's threshold along it, and how far apart seam and ball are."""
    by_level = 1.0 / (np.median(levels, axis=0) + _FLOOR)  # of the logarithm
    noise = np.diag((_NOISE * by_level) ** 2) + _SHADOW**2 + np.outer(by_level, by_level) * _REFLECTION**2
    starts = _starts(detail, levels, colour)
    found = [one for one in (_refined(detail, noise, start) for start in starts) if one is not None]
    if not found:
        raise InputError(_no_seam(colour))
    return max(found, key=lambda one: one[2])


def _starts(
    detail: NDArray[np.float64], levels: NDArray[np.uint8], colour: tuple[int, int, int] | None
) -> list[NDArray[np.float64]]:
    """Return directions (3,) to start from: toward the colour given, or where pixels stand out most."""
    if colour is not None:
        ball = np.log(np.median(levels, axis=0) + _FLOOR)
        toward = np.log(np.array(colour[::-1], float) + _FLOOR) - ball
        hue = toward - toward.mean()
        return [hue if np.linalg.norm(hue) > 0.3 * np.linalg.norm(toward) else toward]
    starts = []
    for basis in (np.eye(3) - 1.0 / 3.0, np.eye(3)):  # in colour only, and in brightness too
        seen = detail @ basis
        # what stands out is rare and far: the fourth power of the length lets it speak
        size = np.minimum(np.linalg.norm(seen, axis=1), np.quantile(np.linalg.norm(seen, axis=1), 0.999))
        direction = np.linalg.eigh((seen * size[:, None] ** 2).T @ seen)[1][:, -1]
        along = seen @ direction
        far = np.abs(along) > np.quantile(np.abs(along), 0.98)
        starts.append(direction * np.sign(np.sum(along[far])))
    return starts


def _refined(
    detail: NDArray[np.float64], noise: NDArray[np.float64], w: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float, float] | None:
    """Return the discriminant (3,), its threshold, and how far apart seam and ball are; None where no seam is."""
    threshold, separation = 0.0, 0.0
    for _ in range(6):
        is_seam = _split(detail @ w)
        if is_seam is None:
            return None
        seam, ball = detail[is_seam], detail[~is_seam]
        apart = seam.mean(axis=0) - ball.mean(axis=0)
        spread = 0.5 * (np.cov(seam.T) + np.cov(ball.T)) + noise
        w = np.linalg.solve(spread, apart)
        w /= np.linalg.norm(w)
        threshold = float(0.5 * w @ (seam.mean(axis=0) + ball.mean(axis=0)))
        separation = float(w @ apart / np.sqrt(w @ spread @ w))
    return w, threshold, separation


def _split(along: NDArray[np.float64]) -> NDArray[np.bool_] | None:
    """Return which of the values (n,) are of the rare high kind, by two means; None where it is not rare."""
    is_seam = along > 0.5 * (float(np.median(along)) + float(np.quantile(along, 0.99)))
    for _ in range(12):
        if not 20 < is_seam.sum() < _MOST_SEAM * len(along):
            return None
        is_seam = along > 0.5 * (float(along[~is_seam].mean()) + float(along[is_seam].mean()))
    return is_seam if 20 < is_seam.sum() < _MOST_SEAM * len(along) else None


def _mean(values: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    return np.asarray(cv2.blur(values, (side, side), borderType=cv2.BORDER_CONSTANT), np.float32)


def _mean_colour(levels: NDArray[np.uint8]) -> tuple[int, int, int]:
    blue, green, red = (round(float(value)) for value in levels.mean(axis=0))
    return red, green, blue


def _no_seam(colour: tuple[int, int, int] | None) -> str:
    if colour is None:
        return (
            "No seam stands out from the ball. Give the ball's "
            "circle (--circle) or the colour of the seam (--colour)."
        )
    named = ",".join(map(str, colour))
    return (
        f"Nothing of the colour {named} stands out from the ball; "
        "check that it is the colour of the seam, as red,green,blue."
    )
