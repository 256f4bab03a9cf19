"""The controller that a log was recorded with: its gain recovered from the log, or one given held against it.

A robot that balances by u = K S(psi) (r - x) shows its K: states, references and torques are all in the log, and
the law is linear in K. Least squares over the samples that no limit clipped gives it, and the share of the torques'
variance that it explains says whether the controller was of this kind at all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.control.interface import Feedback
from ballbot.errors import InputError
from ballbot.log import Log

#: torques this close to the limit count as clipped
_CLIPPED = 0.999
#: least share of each wheel's torque that the law must explain; dry friction compensated, for one, explains less
LEAST_R_SQUARED = 0.98
#: least share that a controller given must explain: its limits and quantised torques are its own, so less is asked
LEAST_EXPLAINED = 0.9
#: a controller may be late by up to so many samples
_LARGEST_DELAY = 4
_PAIRS = ((0, 1), (2, 3), (5, 6), (7, 8))


@dataclass(frozen=True, kw_only=True, eq=False)
class RecoveredGain:
    """u[k] = K S(psi) (r - x) at row k - delay, as found in a log."""

    gain: NDArray[np.float64]  #: K (n, 10)
    delay: int  #: samples from the state that a torque answers to the row that it stands in
    r_squared: NDArray[np.float64]  #: (n,) share of each wheel's torque variance explained
    samples: int  #: rows used
    torque_limit: float | None  #: [N m] at which the log's torques were clipped, if they were


def recover_gain(log: Log) -> RecoveredGain:
    """Find the gain and the delay of the controller that recorded a log.

    Parameters
    ----------
    log : Log
        With states, torques and ref_x, ref_y, ref_psi.

    Raises
    ------
    InputError
        Where no linear law explains the torques.
    """
    errors, torques = heading_error(log.states, log.reference), log.torques
    limit = _clipping_limit(torques)
    fits = [_fit(errors, torques, delay, limit) for delay in range(min(_LARGEST_DELAY + 1, len(log) // 40))]
    if not fits:
        raise InputError(
            "A gain of ten numbers per wheel cannot be estimated "
            f"from {len(log)} rows; at least 40 are needed."
        )
    best = max(fits, key=lambda fit: float(fit.r_squared.min()))
    worst = int(np.argmin(best.r_squared))
    if not best.r_squared[worst] >= LEAST_R_SQUARED:
        raise InputError(
            "The control law u = K S(psi) (r - x) explains only "
            f"{100 * best.r_squared[worst]:.1f} % of u{worst + 1} in the log; the estimate of its "
            f"gain needs {100 * LEAST_R_SQUARED:g} %. Give the controller that recorded the log."
        )
    return best


def delay_of(controller: Feedback, log: Log) -> int:
    """Return by how many samples the log's torques come after the states that the controller answers to.

    Raises
    ------
    InputError
        Where the controller is not the one that recorded the log, at any delay.
    """
    references, states = log.reference, log.states
    controller.reset()
    answers = np.array(
        [controller.update(float(t), x, r) for t, x, r in zip(log.t, states, references, strict=True)]
    )
    torques = log.torques
    delays = range(min(_LARGEST_DELAY + 1, len(log)))
    explained = [
        explained_share(torques[delay:], torques[delay:] - answers[: len(answers) - delay]).min()
        for delay in delays
    ]
    best = int(np.argmax(explained))
    if not explained[best] >= LEAST_EXPLAINED:
        raise InputError(
            f"The controller explains only {max(0.0, 100 * explained[best]):.1f} % of the "
            "log's torques; closed-loop validation needs the controller that recorded the log."
        )
    return best


def explained_share(torques: NDArray[np.float64], unexplained: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return R^2 (n,) of each wheel: one less the unexplained share of the torque's variance."""
    total = np.sum((torques - torques.mean(axis=0)) ** 2, axis=0)
    return 1.0 - np.sum(unexplained**2, axis=0) / np.where(total > 0.0, total, np.inf)


def heading_error(states: NDArray[np.float64], references: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return S(psi) (r - x) (N, 10): the error with its pairs turned by -psi into the heading frame."""
    e = references - states
    c, s = np.cos(states[:, 4]), np.sin(states[:, 4])
    turned = e.copy()
    for first, second in _PAIRS:
        turned[:, first] = c * e[:, first] + s * e[:, second]
        turned[:, second] = c * e[:, second] - s * e[:, first]
    return turned


def _clipping_limit(torques: NDArray[np.float64]) -> float | None:
    """Return the largest torque where it recurs as only a limit makes it, else None."""
    largest = np.abs(torques).max()
    recurring = np.count_nonzero(np.abs(torques) == largest)
    return float(largest) if recurring > 3 and largest > 0.0 else None


def _fit(
    errors: NDArray[np.float64], torques: NDArray[np.float64], delay: int, limit: float | None
) -> RecoveredGain:
    causes, effects = errors[: len(errors) - delay], torques[delay:]
    usable = np.ones(len(effects), dtype=bool)
    if limit is not None:
        usable = np.abs(effects).max(axis=1) < _CLIPPED * limit
    causes, effects = causes[usable], effects[usable]
    transposed, *_ = np.linalg.lstsq(causes, effects, rcond=None)
    return RecoveredGain(
        gain=np.asarray(transposed.T, dtype=np.float64),
        delay=delay,
        r_squared=explained_share(effects, effects - causes @ transposed),
        samples=len(effects),
        torque_limit=limit,
    )
