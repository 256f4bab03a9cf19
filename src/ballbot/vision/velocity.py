"""Angular velocity from orientations, by a smoother of the orientations' errors, velocity and acceleration.

    e_(k+1) = exp([f_k]) e_k + (1 + [f_k]/2) (omega dt + a dt^2 / 2 - f_k),     f_k = log(R_(k+1) R_k^T)
    omega' = a,  a' = white noise of density q;      0 = e_k + noise of covariance s^2 H_k^-1

R_k is what the frame's fit found and exp(e_k) R_k what is true; H_k is the fit's information less what is too small
to be believed, so that a frame that does not tell a turn about some axis adds nothing about it. q/s^2 is the
likeliest by the filter's innovations, which give s too. Filter and smoother: H. E. Rauch, F. Tung and C. T.
Striebel, AIAA Journal 3 (1965) 1445-1450.

Added to the smoother's covariance is that of errors which do not change from frame to frame but as the ball turns:
the fits' bias, times the square of the angle turned a second over the angle at which they are others.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from ballbot.vision.seam import exponential, logarithm
from ballbot.vision.tracking import Track
from ballbot.vision.video import LEAST_FRAMES

#: before the first frame, standard deviations of the error [rad], velocity [rad/s] and acceleration [rad/s^2]
_BEFORE = (0.1, 20.0, 200.0)
#: the density of jerk is sought between these [rad^2/s^5], on so many frames
_DENSITIES = (0.1, 3e7)
_SEARCHED = 480
#: innovations and biases are averaged over this to either side, for noise and light may change [s]
_SPAN = 0.5
#: information about an axis below this share of the whole comes as well from small errors of the view and the curve
_UNBELIEVED = 1e-3
#: turned by this, the ball shows its seam to other patches of the picture [rad]
_OTHER_SIDE = 0.13
_EYE = np.eye(3)


@dataclass(frozen=True, kw_only=True, eq=False)
class Velocity:
    """The ball's angular velocity at each frame, camera frame; NaN where it is not known."""

    omega: NDArray[np.float64]  #: (n, 3) [rad/s]
    covariance: NDArray[np.float64]  #: (n, 3, 3) [rad^2/s^2]
    noise: float  #: s of the fits' information


@dataclass(frozen=True, kw_only=True, eq=False)
class _Steps:
    """A stretch of frames, made ready."""

    F: NDArray[np.float64]  #: (n - 1, 9, 9)
    shift: NDArray[np.float64]  #: (n - 1, 9)
    steps: NDArray[np.float64]  #: (n - 1,) [s]
    H: NDArray[np.float64]  #: (n, 3, 3)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Filtered:
    before: list[tuple[NDArray[np.float64], NDArray[np.float64]]]  #: mean and covariance before each frame
    after: list[tuple[NDArray[np.float64], NDArray[np.float64]]]  #: and with it
    misfit: NDArray[np.float64]  #: (n,) squared innovations by their covariance, 3 expected
    surprise: float  #: sum of the logarithms of the innovations' covariances


def angular_velocity(t: NDArray[np.float64], track: Track) -> Velocity:
    """Return the angular velocity at each frame of a track.

    Parameters
    ----------
    t : ndarray (n,)
        Times of the frames [s].
    track : Track
    """
    omega, covariance = np.full((len(t), 3), np.nan), np.full((len(t), 3, 3), np.nan)
    stretches = [rows for rows in _stretches(track) if len(rows) >= LEAST_FRAMES]
    if not stretches:
        return Velocity(omega=omega, covariance=covariance, noise=float("nan"))
    longest = max(stretches, key=len)[:_SEARCHED]
    guess = _first_guess(track, longest)
    density = _density(_made_ready(t, track, longest), guess)
    noises = []
    for rows in stretches:
        ready = _made_ready(t, track, rows)
        filtered = _filter(ready, density, guess)
        smooth = _smooth(ready, filtered)
        local = _averaged(filtered.misfit / 3.0, t[rows])
        omega[rows] = [mean[3:6] for mean, _ in smooth]
        spread = np.array([P[3:6, 3:6] for _, P in smooth])
        biased = (np.linalg.norm(omega[rows], axis=1) / _OTHER_SIDE) ** 2
        bias = _averaged(track.bias[rows], t[rows])
        covariance[rows] = spread * local[:, None, None] + bias * biased[:, None, None]
        noises.append(float(np.sqrt(np.mean(filtered.misfit / 3.0))))
    return Velocity(omega=omega, covariance=covariance, noise=float(np.mean(noises)))


def _stretches(track: Track) -> list[NDArray[np.intp]]:
    """Return the rows of each stretch; a lost frame between two of the same stretch is simply not there."""
    return [
        np.flatnonzero(track.stretch == number) for number in range(int(track.stretch.max(initial=-1)) + 1)
    ]


def _first_guess(track: Track, rows: NDArray[np.intp]) -> float:
    """Return s^2 by third differences of the orientations, in which smooth motion is small and noise twenty-fold."""
    turns = np.array([logarithm(track.R[b] @ track.R[a].T) for a, b in pairwise(rows)])
    third = np.diff(turns, n=2, axis=0)
    if len(third) == 0:
        return 1e-3
    sizes = np.einsum("ki,kij,kj->k", third, track.information[rows[1:-2]], third) / 60.0
    return max(float(np.median(sizes)), 1e-9)


def _made_ready(t: NDArray[np.float64], track: Track, rows: NDArray[np.intp]) -> _Steps:
    steps = np.diff(t[rows])
    F, shift = np.zeros((len(steps), 9, 9)), np.zeros((len(steps), 9))
    for k, (a, b, dt) in enumerate(zip(rows, rows[1:], steps, strict=False)):
        f = logarithm(track.R[b] @ track.R[a].T)
        bend = _EYE + 0.5 * np.array([[0.0, -f[2], f[1]], [f[2], 0.0, -f[0]], [-f[1], f[0], 0.0]])
        F[k, :3, :3], F[k, :3, 3:6], F[k, :3, 6:] = exponential(f), dt * bend, 0.5 * dt**2 * bend
        F[k, 3:6, 3:6], F[k, 3:6, 6:], F[k, 6:, 6:] = _EYE, dt * _EYE, _EYE
        shift[k, :3] = -bend @ f
    sizes, axes = np.linalg.eigh(track.information[rows])
    believed = np.maximum(sizes - _UNBELIEVED * sizes.sum(axis=1, keepdims=True), 0.0)
    return _Steps(F=F, shift=shift, steps=steps, H=np.einsum("kij,kj,klj->kil", axes, believed, axes))


def _density(ready: _Steps, guess: float) -> float:
    """Return q / s^2 of the largest likelihood, s^2 being the likeliest for each."""

    def cost(logarithm_of_density: float) -> float:
        filtered = _filter(ready, float(np.exp(logarithm_of_density)), guess)
        count = 3.0 * len(filtered.misfit)
        return filtered.surprise + count * float(np.log(filtered.misfit.sum() / count))

    low, high = np.log(np.divide(_DENSITIES, guess))
    return float(np.exp(optimize.fminbound(cost, low, high, xtol=0.3)))


def _filter(ready: _Steps, density: float, guess: float) -> _Filtered:
    """Return the Kalman filter's path with s = 1."""
    mean = np.zeros(9)
    P = np.diag(np.repeat(np.square(_BEFORE), 3)) / guess
    before, after = [], []
    misfit, surprise = np.empty(len(ready.H)), 0.0
    for k, H in enumerate(ready.H):
        if k:
            mean = ready.F[k - 1] @ mean + ready.shift[k - 1]
            P = ready.F[k - 1] @ P @ ready.F[k - 1].T + density * _jerk(ready.steps[k - 1])
        before.append((mean, P))
        # with S = P_ee + H^-1 in a form that a frame which tells nothing about an axis does not break
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
    return _Filtered(before=before, after=after, misfit=misfit, surprise=surprise)


def _smooth(ready: _Steps, filtered: _Filtered) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return mean and covariance of each frame by all frames."""
    mean, P = filtered.after[-1]
    found = [(mean, P)]
    for k in range(len(ready.steps) - 1, -1, -1):
        here, P_here = filtered.after[k]
        then, P_then = filtered.before[k + 1]
        G = np.linalg.solve(P_then, ready.F[k] @ P_here).T
        mean = here + G @ (mean - then)
        P = P_here + G @ (P - P_then) @ G.T
        found.append((mean, P))
    return found[::-1]


def _jerk(dt: float) -> NDArray[np.float64]:
    """Return the covariance (9, 9) that white jerk of density 1 adds over a step to angle, velocity, acceleration."""
    Q = np.array(
        [
            [dt**5 / 20.0, dt**4 / 8.0, dt**3 / 6.0],
            [dt**4 / 8.0, dt**3 / 3.0, dt**2 / 2.0],
            [dt**3 / 6.0, dt**2 / 2.0, dt],
        ]
    )
    return np.kron(Q, _EYE).astype(np.float64)


def _averaged(values: NDArray[np.float64], t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return running means (n, ...) over `_SPAN` to either side."""
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    first, last = np.searchsorted(t, t - _SPAN), np.searchsorted(t, t + _SPAN, side="right")
    count = (last - first).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray((total[last] - total[first]) / count, np.float64)
