"""One driveline's friction from one-step predictions: the estimate, its covariance and its 95 % intervals.

The innovations of the best parameters are nearly white, so that the covariance is s^2 (J^T J)^-1 with s^2 their
variance while the wheel turns. A sweep passes the low speeds a few times only: standard errors clustered in blocks of
time would rest on a handful of blocks for s, v_s and delta. They count where they are larger, as where the friction
changes during the sweep. The law is far from linear in s, v_s and delta; their limits are those of a profile
(`ballbot.fitting.intervals`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from ballbot.fitting.intervals import CONFIDENCE, Interval, between, profile
from ballbot.fitting.least_squares import Stopping, minimize_squares
from ballbot.fitting.parameter import Parameter, ParameterSpace
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.uncertainty import WindowEquations, covariance_in_time
from ballbot.identification.driveline_innovations import (
    FRICTION_SIZE,
    GAPS,
    MOST_DELAY,
    Track,
    innovations,
)

#: half the central difference, of the bounds' width
_DIFFERENCE = 1e-3
#: shares of the bounds' width: a descent begins no nearer to a bound than `NEAR_BOUND`, and an estimate that ends
#: nearer than `AT_BOUND` is at it
NEAR_BOUND, AT_BOUND = 1e-3, 1e-4
_BLOCK = 0.5  # [s]; residuals of one block may depend on each other
#: gaps tried of each break-away, and rounds of trying
_GAPS_TRIED, _ROUNDS = 13, 2
#: errors of s, v_s and delta with play over those of white innovations. On ten sweeps of the twin with play, beyond the
#: gap that is estimated, their standard deviation was 1.39, 1.26 and 1.23 standard errors (three wheels each); without
#: play 0.96, 0.93 and 1.09. The noise lets motor and wheel part again after they met, which the model lacks
_PLAY_WIDENS = 1.4
#: a profile's refits in steps each of its own: with fewer they end above the valley, and the interval is too narrow
_PROFILE_STEPS = 4
#: b and c are linear in the torque and need no profile
_PROFILED = (2, 3, 4)


def extended_space(space: ParameterSpace, *, events: int, used: Sequence[int], play: float) -> ParameterSpace:
    """Return the five of the friction with delay, gains and each break-away's gap; those not `used` are held."""

    def one(name: str, symbol: str, unit: str, most: float, default: float) -> Parameter:
        return Parameter(
            name=name, symbol=symbol, unit=unit, scale="amount", bounds=(0.0, most), default=default
        )

    gains = (
        one("torque_delay", "delay", "samples", MOST_DELAY, 0.0),
        one("angle_gain", "alpha", "1", 1.0, 0.6),
        one("speed_gain", "beta", "1", 1.0, 0.2),
    )
    gaps = tuple(
        one("gap", f"gap{event + 1}", "rad", play if event in used else 0.0, 0.0) for event in range(events)
    )
    return ParameterSpace(parameters=(*space.parameters, *gains, *gaps))


@dataclass(frozen=True, kw_only=True, eq=False)
class InnovationFit:
    """A minimum of the squared innovations, which can be fitted again with parameters moved."""

    track: Track
    coordinates: ParameterSpace
    point: NDArray[np.float64]  #: (p,), scaled
    noise: float  #: deviation of the speed after a sample, from noise of the torque [rad/s]

    def at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the innovations (k, m) [rad/s] at scaled points (k, p)."""
        return innovations(self.track, self.coordinates.physical(points), noise=self.noise)

    @cached_property
    def residuals(self) -> NDArray[np.float64]:
        """The innovations (m,) [rad/s]."""
        return self.at(self.point[None])[0]

    @cached_property
    def jacobian(self) -> NDArray[np.float64]:
        """Their derivatives (m, p) by the scaled parameters, by central differences; zero by those held."""
        z, chosen = self.point, np.flatnonzero(self.coordinates.free)
        moves = _DIFFERENCE * np.eye(len(z))[chosen]
        ahead, behind = np.minimum(z + moves, 1.0), np.maximum(z - moves, 0.0)
        both = self.at(np.concatenate([ahead, behind]))
        result = np.zeros((both.shape[1], len(z)))
        widths = (ahead - behind)[np.arange(len(chosen)), chosen]
        result[:, chosen] = ((both[: len(chosen)] - both[len(chosen) :]) / widths[:, None]).T
        return result

    @property
    def residual_count(self) -> int:
        """How many innovations are of a turning wheel."""
        return max(int(self.track.moving.sum()), 1)

    @property
    def variance(self) -> float:
        """s^2 of these [rad^2/s^2]."""
        free = int(self.coordinates.free.sum())
        return float(self.residuals @ self.residuals) / max(self.residual_count - free, 1)

    @property
    def cost(self) -> float:
        """Half the logarithm of the mean squared innovation."""
        return 0.5 * float(np.log(max(np.mean(self.residuals**2), np.finfo(float).tiny)))

    @property
    def equations(self) -> WindowEquations:
        """The normal equations of each block of time."""
        block = self.blocks
        count = int(block.max()) + 1
        parts = [(self.jacobian[block == one], self.residuals[block == one]) for one in range(count)]
        return WindowEquations(
            matrices=np.array([J.T @ J for J, _ in parts]), scores=np.array([J.T @ r for J, r in parts])
        )

    @property
    def blocks(self) -> NDArray[np.int64]:
        """The block of time of each innovation (m,)."""
        length = max(1, round(_BLOCK / self.track.sample_time))
        sizes = [end - first - 1 for first, end in self.track.pieces]
        innovations_in_all = len(self.track.moving)
        settled = innovations_in_all / sum(sizes)
        # a piece's innovations begin a few samples after it, which shifts the blocks' edges only
        counts = [round(settled * size) for size in sizes]
        counts[-1] = innovations_in_all - sum(counts[:-1])
        firsts = [first for first, _ in self.track.pieces]
        rows = np.concatenate([first + np.arange(count) for first, count in zip(firsts, counts, strict=True)])
        return np.unique(rows // length, return_inverse=True)[1].astype(np.int64)

    def descended(self, *, free: NDArray[np.bool_], most_steps: int) -> InnovationFit:
        """Return the minimum over the free parameters (p,), the others held."""
        places = np.flatnonzero(free & self.coordinates.free)
        if not len(places):
            return self

        def full(part: NDArray[np.float64]) -> NDArray[np.float64]:
            z = self.point.copy()
            z[places] = part
            return z

        found = minimize_squares(
            lambda part: self.at(full(part)[None])[0],
            np.clip(self.point[places], NEAR_BOUND, 1.0 - NEAR_BOUND),
            jacobian_of=lambda part: self._slopes(full(part), places),
            bounds=(0.0, 1.0),
            scale="jac",
            stopping=Stopping(most_evaluations=most_steps),
        ).point
        z = full(np.where(found <= AT_BOUND, 0.0, np.where(found >= 1.0 - AT_BOUND, 1.0, found)))
        return replace(self, point=z)

    def repeated(
        self,
        *,
        moved: NDArray[np.float64],
        free: NDArray[np.bool_],
        most_steps: int,
        run: Run = DEFAULT_RUN,  # noqa: ARG002 (the protocol's)
    ) -> InnovationFit:
        """Fit again from here, after moving the parameters by `moved` (p,), those marked in `free` (p,)."""
        shifted = replace(self, point=np.clip(self.point + moved, 0.0, 1.0))
        return shifted.descended(free=free, most_steps=_PROFILE_STEPS * most_steps)

    def _slopes(self, z: NDArray[np.float64], places: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the derivatives (m, k) by the parameters at k places, by one-sided differences, for a descent."""
        steps = np.where(z[places] < 0.5, _DIFFERENCE, -_DIFFERENCE)
        points = np.tile(z, (len(places) + 1, 1))
        points[np.arange(len(places)), places] += steps
        found = self.at(points)
        return ((found[:-1] - found[-1]) / steps[:, None]).T


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivelineEstimate:
    """The five parameters of one driveline's friction."""

    point: NDArray[np.float64]  #: (5,), scaled
    covariance: NDArray[np.float64]  #: (5, 5), scaled; NaN for a parameter at a bound or without effect
    intervals: dict[str, Interval]  #: of 95 %, by symbol
    delay: float  #: of the torque [s]
    rms: float  #: of the innovations while the wheel turns [rad/s]


def estimate_driveline(
    track: Track, start: NDArray[np.float64], *, space: ParameterSpace, play: float
) -> DrivelineEstimate:
    """Estimate the five parameters from a start (5,), scaled.

    Parameters
    ----------
    track : Track
    start : ndarray (5,)
        Within the basin, as an evolution finds it.
    space : ParameterSpace
        Of the five.
    play : float
        Of the gearbox, at most [rad].
    """
    events = int(track.event.max()) + 1
    used = track.events
    full = extended_space(space, events=events, used=used, play=play)
    z = np.concatenate(
        [np.clip(start, NEAR_BOUND, 1.0 - NEAR_BOUND), full.scaled(full.nominal)[FRICTION_SIZE:]]
    )
    fit = InnovationFit(track=track, coordinates=full, point=z, noise=0.0)
    everything = np.ones(len(z), dtype=bool)
    fit = fit.descended(free=everything, most_steps=30)
    for _ in range(_ROUNDS):
        fit = replace(fit, noise=_noise(fit))
        fit = _with_best_gaps(fit, used).descended(free=everything, most_steps=20)
    covariance = _covariance(fit)
    return DrivelineEstimate(
        point=fit.point[:FRICTION_SIZE],
        covariance=covariance[:FRICTION_SIZE, :FRICTION_SIZE],
        intervals=_intervals(fit, covariance),
        delay=float(fit.point[FRICTION_SIZE]) * MOST_DELAY * track.sample_time,
        rms=float(np.sqrt(fit.variance)),
    )


def _noise(fit: InnovationFit) -> float:
    """Return the deviation of the speed after a sample, as predicted: that of the innovations.

    It contains the torque's noise and the error of the speed that the prediction starts from. With the first alone
    (beta times this), s came out 0.4 standard errors too small on 18 sweeps of the twin without play; with both, 0.06.
    """
    return float(np.sqrt(fit.variance))


def _with_best_gaps(fit: InnovationFit, used: Sequence[int]) -> InnovationFit:
    """Return the fit with the gap of each break-away that leaves the smallest innovations, one after another."""
    for event in used:
        points = np.tile(fit.point, (_GAPS_TRIED + 1, 1))
        points[1:, GAPS + event] = np.linspace(0.0, 1.0, _GAPS_TRIED)
        costs = (fit.at(points) ** 2).sum(axis=1)
        fit = replace(fit, point=points[int(np.argmin(costs))])
    return fit


def _covariance(fit: InnovationFit) -> NDArray[np.float64]:
    """Return the covariance (p, p), scaled: for each parameter by the larger of the two errors."""
    inside = (fit.point > 0.0) & (fit.point < 1.0)
    kept = np.flatnonzero(fit.coordinates.free & inside & (np.linalg.norm(fit.jacobian, axis=0) > 0.0))
    full = np.full((len(fit.point), len(fit.point)), np.nan)
    if len(kept):
        J = fit.jacobian[:, kept]
        lengths = np.linalg.norm(J, axis=0)
        white = np.linalg.pinv((J / lengths).T @ (J / lengths), hermitian=True)
        white *= fit.variance / np.outer(lengths, lengths)
        clustered = covariance_in_time(J, fit.residuals, fit.blocks, neighbours=1)
        widened = np.sqrt(np.maximum(clustered.diagonal() / white.diagonal(), 1.0))
        if fit.track.events:
            widened = np.where(np.isin(kept, _PROFILED), np.maximum(widened, _PLAY_WIDENS), widened)
        full[np.ix_(kept, kept)] = white * np.outer(widened, widened)
    return full


def _intervals(fit: InnovationFit, covariance: NDArray[np.float64]) -> dict[str, Interval]:
    """Return the 95 % interval of each of the five that has an error, or is at a bound that the sweep explains."""
    space, found = fit.coordinates, dict[str, Interval]()
    quantile = float(scipy.stats.t.ppf(0.5 + 0.5 * CONFIDENCE, max(fit.residual_count - len(fit.point), 1)))
    inverse = fit.variance / np.maximum((fit.jacobian**2).sum(axis=0), np.finfo(float).tiny)
    for place in range(FRICTION_SIZE):
        error = float(np.sqrt(covariance[place, place]))
        label, z = space.labels[place], float(fit.point[place])
        if np.isfinite(error) and place not in _PROFILED:
            half = quantile * error
            found[label] = between(space, place, z - half, z + half, method="clustered")
        elif np.isfinite(error) or fit.jacobian[:, place].any():
            size = error if np.isfinite(error) else float(np.sqrt(inverse[place]))
            one = profile(
                fit,
                place,
                free=space.free & (fit.point > 0.0) | (np.arange(len(fit.point)) >= FRICTION_SIZE),
                error=min(quantile * size, 0.5),
                rise=quantile**2 * _inflation(fit, covariance, place),
            )
            method = "profile" if np.isfinite(error) else "at bound"
            found[label] = between(space, place, one.lower, one.upper, method=method)
    return found


def _inflation(fit: InnovationFit, covariance: NDArray[np.float64], place: int) -> float:
    """Return by how much the variance of a parameter is larger than that of white innovations."""
    kept = np.flatnonzero(np.isfinite(covariance.diagonal()))
    if place not in kept:
        return 1.0
    J = fit.jacobian[:, kept]
    white = fit.variance * np.linalg.pinv(J.T @ J, hermitian=True).diagonal()
    return max(float(covariance[place, place] / white[np.flatnonzero(kept == place)[0]]), 1.0)
