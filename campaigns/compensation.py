"""Compensate identified friction on the twin: the main job, over many seeds.

Logs are recorded on the nominal twin without compensation. The friction identified from them is compensated
on the same twin, 32 s of a 0.5 m square, with the same gain, on-board sensors and other seeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.presets import design_gain
from ballbot.control.references import figure_eight, square
from ballbot.estimation.interface import EstimatorName
from ballbot.identification import Bounds, Identification, identify
from ballbot.identification.stages import DEFAULT_OPTIONS, IdentificationOptions
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.twin import Twin
from ballbot.workflows.comparison import ComparedRun, Comparison, run_comparison
from campaigns.section import Section

RECORDED = 48.0  # seconds of each log
RUN = 32.0  # seconds of each run compared
SEEDS = tuple(range(100, 110))


def identified_robot(
    robot: Robot,
    *,
    recorded: float = RECORDED,
    bounds: Bounds | None = None,
    options: IdentificationOptions = DEFAULT_OPTIONS,
) -> Robot:
    """Return the robot with the friction identified from two logs of its nominal twin."""
    return identified(robot, recorded=recorded, bounds=bounds, options=options).robot


def identified(
    robot: Robot,
    *,
    recorded: float = RECORDED,
    bounds: Bounds | None = None,
    options: IdentificationOptions = DEFAULT_OPTIONS,
) -> Identification:
    """Return the identification from two logs of the robot's nominal twin, each `recorded` seconds long."""
    controller = Controller(robot, design_gain(robot).gain)
    logs = [
        simulate(Twin(robot), controller, reference, duration=recorded, seed=seed).without_truth()
        for seed, reference in ((1, square(side=0.5, period=32.0)), (2, figure_eight()))
    ]
    return identify(robot, logs, bounds=bounds, seed=0, options=options)


def compare_compensations(robot: Robot, *, seeds: Sequence[int]) -> Comparison:
    """Return the twin's position errors with no, full and partial compensation of the friction in `robot`."""
    gain = design_gain(robot).gain
    controllers = {kind: Controller(robot, gain, compensation=kind) for kind in ("none", "full", "partial")}
    runs = [
        ComparedRun(
            candidate=name,
            controller=controller,
            plant=partial(_twin, robot),
            reference=partial(square, side=0.5, period=32.0),
            duration=RUN,
            seed=seed,
        )
        for name, controller in controllers.items()
        for seed in seeds
    ]
    return run_comparison(runs)


def _twin(robot: Robot, _: EstimatorName) -> Twin:
    return Twin(robot)


def campaign() -> Section:
    """Run ten seeds and return the section of docs/generated/evidence.md."""
    comparison = compare_compensations(identified_robot(Robot.load("alten")), seeds=SEEDS)
    rows = []
    for name in ("none", "full", "partial"):
        scores, halved = comparison.scores_of(name), halvings(comparison, name)
        stood = [one for one in scores if one.ended is None]
        peaks = np.array([one.peak_position_error for one in stood])
        errors = (peaks.mean(), peaks.max(), np.mean([one.rms_position_error for one in stood]))
        rows.append(
            [
                name,
                *(f"{error:.3f}" for error in errors),
                f"{sum(halved)} of {len(halved)}",
                f"{len(scores) - len(stood)}",
            ]
        )
    return Section(
        title="Compensation of identified friction on the twin",
        before=f"{RUN:g} s of a 0.5 m square on the nominal twin, {len(SEEDS)} seeds, the same gain throughout; the "
        f"compensated friction is identified from two logs of the twin without compensation. Errors of the true"
        " position at least 6 s after each corner [m].",
        columns=[
            "compensation",
            "mean peak",
            "worst peak",
            "mean RMS",
            "peak at most half of none's",
            "falls",
        ],
        rows=rows,
    )


def halvings(comparison: Comparison, name: str) -> list[bool]:
    """Return, for each seed, whether this compensation at least halves the peak error of none, without a fall."""
    pairs = zip(comparison.scores_of(name), comparison.scores_of("none"), strict=True)
    return [
        one.ended is None and one.peak_position_error <= 0.5 * none.peak_position_error for one, none in pairs
    ]
