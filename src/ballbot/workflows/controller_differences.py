"""What differs in a run from the one predicted: a few numbers of its motion and torques, each beside what it was.

The torques are compared with the motion, and the ball's acceleration with the lean (`ballbot.log.checks`), each by a
least-squares fit whose factors are one, or zero, for the robot as identified:

    u_i = k_i n_i + s f(w_i) + o_i                     n the torque of the motion, f the identified friction
    v_dot + C w_dot = -gamma Lambda g - r v/|v| + e     independent of the driveline

The lag at which the first fits quick motion best is the delay from torque to motion. Noise, play and rollers change
these numbers too, so they are compared with those of the study: the friction of its logs, the rest of a simulated run
of the same controller, and not with ones and zeros. No cause is concluded: several faults move one number alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ballbot.log import Log
from ballbot.log.checks.lean import Motion, Rows, as_complex, as_plane, motion_of, usable_rows
from ballbot.log.checks.torque_balance import SIGN, driving_of, smoothed_wheel_speeds
from ballbot.log.columns import torque_names
from ballbot.mechanics.friction import wheel_friction
from ballbot.mechanics.model import contact_momentum
from ballbot.results import reported
from ballbot.robot import Robot

#: exponent of the weight of rows in which a wheel may have stood still within the filter's window
_TURNED_POWER = 4
#: samples by which the torques may act later than logged; a filter of the state makes them seem early
_LAGS = range(-10, 15)
#: unexplained fraction of the torques above which the torque law determines nothing
_UNCLEAR = 0.2
#: duration from which a run separates gain, friction and constants of the torque [s]. On three runs of the twin around
#: the square the gain, truly 1, came out as 0.55 to 0.68 of 8 s, 0.80 to 0.88 of 16 s and 0.995 to 0.999 of 24 s
_SEPARABLE = 23.9
#: width of a filter that keeps fast motion, from which a delay is determined [s]
_QUICK = 0.02
#: ball speed below which the direction of rolling friction is unknown [m/s]
_ROLLING = 0.01
#: usual differences from which one is listed: three standard deviations
LISTED = 3.0


@dataclass(frozen=True)
class Number:
    """A number of a run as it is shown, and by how much it differs on a robot without faults."""

    meaning: str
    unit: str
    #: RMS difference from the predicted run, of a ratio its logarithm; `python -m campaigns.controller_prediction`
    #: prints those of ten twins without faults
    usual: float
    ratio: bool = False
    scale: float = 1.0  #: from SI to the unit


NUMBERS: Mapping[str, Number] = MappingProxyType(
    {
        "delay": Number("delay from torque to motion", "ms", 0.0015, scale=1e3),
        "torque_gain": Number("torque over that of the motion", "", 0.02, ratio=True),
        "torque_spread": Number("the same, the largest wheel's over the smallest's", "", 0.02, ratio=True),
        "friction": Number("friction over the identified one", "", 0.06, ratio=True),
        "asymmetry": Number("torque that all wheels need more in one direction", "N m", 0.01),
        "force": Number("constant torque along the floor, as on a slope", "N m", 0.015),
        "rolling": Number("deceleration of the ball not from the lean", "m/s^2", 0.01),
        "gravity": Number("acceleration of the ball over that from the lean", "", 0.03, ratio=True),
        "turn": Number("turn of the lean about the vertical", "rad", 0.02),
        "lean_offset": Number("constant error of the lean", "mrad", 0.0008, scale=1e3),
        "gyro_noise": Number("noise of the gyro", "mrad/s", 0.1, ratio=True, scale=1e3),
    }
)
#: those that depend on the robot's friction alone, not on its controller
OF_FRICTION = ("friction", "rolling")


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A number of the run that is not as predicted; SI units."""

    name: str
    measured: float
    predicted: float

    @reported
    def usual_sizes(self) -> float:
        """How far it is off, in its usual differences on a robot without faults; NaN if that cannot be said."""
        number = NUMBERS[self.name]
        if not number.ratio:
            return abs(self.measured - self.predicted) / number.usual
        positive = self.measured > 0.0 and self.predicted > 0.0
        return abs(float(np.log(self.measured / self.predicted))) / number.usual if positive else np.nan


def differences(measured: Mapping[str, float], predicted: Mapping[str, float]) -> tuple[Difference, ...]:
    """Return what differs between two signatures, the largest difference first."""
    both = [
        Difference(name=name, measured=measured[name], predicted=predicted[name])
        for name in NUMBERS
        if name in measured and name in predicted
    ]
    listed = [one for one in both if one.usual_sizes >= LISTED]
    return tuple(sorted(listed, key=lambda one: -one.usual_sizes))


def signature_of(log: Log, robot: Robot) -> dict[str, float]:
    """Return the `NUMBERS` that a log shows, SI units; none if it has too little motion, or lacks states or torques.

    Parameters
    ----------
    log : Log
    robot : Robot
        As identified.
    """
    rows = usable_rows(log, robot)
    if rows is None or not set(torque_names(robot.wheel_count)) <= set(log.names):
        return {}
    found = {"delay": _delay(log, rows, robot), "gyro_noise": _gyro_noise(log)}
    found |= _torque_law(log, rows, robot) | _lean_law(motion_of(log, rows), robot)
    return {name: value for name, value in found.items() if np.isfinite(value)}


def _torque_law(log: Log, rows: Rows, robot: Robot) -> dict[str, float]:
    left, fits = _fits(log, rows, robot)
    if left.min() > _UNCLEAR or len(log) * log.sample_time < _SEPARABLE:
        return {}
    n = robot.wheel_count
    gains, constants, friction = np.split(fits[int(np.argmin(left))], [n, 2 * n])
    common = float(constants.mean())
    return {
        "torque_gain": float(gains.mean()),
        "torque_spread": float(gains.max() / gains.min()) if gains.min() > 0.0 else np.nan,
        "friction": float(friction[0]),
        "asymmetry": common,
        "force": float(np.linalg.norm(constants - common)),
    }


def _delay(log: Log, rows: Rows, robot: Robot) -> float:
    """Return the lag at which the torque law fits quick motion best [s]; NaN if it is beyond those tried."""
    left, _ = _fits(log, replace(rows, width=_QUICK), robot)
    best = int(np.argmin(left))
    if not 0 < best < len(left) - 1:
        return np.nan
    # the vertex of the parabola through the three best
    before, here, after = left[best - 1 : best + 2].tolist()
    return log.sample_time * (_LAGS[best] + 0.5 * (before - after) / (before - 2.0 * here + after))


def _fits(log: Log, rows: Rows, robot: Robot) -> tuple[NDArray[np.float64], Sequence[NDArray[np.float64]]]:
    """Return for each lag the unexplained fraction of the torques, and the gains, constants and factor of friction."""
    driving = driving_of(log, rows, motion_of(log, rows), robot)
    assert driving is not None  # all torques are there
    speeds = smoothed_wheel_speeds(log, robot)
    size = np.abs(wheel_friction(speeds, robot.friction)) * np.tanh(speeds / SIGN)
    friction, weight = rows.filtered(log, size).value, driving.turning**_TURNED_POWER
    n, zero = robot.wheel_count, np.zeros((len(weight), robot.wheel_count))
    blocks = []
    for i in range(n):
        gain, constant = zero.copy(), zero.copy()
        gain[:, i], constant[:, i] = driving.needed[:, i], 1.0
        blocks.append(np.column_stack([gain, constant, friction[:, i]]) * weight[:, [i]])
    X, torques = np.vstack(blocks), np.column_stack([log[name] for name in torque_names(n)])
    left, fits = [], []
    for lag in _LAGS:
        u = (rows.filtered(log, torques, late=(lag + 0.5) * log.sample_time).value * weight).T.ravel()
        fits.append(np.asarray(np.linalg.lstsq(X, u, rcond=None)[0], dtype=np.float64))
        left.append(float(np.sum((u - X @ fits[-1]) ** 2)) / max(float(u @ u), 1e-30))
    return np.array(left), fits


def _lean_law(motion: Motion, robot: Robot) -> dict[str, float]:
    law = contact_momentum(robot)
    v, turning = motion.velocity, 1j * motion.turning
    theta, phi = motion.lean
    w = [one.value for one in motion.lean_rate]
    w_dot = [one.rate for one in motion.lean_rate]
    rate = as_complex(as_plane(w_dot[0] + 1j * w_dot[1]) @ law.lever[:, :2].T)
    rate += turning * as_complex(as_plane(w[0] + 1j * w[1]) @ law.lever[:, :2].T)
    pull = as_complex(as_plane(1j * theta - phi) @ law.pull.T)
    rolling = v.value / np.maximum(np.abs(v.value), _ROLLING)
    y = v.rate + turning * v.value + rate
    X = np.column_stack([-pull, -rolling, np.ones_like(pull)])
    gravity, friction, constant = np.linalg.lstsq(X, y, rcond=None)[0]
    return {
        "rolling": float(friction.real),
        "gravity": float(abs(gravity)),
        "turn": float(np.angle(gravity)),
        "lean_offset": float(abs(constant)) / float(np.sqrt(np.abs(np.linalg.det(law.pull)))),
    }


def _gyro_noise(log: Log) -> float:
    """Return the noise of a gyro's sample [rad/s]; NaN without a gyro."""
    if not {"gyro_x", "gyro_y"} <= set(log.names):
        return np.nan
    rates = np.column_stack([log["gyro_x"], log["gyro_y"]])
    # second differences leave noise and take the motion away; theirs is sqrt(6) times as large
    change = np.diff(rates[np.isfinite(rates).all(axis=1)], n=2, axis=0)
    return float(np.sqrt(np.mean(change**2) / 6.0))
