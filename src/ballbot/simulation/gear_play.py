"""The model with play in its gearboxes, as a plant: motors that cross a gap before they move their wheels.

Each motor (rotor and gearbox, j_r = n^2 (j_m + j_g) at the wheel) has a speed rho of its own, and stops half the play p
ahead of and behind its wheel, whose speed is omega = W nu:

    M_w nu_dot + bias_w = W^T (T - T_load) + rolling friction          M_w, bias_w without the rotors
    j_r rho_dot = u - tau(rho) - T                                     tau: the robot's driveline friction
    |delta| <= p/2,  delta_dot = rho - omega                           T > 0 only where delta = p/2, T < 0 at -p/2

As on the twin, encoder, motor and friction are on the motor's side, and the wheel has its own inertia alone. A motor
in the gap transmits nothing. At a stop the two go on at one speed: the momentum along the wheel is conserved, the
impact is without rebound. In contact the equations are those of the model.

A step of at most 0.5 ms has one implicit solution for the torques T, the set-valued friction of motors and floor and
the stops, found contact by contact (Gauss and Seidel's method; each contact is solved exactly), as in J. J. Moreau,
Unilateral contact and dry friction in finite freedom dynamics, 1988.

Neglected are rebound and compliance at the stops (an impact's torque lasts one or two steps; the twin's stops are
soft, which makes its torques rougher where friction is compensated), friction between the gear's teeth, and the rotors'
turning with the body, as in the model. Velocities are of first order in the step, where `ModelPlant` is of fourth
while nothing sticks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array
from ballbot.errors import InputError
from ballbot.mechanics.accelerations import solve
from ballbot.mechanics.contacts import finished, free_motion
from ballbot.mechanics.engine.arrays import box_rows, in_order, mass_matrix
from ballbot.mechanics.engine.compiled import called, compiled
from ballbot.mechanics.engine.lanes import LANES, ROWS, STATE, TORQUE, put_robot, stored
from ballbot.mechanics.engine.loading import load
from ballbot.mechanics.engine.run import load_state, start_lane, velocity_in, write_state
from ballbot.mechanics.engine.vector import each_with, element
from ballbot.mechanics.equations import LARGEST_LEAN, balancing_attitude
from ballbot.mechanics.friction import dry_friction, friction_shift
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import PLACES, RIGID_SIZE, WHEEL_SIZE, friction_places
from ballbot.mechanics.stick_slip import contact_rows, mobility
from ballbot.robot import Robot
from ballbot.robot.derived import reflected_rotor_inertia
from ballbot.simulation.model_plant import checked_states, lift_off, measurement, why_ended
from ballbot.simulation.plant import Measurement

#: longest step [s]; the twin's
_STEP = 5e-4
#: places of D1, D2 and D3 in a packed row; the rotors' inertia is a summand of each
_INERTIA_PLACES = [PLACES[name] for name in ("d1", "d2", "d3")]
_SWEEPS = 100
#: a sweep that changes no contact's speed by more than this is the last [rad/s, m/s]
_SETTLED = 1e-10


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
        return self._wheels.copy()

    @property
    def play_places(self) -> NDArray[np.float64]:
        """How far each motor is ahead of its wheel (n,), between plus and minus half the play [rad]."""
        return self._places.copy()

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
        self._speeds = self.model.wheel_speed(self._state[:5], self._state[5:])
        self._places = self.play * np.random.default_rng([seed, 7]).uniform(-0.5, 0.5, n)
        self._wheels = np.zeros(n)
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
        steps = max(self.model.steps_in(duration), math.ceil(duration / _STEP - 1e-9))
        self._state, motors = self._state.copy(), np.array([self._speeds, self._places, self._wheels])
        transmitted = np.zeros(n)
        run_with_play(
            self.model.selected,
            GearPlayNumbers(self._wheel_side, self.model.packed, self._inertia, self.play),
            self._state,
            motors,
            torques,
            loads,
            duration / steps,
            steps,
            transmitted,
        )
        self._speeds, self._places, self._wheels = motors
        self._transmitted = transmitted
        self._t = round(self._t + duration, 9)
        acting = transmitted - loads
        return self._measure(
            why_ended(self.model.selected, self._wheel_side, self._state, acting, self._lift_off, self._t)
        )

    def _measure(self, ended: str | None) -> Measurement:
        return measurement(self._t, self._state, self._wheels + self._places, self._speeds, ended)


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


#: rows of an array with a column for each motor: its momentum, its inertia with viscous friction, the momentum that
#: dry friction can take, the lowest and highest speed relative to its wheel, its speed
_MOMENTUM, _INERTIA, _DRY, _LOW, _HIGH, _SPEED, _MOTOR_ROWS = range(7)


class GearPlayNumbers(NamedTuple):
    """A robot whose gears have play, in compiled code."""

    wheel_side: NDArray[np.float64]  #: the packed robot without motors
    whole: NDArray[np.float64]  #: the packed robot with them
    inertia: float  #: j_r of a motor [kg m^2]
    play: float  #: [rad]


@compiled
def run_with_play(selected, robot, state, motors, torques, loads, h, steps, transmitted):
    """Advance a robot by `steps` steps of h [s]; state, motors and transmitted are overwritten.

    `robot` is a `GearPlayNumbers`, `state` (10,) or (11,) has the Euler angles' rates, and the rows of `motors` (3, n)
    are the motors' speeds, their places ahead of their wheels, and the wheels' angles. `transmitted` (n,) becomes the
    mean torque from each motor to its wheel.
    """
    n, inertia, play = len(torques), robot.inertia, robot.play
    work, friction = np.zeros(ROWS * LANES), np.zeros(ROWS * LANES)
    put_robot(work, 0, robot.wheel_side)
    put_robot(friction, 0, robot.whole)
    start_lane(selected, work, 0, state, h)
    for i in range(n):
        friction[(TORQUE + i) * LANES] = torques[i]
    P, drivelines = load(selected, work, 0), load(selected, friction, 0).wheels
    burden = np.empty(n)
    for i in range(n):
        burden[i] = -loads[i]
    burdens = each_with(element, selected.wheels, burden)
    motor, forces = np.empty((_MOTOR_ROWS, n)), np.zeros(n + 3)
    for _ in range(steps):
        x = load_state(selected, work, 0)
        if not (abs(x[2]) <= LARGEST_LEAN and abs(x[3]) <= LARGEST_LEAN):
            break
        a = balancing_attitude((x[2], x[3], x[4]))
        free = free_motion(selected, P, a, x, burdens)
        v_dot, w_dot = solve(free.system, free.f_v, free.f_w)
        start, nu = in_order(free.v, free.w), in_order(v_dot, w_dot)
        for j in range(len(nu)):
            nu[j] = start[j] + h * nu[j]
        rows = contact_rows(box_rows(selected, P, a))
        Y, G = mobility(mass_matrix(free.system), rows)
        before, speeds = _speeds(rows, start), _speeds(rows, nu)
        _load_motors(drivelines, inertia, play, motors, torques, h, motor)
        _settle(G, speeds, motor, P.rolling_force, P.pivoting, h, forces)
        for i in range(len(rows)):
            for j in range(len(nu)):
                nu[j] += h * Y[i, j] * forces[i]
        for i in range(n):
            ahead = motors[1, i] + h * (motor[_SPEED, i] - speeds[i])
            motors[0, i] = motor[_SPEED, i]
            motors[1, i] = min(max(ahead, -0.5 * play), 0.5 * play)
            motors[2, i] += 0.5 * h * (before[i] + speeds[i])
            transmitted[i] += forces[i] / steps
        end = finished(selected, x, a, velocity_in(free.v, nu), (nu[2], nu[3], nu[4]), h)
        stored(work, STATE, 0, end)
    write_state(selected, work, 0, state)


@called
def _load_motors(drivelines, inertia, play, motors, torques, h, motor):
    """Fill all rows of `motor` but the speeds with the motors' state at a step's start."""
    for i, driveline in enumerate(drivelines):
        shift = friction_shift(driveline, motors[0, i])
        motor[_MOMENTUM, i] = inertia * motors[0, i] + h * (torques[i] - shift)
        motor[_INERTIA, i] = inertia + h * driveline.b
        motor[_DRY, i] = h * dry_friction(driveline, motors[0, i])
        motor[_LOW, i] = (-0.5 * play - motors[1, i]) / h
        motor[_HIGH, i] = (0.5 * play - motors[1, i]) / h


@called
def _speeds(rows, velocities):
    """Return the speeds at the contacts."""
    speeds = np.zeros(len(rows))
    for i in range(len(rows)):
        for j in range(len(velocities)):
            speeds[i] += rows[i, j] * velocities[j]
    return speeds


@called
def _settle(G, speeds, motor, rolling_force, pivoting, h, forces):
    """Find the forces at all contacts; `speeds` becomes those under them, and `motor` gets the motors' speeds.

    `forces` begins as a guess, the step's before.
    """
    count, n = len(G), motor.shape[1]
    for i in range(count):
        for j in range(count):
            speeds[i] += h * G[i, j] * forces[j]
    x, y = count - 2, count - 1
    stiffest = max(G[x, x], G[y, y]) + abs(G[x, y])
    for _ in range(_SWEEPS):
        moved = 0.0
        for i in range(n):
            without = speeds[i] - h * G[i, i] * forces[i]
            force, motor[_SPEED, i] = _through_play(without, G[i, i], motor[:, i], h)
            moved = max(moved, _change(G, speeds, forces, i, force - forces[i], h))
        for i in range(n, count - 2):  # pivoting
            force = forces[i] - speeds[i] / (h * G[i, i])
            force = min(max(force, -pivoting), pivoting)
            moved = max(moved, _change(G, speeds, forces, i, force - forces[i], h))
        if rolling_force > 0.0:
            p, q = forces[x] - speeds[x] / (h * stiffest), forces[y] - speeds[y] / (h * stiffest)
            share = min(1.0, rolling_force / max(math.hypot(p, q), 1e-300))
            p, q = share * p - forces[x], share * q - forces[y]
            moved = max(moved, _change(G, speeds, forces, x, p, h))
            moved = max(moved, _change(G, speeds, forces, y, q, h))
        if not moved > _SETTLED:
            break


@called
def _change(G, speeds, forces, place, by, h):
    """Change one contact's force and the speeds with it; return by how much its own speed changes."""
    forces[place] += by
    for i in range(len(speeds)):
        speeds[i] += h * G[i, place] * by
    return abs(h * G[place, place] * by)


@called
def _through_play(wheel, mobility, motor, h):
    """Return the torque from a motor to its wheel, which would turn at speed `wheel` without it, and the motor's speed.

    In contact at the stop with relative speed c: m rho = N - h T + friction and rho = wheel + h mobility T + c.
    """
    momentum, inertia, dry = motor[_MOMENTUM], motor[_INERTIA], motor[_DRY]
    speed = _braked(momentum, dry) / inertia
    relative = min(max(speed - wheel, motor[_LOW]), motor[_HIGH])
    if relative == speed - wheel:
        return 0.0, speed
    inverse = 1.0 / mobility
    speed = _braked(momentum + (relative + wheel) * inverse, dry) / (inertia + inverse)
    return (speed - relative - wheel) * inverse / h, speed


@called
def _braked(momentum, dry):
    """Return a momentum less the part that dry friction takes."""
    return math.copysign(max(abs(momentum) - dry, 0.0), momentum)
