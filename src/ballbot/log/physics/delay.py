"""How late the torques are, by the controller: every feedback puts the noise of its state into its torques.

From row to row most of what changes in a measured state is noise, and a controller answers it at once. The changes of
the torques, regressed on the changes of the states so many rows before, are explained at one lag only: that between
the two in the log. A robot's own delay, from the torque to the motion, does not show here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place
from ballbot.log.columns import STATE_NAMES, torque_names
from ballbot.log.log import Log
from ballbot.robot import Robot

LONGEST = 2.0  #: [s], either way
#: lags that are an error [s]; a controller that takes its time and a filter's group delay stay under it
LARGEST = 0.03
#: share of the torques' changes that the lag must explain, and by how much more than any usual lag
EXPLAINED, MORE = 0.4, 0.2
#: changes beyond this many times the median are those of an event, a saturation or a gap
LARGE = 5.0
FEWEST_ROWS = 400
#: rows that are looked at, from the log's start: the lag is known after a few hundred
ENOUGH_ROWS = 20000


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The lag at which the torques answer the states."""

    lag: float  #: [s], positive if the torques come after the states
    explained: float  #: share of the torques' changes at this lag
    usual: float  #: largest share at the lags that a controller may have


def answer_of(log: Log, robot: Robot) -> Answer | None:
    """Return the lag at which the torques answer the states; None without the columns or with too few rows."""
    names = torque_names(robot.wheel_count)
    if not {*STATE_NAMES, *names} <= set(log.names) or len(log) < FEWEST_ROWS:
        return None
    table = np.column_stack([_states(log), *(log[name] for name in names)])[:ENOUGH_ROWS]
    table = np.diff(table[np.isfinite(table).all(axis=1)], axis=0)
    if len(table) < FEWEST_ROWS:
        return None
    size = LARGE * np.median(np.abs(table), axis=0)
    alive = size > 0.0
    if not alive[10:].any():
        return None
    table = np.clip(table, -size, size)[:, alive]
    table -= table.mean(axis=0)
    torques = int(alive[10:].sum())
    return _best(table[:, :-torques], table[:, -torques:], log.sample_time)


def delay_findings(found: Answer | None, *, names: tuple[str, ...]) -> list[Finding]:
    """Return the error of torques that come clearly too late, or too early, for the states beside them."""
    if found is None or abs(found.lag) <= LARGEST:
        return []
    if found.explained < EXPLAINED or found.explained < found.usual + MORE:
        return []
    size, late = 1000.0 * abs(found.lag), found.lag > 0.0
    sentence = (
        f"The torques are {size:.0f} ms too {('late' if late else 'early')} in the log: they respond "
        f"to the states {size:.0f} ms {('before' if late else 'after')}. The times of the torques or "
        "of the sensors are wrong; shift one of them ([input] delay or [attitude] delay in a mapping)."
    )
    where = Place(columns=names)
    return [Finding(code="torque-delay", severity="error", text=sentence, where=where)]


def _states(log: Log) -> NDArray[np.float64]:
    """Return the states (N, 10) with horizontal vectors in the heading frame, in which a feedback is constant."""
    c, s = np.cos(log["psi"]), np.sin(log["psi"])
    columns = []
    for first, second in (("x", "y"), ("theta", "phi"), ("x_dot", "y_dot"), ("theta_dot", "phi_dot")):
        columns += [c * log[first] + s * log[second], c * log[second] - s * log[first]]
    return np.column_stack([*columns, log["psi"], log["psi_dot"]])


def _best(states: NDArray[np.float64], torques: NDArray[np.float64], sample_time: float) -> Answer:
    """Return the lag at which the torques' changes (N, n) are explained best by the states' (N, s)."""
    reach = min(max(1, round(LONGEST / sample_time)), len(states) // 4)
    # whitened states, so that shares are sums of squares
    whitened = (
        states @ np.linalg.pinv(np.linalg.cholesky(states.T @ states + 1e-30 * np.eye(states.shape[1]))).T
    )
    size = 1 << (2 * len(states) - 1).bit_length()
    spectra = (
        np.fft.rfft(whitened, size, axis=0).conj()[:, :, None]
        * np.fft.rfft(torques, size, axis=0)[:, None, :]
    )
    products = np.fft.irfft(spectra, size, axis=0)  # [lag, state, torque], negative lags at the end
    lags = np.arange(-reach, reach + 1)
    shares = np.sum(products[lags] ** 2, axis=(1, 2)) / max(float(np.sum(torques**2)), 1e-30)
    usual = np.abs(lags * sample_time) <= LARGEST
    best = int(np.argmax(shares))
    return Answer(
        lag=float(lags[best] * sample_time), explained=float(shares[best]), usual=float(shares[usual].max())
    )
