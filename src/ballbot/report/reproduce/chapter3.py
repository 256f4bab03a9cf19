"""Figures 3.1, 3.2, 3.4 and 3.5."""

from __future__ import annotations

from matplotlib.figure import Figure

from ballbot.experiments.reproduce.bench import Bench
from ballbot.report.bench import movement_figure
from ballbot.report.driveline import measured_figure, torque_speed_figure
from ballbot.report.reproduce.lines import BASIC_LABELS, THESIS_EQUATIONS, Shown, paths_figure
from ballbot.report.style import WITH_FRICTION, WITHOUT_FRICTION


def figure_3_1(bench: Bench) -> Figure:
    """Return torque over speed of the three free wheels."""
    return measured_figure(bench.sweeps)


def figure_3_2(bench: Bench) -> Figure:
    """Return torque over speed of wheel 1, measured and of both models."""
    return torque_speed_figure(bench.sweeps[0], bench.driveline_fit)


def figure_3_4(bench: Bench) -> Figure:
    """Return the ball's rotation about each axis with friction and without."""
    return movement_figure(bench.ball_movement)


def figure_3_5(bench: Bench) -> Figure:
    """Return the paths of the models about the origin, from the first of their starts."""
    runs = [
        Shown(label="with friction", log=bench.standing["friction"][0], line=WITH_FRICTION),
        Shown(label=BASIC_LABELS["thesis"], log=bench.standing["thesis"][0], line=THESIS_EQUATIONS),
        Shown(label=BASIC_LABELS["exact"], log=bench.standing["exact"][0], line=WITHOUT_FRICTION),
    ]
    return paths_figure(runs, ball_radius=bench.robot.ball.radius, goal=False)
