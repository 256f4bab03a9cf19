"""The on-board state by a Kalman filter: IMU, encoders and, where there is one, a fix from outside.

Unlike `OnboardState` it knows that a ball that does not pivot turns under the wheels as the body turns over it, so that
encoders hold the heading and show the gyro's bias about the vertical; that the angular momentum about the floor's
contact changes by gravity alone, which gives speed from lean and lean from speed whatever the driveline does; and how
sure it is of each state, so that a fix corrects each by as much as it should.

Missing values (NaN) are predicted: the gyro stays as it was, encoders or attitude do not correct that sample.
Without a fix, position and heading stay relative to the start, and their covariance grows until they are unknown by
0.2 m or 0.2 rad. `ballbot.estimation.kalman_model` has the states and equations.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.estimation.heading import Heading
from ballbot.estimation.interface import Fix, Reading, all_known, checked_reading, known
from ballbot.estimation.kalman_model import (
    BIAS,
    COVARIANCE,
    DIRECT,
    DRIFT,
    FIRST,
    GYRO,
    GYRO_BEFORE,
    LEAN_ERROR,
    LOWER_TRIANGLE,
    MODEL_SIZE,
    NUMBERS,
    PIVOTING,
    PIVOTS,
    PSI,
    ROWS,
    SENSORS,
    SHOWN,
    SHOWN_PSI,
    SHOWN_TOGETHER,
    STATE,
    STATES,
    VARIANCES,
    FilterModel,
    FilterNoise,
    G,
    S,
    X,
    sample,
    take_fix,
)
from ballbot.estimation.swing import SwingTwist, begin_state, fill_state, swing
from ballbot.mechanics.engine.lanes import LANES
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.model import contact_momentum
from ballbot.robot import Robot

_NO_SWING = SwingTwist(math.nan, math.nan, math.nan)
#: where the work array has the covariance
_TRIANGLE = slice(COVARIANCE, COVARIANCE + len(LOWER_TRIANGLE[0]))


class KalmanFilter:
    """An extended Kalman filter of 14 states, updated every `sample_time` [s] without look-ahead.

    The robot's friction is not used; its noise is `FilterNoise.of(robot)` by default. InputError if the sample time is
    not positive.
    """

    def __init__(self, robot: Robot, *, sample_time: float, noise: FilterNoise | None = None) -> None:
        if not (math.isfinite(sample_time) and sample_time > 0):
            raise InputError(f"The sample time of a Kalman filter must be above 0 s, not {sample_time}.")
        self.robot = robot
        self.sample_time = sample_time
        self.noise = noise if noise is not None else FilterNoise.of(robot)
        self._ball_from_wheels = np.ascontiguousarray(transforms(robot).T_obw)
        self._model = filter_model(robot, sample_time=sample_time, noise=self.noise)
        # a block of one: its column is the first of each row
        self._work = np.zeros(ROWS * LANES)
        self._column = self._work[::LANES]
        self._column[:MODEL_SIZE] = self._model.row()
        self._x = self._column[STATE : STATE + STATES]
        self.reset()

    def reset(self, *, position: tuple[float, float] = (0.0, 0.0)) -> None:
        """Reset: the robot stands still at (x, y) [m], in the AHRS's heading, when the next reading comes."""
        self._x[:] = 0.0
        self._x[X : X + 2] = position
        self._shown = self._column[SHOWN : SHOWN + NUMBERS]
        self._shown[:] = np.nan
        self._column[_TRIANGLE] = first_covariance(self.noise)[LOWER_TRIANGLE]
        self._angles: Floats | None = None
        self._without_angles = 0  # samples since the encoders last had all angles
        self._gyro = np.zeros(3)
        self._pivoting = 0.0
        self._heading = Heading()

    def update(self, reading: Reading) -> Floats:
        """Take one sample and return the state (10,), all NaN until a reading is whole.

        Encoder angles, gyro and attitude are used, and what other `SENSORS` show. InputError if the reading is of
        another number of wheels.
        """
        angles, _, gyro, attitude = checked_reading(reading, self.robot.wheel_count)
        turned, leans, turns = all_known(angles), all_known(attitude), all_known(gyro)
        if self._angles is None and not (turned and leans and turns):
            return np.full(10, np.nan)
        gyro = gyro.copy() if turns else np.where(known(gyro), gyro, self._gyro)
        shown = _NO_SWING
        if leans:
            shown = swing(*attitude[:2].tolist(), self._heading.unwrapped(float(attitude[2])))
        if self._angles is None:
            begin_state(self._model.lever, shown, gyro, self._x)
        else:
            # the ball's mean turning relative to the body since the encoders last had all angles [rad/s]
            passed = self.sample_time * (1 + self._without_angles)
            ball_rate = (
                self._ball_from_wheels @ (angles - self._angles) / passed if turned else np.full(3, np.nan)
            )
            self._column[GYRO_BEFORE : GYRO_BEFORE + 3] = self._gyro
            self._column[GYRO : GYRO + 3] = gyro
            self._show("wheels", ball_rate)
            self._show("attitude", shown)
            for sensor in DIRECT:
                values = np.ravel(getattr(reading, sensor.name))
                self._show(sensor.name, np.where(known(values), values, np.nan))
            self._column[PIVOTS] = self.pivots
            sample(self._work)
            if turned:
                share = min(1.0, self.sample_time / self.noise.pivoting_time)
                self._pivoting += share * (float(self._column[PIVOTING]) - self._pivoting)
        self._without_angles = 0 if turned else self._without_angles + 1
        if turned:
            self._angles = angles.copy()
        self._gyro = gyro
        if reading.fix is not None:
            self._take_fix(reading.fix)
        return self._state()

    def _show(self, sensor: str, numbers: ArrayLike) -> None:
        """Set the measured numbers of a sensor, NaN if missing."""
        first = FIRST[sensor]
        self._shown[first : first + np.size(numbers)] = numbers

    @property
    def pivots(self) -> bool:
        """Whether the wheels have lately seen the ball turn on the spot; they then do not correct the heading."""
        return abs(self._pivoting) > self.noise.pivoting_limit

    @property
    def _P(self) -> Floats:
        """Covariance (14, 14) of the states."""
        P = np.zeros((STATES, STATES))
        P[LOWER_TRIANGLE] = self._column[_TRIANGLE]
        return P + np.tril(P, -1).T

    def _state(self) -> Floats:
        state = np.empty(10)
        fill_state(self._model.lever, self._x, self._gyro, state)
        return state

    def _take_fix(self, fix: Fix) -> None:
        position, heading = (np.nan if value is None else value for value in (fix.position, fix.heading))
        seen = np.append(np.broadcast_to(position, 2), heading)
        seen[~known(seen)] = np.nan
        seen[2] = self._x[PSI] + math.remainder(seen[2] - self._x[PSI], 2 * math.pi)
        self._show("fix", seen)
        first = VARIANCES + FIRST["fix"]
        deviations = (fix.position_deviation, fix.position_deviation, fix.heading_deviation)
        self._column[first : first + 3] = np.square(deviations)
        take_fix(self._work)


def filter_model(robot: Robot, *, sample_time: float, noise: FilterNoise) -> FilterModel:
    """Return a robot and its noise as compiled code reads them."""
    h = sample_time
    momentum = contact_momentum(robot)
    walk = np.zeros(STATES)
    walk[S : S + 2] = noise.push**2 * h
    walk[BIAS : BIAS + 3] = noise.gyro_bias_walk**2 * h
    walk[SHOWN_PSI] = noise.heading_walk**2 * h
    walk[DRIFT] = noise.heading_drift_walk**2 * h
    walk[LEAN_ERROR : LEAN_ERROR + 2] = -(noise.lean_error**2) * math.expm1(-2.0 * h / noise.lean_error_time)
    return FilterModel(
        sample_time=h,
        radius=robot.ball.radius,
        lever=np.ascontiguousarray(momentum.lever),
        pull=np.ascontiguousarray(momentum.pull),
        forgotten=-math.expm1(-h / noise.lean_error_time),
        gyro_variance=noise.gyro**2,
        walk=walk,
        variances=np.concatenate([sensor.variances(noise, h) for sensor in SENSORS]),
    )


def filter_row(robot: Robot, *, sample_time: float) -> Floats:
    """Return a robot's filter as the compiled loop reads it: model, lower triangle of P, and how pivoting is found."""
    noise = FilterNoise.of(robot)
    model = filter_model(robot, sample_time=sample_time, noise=noise)
    share = min(1.0, sample_time / noise.pivoting_time)
    return np.concatenate(
        [model.row(), first_covariance(noise)[LOWER_TRIANGLE], [share, noise.pivoting_limit]]
    )


def first_covariance(noise: FilterNoise) -> Floats:
    """Return P (14, 14) before the first reading: it sets the attitude, errors and all."""
    P = np.zeros((STATES, STATES))
    P[X, X] = P[X + 1, X + 1] = noise.start_position**2
    for i in range(3):
        P[BIAS + i, BIAS + i] = noise.gyro_bias**2
    for i in range(2):
        P[S + i, S + i] = noise.start_speed**2
        P[LEAN_ERROR + i, LEAN_ERROR + i] = noise.lean_error**2
        P[G + i, G + i] = noise.attitude**2 + noise.lean_error**2
    P[PSI, PSI] = noise.attitude**2 + noise.start_heading**2
    P[SHOWN_PSI, SHOWN_PSI] = noise.attitude**2
    P[DRIFT, DRIFT] = noise.heading_drift**2
    # g + a is known but for white noise: if one is too large the other is too small; so is psi_a, a part of it psi
    together = (-(noise.lean_error**2), -(noise.lean_error**2), noise.attitude**2)
    for (i, j), covariance in zip(SHOWN_TOGETHER, together, strict=True):
        P[i, j] = P[j, i] = covariance
    return P
