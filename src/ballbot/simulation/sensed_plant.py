"""The model behind a robot's own sensors and drive: delayed, noisy, with play, on a sloping floor.

It stands between `ModelPlant`, whose sensors are perfect, and the MuJoCo twin: the equations of motion with the sensors
and the drive of a twin's scenario, in a fraction of the twin's time. It is the compiled loop, called one sample at a
time: drive, floor and mechanics are the loop's own, so that controllers written in Python run what the loop runs. The
sensors and the estimator are those in Python, which have an accelerometer and fixes besides.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array
from ballbot.errors import InputError
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import Estimator, EstimatorName
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.inputs import change_samples, draws_of, empty_outcome, inputs_of, new_commands
from ballbot.simulation.loop import ADVANCED, CHANGED, Sampling, new_memory, run_block
from ballbot.simulation.model_plant import LIFTED, checked_states, fallen_words
from ballbot.simulation.plant import Measurement
from ballbot.simulation.sensors import SensorSuite, sensor_samples


class SensedPlant:
    """A model behind a robot's own sensors, drive and floor.

    The model, of the exact formulation, has the true mechanics, friction and limits of the drive. Without sensors among
    the imperfections the state is the true one, at the sample time of the robot's own sensors. The name of an estimator
    makes one for the robot that `imperfections.known` has; another estimator is reset and updated by the plant.

    InputError if the formulation is not "exact", the known robot has another number of wheels, or motors with play have
    no inertia.
    """

    def __init__(
        self, model: Model, imperfections: Imperfections, *, estimator: EstimatorName | Estimator = "onboard"
    ) -> None:
        if model.formulation != "exact":
            raise InputError(
                "Sensors need the formulation 'exact'; the wheel speeds of 'thesis' are not those that encoders see."
            )
        robot, assumed = model.robot, imperfections.known or model.robot
        if assumed.wheel_count != robot.wheel_count:
            raise InputError(
                f"The known robot has {assumed.wheel_count} wheels and the model's {robot.wheel_count}; they must have "
                "the same number."
            )
        self.model, self.imperfections = model, imperfections
        sensors = imperfections.sensors or robot.sensors
        self._sample_time = sensors.sample_time
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
        later = [
            (change.model, replace(imperfections, imbalance=change.imbalance, known=assumed))
            for change in imperfections.later
        ]
        self._stages = [
            inputs_of([one], [given], sample_time=self._sample_time)
            for one, given in ((model, imperfections), *later)
        ]
        self._changes = change_samples(imperfections, self._sample_time)
        self._inputs = self._stages[0]
        self._sampling = Sampling(
            references=np.zeros((1, 10)),
            sample_time=self._sample_time,
            steps=model.steps_in(self._sample_time),
        )
        self.reset()

    @property
    def robot(self) -> Robot:
        """The model's robot."""
        return self.model.robot

    @property
    def motor_angles(self) -> NDArray[np.float64]:
        """Angles (n,) of the motors at the wheels since the reset, of which the encoders count [rad]."""
        return self._memory.encoders[0, : self.robot.wheel_count].copy()

    @property
    def motor_speeds(self) -> NDArray[np.float64]:
        """Speeds (n,) of the motors at the wheels [rad/s]."""
        return self._memory.encoders[0, self.robot.wheel_count :].copy()

    def reset(self, initial_state: ArrayLike | None = None, *, seed: int = 0) -> Measurement:
        """Start at t = 0 from a true state (10,), by default upright at rest at the origin, and return the measurement.

        All noise, the wheels' angles, and where in its play each gearbox rests, follow from the seed: equal seeds give
        equal runs, bit for bit. InputError if the state is not ten finite numbers with a lean of at most 1.2 rad.
        """
        state = np.zeros(10) if initial_state is None else checked_states(initial_state)[0]
        self._inputs = self._stages[0]
        self._inputs.initial[0] = state
        n = self.robot.wheel_count
        self._random, self._instants = np.random.default_rng(seed), np.random.default_rng([seed, 5])
        drawn = draws_of([(self.imperfections, seed)], 1, n=n, samples=0, sample_time=self._sample_time)
        self._draws = drawn._replace(noise=np.zeros((1, 6 + n)), durations=np.zeros((1, 1)), samples=1)
        self._sample, self._late = 0, 0.0
        self._out = empty_outcome(1, 1, np.iinfo(np.int64).max, n)
        self._memory = new_memory(self._inputs.loops, 1, n, filtering=False)
        self._commands = new_commands(1, n)
        self._run((0, 0))
        self._sensors.reset(self._random, self.motor_angles)
        self._estimator.reset(position=(float(state[0]), float(state[1])))
        return self._measure()

    def step(self, torques: ArrayLike, duration: float) -> Measurement:
        """Hold commanded torques (n,) [N m] for whole sample times [s]; return the measurement at the end.

        The sensors are read at each sample. Delay, noise, lag, torque limit and supply limit act on the torques.
        InputError if they are not n finite numbers, or the duration is no such number.
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
        self._commands.todo[0] = ADVANCED
        if self._sample in self._changes:
            self._inputs = self._stages[1 + self._changes.index(self._sample)]
            self._commands.todo[0] = CHANGED
        late = self.imperfections.jitter * self._instants.uniform(-1.0, 1.0)
        self._random.standard_normal(out=self._draws.noise[0, 6:])
        self._draws.durations[0, 0] = self._sample_time + late - self._late
        self._commands.torques[0] = torques
        self._run((0, 1))
        self._sample, self._late = self._sample + 1, late

    def _run(self, span: tuple[int, int]) -> None:
        """Take the loop over a sample, or to the start."""
        given = self._inputs, self._draws, self._sampling, self._memory, self._commands, self._out
        run_block(self.model.selected, *given, span)

    def _measure(self) -> Measurement:
        """Read every sensor once."""
        given, t = self.imperfections, round(self._sample * self._sample_time, 9)
        truth, rate = self._memory.states[0].copy(), self._memory.gyros[0].copy()
        missing = given.missing_from <= self._sample < given.missing_from + given.missing
        body_velocity = np.array([truth[5], truth[6], 0.0, *rate])
        reading = self._sensors.read(t, truth, body_velocity, self.motor_angles)
        perfect = given.sensors is None
        state = truth.copy() if perfect else self._estimator.update(reading)
        if missing:
            state[0] = np.nan
        return Measurement(
            t=t,
            state=state,
            wheel_angles=self.motor_angles if perfect else reading.wheel_angles,
            wheel_speeds=self.motor_speeds if perfect else reading.wheel_speeds,
            gyro=rate if perfect else reading.gyro,
            acceleration=reading.acceleration,
            attitude=reading.attitude,
            truth=truth,
            valid=reading.whole and not missing,
            ended=self._why_ended(t),
        )

    def _why_ended(self, t: float) -> str | None:
        if self._out.ended[0] > self._sample:
            return None
        why = LIFTED if self._out.lifted[0] else fallen_words(self.imperfections.fallen_lean)
        return f"{why} at t = {t:.3f} s"
