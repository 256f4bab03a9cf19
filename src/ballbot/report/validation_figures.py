"""Figures of a validation: the error against the horizon, and the residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from ballbot.log import STATE_NAMES
from ballbot.report.palette import BLUE, INK, MUTED, ORANGE
from ballbot.report.series import IN_TURN
from ballbot.report.style import (
    LOOKS,
    MARKS,
    STATE_SYMBOLS,
    STATE_UNITS,
    WITH_FRICTION,
    WITHOUT_FRICTION,
    label_of,
)
from ballbot.validation.models import FINEST
from ballbot.validation.prediction import HorizonComparison
from ballbot.validation.residuals import SpeedEffect


def horizon_figure(horizon: HorizonComparison, names: tuple[str, str]) -> Figure:
    """Return the forecast's RMSE against how far it looks ahead, a panel for each state.

    A filled dot is a horizon at which the first model is better by the whole interval, an empty one where it is not.
    """
    figure = Figure(figsize=(7.4, 3.6), layout="constrained")
    panels = figure.subplots(2, 5, sharex=True)
    errors = horizon.errors
    ahead, better = 1e3 * errors.horizons, errors.ratio_interval()[0] > 1.0
    # what is below any sensor's resolution is drawn at it
    first_model, second_model = np.maximum(errors.rmse, FINEST)
    for index, (axes, name) in enumerate(zip(panels.flat, STATE_NAMES, strict=True)):
        first = first_model[:, index]
        axes.loglog(ahead, first, label=label_of(names[0]), **WITH_FRICTION)
        axes.loglog(ahead, second_model[:, index], label=label_of(names[1]), **WITHOUT_FRICTION)
        axes.loglog(
            ahead, horizon.noise_floor[:, index], label="noise of the start alone", color=MUTED, linestyle=":"
        )
        for which, face in ((better[:, index], BLUE), (~better[:, index], "white")):
            axes.loglog(ahead[which], first[which], "o", color=BLUE, markerfacecolor=face, markersize=3)
        axes.set_title(f"{STATE_SYMBOLS[name]} [{STATE_UNITS[name]}]")
        axes.set_xticks([10, 100, 500], ["10", "100", "500"])
        axes.xaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_minor_locator(NullLocator())
        axes.tick_params(labelsize=7)
    for axes in panels[-1]:
        axes.set_xlabel("ahead [ms]")
    for axes in panels[:, 0]:
        axes.set_ylabel("RMSE")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=2)
    return figure


#: sides of a map of few cells and of all [in]
_SMALLEST, _LARGEST = 3.2, 5.6


def correlation_figure(
    labels: Sequence[str],
    correlation: NDArray[np.float64],
    *,
    marked: NDArray[np.bool_] | None = None,
) -> Figure:
    """Return a correlation matrix as a map with its numbers; what correlates with nothing is left out.

    Cells that are `marked`, the significant ones, have a frame.
    """
    known, inches = np.flatnonzero(np.isfinite(correlation).any(axis=1)).tolist(), _LARGEST
    if 0 < len(known) < len(labels):
        among = np.ix_(known, known)
        inches = max(_SMALLEST, inches * len(known) / len(labels))
        labels, correlation = [labels[place] for place in known], correlation[among]
        marked = None if marked is None else marked[among]
    figure = Figure(figsize=(inches, inches), layout="constrained")
    axes = figure.subplots()
    for (row, column), value in np.ndenumerate(correlation[::-1]):
        if not np.isfinite(value):
            continue
        # the page shows through a color, so that a small number is pale in either theme
        fill = to_rgba(ORANGE if value > 0.0 else BLUE, alpha=min(abs(value), 1.0))
        axes.add_patch(Rectangle((column, row), 1.0, 1.0, facecolor=fill, edgecolor="white", linewidth=0.6))
        if abs(value) >= 0.095:
            color = "white" if abs(value) > 0.6 else INK
            at = (column + 0.5, row + 0.5)
            axes.text(*at, _two_digits(value), ha="center", va="center", fontsize=6.3, color=color)
    if marked is not None:
        for row, column in np.argwhere(marked[::-1]):
            place = (column + 0.06, row + 0.06)
            axes.add_patch(Rectangle(place, 0.88, 0.88, fill=False, edgecolor=INK, linewidth=0.8))
    count = len(labels)
    axes.set(xlim=(0.0, count), ylim=(0.0, count), aspect="equal")
    axes.set_xticks(np.arange(count) + 0.5, labels, rotation=90)
    axes.set_yticks(np.arange(count) + 0.5, labels[::-1])
    axes.grid(visible=False)
    axes.tick_params(length=0, labelsize=7.5, labelcolor=INK)
    for spine in axes.spines.values():
        spine.set_visible(False)
    legend = [Patch(color=ORANGE, label="positive"), Patch(color=BLUE, label="negative")]
    if marked is not None:
        legend.append(Patch(facecolor="none", edgecolor=INK, label="significant"))
    figure.legend(handles=legend, loc="outside upper left", ncols=len(legend))
    return figure


def _two_digits(value: float) -> str:
    text = f"{value:.2f}".replace("0.", ".")
    return {"1.00": "1", "-1.00": "-1"}.get(text, text)


def symbols(labels: Sequence[str]) -> list[str]:
    """Return labels such as e_theta_dot or u1 as the thesis's symbols."""
    return [
        rf"$\varepsilon$({STATE_SYMBOLS[label[2:]]})" if label.startswith("e_") else rf"$u_{{{label[1:]}}}$"
        for label in labels
    ]


def wheels_figure(by_speed: Sequence[SpeedEffect]) -> Figure:
    """Return the wheels' residual torques against their speed."""
    figure = Figure(figsize=(7.4, 2.7), layout="constrained")
    axes = figure.subplots()
    axes.axhline(0.0, color=INK, linewidth=0.8)
    for wheel, (effect, look, mark) in enumerate(zip(by_speed, IN_TURN, MARKS, strict=False), start=1):
        axes.errorbar(effect.speeds, effect.torques, yerr=effect.half_widths, fmt=mark, color=LOOKS[look]["color"],
                      markersize=3.2, linewidth=0.9, label=f"wheel {wheel}")  # fmt: skip
    axes.set_xlabel("wheel speed [rad/s]")
    axes.set_ylabel("residual torque [N m]")
    figure.legend(loc="outside upper left", ncols=len(by_speed))
    return figure
