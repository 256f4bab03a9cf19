"""A controller designed for a robot: sampled LQR on the model without friction, friction compensation, and parts.

The gain is designed without friction, because the compensation cancels it. A design knows how close the compensation
comes to the friction that the robot has with 95 % confidence.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ballbot.control.controller import Compensation, Controller
from ballbot.control.linear import refuse_without_margin
from ballbot.control.lqr import LqrDesign
from ballbot.control.margins import Margins, loop_margins
from ballbot.control.overcompensation import (
    CompensationMargin,
    certain_friction,
    compensation_margin,
    refuse_overcompensation,
)
from ballbot.control.parts.notch import Notch
from ballbot.control.parts.prediction import DelayPrediction
from ballbot.control.presets import KINDS
from ballbot.errors import InputError
from ballbot.robot import Friction, RobotLike, as_robot
from ballbot.robot.components import scaled_friction
from ballbot.summary import Reported


@dataclass(frozen=True, kw_only=True)
class GainOptions:
    """How the gain is designed."""

    kind: str = "nominal"  #: of `ballbot.control.presets.KINDS`
    state_weights: Sequence[float] | None = None  #: (10,) diagonal of Q; the kind's own if None
    torque_weight: float | None = None  #: diagonal of R, the same for every wheel; the kind's own if None
    sample_time: float | None = None  #: [s]; the robot's own if None


@dataclass(frozen=True, kw_only=True)
class PartOptions:
    """What the controller has besides its gain; InputError if the factor on the friction is not possible."""

    compensation: Compensation | None = None
    """none; full (all friction); partial (only while friction works against the intended motion). If not given, the
    kind's own: none for nominal, full for precise."""

    compensation_gain: float = 1.0
    """Factor on the compensated friction, below 1 if it is uncertain."""

    notch: float | None = None
    """A frequency [Hz] to remove from the torques, such as a resonance that `ballbot validate` reports."""

    delay: float | None = None
    """Time from a measurement until the torque computed from it acts [s]. The controller feeds back the state
    predicted for that time. `ballbot identify --estimate delays` estimates it."""

    allow_overcompensation: bool = False
    """Write the controller even if it compensates more friction than is certain."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.compensation_gain < math.inf:
            raise InputError(
                f"--compensation-gain is {self.compensation_gain:g}; it must be zero or more, such as 0.8."
            )


DEFAULT_GAIN, DEFAULT_PARTS = GainOptions(), PartOptions()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ControllerDesign(Reported):
    """A controller and how it was designed; `plot()` is its loop's Bode diagram."""

    controller: Controller
    gain: LqrDesign
    stated: Friction  #: the robot's friction
    certain: Friction  #: the part of it that is present with 95 % confidence
    margin: CompensationMargin
    loop_margins: Margins


def design_controller(
    robot: RobotLike, *, gain: GainOptions = DEFAULT_GAIN, parts: PartOptions = DEFAULT_PARTS
) -> ControllerDesign:
    """Design a controller for a robot, and compute the margin of its compensation.

    Parameters
    ----------
    robot : Robot, preset or robot file
        Its friction, as far as it is certain, is compensated; the gain is designed without friction.

    Raises
    ------
    InputError
        If a weight or a part is not possible, more friction is compensated than is certain and this is not allowed, or
        the loop has no stability margin.
    """
    robot, kind = as_robot(robot), KINDS[gain.kind]
    design = kind.design(
        robot,
        state_weights=gain.state_weights or kind.state_weights,
        torque_weight=gain.torque_weight,
        sample_time=gain.sample_time,
    )
    certain = certain_friction(robot)
    compensated = scaled_friction(certain, parts.compensation_gain)
    controller = kind.controller(robot, compensated, design, parts.compensation or kind.compensation)
    if parts.notch is not None:
        controller = controller.with_parts(replace(controller.parts, notch=Notch(frequency=parts.notch)))
    if parts.delay is not None:
        late = DelayPrediction(delay=parts.delay)
        controller = controller.with_parts(replace(controller.parts, prediction=late))
    if not parts.allow_overcompensation:
        refuse_overcompensation(controller, certain)
    refuse_without_margin(controller)
    return ControllerDesign(
        controller=controller,
        gain=design,
        stated=robot.friction,
        certain=certain,
        margin=compensation_margin(controller, certain),
        loop_margins=loop_margins(controller),
    )
