"""The twin on the bench: the robot is clamped, its motors follow given torques.

On the stand the wheels are in the air (thesis 3.1, Figure 3.1). Upside down the ball lies on the wheels (3.2, 3.3
and Appendix V) and a camera gives its angular velocity in the body's frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.columns import torque_names, wheel_angle_names, wheel_speed_names
from ballbot.progress import Progress, ProgressCallback, ignore_progress
from ballbot.robot import Robot
from ballbot.simulation.held_robot import CAMERA_NOISE, multisine_at, sweep_at
from ballbot.simulation.run import sample_count
from ballbot.simulation.sensors import Encoders
from ballbot.twin.driveline import Driveline, Shafts
from ballbot.twin.engine import Engine, rotated
from ballbot.twin.mjcf import twin_mjcf
from ballbot.twin.scenario import Scenario

Bench = Literal["stand", "upside_down"]


@dataclass(frozen=True, kw_only=True)
class BenchRun:
    """The log of a run, and the same columns with the true values."""

    log: Log  #: t, u*, wheel*, wheel*_dot, and upside down ball_omega_x, _y, _z
    truth: Log


def run_bench(
    robot: Robot,
    scenario: Scenario,
    torques: NDArray[np.float64],
    *,
    bench: Bench,
    seed: int = 0,
    progress: ProgressCallback = ignore_progress,
) -> BenchRun:
    """Drive the motors of a clamped robot by torques (N, n) [N m], commanded at each sample, before noise and limits.

    The scenario's pushes, bumps, timing and IMU have no effect here. The same seed, of wheels, play and noise, gives
    the same result.

    InputError if the torques are not rows of n finite numbers, or the scenario does not fit the robot.
    """
    count = robot.wheel_count
    if torques.ndim != 2 or torques.shape[1] != count or not len(torques) or not np.isfinite(torques).all():
        raise InputError(f"The torques must be rows of {count} finite numbers, not of shape {torques.shape}.")
    engine = Engine(twin_mjcf(robot, scenario, mounting=bench))
    clamped = _ClampedRobot(robot, scenario, engine, bench, seed)
    measured, true = [], []
    for k, torque in enumerate(torques):
        before, truth = clamped.read()
        measured.append(before)
        true.append(truth)
        clamped.advance(torque)
        if k % 200 == 0:
            progress(Progress(stage="simulating", done=k, total=len(torques)))
    t = scenario.sensors.sample_time * np.arange(len(torques), dtype=np.float64)
    names = [*wheel_angle_names(count), *wheel_speed_names(count)]
    names += [f"ball_omega_{axis}" for axis in "xyz"] if bench == "upside_down" else []
    inputs = dict(zip(torque_names(count), torques.T, strict=True))
    logs = [
        Log({"t": t} | inputs | dict(zip(names, np.array(rows).T, strict=True))) for rows in (measured, true)
    ]
    return BenchRun(log=logs[0], truth=logs[1])


class _ClampedRobot:
    """A clamped robot between two samples."""

    def __init__(self, robot: Robot, scenario: Scenario, engine: Engine, bench: Bench, seed: int) -> None:
        self._engine = engine
        self._random = np.random.default_rng(seed)
        self._noise = scenario.torque_noise
        self._steps = round(scenario.sensors.sample_time / scenario.timestep)
        self._driveline = Driveline(robot, scenario, engine)
        self._shafts = Shafts(robot, scenario, engine)
        self._shafts.reset(self._random)
        self._driveline.reset()
        self._encoders = Encoders(robot, scenario.sensors, window=scenario.speed_window)
        self._encoders.reset(self._shafts.angles())
        self._start = self._shafts.angles().copy()
        self._with_ball = bench == "upside_down"
        if self._with_ball:
            position, velocity = engine.first_position("ball"), engine.first_velocity("ball")
            self._orientation = engine.qpos[position + 3 : position + 7]
            self._spin = engine.qvel[velocity + 3 : velocity + 6]

    def read(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return a row as the sensors measure it, and the true one."""
        angles = self._shafts.angles()
        row = np.concatenate(self._encoders.read(angles))
        truth = np.concatenate((angles - self._start, self._driveline.speeds))
        if self._with_ball:
            omega = rotated(self._orientation, self._spin)  # the engine gives it in the ball's frame
            truth = np.concatenate((truth, omega))
            row = np.concatenate((row, omega + CAMERA_NOISE * self._random.standard_normal(3)))
        return row, truth

    def advance(self, torques: NDArray[np.float64]) -> None:
        """Advance by one sample."""
        self._driveline.command(torques + self._noise * self._random.standard_normal(len(torques)))
        for _ in range(self._steps):
            if self._shafts.returning:
                self._shafts.turn_back()
            self._driveline.prepare_step()
            self._engine.step()


def sweep_torques(robot: Robot, scenario: Scenario, *, duration: float) -> NDArray[np.float64]:
    """Return the thesis's driveline sweep (N, n); see `ballbot.simulation.held_robot.sweep_at`."""
    return sweep_at(_times(scenario, duration), robot.wheel_count)


def multisine_torques(robot: Robot, scenario: Scenario, *, duration: float, seed: int) -> NDArray[np.float64]:
    """Return torques (N, n) that stir the ball; see `ballbot.simulation.held_robot.multisine_at`."""
    return multisine_at(_times(scenario, duration), robot.wheel_count, seed=seed)


def _times(scenario: Scenario, duration: float) -> NDArray[np.float64]:
    sample_time = scenario.sensors.sample_time
    return sample_time * np.arange(sample_count(duration, sample_time), dtype=np.float64)
