"""What a controller design shows: A and B of x_dot = A x + B u about upright, and the figure of a robust design.

The matrices go into results.json in full precision, and into text. The exact model's are the ones to design with. The
thesis's formulation stands beside them only where it is marked as what it is. The figure shows how the search went,
and what it gained on robots it had not seen.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ballbot.log.columns import STATE_NAMES, torque_names, unit_of
from ballbot.report.style import BLUE, GREEN, ORANGE, SHADE, Line
from ballbot.workflows.perturbed_robots import TAIL
from ballbot.workflows.robust_design import RobustDesign

if TYPE_CHECKING:
    from ballbot.mechanics.model import LinearModel, Model

#: what is wrong with each matrix that the thesis's mistakes are in; numbers: docs/generated/reproduce.md
MISTAKEN_MATRICES = {
    "T_trw": "the thesis's mistake 6: without the motors' counter-torque; the exact model does not use it",
    "T_owr": "the thesis's mistake 8: absolute spin, where motor, friction and encoder have the speed against the "
    "body; the exact model does not use it",
}
MISTAKEN_LINEARIZATION = (
    "the thesis's mistakes 5, 6, 7 and 17 (docs/generated/reproduce.md): to compare with, not to design with"
)


def linearization_results(model: Model) -> dict[str, object]:
    """Return what results.json holds of a model's linearization, the thesis's formulation marked beside it.

    Parameters
    ----------
    model : Model
        In the exact formulation, with the friction whose viscous part is to be in A.
    """
    names = [*STATE_NAMES]
    return {
        "about": "upright, at rest, psi = 0; viscous friction only",
        "state": names,
        "state_units": [unit_of(name) for name in names],
        "input": [*torque_names(model.robot.wheel_count)],
        "input_unit": "N m",
        "exact": _matrices(model.linearize()),
        "thesis": {"mistake": MISTAKEN_LINEARIZATION}
        | _matrices(replace(model, formulation="thesis").linearize()),
    }


def state_order(wheel_count: int) -> str:
    """Return what the rows and columns of A and B are, as a line of text."""
    states = ", ".join(f"{name} [{unit_of(name)}]" for name in STATE_NAMES)
    return f"x = {states}\nu = {', '.join(torque_names(wheel_count))} [N m]"


def _matrices(linear: LinearModel) -> dict[str, object]:
    return {"A": linear.A.tolist(), "B": linear.B.tolist()}


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
    for name, rival in found.rivals.items():
        share = 100.0 * (np.arange(len(rival.costs)) + 0.5) / len(rival.costs)
        axes.plot(share, np.sort(rival.costs), label=_LABELS[name], **_LINES[name])
    axes.set_yscale("log")
    axes.set_yticks([1, 2, 5, 10, 20], labels=["1", "2", "5", "10", "20"])
    axes.minorticks_off()
    axes.set_xlim(0.0, 100.0)
    axes.set_ylim(0.9, 1.3 * max(float(rival.costs.max()) for rival in found.rivals.values()))
    axes.set_xlabel("share of the robots that cost less [%]")
    axes.set_ylabel("J")
    axes.set_title(f"{found.fresh} robots that the search had not seen")
    axes.legend(loc="upper left", fontsize=7.5)
