"""Figures of the comparison of controllers, in the manner of the thesis's Figures 5.7 and 5.8, and of the poles."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ballbot.experiments.metrics import SETTLE, position_error, settled, true_place
from ballbot.log import Log
from ballbot.report.style import BLUE, GREEN, INK, MUTED, ORANGE, REFERENCE, SHADE, Line, thinned

RUN_LINES: Mapping[str, Line] = {
    "none": {"color": ORANGE, "linestyle": "--", "linewidth": 1.2},
    "full": {"color": MUTED, "linestyle": ":", "linewidth": 1.4},
    "partial": {"color": GREEN, "linestyle": "-.", "linewidth": 1.3},
    "precise": {"color": BLUE, "linestyle": "-", "linewidth": 1.2},
}
RUN_LABELS: Mapping[str, str] = {
    "none": "no compensation",
    "full": "full compensation",
    "partial": "partial compensation",
    "precise": "precise",
}


def paths_figure(runs: Mapping[str, Log]) -> Figure:
    """Return each controller's path over the floor beside the reference (Figure 5.7)."""
    figure = Figure(figsize=(7.4, 2.8), layout="constrained")
    panels = figure.subplots(1, len(runs), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (name, log) in zip(panels, runs.items(), strict=True):
        place = true_place(log)
        axes.plot(log["ref_x"], log["ref_y"], label="reference", **REFERENCE)
        x, y = thinned(place["x"], place["y"])
        axes.plot(x, y, label="robot", **RUN_LINES[name])
        axes.plot(place["x"][:1], place["y"][:1], marker="o", color=INK, markersize=3.5, linestyle="none")
        axes.set_title(RUN_LABELS[name] + (" (fell)" if log.ended else ""))
        axes.set_aspect("equal")
        axes.set_xlabel("$x$ [m]")
    panels[0].set_ylabel("$y$ [m]")
    return figure


def position_error_figure(runs: Mapping[str, Log]) -> Figure:
    """Return the distance from the reference over time, with the reference below (Figure 5.8)."""
    figure = Figure(figsize=(7.4, 3.2), layout="constrained")
    error_axes, reference_axes = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    longest = max(runs.values(), key=len)
    _shade(error_axes, longest, settled(longest, SETTLE))
    for name, log in runs.items():
        t, error = thinned(log.t, position_error(log))
        error_axes.plot(t, error, label=RUN_LABELS[name], **RUN_LINES[name])
    error_axes.set_ylabel("distance from the\nreference [m]")
    error_axes.set_ylim(bottom=0.0)
    error_axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.2), ncols=4)
    for name, color, style in (("x", BLUE, "-"), ("y", ORANGE, "--")):
        t, reference = thinned(longest.t, longest[f"ref_{name}"])
        reference_axes.plot(t, reference, color=color, linestyle=style, linewidth=1.2, label=f"${name}$")
    reference_axes.set_ylabel("reference\n[m]")
    reference_axes.set_xlabel("time [s]")
    reference_axes.legend(loc="upper left", ncols=2)
    error_axes.margins(x=0.01)
    return figure


def poles_figure(open_loop: NDArray[np.complex128], closed_loop: NDArray[np.complex128]) -> Figure:
    """Return the robot's poles without control and those of the closed loop in the complex plane."""
    figure = Figure(figsize=(4.6, 2.6), layout="constrained")
    axes = figure.subplots()
    axes.axvspan(0.0, 1e3, color=SHADE)
    axes.axvline(0.0, color=MUTED, linewidth=0.8)
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    axes.plot(open_loop.real, open_loop.imag, "x", color=ORANGE, markersize=7, label="without control")
    axes.plot(
        closed_loop.real,
        closed_loop.imag,
        "o",
        color=BLUE,
        markersize=4.5,
        mfc="none",
        label="with this gain",
    )
    everything = np.concatenate([open_loop, closed_loop])
    height = max(1.0, 1.25 * float(np.abs(everything.imag).max()))
    axes.set(xlim=(1.12 * everything.real.min(), 1.5 * everything.real.max()), ylim=(-height, height))
    axes.set_xlabel("real part [rad/s]")
    axes.set_ylabel("imaginary part [rad/s]")
    axes.legend(loc="upper left")
    return figure


def _shade(axes: Axes, log: Log, counted: NDArray[np.bool_]) -> None:
    """Shade the times that count as settled."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], counted, [False]])))
    for number, (first, end) in enumerate(edges.reshape(-1, 2)):
        label = "settled: counts" if number == 0 else None
        axes.axvspan(float(log.t[first]), float(log.t[end - 1]), color=SHADE, label=label)
