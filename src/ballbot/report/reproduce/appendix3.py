"""Figure III.1: a simulated swing and the pendulum fitted to it."""

from __future__ import annotations

from matplotlib.figure import Figure

from ballbot.experiments.reproduce.bench import Bench
from ballbot.report.bench import swing_figure


def figure_iii_1(bench: Bench) -> Figure:
    """Return the first simulated swing, the fitted pendulum and their difference."""
    return swing_figure(bench.swings[0], label="simulated, with the tracking's error")
