"""Clock and rotation by least squares on how the body turned over half a second; and flips of the marker body.

    e_k = R (C(t_k + h) - C(t_k)) - (L(s_k+h) - L(s_k)) + b h,      s = (t - offset) / (1 + rate)

C and L are the running totals of cameras and log, R takes the marker frame to the log's body frame, b is the gyro's
bias. R starts from the closed form of Wahba's problem on the same increments (F. L. Markley, J. Astronautical Sciences
36 (1988) 245-258), which is also how hand-eye calibration finds it. Standard errors are clustered by blocks of time,
because residuals depend on each other over seconds.

Symmetric markers make the marker body's frame jump by 90 or 180 degrees. The jumps are found by the log, and undone:

    R_seen = R F,   F one of the 24 rotations of a cube, constant from break to break

Across a break the log gives the body's turning, M in the marker frame, so that F after it follows from F before:
F_b = the cube's rotation nearest to M^T F_a R_a^T R_b.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.fitting.least_squares import fit_linear
from ballbot.fitting.uncertainty import covariance_in_time
from ballbot.log.pose import Poses
from ballbot.validation.alignment.clock import Clock, Turning, broken

#: length of a block [s], and how many there are at least
_BLOCK = 5.0
_LEAST_BLOCKS = 8


def _blocks(times: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the number of the block of time (n,) that each of increasing times (n,) [s] is in."""
    length = max(min(_BLOCK, (times[-1] - times[0]) / _LEAST_BLOCKS), 1e-9)
    return np.unique(((times - times[0]) / length).astype(np.int64), return_inverse=True)[1].astype(np.int64)


def _quantile(blocks: NDArray[np.int64]) -> float:
    """Return Student's t for 95 % with as many blocks."""
    return float(scipy.stats.t.ppf(0.975, max(int(blocks.max()), 1)))


def fit_in_blocks(
    J: NDArray[np.float64], values: NDArray[np.float64], times: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the parameters (p,) with which J (n, c, p) explains the values (n, c), and their 95 % half widths (p,)."""
    blocks = _blocks(times)
    fit = fit_linear(J.reshape(-1, J.shape[2]), values.ravel(), np.repeat(blocks, values.shape[1]))
    return fit.values, _quantile(blocks) * fit.errors


#: increments are over this [s]: long beside the cameras' noise, short beside a gyro's drift
SPAN = 0.5
#: increments at the most; more only repeat one another
_MOST = 12000
_LEAST = 60
_ITERATIONS = 25
#: errors beyond so many standard deviations count less (Huber)
_TUNING = 2.5
#: standard error from which an angle counts as not determined [rad]
UNDETERMINED = 0.1


#: a step beyond this [s, rad, rad/s] leads nowhere
_LARGEST_STEP = 1e3


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionFit:
    """The clock and the rotation, with 95 % half widths by blocks of time."""

    clock: Clock
    body_marker: Rotation  #: marker frame to the log's body frame
    bias: NDArray[np.float64]  #: (3,) of the log's gyro [rad/s], body frame
    offset_half_width: float  #: [s]
    rate_half_width: float  #: [s/s]
    rotation_half_width: NDArray[np.float64]  #: (3,) about the body's axes [rad]; infinite if not determined
    unobservable_axis: NDArray[np.float64] | None  #: (3,) axis of the body, turning about which is unknown
    error: float  #: rms of an increment's error, a component [rad]
    motion: float  #: rms of an increment, a component [rad]
    increments: int


@dataclass(frozen=True, kw_only=True, eq=False)
class _Increments:
    """Rotations that the cameras saw over `SPAN`, and their times."""

    start: NDArray[np.float64]  #: (n,) [s], the cameras' clock
    end: NDArray[np.float64]  #: (n,)
    turned: NDArray[np.float64]  #: (n, 3) [rad], marker frame


def wahba(log: Turning, cameras: Turning, clock: Clock, *, rows: tuple[int, int] | None = None) -> Rotation:
    """Return the rotation, marker frame to body frame, that fits the increments best, given a clock.

    Parameters
    ----------
    log, cameras : Turning
    clock : Clock
    rows : tuple of int, optional
        First and last row of the cameras' that count.

    Raises
    ------
    InputError
        If there are too few increments that both have.
    """
    increments = _cut(log, cameras, clock, rows)
    s0, s1 = clock.to_log(increments.start), clock.to_log(increments.end)
    turned = log.at(s1) - log.at(s0)
    # a constant rate, the gyro's bias, is no motion
    U, _, Vt = np.linalg.svd(_centred(turned).T @ _centred(increments.turned))
    return Rotation.from_matrix(U @ np.diag([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)]) @ Vt)


def fit_motion(log: Turning, cameras: Turning, clock: Clock, body_marker: Rotation) -> MotionFit:
    """Return the clock, rotation and bias under which log and cameras turn alike, from a start near them.

    Raises
    ------
    InputError
        If there are too few increments that both have, or the fit runs away from the start.
    """
    increments = _cut(log, cameras, clock, None)
    middle = float(np.mean(clock.to_log(increments.start)))
    bias = np.zeros(3)
    weights = np.ones(len(increments.start))
    for _ in range(_ITERATIONS):
        residuals, J = _equations(log, increments, clock, body_marker, bias, middle)
        size = np.linalg.norm(residuals, axis=1)
        scale = 1.4826 * float(np.median(size)) / 1.5382  # the median length of three unit normals
        weights = np.minimum(1.0, _TUNING * np.sqrt(3.0) * scale / np.maximum(size, 1e-300))
        # from a wrong start the clock runs off the log, where nothing turns and steps have no bound
        with np.errstate(over="ignore", invalid="ignore"):
            step = _solved(J, residuals, weights)[0]
        if not np.abs(step).max() < _LARGEST_STEP:
            raise InputError(
                "Log and motion capture do not turn alike: no clock near that start makes them match."
            )
        clock = _moved(clock, step[0], step[1], middle)
        body_marker = Rotation.from_rotvec(step[2:5]) * body_marker
        bias = bias + step[5:]
        if abs(step[0]) < 1e-7 and np.abs(step[2:5]).max() < 1e-7:
            break
    residuals, J = _equations(log, increments, clock, body_marker, bias, middle)
    inverse = _solved(J, residuals, weights)[1]
    blocks = _blocks(increments.start)
    covariance = covariance_in_time(
        (J * weights[:, None, None]).reshape(-1, J.shape[2]),
        residuals.ravel(),
        np.repeat(blocks, residuals.shape[1]),
        inverse=inverse,
    )
    return _with_half_widths(
        clock,
        body_marker,
        bias,
        covariance,
        _quantile(blocks),
        middle,
        increments=increments,
        residuals=residuals,
    )


def _cut(log: Turning, cameras: Turning, clock: Clock, rows: tuple[int, int] | None) -> _Increments:
    first, last = rows or (0, len(cameras.t) - 1)
    starts = np.arange(first, last + 1, max(1, (last - first) // _MOST))
    ends = np.searchsorted(cameras.t, cameras.t[starts] + SPAN)
    starts, ends = starts[ends <= last], ends[ends <= last]
    start, end = cameras.t[starts], cameras.t[ends]
    s0, s1 = clock.to_log(start), clock.to_log(end)
    # a margin, for the clock moves
    usable = (cameras.missing[ends] == cameras.missing[starts]) & log.covers(s0 - 0.05, s1 + 0.05)
    if usable.sum() < _LEAST:
        raise InputError(
            f"Log and motion capture share {usable.sum()} intervals of "
            f"{SPAN:g} s without a gap; at least {_LEAST} are needed."
        )
    starts, ends = starts[usable], ends[usable]
    return _Increments(
        start=start[usable], end=end[usable], turned=cameras.total[ends] - cameras.total[starts]
    )


def _equations(
    log: Turning, increments: _Increments, clock: Clock, body_marker: Rotation, bias: NDArray[np.float64],
    middle: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
    """Return residuals (n, 3) and their derivative (n, 3, 8) by offset at `middle`, rate, rotation and bias."""
    s0, s1 = clock.to_log(increments.start), clock.to_log(increments.end)
    rotated = body_marker.apply(increments.turned)
    span = s1 - s0
    residuals = rotated - (log.at(s1) - log.at(s0)) + bias * span[:, None]
    J = np.zeros((len(span), 3, 8))
    w0, w1 = log.rate_at(s0) - bias, log.rate_at(s1) - bias
    J[:, :, 0] = (w1 - w0) / (1.0 + clock.rate)
    J[:, :, 1] = (w1 * (s1 - middle)[:, None] - w0 * (s0 - middle)[:, None]) / (1.0 + clock.rate)
    # d (exp(d) v) = d x v
    J[:, 0, 3], J[:, 0, 4] = rotated[:, 2], -rotated[:, 1]
    J[:, 1, 2], J[:, 1, 4] = -rotated[:, 2], rotated[:, 0]
    J[:, 2, 2], J[:, 2, 3] = rotated[:, 1], -rotated[:, 0]
    J[:, [0, 1, 2], [5, 6, 7]] = span[:, None]
    return residuals, J


def _solved(
    J: NDArray[np.float64], residuals: NDArray[np.float64], weights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the Gauss-Newton step (8,) and the inverse (8, 8) of its faintly damped matrix."""
    flat = J.reshape(-1, J.shape[2])
    w = np.repeat(weights, 3)
    H = (flat * w[:, None]).T @ flat
    scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    # a quantity that the motion does not determine keeps its value
    inverse = np.linalg.inv(H * np.outer(scale, scale) + 1e-9 * np.eye(len(H))) * np.outer(scale, scale)
    return -inverse @ (flat * w[:, None]).T @ residuals.ravel(), inverse


def _moved(clock: Clock, shift: float, change: float, middle: float) -> Clock:
    rate = clock.rate + change
    return Clock(
        offset=float(clock.to_cameras(np.array(middle)) + shift - (1.0 + rate) * middle), rate=float(rate)
    )


def _with_half_widths(
    clock: Clock, body_marker: Rotation, bias: NDArray[np.float64], covariance: NDArray[np.float64],
    quantile: float, middle: float, *, increments: _Increments, residuals: NDArray[np.float64],
) -> MotionFit:  # fmt: skip
    to_zero = np.array([1.0, -middle])  # offset at the log's zero from offset at `middle` and rate
    axes, variances = _by_motion(increments, residuals, body_marker)
    half = quantile * np.sqrt(np.diag(covariance)[2:5])
    unobservable = None
    if variances.max() > UNDETERMINED**2:
        unobservable = axes[:, int(np.argmax(variances))]
        unobservable = unobservable * np.sign(unobservable[np.argmax(np.abs(unobservable))])
        half = np.where(np.abs(unobservable) > 0.3, np.inf, half)
    return MotionFit(
        clock=clock,
        body_marker=body_marker,
        bias=bias,
        offset_half_width=float(quantile * np.sqrt(to_zero @ covariance[:2, :2] @ to_zero)),
        rate_half_width=float(quantile * np.sqrt(covariance[1, 1])),
        rotation_half_width=half,
        unobservable_axis=unobservable,
        error=_rms(residuals),
        motion=_rms(_centred(increments.turned)),
        increments=len(residuals),
    )


def _by_motion(
    increments: _Increments, residuals: NDArray[np.float64], body_marker: Rotation
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return axes (3, 3), in columns, and the variance (3,) of a rotation about each that the motion allows.

    If all turning is about one axis, a rotation about it changes the residuals hardly, and clustered errors do not show
    this. The motion about the other two axes that log and cameras have in common, without their noise, determines it:
    the singular values of the covariance between the two. One independent increment is counted for each `SPAN`.
    """
    turned = _centred(body_marker.apply(increments.turned))
    logged = turned - _centred(residuals)
    U, shared, Vt = np.linalg.svd(logged.T @ turned / len(turned))
    shared[2] *= np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    independent = len(turned) * min(1.0, float(np.median(np.diff(increments.start))) / SPAN)
    across = np.maximum(np.sum(shared) - shared, 1e-300)
    return U, np.minimum(np.mean(residuals**2) / (independent * across), np.pi**2)


def _centred(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return values - np.median(values, axis=0)


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


#: further than this from every rotation of the cube, it is something else [rad]
_LARGEST_REMAINDER = np.radians(30.0)
_LONGEST_BREAK = 20.0  #: over which a gyro is believed [s]


@dataclass(frozen=True, kw_only=True)
class Flip:
    """A change of the marker body's frame."""

    t: float  #: of the cameras' clock [s]
    angle: float  #: [rad], of a rotation of a cube
    axis: tuple[float, float, float]  #: in the marker frame, a unit vector


@cache
def cube_rotations() -> Rotation:
    """Return the 24 rotations that leave a cube in place."""
    return Rotation.create_group("O")


def nearest_cube_rotation(rotation: Rotation) -> tuple[Rotation, float]:
    """Return the cube's rotation nearest to one, and the angle between the two [rad]."""
    group = cube_rotations()
    angles = (group.inv() * rotation).magnitude()
    best = int(np.argmin(angles))
    return group[best], float(angles[best])


def unbroken_stretches(poses: Poses) -> list[tuple[int, int]]:
    """Return the first and last row of every stretch of poses without a break, in their order."""
    unbroken = ~broken(poses)
    edges = np.diff(np.concatenate([[False], unbroken, [False]]).astype(np.int8))
    return list(zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True))


def undo_flips(
    poses: Poses,
    found: list[tuple[int, int]],
    anchor: int,
    *,
    log: Turning,
    clock: Clock,
    body_marker: Rotation,
) -> tuple[Poses, tuple[Flip, ...]]:
    """Return the poses in the frame that the marker body has in one stretch, and where it changed.

    Parameters
    ----------
    poses : Poses
    found : list of tuple of int
        Their `stretches`.
    anchor : int
        The number of the stretch whose frame all get.
    log : Turning
        Of the same body.
    clock : Clock
    body_marker : Rotation
        Marker frame to body frame, in the anchor.
    """
    undo = [Rotation.identity()] * len(found)
    for right in range(anchor + 1, len(found)):
        M, seen = _across(poses, found[right - 1], found[right], log, clock, body_marker)
        undo[right] = (
            undo[right - 1] if M is None else _nearest_or(M.inv() * undo[right - 1] * seen, undo[right - 1])
        )
    for left in range(anchor - 1, -1, -1):
        M, seen = _across(poses, found[left], found[left + 1], log, clock, body_marker)
        undo[left] = (
            undo[left + 1] if M is None else _nearest_or(M * undo[left + 1] * seen.inv(), undo[left + 1])
        )
    flips: list[Flip] = []
    for right in range(1, len(found)):
        change = (undo[right - 1].inv() * undo[right]).as_rotvec()
        if np.linalg.norm(change) > 0.1:
            flips.append(_flip(float(poses.t[found[right][0]]), change))
    return (_without_flips(poses, found, undo), tuple(flips)) if flips else (poses, ())


def _across(
    poses: Poses, left: tuple[int, int], right: tuple[int, int], log: Turning, clock: Clock, body_marker: Rotation
) -> tuple[Rotation | None, Rotation]:  # fmt: skip
    """Return how the body turned between two stretches, in the marker frame, by the log (None: unknown) and as seen."""
    a, b = left[1], right[0]
    M = _turned_between(log, clock, poses.t[a], poses.t[b])
    seen = poses.rotations[a].inv() * poses.rotations[b]
    return (None if M is None else body_marker.inv() * M * body_marker), seen


def _nearest_or(rotation: Rotation, otherwise: Rotation) -> Rotation:
    """Return the cube's rotation nearest to a rotation, or `otherwise` if that is not near."""
    nearest, remainder = nearest_cube_rotation(rotation)
    return nearest if remainder < _LARGEST_REMAINDER else otherwise


def _without_flips(poses: Poses, found: list[tuple[int, int]], undo: list[Rotation]) -> Poses:
    """Return the poses with every stretch's flip undone; between stretches, that of the one before."""
    quaternions = poses.rotations.as_quat()
    ends = [*(start for start, _ in found[1:]), len(quaternions)]
    begin = 0
    for end, flip in zip(ends, undo, strict=True):
        quaternions[begin:end] = (poses.rotations[begin:end] * flip.inv()).as_quat()
        begin = end
    return replace(poses, rotations=Rotation.from_quat(quaternions))


def _turned_between(log: Turning, clock: Clock, start: float, end: float) -> Rotation | None:
    """Return how the body turned between two times of the cameras, in its frame at the first; None where unknown."""
    t = clock.to_log(np.array([start, end]))
    if t[1] - t[0] > _LONGEST_BREAK or not log.covers(t[:1], t[1:])[0]:
        return None
    inside = log.t[(log.t > t[0]) & (log.t < t[1])]
    steps = Rotation.from_rotvec(np.diff(log.at(np.concatenate([t[:1], inside, t[1:]])), axis=0))
    while len(steps) > 1:  # neighbours multiplied, until one is left
        odd = steps[-1:] if len(steps) % 2 else None
        steps = steps[0 : len(steps) // 2 * 2 : 2] * steps[1::2]
        steps = Rotation.concatenate([steps, odd]) if odd is not None else steps
    return steps[0]


def _flip(t: float, change: NDArray[np.float64]) -> Flip:
    angle = float(np.linalg.norm(change))
    x, y, z = (change / angle).tolist()
    return Flip(t=t, angle=angle, axis=(x, y, z))
