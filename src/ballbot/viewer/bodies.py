"""The model and the twin as bodies that can be pushed, and whose friction and floor change while they move.

A push F at the height h along the body's axis is the generalised force

    (F_x, F_y, -h c_theta c_phi F_y, h (c_phi F_x + s_theta s_phi F_y), 0)

on x, y, theta, phi and psi. A floor that rises by the slope s along x carries the weight along its normal, through the
ball's centre: to first order the force -(m_b + m_r) g s on x. The twin has a floor that tilts.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ballbot.arrays import Floats
from ballbot.control.interface import Feedback, estimator_of
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import EstimatorName
from ballbot.mechanics.model import Model
from ballbot.robot import Friction, Robot
from ballbot.simulation.model_plant import ModelPlant
from ballbot.simulation.plant import Measurement
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import BodyForce, Twin
from ballbot.viewer.motion import integrated_rotation, quaternion_product

#: lean at which a robot of the twin counts as fallen [rad]: further than in its scenario, to see it fall
_FALLEN = 1.2


def push_force(
    force: tuple[float, float],
    height: float,  # above the ball's centre along the body's axis
    attitude: Sequence[float],  # theta and phi first [rad]
) -> Floats:
    """Return the generalised force (5,) of a horizontal force (2,) [N] on the body at a height [m]."""
    theta, phi = attitude[0], attitude[1]
    f_x, f_y = force
    about_theta = -height * math.cos(theta) * math.cos(phi) * f_y
    about_phi = height * (math.cos(phi) * f_x + math.sin(theta) * math.sin(phi) * f_y)
    return np.array([f_x, f_y, about_theta, about_phi, 0.0])


class ModelBody:
    """The exact model with perfect sensors."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot  #: with the friction that acts now
        self._plant = ModelPlant(Model(robot))
        self._slope = 0.0

    def reset(self, state: Floats) -> Measurement:
        """Start from a state (10,)."""
        self._ball = np.array([1.0, 0.0, 0.0, 0.0])
        self._last = self._plant.reset(state)
        return self._last

    def change(self, friction: Friction, slope: float) -> None:
        """Go on with other friction and another slope of the floor."""
        self.robot = self.robot.replace(friction=friction)
        self._plant.model = Model(self.robot)
        self._slope = slope

    def step(
        self, torques: Floats, duration: float, force: tuple[float, float], height: float
    ) -> Measurement:
        """Hold torques (n,) and a push for a duration [s]."""
        before = self._last.truth
        pulled = np.zeros(5)
        if any(force):
            pulled += push_force(force, height, before[2:4].tolist())
        pulled[0] -= self.robot.weight * self._slope
        if pulled.any():
            self._plant.push(duration * pulled)
        self._last = self._plant.step(torques, duration)
        moved = self._last.truth[:2] - before[:2]
        turn = np.array([[-moved[1], moved[0], 0.0]]) / self.robot.ball.radius
        if np.isfinite(turn).all():
            self._ball = integrated_rotation(turn, first=self._ball)[-1]
        return self._last

    def ball(self) -> Floats:
        """Return the ball's orientation (4,), world from ball, wxyz."""
        return self._ball


class TwinBody:
    """The twin, rebuilt in its present state when friction or floor change."""

    def __init__(self, robot: Robot, scenario: Scenario, controller: Feedback) -> None:
        # pushes come from the view
        self._scenario = replace(scenario, pushes=(), fallen_lean=max(_FALLEN, scenario.fallen_lean))
        self._known, self.robot = robot, robot.replace(friction=scenario.friction)
        self._estimator: EstimatorName = estimator_of(controller)
        self._build()

    def _build(self) -> None:
        estimator = named_estimator(
            self._estimator, self._known, sample_time=self._scenario.sensors.sample_time
        )
        self._twin = Twin(self.robot, self._scenario, estimator=estimator)
        self._force = BodyForce(self._twin.engine)
        self._quaternion = self._twin.engine.position("ball")[3:]

    def reset(self, state: Floats) -> Measurement:
        """Start from a state (10,)."""
        self._turned = np.array([1.0, 0.0, 0.0, 0.0])
        self._wheels = np.zeros(self.robot.wheel_count)
        self._start = 0.0
        self._force.clear()
        return self._carried(self._twin.reset(state))

    def change(self, friction: Friction, slope: float) -> None:
        """Go on with other friction and another slope of the floor; the estimator starts at the true position."""
        last, ball = self._last, self.ball()
        self.robot = self.robot.replace(friction=friction)
        self._scenario = replace(self._scenario, friction=friction, floor_tilt=(0.0, -math.atan(slope)))
        self._build()
        self._turned, self._wheels, self._start = ball, last.wheel_angles, last.t
        state = last.truth if np.isfinite(last.truth).all() else np.zeros(10)  # it may have diverged
        self._last = self._carried(self._twin.reset(state))

    def step(
        self, torques: Floats, duration: float, force: tuple[float, float], height: float
    ) -> Measurement:
        """Hold torques (n,) and a push for a duration [s]."""
        self._force.clear()
        if any(force):
            self._force.add((*force, 0.0), height)
        return self._carried(self._twin.step(torques, duration))

    def _carried(self, reading: Measurement) -> Measurement:
        """Return a measurement whose time and wheel angles go on from before the last change."""
        self._last = replace(
            reading, t=self._start + reading.t, wheel_angles=self._wheels + reading.wheel_angles
        )
        return self._last

    def ball(self) -> Floats:
        """Return the ball's orientation (4,), world from ball, wxyz."""
        return np.array(quaternion_product(self._quaternion.tolist(), self._turned.tolist()))


#: a plant that can be pushed, and whose friction and floor can change
Body = ModelBody | TwinBody
