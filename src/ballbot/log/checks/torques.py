"""Torque columns that are not those of a balancing robot: random, late, of another motion.

A balancing robot's torques are feedback: a linear law in states and reference, in the frame that turns with the
heading, explains most of every torque's variance, and a torque hardly changes from row to row. These checks need no
model of the robot.

Every feedback passes the noise of its state on to its torques. From row to row most of the change of a measured state
is noise, to which a controller responds at once. A regression of the torques' changes on earlier changes of the states
explains them at one lag only: that between the two in the log. The robot's own delay, from torque to motion, has no
effect here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import every
from ballbot.findings import Finding, error
from ballbot.log.checks.values import LEAST_SPEED
from ballbot.log.columns import STATE_NAMES, numbered_names, torque_names
from ballbot.log.log import Log
from ballbot.robot import Robot

#: fewest complete rows for a fit of the law
LEAST_ROWS = 200
#: explained fraction of a torque's variance below which it is no feedback, and above which it is
UNRELATED, RELATED = 0.1, 0.4
_REFERENCE = ("ref_x", "ref_y", "ref_psi")
#: correlation of a torque with itself a row later, below which it is random
RANDOM = 0.3

LONGEST_DELAY = 2.0  #: [s], in either direction
#: longer lags are an error [s]; the computing time of a controller and the group delay of a filter are below
LARGEST_DELAY = 0.03
#: fraction of the torques' changes that the lag must explain, and its excess over any usual lag
DELAY_EXPLAINED, DELAY_MARGIN = 0.4, 0.2
#: changes beyond this many times the median are due to an event, a saturation or a gap
LARGE_CHANGE = 5.0
FEWEST_ROWS = 400
#: rows that are used, from the log's start; a few hundred are enough for the lag
ENOUGH_ROWS = 20000


def check_torques(log: Log) -> list[Finding]:
    """Return an error for torques that cannot be a balancing robot's feedback: random ones, or of another motion.

    A log without the ten states is not of a balancing robot and may have any torques.
    """
    names = numbered_names(log.names, prefix="u") if "u1" in log else ()
    if not names or not {*STATE_NAMES} <= set(log.names):
        return []
    table = np.column_stack([log[name] for name in (*names, *STATE_NAMES)])
    rows: NDArray[np.bool_] = np.all(np.isfinite(table), axis=1)
    torques, states = table[rows, : len(names)], table[rows, len(names) :]
    moving = len(states) >= LEAST_ROWS and states[:, 5:7].std(axis=0).max() >= LEAST_SPEED
    if not moving or (torques.std(axis=0) == 0.0).any():
        return []
    reference = np.column_stack(
        [np.nan_to_num(log[n][rows]) if n in log else 0.0 * log.t[rows] for n in _REFERENCE]
    )
    explained = _feedback_fraction(torques, states, reference)
    unrelated = explained < UNRELATED
    if not (unrelated.all() or (unrelated.any() and explained.max() > RELATED)):
        return []
    centred = torques - torques.mean(axis=0)
    memory = np.mean(centred[1:] * centred[:-1], axis=0) / np.mean(centred**2, axis=0)
    columns = [name for name, is_unrelated in zip(names, unrelated, strict=True) if is_unrelated]
    random = bool((memory[unrelated] < RANDOM).all())
    cause = (
        f"random from row to row (correlation {memory[unrelated].max():.2f}): noise or another quantity"
        if random
        else "torques of another log, much shifted in time, or of a robot that is held"
    )
    text = (
        f"{every(columns)}: the motion explains {100.0 * explained[unrelated].max():.0f} %, and of feedback more than "
        f"half: {cause}."
    )
    return [error("torque-unrelated", text, *columns)]


def _feedback_fraction(
    torques: NDArray[np.float64], states: NDArray[np.float64], reference: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the fraction of each torque's variance (n,) that a linear law in states and reference explains.

    Parameters
    ----------
    torques : ndarray (N, n)
        [N m]; each varies.
    states : ndarray (N, 10)
        SI units and radians.
    reference : ndarray (N, 3)
        x, y [m], psi [rad].
    """
    turn = np.exp(-1j * states[:, 4])
    # x + j y, theta + j phi, their rates and the reference, by the world's axes and by the body's
    pairs = [states[:, k] + 1j * states[:, k + 1] for k in (0, 2, 5, 7)]
    pairs.append(reference[:, 0] + 1j * reference[:, 1])
    pairs += [pair * turn for pair in pairs]
    features = [part for pair in pairs for part in (pair.real, pair.imag)]
    design = np.column_stack([*features, states[:, [4, 9]], reference[:, 2], np.ones(len(states))])
    design /= np.maximum(np.abs(design).max(axis=0), 1e-300)
    # normal equations: ten times as fast, and precise enough
    law = np.linalg.lstsq(design.T @ design, design.T @ torques, rcond=1e-12)[0]
    return 1.0 - (torques - design @ law).var(axis=0) / torques.var(axis=0)


def delay_findings(log: Log, robot: Robot) -> list[Finding]:
    """Return the error of torques that come clearly too late, or too early, for the states beside them."""
    names = torque_names(robot.wheel_count)
    if not {*STATE_NAMES, *names} <= set(log.names) or len(log) < FEWEST_ROWS:
        return []
    sensed = _heading_frame_states(log)
    table = np.column_stack([sensed, *(log[name] for name in names)])[:ENOUGH_ROWS]
    table = np.diff(table[np.isfinite(table).all(axis=1)], axis=0)
    if len(table) < FEWEST_ROWS:
        return []
    size = LARGE_CHANGE * np.median(np.abs(table), axis=0)
    moved = int((size[sensed.shape[1] :] > 0.0).sum())
    table = np.clip(table, -size, size)[:, size > 0.0]
    table -= table.mean(axis=0)
    if moved in (0, table.shape[1]):
        return []
    lags, explained = _explained_by_lag(table[:, :-moved], table[:, -moved:], log.sample_time)
    usual = float(explained[np.abs(lags) <= LARGEST_DELAY].max())
    best = int(np.argmax(explained))
    if abs(lags[best]) <= LARGEST_DELAY or explained[best] < max(DELAY_EXPLAINED, usual + DELAY_MARGIN):
        return []
    milliseconds, late = 1000.0 * abs(lags[best]), lags[best] > 0.0
    text = (
        f"The torques are {milliseconds:.0f} ms too {'late' if late else 'early'} in the log: they respond to the "
        f"states {milliseconds:.0f} ms {'before' if late else 'after'}. The times of the torques or of the sensors are "
        "wrong; shift one of them ([input] delay or [attitude] delay in a mapping)."
    )
    return [error("torque-delay", text, *names)]


def _heading_frame_states(log: Log) -> NDArray[np.float64]:
    """Return the states (N, 10) with horizontal vectors in the heading frame, in which a feedback is constant."""
    c, s = np.cos(log["psi"]), np.sin(log["psi"])
    columns = []
    for first, second in (("x", "y"), ("theta", "phi"), ("x_dot", "y_dot"), ("theta_dot", "phi_dot")):
        columns += [c * log[first] + s * log[second], c * log[second] - s * log[first]]
    return np.column_stack([*columns, log["psi"], log["psi_dot"]])


def _explained_by_lag(
    states: NDArray[np.float64], torques: NDArray[np.float64], sample_time: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return lags [s] and the fraction of the torques' changes (N, n) that the states' (N, s) explain at each."""
    reach = min(max(1, round(LONGEST_DELAY / sample_time)), len(states) // 4)
    # whitened states, so that explained fractions are sums of squares
    factor = np.linalg.cholesky(states.T @ states + 1e-30 * np.eye(states.shape[1]))
    whitened = states @ np.linalg.pinv(factor).T
    size = 1 << (2 * len(states) - 1).bit_length()
    spectra = (
        np.fft.rfft(whitened, size, axis=0).conj()[:, :, None]
        * np.fft.rfft(torques, size, axis=0)[:, None, :]
    )
    products = np.fft.irfft(spectra, size, axis=0)  # [lag, state, torque], negative lags at the end
    lags = np.arange(-reach, reach + 1, dtype=np.intp)
    explained = np.sum(products[lags] ** 2, axis=(1, 2)) / max(float(np.sum(torques**2)), 1e-30)
    return np.asarray(lags * sample_time, dtype=np.float64), explained
