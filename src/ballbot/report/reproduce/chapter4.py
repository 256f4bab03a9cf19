"""Figures 4.1 to 4.3."""

from __future__ import annotations

from matplotlib.figure import Figure

from ballbot.experiments.reproduce.bench import Bench
from ballbot.report.validation_figures import correlation_figure, symbols, trajectories_figure


def figure_4_1(bench: Bench) -> Figure:
    """Return measured and simulated states in closed loop."""
    closed = bench.validation.closed_loop
    assert closed is not None  # the log is of the controller that is given
    return trajectories_figure(closed.example, bench.validation.models.names)


def figure_4_2(bench: Bench) -> Figure:
    """Return measured and simulated states in open loop, of the run whose errors are the median ones."""
    opened = bench.validation.open_loop
    assert opened is not None  # nothing pushed the robot
    return trajectories_figure(opened.example, bench.validation.models.names)


def figure_4_3(bench: Bench) -> Figure:
    """Return the correlation matrix of residuals and torques, its significant cells framed."""
    found = bench.validation.residuals.correlations
    return correlation_figure(symbols(found.labels), found.matrix, marked=found.significant)
