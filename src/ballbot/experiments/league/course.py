"""A course of the league: where the robot is asked to be, and what is then true of the twin."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, replace
from difflib import get_close_matches

from ballbot.control.references import REFERENCES, Reference, is_reference_file, read_reference
from ballbot.errors import InputError
from ballbot.estimation.interface import EstimatorName, named_estimator
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.robot import scaled_body, scaled_friction
from ballbot.simulation.plant import Plant
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import Twin


@dataclass(frozen=True, kw_only=True)
class Asked:
    """A reference by what makes it, so that it can go to other processes."""

    name: str  #: of `ballbot.control.references`, or a reference file
    options: tuple[tuple[str, float], ...] = ()  #: of the named one, such as ("ramp", 0.0)

    def reference(self) -> Reference:
        """Return it.

        Raises
        ------
        InputError
            Where there is no such reference, or it has no such option.
        """
        if is_reference_file(self.name):
            if self.options:
                raise InputError(f"The reference file {self.name} takes no options; remove {self._first}.")
            return read_reference(self.name)
        if self.name not in REFERENCES:
            near = get_close_matches(self.name, REFERENCES, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"the names are {', '.join(REFERENCES)}."
            raise InputError(f"There is no reference {self.name!r}; {hint}")
        make = REFERENCES[self.name]
        known = list(inspect.signature(make).parameters)
        unknown = [key for key, _ in self.options if key not in known]
        if unknown:
            raise InputError(
                f"The reference {self.name} has no option {unknown[0]}; it has {', '.join(known)}."
            )
        return make(**dict(self.options))

    @property
    def _first(self) -> str:
        return self.options[0][0]


@dataclass(frozen=True, kw_only=True)
class Unlike:
    """How the robot that runs differs from the one described, which the controllers know: factors."""

    mass: float = 1.0  #: of the body
    height: float = 1.0  #: of its centre of mass above the ball's centre
    friction: float = 1.0  #: of the wheels' and the rolling friction


@dataclass(frozen=True, kw_only=True)
class Course:
    """What every controller is put through."""

    name: str
    about: str  #: in a sentence, for those who read the table
    asked: Asked
    duration: float  #: [s]
    settle: float  #: errors count from so long after the start and each jump of the reference on [s]
    unlike: Unlike = Unlike()
    scenario: Scenario | None  #: of the twin; None is the exact model with perfect sensors

    @property
    def disturbed(self) -> tuple[float, ...]:
        """When something pushes the robot [s]."""
        return tuple(push.time for push in self.scenario.pushes) if self.scenario else ()

    def plant(self, robot: Robot, *, estimator: EstimatorName = "onboard") -> Plant | Model:
        """Return a new robot to run; of the model the friction is the robot's, of the twin the scenario's.

        The model's state is measured without error; the twin's is estimated, from what the robot is described to be.

        Raises
        ------
        InputError
            Where the robot would be none.
        """
        other = self.unlike
        true = robot
        if other != Unlike():
            body = scaled_body(robot.body, mass=other.mass, height=other.height)
            true = robot.replace(body=body, friction=scaled_friction(robot.friction, other.friction))
        if self.scenario is None:
            return Model(true)
        friction = scaled_friction(self.scenario.friction, other.friction)
        scenario = replace(self.scenario, friction=friction)
        state = named_estimator(estimator, robot, sample_time=scenario.sensors.sample_time)
        return Twin(true, scenario, estimator=state)
