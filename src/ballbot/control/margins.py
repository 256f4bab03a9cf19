"""What a reference will ask of a robot, before it is tried: torque, speed, power and lean against their limits.

The reference is shaped as the controller shapes it. Its motion's lean and torques are those of the feed-forward; what
friction takes at the wheels' speeds comes on top, each wheel's own and its part in carrying the rolling friction.
What feedback needs besides, for disturbances and noise, is not in it: keep some margin for that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.control.compensation import rolling_shares
from ballbot.control.feed_forward import FeedForward
from ballbot.control.reference_shaping import ReferenceShaping, shape_references
from ballbot.control.references import Reference
from ballbot.errors import InputError
from ballbot.mechanics.friction import wheel_friction
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.derived import wheel_speed_limit

#: lean up to which the feed-forward's linear model is good, and a robot with rollers keeps its grip [rad]
LARGEST_LEAN = 0.3
#: share of a limit from which a reference is said to be out of reach: feedback needs the rest
_USABLE = 0.8


@dataclass(frozen=True, kw_only=True)
class Demand:
    """The most that a motion asks of one thing, and what there is of it."""

    what: str
    unit: str
    most: float
    limit: float
    at: float  #: when it is asked [s]

    @property
    def share(self) -> float:
        """What is asked over what there is."""
        return self.most / self.limit

    @property
    def sentence(self) -> str | None:
        """Why the motion cannot be followed, or None."""
        if self.share <= _USABLE:
            return None
        return (
            f"The motion asks for {self.most:.3g} {self.unit} of {self.what} at t = {self.at:.2f} s, and "
            f"{_USABLE * self.limit:.3g} {self.unit} of the robot's {self.limit:.3g} {self.unit} are at hand; feedback "
            "needs the rest."
        )


@dataclass(frozen=True, kw_only=True)
class Margins:
    """What a reference asks of a robot."""

    lean: Demand  #: of the body [rad]
    torque: Demand  #: of a wheel [N m]
    speed: Demand  #: of a wheel [rad/s]
    power: float  #: the most that all wheels take together [W]

    @property
    def refusals(self) -> tuple[str, ...]:
        """Why the robot cannot follow, a sentence each; empty where it can."""
        return tuple(one.sentence for one in (self.lean, self.torque, self.speed) if one.sentence)


def reference_margins(
    robot: Robot,
    reference: Reference,
    *,
    duration: float,
    shaping: ReferenceShaping | None = None,
    sample_time: float | None = None,
) -> Margins:
    """Return what a reference asks of a robot that starts at the reference's first pose.

    Parameters
    ----------
    robot : Robot
        With its friction.
    reference : callable
        f(t) -> (10,)
    duration : float
        [s]
    shaping : ReferenceShaping, optional
        The default one where not given.
    sample_time : float, optional
        [s]; the robot's own where not given.

    Raises
    ------
    InputError
        Where the duration is less than a sample.
    """
    h = robot.sensors.sample_time if sample_time is None else sample_time
    if not duration >= h:
        raise InputError(f"The duration is {duration:g} s; it must be at least one sample of {h:g} s.")
    times = np.asarray(np.arange(round(duration / h)) * h, dtype=np.float64)
    references = np.array([reference(float(t)) for t in times], dtype=np.float64)
    smooth = shape_references(shaping or ReferenceShaping(), references, h)
    states = _motion(FeedForward.of(robot), smooth)
    speeds = Model(robot).wheel_speed(states[:, :5], states[:, 5:])
    torques = _motion_torques(FeedForward.of(robot), smooth) + _friction_torques(robot, states, speeds)
    top = wheel_speed_limit(
        supply_voltage=robot.drive.supply_voltage,
        speed_constant=robot.drive.speed_constant,
        gear_ratio=robot.drive.gear_ratio,
    )
    return Margins(
        lean=_demand("lean", "rad", np.hypot(states[:, 2], states[:, 3]), LARGEST_LEAN, times),
        torque=_demand("torque at a wheel", "N m", np.abs(torques).max(axis=1), robot.drive.torque_limit, times),
        speed=_demand("speed of a wheel", "rad/s", np.abs(speeds).max(axis=1), top, times),
        power=float(np.sum(torques * speeds, axis=1).max()),
    )  # fmt: skip


def _demand(
    what: str, unit: str, values: NDArray[np.float64], limit: float, times: NDArray[np.float64]
) -> Demand:
    k = int(np.argmax(values))
    return Demand(what=what, unit=unit, most=float(values[k]), limit=limit, at=float(times[k]))


def _heading_frame(
    smooth: NDArray[np.float64], derivative: int, psi: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a derivative of x and y (N, 2) turned by -psi."""
    x, y = smooth[:, 0, derivative], smooth[:, 1, derivative]
    return np.stack([np.cos(psi) * x + np.sin(psi) * y, np.cos(psi) * y - np.sin(psi) * x], axis=1)


def _world(vector: NDArray[np.float64], psi: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y = vector.T
    return np.stack([np.cos(psi) * x - np.sin(psi) * y, np.sin(psi) * x + np.cos(psi) * y], axis=1)


def _motion(forward: FeedForward, smooth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the states (N, 10) of a shaped motion."""
    psi = smooth[:, 2, 0]
    second, third = _heading_frame(smooth, 2, psi), _heading_frame(smooth, 3, psi)
    states = np.empty((len(smooth), 10))
    states[:, :2] = smooth[:, :2, 0] - _world(second @ forward.offset.T, psi)
    states[:, 2:4] = _world(second @ forward.lean.T, psi)
    states[:, 4] = psi
    states[:, 5:7] = smooth[:, :2, 1] - _world(third @ forward.offset.T, psi)
    states[:, 7:9] = _world(third @ forward.lean.T, psi)
    states[:, 9] = smooth[:, 2, 1]
    return states


def _motion_torques(forward: FeedForward, smooth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the torques (N, n) of a shaped motion without friction."""
    psi = smooth[:, 2, 0]
    second, fourth = _heading_frame(smooth, 2, psi), _heading_frame(smooth, 4, psi)
    turning = smooth[:, 2, 2, None] * forward.by_turning
    return second @ forward.by_second.T + fourth @ forward.by_fourth.T + turning


def _friction_torques(
    robot: Robot, states: NDArray[np.float64], speeds: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return what friction takes of each wheel's torque (N, n)."""
    psi, v = states[:, 4], states[:, 5:7]
    size = np.hypot(v[:, 0], v[:, 1])
    moving = v / np.where(size > 0.0, size, 1.0)[:, None]
    heading = _world(moving, -psi)
    weight = (robot.ball.mass + robot.body.mass) * robot.gravity
    rolling = weight * robot.friction.rolling * heading @ rolling_shares(robot).T
    return wheel_friction(speeds, robot.friction) + rolling
