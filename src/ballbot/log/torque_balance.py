"""Wheel torques against the torques that the motion needs, and how large each is.

The rows of the equations of motion without the lean, about upright and in the heading frame, give the torque between
ball and wheels,

    r_b d/dt (M_vv v + M_vw w) = E^T tau,      M_w. (w_dot, v_dot) about the vertical = -tau_z,      tau = A^T n,

and with it n, the torque that each wheel needs for the motion. A motor supplies it and its driveline's friction:

    u_i = s_i (k n_i + f(wheel speed i))    f: dry, viscous, falling with speed; it never drives

so k is one for the right robot, s_i for the right scale, and wheel i's torque follows n_i and its own speed's sign.
Which order and signs of the torques explain the log best: `ballbot.log.mapping_search.commands`.

The gains are solved from one set of products per motor and second, weighted by the fraction of time in which the wheel
turned for certain: the friction of a sticking wheel is unknown. Regression of a torque on the torque that the motion
needs gives too small a factor, because the need is computed from differentiated signals and has their noise. The factor
is therefore that of the part of the need that gravity causes: its noise is that of another sensor, an instrumental
variable. Its error has three parts: the scatter of the seconds; what friction's three terms miss, a fraction of the
friction that grows with the part of it that goes along with the need; and a floor. A log in which friction is most of
the torque hardly bounds the scale; a finding then reports the bounds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Floats
from ballbot.log.balancing_motion import EVERY, Motion, as_complex, as_plane
from ballbot.log.columns import torque_names
from ballbot.log.log import Log
from ballbot.log.pose import measured_wheel_speeds
from ballbot.log.signals import INTERVAL, local_fit
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.model import Model, contact_momentum
from ballbot.robot import Robot

#: speed at which the sign of a wheel's dry friction is nearly certain, above which it is certain, and at which the
#: falling part of friction has fallen to 37 % [rad/s]
SIGN, TURNING, FALLING = 0.1, 0.3, 0.6
#: exponent of the weight of rows by the fraction of the filter's time in which the wheel turned for certain
TURNED_POWER = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Driving:
    """Torques, needed torques and friction terms of each wheel, at the rows of `Motion`."""

    torque: Floats  #: (N, n) u as logged, filtered [N m]
    needed: Floats  #: (N, n) n, the torque that the motion needs of each wheel [N m]
    pulled: Floats  #: (N, n) gravity's part of it [N m]
    friction: Floats  #: (N, n, 3) sign, speed and falling sign of each wheel's speed, filtered
    turning: Floats  #: (N, n) fraction of the filter's time in which the wheel turned for certain
    block: NDArray[np.intp]  #: (N,)
    azimuths: Floats  #: (n,) of the wheels [rad]


def driving_of(log: Log, motion: Motion, robot: Robot) -> Driving | None:
    """Return the torques of a log and those that its motion needs; None without every wheel's torque."""
    names = torque_names(robot.wheel_count)
    if not set(names) <= set(log.names):
        return None
    speed = smoothed_wheel_speeds(log, robot)
    sign = np.tanh(speed / SIGN)
    parts = (sign, speed, sign * np.exp(-np.abs(speed) / FALLING), (np.abs(speed) > TURNING).astype(float))
    terms = motion.filtered(log, np.hstack(parts)).reshape(len(motion.block), 4, -1)
    torques = np.column_stack([log[name] for name in names])
    needed, pulled = _needed(motion, robot)
    return Driving(
        torque=motion.filtered(log, torques, late=0.5 * log.sample_time), needed=needed, pulled=pulled,
        friction=np.moveaxis(terms[:, :3], 1, -1), turning=np.clip(terms[:, 3], 0.0, 1.0),
        block=motion.block, azimuths=np.asarray(robot.wheels.azimuths),
    )  # fmt: skip


def _needed(motion: Motion, robot: Robot) -> tuple[Floats, Floats]:
    """Return the torques (N, n) [N m] that the motion needs of each wheel, and gravity's part of them."""
    M, r_b, pull = Model(robot).mass_matrix(np.zeros(5)), robot.ball.radius, contact_momentum(robot).pull
    v, v_dot = as_plane(motion.velocity), as_plane(motion.acceleration)
    lean_rate, lean_acceleration = (a + 1j * b for a, b in (motion.lean_rate, motion.lean_acceleration))
    w = np.column_stack([as_plane(lean_rate), motion.turning])
    w_dot = np.column_stack([as_plane(lean_acceleration), motion.turning_rate])
    momentum, change = (as_complex(a @ M[:2, :2].T + b @ M[:2, 2:].T) for a, b in ((v, w), (v_dot, w_dot)))
    force = change + 1j * motion.turning * momentum
    g = -motion.lean[1] + 1j * motion.lean[0]
    of_gravity = as_complex(-as_plane(g) @ pull.T @ M[:2, :2].T)
    tau_z = -(w_dot @ M[4, 2:] + v_dot @ M[4, :2])
    # tau (N, 3) between ball and wheels about the heading frame's axes, as torques of the wheels
    needed, pulled = (
        np.column_stack([-r_b * f.imag, r_b * f.real, z]) @ np.linalg.pinv(transforms(robot).T_owb)
        for f, z in ((force, tau_z), (of_gravity, np.zeros(len(g))))
    )
    return needed, pulled


def smoothed_wheel_speeds(log: Log, robot: Robot) -> Floats:
    """Return each wheel's speed (len(log), n) [rad/s], smoothed; by the states where it is not logged.

    It is missing in rows that lack the states as well.
    """
    speeds = measured_wheel_speeds(log, robot)
    known = np.isfinite(speeds).all(axis=1)
    smooth = np.full_like(speeds, np.nan)
    smooth[known] = local_fit(log.t[known], speeds[known], rows=max(2, round(0.015 / log.sample_time)))[0]
    return smooth


#: fewest seconds in which a wheel turns for certain for the gain of a motor
LEAST_TURNING = 2.0
#: relative error of every gain, and of the friction that the three terms give: with these, the largest of 724 gains of
#: sound recordings of the development halves of campaigns/mapping_recordings.py is 3.2 standard errors from one
FLOOR, FRICTION_ERROR = 0.03, 0.03
#: standard deviation of the logarithm of the gain of all torques, before a log is seen
USUAL = 0.15
#: standard errors of a gain that is wrong (of 400 sound logs of robots that set nothing, 2 are beyond 3.5), and the
#: factor of one torque over the others that is
SURE, UNLIKE = 5.0, 1.25
#: a factor that a log must exclude; otherwise its bounds are reported
MUST_SHOW = 1.4
#: gains nearer to zero than this part of the middle one are as good as zero
ZERO = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class Gains:
    """Factors of each torque over the one that its wheel needs."""

    factors: Floats  #: (n,); nan if the log does not show it
    errors: Floats  #: (n,) relative standard errors

    def common(self, but: int | None = None) -> tuple[float, float]:
        """Return the factor of all torques, or of all but one, and its relative standard error."""
        shown = self.factors[np.isfinite(self.factors)]
        known = self.factors > ZERO * max(float(np.median(shown)), 0.0) if shown.size else self.factors > 0.0
        known = known & (np.arange(len(known)) != but)
        weights = 1.0 / np.square(self.errors[known])
        precision = float(weights.sum())
        if precision == 0.0:
            return 1.0, float("inf")
        return float(np.exp(weights @ np.log(self.factors[known]) / precision)), precision**-0.5

    def unlike(self) -> tuple[Floats, Floats]:
        """Return the factor (n,) of each torque over that of the others, and its relative standard error.

        The others' is known by what is usual, too, unless the log contradicts that.
        """
        others, errors = np.array([self.common(i) for i in range(len(self.factors))]).T
        precision = errors**-2 + USUAL**-2
        usual = np.abs(np.log(others)) < 3.0 * np.hypot(errors, USUAL)
        others = np.where(usual, others ** (errors**-2 / precision), others)
        errors = np.where(usual, precision**-0.5, errors)
        return np.maximum(self.factors / others, ZERO), np.hypot(self.errors, errors)

    def unbounded(self) -> dict[int, tuple[float, float]]:
        """Return bounds (95 %) of the factor over the others' of each torque (from 0) that may be `MUST_SHOW` off."""
        factors, errors = self.unlike()
        with np.errstate(over="ignore"):
            reach = np.exp(1.96 * errors)
        wide = ~(np.exp(np.abs(np.nan_to_num(np.log(factors)))) * reach < MUST_SHOW)
        low, high = (factors / reach).tolist(), (factors * reach).tolist()
        return {i: (low[i], high[i]) for i in np.flatnonzero(wide).tolist()}

    def scale_errors(self) -> Floats:
        """Return the relative standard error (n,) of each torque's scale that its motor's friction has besides its own.

        It is zero if the logs bound the scale to a factor of `MUST_SHOW`. If not, the scale is known by them and by
        what is usual.
        """
        errors = (self.errors**-2.0 + USUAL**-2) ** -0.5
        return np.where(np.isin(np.arange(len(errors)), list(self.unbounded())), errors, 0.0)


def gains_of(driving: Driving) -> Gains:
    """Return the gain of each motor."""
    factors = np.array([_gain(driving, i) for i in range(driving.torque.shape[1])])
    return Gains(factors=factors[:, 0], errors=factors[:, 1])


def _gain(driving: Driving, i: int) -> tuple[float, float]:
    """Return the factor of a motor and its relative standard error; (nan, inf) if the log has none."""
    weight = driving.turning[:, i] ** TURNED_POWER
    friction = np.column_stack([driving.friction[:, i], np.ones(len(weight))])
    rest = np.column_stack([driving.needed[:, i], driving.pulled[:, i], driving.torque[:, i]])
    friction, rest = friction * weight[:, None], rest * weight[:, None]
    of_friction, crossed = friction.T @ friction, friction.T @ rest
    size = np.diag(of_friction)
    tiny = np.diag(1e-9 * size + 1e-12 * size.sum() + 1e-300)  # terms may be collinear, or zero
    explained = np.linalg.solve(of_friction + tiny, crossed)
    left = rest - friction @ explained  # of the need, gravity's part of it and the torque
    of_need, of_torque = (np.bincount(driving.block, weights=left[:, 1] * left[:, k]) for k in (0, 2))
    common = float(of_need.sum())
    if EVERY * INTERVAL * float(weight.sum()) < LEAST_TURNING or common <= 0.0:
        return float("nan"), float("inf")
    k = float(of_torque.sum()) / common
    scatter = float(np.linalg.norm(of_torque - k * of_need)) / common
    own = explained[:, 2] - k * explained[:, 0]
    # what the terms miss, at its worst goes along with gravity's need
    missed = FRICTION_ERROR * np.sqrt(own @ of_friction @ own * np.vdot(left[:, 1], left[:, 1])) / common
    return k, float(np.hypot(np.hypot(scatter, missed) / max(abs(k), ZERO), FLOOR))


def together(gains: Sequence[Gains]) -> Gains:
    """Return the gains that several logs of a robot show."""
    weights = 1.0 / np.square([gain.errors for gain in gains])
    precision = weights.sum(axis=0)
    mean = np.sum(np.where(weights > 0.0, weights * [gain.factors for gain in gains], 0.0), axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return Gains(factors=mean / precision, errors=np.maximum(precision**-0.5, FLOOR))
