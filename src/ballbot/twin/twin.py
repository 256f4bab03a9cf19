"""The twin: a MuJoCo robot with real rollers, seen through its own sensors.

It is a plant like any other (`ballbot.simulation.plant`): torques in, measurements out. What it adds to the
exact model is what the exact model leaves out: wheels that touch in one of two rows of rollers, slip, soft
contacts, gearbox play, and whatever else its scenario says; sensors that count, err and drift.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array
from ballbot.estimation.attitude import angle_rates
from ballbot.estimation.interface import Estimator
from ballbot.estimation.onboard import OnboardState
from ballbot.mechanics.geometry import transforms
from ballbot.robot.robot import Robot
from ballbot.simulation.plant import Measurement
from ballbot.simulation.sensor_suite import SensorSuite, sensor_samples
from ballbot.twin.disturbances import disturbances
from ballbot.twin.driveline import Driveline
from ballbot.twin.engine import Engine
from ballbot.twin.kinematics import attitude_of, ball_rate, body_rate, encoder_speeds, quaternion_of
from ballbot.twin.mjcf import floor_normal, twin_mjcf
from ballbot.twin.scenario import Scenario
from ballbot.twin.shafts import Shafts
from ballbot.twin.timing import Clockwork


class Twin:
    """A robot to experiment on.

    Parameters
    ----------
    robot : Robot
        The rigid body, the drive and the geometry; its friction is not looked at.
    scenario : Scenario, optional
        Everything else that is true; `Scenario.nominal(robot)` where none is given.
    estimator : Estimator, optional
        Makes the measured state of what the sensors say; the thesis's `OnboardState` where none is given. It is
        the twin's own from here on.

    Raises
    ------
    InputError
        Where the two do not fit each other, or MuJoCo is not installed.
    """

    def __init__(
        self, robot: Robot, scenario: Scenario | None = None, *, estimator: Estimator | None = None
    ) -> None:
        self.robot = robot
        self.scenario = scenario if scenario is not None else Scenario.nominal(robot)
        self.engine = Engine(twin_mjcf(robot, self.scenario))
        sensors = self.scenario.sensors
        self._substeps = round(sensors.sample_time / self.scenario.timestep)
        self._driveline = Driveline(robot, self.scenario, self.engine)
        self._shafts = Shafts(robot, self.scenario, self.engine)
        self._disturbances = disturbances(robot, self.scenario, self.engine)
        self._clockwork: Clockwork | None = None
        self._sensors = SensorSuite(
            robot,
            sensors,
            window=self.scenario.speed_window,
            faults=self.scenario.sensor_faults,
            accelerometer=self.scenario.accelerometer,
            fix=self.scenario.fix,
        )
        self._estimator = estimator or OnboardState(robot, sample_time=sensors.sample_time)
        self._lay_out_views()
        self._random = np.random.default_rng(0)
        self._t = 0.0
        self._samples = 0
        self._psi = 0.0

    def reset(self, initial_state: ArrayLike | None = None, *, seed: int = 0) -> Measurement:
        """Put the robot in a state, at t = 0, and return what its sensors say.

        The rollers' places on the ball, where in its play each gearbox rests and all noise follow from the
        seed. Wheels start at the speeds that go with the state.

        Parameters
        ----------
        initial_state : array (10,) or None
            True state; None is upright at rest at the origin.
        seed : int
            Equal seeds give equal runs, bit for bit.

        Raises
        ------
        InputError
            Where the state is not ten finite numbers.
        """
        state = (
            np.zeros(10) if initial_state is None else real_array(initial_state, (10,), "The initial state")
        )
        self._random = np.random.default_rng(seed)
        self._clockwork = self._wound_clockwork(seed)
        self.engine.reset()
        self._place(state)
        self._driveline.reset()
        self._sensors.reset(self._random, self._shafts.angles())
        self._estimator.reset(position=(float(state[0]), float(state[1])))
        self._t = 0.0
        self._samples = 0
        self._psi = float(state[4])
        return self._measure()

    def step(self, torques: ArrayLike, duration: float) -> Measurement:
        """Hold the torques for a duration and return what the sensors say at its end.

        Parameters
        ----------
        torques : array (n,)
            Commanded torques at the wheels [N m]; noise, torque limit and supply limit come upon them.
        duration : float
            A whole number of the sensors' sample times [s]; the sensors are read at each.

        Raises
        ------
        InputError
            If the torques are not n finite numbers, or the duration is no such number.
        """
        held = real_array(torques, (self.robot.wheel_count,), "The array of torques")
        duration = positive_number(duration, "The duration")
        samples = sensor_samples(duration, self.scenario.sensors.sample_time)
        for _ in range(samples - 1):
            self._advance(held)
            self._measure()
        self._advance(held)
        return self._measure()

    def _lay_out_views(self) -> None:
        """Find the coordinates of ball, body and motors among MuJoCo's."""
        engine = self.engine
        ball, body = engine.first_position("ball"), engine.first_position("body")
        self._ball_position = engine.qpos[ball : ball + 3]
        self._body_pose = engine.qpos[body : body + 7]
        ball, body = engine.first_velocity("ball"), engine.first_velocity("body")
        self._ball_velocity = engine.qvel[ball : ball + 6]
        self._body_velocity = engine.qvel[body : body + 6]

    def _wound_clockwork(self, seed: int) -> Clockwork | None:
        """Return what delays and unsettles the samples of the run of that seed, or None."""
        if self.scenario.timing is None:
            return None
        return Clockwork(
            self.scenario.timing,
            steps=self._substeps,
            timestep=self.scenario.timestep,
            wheel_count=self.robot.wheel_count,
            random=np.random.default_rng([seed, 5]),  # not the stream of the noise
        )

    def _place(self, state: NDArray[np.float64]) -> None:
        """Write a state (10,) into the engine, wheels and play where chance puts them."""
        radius = self.robot.ball.radius
        x, y, theta, phi, psi = state[:5].tolist()
        normal = floor_normal(self.scenario)
        height = (radius - normal[0] * x - normal[1] * y) / normal[2]
        self._ball_position[:] = (x, y, height)
        self._body_pose[:3] = (x, y, height)
        self._body_pose[3:] = quaternion_of(theta, phi, psi)
        self._ball_velocity[:3] = (state[5], state[6], 0.0)
        self._ball_velocity[3:] = ball_rate(state, radius)  # the ball's own frame is the world's at the start
        self._body_velocity[:3] = self._ball_velocity[:3]
        self._body_velocity[3:] = body_rate(state)
        self._driveline.speeds[:] = encoder_speeds(state, transforms(self.robot).T_owb, radius)
        self._shafts.reset(self._random)

    def _advance(self, torques: NDArray[np.float64]) -> None:
        """Advance by one sample with the torques (n,) held and their noise upon them."""
        noise = self.scenario.torque_noise * self._random.standard_normal(self.robot.wheel_count)
        steps = self._substeps
        if self._clockwork:
            torques, steps = self._clockwork.acting(torques), self._clockwork.next_steps()
        for disturbance in self._disturbances:
            disturbance.prepare_sample(self._t)
        self._driveline.command(torques + noise)
        prepare, step = self._driveline.prepare_step, self.engine.step
        for _ in range(steps):
            if self._shafts.returning:
                self._shafts.turn_back()
            prepare()
            step()
        self._samples += 1
        on_grid = self._samples * self.scenario.sensors.sample_time
        self._t = self._t + steps * self.scenario.timestep if self._clockwork else on_grid

    def _measure(self) -> Measurement:
        """Read every sensor once."""
        t, truth = self._t, self._truth()
        reading = self._sensors.read(t, truth, self._body_velocity, self._shafts.angles())
        return Measurement(
            t=t,
            state=self._estimator.update(reading),
            wheel_angles=reading.wheel_angles,
            wheel_speeds=reading.wheel_speeds,
            gyro=reading.gyro,
            acceleration=reading.acceleration,
            truth=truth,
            valid=reading.whole,
            ended=self._why_ended(t, truth),
        )

    def _truth(self) -> NDArray[np.float64]:
        attitude = attitude_of(self._body_pose[3:], near_psi=self._psi)
        self._psi = float(attitude[2])
        rates = angle_rates(attitude, self._body_velocity[3:])
        return np.concatenate((self._ball_position[:2], attitude, self._ball_velocity[:2], rates))

    def _why_ended(self, t: float, truth: NDArray[np.float64]) -> str | None:
        limit = self.scenario.fallen_lean
        upright = math.cos(truth[2]) * math.cos(truth[3])  # cosine of the lean
        if not math.isfinite(upright):
            return f"the simulation diverged at t = {t:.3f} s"
        if upright < math.cos(limit):
            return f"fallen: lean past {limit:g} rad at t = {t:.3f} s"
        return None
