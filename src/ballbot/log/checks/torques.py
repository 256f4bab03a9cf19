"""Torque columns that are late or early for the states beside them.

Every feedback passes the noise of its state on to its torques. From row to row most of the change of a measured state
is noise, to which a controller responds at once. A regression of the torques' changes on earlier changes of the states
explains them at one lag only: that between the two in the log. The robot's own delay, from torque to motion, has no
effect here, and no model of the robot is needed.
"""

from __future__ import annotations

import numpy as np

from ballbot.findings import Finding, error
from ballbot.log.columns import STATE_NAMES, torque_names
from ballbot.log.log import Log
from ballbot.robot import Robot

LONGEST_DELAY = 0.5  #: [s], in either direction
#: longer lags are an error [s]; the computing time of a controller and the group delay of a filter are below
LARGEST_DELAY = 0.03
#: fraction of the torques' changes that the lag must explain, and its excess over any usual lag
DELAY_EXPLAINED, DELAY_MARGIN = 0.4, 0.2
#: changes beyond this many times the median are due to an event, a saturation or a gap
LARGE_CHANGE = 5.0
#: rows that are needed, and that are used from the log's start: a few hundred are enough for the lag
FEWEST_ROWS, ENOUGH_ROWS = 400, 20000


def delay_findings(log: Log, robot: Robot) -> list[Finding]:
    """Return the error of torques that come clearly too late, or too early, for the states beside them."""
    names = torque_names(robot.wheel_count)
    if not {*STATE_NAMES, *names} <= set(log.names):
        return []
    # in the heading frame, in which a feedback is constant
    turn = np.exp(-1j * log["psi"])
    pairs = (("x", "y"), ("theta", "phi"), ("x_dot", "y_dot"), ("theta_dot", "phi_dot"))
    turned = [(log[a] + 1j * log[b]) * turn for a, b in pairs]
    parts = [part for one in turned for part in (one.real, one.imag)]
    table = np.column_stack([*parts, log["psi"], log["psi_dot"], *(log[name] for name in names)])[
        :ENOUGH_ROWS
    ]
    table = np.diff(table[np.isfinite(table).all(axis=1)], axis=0)
    size = LARGE_CHANGE * np.median(np.abs(table), axis=0) if len(table) >= FEWEST_ROWS else np.zeros(1)
    moved = int((size[len(STATE_NAMES) :] > 0.0).sum())
    if not moved or not (size[: len(STATE_NAMES)] > 0.0).any():
        return []
    table = np.clip(table, -size, size)[:, size > 0.0]
    table -= table.mean(axis=0)
    states, torques = table[:, :-moved], table[:, -moved:]
    # whitened states, so that explained fractions are sums of squares
    factor = np.linalg.cholesky(states.T @ states + 1e-30 * np.eye(states.shape[1]))
    states = states @ np.linalg.pinv(factor).T
    reach = min(max(1, round(LONGEST_DELAY / log.sample_time)), len(states) // 4)
    rows, lags = len(states), np.arange(-reach, reach + 1)
    products = [
        states[max(-lag, 0) : rows - max(lag, 0)].T @ torques[max(lag, 0) : rows - max(-lag, 0)]
        for lag in lags
    ]
    explained = np.square(products).sum(axis=(1, 2)) / max(float(np.sum(torques**2)), 1e-30)
    delays = lags * log.sample_time
    usual = float(explained[np.abs(delays) <= LARGEST_DELAY].max())
    best = int(np.argmax(explained))
    if abs(delays[best]) <= LARGEST_DELAY or explained[best] < max(DELAY_EXPLAINED, usual + DELAY_MARGIN):
        return []
    milliseconds, is_late = 1000.0 * abs(delays[best]), delays[best] > 0.0
    text = (
        f"The torques are {milliseconds:.0f} ms too {'late' if is_late else 'early'} in the log: they respond to the "
        f"states {milliseconds:.0f} ms {'before' if is_late else 'after'}. The times of the torques or of the sensors "
        "are wrong; shift one of them ([input] delay or [attitude] delay in a mapping)."
    )
    return [error("torque-delay", text, *names)]
