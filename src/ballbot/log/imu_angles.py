"""An IMU's angles, quaternion and rates, as the robot's angles and rates.

An IMU gives R_world_imu = Rz(yaw) Ry(pitch) Rx(roll), the aerospace sequence ZYX; Ballbot's angles are those of
R_world_body = Rx(theta) Ry(phi) Rz(psi), XYZ, and so are those of an IMU whose tilts do not turn with the heading. To
first order of the lean, in which roll and pitch have no sequence, there are these two. If the angle from the robot's x
axis to the IMU's is `turn`, towards the left, R_world_body = R_world_imu Rz(-turn). Ballbot's lean angles are about
axes of the world, roll and pitch of ZYX about axes that turn with the heading: they are the same only while the heading
is zero. Its gyro gives the rates of these angles, with less noise than their differences. An IMU that hangs upside down
gives R_world_imu Rx(pi): half a turn is taken off its roll.
"""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from ballbot.arrays import Floats
from ballbot.log.columns import ATTITUDE_NAMES, Columns
from ballbot.log.signals import unwrapped

#: names beside a file's own for the angles that are made of its quaternion
QUATERNION_ANGLES = tuple(f"{name} [rad] of the quaternion" for name in ("roll", "pitch", "yaw"))

#: about which axes an IMU turns in turn, each as the turns before left it: yaw, pitch, roll; or roll, pitch, yaw
AngleSequence = Literal["ZYX", "XYZ"]

#: a shorter quaternion is missing, such as zeros before the first message
_LEAST_NORM = 0.1


def quaternion_angles(wxyz: Floats) -> Columns:
    """Return roll, pitch and yaw (N,) [rad] of quaternions w, x, y, z (N, 4) by `QUATERNION_ANGLES`.

    They are NaN where the quaternion is not known or zero. The yaw continues past half a turn.
    """
    from ballbot.mechanics.geometry import roll_pitch_yaw

    norm = np.linalg.norm(wxyz, axis=1)
    known = norm > _LEAST_NORM
    angles = np.full((len(wxyz), 3), np.nan)
    angles[known] = roll_pitch_yaw(*(wxyz[known] / norm[known, None]).T).T
    angles[:, 2] = unwrapped(angles[:, 2])
    return dict(zip(QUATERNION_ANGLES, angles.T, strict=True))


def within_half_a_turn(angles: Floats, half: float) -> Floats:
    """Return angles, of any shape, from -half to half a turn: a roll of 359 degrees is one of -1."""
    return np.where(np.abs(angles) > half, np.mod(angles + half, 2.0 * half) - half, angles)


def turning_tilts(angles: Floats, handedness: float) -> Floats:
    """Return roll and pitch (N, 2) [rad] of the sequence ZYX of roll, pitch and yaw (N, 3) [rad] of the sequence XYZ.

    `handedness` is -1 if the yaw counts against the tilts.
    """
    return Rotation.from_euler("XYZ", angles * [1.0, 1.0, handedness]).as_euler("ZYX")[:, :0:-1]


def from_roll_pitch_yaw(angles: Floats, *, turn: float = 0.0, sequence: AngleSequence = "ZYX") -> Floats:
    """Return theta, phi, psi (N, 3) [rad], psi without jumps, of roll, pitch and yaw (N, 3) [rad]; NaN goes through.

    `turn` is the angle of the IMU's x axis from the robot's, towards the left [rad].
    """
    turned = np.full_like(angles, np.nan)
    known = np.isfinite(angles).all(axis=1)
    if known.any():
        imu = Rotation.from_euler(sequence, angles[known, :: 1 if sequence == "XYZ" else -1])
        turned[known] = (imu * Rotation.from_euler("Z", -turn)).as_euler("XYZ")
    turned[:, 2] = unwrapped(turned[:, 2])
    return turned


def integral_of(rows: Floats, rate: Floats) -> Floats:
    """Return the integral (N,) of a rate over times (N,) from its first known value; what is missing stays so."""
    known, integral = np.isfinite(rate), np.full(len(rate), np.nan)
    if known.any():
        integral[known] = cumulative_trapezoid(rate[known], rows[known], initial=0.0)
    return integral


def body_motion(
    t: Floats, imu: Sequence[Floats], gyro: Floats | None, turn: float, sequence: AngleSequence = "ZYX"
) -> Columns:
    """Return theta, phi and psi (N,) [rad], and with a gyro (N, 3) their rates and those about the robot's axes.

    Of the `imu` are roll, pitch and yaw (N,) at times t (N,) [s], and angular velocities. Without a yaw, psi is the
    integral of the gyro's rate, or, without a gyro, such that the robot's x axis points ahead.
    """
    from ballbot.mechanics.geometry import body_rates_matrix

    c, s = math.cos(turn), math.sin(turn)
    roll, pitch = imu[:2]
    if len(imu) > 2:
        yaw = imu[2]
    elif gyro is not None:
        yaw = integral_of(t, np.nan_to_num(gyro[:, 2]))
    else:
        yaw = np.arctan2(s * np.cos(roll), c * np.cos(pitch) - s * np.sin(pitch) * np.sin(roll))
    angles = from_roll_pitch_yaw(np.column_stack([roll, pitch, yaw]), turn=turn, sequence=sequence)
    columns: Columns = dict(zip(ATTITUDE_NAMES, angles.T, strict=True))
    if gyro is None:
        return columns
    x, y, z = gyro.T
    body = np.column_stack([c * x - s * y, s * x + c * y, z])
    columns |= dict(zip(("gyro_x", "gyro_y", "gyro_z"), body.T, strict=True))
    rates = np.linalg.solve(body_rates_matrix(*angles.T), body[..., None])[..., 0]
    return columns | {f"{name}_dot": rate for name, rate in zip(ATTITUDE_NAMES, rates.T, strict=True)}
