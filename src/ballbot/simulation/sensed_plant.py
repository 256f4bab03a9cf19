"""The model as a robot has it: through its own sensors, late, noisy, with play, on a floor that is not level.

It stands between `ModelPlant`, whose sensors are perfect, and the MuJoCo twin: the equations of motion with the sensors
and the drive of a twin's scenario, in a fraction of the twin's time. Controllers can so be compared on robots whose
masses, geometry or friction differ from those that the controller knows.

The imperfections:

- sensors, their faults, an accelerometer and fixes: those of the twin (`ballbot.simulation.sensors`). The
  controller's state is an estimator's, of the robot that the controller knows.
- delay: torques act whole samples later, zero at first. Noise comes upon each sample's torques when they act, and then
  the driver's torque limit and the supply's speed limit, which is taken by the speed at the sample's start.
- play: `ballbot.simulation.gear_play`; without it the model is stepped as `ModelPlant` does, bit for bit.
- slope: to first order, as `ballbot.simulation.conditions` has it. The lean that is measured is larger by that at
  which the robot rests, and the slope loads the wheels beyond their play.

Rolling and pivoting friction are the model's, and so is the friction of its drivelines.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array
from ballbot.errors import InputError
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import Estimator, EstimatorName, Reading
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.mechanics.geometry import body_rates_matrix
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.derived import wheel_speed_limit
from ballbot.simulation.gear_play import GearPlayPlant
from ballbot.simulation.imperfections import (
    FALLING_PART,
    Battery,
    Imperfections,
    Supply,
    off_axis,
    rest_on_slope,
)
from ballbot.simulation.model_plant import ModelPlant, checked_states
from ballbot.simulation.plant import Measurement
from ballbot.simulation.sensors import SensorSuite, sensor_samples


class SensedPlant:
    """A model behind a robot's own sensors, drive and floor.

    Parameters
    ----------
    model : Model
        The true mechanics, friction and limits of the drive. Of the exact formulation, whose wheel speeds are those
        that encoders see.
    imperfections : Imperfections
    known : Robot, optional
        The robot that the estimator knows; the model's by default.
    estimator : {"onboard", "kalman"} or Estimator
        A name makes a new one for the known robot; another estimator is reset and updated by the plant.

    Raises
    ------
    InputError
        If the formulation is not "exact", the known robot has another number of wheels, or the model cannot have play
        (`GearPlayPlant`).
    """

    def __init__(
        self,
        model: Model,
        imperfections: Imperfections,
        *,
        known: Robot | None = None,
        estimator: EstimatorName | Estimator = "onboard",
    ) -> None:
        if model.formulation != "exact":
            raise InputError(
                "Sensors need the formulation 'exact'; the wheel speeds of 'thesis' are not those that encoders see."
            )
        robot, assumed = model.robot, model.robot if known is None else known
        if assumed.wheel_count != robot.wheel_count:
            raise InputError(
                f"The known robot has {assumed.wheel_count} wheels and the model's {robot.wheel_count}; they must have "
                "the same number."
            )
        apart = [name for name in ("pushes", "lag", "jitter", "missing") if getattr(imperfections, name)]
        if apart:
            raise InputError(
                f"A plant called sample by sample has no {', '.join(apart)}; run the robot with `simulate_batch`, or "
                "on the twin."
            )
        self.model, self.imperfections = model, imperfections
        sensors = imperfections.sensors or robot.sensors
        self._sample_time = sensors.sample_time
        self._mechanics = (
            GearPlayPlant(model, imperfections.backlash)
            if imperfections.backlash > 0.0
            else ModelPlant(model)
        )
        self._sensors = SensorSuite(
            robot,
            sensors,
            window=imperfections.speed_window,
            faults=imperfections.sensor_faults,
            accelerometer=imperfections.accelerometer,
            fix=imperfections.fix,
        )
        self._estimator = (
            named_estimator(estimator, assumed, sample_time=self._sample_time)
            if isinstance(estimator, str)
            else estimator
        )
        self._drive = DriveLimits(robot, imperfections.supply)
        self._slope = _Rest(robot, imperfections.slope, imperfections.imbalance)
        self._upright_cosine = math.cos(imperfections.fallen_lean)
        self.reset()

    @property
    def robot(self) -> Robot:
        """The model's robot."""
        return self.model.robot

    @property
    def motor_angles(self) -> NDArray[np.float64]:
        """Angles (n,) of the motors at the wheels, of which the encoders count [rad]."""
        return self._true.wheel_angles.copy()

    @property
    def play_places(self) -> NDArray[np.float64]:
        """How far each motor is ahead of its wheel (n,) [rad]; zero without play."""
        mechanics = self._mechanics
        return (
            mechanics.play_places
            if isinstance(mechanics, GearPlayPlant)
            else np.zeros(self.robot.wheel_count)
        )

    def reset(self, initial_state: ArrayLike | None = None, *, seed: int = 0) -> Measurement:
        """Start at t = 0 and return the sensors' measurement.

        Parameters
        ----------
        initial_state : array_like (10,) or None
            True state; None is upright at rest at the origin.
        seed : int
            All noise, and where in its play each gearbox rests, follow from it: equal seeds give equal runs, bit for
            bit.

        Raises
        ------
        InputError
            If the state is not ten finite numbers with a lean of at most 1.2 rad.
        """
        state = np.zeros(10) if initial_state is None else checked_states(initial_state)[0]
        self._random = np.random.default_rng(seed)
        self._waiting = deque([np.zeros(self.robot.wheel_count)] * self.imperfections.delay)
        self._true = self._mechanics.reset(self._slope.on_level(state), seed=seed)
        self._sensors.reset(self._random, self._true.wheel_angles)
        self._estimator.reset(position=(float(state[0]), float(state[1])))
        return self._measure()

    def step(self, torques: ArrayLike, duration: float) -> Measurement:
        """Hold the torques for a duration and return the sensors' measurement at its end.

        Parameters
        ----------
        torques : array_like (n,)
            Commanded torques at the wheels [N m]; delay, noise, torque limit and supply limit come upon them.
        duration : float
            A whole number of the sensors' sample times [s]; the sensors are read at each.

        Raises
        ------
        InputError
            If the torques are not n finite numbers, or the duration is no such number.
        """
        held = real_array(torques, (self.robot.wheel_count,), "The array of torques")
        duration = positive_number(duration, "The duration")
        samples = sensor_samples(duration, self._sample_time)
        for _ in range(samples - 1):
            self._advance(held)
            self._measure()
        self._advance(held)
        return self._measure()

    def _advance(self, torques: NDArray[np.float64]) -> None:
        """Advance by one sample with the torques (n,) that were commanded."""
        imperfections, mechanics = self.imperfections, self._mechanics
        self._waiting.append(torques)
        noise = imperfections.torque_noise * self._random.standard_normal(self.robot.wheel_count)
        acting = self._drive.within_limits(self._waiting.popleft() + noise, self._true.wheel_speeds)
        sample_time = self._sample_time
        load = self._slope.load(float(self._true.state[4]))
        if isinstance(mechanics, GearPlayPlant):
            self._true = mechanics.step(acting, sample_time, wheel_load=load)
        else:
            self._true = mechanics.step(acting - load, sample_time)

    def _measure(self) -> Measurement:
        """Read every sensor once."""
        true = self._true
        truth = self._slope.on_slope(true.truth)
        reading = self._read(true, truth)
        return Measurement(
            t=true.t,
            state=self._estimator.update(reading),
            wheel_angles=reading.wheel_angles,
            wheel_speeds=reading.wheel_speeds,
            gyro=reading.gyro,
            acceleration=reading.acceleration,
            attitude=reading.attitude,
            truth=truth,
            valid=reading.whole,
            ended=self._why_ended(true, truth),
        )

    def _read(self, true: Measurement, truth: NDArray[np.float64]) -> Reading:
        body_rate = true.gyro if truth is true.truth else body_rates_matrix(*truth[2:5]) @ truth[7:]
        body_velocity = np.array([truth[5], truth[6], 0.0, *body_rate])
        return self._sensors.read(true.t, truth, body_velocity, true.wheel_angles)

    def _why_ended(self, true: Measurement, truth: NDArray[np.float64]) -> str | None:
        limit = self.imperfections.fallen_lean
        upright = math.cos(truth[2]) * math.cos(truth[3])  # cosine of the lean
        if true.ended is None and limit < LARGEST_LEAN and upright < self._upright_cosine:
            return f"fallen: lean past {limit:g} rad at t = {true.t:.3f} s"
        return true.ended


class DriveLimits:
    """Torque limit of the drivers and speed limit of the supply, as on the twin."""

    def __init__(self, robot: Robot, supply: Supply | None = None) -> None:
        drive = robot.drive
        self._battery = Battery(robot, supply) if supply else None
        self._limit = drive.torque_limit
        self._top = wheel_speed_limit(
            supply_voltage=drive.supply_voltage,
            speed_constant=drive.speed_constant,
            gear_ratio=drive.gear_ratio,
        )

    def within_limits(self, torques: NDArray[np.float64], speeds: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the torques (n,) [N m] that the motors can give of those commanded at motor speeds (n,) [rad/s]."""
        limit, top = self._limit, self._top
        clipped = np.minimum(np.maximum(torques, -limit), limit)
        if self._battery is not None:
            return self._battery.within(clipped, speeds)
        if np.abs(speeds).max() <= (1.0 - FALLING_PART) * top:
            return clipped
        # one-sided: a motor at its highest speed can still brake with full torque
        share = np.clip((top - speeds * np.sign(clipped)) / (FALLING_PART * top), 0.0, 1.0)
        return np.sign(clipped) * np.minimum(np.abs(clipped), share * limit)


class _Rest:
    """A floor that rises and a body off its axis, as lean and wheel torques that the robot on level ground lacks."""

    def __init__(self, robot: Robot, slope: tuple[float, float], imbalance: tuple[float, float]) -> None:
        self._off_axis = off_axis(robot, imbalance)
        self._lean, self._along = rest_on_slope(robot, slope)
        _, self._across = rest_on_slope(robot, (slope[1], -slope[0]))
        self._level = slope[0] == slope[1] == imbalance[0] == imbalance[1] == 0.0
        self._none = np.zeros(robot.wheel_count)

    def on_level(self, state: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the state (10,) of the robot on level ground that moves as one on the slope."""
        return state if self._level else self._leaning(state, -1.0)

    def on_slope(self, state: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the state (10,) on the slope of a robot on level ground."""
        return state if self._level else self._leaning(state, 1.0)

    def load(self, psi: float) -> NDArray[np.float64]:
        """Return the torques (n,) [N m] with which the slope loads the wheels at a heading [rad]."""
        if self._level:
            return self._none
        return math.cos(psi) * self._along + math.sin(psi) * self._across

    def _leaning(self, state: NDArray[np.float64], sign: float) -> NDArray[np.float64]:
        moved = state.copy()
        x, y = self._off_axis
        s, c = math.sin(state[4]), math.cos(state[4])
        theta, phi = s * x + c * y, s * y - c * x
        moved[2:4] += sign * (self._lean + np.array([theta, phi]))
        moved[7:9] += sign * state[9] * np.array([-phi, theta])
        return moved
