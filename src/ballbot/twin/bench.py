"""The twin on the bench: the robot is clamped, its motors follow given torques.

On the stand the wheels are in the air (thesis 3.1, Figure 3.1). Upside down the ball lies on the wheels (3.2, 3.3
and Appendix V) and a camera gives its angular velocity in the body's frame.
"""

from typing import Literal

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.columns import torque_names, wheel_angle_names, wheel_speed_names
from ballbot.progress import Progress, ProgressCallback, ignore_progress
from ballbot.robot import Robot
from ballbot.simulation.held_robot import CAMERA_NOISE, multisine_at, sweep_at
from ballbot.simulation.run import sample_count
from ballbot.simulation.sensors import SensorSuite
from ballbot.twin.driveline import Shafts, TwinDriveline
from ballbot.twin.engine import Engine, rotated
from ballbot.twin.mjcf import twin_mjcf
from ballbot.twin.scenario import Scenario

Bench = Literal["stand", "upside_down"]


def bench_torques(
    robot: Robot, scenario: Scenario, *, bench: Bench, duration: float, seed: int = 0
) -> Floats:
    """Return torques (N, n) [N m]: the thesis's sweep on the stand, upside down a multisine that stirs the ball."""
    sample_time = scenario.sensors.sample_time
    times = sample_time * np.arange(sample_count(duration, sample_time), dtype=np.float64)
    if bench == "stand":
        return sweep_at(times, robot.wheel_count)
    return multisine_at(times, robot.wheel_count, seed=seed)


def run_bench(
    robot: Robot,
    scenario: Scenario,
    torques: Floats,
    *,
    bench: Bench,
    seed: int = 0,
    progress: ProgressCallback = ignore_progress,
) -> tuple[Log, Log]:
    """Drive the motors of a clamped robot by torques (N, n) [N m], commanded at each sample, before noise and limits.

    Return its log (t, u*, wheel*, wheel*_dot, and upside down ball_omega_x, _y, _z) and one with the true values. The
    scenario's pushes, bumps, timing and IMU have no effect here. The same seed, of wheels, play and noise, gives the
    same result.

    InputError if the torques are not rows of n finite numbers, or the scenario does not fit the robot.
    """
    count = robot.wheel_count
    if torques.ndim != 2 or torques.shape[1] != count or not len(torques) or not np.isfinite(torques).all():
        raise InputError(f"The torques must be rows of {count} finite numbers, not of shape {torques.shape}.")
    engine, random = Engine(twin_mjcf(robot, scenario, mounting=bench)), np.random.default_rng(seed)
    driveline, shafts = TwinDriveline(robot, scenario, engine), Shafts(robot, scenario, engine)
    shafts.reset(random)
    driveline.reset()
    sensors = SensorSuite(robot, scenario.sensors, window=scenario.speed_window)
    start = shafts.angles().copy()
    sensors.reset(np.random.default_rng(seed), start)  # of the AHRS alone, which is not logged
    sample_time = scenario.sensors.sample_time
    steps, measured, true = round(sample_time / scenario.timestep), [], []
    for k, torque in enumerate(torques):
        angles = shafts.angles()
        reading = sensors.read(k * sample_time, np.zeros(10), np.zeros(6), angles)
        row, truth = [reading.wheel_angles, reading.wheel_speeds], [angles - start, driveline.speeds]
        if bench == "upside_down":
            # the engine gives it in the ball's frame
            omega = rotated(engine.position("ball")[3:], engine.velocity("ball")[3:])
            row, truth = [*row, omega + CAMERA_NOISE * random.standard_normal(3)], [*truth, omega]
        measured.append(np.concatenate(row))
        true.append(np.concatenate(truth))
        driveline.command(torque + scenario.torque_noise * random.standard_normal(count))
        driveline.advance(steps, shafts)
        if k % 200 == 0:
            progress(Progress(stage="simulating", done=k, total=len(torques)))
    names = [*wheel_angle_names(count), *wheel_speed_names(count)]
    names += [f"ball_omega_{axis}" for axis in "xyz"] if bench == "upside_down" else []
    inputs = dict(zip(torque_names(count), torques.T, strict=True))
    inputs = {"t": sample_time * np.arange(len(torques), dtype=np.float64), **inputs}
    log, truth_log = (
        Log(inputs | dict(zip(names, np.array(rows).T, strict=True))) for rows in (measured, true)
    )
    return log, truth_log
