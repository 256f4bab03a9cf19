"""The faults that a twin may have: each is a value with its sizes, their units and their allowed ranges.

`Scenario` puts them together. A fault that is None is off: neither the MuJoCo model nor the steps contain it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ballbot.robot.parameters import parameter
from ballbot.simulation.imperfections import MAX_DELAY


@dataclass(frozen=True, kw_only=True)
class Softness:
    """A ball that deforms under the wheels: a spring and a damper at each contact, along its normal."""

    stiffness: float = field(metadata=parameter("of each contact", unit="N/m"))
    damping: float = field(metadata=parameter("of each contact", unit="N s/m", least=0.0))


@dataclass(frozen=True, kw_only=True)
class Compliance:
    """A driveline that twists: a spring and a damper between the motor's side and the wheel's, beyond the play."""

    frequency: float = field(
        metadata=parameter("at which motor and balancing robot oscillate against each other", unit="Hz")
    )
    damping_ratio: float = field(metadata=parameter("of that mode", least=0.0, most=2.0))


@dataclass(frozen=True, kw_only=True)
class CurrentLoop:
    """A motor driver with a lag: the torque follows its command through a first-order filter."""

    bandwidth: float = field(metadata=parameter("at which the torque has fallen to 71 %", unit="Hz"))


@dataclass(frozen=True, kw_only=True)
class LoadDependence:
    """Dry driveline friction that grows with the force N between wheel and ball.

    Its size is multiplied by 1 - f + f N / N_0, where f is the fraction and N_0 the force at rest, upright.
    """

    fraction: float = field(
        metadata=parameter("fraction of the dry friction that follows the force", least=0.0, most=1.0)
    )


@dataclass(frozen=True, kw_only=True)
class Payload:
    """A payload: a solid aluminium ball, fixed to the body."""

    mass: float = field(metadata=parameter("of the payload", unit="kg"))
    position: tuple[float, float, float] = field(
        metadata=parameter(
            "of its centre from the ball's centre: forward, left, up", unit="m", least=-math.inf
        )
    )


@dataclass(frozen=True, kw_only=True)
class Roughness:
    """A floor with gentle bumps, modelled by the force of their slope.

    The force on a robot of mass m at the height h(x, y) is -m g grad h. The height is a sum of waves in all directions
    with wavelengths between one and four times the shortest.
    """

    height: float = field(metadata=parameter("root mean square", unit="m", least=0.0))
    wavelength: float = field(
        metadata=parameter("shortest wavelength; the longest is four times as long", unit="m")
    )
    seed: int = field(metadata=parameter("random seed of the floor; the run has its own", least=-math.inf))


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Delay and jitter of the controller."""

    delay: int = field(
        default=0,
        metadata=parameter("whole samples by which torques are delayed", least=0.0, most=float(MAX_DELAY)),
    )
    jitter: float = field(
        default=0.0, metadata=parameter("largest deviation of a sampling instant", unit="s", least=0.0)
    )
