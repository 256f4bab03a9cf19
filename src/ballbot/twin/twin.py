"""The twin: a MuJoCo robot with real rollers, measured by its own sensors.

It is a plant (`ballbot.simulation.plant`): torques in, measurements out. Beyond the exact model it has wheels that
touch with one of two rows of rollers, slip, soft contacts, gearbox play and the other faults of its scenario, and
sensors with quantisation, noise and drift. Delayed torques and sampling jitter (`TimingModel`), pushes on the body and
bumps of the floor (`Disturbances`) are applied here, once a sample.
"""

import math
from collections import deque
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ballbot.arrays import Floats, positive_number, real_array
from ballbot.estimation.interface import Estimator
from ballbot.estimation.onboard import OnboardState
from ballbot.mechanics.geometry import angle_rates, quaternion_of, rotation, transforms
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.simulation.imperfections import slope_of, waves_of
from ballbot.simulation.plant import Measurement
from ballbot.simulation.sensors import SensorSuite, sensor_samples
from ballbot.twin.driveline import Shafts, TwinDriveline
from ballbot.twin.engine import Engine, attitude_of, body_rate
from ballbot.twin.faults import Timing
from ballbot.twin.mjcf import floor_friction, floor_normal, twin_mjcf
from ballbot.twin.scenario import Scenario
from ballbot.twin.scenario_file import load_scenario


class TimingModel:
    """Delay of the torques, and jitter of the sampling instants.

    Instant k is at k T + e_k with e_k ~ U(-jitter, jitter) in whole physics steps and e_0 = 0; the mean rate stays.
    """

    def __init__(
        self,
        timing: Timing,
        *,
        steps: int,  # physics steps in a sample on the grid
        timestep: float,
        wheel_count: int,
        random: np.random.Generator,
    ) -> None:
        self._waiting = deque([np.zeros(wheel_count)] * timing.delay)
        self._largest = int(timing.jitter / timestep * (1 + 1e-9))
        self._steps = steps
        self._late = 0  # steps by which the last instant was later than its place
        self._random = random

    def acting(self, torques: Floats) -> Floats:
        """Return the torques (n,) that act while these were computed."""
        self._waiting.append(torques)
        return self._waiting.popleft()

    def next_steps(self) -> int:
        """Return the physics steps up to the next instant."""
        if not self._largest:
            return self._steps
        late = int(self._random.integers(-self._largest, self._largest, endpoint=True))
        steps = self._steps + late - self._late
        self._late = late
        return steps


class BodyForce:
    """Forces on the body at heights above the ball's centre, until they are changed."""

    def __init__(self, engine: Engine) -> None:
        self._wrench = engine.external_force("body")
        self._center_of_mass = engine.center_of_mass("body")
        self._pose = engine.position("body")

    def clear(self) -> None:
        """Remove every force."""
        self._wrench[:] = 0.0

    def add(self, force: ArrayLike, height: float) -> None:
        """Add a force (3,) [N], world frame, at a height along the body's axis [m]."""
        arm = self._pose[:3] + height * _up(self._pose[3:]) - self._center_of_mass
        newtons = np.asarray(force, dtype=np.float64)
        self._wrench[:3] += newtons
        self._wrench[3:] += np.cross(arm, newtons)


class Disturbances:
    """The pushes, the bumps and the changes of a scenario.

    A push is a force on the body during its interval. A bump is the force of the slope of an uneven floor, at the
    ball's centre. A payload that is not on the robot has no mass.
    """

    def __init__(self, robot: Robot, scenario: Scenario, engine: Engine) -> None:
        self._pushes, self._body = scenario.pushes, BodyForce(engine)
        self._waves = waves_of(scenario.roughness) if scenario.roughness else None
        self._robot, self._scenario, self._engine = robot, scenario, engine
        self._changes = [0.0, *scenario.changes()]
        self._on_ball = engine.external_force("ball")
        self._place = engine.position("ball")[:2]

    def reset(self) -> None:
        """Have the payload and the floor of the start."""
        self._ahead = list(self._changes)

    def prepare_sample(self, t: float) -> None:
        """Set forces, payload and floor for the sample that begins at t [s], within half a microsecond of rounding."""
        while self._ahead and self._ahead[0] - 5e-7 <= t:
            self._change(self._scenario.at(self._ahead.pop(0)))
        if self._pushes:
            self._body.clear()
        for push in self._pushes:
            if push.time - 5e-7 <= t < push.time + push.duration - 5e-7:
                self._body.add(push.force, push.height)
        if self._waves is not None:
            self._on_ball[:2] = -self._weight * slope_of(self._waves, self._place)

    def _change(self, now: Scenario) -> None:
        carried = now.payload.mass if now.payload else 0.0
        self._weight = (self._robot.ball.mass + self._robot.body.mass + carried) * self._robot.gravity  # [N]
        if self._scenario.payload:
            self._engine.set_mass("payload", 1.0 if carried else 0.0)
        if self._scenario.carpet:
            self._engine.floor_friction[2:] = floor_friction(self._robot, now)[2:]


def _up(quaternion_wxyz: Floats) -> Floats:
    """Return the body's z axis (3,) in the world's frame."""
    w, x, y, z = quaternion_wxyz.tolist()
    return np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])


class Twin:
    """A MuJoCo robot in a scenario, as a plant.

    Parameters
    ----------
    robot : Robot, preset or robot file
        Gives the rigid body, the drive and the geometry; its friction is not used.
    scenario : Scenario, name or scenario file, optional
        All other true properties; `Scenario.nominal(robot)` if not given.
    estimator : Estimator, optional
        Estimates the state from the sensors' readings; the thesis's `OnboardState` if not given. The twin resets and
        updates it.

    Raises
    ------
    InputError
        If the scenario does not fit the robot, or MuJoCo is not installed.

    Examples
    --------
    >>> twin = Twin("alten", "ideal")
    >>> start = twin.reset(seed=1)
    >>> round(twin.step([0.1, 0.1, 0.1], 0.005).t, 6)
    0.005
    """

    def __init__(
        self,
        robot: RobotLike,
        scenario: Scenario | str | Path | None = None,
        *,
        estimator: Estimator | None = None,
    ) -> None:
        self.robot = robot = as_robot(robot)
        self.scenario = load_scenario(scenario or "nominal", robot)
        self.engine = Engine(twin_mjcf(robot, self.scenario))
        sensors = self.scenario.sensors
        self._substeps = round(sensors.sample_time / self.scenario.timestep)
        self._driveline = TwinDriveline(robot, self.scenario, self.engine)
        self._shafts = Shafts(robot, self.scenario, self.engine)
        self._disturbances = Disturbances(robot, self.scenario, self.engine)
        self._timing: TimingModel | None = None
        self._sensors = SensorSuite(
            robot,
            sensors,
            window=self.scenario.speed_window,
            faults=self.scenario.sensor_faults,
            accelerometer=self.scenario.accelerometer,
            fix=self.scenario.fix,
        )
        self._estimator = estimator or OnboardState(robot, sample_time=sensors.sample_time)
        self._ball_position, self._body_pose = self.engine.position("ball")[:3], self.engine.position("body")
        self._ball_velocity, self._body_velocity = self.engine.velocity("ball"), self.engine.velocity("body")
        self._random = np.random.default_rng(0)
        self._t = 0.0
        self._samples = 0
        self._psi = 0.0

    def reset(self, initial_state: ArrayLike | None = None, *, seed: int = 0) -> Measurement:
        """Set the robot to a true state at t = 0 and measure it.

        The wheels' angles, the position of each gearbox within its play and all noise follow from the seed: the same
        seed gives the same run, bit for bit. Wheels start at the speeds of the state.

        Parameters
        ----------
        initial_state : array_like (10,), optional
            x, y [m], theta, phi, psi [rad], and their rates; upright at rest if not given.
        seed : int

        Returns
        -------
        Measurement

        Raises
        ------
        InputError
            If the state is not ten finite numbers.

        Examples
        --------
        >>> Twin("alten", "ideal").reset([0, 0, 0.02, 0, 0, 0, 0, 0, 0, 0]).truth[2].round(3)
        np.float64(0.02)
        """
        state = (
            np.zeros(10) if initial_state is None else real_array(initial_state, (10,), "The initial state")
        )
        self._random = np.random.default_rng(seed)
        if self.scenario.timing:
            self._timing = TimingModel(
                self.scenario.timing,
                steps=self._substeps,
                timestep=self.scenario.timestep,
                wheel_count=self.robot.wheel_count,
                random=np.random.default_rng([seed, 5]),  # not the stream of the noise
            )
        self.engine.reset()
        self._place(state)
        self._disturbances.reset()
        self._driveline.reset()
        self._sensors.reset(self._random, self._shafts.angles())
        self._estimator.reset(position=(float(state[0]), float(state[1])))
        self._t = 0.0
        self._samples = 0
        self._psi = float(state[4])
        return self._measure()

    def step(self, torques: ArrayLike, duration: float) -> Measurement:
        """Hold commanded torques for whole sample times and measure at the end.

        The sensors are read at each sample; noise, torque limit and supply limit act on the torques.

        Parameters
        ----------
        torques : array_like (n,)
            [N m].
        duration : float
            [s]; a whole number of sample times.

        Returns
        -------
        Measurement

        Raises
        ------
        InputError
            If the torques are not n finite numbers, or the duration is not a whole number of sample times.

        Examples
        --------
        >>> twin = Twin("alten", "ideal")
        >>> start = twin.reset([0, 0, 0.02, 0, 0, 0, 0, 0, 0, 0])
        >>> bool(twin.step([0, 0, 0], 0.1).truth[2] > 0.02)
        True
        """
        held = real_array(torques, (self.robot.wheel_count,), "The array of torques")
        duration = positive_number(duration, "The duration")
        samples = sensor_samples(duration, self.scenario.sensors.sample_time)
        for _ in range(samples - 1):
            self._advance(held)
            self._measure()
        self._advance(held)
        return self._measure()

    def _place(self, state: Floats) -> None:
        """Write a state (10,) into the engine, with random wheel angles and play."""
        radius = self.robot.ball.radius
        x, y, theta, phi, psi = state[:5].tolist()
        normal = floor_normal(self.scenario)
        height = (radius - normal[0] * x - normal[1] * y) / normal[2]
        self._ball_position[:] = (x, y, height)
        self._body_pose[:3] = (x, y, height)
        self._body_pose[3:] = quaternion_of(theta, phi, psi)
        self._ball_velocity[:3] = (state[5], state[6], 0.0)
        rolling = np.array([-state[6], state[5], 0.0]) / radius  # Omega without slip or pivoting, world frame
        self._ball_velocity[3:] = rolling  # the ball's own frame is the world's at the start
        self._body_velocity[:3] = self._ball_velocity[:3]
        self._body_velocity[3:] = body_rate(state)
        z = rotation(theta, phi, psi).T @ rolling
        self._driveline.speeds[:] = transforms(self.robot).T_owb @ (z - body_rate(state))
        self._shafts.reset(self._random)

    def _advance(self, torques: Floats) -> None:
        """Advance by one sample with the torques (n,) held and noise added."""
        noise = self.scenario.torque_noise * self._random.standard_normal(self.robot.wheel_count)
        steps = self._substeps
        if self._timing:
            torques, steps = self._timing.acting(torques), self._timing.next_steps()
        self._disturbances.prepare_sample(self._t)
        self._driveline.command(torques + noise)
        self._driveline.advance(steps, self._shafts)
        self._samples += 1
        on_grid = self._samples * self.scenario.sensors.sample_time
        self._t = self._t + steps * self.scenario.timestep if self._timing else on_grid

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
            attitude=reading.attitude,
            truth=truth,
            valid=reading.whole,
            ended=self._why_ended(t, truth),
        )

    def _truth(self) -> Floats:
        attitude = attitude_of(self._body_pose[3:], near_psi=self._psi)
        self._psi = float(attitude[2])
        rates = angle_rates(attitude, self._body_velocity[3:])
        return np.concatenate((self._ball_position[:2], attitude, self._ball_velocity[:2], rates))

    def _why_ended(self, t: float, truth: Floats) -> str | None:
        limit = self.scenario.fallen_lean
        upright = math.cos(truth[2]) * math.cos(truth[3])  # cosine of the lean
        if not math.isfinite(upright):
            return f"the simulation diverged at t = {t:.3f} s"
        if upright < math.cos(limit):
            return f"fallen: lean past {limit:g} rad at t = {t:.3f} s"
        return None
