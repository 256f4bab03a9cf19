"""What a closed-loop run is judged by: each number a function of its log, with its definition and its unit.

Errors are the true position's and heading's where the log has the truth, and count once the robot has settled:
`settled` says when. Torque and energy count from the first row to the last.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from ballbot.errors import InputError
from ballbot.log import Log

#: time [s] after the start, or after a jump of the reference, from which errors count. The nominal closed loop
#: without friction has done 97 % of a step after 6 s.
SETTLE = 6.0
#: distance from the reference [m] within which a robot has arrived
BAND = 0.05
#: above which a torque is rough rather than balancing [Hz]: the fastest closed-loop pole of the nominal gain turns at
#: a tenth of it, the encoders' and the IMU's noise reaches up to half the sample rate
HIGH_FREQUENCY = 10.0

#: change of the reference from one sample to the next that is a jump, in m and rad
_JUMP = 0.02
#: half the order of the high-pass filter, which runs forward and backward
_FILTER_ORDER = 2
#: rounding that a time is forgiven [s]
_ROUNDING = 1e-6


def settled(log: Log, settle: float) -> NDArray[np.bool_]:
    """Return which rows (N,) are at least `settle` seconds after the start and after each jump of the reference.

    A jump is a change by more than 2 cm or 0.02 rad from one row to the next. Of a square with 8 s a side and the
    6 s of `SETTLE`, the last two seconds of each side count. A push is no jump: what it does to the robot counts.
    """
    t, since = log.t, np.concatenate([_jump_times(log), [np.inf]])
    return t - since[np.searchsorted(since, t, side="right") - 1] >= settle - _ROUNDING


def position_error(log: Log) -> NDArray[np.float64]:
    """Return the horizontal distance from the reference (N,) [m]."""
    place = true_place(log)
    return np.hypot(place["x"] - log["ref_x"], place["y"] - log["ref_y"])


def heading_error(log: Log) -> NDArray[np.float64]:
    """Return how far the heading is from the reference's (N,) [rad], 0 to pi: whole turns do not count."""
    away = true_place(log)["psi"] - log["ref_psi"]
    return np.abs((away + np.pi) % (2.0 * np.pi) - np.pi)


def settling_time(log: Log, *, band: float = BAND, disturbed: Sequence[float] = ()) -> tuple[float, bool]:
    """Return how long the robot takes to arrive and stay, the longest of the run [s], and whether it always did.

    The start, each jump of the reference and each time in `disturbed` begin a stretch, which lasts until the next of
    them. Its settling time runs from its begin to the last row at which the robot is farther than `band` from the
    reference; zero where there is none. A stretch at whose end the robot is outside counts with all its length, and
    the second value is then False: the time is a lower bound.

    Parameters
    ----------
    log : Log
    band : float
        [m]
    disturbed : sequence of float
        When something else than the reference sends the robot away, such as a push [s].
    """
    t = log.t
    begins = np.unique(np.concatenate([_jump_times(log), [s for s in disturbed if t[0] < s < t[-1]]]))
    starts = np.searchsorted(t, begins - _ROUNDING)
    outside = position_error(log) > band
    longest, always = 0.0, True
    for first, end in zip(starts, [*starts[1:], len(t)], strict=True):
        rows = np.flatnonzero(outside[first:end])
        if rows.size:
            longest = max(longest, float(t[first + rows[-1]] - t[first]))
            always &= bool(first + rows[-1] < end - 1)
    return longest, always


def true_place(log: Log) -> Log:
    """Return the log with the truth in place of what was measured, where it has it."""
    return log.truth() if "true_x" in log else log


def rms_torque(log: Log) -> float:
    """Return the root mean square of the torques of all wheels [N m]."""
    return rms(log.torques)


def rms_torque_change(log: Log) -> float:
    """Return the root mean square of the torques' change from one sample to the next [N m].

    It weighs what lies near half the sample rate most, and so grows with the sample time of the controller.
    """
    return rms(np.diff(log.torques, axis=0)) if len(log) > 1 else 0.0


def high_frequency_torque(log: Log, *, above: float = HIGH_FREQUENCY) -> float:
    """Return the root mean square of what the torques hold above a frequency [N m]: the worry of Figure 5.5.

    A Butterworth high-pass of second order at `above` [Hz] runs over the torques forward and backward, so that a
    sine at that frequency keeps half of its size, at twice of it 94 %, at half of it 6 %. All wheels, all rows.

    Raises
    ------
    InputError
        Where half the log's sample rate is not above that frequency.
    """
    rate = 1.0 / log.sample_time
    if above >= 0.5 * rate:
        raise InputError(
            f"The torques are sampled at {rate:.4g} Hz, which shows nothing above {0.5 * rate:.4g} Hz; "
            f"torque above {above:g} Hz cannot be computed."
        )
    sections = butter(_FILTER_ORDER, above, btype="highpass", fs=rate, output="sos")
    rows_beyond = min(round(rate / above), len(log) - 1)  # a period of the slowest that passes
    return rms(sosfiltfilt(sections, log.torques, axis=0, padlen=rows_beyond))


def energies(log: Log) -> tuple[float, float]:
    """Return the mechanical energy that the wheels' motors exchange, and the part that they give [J].

    The first is the integral of sum |u_i w_i|, the second that of sum max(u_i w_i, 0), which a drive that cannot
    take energy back draws. The torques are held between rows, so that a row's work is u_i times the angle that the
    encoder turns until the next row. What windings heat away is not in it; it goes with the square of `rms_torque`.
    """
    work = log.torques[:-1] * np.diff(log.wheel_angles, axis=0)
    return float(np.abs(work).sum()), float(np.maximum(work, 0.0).sum())


def rms(values: NDArray[np.float64]) -> float:
    """Return the root mean square of all values."""
    return float(np.sqrt(np.mean(values**2)))


def _jump_times(log: Log) -> NDArray[np.float64]:
    """Return when the run starts and the reference jumps [s]."""
    asked = log.reference[:, [0, 1, 4]]
    jumps = np.abs(np.diff(asked, axis=0)).max(axis=1, initial=0.0) > _JUMP
    return log.t[np.concatenate([[True], jumps])]
