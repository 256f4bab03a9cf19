"""Figures IV.1 to IV.4."""

from __future__ import annotations

from matplotlib.figure import Figure

from ballbot.experiments.reproduce.bench import Bench
from ballbot.report.alignment import (
    orientation_error_figure,
    orientation_figure,
    position_error_figure,
    position_figure,
)


def figure_iv_1(bench: Bench) -> Figure:
    """Return the angles on board and by the cameras."""
    return orientation_figure(bench.alignments[0])


def figure_iv_2(bench: Bench) -> Figure:
    """Return the angles' errors."""
    return orientation_error_figure(bench.alignments[0])


def figure_iv_3(bench: Bench) -> Figure:
    """Return the position on board and by the cameras."""
    return position_figure(bench.alignments[0])


def figure_iv_4(bench: Bench) -> Figure:
    """Return the position's errors."""
    return position_error_figure(bench.alignments[0])
