"""How large the dead band is that a firmware adds to its duties, by the motion.

With a dead band d_0, and the terms of `ballbot.log.mapping_inference.commands`,

    s_i d_i = a n_i + b w_i + c_i sgn w_i + .. - d_0 sgn d_i

where wheels turn against their duties, or coast: elsewhere sgn d_i is sgn w_i, and d_0 counts as less dry friction.
sgn d_i has the noise of d_i, so that a regression on it is biased, by the dead band itself or more. The sign of what
the terms without a dead band give for d_i is an instrument: it follows sgn d_i and not the noise. The estimate shows
whether there is a dead band rather than how large it is (`WITHOUT_ONE`, `WITH_ONE`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log.checks.torque_balance import Driving
from ballbot.log.mapping_inference.commands import Assignment
from ballbot.log.mapping_inference.evidence import (
    CONFIDENT,
    MOST,
    TINY,
    jackknife_error,
    solved,
    without_each_block,
)
from ballbot.log.mapping_inference.tolerances import TORQUE_PART

#: largest dead band that must be expected, over the size of what drives, and of full duty: chosen. The larger of both
#: counts, since a motor and its driver lose the same duty in a log that drives gently
LARGEST_DEAD_BAND, LARGEST_DUTY = 0.7, 0.02
#: probability before the log is seen that a firmware adds one that its team does not state: chosen, somewhat more than
#: the part of the corpus' logs that have one, a sixth to a quarter
ADDS_ONE = 0.3
#: commands below this part of their size have no clear sign
UNCLEAR_SIGN = 0.15
#: how far an estimate is from a dead band, over the size of what drives: mean and standard deviation, without a dead
#: band and with one. Play, static friction and the chatter of duties make it too small without one: in 91 logs of four
#: development halves with a jackknife error below 0.5 it is -0.56, standard deviation 0.50; in 18 with a dead band 0.17
#: too large, standard deviation 0.36. A robot without play is expected nearer to zero
WITHOUT_ONE, WITH_ONE = (-0.4, 0.55), (0.15, 0.5)
#: largest jackknife error with which an estimate is worth a word
LARGEST_ERROR = 0.5
#: sizes of which the posterior is made
SIZES = 400


@dataclass(frozen=True, kw_only=True)
class DeadBandEstimate:
    """A dead band over the size (root mean square) of what drives the wheels."""

    value: float
    error: float  #: its standard error by the jackknife over blocks of a second
    size: float  #: of what drives, in the file's unit

    @property
    def informative(self) -> bool:
        """Whether the log shows more than chance."""
        return self.error < LARGEST_ERROR


def dead_band_estimate(
    driving: Driving, assigned: Assignment, signs: NDArray[np.float64], sizes: NDArray[np.float64]
) -> DeadBandEstimate | None:
    """Estimate the dead band; None if the log is too short, or does not show what drives.

    Parameters
    ----------
    driving : Driving
        The commands are its torques.
    assigned : Assignment
    signs : ndarray (N, wheels, commands)
        Sign of each command while each wheel turns, filtered.
    sizes : ndarray (n,)
        Standard deviation of the part of each wheel's command that drives.
    """
    size = float(np.sqrt(np.square(sizes).mean()))
    if not size > 0.0:  # unknown without a gain
        return None
    place, n = np.argsort(assigned.wheels), driving.torque.shape[1]
    s, wheels = np.asarray(assigned.signs, dtype=np.float64)[place], np.arange(driving.torque.shape[1])
    u = driving.torque[:, place] * s
    own = np.zeros((len(u), n, 3 * n))  # sign, falling sign and offset of each wheel
    for part, values in enumerate((driving.friction[:, :, 0], driving.friction[:, :, 2], np.ones_like(u))):
        own[:, wheels, 3 * wheels + part] = values
    terms = np.concatenate([driving.needed[..., None], driving.friction[:, :, 1, None], own], axis=-1)
    weight = driving.turning**2
    root = np.sqrt(weight)[..., None]
    columns = terms.shape[-1]
    found = np.linalg.lstsq((terms * root).reshape(-1, columns), (u * root[..., 0]).ravel(), rcond=1e-9)[0]
    sign = s * signs[:, wheels, place]
    instrument = np.tanh(terms @ found / max(UNCLEAR_SIGN * size, TINY)) * (np.abs(sign) > 0.0)
    right = np.concatenate([terms, sign[..., None], u[..., None]], axis=-1)
    left = np.concatenate([terms, instrument[..., None]], axis=-1) * weight[..., None]
    blocks = [driving.block == one for one in range(int(driving.block[-1]) + 1)]
    sums = np.array([np.einsum("nwi,nwj->ij", left[rows], right[rows]) for rows in blocks])

    def estimate(total: NDArray[np.float64]) -> float:
        return -float(solved(total)[-1]) / max(size, TINY)

    error = jackknife_error(without_each_block(sums, estimate))
    if not math.isfinite(error):
        return None
    return DeadBandEstimate(value=estimate(sums.sum(axis=0)), error=error, size=size)


@dataclass(frozen=True, kw_only=True)
class UndoneDeadBand:
    """A dead band as a mapping undoes it."""

    value: float  #: over the size of what drives; zero counts it as less dry friction
    confidence: float  #: that the rest of it changes the torques by no more than `TORQUE_PART`
    probability: float  #: that the firmware adds one


def undone_dead_band(
    turning_against: float, estimate: DeadBandEstimate | None = None, *, full_duty: float = 0.0
) -> UndoneDeadBand:
    """Return what to undo of a dead band that nobody states.

    None is, as long as that is harmless with confidence; else the expected one, if the motion shows one and the
    confidence is greater then. Before the log is seen, a firmware adds a dead band with the probability `ADDS_ONE`, of
    a size up to the largest, a smaller one more likely in proportion to its distance from that.

    Parameters
    ----------
    turning_against : float
        As `DriveEvidence` has it: the error is this times the rest of the dead band.
    estimate : DeadBandEstimate, optional
    full_duty : float
        Full duty over the size of what drives; zero if that is unknown.
    """
    if not math.isfinite(turning_against):
        return UndoneDeadBand(value=0.0, confidence=0.5, probability=ADDS_ONE)
    largest = max(LARGEST_DEAD_BAND, LARGEST_DUTY * full_duty)
    sizes = np.linspace(0.0, largest, SIZES)
    weights = largest - sizes
    weights *= ADDS_ONE / weights.sum()
    nothing = 1.0 - ADDS_ONE
    if estimate is not None:
        weights = weights * _likelihood(estimate, sizes, WITH_ONE)
        nothing *= float(_likelihood(estimate, np.zeros(1), WITHOUT_ONE)[0])
    total = nothing + float(weights.sum())
    if not total > 0.0:  # an estimate beyond all expectation shows nothing
        return undone_dead_band(turning_against, full_duty=full_duty)
    probability, expected = float(weights.sum()) / total, float(weights @ sizes) / total

    def harmless(undone: float) -> float:
        left = float(weights[np.abs(sizes - undone) * turning_against < TORQUE_PART].sum())
        return min((left + nothing * (undone * turning_against < TORQUE_PART)) / total, MOST)

    ignored = harmless(0.0)
    shown = estimate is not None and estimate.informative and probability > ADDS_ONE
    undone = expected if ignored < CONFIDENT and shown and harmless(expected) > ignored else 0.0
    return UndoneDeadBand(value=undone, confidence=harmless(undone), probability=probability)


def _likelihood(
    estimate: DeadBandEstimate, sizes: NDArray[np.float64], off: tuple[float, float]
) -> NDArray[np.float64]:
    """Return the density of an estimate with dead bands (K,), from which it is off by a mean and deviation."""
    deviation = math.hypot(estimate.error, off[1])
    return np.exp(-0.5 * np.square((estimate.value - sizes - off[0]) / deviation)) / deviation
