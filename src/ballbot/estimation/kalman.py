"""The on-board state by a Kalman filter: IMU, encoders and, where there is one, a fix from outside.

Unlike `OnboardState` it knows that a ball that does not pivot turns under the wheels as the body turns over it, so that
encoders hold the heading and show the gyro's bias about the vertical; that the angular momentum about the floor's
contact changes by gravity and rolling friction alone, which gives speed from lean and lean from speed whatever the
driveline does; and how sure it is of each state, so that a fix corrects each by as much as it should.

Missing values (NaN) are predicted: the gyro stays as it was, encoders or attitude do not correct that sample.
Without a fix, position and heading stay relative to the start, and their covariance grows until they are unknown by
0.2 m or 0.2 rad. `ballbot.estimation.kalman_model` has the states and equations.
"""

import math

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.estimation.heading import Heading
from ballbot.estimation.interface import Fix, Reading, checked_reading, known
from ballbot.estimation.kalman_front import FILTER_MEMORY, FILTER_MEMORY_TYPE, see, show
from ballbot.estimation.kalman_model import (
    BIAS,
    DIRECT,
    DRIFT,
    FIRST,
    LEAN_ERROR,
    PSI,
    ROWS,
    SENSORS,
    SHOWN,
    SHOWN_PSI,
    STATE,
    STATES,
    VARIANCES,
    FilterNoise,
    G,
    KalmanRecord,
    S,
    X,
    sample_block,
    sample_code,
    take_fix,
)
from ballbot.estimation.swing import fill_state
from ballbot.mechanics.engine.compiled import compiled
from ballbot.mechanics.engine.lanes import LANES
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.model import contact_momentum
from ballbot.records import packed
from ballbot.robot import Robot
from ballbot.robot.derived import encoder_step


@compiled
def _update(code, record, work, memory, ball_from_wheels, shown, state):
    kept = memory.view(FILTER_MEMORY_TYPE)[0]
    show(record, work, 0, kept, ball_from_wheels, shown)
    sample_block(code, work, 1)
    see(record, work, 0, kept, state)


class KalmanFilter:
    """An extended Kalman filter of 14 states, updated every `sample_time` [s] without look-ahead.

    Of the robot's friction only the ball's on the floor is used; its noise is `FilterNoise.of(robot)` by default.
    InputError if the sample time is not positive.
    """

    def __init__(self, robot: Robot, *, sample_time: float, noise: FilterNoise | None = None) -> None:
        if not (math.isfinite(sample_time) and sample_time > 0):
            raise InputError(f"The sample time of a Kalman filter must be above 0 s, not {sample_time}.")
        self.robot = robot
        self.sample_time = sample_time
        self.noise = noise if noise is not None else FilterNoise.of(robot)
        self._model = kalman_record(robot, sample_time=sample_time, noise=self.noise)
        # a block of one: its column is the first of each row
        self._work = np.zeros(ROWS * LANES)
        self._column = self._work[::LANES]
        self._x = self._column[STATE : STATE + STATES]
        self._memory = FILTER_MEMORY.zeros()
        self._given = (
            sample_code(),
            packed(self._model),
            self._work,
            self._memory.view(np.float64),
            np.ascontiguousarray(transforms(robot).T_obw),
        )
        self.reset()

    def reset(self, *, position: tuple[float, float] = (0.0, 0.0)) -> None:
        """Reset: the robot stands still at (x, y) [m], in the AHRS's heading, when the next reading comes."""
        self._memory[:], self._heading = FILTER_MEMORY.zeros(), Heading()
        self._memory["position"] = position

    def update(self, reading: Reading) -> Floats:
        """Take one sample and return the state (10,), all NaN until a reading is whole.

        Encoder angles, gyro and attitude are used, and what other `SENSORS` show. InputError if the reading is of
        another number of wheels.
        """
        shown, state = checked_reading(reading, self.robot.wheel_count, self._heading), np.empty(10)
        for sensor in DIRECT:
            self._show(sensor.name, np.ravel(getattr(reading, sensor.name)))
        _update(*self._given, shown, state)
        if reading.fix is not None and self._memory["started"][0]:
            self._take_fix(reading.fix)
            fill_state(self._model.lever, self._x, self._memory["gyro"][0], state)
        return state

    def _show(self, sensor: str, numbers: Floats) -> None:
        """Set the measured numbers of a sensor, NaN if missing."""
        first = SHOWN + FIRST[sensor]
        self._column[first : first + len(numbers)] = np.where(known(numbers), numbers, np.nan)

    def _take_fix(self, fix: Fix) -> None:
        position, heading = (np.nan if value is None else value for value in (fix.position, fix.heading))
        seen = np.append(np.broadcast_to(position, 2), heading)
        seen[2] = (
            self._x[PSI] + math.remainder(seen[2] - self._x[PSI], 2 * math.pi) if known(heading) else np.nan
        )
        self._show("fix", seen)
        first = VARIANCES + FIRST["fix"]
        deviations = (fix.position_deviation, fix.position_deviation, fix.heading_deviation)
        self._column[first : first + 3] = np.square(deviations)
        take_fix(self._work)


def kalman_record(robot: Robot, *, sample_time: float, noise: FilterNoise | None = None) -> KalmanRecord:
    """Return the numbers of a robot's filter; the noise is `FilterNoise.of(robot)` by default."""
    noise, h = noise if noise is not None else FilterNoise.of(robot), sample_time
    momentum, every_sample = contact_momentum(robot), SENSORS[:-1]
    walk, start = np.zeros((2, STATES))
    walk[S : S + 2] = noise.push**2 * h
    walk[BIAS : BIAS + 3] = noise.gyro_bias_walk**2 * h
    walk[SHOWN_PSI] = noise.heading_walk**2 * h
    walk[DRIFT] = noise.heading_drift_walk**2 * h
    walk[LEAN_ERROR : LEAN_ERROR + 2] = -(noise.lean_error**2) * math.expm1(-2.0 * h / noise.lean_error_time)
    # before the first reading: it sets the attitude, errors and all
    start[X : X + 2] = noise.start_position**2
    start[BIAS : BIAS + 3] = noise.gyro_bias**2
    start[BIAS + 2] = noise.heading_bias**2
    start[S : S + 2] = noise.start_speed**2
    start[LEAN_ERROR : LEAN_ERROR + 2] = noise.lean_error**2
    start[G : G + 2] = noise.attitude**2 + noise.lean_error**2
    start[PSI] = noise.attitude**2 + noise.start_heading**2
    start[SHOWN_PSI] = noise.attitude**2
    # of the bias about z, what the AHRS's heading integrates; none if that does not drift
    integrated = min(noise.heading_bias, noise.heading_drift) ** 2
    start[DRIFT] = noise.heading_drift**2 + integrated
    return KalmanRecord(
        sample_time=h,
        radius=robot.ball.radius,
        ball_turn=transforms(robot).T_obw * encoder_step(robot),
        lever=momentum.lever,
        pull=momentum.pull,
        rolling=momentum.rolling,
        forgotten=-math.expm1(-h / noise.lean_error_time),
        gyro_variance=noise.gyro**2,
        walk=walk,
        variances=np.concatenate([sensor.variances(noise, h) for sensor in every_sample]),
        start_variances=start,
        # g + a is known but for white noise: if one is too large the other is too small; so is psi_a, a part of it psi.
        # b_z is a part of r: were they independent, the filter would give the bias a part of the AHRS's other drift
        start_covariances=np.array(
            [-(noise.lean_error**2), -(noise.lean_error**2), noise.attitude**2, integrated]
        ),
        pivoting_share=min(1.0, h / noise.pivoting_time),
        pivoted_share=min(1.0, h / noise.pivoted_time),
        # of white noise, over that of its mean
        pivoting_variance=2.0 * noise.pivoting_time / h,
    )
