"""How large the dead band is that a firmware adds to its duties, by the motion.

With a dead band d_0, and the terms of `ballbot.log.mapping_inference.commands`,

    s_i d_i = a n_i + b w_i + c_i sgn w_i + .. - d_0 sgn d_i

where wheels turn against their duties, or coast: elsewhere sgn d_i is sgn w_i, and d_0 counts as less dry friction.
sgn d_i has the noise of d_i, so that a regression on it is biased, by the dead band itself or more. The sign of what
the terms without a dead band give for d_i is an instrument: it follows sgn d_i and not the noise. Dead bands of 0,
0.17, 0.38 and 0.75 of the size of what drives, made of seven logs of the development halves, are found with a standard
deviation of 0.13, and the larger ones up to 0.35 too small or too large.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from ballbot.log.checks.torque_balance import Driving
from ballbot.log.mapping_inference.commands import Assignment
from ballbot.log.mapping_inference.evidence import (
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
#: probability before the log is seen that a firmware adds one that its team does not state: chosen, that of the
#: corpus' halves, where it is a sixth to a quarter
ADDS_ONE = 0.25
#: commands below this part of their size have no clear sign
UNCLEAR_SIGN = 0.15
#: an estimate's error beyond its jackknife, over the size of what drives
ESTIMATE_ERROR = 0.15
#: largest jackknife error of an estimate that is believed, and by how many errors it may be below zero: of one log of
#: the third development half the estimate is -1.1, whatever its dead band, and its jackknife error 0.2
LARGEST_ERROR, BELOW_ZERO = 0.3, 2.0


@dataclass(frozen=True, kw_only=True)
class DeadBandEstimate:
    """A dead band over the size (root mean square) of what drives the wheels."""

    value: float
    error: float  #: its standard error
    size: float  #: of what drives, in the file's unit

    @property
    def believed(self) -> bool:
        """Whether the log shows the dead band."""
        return (
            self.error < math.hypot(LARGEST_ERROR, ESTIMATE_ERROR) and self.value > -BELOW_ZERO * self.error
        )


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
    return DeadBandEstimate(
        value=estimate(sums.sum(axis=0)), error=math.hypot(error, ESTIMATE_ERROR), size=size
    )


def dead_band_confidence(
    turning_against: float, estimate: DeadBandEstimate | None = None, *, full_duty: float = 0.0
) -> float:
    """Return the confidence that a dead band that nobody states only makes dry friction appear less.

    Before the log is seen, a firmware adds a dead band with the probability `ADDS_ONE`, of any size up to the largest
    alike. An estimate that is believed has a normal error.

    Parameters
    ----------
    turning_against : float
        As `DriveEvidence` has it: the error is this times the dead band.
    estimate : DeadBandEstimate, optional
    full_duty : float
        Full duty over the size of what drives; zero if that is unknown.
    """
    if not math.isfinite(turning_against):
        return 0.5
    largest = max(LARGEST_DEAD_BAND, LARGEST_DUTY * full_duty)
    harmful = min(TORQUE_PART / max(turning_against, TINY), largest)
    if estimate is None or not estimate.believed:
        return min(1.0 - ADDS_ONE * (1.0 - harmful / largest), MOST)
    places = [(one - estimate.value) / estimate.error for one in (0.0, harmful, largest)]
    below = [float(ndtr(one)) for one in places]
    no_band = (1.0 - ADDS_ONE) * math.exp(-0.5 * places[0] ** 2) / (math.sqrt(2.0 * math.pi) * estimate.error)
    small, large = (
        ADDS_ONE / largest * (one - other) for one, other in zip(below[1:], below[:-1], strict=True)
    )
    return min((no_band + small) / max(no_band + small + large, TINY), MOST)
