"""A `Model` whose gearboxes have play, as a plant; `ballbot.mechanics.engine.play` has the equations and the step.

As on the twin, encoder, motor and friction are on the motor's side, and the wheel has its own inertia alone.

Neglected are rebound and compliance at the stops (an impact's torque lasts one or two steps; the twin's stops are
soft, which makes its torques rougher where friction is compensated), friction between the gear's teeth, and the rotors'
turning with the body, as in the model. Velocities are of first order in the step, where `ModelPlant` is of fourth
while nothing sticks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import compiled
from ballbot.mechanics.engine.lanes import (
    AHEAD,
    ANGLE,
    LANES,
    LOAD,
    MOTOR,
    PASSED,
    PLAY,
    ROTOR,
    ROWS,
    STEP,
    TORQUE,
    put_robot,
)
from ballbot.mechanics.engine.play import play_block
from ballbot.mechanics.engine.run import start_lane, write_state
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import PLACES, RIGID_SIZE, WHEEL_SIZE, friction_places
from ballbot.robot import Robot
from ballbot.robot.derived import reflected_rotor_inertia
from ballbot.simulation.model_plant import checked_states, lift_off, measurement, why_ended
from ballbot.simulation.plant import Measurement

#: places of D1, D2 and D3 in a packed row; the rotors' inertia is a summand of each
_INERTIA_PLACES = [PLACES[name] for name in ("d1", "d2", "d3")]


class GearPlayPlant:
    """A `Model` whose gearboxes have play, behind the plant's seam. Its measurements are the true state.

    Wheel angles and speeds are the motors', which the encoders see. A run ends as `ModelPlant`'s does.

    Parameters
    ----------
    model : Model
        Of the exact formulation.
    play : float
        At the wheel, from stop to stop [rad].

    Raises
    ------
    InputError
        If the play is not above zero, the formulation is not "exact", or the motors have no inertia.
    """

    def __init__(self, model: Model, play: float) -> None:
        self.model = model
        self.play = positive_number(play, "The play")
        if model.formulation != "exact":
            raise InputError("Play needs the formulation 'exact'; the thesis's equations have no rotors.")
        self._inertia = _rotor_inertia(model.robot)
        if not self._inertia > 0.0:
            raise InputError(
                f"The motors and gears of {model.robot.name!r} have no inertia, so nothing limits their speed within "
                "the play; give drive.motor_inertia or drive.gear_inertia."
            )
        self._wheel_side = _row_without_motors(model)
        self._lift_off = lift_off(model.robot)
        self.reset()

    @property
    def robot(self) -> Robot:
        """The model's robot."""
        return self.model.robot

    @property
    def wheel_angles(self) -> NDArray[np.float64]:
        """Angles (n,) of the wheels themselves, beyond the play, zero at the reset [rad]."""
        return self._rows(ANGLE)

    @property
    def play_places(self) -> NDArray[np.float64]:
        """How far each motor is ahead of its wheel (n,), between plus and minus half the play [rad]."""
        return self._rows(AHEAD)

    @property
    def transmitted(self) -> NDArray[np.float64]:
        """Mean torques (n,) from motors to wheels over the last step [N m]."""
        return self._transmitted.copy()

    def reset(self, initial_state: ArrayLike | None = None, *, seed: int = 0) -> Measurement:
        """Start at t = 0 from a state (10,), or upright at rest at the origin.

        A motor is anywhere within its play, which follows from the seed, and has its wheel's speed.

        Raises
        ------
        InputError
            If the state is not ten finite numbers with a lean of at most 1.2 rad.
        """
        n = self.robot.wheel_count
        self._state = np.zeros(5 + self.model.velocity_count)
        if initial_state is not None:
            self._state[:10] = checked_states(initial_state)[0]
        self._t = 0.0
        speeds = self.model.wheel_speed(self._state[:5], self._state[5:])
        motors = np.array([speeds, places_in_play(self.play, n, seed), np.zeros(n)])
        self._work = np.zeros(ROWS * LANES)
        self._work[[ROTOR * LANES, PLAY * LANES]] = self._inertia, self.play
        start_with_play(self.model.selected, self._work, self.model.packed, self._state, motors)
        self._transmitted = np.zeros(n)
        return self._measure(None)

    def step(
        self, torques: ArrayLike, duration: float, *, wheel_load: ArrayLike | None = None
    ) -> Measurement:
        """Hold the motors' torques (n,) [N m] for a duration [s] and return the measurement at its end.

        Parameters
        ----------
        torques : array_like (n,)
        duration : float
        wheel_load : array_like (n,), optional
            Torques that load the wheels themselves, T_load [N m].

        Raises
        ------
        InputError
            If torques or loads are not n finite numbers, or the duration is not above zero.
        """
        n = self.robot.wheel_count
        torques = real_array(torques, (n,), "The array of torques")
        loads = (
            np.zeros(n) if wheel_load is None else real_array(wheel_load, (n,), "The array of wheel loads")
        )
        duration = positive_number(duration, "The duration")
        steps = self.model.steps_in(duration)
        self._state = self._state.copy()
        run_with_play(
            self.model.selected,
            self._work,
            torques,
            loads,
            duration / steps,
            steps,
            self._state,
            self._transmitted,
        )
        self._t = round(self._t + duration, 9)
        acting = self._transmitted - loads
        return self._measure(
            why_ended(self.model.selected, self._wheel_side, self._state, acting, self._lift_off, self._t)
        )

    def _measure(self, ended: str | None) -> Measurement:
        return measurement(
            self._t, self._state, self._rows(ANGLE) + self._rows(AHEAD), self._rows(MOTOR), ended
        )

    def _rows(self, first: np.int64) -> NDArray[np.float64]:
        """Return a number of each wheel (n,) from the work array."""
        return self._work[first * LANES : (first + self.robot.wheel_count) * LANES : LANES].copy()


def places_in_play(play: float, wheel_count: int, seed: int) -> NDArray[np.float64]:
    """Return how far each motor (n,) is ahead of its wheel at the start of a run of that seed [rad]."""
    return play * np.random.default_rng([seed, 7]).uniform(-0.5, 0.5, wheel_count)


def _rotor_inertia(robot: Robot) -> float:
    drive = robot.drive
    return reflected_rotor_inertia(
        gear_ratio=drive.gear_ratio, motor_inertia=drive.motor_inertia, gear_inertia=drive.gear_inertia
    )


def _row_without_motors(model: Model) -> NDArray[np.float64]:
    """Return the packed robot without its rotors and their friction, which are on the motor's side of the play."""
    row, n = model.packed.copy(), model.robot.wheel_count
    row[_INERTIA_PLACES] -= _rotor_inertia(model.robot)
    row[friction_places(n)[: 3 * n]] = 0.0
    row[RIGID_SIZE + WHEEL_SIZE * n :] = 0.0
    return row


@compiled
def start_with_play(selected, work, row, state, motors):
    """Put a packed robot into the first lane of a block's work array.

    `state` (10,) or (11,) has the Euler angles' rates, and the rows of `motors` (3, n) are the motors' speeds, their
    places ahead of their wheels, and the wheels' angles.
    """
    put_robot(work, 0, row)
    start_lane(selected, work, 0, state, 0.0)
    for i in range(motors.shape[1]):
        work[(MOTOR + i) * LANES], work[(AHEAD + i) * LANES] = motors[0, i], motors[1, i]
        work[(ANGLE + i) * LANES] = motors[2, i]


@compiled
def run_with_play(selected, work, torques, loads, h, steps, state, transmitted):
    """Advance the robot in the first lane by `steps` steps of h [s]; its state goes to `state`.

    `transmitted` (n,) becomes the mean torque from each motor to its wheel.
    """
    work[STEP * LANES] = h
    for i in range(len(torques)):
        work[(TORQUE + i) * LANES], work[(LOAD + i) * LANES] = torques[i], loads[i]
        transmitted[i] = 0.0
    for _ in range(steps):
        play_block(selected, work, 1)
        for i in range(len(torques)):
            transmitted[i] += work[(PASSED + i) * LANES] / steps
    write_state(selected, work, 0, state)
