"""Figure V.2 of the thesis: the ball's angular velocity by video, with its error, beside the wheels'."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ballbot.report.style import GREEN, MEASURED, SHADE, WITHOUT_FRICTION, thinned
from ballbot.vision.comparison import WheelComparison
from ballbot.vision.spin import Spin

_AXES = ("x", "y", "z")


def velocity_figure(spin: Spin, comparison: WheelComparison | None) -> Figure:
    """Return the velocity about each axis, robot frame, with twice its standard error; where it was lost is shaded."""
    figure = Figure(figsize=(7.4, 4.9), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    for axis, panel in enumerate(panels):
        _draw_lost(panel, spin)
        t, omega, error = thinned(spin.t, spin.omega[:, axis], spin.errors[:, axis])
        panel.fill_between(
            t,
            omega - 2.0 * error,
            omega + 2.0 * error,
            color=GREEN,
            alpha=0.35,
            linewidth=0.0,
            label="± 2 standard errors",
        )
        panel.plot(t, omega, **MEASURED, label="video")
        if comparison is not None:
            panel.plot(
                *thinned(spin.t, comparison.wheels[:, axis]),
                **WITHOUT_FRICTION,
                label="$T_{obw}$ × wheel speeds",
            )
        panel.set_ylabel(rf"$\Omega_{_AXES[axis]}$ [rad/s]")
        panel.margins(x=0.01)
    _finish(figure, panels[0], panels[-1])
    return figure


def difference_figure(spin: Spin, comparison: WheelComparison) -> Figure:
    """Return video less wheels about each axis beside twice the video's standard error."""
    figure = Figure(figsize=(7.4, 4.2), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True, sharey=True)
    for axis, panel in enumerate(panels):
        _draw_lost(panel, spin)
        t, difference, error = thinned(spin.t, comparison.difference[:, axis], spin.errors[:, axis])
        panel.fill_between(
            t,
            -2.0 * error,
            2.0 * error,
            color=GREEN,
            alpha=0.35,
            linewidth=0.0,
            label="± 2 standard errors of video",
        )
        panel.plot(t, difference, color=MEASURED["color"], linewidth=0.8, label="video less wheels")
        panel.set_ylabel(rf"$\Omega_{_AXES[axis]}$ [rad/s]")
        panel.margins(x=0.01)
    _finish(figure, panels[0], panels[-1])
    return figure


def _draw_lost(panel: Axes, spin: Spin) -> None:
    starts, ends = _spans(~spin.known)
    half = 0.5 * float(np.median(np.diff(spin.t)))
    for number, (a, b) in enumerate(zip(starts, ends, strict=True)):
        label = "lost" if number == 0 else None
        panel.axvspan(float(spin.t[a]) - half, float(spin.t[b]) + half, color=SHADE, label=label)


def _spans(flags: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return first and last row of each run of true flags."""
    edges = np.diff(np.concatenate([[0], flags.astype(np.int8), [0]]))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1


def _finish(figure: Figure, top: Axes, bottom: Axes) -> None:
    handles, labels = top.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    bottom.set_xlabel("time of the video [s]")
