"""The model as a plant: the equations of motion with perfect sensors."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array
from ballbot.errors import InputError
from ballbot.mechanics.engine import simulate_one
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.mechanics.geometry import body_rates_matrix
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import Exact, Pivoting, Thesis
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

    def reset(self, initial_state: ArrayLike | None = None, *, seed: int = 0) -> Measurement:  # noqa: ARG002
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

    def step(self, torques: ArrayLike, duration: float) -> Measurement:
        """Hold the torques (n,) [N m] for a duration [s] and return the measurement at its end.

        Raises
        ------
        InputError
            If they are not n finite numbers, or the duration is not above zero.
        """
        torques = real_array(torques, (self.robot.wheel_count,), "The array of torques")
        duration = positive_number(duration, "The duration")
        model, before = self.model, self._wheel_speeds
        self._state = simulate_one(
            model.selected,
            model.packed,
            self._state,
            torques,
            sample_time=duration,
            steps=model.steps_in(duration),
        )
        self._t = round(
            self._t + duration, 9
        )  # whole nanoseconds: a sum would drift past a reference's corners
        self._wheel_speeds = self._speeds()
        self._wheel_angles = self._wheel_angles + 0.5 * duration * (before + self._wheel_speeds)
        model = self.model
        ended = why_ended(model.selected, model.packed, self._state, torques, self._lift_off, self._t)
        return self._measure(ended)

    def _speeds(self) -> NDArray[np.float64]:
        if not np.isfinite(self._state).all():  # torques too large for numbers; the run ends
            return np.full(self.robot.wheel_count, np.nan)
        return self.model.wheel_speed(self._state[:5], self._state[5:])

    def _measure(self, ended: str | None) -> Measurement:
        return measurement(self._t, self._state, self._wheel_angles, self._wheel_speeds, ended)


def why_ended(
    selected: Exact | Thesis | Pivoting,
    row: NDArray[np.float64],
    state: NDArray[np.float64],
    torques: NDArray[np.float64],
    limit: float,
    t: float,
) -> str | None:
    """Return why a run of a packed robot ends at time t [s], or None.

    Parameters
    ----------
    selected, row
        What selects the equations, and the robot's numbers for them (`Model.selected`, `Model.packed`).
    state : ndarray (10,) or (11,)
    torques : ndarray (n,)
        [N m].
    limit : float
        Of the robot's floor (`lift_off`) [1/s^2].
    """
    if not np.abs(state[2:4]).max() <= LARGEST_LEAN:
        return f"{FALLEN} at t = {t:.3f} s"
    if not sinking_of(selected, row, state, torques) < limit:
        return f"{LIFTED} at t = {t:.3f} s"
    return None


def measurement(
    t: float,
    state: NDArray[np.float64],
    wheel_angles: NDArray[np.float64],
    wheel_speeds: NDArray[np.float64],
    ended: str | None,
) -> Measurement:
    """Return the measurement of perfect sensors: what is measured of a state (10,) or (11,) is what is true."""
    seen = state[:10].copy()
    return Measurement(
        t=t,
        state=seen,
        wheel_angles=wheel_angles,
        wheel_speeds=wheel_speeds,
        gyro=body_rates_matrix(*seen[2:5]) @ seen[7:],
        truth=seen,
        ended=ended,
    )


def checked_states(states: ArrayLike) -> NDArray[np.float64]:
    """Return a copy of initial states (10,) or (lanes, 10) as rows (lanes, 10).

    Raises
    ------
    InputError
        Where they are not rows of ten finite numbers with a lean of at most 1.2 rad.
    """
    given = real_array(states, ("...", 10), "The initial state")
    if given.ndim > 2 or given.size == 0:
        raise InputError(f"The initial state has the shape {given.shape}; it must be ten numbers a robot.")
    rows = np.array(given, ndmin=2)
    lean = np.abs(rows[:, 2:4]).max(initial=0.0)
    if lean > LARGEST_LEAN:
        raise InputError(f"The initial lean is {lean:.3g} rad; the model holds up to {LARGEST_LEAN} rad.")
    return rows
