"""The model as a plant, with perfect sensors, and where it no longer holds: the floor would pull, or a wheel slips.

The centre of mass is at the height l cos(theta) cos(phi) above the ball's centre, so the floor pushes with

    (m_b + m_r) g + m_r l d^2/dt^2 (cos theta cos phi)

which falls to zero where the height's second derivative is -(m_b + m_r) g / (m_r l) (`lift_off`).

Forces at the wheels, and where they slip or lift: `ballbot.mechanics.traction`.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array
from ballbot.errors import InputError
from ballbot.mechanics.engine.arrays import angle_accelerations
from ballbot.mechanics.engine.compiled import compiled
from ballbot.mechanics.engine.lanes import LANES, ROWS, load_parameters, put_robot, under_torque
from ballbot.mechanics.engine.run import load_state, simulate_one, start_lane
from ballbot.mechanics.engine.smooth import acceleration, ball_velocity, body_velocity, net_torques, pose
from ballbot.mechanics.engine.tracing import greatest, least, traced, where
from ballbot.mechanics.engine.vector import each, from_array
from ballbot.mechanics.equations import LARGEST_LEAN, rates_of_angles
from ballbot.mechanics.floor import floor_friction
from ballbot.mechanics.friction import directed_friction, sign
from ballbot.mechanics.geometry import body_rates_matrix
from ballbot.mechanics.model import Model
from ballbot.mechanics.traction import forces_at_contacts
from ballbot.robot import Robot
from ballbot.simulation.plant import Measurement


def lift_off(robot: Robot) -> float:
    """Return -d^2/dt^2 (cos theta cos phi) [1/s^2] at which the floor no longer pushes."""
    body = robot.body
    return robot.weight / (body.mass * body.center_of_mass)


@traced
def moving(selected, P, state, u):
    """Return attitude, wheel speeds, v, w, net torques and accelerations; a wheel at rest has no dry friction."""
    a, speeds = pose(selected, P, state)
    v, w = ball_velocity(state), body_velocity(state)
    signs = each(sign, speeds)
    dry = each(directed_friction, P.wheels, speeds, signs)
    net = net_torques(P, u, speeds, signs, dry)
    return a, speeds, v, w, net, *acceleration(selected, P, a, v, w, net, floor_friction(P, v))


@traced
def sinking_with_speeds(selected, P, state, u):
    """Return -d^2/dt^2 (cos theta cos phi) [1/s^2] under wheel torques u and friction, and the wheels' speeds [rad/s].

    `state` has the formulation's body rates; a wheel at rest counts as one without dry friction.
    """
    a, speeds, _, w, _, _, w_dot = moving(selected, P, state, u)
    rates = rates_of_angles(selected, a, w)
    theta, phi = rates[0], rates[1]
    accelerations = angle_accelerations(selected, a, rates, w_dot)
    st, ct, sp, cp = a.sin_theta, a.cos_theta, a.sin_phi, a.cos_phi
    centripetal = ct * cp * (theta * theta + phi * phi) - 2.0 * st * sp * theta * phi
    return centripetal + st * cp * accelerations[0] + ct * sp * accelerations[1], speeds


@compiled
def sinking_and_speeds(selected, row, state, u):
    """Return `sinking_with_speeds` of one packed robot, under wheel torques u (n,).

    `state` is (10,), or (11,) with the spin where the ball pivots; its rates are the Euler angles'.
    """
    work = np.zeros(ROWS * LANES)
    put_robot(work, 0, row)
    start_lane(selected, work, 0, state, 0.0)
    moving, torques = load_state(selected, work, 0), from_array(selected.wheels, u)
    P = under_torque(load_parameters(selected, work, 0), torques)
    return sinking_with_speeds(selected, P, moving, torques)


_LIFTED = 1e9  # the friction needed where nothing presses


@traced
def wheel_forces(selected, P, state, u, row):
    """Return each wheel's f_i r_w [N m] and N_i [N] under wheel torques u, by the `row` of `pack_contacts`.

    `state` has the formulation's body rates; a wheel at rest counts as one without dry friction.
    """
    a, _, _, w, net, v_dot, w_dot = moving(selected, P, state, u)
    return forces_at_contacts(P, a, w, (v_dot, w_dot), net, row)[:2]


@traced
def friction_needed(selected, P, state, u, row):
    """Return the largest |f_i| / N_i under wheel torques u, of a robot with the `row` of `pack_contacts`."""
    pushes, pressing = wheel_forces(selected, P, state, u, row)
    largest = 0.0
    for push, pressed in zip(pushes, pressing, strict=True):
        share = where(pressed > 0.0, abs(push) * row[1] / pressed, _LIFTED)
        largest = greatest(largest, least(share, _LIFTED))
    return largest


@compiled
def friction_needed_along(selected, parameters, contacts, states, torques, out):
    """Fill `out` (N,) with the friction needed at states (N, 10), of Euler angles' rates, under torques (N, n)."""
    work = np.zeros(ROWS * LANES)
    put_robot(work, 0, parameters)
    bare = load_parameters(selected, work, 0)
    for k in range(len(states)):
        start_lane(selected, work, 0, states[k], 0.0)
        u = from_array(selected.wheels, torques[k])
        P = under_torque(bare, u)
        out[k] = friction_needed(selected, P, load_state(selected, work, 0), u, contacts)


#: why a run on the model ends that does not fall
LIFTED = "lifted: the floor would have to pull"


def fallen_words(limit: float) -> str:
    """Return why a run ends past a lean [rad]."""
    return f"fallen: lean past {limit:g} rad"


class ModelPlant:
    """A `Model` behind the plant's seam. Its measurements are the true state.

    A run ends where theta or phi passes 1.2 rad, or where, at the end of a sample, the floor would have to pull
    the robot down. Wheel angles are the integral of the formulation's wheel speeds (trapezoids over samples).

    If the model's ball pivots, its spin is carried along: it starts at zero, no measurement shows it but the
    wheels', and state and truth stay the ten numbers.
    """

    def __init__(self, model: Model) -> None:
        #: may be replaced between samples by one whose robot differs in its friction only
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

    def reset(self, initial_state: ArrayLike | None = None, *, seed: int = 0) -> Measurement:  # noqa: ARG002
        """Start at t = 0 from a state (10,), or upright at rest at the origin; nothing here is random.

        InputError if the state is not ten finite numbers with a lean of at most 1.2 rad.
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

        InputError if they are not n finite numbers, or the duration is not above zero.
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
        # whole nanoseconds: a sum would drift past a reference's corners
        self._t = round(self._t + duration, 9)
        sinking, speeds = sinking_and_speeds(model.selected, model.packed, self._state, torques)
        self._wheel_speeds = np.array(speeds)
        self._wheel_angles = self._wheel_angles + 0.5 * duration * (before + self._wheel_speeds)
        if not np.abs(self._state[2:4]).max() <= LARGEST_LEAN:
            return self._measure(f"{fallen_words(LARGEST_LEAN)} at t = {self._t:.3f} s")
        if not sinking < self._lift_off:
            return self._measure(f"{LIFTED} at t = {self._t:.3f} s")
        return self._measure(None)

    def push(self, impulse: ArrayLike) -> None:
        """Change the velocities at once by an impulse p (5,) of x, y [N s], theta, phi, psi [N m s]: M(q) dq_dot = p.

        A force that lasts is an impulse before each sample, exact to first order in the sample time. InputError if it
        is not five finite numbers.
        """
        p = real_array(impulse, (5,), "The impulse")
        padded = np.concatenate((p, np.zeros(self.model.velocity_count - 5)))
        self._state[5:] += np.linalg.solve(self.model.mass_matrix(self._state[:5]), padded)
        self._wheel_speeds = self._speeds()

    def _speeds(self) -> NDArray[np.float64]:
        return self.model.wheel_speed(self._state[:5], self._state[5:])

    def _measure(self, ended: str | None) -> Measurement:
        seen = self._state[:10].copy()
        return Measurement(
            t=self._t,
            state=seen,
            wheel_angles=self._wheel_angles,
            wheel_speeds=self._wheel_speeds,
            gyro=body_rates_matrix(*seen[2:5]) @ seen[7:],
            truth=seen,
            ended=ended,
        )


def checked_states(states: ArrayLike) -> NDArray[np.float64]:
    """Return a copy of initial states (10,) or (lanes, 10) as rows (lanes, 10).

    InputError if they are not rows of ten finite numbers with a lean of at most 1.2 rad.
    """
    given = real_array(states, ("...", 10), "The initial state")
    if given.ndim > 2 or given.size == 0:
        raise InputError(f"The initial state has the shape {given.shape}; it must be ten numbers a robot.")
    rows = np.array(given, ndmin=2)
    lean = np.abs(rows[:, 2:4]).max(initial=0.0)
    if lean > LARGEST_LEAN:
        raise InputError(f"The initial lean is {lean:.3g} rad; the model holds up to {LARGEST_LEAN} rad.")
    return rows
