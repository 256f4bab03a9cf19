"""Torque columns that are not those of a balancing robot: dead, constant, random, late, of another motion.

A balancing robot's torques are feedback: a linear law in states and reference, in the frame that turns with the
heading, explains most of every torque's variance, and a torque hardly changes from row to row. These checks need no
model of the robot.

Every feedback passes the noise of its state on to its torques. From row to row most of the change of a measured state
is noise, to which a controller responds at once. A regression of the torques' changes on earlier changes of the states
explains them at one lag only: that between the two in the log. The robot's own delay, from torque to motion, has no
effect here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import every
from ballbot.findings import Finding, Place
from ballbot.log.columns import STATE_NAMES, torque_names, wheel_speed_names
from ballbot.log.log import Log
from ballbot.robot import Robot

#: fewest complete rows for a fit of the law
LEAST_ROWS = 200
#: the torque of a dead motor varies less than this fraction of the others'
DEAD_FRACTION = 0.02
#: a wheel that moves at least this fraction of the others' motion needs its motor
MOVING_FRACTION = 0.2
#: explained fraction of a torque's variance below which it is no feedback, and above which it is
UNRELATED, RELATED = 0.1, 0.4
#: least standard deviation of the ball's velocity for a conclusion [m/s]
LEAST_SPEED = 2e-3
_REFERENCE = ("ref_x", "ref_y", "ref_psi")
#: correlation of a torque with itself a row later, below which it is random
RANDOM = 0.3


def check_torques(log: Log, *, robot: Robot | None = None) -> list[Finding]:
    """Return an error for torques that cannot be those of a balancing robot's motors.

    Parameters
    ----------
    log : Log
        A log without the ten states is not of a balancing robot and may have any torques.
    robot : Robot, optional
        Gives the wheels' motion if the log lacks it.
    """
    names = torque_names(_torque_count(log))
    if not names or not {*STATE_NAMES} <= set(log.names):
        return []
    table = np.column_stack([log[name] for name in (*names, *STATE_NAMES)])
    rows: NDArray[np.bool_] = np.all(np.isfinite(table), axis=1)
    if rows.sum() < LEAST_ROWS:
        return []
    torques, states = table[rows, : len(names)], table[rows, len(names) :]
    reference = np.column_stack(
        [np.nan_to_num(log[n][rows]) if n in log else 0.0 * log.t[rows] for n in _REFERENCE]
    )
    moving = _moving_wheels(log, rows, states, len(names), robot)
    dead = _dead(torques, moving)
    if dead.any():
        return [_dead_finding(names, dead, torques)]
    if states[:, 5:7].std(axis=0).max() < LEAST_SPEED or (torques.std(axis=0) == 0.0).any():
        return []
    return _unrelated_findings(names, torques, feedback_fraction(torques, states, reference))


def feedback_fraction(
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


def _torque_count(log: Log) -> int:
    count = 0
    while f"u{count + 1}" in log:
        count += 1
    return count


def _moving_wheels(
    log: Log, rows: NDArray[np.bool_], states: NDArray[np.float64], count: int, robot: Robot | None
) -> NDArray[np.bool_]:
    """Return which wheels (n,) move, by the states and the robot, else by encoders; none if neither is known."""
    from ballbot.log.checks.kinematics import LEAST_MOTION, wheel_speeds_of_states

    if robot is not None and robot.wheel_count == count:
        speeds = wheel_speeds_of_states(states, robot)
    elif {*wheel_speed_names(count)} <= set(log.names):
        speeds = np.nan_to_num(np.column_stack([log[name][rows] for name in wheel_speed_names(count)]))
    else:
        return np.zeros(count, dtype=np.bool_)
    size = speeds.std(axis=0)
    return (size > LEAST_MOTION) & (size > MOVING_FRACTION * np.median(size))


def _dead(torques: NDArray[np.float64], moving: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which wheels (n,) move though their torque does not vary."""
    size = torques.std(axis=0)
    constant = np.ptp(torques, axis=0) == 0.0
    return moving & (constant | (size < DEAD_FRACTION * np.median(size)))


def _dead_finding(names: tuple[str, ...], dead: NDArray[np.bool_], torques: NDArray[np.float64]) -> Finding:
    silent = tuple(name for name, is_dead in zip(names, dead, strict=True) if is_dead)
    level = torques[:, dead].mean(axis=0)
    subject = f"{every(silent)} {_verb(silent)}"
    zero = bool((np.abs(level) <= DEAD_FRACTION * max(1e-9, float(np.abs(torques).max()))).all())
    if dead.all():
        values = (
            "zero in every window" if zero else f"{', '.join(f'{u:.3g}' for u in level)} N m in every row"
        )
        sentence = (
            f"The torques u are {values} though the robot moves: the motors were off, or the torques were not "
            "recorded. Record the torques that acted."
        )
    elif zero:
        sentence = (
            f"{subject} zero throughout though its wheel moves and the other "
            "motors work: a dead motor, or a torque that was not recorded. "
            "Identification and validation would use it as the torque that acted."
        )
    else:
        values = ", ".join(f"{value:.3g}" for value in level)
        sentence = (
            f"{subject} constant throughout ({values} N m) though its wheel moves and the other torques vary: a "
            "torque that was not recorded, or a motor that does not follow its command."
        )
    return Finding(severity="error", code="dead-motor", text=sentence, where=Place(columns=silent))


def _unrelated_findings(
    names: tuple[str, ...], torques: NDArray[np.float64], explained: NDArray[np.float64]
) -> list[Finding]:
    unrelated = explained < UNRELATED
    if not (unrelated.all() or (unrelated.any() and explained.max() > RELATED)):
        return []
    centred = torques - torques.mean(axis=0)
    memory = np.mean(centred[1:] * centred[:-1], axis=0) / np.mean(centred**2, axis=0)
    columns = tuple(name for name, is_unrelated in zip(names, unrelated, strict=True) if is_unrelated)
    most = 100.0 * float(explained[unrelated].max())
    listed = every(columns)
    if (memory[unrelated] < RANDOM).all():
        sentence = (
            f"{listed} {_verb(columns)} random: unrelated from row to row (correlation "
            f"{memory[unrelated].max():.2f}) and to the motion, which explains {most:.0f} % of it. No "
            "balancing robot's feedback is like that: the column is noise or another quantity."
        )
    else:
        sentence = (
            f"{listed} {_verb(columns)} unrelated to the motion, which explains "
            f"{most:.0f} % of it; feedback would give more than half: torques "
            "of another log, much shifted in time, or of a robot that is held."
        )
    return [Finding(severity="error", code="torque-unrelated", text=sentence, where=Place(columns=columns))]


def _verb(names: tuple[str, ...]) -> str:
    return "is" if len(names) == 1 else "are"


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


@dataclass(frozen=True, kw_only=True)
class TorqueDelay:
    """The lag at which the torques respond to the states."""

    lag: float  #: [s], positive if the torques come after the states
    explained: float  #: explained fraction of the torques' changes at this lag
    usual: float  #: largest explained fraction at the lags that a controller may have
    at_once: float  #: explained fraction without a lag


def torque_delay(log: Log, robot: Robot) -> TorqueDelay | None:
    """Return the lag at which the torques respond to the states; None without the columns or with too few rows."""
    names = torque_names(robot.wheel_count)
    if not {*STATE_NAMES, *names} <= set(log.names) or len(log) < FEWEST_ROWS:
        return None
    torques = np.column_stack([log[name] for name in names])
    return response_delay(_heading_frame_states(log), torques, log.sample_time)


def response_delay(
    sensed: NDArray[np.float64], torques: NDArray[np.float64], sample_time: float
) -> TorqueDelay | None:
    """Return the lag at which torques respond to the noise of what a controller is given; None with too few rows.

    Parameters
    ----------
    sensed : ndarray (N, s)
        What it is given, in any units; rows with a NaN are left out.
    torques : ndarray (N, n)
        In any units and order.
    sample_time : float
        Between rows [s].
    """
    table = np.column_stack([sensed, torques])[:ENOUGH_ROWS]
    table = np.diff(table[np.isfinite(table).all(axis=1)], axis=0)
    if len(table) < FEWEST_ROWS:
        return None
    size = LARGE_CHANGE * np.median(np.abs(table), axis=0)
    alive, count = size > 0.0, sensed.shape[1]
    if not alive[:count].any() or not alive[count:].any():
        return None
    table = np.clip(table, -size, size)[:, alive]
    table -= table.mean(axis=0)
    moved = int(alive[count:].sum())
    return _best_delay(table[:, :-moved], table[:, -moved:], sample_time)


def delay_findings(found: TorqueDelay | None, *, names: tuple[str, ...]) -> list[Finding]:
    """Return the error of torques that come clearly too late, or too early, for the states beside them."""
    if found is None or abs(found.lag) <= LARGEST_DELAY:
        return []
    if found.explained < DELAY_EXPLAINED or found.explained < found.usual + DELAY_MARGIN:
        return []
    size, late = 1000.0 * abs(found.lag), found.lag > 0.0
    sentence = (
        f"The torques are {size:.0f} ms too {('late' if late else 'early')} in the log: they respond "
        f"to the states {size:.0f} ms {('before' if late else 'after')}. The times of the torques or "
        "of the sensors are wrong; shift one of them ([input] delay or [attitude] delay in a mapping)."
    )
    where = Place(columns=names)
    return [Finding(code="torque-delay", severity="error", text=sentence, where=where)]


def _heading_frame_states(log: Log) -> NDArray[np.float64]:
    """Return the states (N, 10) with horizontal vectors in the heading frame, in which a feedback is constant."""
    c, s = np.cos(log["psi"]), np.sin(log["psi"])
    columns = []
    for first, second in (("x", "y"), ("theta", "phi"), ("x_dot", "y_dot"), ("theta_dot", "phi_dot")):
        columns += [c * log[first] + s * log[second], c * log[second] - s * log[first]]
    return np.column_stack([*columns, log["psi"], log["psi_dot"]])


def _best_delay(states: NDArray[np.float64], torques: NDArray[np.float64], sample_time: float) -> TorqueDelay:
    """Return the lag at which the torques' changes (N, n) are explained best by the states' (N, s)."""
    reach = min(max(1, round(LONGEST_DELAY / sample_time)), len(states) // 4)
    # whitened states, so that explained fractions are sums of squares
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
    explained = np.sum(products[lags] ** 2, axis=(1, 2)) / max(float(np.sum(torques**2)), 1e-30)
    usual = np.abs(lags * sample_time) <= LARGEST_DELAY
    best = int(np.argmax(explained))
    return TorqueDelay(
        lag=float(lags[best] * sample_time),
        explained=float(explained[best]),
        usual=float(explained[usual].max()),
        at_once=float(explained[reach]),
    )
