"""The figure of a robust design: how the search went, and what it gained on robots it had not seen."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ballbot.report.style import BLUE, GREEN, ORANGE, SHADE, Line
from ballbot.workflows.perturbed_robots import TAIL
from ballbot.workflows.robust_design import RobustDesign

_LINES: dict[str, Line] = {
    "robust": {"color": BLUE, "linestyle": "-", "linewidth": 2.0},
    "nominal": {"color": ORANGE, "linestyle": "--", "linewidth": 1.4},
    "plain": {"color": GREEN, "linestyle": "-.", "linewidth": 1.4},
}
_LABELS = {"robust": "weights found", "nominal": "nominal weights", "plain": "plain LQR, Q = I and R = I"}


def robust_figure(found: RobustDesign) -> Figure:
    """Draw the best worst tenth over the generations, and each design's costs on the fresh robots in order of size."""
    figure = Figure(figsize=(7.4, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.6))
    generations = np.arange(1, len(found.history) + 1)
    left.step(generations, found.history, where="post", **_LINES["robust"])
    left.set_ylim(0.0, 1.1 * found.history[0])
    left.set_xlabel("generation")
    left.set_ylabel("best worst tenth of J")
    left.set_title("the search")
    _draw_costs(right, found)
    return figure


def _draw_costs(axes: Axes, found: RobustDesign) -> None:
    axes.axvspan(100.0 * (1.0 - TAIL), 100.0, color=SHADE, label="worst tenth")
    for name, design in found.compared.items():
        share = 100.0 * (np.arange(len(design.costs)) + 0.5) / len(design.costs)
        axes.plot(share, np.sort(design.costs), label=_LABELS[name], **_LINES[name])
    axes.set_yscale("log")
    axes.set_yticks([1, 2, 5, 10, 20], labels=["1", "2", "5", "10", "20"])
    axes.minorticks_off()
    axes.set_xlim(0.0, 100.0)
    axes.set_ylim(0.9, 1.3 * max(float(design.costs.max()) for design in found.compared.values()))
    axes.set_xlabel("share of the robots that cost less [%]")
    axes.set_ylabel("J")
    axes.set_title(f"{found.fresh} robots that the search had not seen")
    axes.legend(loc="upper left", fontsize=7.5)
