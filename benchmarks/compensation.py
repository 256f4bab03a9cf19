"""Identified friction compensation on the twin: what the main job is for, over many seeds.

Logs are recorded on the nominal twin without compensation; the friction identified from them alone is compensated
on the same twin, 32 s of a 0.5 m square, with the same gain, on-board sensors and other seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ballbot.control.controller import Controller
from ballbot.control.nominal import design_gain
from ballbot.control.references import figure_eight, square
from ballbot.experiments.compare import Comparison, compare
from ballbot.identification import identify
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.twin import Twin

RECORDED = 48.0  # seconds of each log
RUN = 32.0  # seconds of each run compared


def identified_robot(robot: Robot) -> Robot:
    """Return the robot with the friction that two recorded logs of its nominal twin tell."""
    controller = Controller(robot, design_gain(robot).gain)
    logs = [
        simulate(Twin(robot), controller, reference, duration=RECORDED, seed=seed).without_truth()
        for seed, reference in ((1, square(side=0.5, period=32.0)), (2, figure_eight()))
    ]
    return identify(robot, logs, seed=0).robot


def compare_compensations(
    robot: Robot, *, seeds: Sequence[int], progress: Callable[[float], None] | None = None
) -> Comparison:
    """Return the twin's position errors with no, full and partial compensation of the friction in `robot`."""
    gain = design_gain(robot).gain
    controllers = {kind: Controller(robot, gain, compensation=kind) for kind in ("none", "full", "partial")}
    reference = square(side=0.5, period=32.0)
    return compare(
        lambda: Twin(robot), controllers, reference, duration=RUN, seeds=seeds, threads=2, progress=progress
    )


def table(seeds: Sequence[int] = tuple(range(100, 110))) -> str:
    """Return the campaign's Markdown table."""
    comparison = compare_compensations(identified_robot(Robot.load("alten")), seeds=seeds)
    lines = [
        f"32 s of a 0.5 m square on the nominal twin, {len(seeds)} seeds, friction identified from the twin's own logs;"
        " errors at least 6 s after each corner.",
        "",
        "| compensation | mean peak error [m] | worst peak [m] | mean RMS error [m] | runs that peak at most half | falls |",
        "|---|---|---|---|---|---|",
    ]
    for name in ("none", "full", "partial"):
        summary = comparison.summary(name)
        halved = halvings(comparison, name)
        lines.append(
            f"| {name} | {summary.peak_position_error:.3f} | {summary.worst_position_error:.3f} "
            f"| {summary.rms_position_error:.3f} | {sum(halved)} of {len(halved)} | {summary.falls} |"
        )
    return "\n".join(lines)


def halvings(comparison: Comparison, name: str) -> list[bool]:
    """Return, for each seed, whether this compensation at least halves the peak error of none, without a fall."""
    pairs = zip(comparison.scores[name], comparison.scores["none"], strict=True)
    return [
        one.ended is None and one.peak_position_error <= 0.5 * none.peak_position_error for one, none in pairs
    ]
