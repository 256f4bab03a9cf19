"""Track the ball's orientation through a video, and estimate its angular velocity.

Initial search: many rotations are tried, the best are refined, and the best of those is kept. Seams have symmetries, so
that several orientations look the same; any of them is right, because the angular velocity is the same.

Tracking: each frame's fit starts at the orientation predicted by the last angular velocity. A frame is lost if too few
of the seam's pixels are explained, or too little of the curve is visible. Then the orientation is searched again, at
once and in every fourth frame. A stretch consists of frames that were tracked from one to the next; between stretches
the orientation may change by a symmetry of the seam.

The angular velocity comes from a smoother of the orientations' errors, velocity and acceleration.

    e_(k+1) = exp([f_k]) e_k + (1 + [f_k]/2) (omega dt + a dt^2 / 2 - f_k),     f_k = log(R_(k+1) R_k^T)
    omega' = a,  a' = white noise of density q;      0 = e_k + noise of covariance s^2 H_k^-1

R_k is the frame's fit and exp(e_k) R_k the true orientation; H_k is the fit's information less a threshold, so that a
frame adds no information about an axis about which it does not determine the rotation. q/s^2 is the maximum-likelihood
estimate by the filter's innovations, which also give s. Filter and smoother: H. E. Rauch, F. Tung and C. T.
Striebel, AIAA Journal 3 (1965) 1445-1450.

To the smoother's covariance is added that of errors which do not change from frame to frame but as the ball turns: the
fits' bias, times the square of the angular velocity over the angle at which these errors change.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from scipy.spatial.transform import Rotation

from ballbot.arrays import Bools, Floats
from ballbot.progress import Progress, ProgressCallback
from ballbot.vision.seam import SeamFit, SeamPoints, SeamTable, fit_rotation
from ballbot.vision.seam_pixels import SeamFinder
from ballbot.vision.video import LEAST_FRAMES

#: number of rotations tried: evenly spaced by 15 degrees
_TRIED = 2304
#: points of the frame used for trying, and number of rotations that are refined
_POINTS, _REFINED = 160, 24
#: distance from the curve from which on the cost is constant [rad]
_FAR = 0.3
_SEARCH_REACHES = (0.5, 0.4, 0.3, 0.25, 0.2, 0.16, 0.13, 0.13)
#: points of the curve at which the score checks whether the seam is visible
_CURVE_POINTS = 400
#: degree of seam from which a pixel counts as visible seam
_SEEN = 0.15


def _grid() -> Floats:
    """Return rotations (n, 3, 3) spread evenly: the super-Fibonacci spiral (M. Alexa, CVPR 2022, 8281-8290)."""
    phi, psi = np.sqrt(2.0), 1.533751168755204288118041
    s = np.arange(_TRIED) + 0.5
    t, d = s / _TRIED, 2.0 * np.pi * s
    r, R = np.sqrt(t), np.sqrt(1.0 - t)
    alpha, beta = d / phi, d / psi
    quaternions = np.column_stack([r * np.sin(alpha), r * np.cos(alpha), R * np.sin(beta), R * np.cos(beta)])
    return Rotation.from_quat(quaternions).as_matrix()


#: distances from the curve from which on pixels have no weight, by iteration [rad]: large at first, for a poor start
_REACHES = (0.28, 0.2, 0.14, 0.12, 0.12)
#: quality from which a frame is tracked, and from which the result of a new search is accepted
_TRACKED, _FOUND = 0.55, 0.7
#: fewest pixels of a seam
_LEAST_PIXELS = 60
#: while lost, the orientation is searched in one frame of so many
_SEARCHED_EVERY = 4
#: largest difference to the predicted orientation [rad]
_LARGEST_JUMP = 0.35


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """The ball's orientation in every frame."""

    stated: Floats  #: (n,) times of the frames, as the video states them [s]
    R: Floats  #: (n, 3, 3) ball frame to camera frame; NaN where lost
    information: Floats  #: (n, 3, 3) from `SeamFit`, camera frame
    bias: Floats  #: (n, 3, 3) from `SeamFit`, camera frame [rad^2]
    quality: Floats  #: (n,) 0 to 1
    stretch: NDArray[np.int64]  #: (n,) number of the stretch; -1 if lost

    @property
    def tracked(self) -> Bools:
        """Which frames (n,) were tracked."""
        return self.stretch >= 0


class _Follower:
    """Fits an orientation to the seam of one frame after the other, and keeps the state between them."""

    def __init__(self, finder: SeamFinder, table: SeamTable) -> None:
        self._finder, self._table = finder, table
        self._last: Floats | None = None
        self._turn = np.zeros(3)  # over the last frame, camera frame [rad]
        self._settled = False  # whether that is known
        self._lost = 0  # frames since the last that was tracked
        self._stretch = -1

    def next(self, frame: NDArray[np.uint8]) -> tuple[SeamFit, float, int] | None:
        """Return the orientation, its quality and its stretch; None if the ball is lost."""
        seen, seam = self._finder.find(frame)
        enough = len(seen.p) >= _LEAST_PIXELS
        result = (self._followed(seen, seam) or self._searched(seen, seam)) if enough else None
        if result is None:
            self._lost, self._settled = self._lost + 1, False
            return None
        self._lost = 0
        return *result, self._stretch

    def _followed(self, seen: SeamPoints, seam: NDArray[np.float32]) -> tuple[SeamFit, float] | None:
        if self._last is None or self._lost > 1:
            return None
        turn = self._turn * (1.0 + self._lost)
        predicted = Rotation.from_rotvec(turn).as_matrix() @ self._last
        fit = fit_rotation(self._table, seen, predicted, reaches=_REACHES)
        quality = self._score(fit, seam)
        jump = float(Rotation.from_matrix(fit.R @ predicted.T).magnitude())
        if quality < _TRACKED or jump > _LARGEST_JUMP:
            if self._settled:
                return None
            # the second frame of a stretch: the angular velocity is not known yet
            fit, quality = self._localise(seen, seam, near=self._last)
            if quality < _FOUND:
                return None
        whole = Rotation.from_matrix(fit.R @ self._last.T).as_rotvec() / (1.0 + self._lost)
        if np.linalg.norm(whole) > 1.0:  # a symmetric orientation
            return None
        self._turn, self._last, self._settled = whole, fit.R, True
        return fit, quality

    def _searched(self, seen: SeamPoints, seam: NDArray[np.float32]) -> tuple[SeamFit, float] | None:
        if self._last is not None and self._lost % _SEARCHED_EVERY:
            return None
        fit, quality = self._localise(seen, seam, near=self._last)
        if quality < _FOUND:
            return None
        self._last, self._turn, self._settled = fit.R, np.zeros(3), False
        self._stretch += 1
        return fit, quality

    def _score(self, fit: SeamFit, seam: NDArray[np.float32]) -> float:
        """Return the smaller of what a fit explains of the seam's pixels and what is seen of the curve, 0 to 1.

        `seam` (m,) is how much each pixel used is seam; the curve counts where a pixel is used.
        """
        curve = self._table.seam.points
        points = curve[:: max(1, len(curve) // _CURVE_POINTS)] @ fit.R.T
        pixels = self._finder.pixels
        index = pixels.index_at(pixels.view.project(points[points @ pixels.toward > pixels.rim])[0])
        index = index[index >= 0]
        return min(fit.inliers, float(np.mean(seam[index] > _SEEN))) if len(index) else 0.0

    def _localise(
        self, seen: SeamPoints, seam: NDArray[np.float32], *, near: Floats | None
    ) -> tuple[SeamFit, float]:
        """Return the best orientation for a frame, and its score; among some as good, the nearest to `near` (3, 3)."""
        # those with more weight are likelier to be chosen; the same for the same frame
        chosen = np.searchsorted(np.cumsum(seen.area), np.linspace(0.0, 0.999, _POINTS) * seen.area.sum())
        few = seen.p[np.minimum(chosen, len(seen.p) - 1)]
        grid = _grid().astype(np.float32)
        q = np.einsum("pi,gij->gpj", few, grid).reshape(-1, 3)
        r = np.einsum("ki,ki->k", q, self._table.normals_at(q)).reshape(len(grid), -1)
        cost = np.minimum(r * r, np.float32(_FAR**2)).mean(axis=1)
        best = []
        for k in np.argsort(cost, kind="stable")[:_REFINED]:
            fit = fit_rotation(self._table, seen, grid[k].astype(np.float64), reaches=_SEARCH_REACHES)
            best.append((fit, self._score(fit, seam)))
        top = max(best, key=lambda candidate: candidate[1])
        if near is None:
            return top
        alike = [candidate for candidate in best if candidate[1] > 0.97 * top[1]]
        return max(alike, key=lambda candidate: float(np.trace(candidate[0].R.T @ near)))


def follow(
    frames: Iterable[tuple[float, NDArray[np.uint8]]],
    finder: SeamFinder,
    table: SeamTable,
    *,
    frame_count: int,
    progress: ProgressCallback,
) -> Track:
    """Return the orientation in every frame of a video, by its stated time [s] and its picture (height, width, 3).

    `frame_count` is the largest number of frames, for the progress; 0 if it is not known.
    """
    follower, stated = _Follower(finder, table), list[float]()
    results: list[tuple[SeamFit, float, int] | None] = []
    for count, (time, frame) in enumerate(frames, start=1):
        stated.append(time)
        results.append(follower.next(frame))
        total = frame_count or 1
        progress(Progress(stage="tracking", done=min(count, total), total=total))

    def matrices(of: Callable[[SeamFit], Floats]) -> Floats:
        nothing = np.full((3, 3), np.nan)
        return np.array([of(result[0]) if result else nothing for result in results]).reshape(-1, 3, 3)

    return Track(
        stated=np.array(stated),
        R=matrices(lambda fit: fit.R),
        information=matrices(lambda fit: fit.information),
        bias=matrices(lambda fit: fit.bias),
        quality=np.array([result[1] if result else 0.0 for result in results]),
        stretch=np.array([result[2] if result else -1 for result in results], dtype=np.int64),
    )


#: initial standard deviations of the error [rad], velocity [rad/s] and acceleration [rad/s^2]
_BEFORE = (0.1, 20.0, 200.0)
#: q/s^2 is estimated between these [1/s^5], on so many frames
_DENSITIES = (1.0, 1e12)
_SEARCHED = 480
#: s^2 of a seam's pixels, roughly [rad^2]: only for the state before the first frame
_ROUGHLY = 1e-3
#: innovations and biases are averaged over this time to either side, because noise and light may change [s]
_SPAN = 0.5
#: information about an axis below this fraction of the total may come from small errors of the view and the curve
_NEGLIGIBLE = 1e-3
#: rotation by which the seam moves to other pixels, with other errors [rad]
_OTHER_SIDE = 0.13
_EYE = np.eye(3)


@dataclass(frozen=True, kw_only=True, eq=False)
class Velocity:
    """The ball's angular velocity at each frame, camera frame; NaN if it is not known."""

    omega: Floats  #: (n, 3) [rad/s]
    covariance: Floats  #: (n, 3, 3) [rad^2/s^2]


class _Steps(NamedTuple):
    """The smoother's model of a stretch of frames."""

    F: Floats  #: (n - 1, 9, 9)
    shift: Floats  #: (n - 1, 9)
    steps: Floats  #: (n - 1,) [s]
    H: Floats  #: (n, 3, 3)


#: mean and covariance of each frame's state
_States = list[tuple[Floats, Floats]]


def angular_velocity(t: Floats, track: Track) -> Velocity:
    """Return the angular velocity at each frame of a track, at times t (n,) [s]."""
    omega, covariance = np.full((len(t), 3), np.nan), np.full((len(t), 3, 3), np.nan)
    # lost frames within a stretch are left out
    numbered = [np.flatnonzero(track.stretch == k) for k in range(int(track.stretch.max(initial=-1)) + 1)]
    stretches = [rows for rows in numbered if len(rows) >= LEAST_FRAMES]
    if not stretches:
        return Velocity(omega=omega, covariance=covariance)
    density = _density(_made_ready(t, track, max(stretches, key=len)[:_SEARCHED]))
    for rows in stretches:
        ready = _made_ready(t, track, rows)
        before, after, misfit, _ = _filter(ready, density)
        smooth = _smooth(ready, before, after)
        omega[rows] = [mean[3:6] for mean, _ in smooth]
        spread = np.array([P[3:6, 3:6] for _, P in smooth])
        biased = (np.linalg.norm(omega[rows], axis=1) / _OTHER_SIDE) ** 2
        local, bias = _averaged(misfit / 3.0, t[rows]), _averaged(track.bias[rows], t[rows])
        covariance[rows] = spread * local[:, None, None] + bias * biased[:, None, None]
    return Velocity(omega=omega, covariance=covariance)


def _made_ready(t: Floats, track: Track, rows: NDArray[np.intp]) -> _Steps:
    steps = np.diff(t[rows])
    F, shift = np.zeros((len(steps), 9, 9)), np.zeros((len(steps), 9))
    orientations, dt = Rotation.from_matrix(track.R[rows]), steps[:, None, None]
    turns = orientations[1:] * orientations[:-1].inv()
    f = turns.as_rotvec()
    bend = _EYE + 0.5 * np.cross(f[:, None], _EYE).swapaxes(1, 2)
    F[:, :3, :3], F[:, :3, 3:6], F[:, :3, 6:] = turns.as_matrix(), dt * bend, 0.5 * dt**2 * bend
    F[:, 3:6, 3:6], F[:, 3:6, 6:], F[:, 6:, 6:] = _EYE, dt * _EYE, _EYE
    shift[:, :3] = -np.einsum("kij,kj->ki", bend, f)
    sizes, axes = np.linalg.eigh(track.information[rows])
    trusted = np.maximum(sizes - _NEGLIGIBLE * sizes.sum(axis=1, keepdims=True), 0.0)
    return _Steps(F=F, shift=shift, steps=steps, H=np.einsum("kij,kj,klj->kil", axes, trusted, axes))


def _density(ready: _Steps) -> float:
    """Return the maximum-likelihood q / s^2, with s^2 concentrated out."""

    def cost(logarithm_of_density: float) -> float:
        _, _, misfit, surprise = _filter(ready, float(np.exp(logarithm_of_density)))
        count = 3.0 * len(misfit)
        return surprise + count * float(np.log(misfit.sum() / count))

    low, high = np.log(_DENSITIES)
    return float(np.exp(optimize.fminbound(cost, low, high, xtol=0.3)))


def _filter(ready: _Steps, density: float) -> tuple[_States, _States, Floats, float]:
    """Return the states before and with each frame of the Kalman filter with s = 1, and how well they fit.

    That is each frame's squared innovation by its covariance (n,), 3 expected, and the sum of the logarithms of these
    covariances.
    """
    mean = np.zeros(9)
    P = np.diag(np.repeat(np.square(_BEFORE), 3)) / _ROUGHLY
    before, after = [], []
    misfit, surprise = np.empty(len(ready.H)), 0.0
    for k, H in enumerate(ready.H):
        if k:
            mean = ready.F[k - 1] @ mean + ready.shift[k - 1]
            P = ready.F[k - 1] @ P @ ready.F[k - 1].T + density * _jerk(ready.steps[k - 1])
        before.append((mean, P))
        # with S = P_ee + H^-1 in a form that remains valid if a frame has no information about an axis
        A = _EYE + H @ P[:3, :3]
        gain = np.linalg.solve(A, H)  # S^-1
        e = mean[:3]
        misfit[k] = e @ gain @ e
        surprise += float(np.log(np.linalg.det(A)))
        K = P[:, :3] @ gain
        mean = mean - K @ e
        P = P - K @ P[:3, :]
        P = 0.5 * (P + P.T)
        after.append((mean, P))
    return before, after, misfit, surprise


def _smooth(ready: _Steps, before: _States, after: _States) -> _States:
    """Return mean and covariance of each frame by all frames."""
    mean, P = after[-1]
    states = [(mean, P)]
    for F, (here, P_here), (then, P_then) in zip(ready.F[::-1], after[-2::-1], before[:0:-1], strict=True):
        G = np.linalg.solve(P_then, F @ P_here).T
        mean, P = here + G @ (mean - then), P_here + G @ (P - P_then) @ G.T
        states.append((mean, P))
    return states[::-1]


def _jerk(dt: float) -> Floats:
    """Return the covariance (9, 9) that white jerk of density 1 adds over a step to angle, velocity, acceleration."""
    a, b, c, d, e = dt**5 / 20.0, dt**4 / 8.0, dt**3 / 6.0, dt**3 / 3.0, dt**2 / 2.0
    return np.kron(np.array([[a, b, c], [b, d, e], [c, e, dt]]), _EYE).astype(np.float64)


def _averaged(values: Floats, t: Floats) -> Floats:
    """Return running means (n, ...) over `_SPAN` to either side."""
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    first, last = np.searchsorted(t, t - _SPAN), np.searchsorted(t, t + _SPAN, side="right")
    count = (last - first).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray((total[last] - total[first]) / count, np.float64)
