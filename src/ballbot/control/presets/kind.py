"""A kind of ready-made controller: how its gain is designed, and what stands around the gain."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from ballbot.control.controller import Compensation, Controller
from ballbot.control.lqr import LqrDesign
from ballbot.robot import Friction, Robot, RobotLike, as_robot


class GainDesign(Protocol):
    """Designs a gain for a robot."""

    def __call__(
        self,
        robot: RobotLike,
        *,
        state_weights: Sequence[float],
        torque_weight: float | None = None,
        sample_time: float | None = None,
    ) -> LqrDesign:
        """Return the gain by ten weights of the state and one of each torque, the kind's own if not given."""
        ...


@dataclass(frozen=True, kw_only=True)
class ControllerKind:
    """One kind; the value `KIND` of its file in this folder."""

    name: str  #: as `ballbot design --kind`, `simulate --controller` and `compare` take it
    text: str  #: for `ballbot design --help`
    compensation: Compensation  #: unless another is asked for
    state_weights: Sequence[float]  #: (10,) unless others are given
    design: GainDesign
    #: of a robot, the part of its friction that is compensated, and a gain that `design` made
    controller: Callable[[Robot, Friction, LqrDesign, Compensation], Controller]
    #: what a study tries: the compensation by the candidate's name
    candidates: Mapping[str, Compensation] = field(default_factory=dict[str, Compensation])

    def made(
        self, robot: RobotLike, *, compensated: Friction | None = None, sample_time: float | None = None
    ) -> Controller:
        """Return the controller by the kind's own weights; it compensates the robot's friction if not given another."""
        robot = as_robot(robot)
        design = self.design(robot, state_weights=self.state_weights, sample_time=sample_time)
        return self.controller(robot, compensated or robot.friction, design, self.compensation)
