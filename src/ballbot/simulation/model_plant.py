"""The model as a plant: the equations of motion with perfect sensors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.mechanics.engine import simulate_lanes
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.mechanics.geometry import body_rates_matrix
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.floor import lift_off, sinking_of
from ballbot.simulation.plant import Measurement

#: why a run on the model ends
FALLEN = f"fallen: lean past {LARGEST_LEAN:g} rad"
LIFTED = "lifted: the floor would have to pull"


class ModelPlant:
    """A `Model` behind the plant's seam. What is measured is what is true.

    A run ends where theta or phi passes 1.2 rad, or where, at the end of a sample, the floor would have to pull
    the robot down. Wheel angles are the integral of the formulation's wheel speeds (trapezoids over samples).

    Where the model's ball pivots, its spin is carried along: it starts at zero, no measurement shows it but the
    wheels', and state and truth stay the ten numbers.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self._lift_off = lift_off(model.robot)
        self._t = 0.0
        self._state = np.zeros(5 + model.velocity_count)
        self._wheel_angles = np.zeros(model.robot.wheel_count)
        self._wheel_speeds = np.zeros(model.robot.wheel_count)

    @property
    def robot(self) -> Robot:
        """The model's robot."""
        return self.model.robot

    @property
    def spin(self) -> float:
        """The ball's spin about the vertical [rad/s]; zero where the model's ball does not pivot."""
        return float(self._state[10]) if self.model.pivots else 0.0

    def reset(self, initial_state: NDArray[np.float64] | None = None, *, seed: int = 0) -> Measurement:  # noqa: ARG002
        """Start at t = 0 from a state (10,), or upright at rest at the origin; nothing here is random.

        Raises
        ------
        InputError
            Where the state is not ten finite numbers with a lean of at most 1.2 rad.
        """
        self._state = np.zeros(5 + self.model.velocity_count)
        if initial_state is not None:
            self._state[:10] = checked_states(initial_state)[0]
        self._t = 0.0
        self._wheel_angles = np.zeros(self.robot.wheel_count)
        self._wheel_speeds = self._speeds()
        return self._measure(None)

    def step(self, torques: NDArray[np.float64], duration: float) -> Measurement:
        """Hold the torques (n,) [N m] for a duration [s] and return the measurement at its end."""
        torques = np.ascontiguousarray(torques, dtype=np.float64)
        batch = simulate_lanes(
            self.model.selected,
            parameters=self.model.packed[None],
            initial=self._state[None],
            torques=torques[None, None],
            sample_time=duration,
            steps=self.model.steps_in(duration),
        )
        before = self._wheel_speeds
        self._state = batch.states[0, 0]
        self._t = round(
            self._t + duration, 9
        )  # whole nanoseconds: a sum would drift past a reference's corners
        self._wheel_speeds = self._speeds()
        self._wheel_angles = self._wheel_angles + 0.5 * duration * (before + self._wheel_speeds)
        return self._measure(self._why_ended(torques))

    def _speeds(self) -> NDArray[np.float64]:
        return self.model.wheel_speed(self._state[:5], self._state[5:])

    def _why_ended(self, torques: NDArray[np.float64]) -> str | None:
        if not np.abs(self._state[2:4]).max() <= LARGEST_LEAN:
            return f"{FALLEN} at t = {self._t:.3f} s"
        if not sinking_of(self.model.selected, self.model.packed, self._state, torques) < self._lift_off:
            return f"{LIFTED} at t = {self._t:.3f} s"
        return None

    def _measure(self, ended: str | None) -> Measurement:
        state = self._state[:10].copy()
        return Measurement(
            t=self._t,
            state=state,
            wheel_angles=self._wheel_angles,
            wheel_speeds=self._wheel_speeds,
            gyro=body_rates_matrix(*state[2:5]) @ state[7:],
            truth=state,
            ended=ended,
        )


def checked_states(states: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return initial states as rows (lanes, 10).

    Raises
    ------
    InputError
        Where they are not rows of ten finite numbers with a lean of at most 1.2 rad.
    """
    rows = np.atleast_2d(np.array(states, dtype=np.float64))
    if rows.ndim != 2 or rows.shape[1] != 10:
        raise InputError(
            f"The initial state has the shape {np.shape(states)}; it must be ten numbers a robot."
        )
    if not np.isfinite(rows).all():
        raise InputError("The initial state holds a value that is not finite; all ten must be numbers.")
    lean = np.abs(rows[:, 2:4]).max(initial=0.0)
    if lean > LARGEST_LEAN:
        raise InputError(f"The initial lean is {lean:.3g} rad; the model holds up to {LARGEST_LEAN} rad.")
    return rows
