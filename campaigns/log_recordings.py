"""The sound recordings of `campaigns.log_faults`, of the twin and the equations of motion over all presets.

A draw varies the reference, the controller, the scenario (wheels, noise, heading drift, play, friction, late and
unsteady torques, tilted floors, pushes, slow errors and latency of the sensors) and, by a few percent, the true
robot, because no preset describes its robot exactly. Every fifth robot is the twin; the others are simulated by the
equations of motion, with what these have of the scenario, which takes a fraction of the twin's time.

Recordings are kept in build/log_faults, each as soon as it is complete, and are not recorded again. Delete the folder
after a change of `drawn`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballbot.control.controller import Compensation, Controller
from ballbot.control.presets import NOMINAL_TORQUE_WEIGHT, design_gain
from ballbot.control.references import Reference, change_pose, circle, figure_eight, hold, square
from ballbot.log import Log
from ballbot.robot import Robot
from ballbot.robot.components import scaled_body, scaled_friction
from ballbot.simulation.imperfections import Push
from ballbot.simulation.plant import Plant
from ballbot.simulation.run import simulate
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.simulation.sensors import SensorFaults
from ballbot.twin import Scenario, Twin
from ballbot.twin.faults import Softness, Timing
from ballbot.twin.imperfections import imperfections_of, true_model
from campaigns.faulty_twins import asymmetric
from campaigns.section import is_kept

PRESETS = ("alten", "cmu", "kugle", "rezero", "rob311")
REFERENCES = ("hold", "square", "circle", "figure_eight", "change_pose")
#: [kg m^2], in place of a preset's own, which is more than its body could have
WHEEL_INERTIA = {"rob311": 5e-5}
#: half of the logs are of the nominal wheels
SCENARIOS = ("nominal",) * 5 + ("wide_rows", "single_row", "single_point", "resonant", "soft_ball")
COMPENSATIONS: tuple[Compensation, ...] = ("none", "none", "full", "partial")
#: [kg], the body that the nominal scenario's friction and noise belong to
NOMINAL_MASS = 17.076


@dataclass(frozen=True, kw_only=True)
class Draw:
    """One log's settings; together with the seed they make it, bit for bit."""

    seed: int
    preset: str
    reference: str
    scenario: Scenario
    robot: Robot  #: the true one
    compensation: Compensation
    torque_weight: float  #: of the LQR [1/(N m)^2]
    twin: bool  #: or the equations of motion
    duration: float = 64.0  #: [s]


def drawn(seed: int) -> Draw:
    """Return the settings of one log; presets and references take turns, so that every pair comes up."""
    random = np.random.default_rng([13, seed])
    preset = PRESETS[seed % len(PRESETS)]
    robot = _true_robot(preset, random)
    scenario = _scenario(robot, SCENARIOS[random.integers(len(SCENARIOS))], random)
    return Draw(
        seed=seed,
        preset=preset,
        reference=REFERENCES[seed // len(PRESETS) % len(REFERENCES)],
        scenario=scenario,
        robot=robot,
        compensation=COMPENSATIONS[random.integers(len(COMPENSATIONS))],
        torque_weight=NOMINAL_TORQUE_WEIGHT * 3.0 ** random.uniform(-1.0, 1.0),
        twin=(seed + seed // len(PRESETS)) % len(PRESETS) == 0,
    )


def record(draw: Draw) -> Log:
    """Return the log that the robot's own sensors make of a draw, up to a fall."""
    design = design_gain(draw.robot, torque_weight=draw.torque_weight)
    known = draw.robot.replace(friction=draw.scenario.friction)
    controller = Controller(known, design.gain, compensation=draw.compensation)
    log = simulate(_plant(draw), controller, _reference(draw), duration=draw.duration, seed=draw.seed)
    return log.without_truth()


def _plant(draw: Draw) -> Plant:
    if draw.twin:
        return Twin(draw.robot, draw.scenario)
    friction = asymmetric(draw.scenario.friction, 0.0)
    scenario = replace(draw.scenario, friction=friction, pushes=(), softness=None, compliance=None)
    if scenario.timing is not None:
        scenario = replace(scenario, timing=replace(scenario.timing, jitter=0.0))
    return SensedPlant(true_model(draw.robot, scenario), imperfections_of(scenario))


def _true_robot(preset: str, random: np.random.Generator) -> Robot:
    """Return the preset with a body that was weighed to 3 % and measured to 2 %."""
    robot = Robot.load(preset)
    if preset in WHEEL_INERTIA:
        robot = robot.replace(wheels=replace(robot.wheels, inertia=WHEEL_INERTIA[preset]))
    mass, height = random.normal(1.0, 0.015), random.normal(1.0, 0.01)  # 2 sigma: 3 %, 2 %
    return robot.replace(body=scaled_body(robot.body, mass=mass, height=height))


def _scenario(robot: Robot, name: str, random: np.random.Generator) -> Scenario:
    base = Scenario.named(name, robot)
    heavier = robot.body.mass / NOMINAL_MASS
    noise = random.uniform(0.3, 2.0)  # of gyro and attitude, times the nominal
    sensors = replace(
        base.sensors,
        gyro_noise=noise * base.sensors.gyro_noise,
        attitude_noise=noise * base.sensors.attitude_noise,
        heading_drift=random.uniform(-3e-3, 3e-3),  # [rad/s], twice the thesis's
    )
    friction = scaled_friction(base.friction, heavier * random.uniform(0.2, 1.5))
    backlash = np.radians(random.uniform(0.0, 1.5))
    torque_noise = heavier * base.torque_noise * random.uniform(0.0, 2.0)
    return replace(
        base,
        sensors=sensors,
        friction=asymmetric(friction, random.uniform(-0.2, 0.2)),
        backlash=backlash,
        torque_noise=torque_noise,
        speed_window=int(random.integers(1, 5)),
        floor_tilt=tuple(np.radians(random.normal(0.0, 0.3, 2)).tolist()),
        timing=_timing(sensors.sample_time, random),
        pushes=_pushes(robot, random),
        sensor_faults=_sensor_faults(sensors.sample_time, random),
        softness=_softness(base, heavier),
    )


def _softness(base: Scenario, heavier: float) -> Softness | None:
    """Return the scenario's softness for a robot of another weight, which sinks in as deep."""
    soft = base.softness
    # the twin's steps of 0.5 ms are stable up to 310 N s/m
    return soft and Softness(stiffness=heavier * soft.stiffness, damping=min(heavier * soft.damping, 300.0))


def _timing(sample_time: float, random: np.random.Generator) -> Timing | None:
    """Half of the robots are up to 2 samples late and wander by up to a tenth of one."""
    if random.random() < 0.5:
        return None
    return Timing(delay=int(random.integers(0, 3)), jitter=random.uniform(0.0, 0.1) * sample_time)


def _pushes(robot: Robot, random: np.random.Generator) -> tuple[Push, ...]:
    """A fifth of the robots are pushed once, sideways at the top, by up to 2 % of their weight for 0.2 s."""
    if random.random() < 0.8:
        return ()
    size, way = 0.02 * robot.gravity * robot.body.mass * random.random(), random.uniform(0.0, 2.0 * np.pi)
    force = (float(size * np.cos(way)), float(size * np.sin(way)), 0.0)
    height = 2.0 * robot.body.center_of_mass
    return (Push(time=float(random.integers(5, 12)), duration=0.2, force=force, height=height),)


def _sensor_faults(sample_time: float, random: np.random.Generator) -> SensorFaults | None:
    """A third of the robots' AHRS errs slowly by up to 3 mrad and is late by up to one sample."""
    if random.random() < 2.0 / 3.0:
        return None
    return SensorFaults(
        gyro_bias=random.uniform(0.0, 2e-3),
        lean_error=random.uniform(0.0, 3e-3),
        latency=sample_time * int(random.integers(0, 2)),
    )


def _reference(draw: Draw) -> Reference:
    random = np.random.default_rng([14, draw.seed])
    size, period = random.uniform(0.2, 1.0), random.uniform(16.0, 40.0)  # [m], [s]
    if draw.reference == "hold":
        return hold()
    if draw.reference == "square":
        return square(side=0.6 * size, period=period)
    if draw.reference == "circle":
        return circle(radius=0.5 * size, period=period)
    if draw.reference == "figure_eight":
        return figure_eight(length=size, width=0.5 * size, period=period)
    turn = random.uniform(-np.pi, np.pi)
    return change_pose(
        x=size, y=random.uniform(-1.0, 1.0) * size, psi=turn, at=3.0, ramp=random.uniform(3.0, 8.0)
    )


RECORDINGS = 50
KEPT = Path(__file__).parents[1] / "build" / "log_faults"


def recording(seed: int) -> Log:
    """Return the log of a seed, from `KEPT` if it was recorded before."""
    path = KEPT / f"{seed:04d}.parquet"
    if not is_kept(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        record(drawn(seed)).write(path)
    return Log.read(path)
