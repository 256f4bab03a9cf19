"""The faults that a twin may have: each is a value with its sizes, their units and their allowed ranges.

`Scenario` puts them together. A fault that is None is off: neither the MuJoCo model nor the steps contain it.
"""

import math

from ballbot.robot.parameters import parameter, parameter_class
from ballbot.simulation.imperfections import MAX_DELAY

_ALUMINIUM = 2700.0  # [kg/m^3]
#: later than any run lasts [s]
NEVER = 1e9


@parameter_class
class Softness:
    """A ball that deforms under the wheels: a spring and a damper at each contact, along its normal."""

    stiffness: float = parameter("of each contact", "N/m")
    damping: float = parameter("of each contact", "N s/m", least=0.0)


@parameter_class
class Compliance:
    """A driveline that twists: a spring and a damper between the motor's side and the wheel's, beyond the play."""

    frequency: float = parameter("at which motor and balancing robot oscillate against each other", "Hz")
    damping_ratio: float = parameter("of that mode", least=0.0, most=2.0)


@parameter_class
class CurrentLoop:
    """A motor driver with a lag: the torque follows its command through a first-order filter."""

    bandwidth: float = parameter("at which the torque has fallen to 71 %", "Hz")


@parameter_class
class LoadDependence:
    """Dry driveline friction that grows with the force N between wheel and ball.

    Its size is multiplied by 1 - f + f N / N_0, where f is the fraction and N_0 the force at rest, upright.
    """

    fraction: float = parameter("fraction of the dry friction that follows the force", least=0.0, most=1.0)


@parameter_class
class Payload:
    """A payload: a solid aluminium ball, fixed to the body while it is there."""

    mass: float = parameter("of the payload", "kg")
    position: tuple[float, float, float] = parameter(
        "of its centre from the ball's centre: forward, left, up", "m", least=-math.inf
    )
    put_on: float = parameter("when it is put on", "s", default=0.0, least=0.0)
    taken_off: float = parameter("when it is taken off", "s", default=NEVER, least=0.0)

    @property
    def radius(self) -> float:
        """The radius [m] of that much aluminium."""
        return (3 * self.mass / (4 * math.pi * _ALUMINIUM)) ** (1 / 3)


@parameter_class
class Carpet:
    """Another floor for a while: the robot rolls onto it at one instant, and off it at another."""

    rolling: float = parameter("coefficient of rolling friction on it", least=0.0)
    pivoting: float = parameter(
        "moment that resists the ball's pivoting on it, over the normal force", "m", least=0.0
    )
    begins: float = parameter("when the robot rolls onto it", "s", default=0.0, least=0.0)
    ends: float = parameter("when it rolls off it", "s", default=NEVER, least=0.0)


@parameter_class
class Timing:
    """Delay and jitter of the controller."""

    delay: int = parameter(
        "whole samples by which torques are delayed", default=0, least=0.0, most=float(MAX_DELAY)
    )
    jitter: float = parameter("largest deviation of a sampling instant", "s", default=0.0, least=0.0)
