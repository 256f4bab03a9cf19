"""Count the correct logs that the checks stop: 300 logs of the twin, over all presets, each checked with its preset.

.venv/bin/python -m campaigns.evidence false_alarms

A draw varies the reference, the controller, the scenario (wheels, noise, heading drift, play, friction, late and
unsteady torques, tilted floors, pushes, slow errors and latency of the sensors) and, by a few percent, the true
robot, because no preset describes its robot exactly.

Recorded logs are kept in build/false_alarms, each as soon as it is complete, and are not recorded again: an interrupted
campaign continues, and another version of the checks takes minutes. Delete the folder after a change of `drawn`.
"""

from __future__ import annotations

import os
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballbot.control.controller import Compensation, Controller
from ballbot.control.presets import NOMINAL_TORQUE_WEIGHT, design_gain
from ballbot.control.references import Reference, change_pose, circle, figure_eight, hold, square
from ballbot.findings import Finding
from ballbot.log import Log
from ballbot.log.checks import check_logs
from ballbot.processes import worker_pool
from ballbot.robot import Robot
from ballbot.robot.components import scaled_body, scaled_friction
from ballbot.simulation.imperfections import Push
from ballbot.simulation.run import simulate
from ballbot.simulation.sensors import SensorFaults
from ballbot.twin import Scenario, Twin
from ballbot.twin.faults import Softness, Timing
from campaigns.section import Section, is_kept

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
    duration: float  #: [s]


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
        duration=float(random.integers(10, 17)),
    )


def record(draw: Draw) -> Log:
    """Return the log that the robot's own sensors make of a draw, a fall's included."""
    design = design_gain(draw.robot, torque_weight=draw.torque_weight)
    known = draw.robot.replace(friction=draw.scenario.friction)
    controller = Controller(known, design.gain, compensation=draw.compensation)
    twin = Twin(draw.robot, draw.scenario)
    log = simulate(twin, controller, _reference(draw), duration=draw.duration, seed=draw.seed)
    return log.without_truth()


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
    return replace(
        base,
        sensors=sensors,
        friction=scaled_friction(base.friction, heavier * random.uniform(0.2, 1.5)),
        backlash=np.radians(random.uniform(0.0, 1.5)),
        torque_noise=heavier * base.torque_noise * random.uniform(0.0, 2.0),
        asymmetry=random.uniform(-0.2, 0.2),
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


KEPT = Path(__file__).parents[1] / "build" / "false_alarms"
LOGS = 300
#: stopped logs of `LOGS` that are still a pass
MOST_STOPPED = 3


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What the checks make of one correct log."""

    seed: int
    preset: str
    reference: str
    duration: float  #: [s], of the log
    findings: tuple[Finding, ...]  #: notes left out

    @property
    def errors(self) -> tuple[str, ...]:
        """Codes of the findings that would stop a command."""
        return tuple(finding.code for finding in self.findings if finding.severity == "error")


def outcome(seed: int, *, kept: Path | None = None) -> Outcome:
    """Record the log of a seed, or read it if it is kept, and check it with its nominal preset, as a user would."""
    draw = drawn(seed)
    path = None if kept is None else kept / f"{seed:04d}.parquet"
    if path is not None and path.exists():
        log = Log.read(path)
    else:
        log = record(draw)
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            log.write(path)
    return checked(draw, log)


def checked(draw: Draw, log: Log) -> Outcome:
    """Return what the checks make of a draw's log."""
    found = check_logs({"log": log}, robot=Robot.load(draw.preset))
    return Outcome(
        seed=draw.seed,
        preset=draw.preset,
        reference=draw.reference,
        duration=float(log.t[-1]),
        findings=tuple(finding for finding in found if finding.severity != "note"),
    )


def outcomes(seeds: Sequence[int], *, kept: Path | None = None, processes: int = 1) -> Iterator[Outcome]:
    """Yield the outcomes of seeds as they come."""
    if processes == 1:
        yield from (outcome(seed, kept=kept) for seed in seeds)
        return
    with worker_pool(processes) as pool:
        runs = [pool.submit(outcome, seed, kept=kept) for seed in seeds]
        yield from (run.result() for run in as_completed(runs))


def campaign() -> Section:
    """Check all logs and return the section of docs/generated/evidence.md."""
    for path in KEPT.glob("*.parquet"):
        is_kept(path)  # other processes read them
    return section(sorted(_followed(range(LOGS)), key=lambda one: one.seed))


def section(found: Sequence[Outcome]) -> Section:
    """Return the section of docs/generated/evidence.md that outcomes make."""
    stopped = [one for one in found if one.errors]
    named = "; ".join(
        f"seed {one.seed} ({one.preset}, {one.reference}): {', '.join(one.errors)}" for one in stopped
    )
    return Section(
        title="Correct logs that the checks stop",
        before=f"{len(found)} logs of the twin over all presets, {min(o.duration for o in found):.0f} to"
        f" {max(o.duration for o in found):.0f} s, with the references, noise, drift, play, delay, friction and"
        " imprecise robots that `campaigns/false_alarms.py` draws; `check_logs` with the nominal preset. An error"
        f" stops a command; at most {MOST_STOPPED} of {LOGS} may.",
        columns=["preset", "logs", "stopped by an error", "with a warning", "codes of warnings"],
        rows=[*(_row(one, [o for o in found if o.preset == one]) for one in PRESETS), _row("all", found)],
        after=f"Stopped: {named or 'none'}.",
    )


def _row(name: str, found: Sequence[Outcome]) -> list[str]:
    logs_of = defaultdict(set)
    for one in found:
        for finding in one.findings:
            if finding.severity == "warning":
                logs_of[finding.code].add(one.seed)
    warned = set[int]().union(*logs_of.values())
    codes = Counter({code: len(seeds) for code, seeds in logs_of.items()}).most_common()
    return [
        name,
        f"{len(found)}",
        f"{sum(bool(one.errors) for one in found)}",
        f"{len(warned)}",
        ", ".join(f"{code} {count}" for code, count in codes) or "none",
    ]


def _followed(seeds: Sequence[int]) -> Iterator[Outcome]:
    """Yield the outcomes of seeds; report every tenth on standard error."""
    stopped = 0
    for done, one in enumerate(outcomes(seeds, kept=KEPT, processes=os.cpu_count() or 1), start=1):
        stopped += bool(one.errors)
        if done % 10 == 0 or one.errors:
            codes = f"; seed {one.seed} ({one.preset}): {', '.join(one.errors)}" if one.errors else ""
            print(
                f"{done} of {len(seeds)} logs checked, {stopped} stopped{codes}", file=sys.stderr, flush=True
            )
        yield one
