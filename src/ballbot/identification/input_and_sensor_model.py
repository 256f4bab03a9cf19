"""What stands between a log and the robot: gains, offsets and delays of motors and sensors.

What stands between a log's numbers and the robot: the motors' gain, offset and delay, the IMU's tilt and bias.

Torques. Of the torque u_i logged in row k there acts, over the sample that begins at row k,

    gain_i ((1 - f) u_i[k - m] + f u_i[k - m - 1]) + offset_i        delay = (m + f) sample times, 0 <= f < 1

A held torque that comes a fraction f of a sample late acts over the first part of the sample with its old value; here
both values act throughout with that share, so that each sample has the same impulse.

Sensors. An IMU that is tilted by small angles (a, b) about the body's x and y axes reads R Rx(a) Ry(b) in place of
R = Rx(theta) Ry(phi) Rz(psi); a centre of mass beside the axis looks the same. To first order it reads

    theta + a cos psi - b sin psi        phi + a sin psi + b cos psi

and the gyro's bias (g_x, g_y, g_z) turns with the body likewise in the lean's rates. That about z is added to
psi_dot, and a heading that is the integral of psi_dot runs away at that rate: by g_z times the time since the start.

Sensors that tell late: a row's angles, or its velocities, are those of a moment before its positions.

An IMU's message waits for the next row, its filter lags; velocities that are encoders' differences are means over the
sample that ends. Row k then shows, of a state whose sensor is late by d,

    seen_k = state(t_k - d)                with the states between samples on straight lines

The positions x and y are the clock. A window's start is seen late as well: the true one lies ahead of it by d times the
slope of a first sample simulated from what was seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.quantities import Layout
from ballbot.identification.windows import Windows
from ballbot.log import STATE_NAMES

_PSI = 4


def acting_torques(
    layout: Layout, values: NDArray[np.float64], windows: Windows
) -> NDArray[np.float64] | None:
    """Return the torques that act (sets, w, m, n) for sets of parameters (sets, p); None where those logged do."""
    gain, offset, delay = (layout.part(name, values) for name in ("torque_gain", "torque_offset", "delay"))
    if gain is None and offset is None and delay is None:
        return None
    if delay is None:
        u = np.broadcast_to(windows.torques, (len(values), *windows.torques.shape))
    else:
        u = _delayed(delay[:, 0] / windows.sample_time, windows)
    if gain is not None:
        u = u * gain[:, None, None, :]
    if offset is not None:
        u = u + offset[:, None, None, :]
    return u


def sensor_offsets(
    layout: Layout, values: NDArray[np.float64], states: NDArray[np.float64], times: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Return what sensors add to measured states, None if they are without fault.

    Parameters
    ----------
    values : ndarray (sets, p)
    states : ndarray (w, k, 10)
        As measured; their heading says how the body stands.
    times : ndarray (k,)
        Since each window's start [s].

    Returns
    -------
    ndarray (sets, w, k, 10)
    """
    lean, gyro = layout.part("lean_bias", values), layout.part("gyro_bias", values)
    if lean is None and gyro is None:
        return None
    offsets = np.zeros((len(values), *states.shape))
    if lean is not None:
        offsets[..., 2], offsets[..., 3] = _turned(lean, states)
    if gyro is not None:
        offsets[..., 7], offsets[..., 8] = _turned(gyro, states)
        about_z = gyro[:, 2, None, None]
        offsets[..., 9] = about_z
        offsets[..., _PSI] = about_z * times
    return offsets


def samples_before(layout: Layout, upper: NDArray[np.float64], sample_time: float) -> int:
    """Return how many rows of torques before a window its prediction may need; `upper` (p,) bounds the parameters."""
    delay = layout.part("delay", upper)
    return 0 if delay is None else int(np.floor(delay[0] / sample_time + 1e-9)) + 1


def _delayed(samples: NDArray[np.float64], windows: Windows) -> NDArray[np.float64]:
    """Return the torques (sets, w, m, n) that come so many samples (sets,) late."""
    record = np.concatenate([windows.earlier, windows.torques], axis=1)
    before, count = windows.earlier.shape[1], windows.samples
    whole = np.minimum(np.floor(samples).astype(np.int64), before - 1)
    late = np.empty((len(samples), *windows.torques.shape))
    for i, (m, f) in enumerate(zip(whole, samples - whole, strict=True)):
        first = before - m
        now, previous = record[:, first : first + count], record[:, first - 1 : first - 1 + count]
        late[i] = (1.0 - f) * now + f * previous
    return late


def _turned(
    pair: NDArray[np.float64], states: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a body's pair (sets, 2 or more) about the axes of lean, (sets, w, k) each."""
    a, b = pair[:, 0, None, None], pair[:, 1, None, None]
    c, s = np.cos(states[..., _PSI]), np.sin(states[..., _PSI])
    return c * a - s * b, s * a + c * b


#: which states each quantity delays
_LATE = {
    "imu_delay": tuple(
        STATE_NAMES.index(name + rate) for name in ("theta", "phi", "psi") for rate in ("", "_dot")
    ),
    "velocity_delay": (STATE_NAMES.index("x_dot"), STATE_NAMES.index("y_dot")),
}


def state_delays(layout: Layout, values: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return by how much each state is seen late (sets, 10) [s], for parameters (sets, p); None if none may be."""
    if not set(_LATE) & set(layout.extra):
        return None
    delays = np.zeros((len(values), len(STATE_NAMES)))
    for name, states in _LATE.items():
        part = layout.part(name, values)
        if part is not None:
            delays[:, states] = part
    return delays


def seen_late(
    states: NDArray[np.float64], delays: NDArray[np.float64], sample_time: float
) -> NDArray[np.float64]:
    """Return what late sensors show of states (sets, w, m + 1, 10), the start first: (sets, w, m, 10), of rows 1 to m.

    Parameters
    ----------
    states : ndarray (sets, w, m + 1, 10)
    delays : ndarray (sets, 10)
        [s].
    sample_time : float
        [s].
    """
    m = states.shape[2] - 1
    place = np.arange(1.0, m + 1.0)[:, None] - delays[:, None] / sample_time  # (sets, m, 10), in samples
    before = np.clip(np.floor(place), 0, m - 1).astype(
        np.int64
    )  # beyond the ends, the first and the last line go on
    share = (place - before)[:, None]
    first = np.take_along_axis(states, before[:, None], axis=2)
    second = np.take_along_axis(states, before[:, None] + 1, axis=2)
    return (1.0 - share) * first + share * second
