"""Ten minutes of balancing on the nominal scenario, over many seeds.

.venv/bin/python -m campaigns.evidence twin_balance
"""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from ballbot import Robot, simulate
from ballbot.control.presets import nominal_controller
from ballbot.control.references import hold
from ballbot.processes import worker_pool
from ballbot.twin import Twin
from campaigns.section import Section

SEEDS = range(1, 21)
DURATION = 600.0  # [s]


@dataclass(frozen=True, kw_only=True)
class Balanced:
    """One run in numbers."""

    stood: float  #: how long [s]
    lean: float  #: largest [degrees]
    strayed: float  #: farthest from the spot, by the truth [m]
    sensed: float  #: the same as the robot's own sensors have it [m]
    turned: float  #: largest heading, by the truth [degrees]


def balance(seed: int, duration: float = DURATION) -> Balanced:
    """Balance on a spot without compensation, by the robot's own sensors."""
    robot = Robot.load("alten")
    log = simulate(Twin(robot), nominal_controller(robot), hold(), duration=duration, seed=seed)
    truth = log.truth()
    lean = np.degrees(np.arccos(np.cos(truth["theta"]) * np.cos(truth["phi"])))
    return Balanced(
        stood=len(log) * log.sample_time,
        lean=float(lean.max()),
        strayed=float(np.hypot(truth["x"], truth["y"]).max()),
        sensed=float(np.hypot(log["x"], log["y"]).max()),
        turned=float(np.degrees(np.abs(truth["psi"]).max())),
    )


def campaign() -> Section:
    """Return what became of every seed."""
    with worker_pool(os.cpu_count()) as pool:
        runs = list(pool.map(balance, SEEDS))
    falls = sum(run.stood < DURATION - 0.01 for run in runs)
    columns = ["", "worst", "median"]
    rows = [
        [name, f"{pick(values):.2f}", f"{np.median(values):.2f}"]
        for name, pick, values in (
            ("stood [s]", min, [run.stood for run in runs]),
            ("largest lean [deg]", max, [run.lean for run in runs]),
            ("farthest from the spot, by its own sensors [m]", max, [run.sensed for run in runs]),
            ("farthest from the spot, true [m]", max, [run.strayed for run in runs]),
            ("turned away, true [deg]", max, [run.turned for run in runs]),
        )
    ]
    return Section(
        title="Ten minutes on the nominal twin",
        before=f"The nominal gain (an LQR of the exact model), no compensation, on-board state only, {DURATION / 60:g} "
        f"minutes, {len(runs)} seeds: {falls} falls.",
        columns=columns,
        rows=rows,
        after="The robot holds the heading of its AHRS and turns with its drift, which alone causes "
        f"{np.degrees(Robot.load('alten').sensors.heading_drift) * DURATION:.0f} degrees. Its frame turns as a whole, "
        "so the lean that it feeds back stays right about its wheels, and on one spot its own place, too.",
    )
