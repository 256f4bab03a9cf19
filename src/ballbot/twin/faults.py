"""Faults of a twin that are off unless its scenario has them: each a value, with its sizes.

What is off is built neither into the MuJoCo model nor into the steps, and so costs nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

#: how a wheel touches the ball: by its rollers, or by one point that is always there
WheelContact = Literal["rollers", "point"]


@dataclass(frozen=True, kw_only=True)
class Softness:
    """A ball that gives way under the wheels: a spring and a damper at each contact, along its normal."""

    stiffness: float  #: [N/m]
    damping: float  #: [N s/m]


@dataclass(frozen=True, kw_only=True)
class Compliance:
    """A driveline that twists: a spring and a damper between the motor's side and the wheel's, beyond the play."""

    frequency: float  #: at which motor and robot swing against each other, the robot on its ball [Hz]
    damping_ratio: float  #: of that mode [-]


@dataclass(frozen=True, kw_only=True)
class CurrentLoop:
    """A motor driver that takes its time: the torque follows its command through a first-order lag."""

    bandwidth: float  #: at which the torque has fallen to 71 % [Hz]


@dataclass(frozen=True, kw_only=True)
class Supply:
    """A battery and the motors' windings: the voltage left over drives the current.

    T_max = n k_t (V - k_e n w) / R, T_min = -n k_t (V + k_e n w) / R, with V = V_0 - R_i I and the battery's
    current I = sum (T w + R i^2) / V_0. The nominal twin has a fixed speed limit instead.
    """

    winding_resistance: float  #: R of one motor [ohm]
    internal_resistance: float  #: R_i of the battery and its leads [ohm]; 0 does not sag


@dataclass(frozen=True, kw_only=True)
class LoadDependence:
    """Dry driveline friction that grows with the force N between wheel and ball.

    It is 1 - share + share N / N_0 times its size, where N_0 is the force at rest, upright.
    """

    share: float  #: part of the dry friction that follows the force, 0 to 1 [-]


@dataclass(frozen=True, kw_only=True)
class Push:
    """A force on the body for a while, in the world's frame; it starts and ends with a sample."""

    time: float  #: when it begins [s]
    duration: float  #: [s]
    force: tuple[float, float, float]  #: [N]
    height: float  #: of the point of attack above the ball's centre, along the body's axis [m]


@dataclass(frozen=True, kw_only=True)
class Payload:
    """Something carried: a solid ball of aluminium's density, fixed to the body."""

    mass: float  #: [kg]
    position: tuple[float, float, float]  #: of its centre from the ball's centre, body frame [m]


@dataclass(frozen=True, kw_only=True)
class Roughness:
    """A floor with gentle bumps, by the force that their slope makes.

    A robot of weight m g at a place of height h(x, y) is pushed by -m g grad h. The height is a sum of waves in
    all directions, between one and four times the shortest wavelength.
    """

    height: float  #: root mean square [m]
    wavelength: float  #: the shortest [m]
    seed: int  #: of the floor; the robot's run has its own


@dataclass(frozen=True, kw_only=True)
class Timing:
    """A controller that is late or unsteady."""

    delay: int = 0  #: samples by which torques come later than they were computed
    jitter: float = 0.0  #: largest deviation of a sampling instant from its place on the grid [s]
