"""The motors' shafts: the angles that encoders see.

Wheels with rollers simply turn. A wheel that touches the ball in a single point has one roller, which must stay
under the ball: before each step such a wheel is turned back to where its roller touches, and what it had turned
is kept. Its speeds, the roller's among them, go on; the error of a step shrinks with the step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.robot.robot import Robot
from ballbot.twin.engine import Engine
from ballbot.twin.scenario import Scenario


class Shafts:
    """The shafts of one twin.

    Parameters
    ----------
    robot : Robot
    scenario : Scenario
    engine : Engine
        Has a hinge "wheel 1" to "wheel n", and "play 1" to "play n" where the scenario has play or a spring.
    """

    def __init__(self, robot: Robot, scenario: Scenario, engine: Engine) -> None:
        count = robot.wheel_count
        self._hinges = engine.qpos[engine.positions("wheel", count)]
        self._has_play = scenario.backlash > 0 or scenario.compliance is not None
        self._play = engine.qpos[engine.positions("play", count)] if self._has_play else None
        self._backlash = scenario.backlash
        #: whether the wheels must be turned back before each step
        self.returning = scenario.wheel_contact == "point"
        self._turned = np.zeros(count)

    def reset(self, random: np.random.Generator) -> None:
        """Put every wheel at any angle, and the motor anywhere within its play."""
        count = len(self._hinges)
        self._hinges[:] = random.uniform(0.0, 2 * np.pi, count)
        if self._backlash > 0 and self._play is not None:
            self._play[:] = self._backlash * random.uniform(-0.5, 0.5, count)
        self._turned[:] = 0.0
        if self.returning:
            self.turn_back()

    def angles(self) -> NDArray[np.float64]:
        """Return the motors' angles (n,) at the wheel [rad]."""
        return self._hinges + self._turned if self.returning else self._hinges

    def wheel_angles(self) -> NDArray[np.float64]:
        """Return the wheels' own angles (n,) [rad], beyond play and spring."""
        return self.angles() if self._play is None else self.angles() + self._play

    def turn_back(self) -> None:
        """Put the single roller of every wheel where it touches the ball."""
        turn = self._hinges if self._play is None else self._hinges + self._play
        turn = turn.copy()
        self._turned += turn
        self._hinges -= turn
