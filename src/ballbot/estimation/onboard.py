"""The on-board state, the thesis's way (Appendices I and V): an AHRS and wheel encoders, nothing else.

    z = T_obw wheel_speed + w      ball's angular velocity, body frame (wheels see z - w) [rad/s]
    Omega = R z                    the same, world frame
    v = r_b (Omega_y, -Omega_x)    velocity of a ball that rolls without slip, world frame [m/s]
    Phi_dot = B^-1 w               rates of theta, phi, psi [rad/s]
    x, y                           the sum of v from the start: an error here is never corrected [m]

It cannot measure slip, the play between encoder and wheel, or the drift of its own heading. A value that is missing
(NaN, or beyond any sensor) is predicted: the gyro's and v stay as they were, theta, phi and psi go on at their last
rates. The firmware's C is written from this file (`tests.support.firmware_law`).
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.estimation.heading import Heading
from ballbot.estimation.interface import Reading, checked_reading
from ballbot.estimation.known import are_known, is_known, not_a_number
from ballbot.mechanics.engine.compensated_sum import add_to
from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.mechanics.engine.elementary import sine_cosine
from ballbot.mechanics.geometry import transforms
from ballbot.records import MAX_WHEELS, number, packed, schema_of, whole
from ballbot.robot import Robot


@dataclass(frozen=True, kw_only=True, eq=False)
class OnboardRecord:
    """The numbers of the on-board state, the thesis's way."""

    sample_time: float = field(metadata=number("s"))
    radius: float = field(metadata=number("m"))  #: of the ball
    ball_from_wheels: Floats = field(metadata=number("1", 3, MAX_WHEELS))  #: T_obw


@dataclass(frozen=True, kw_only=True, eq=False)
class OnboardMemory:
    """What the on-board state remembers."""

    started: int = field(metadata=whole())
    position: Floats = field(metadata=number("m", 2))
    position_rest: Floats = field(metadata=number("m", 2))  #: what rounding has taken from it
    velocity: Floats = field(metadata=number("m/s", 2))
    gyro: Floats = field(metadata=number("rad/s", 3))
    attitude: Floats = field(metadata=number("rad", 3))


ONBOARD, ONBOARD_MEMORY = schema_of(OnboardRecord), schema_of(OnboardMemory)
ONBOARD_TYPE, ONBOARD_MEMORY_TYPE = ONBOARD.dtype(), ONBOARD_MEMORY.dtype()


def onboard_record(robot: Robot, *, sample_time: float) -> OnboardRecord:
    """Return the numbers of the on-board state for a robot."""
    return OnboardRecord(
        sample_time=sample_time, radius=robot.ball.radius, ball_from_wheels=transforms(robot).T_obw
    )


class _Turns(NamedTuple):
    """Sines and cosines of theta, phi and psi."""

    s1: float
    c1: float
    s2: float
    c2: float
    s3: float
    c3: float


class AngularVelocity(NamedTuple):
    """An angular velocity."""

    x: float  # [rad/s]
    y: float  # [rad/s]
    z: float  # [rad/s]


@inlined
def _turns_of(angles):
    """Return sines and cosines of theta, phi, psi [rad]."""
    s1, c1 = sine_cosine(angles[0])
    s2, c2 = sine_cosine(angles[1])
    s3, c3 = sine_cosine(angles[2])
    return _Turns(s1, c1, s2, c2, s3, c3)


@inlined
def _fill_rates(a, w, state):
    """Fill the state's rates, Phi_dot = B^-1 w of the body's angular velocity w [rad/s] in its own frame."""
    state[7] = (a.c3 * w[0] - a.s3 * w[1]) / a.c2
    state[8] = a.s3 * w[0] + a.c3 * w[1]
    state[9] = w[2] - a.s2 * state[7]


@inlined
def ball_rate(ball_from_wheels, wheel_count, speeds):
    """Return the ball's angular velocity relative to the body, in its frame [rad/s]."""
    x = 0.0
    y = 0.0
    z = 0.0
    for i in range(wheel_count):
        x += ball_from_wheels[0, i] * speeds[i]
        y += ball_from_wheels[1, i] * speeds[i]
        z += ball_from_wheels[2, i] * speeds[i]
    return AngularVelocity(x, y, z)


@inlined
def _ball_turning(a, relative, gyro):
    """Return Omega [rad/s], world frame, of a ball with this angular velocity relative to the body."""
    z_x, z_y, z_z = relative.x + gyro[0], relative.y + gyro[1], relative.z + gyro[2]
    # R = Rx(theta) Ry(phi) Rz(psi); first Rz z, then Ry, then Rx
    forward = a.c3 * z_x - a.s3 * z_y
    left = a.s3 * z_x + a.c3 * z_y
    up = a.c2 * z_z - a.s2 * forward
    return AngularVelocity(a.c2 * forward + a.s2 * z_z, a.c1 * left - a.s1 * up, a.s1 * left + a.c1 * up)


@inlined
def _remember(record, memory, reading, state):
    """Remember gyro and attitude; what they lack is predicted."""
    if not are_known(reading.attitude, 3):
        before = _turns_of(memory.attitude)
        _fill_rates(before, memory.gyro, state)
        for k in range(3):
            memory.attitude[k] += record.sample_time * state[7 + k]
    for k in range(3):
        if is_known(reading.attitude[k]):
            memory.attitude[k] = reading.attitude[k]
        if is_known(reading.gyro[k]):
            memory.gyro[k] = reading.gyro[k]


@inlined
def onboard_reset(memory, position):
    """Forget the past; the robot stands at a position x, y [m], world frame."""
    memory.started = 0
    for k in range(2):
        memory.position[k] = position[k]
        memory.position_rest[k] = 0.0


@inlined
def onboard_update(record, memory, wheel_count, reading, state):
    """Take one sample and fill the state: x, y [m], theta, phi, psi [rad] and their rates, world frame.

    All are NaN until a reading is whole. Return 1 if it is whole, 0 if something in it is predicted or missing.
    """
    rolls = are_known(reading.wheel_speeds, wheel_count)
    complete = rolls and are_known(reading.gyro, 3) and are_known(reading.attitude, 3)
    if memory.started == 0 and not complete:
        for k in range(10):
            state[k] = not_a_number()
        return 0
    _remember(record, memory, reading, state)
    a = _turns_of(memory.attitude)
    state[5], state[6] = memory.velocity[0], memory.velocity[1]
    if rolls:
        relative = ball_rate(record.ball_from_wheels, wheel_count, reading.wheel_speeds)
        omega = _ball_turning(a, relative, memory.gyro)
        state[5], state[6] = record.radius * omega.y, -record.radius * omega.x
    for k in range(2):
        if memory.started == 1:
            # trapezoid between this sample and the one before
            passed = 0.5 * record.sample_time * (state[5 + k] + memory.velocity[k])
            add_to(memory.position, memory.position_rest, k, passed)
        memory.velocity[k], state[k] = state[5 + k], memory.position[k]
    for k in range(3):
        state[2 + k] = memory.attitude[k]
    _fill_rates(a, memory.gyro, state)
    memory.started = 1
    return 1 if complete else 0


@compiled
def _update(record, memory, shown, state):
    numbers, kept = record.view(ONBOARD_TYPE)[0], memory.view(ONBOARD_MEMORY_TYPE)[0]
    onboard_update(numbers, kept, len(shown.wheel_speeds), shown, state)


class OnboardState:
    """The ten states from wheel speeds, gyro and attitude, updated every `sample_time` [s] without look-ahead.

    InputError if the sample time is not positive.

    >>> estimator = OnboardState(Robot.load("alten"), sample_time=0.005)
    >>> zero = np.zeros(3)
    >>> turning = Reading(wheel_angles=zero, wheel_speeds=zero, gyro=np.array([0.2, 0.0, 0.0]), attitude=zero)
    >>> estimator.update(turning)[7].item()  # theta_dot
    0.2
    """

    def __init__(self, robot: Robot, *, sample_time: float) -> None:
        if not sample_time > 0:
            raise InputError(f"The sample time of an on-board state must be above 0 s, not {sample_time}.")
        self.robot = robot
        self.sample_time = sample_time
        self._record = packed(onboard_record(robot, sample_time=sample_time))
        self.reset()

    def reset(self, *, position: tuple[float, float] = (0.0, 0.0)) -> None:
        """Reset to the position (x, y) [m]."""
        memory = ONBOARD_MEMORY.zeros()
        memory["position"] = position
        self._memory, self._heading = memory.view(np.float64), Heading()

    def update(self, reading: Reading) -> Floats:
        """Take one sample and return the state (10,), all NaN until a reading is complete.

        Wheel speeds, gyro and attitude are used, and no fix. InputError if the reading has the wrong number of wheels.
        """
        shown, state = checked_reading(reading, self.robot.wheel_count, self._heading), np.empty(10)
        _update(self._record, self._memory, shown, state)
        return state
