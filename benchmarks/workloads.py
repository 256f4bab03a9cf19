"""The page of the timings, the machine, and the states that they start from."""

import platform
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.presets import design_gain
from ballbot.control.references import square
from ballbot.log import STATE_NAMES, Log
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.twin import Scenario

PAGE = Path(__file__).parents[1] / "docs" / "generated" / "benchmarks.md"
SAMPLES = 100
#: standard deviations of good sensors' noise, for x y theta phi psi and their rates
NOISE = np.array([1e-4, 1e-4, 5e-4, 5e-4, 5e-4, 1e-3, 1e-3, 7e-4, 7e-4, 7e-4])


def nominal_robot() -> Robot:
    """Return `alten` with the nominal scenario's friction, full Stribeck on each wheel."""
    robot = Robot.load("alten")
    return robot.replace(friction=Scenario.nominal(robot).friction)


def smooth(robots: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return starts (robots, 10) and torques (robots, samples, 3) in which no wheel changes its sign."""
    start = np.array([0, 0, 0.002, -0.003, 0.4, 0.6, 0.2, 0.0, 0.0, 8.0])
    spread = 1e-3 * np.random.default_rng(0).standard_normal((robots, 10))
    return start + spread, np.tile([-0.35, -0.35, -0.35], (robots, SAMPLES, 1))


def balancing(robots: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return starts (robots, 10) and torques (robots, samples, 3) out of a run around a square without compensation.

    In the run wheels stick in some half of all steps.
    """
    robot = nominal_robot()
    log = simulate(Model(robot), Controller(robot, design_gain(robot).gain), square(), duration=64.0)
    first = np.random.default_rng(1).integers(0, len(log) - SAMPLES, robots)
    return log.states[first], log.torques[first[:, None] + np.arange(SAMPLES)]


def measured_square(robot: Robot, *, duration: float, period: float) -> Log:
    """Return the log of a robot balanced around a square, with `NOISE` in its states."""
    controller = Controller(robot, design_gain(robot).gain)
    log = simulate(Model(robot), controller, square(period=period), duration=duration).without_truth()
    noise = NOISE * np.random.default_rng(1).standard_normal((len(log), 10))
    return log.with_columns({name: log[name] + noise[:, i] for i, name in enumerate(STATE_NAMES)})


def processor() -> str:
    """Return the processor's name as the machine gives it."""
    for line in Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else ():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
