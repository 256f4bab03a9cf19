"""Measure the speed of the twin on one core, and the part of it that is not MuJoCo's.

OMP_NUM_THREADS=1 .venv/bin/python -m campaigns.evidence twin_speed
"""

from __future__ import annotations

from time import perf_counter

import numpy as np

from ballbot import Robot, simulate
from ballbot.control.presets import nominal_controller
from ballbot.control.references import hold
from ballbot.twin import Scenario, Twin
from campaigns.section import Section

DURATION = 20.0  # [s]
ROUNDS = 5


class Stopwatch:
    """Adds up the time that a twin's engine spends in MuJoCo's own step."""

    def __init__(self, twin: Twin) -> None:
        self._step = twin.engine.step
        twin.engine.step = self.step
        self.elapsed = 0.0

    def step(self) -> None:
        """Take a step."""
        started = perf_counter()
        self._step()
        self.elapsed += perf_counter() - started


def campaign() -> Section:
    """Return real-time factors and overheads, the median of some rounds."""
    robot = Robot.load("alten")
    rows = []
    for name in ("nominal", "single_row", "single_point", "resonant", "soft_ball"):
        scenario = Scenario.named(name, robot)
        plain, timed = Twin(robot, scenario), Twin(robot, scenario)
        watch = Stopwatch(timed)
        whole, own = np.empty(ROUNDS), np.empty(ROUNDS)  # times real time
        overhead = np.empty(ROUNDS)
        for k in range(ROUNDS):
            run, seconds = _closed_loop(robot, plain)
            watch.elapsed = 0.0
            _closed_loop(robot, timed)
            whole[k], own[k] = run / seconds, run / watch.elapsed
            overhead[k] = seconds / watch.elapsed - 1.0
        found = [float(np.median(values)) for values in (whole, own, overhead)]
        rows.append([name, f"{found[0]:.1f}", f"{found[1]:.1f}", f"{100 * found[2]:.0f} %"])
    return Section(
        title="The twin's speed",
        before=f"{DURATION:g} s in closed loop (LQR, on-board state, log) on one core, as a multiple of real time; "
        f"MuJoCo's `mj_step` alone with the same model in the same run, and the overhead of everything else. Median of "
        f"{ROUNDS} rounds.",
        columns=["scenario", "whole loop", "MuJoCo alone", "overhead"],
        rows=rows,
    )


def _closed_loop(robot: Robot, twin: Twin) -> tuple[float, float]:
    """Return how long the robot balanced and how long that took [s]."""
    controller = nominal_controller(robot)
    started = perf_counter()
    log = simulate(twin, controller, hold(), duration=DURATION, seed=1)
    return len(log) * log.sample_time, perf_counter() - started
