"""The rotation of a body from a log and from cameras, and the clock offset and frame rotation between the two.

    t_camera = offset + (1 + rate) t_log
    e_k = R (C(t_k + h) - C(t_k)) - (L(s_k + h) - L(s_k)) + b h,      s = (t - offset) / (1 + rate)

C and L are running totals of the turning in the body frame, from the cameras and from the log: the integral of w dt
from a gyro, and the sum of log(R_k^T R_k+1) from orientations. R rotates the marker frame to the log's body frame, and
b is the bias of the gyro.

The fit starts from clocks with which both turn equally fast, which needs no frame: the speeds are correlated over all
shifts and over rates up to 1 %, with each overlap normalised by the samples that both have (D. Padfield, IEEE Trans.
Image Processing 21 (2012) 2706-2718). A periodic motion gives several peaks; all are fitted, and the most
likely one is kept. R starts from the closed solution of Wahba's problem. Large errors count less (Huber).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import fft
from scipy.spatial.transform import Rotation

from ballbot.arrays import Bools, Floats, Ints
from ballbot.errors import InputError
from ballbot.fitting.experiment import Residuals, residuals_without_states
from ballbot.fitting.fit import at_bound, fit
from ballbot.fitting.least_squares import fit_linear
from ballbot.fitting.parameter import FitParameter
from ballbot.log import Log
from ballbot.log.pose import Poses

GYRO_NAMES = ("gyro_x", "gyro_y", "gyro_z")
ANGLE_NAMES = ("theta", "phi", "psi")
#: shorter intervals between rows, and those with two lost rows, are not gaps [s]
_LONGEST_BRIDGE = 0.06


@dataclass(frozen=True, kw_only=True, eq=False)
class Turning:
    """Running totals of a body's rotation, in the body frame."""

    t: Floats  #: (N,) [s], on the clock of its source
    total: Floats  #: (N, 3) [rad]
    missing: Floats  #: (N,) running number of steps with unknown rotation

    @staticmethod
    def of(t: Floats, steps: Floats, known: Bools) -> Turning:
        """Return the totals of steps (N - 1, 3) [rad] between times (N,) [s]; unknown steps are missing."""
        total = np.concatenate([np.zeros((1, 3)), np.cumsum(np.where(known[:, None], steps, 0.0), axis=0)])
        return Turning(t=t, total=total, missing=np.concatenate([[0.0], np.cumsum(~known)]))

    @staticmethod
    def of_rates(t: Floats, rate: Floats) -> Turning:
        """Return the totals of rates (N, 3) [rad/s]; NaN are missing."""
        known = np.asarray(np.isfinite(rate).all(axis=1))
        rate = np.where(known[:, None], rate, 0.0)
        return Turning.of(
            t, 0.5 * (rate[1:] + rate[:-1]) * np.diff(t)[:, None], known[1:] & known[:-1] & ~_gaps(t)
        )

    def over(self, start: Floats, end: Floats) -> Floats:
        """Return the rotation (k, 3) [rad] from times `start` (k,) to `end`."""
        columns = [np.interp(end, self.t, total) - np.interp(start, self.t, total) for total in self.total.T]
        return np.column_stack(columns)

    def covers(self, start: Floats, end: Floats) -> Bools:
        """Return for which intervals (k,) the rotation is known throughout."""
        after = self.missing[np.clip(np.searchsorted(self.t, end), 0, len(self.t) - 1)]
        before = self.missing[np.clip(np.searchsorted(self.t, start, side="right") - 1, 0, len(self.t) - 1)]
        return (start >= self.t[0]) & (end <= self.t[-1]) & (before == after)


def log_turning(log: Log) -> Turning:
    """Return the rotation of a log from its gyro or, without one, from its angles; InputError if it has neither."""
    if has_gyro(log):
        return Turning.of_rates(log.t, _columns(log, GYRO_NAMES)[0])
    if not all(name in log for name in ANGLE_NAMES):
        raise InputError("Alignment needs the log's gyro_x, gyro_y, gyro_z, or its theta, phi, psi.")
    rotations, known = log_rotations(log)
    return Turning.of(log.t, _steps(rotations), known[1:] & known[:-1] & ~_gaps(log.t))


def has_gyro(log: Log) -> bool:
    """Return whether the log has a gyro."""
    return all(name in log for name in GYRO_NAMES)


def log_rotations(log: Log) -> tuple[Rotation, Bools]:
    """Return the log's orientations, body to world, and which (N,) are known; unknown ones repeat the last."""
    angles, known = _columns(log, ANGLE_NAMES)
    last = np.maximum.accumulate(np.where(known, np.arange(len(known)), np.argmax(known)))
    return Rotation.from_euler("XYZ", angles[last]), known


def poses_turning(poses: Poses) -> Turning:
    """Return the rotation of poses that were all seen; steps over gaps are missing."""
    return Turning.of(poses.t, _steps(poses.rotations), ~_gaps(poses.t))


def longest_bridge(t: Floats) -> float:
    """Return the longest interval between times (N,) over which values may be interpolated [s]."""
    return max(_LONGEST_BRIDGE, 2.5 * float(np.median(np.diff(t))))


def _gaps(t: Floats) -> Bools:
    return np.diff(t) > longest_bridge(t)


def _steps(rotations: Rotation) -> Floats:
    return (rotations[:-1].inv() * rotations[1:]).as_rotvec()


def _columns(log: Log, names: Sequence[str]) -> tuple[Floats, Bools]:
    """Return columns (N, k) and which rows (N,) are complete; InputError if hardly any is."""
    values = np.column_stack([log[name] for name in names])
    known = np.asarray(np.isfinite(values).all(axis=1))
    if known.sum() < 10:
        raise InputError(
            f"The log's {', '.join(names)} have values in only {known.sum()} of {len(known)} rows."
        )
    return values, known


#: step of the search grid [s], short enough not to miss a peak
_STEP = 0.02
#: averaging time of the turning speed [s], which reduces camera noise and tolerates a slightly wrong clock rate
_MEAN = 0.2
#: largest clock rate searched [s/s]: that of a microcontroller without a crystal
_LARGEST_RATE = 0.01
#: least overlap [s]
_LEAST_OVERLAP = 4.0
#: peaks that are fitted, and their least distance [s]
_PEAKS = 4
_APART = 0.3


@dataclass(frozen=True, kw_only=True)
class Clock:
    """t_camera = offset + (1 + rate) t_log."""

    offset: float  #: the cameras' time at the log's zero [s]
    rate: float  #: by which the cameras' clock runs faster [s/s]

    def to_log(self, t: Floats) -> Floats:
        """Return times of the cameras' clock as times of the log's."""
        return (t - self.offset) / (1.0 + self.rate)

    def to_cameras(self, t: Floats) -> Floats:
        """Return times of the log's clock as times of the cameras'."""
        return self.offset + (1.0 + self.rate) * t


def _candidate_clocks(log: Turning, cameras: Turning) -> list[Clock]:
    """Return up to four clocks with which log and cameras turn alike, the most likely first."""
    start, end = float(log.t[0]), float(log.t[-1])
    speeds, known = _speeds(log, np.arange(start, end, _STEP))
    # a rate off by half a step shifts the ends by a quarter of the averaging time
    count = int(np.ceil(_LARGEST_RATE * (end - start) / _MEAN))
    peaks: list[tuple[float, float, Clock]] = []
    for rate in np.linspace(-_LARGEST_RATE, _LARGEST_RATE, 2 * count + 1):
        begin = cameras.t[0] / (1.0 + rate)
        grid = np.arange(begin, cameras.t[-1] / (1.0 + rate), _STEP)
        score = _scores(speeds, known, *_speeds(cameras, (1.0 + rate) * grid))
        for _ in range(_PEAKS):
            best = int(np.argmax(score))
            if not score[best] > 0.0:
                break
            shift = begin - start + (best - len(speeds) + 1) * _STEP
            clock = Clock(offset=float((1.0 + rate) * shift), rate=float(rate))
            peaks.append((float(score[best]), float(clock.to_cameras(np.array(0.5 * (start + end)))), clock))
            score[max(0, best - int(_APART / _STEP)) : best + int(_APART / _STEP) + 1] = -np.inf
    kept: list[tuple[float, Clock]] = []
    for _, middle, clock in sorted(peaks, key=lambda peak: -peak[0]):
        if len(kept) < _PEAKS and all(abs(middle - other) > _APART for other, _ in kept):
            kept.append((middle, clock))
    return [clock for _, clock in kept]


def _speeds(turning: Turning, t: Floats) -> tuple[Floats, Floats]:
    """Return the mean turning speeds (k,) [rad/s] around times (k,), and 1 where they are known, else 0."""
    start, end = t - 0.5 * _MEAN, t + 0.5 * _MEAN
    known = turning.covers(start, end).astype(np.float64)
    return known * np.linalg.norm(turning.over(start, end), axis=1) / _MEAN, known


def _scores(a: Floats, a_known: Floats, b: Floats, b_known: Floats) -> Floats:
    """Return the z-score (len(a) + len(b) - 1,) of the correlation of `a` and `b` by shift; -inf with short overlap."""
    size = fft.next_fast_len(len(a) + len(b) - 1, real=True)

    def shifted(left: NDArray[np.complex128], right: NDArray[np.complex128]) -> Floats:
        return np.asarray(fft.irfft(left * right, size))[: len(a) + len(b) - 1]

    A, A1, A2 = (np.asarray(fft.rfft(values[::-1], size)) for values in (a, a_known, a * a))
    B, B1, B2 = (np.asarray(fft.rfft(values, size)) for values in (b, b_known, b * b))
    n = np.round(shifted(A1, B1))
    with np.errstate(divide="ignore", invalid="ignore"):
        sum_a, sum_b = shifted(A, B1), shifted(A1, B)
        covariance = shifted(A, B) - sum_a * sum_b / n
        spread_a = shifted(A2, B1) - sum_a**2 / n
        spread_b = shifted(A1, B2) - sum_b**2 / n
        correlation = covariance / np.sqrt(spread_a * spread_b)
    useful = (n * _STEP >= _LEAST_OVERLAP) & (spread_a > 1e-9) & (spread_b > 1e-9) & np.isfinite(correlation)
    # Fisher's z over its standard error: a long overlap counts more than a short accidental match
    z = np.arctanh(np.clip(np.where(useful, correlation, 0.0), -0.9999, 0.9999)) * np.sqrt(np.maximum(n, 1.0))
    return np.where(useful, z, -np.inf)


#: length of a block [s], and least number of blocks
_BLOCK = 5.0
_LEAST_BLOCKS = 8


def fit_in_blocks(J: Floats, values: Floats, times: Floats) -> tuple[Floats, Floats]:
    """Return the parameters (p,) that fit values (n, c) by J (n, c, p), and their 95 % half widths (p,)."""
    blocks, quantile = _blocks(times)
    fit = fit_linear(J.reshape(-1, J.shape[2]), values.ravel(), np.repeat(blocks, values.shape[1]))
    return fit.values, quantile * fit.errors


def _blocks(times: Floats) -> tuple[Ints, float]:
    """Return the block (n,) of each of increasing times (n,) [s], and Student's t for 95 % with as many blocks."""
    length = max(min(_BLOCK, (times[-1] - times[0]) / _LEAST_BLOCKS), 1e-9)
    blocks = np.unique(((times - times[0]) / length).astype(np.int64), return_inverse=True)[1]
    return blocks.astype(np.int64), float(scipy.stats.t.ppf(0.975, max(int(blocks.max()), 1)))


#: duration of an increment [s], long enough for the cameras' noise and short enough for the gyro's drift
SPAN = 0.5
#: largest and least number of increments
_MOST = 12000
_LEAST = 60
#: errors beyond so many standard deviations count less (Huber); number of updates of the weights
_TUNING = 2.5
_REWEIGHTED = 2
#: rates are slopes over so long to either side [s]
_SLOPE = 0.01
#: standard error beyond which a rotation is not determined [rad]
_UNDETERMINED = 0.1
#: another clock is reported if its log-likelihood gain exceeds this share of the best one's
_RIVAL = 0.5
#: clocks that differ by less in the middle of the log are the same [s]
_SAME = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionFit:
    """Clock and rotation, with 95 % half widths clustered by blocks of time."""

    clock: Clock
    body_marker: Rotation  #: marker frame to the log's body frame
    bias: Floats  #: (3,) of the log's gyro [rad/s], body frame
    offset_half_width: float  #: [s]
    rate_half_width: float  #: [s/s]
    rotation_errors: Floats  #: (3,) standard errors about the body's axes [rad]
    quantile: float  #: Student's t for 95 %, with as many blocks
    error: float  #: rms error of a component of an increment [rad]
    motion: float  #: rms of a component of an increment [rad]
    increments: int
    axis_error: float  #: standard error of the rotation about the least determined axis [rad]

    @property
    def rotation_half_width(self) -> Floats:
        """95 % half widths of `body_marker` (3,) about the body's axes [rad]."""
        return self.quantile * self.rotation_errors

    @property
    def share(self) -> float:
        """Share of the rotation that log and cameras have in common."""
        return 1.0 - (self.error / self.motion) ** 2

    @property
    def gain(self) -> float:
        """Log-likelihood ratio to no relation between log and cameras."""
        return -self.increments * float(np.log(self.error / self.motion))


def match_turning(log: Turning, cameras: Turning, *, least_share: float) -> tuple[MotionFit, Clock | None]:
    """Return the most likely clock and rotation, and the clock of another fit that is nearly as likely.

    InputError if log and cameras share less than `least_share` of the rotation, or turn about one axis only.
    """
    fits = [fit for clock in _candidate_clocks(log, cameras) if (fit := _fitted(log, cameras, clock))]
    fits.sort(key=lambda fit: -fit.gain)
    share = fits[0].share if fits else 0.0
    if share < least_share:
        raise InputError(
            f"Log and cameras do not turn alike: with the best clock {100.0 * share:.0f} % of the turning is common to "
            f"both over at least {_LEAST_OVERLAP:g} s; for the same run it is over {100.0 * least_share:.0f} %. Check "
            "that both are of one run, and the order and signs of the log's sensors."
        )
    best = fits[0]
    if best.axis_error > _UNDETERMINED:
        raise InputError(
            "Log and cameras turn about one axis only, about which the rotation between their frames is then not "
            "known. Balance and turn the heading in the same run."
        )
    middle = np.array(0.5 * (log.t[0] + log.t[-1]))
    likely = [fit.clock for fit in fits[1:] if fit.gain > _RIVAL * best.gain]
    here = best.clock.to_cameras(middle)
    return best, next((clock for clock in likely if abs(clock.to_cameras(middle) - here) > _SAME), None)


#: changes of clock and rotation from the start of the fit, and the bias of the gyro
_PARAMETERS = (
    FitParameter.about("offset in the middle", 0.0, "s", within=2.0),
    FitParameter.about("rate", 0.0, "s/s", within=_LARGEST_RATE),
    *(FitParameter.about(f"rotation about {axis}", 0.0, "rad", within=3.0) for axis in "xyz"),
    *(FitParameter.about(f"bias about {axis}", 0.0, "rad/s", within=2.0) for axis in "xyz"),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pairs:
    """Increments (n,) from log and cameras, and the start of the fit of x (8,), the values of `_PARAMETERS`."""

    log: Turning
    start: Floats  #: (n,), on the cameras' clock [s]
    end: Floats
    turned: Floats  #: (n, 3), from the cameras [rad]
    clock: Clock
    middle: float  #: of the log's times [s]
    body_marker: Rotation

    @staticmethod
    def shared(log: Turning, cameras: Turning, clock: Clock) -> _Pairs | None:
        """Return the increments over `SPAN` that both have with a clock; None if there are too few."""
        starts = np.arange(0, len(cameras.t), max(1, len(cameras.t) // _MOST))
        ends = np.searchsorted(cameras.t, cameras.t[starts] + SPAN)
        starts, ends = starts[ends < len(cameras.t)], ends[ends < len(cameras.t)]
        start, end = cameras.t[starts], cameras.t[ends]
        # a margin, as the fit changes the clock
        usable = log.covers(clock.to_log(start) - 0.05, clock.to_log(end) + 0.05)
        usable &= cameras.missing[ends] == cameras.missing[starts]
        if usable.sum() < _LEAST:
            return None
        start, end, turned = start[usable], end[usable], (cameras.total[ends] - cameras.total[starts])[usable]
        # without the constant rate of the gyro's bias
        logged = _centred(log.over(clock.to_log(start), clock.to_log(end)))
        return _Pairs(
            log=log,
            start=start,
            end=end,
            turned=turned,
            clock=clock,
            middle=float(np.mean(clock.to_log(start))),
            body_marker=Rotation.align_vectors(logged, _centred(turned))[0],
        )

    def clock_of(self, x: Floats) -> Clock:
        rate = self.clock.rate + x[1]
        offset = self.clock.to_cameras(np.array(self.middle)) + x[0] - (1.0 + rate) * self.middle
        return Clock(offset=float(offset), rate=float(rate))

    def _at(self, x: Floats) -> tuple[Floats, ...]:
        """Return start and end (n,) on the log's clock, and the cameras' increments (n, 3) in its frame."""
        clock = self.clock_of(x)
        rotated = (Rotation.from_rotvec(x[2:5]) * self.body_marker).apply(self.turned)
        return clock.to_log(self.start), clock.to_log(self.end), rotated

    def errors(self, x: Floats) -> Floats:
        """Return the errors e (n, 3)."""
        s0, s1, rotated = self._at(x)
        return rotated - self.log.over(s0, s1) + np.outer(s1 - s0, x[5:])

    def slopes(self, x: Floats) -> Floats:
        """Return the derivatives of the errors (n, 3, 8)."""
        s0, s1, v = self._at(x)
        w0, w1 = (self.log.over(s - _SLOPE, s + _SLOPE) / (2.0 * _SLOPE) - x[5:] for s in (s0, s1))
        J = np.zeros((len(s0), 3, 8))
        J[:, :, 0] = w1 - w0
        J[:, :, 1] = w1 * (s1 - self.middle)[:, None] - w0 * (s0 - self.middle)[:, None]
        # d (exp(d) v) = d x v
        J[:, [0, 1, 2], [3, 4, 2]], J[:, [0, 1, 2], [4, 2, 3]] = v[:, [2, 0, 1]], -v[:, [1, 2, 0]]
        J[:, [0, 1, 2], [5, 6, 7]] = (s1 - s0)[:, None]
        return J

    def experiment(self, weights: Floats) -> Residuals:
        """Return the experiment with weights (n,) of the squared errors."""
        blocks, _ = _blocks(self.start)
        root = np.sqrt(weights)[:, None]
        return residuals_without_states(
            lambda x: self.errors(x) * root,
            parameters=_PARAMETERS,
            derivatives_of=lambda x: (self.slopes(x) * root[:, None]).reshape(-1, 8),
            block=np.repeat(blocks, 3),
        )


def _fitted(log: Turning, cameras: Turning, clock: Clock) -> MotionFit | None:
    """Return the fit that starts from a clock; None if log and cameras have too little in common."""
    pairs = _Pairs.shared(log, cameras, clock)
    if pairs is None:
        return None
    x, weights = np.zeros(8), np.ones(len(pairs.start))
    space = pairs.experiment(weights).coordinates
    for _ in range(_REWEIGHTED):
        x = fit(pairs.experiment(weights), space.scaled(x)).values
        weights = _huber_weights(pairs.errors(x))
    result = fit(pairs.experiment(weights), space.scaled(x))
    if at_bound(result.finished.point)[1]:  # clock rates that differ so much are not of one run
        return None
    x, residuals, (_, quantile) = result.values, pairs.errors(result.values), _blocks(pairs.start)
    # the offset at the log's zero, from that in the middle and the rate
    to_zero = np.array([1.0, -pairs.middle])
    body_marker = Rotation.from_rotvec(x[2:5]) * pairs.body_marker
    every = float(np.median(np.diff(pairs.start)))
    return MotionFit(
        clock=pairs.clock_of(x),
        body_marker=body_marker,
        bias=x[5:],
        offset_half_width=float(quantile * np.sqrt(to_zero @ result.covariance[:2, :2] @ to_zero)),
        rate_half_width=float(quantile * result.errors[1]),
        rotation_errors=result.errors[2:5],
        quantile=quantile,
        error=float(np.sqrt(np.mean(residuals**2))),
        motion=float(np.sqrt(np.mean(_centred(pairs.turned) ** 2))),
        increments=len(pairs.start),
        axis_error=_axis_error(body_marker.apply(pairs.turned), residuals, every),
    )


def _huber_weights(residuals: Floats) -> Floats:
    """Return the weights (n,) of residuals (n, 3)."""
    size = np.linalg.norm(residuals, axis=1)
    scale = 1.4826 * float(np.median(size)) / 1.5382  # the median length of three unit normals
    return np.minimum(1.0, _TUNING * np.sqrt(3.0) * scale / np.maximum(size, 1e-300))


def _axis_error(turned: Floats, residuals: Floats, every: float) -> float:
    """Return the standard error [rad] of the rotation about the axis that the motion (n, 3) determines least."""
    turned = _centred(turned)
    U, shared, Vt = np.linalg.svd((turned - _centred(residuals)).T @ turned / len(turned))
    across = shared[1] + shared[2] * np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    independent = len(turned) * min(1.0, every / SPAN)
    return float(np.sqrt(np.mean(residuals**2) / (independent * max(across, 1e-300))))


def _centred(values: Floats) -> Floats:
    return values - np.median(values, axis=0)
