"""A recorded run of the twin: its log, the true values, and motion capture.

log                  the columns that a real robot logs
truth                the same rows with the true values
motion_capture       the ball's centre and the body's orientation, in the cameras' frame and time; not on the bench

Motion capture has a frame, a clock and noise of its own, which follow from a seed:

    t_camera = (1 + clock_rate) t + clock_offset
    p_camera = R_camera_world p + origin
    q_camera_body = q_camera_world q_world_body

The alignment of log and cameras is tested against this setup.

`twin_findings` checks whether the twin can simulate a robot and the nominal controller can balance it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from ballbot.control.interface import Feedback
from ballbot.control.presets import nominal_controller
from ballbot.control.references import Reference
from ballbot.errors import InputError
from ballbot.estimation.interface import state_errors
from ballbot.findings import Finding, error, warning
from ballbot.log import Log
from ballbot.progress import ProgressCallback, ignore_progress
from ballbot.results import to_results
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.twin.bench import Bench, bench_torques, run_bench
from ballbot.twin.mjcf import twin_mjcf
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import Twin


@dataclass(frozen=True, kw_only=True)
class MotionCapture:
    """A motion-capture system: its rate, frame, clock and noise."""

    seed: int
    rate: float  #: [Hz]
    origin: tuple[float, float, float]  #: the world frame's origin in the cameras' frame [m]
    rotation_wxyz: tuple[float, float, float, float]  #: unit quaternion, world to cameras
    clock_offset: float  #: the cameras' time at the log's zero [s]
    clock_rate: float  #: how much faster the cameras' clock runs [s/s]
    position_noise: float  #: standard deviation of each coordinate [m]
    orientation_noise: float  #: standard deviation about each axis [rad]

    @staticmethod
    def drawn(seed: int) -> MotionCapture:
        """Return a random setup: 120 Hz, any place and heading, nearly level."""
        random = np.random.default_rng([seed, 120])  # not the stream of the twin with that seed
        tilt_x, tilt_y = random.normal(0.0, 0.01, 2)  # frame's tilt: N(0, 0.01 rad) about each level axis
        heading = random.uniform(-np.pi, np.pi)  # frame's heading: U(-pi, pi)
        rotation = Rotation.from_euler("XYZ", [tilt_x, tilt_y, heading])
        x, y, z, w = rotation.as_quat().tolist()
        origin = random.uniform(-2.0, 2.0, 3)  # place: U(-2 m, 2 m) along each axis
        return MotionCapture(
            seed=seed,
            rate=120.0,
            origin=(float(origin[0]), float(origin[1]), float(origin[2])),
            rotation_wxyz=(w, x, y, z),
            clock_offset=float(random.uniform(2.0, 6.0)),  # cameras started first: U(2 s, 6 s)
            clock_rate=float(random.normal(0.0, 2e-5)),  # two quartz clocks: N(0, 20 ppm)
            position_noise=2e-4,
            orientation_noise=1e-3,
        )

    def record(self, truth: Log, *, ball_radius: float) -> Log:
        """Return the motion capture of a run by its true t, x, y, theta, phi, psi, linear between samples.

        The ball's centre is `ball_radius` [m] above the floor. The log has t [s]; x y z [m], the ball's centre;
        qw qx qy qz, body to cameras' frame, without jumps of sign.
        """
        truth.require("x", "y", "theta", "phi", "psi")
        start, end = float(truth.t[0]), float(truth.t[-1])
        t = start + np.arange(int((end - start) * self.rate) + 1) / self.rate
        pose = {name: np.interp(t, truth.t, truth[name]) for name in ("x", "y", "theta", "phi", "psi")}
        random = np.random.default_rng([self.seed, 121])
        w, *xyz = self.rotation_wxyz
        camera_world = Rotation.from_quat([*xyz, w])
        centers = np.column_stack((pose["x"], pose["y"], np.full(len(t), ball_radius)))
        centers = camera_world.apply(centers) + self.origin
        centers += self.position_noise * random.standard_normal(centers.shape)
        angles = np.column_stack((pose["theta"], pose["phi"], pose["psi"]))
        wobble = Rotation.from_rotvec(self.orientation_noise * random.standard_normal(centers.shape))
        quaternions = (camera_world * Rotation.from_euler("XYZ", angles) * wobble).as_quat()
        # the sign of each next to its predecessor's
        turned = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0, -1.0, 1.0)
        quaternions *= np.concatenate(([1.0], np.cumprod(turned)))[:, None]
        columns = {"t": (1.0 + self.clock_rate) * t + self.clock_offset}
        columns |= dict(zip("xyz", centers.T, strict=True))
        columns |= {name: quaternions[:, i] for name, i in (("qw", 3), ("qx", 0), ("qy", 1), ("qz", 2))}
        return Log(columns)


#: balancing along a reference; the thesis's two experiments with the robot held
Experiment = Literal["balance", "driveline_sweep", "upside_down"]

_BENCHES: dict[str, Bench] = {"driveline_sweep": "stand", "upside_down": "upside_down"}

#: default duration of each experiment [s]; the sweep has two periods of 62.83 s
DURATIONS: dict[Experiment, float] = {"balance": 40.0, "driveline_sweep": 125.66, "upside_down": 60.0}


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A run of the twin."""

    run: Log  #: with the true states beside the measured ones if the robot balances
    logs: Mapping[str, Log]  #: by the names above
    results: Mapping[str, object]  #: the run in numbers, SI units


def record_balance(
    twin: Twin,
    controller: Feedback,
    reference: Reference,
    *,
    duration: float,
    seed: int = 0,
    progress: ProgressCallback = ignore_progress,
) -> Recording:
    """Run the twin in closed loop for a duration [s], with motion capture.

    The seed is that of the twin, its noise, and the cameras' frame, clock and noise. InputError if the duration is not
    at least a sample, or the controller's sample time is not one of the twin's.
    """
    run = simulate(twin, controller, reference, duration=duration, seed=seed, progress=progress)
    mocap = MotionCapture.drawn(seed).record(run.truth(), ball_radius=twin.robot.ball.radius)
    logs = {"log": run.without_truth(), "truth": run.truth(), "motion_capture": mocap}
    return Recording(run=run, logs=logs, results=results(run))


def record_bench(
    robot: Robot,
    scenario: Scenario,
    experiment: Experiment,
    *,
    duration: float,
    seed: int = 0,
    progress: ProgressCallback = ignore_progress,
) -> Recording:
    """Drive the motors of the robot held on the bench; see `ballbot.twin.bench`."""
    bench = _BENCHES[experiment]
    torques = bench_torques(robot, scenario, bench=bench, duration=duration, seed=seed)
    log, truth = run_bench(robot, scenario, torques, bench=bench, seed=seed, progress=progress)
    numbers = {"ended": None, "peak_wheel_speed": float(np.abs(truth.wheel_speeds).max())}
    return Recording(run=log, logs={"log": log, "truth": truth}, results=numbers)


def results(log: Log) -> dict[str, object]:
    """Return why a balancing run with its truth stopped early, `ended`, and the on-board state's `estimation_errors`.

    These are those of `ballbot.estimation.interface`; None if the run has a single row.
    """
    errors = None if len(log) < 2 else to_results(state_errors(log.t, log.states, log.truth().states))
    return {"ended": log.ended, "estimation_errors": errors}


def twin_findings(robot: Robot) -> tuple[Finding, ...]:
    """Return why `ballbot record nominal` would refuse a robot; empty if it records it."""
    findings = []
    try:  # without MuJoCo, only the document can be checked
        (Twin if find_spec("mujoco") else twin_mjcf)(robot, Scenario.nominal(robot))
    except InputError as refusal:
        text = f"The twin cannot simulate this robot, so `ballbot record` refuses it: {refusal}"
        findings.append(warning("robot-twin", text))
    try:
        nominal_controller(robot)
    except InputError as refusal:
        text = f"No nominal controller can be designed for this robot: {refusal}"
        findings.append(error("robot-balance", text))
    return tuple(findings)
