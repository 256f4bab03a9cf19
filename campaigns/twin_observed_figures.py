"""Figures of what the thesis saw, on the twin; `campaigns.twin_observed` makes the runs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ballbot import Log
from ballbot.report.comparison import RUN_LABELS, RUN_LINES
from ballbot.report.style import BLUE, INK, MUTED, ORANGE, REFERENCE, SHADE, Line, thinned
from ballbot.workflows.metrics import SETTLE, position_error, score, settled, true_place
from campaigns.observations import Drift, Impulses, Ripple, Spectrum

_ON: Line = {"color": ORANGE, "linestyle": "-", "linewidth": 1.0}
_OFF: Line = {"color": BLUE, "linestyle": "-", "linewidth": 1.0}
_TURNS = 3.0  # that are shown of a wheel's


def errors_figure(runs: Mapping[str, Log]) -> Figure:
    """Return the paths around the square without and with compensation, and the distances from it over time."""
    figure = Figure(figsize=(7.4, 3.0), layout="constrained")
    paths, errors = figure.subplots(1, 2, width_ratios=(2, 3))
    longest = max(runs.values(), key=len)
    paths.plot(longest["ref_x"], longest["ref_y"], **REFERENCE)
    for name in ("none", "partial"):
        place = true_place(runs[name])
        paths.plot(*thinned(place["x"], place["y"]), **RUN_LINES[name])
    paths.set_aspect("equal")
    paths.set(xlabel="$x$ [m]", ylabel="$y$ [m]", title="True path")
    _shade_settled(errors, longest)
    for name, log in runs.items():
        label = f"{RUN_LABELS[name]}: {score(log).peak_position_error:.2f} m"
        errors.plot(*thinned(log.t, position_error(log)), label=label, **RUN_LINES[name])
    errors.set(xlabel="time [s]", ylabel="distance from the reference [m]", ylim=(0.0, 1.25))
    errors.set_title("Distance, and its peak once settled (shaded)")
    errors.legend(loc="upper right")
    errors.margins(x=0.01)
    return figure


def rollers_figure(found: Mapping[str, Ripple]) -> Figure:
    """Return the wheel's speed over its angle, and the orders in it, of wheels of several kinds."""
    figure = Figure(figsize=(7.4, 1.35 * len(found)), layout="constrained")
    panels = figure.subplots(len(found), 2, sharex="col", width_ratios=(3, 2), squeeze=False)
    highest = 1.15 * max(float(np.abs(one.ripple).max()) for one in found.values())
    for (speed, orders), (name, one) in zip(panels, found.items(), strict=True):
        shown = one.turns < _TURNS
        speed.plot(one.turns[shown], 100 * one.ripple[shown], color=BLUE, linewidth=0.9)
        speed.set(xlim=(0.0, _TURNS), ylim=(-100 * highest, 100 * highest))
        speed.set_title(f"{name.replace('_', ' ')}: {100 * one.line:.2f} % at {one.per_row} a turn")
        below = (one.order > 1.0) & (one.order < 30.0)
        orders.semilogy(one.order[below], 100 * one.amplitude[below], color=BLUE, linewidth=0.9)
        orders.axvline(one.per_row, color=ORANGE, linewidth=2.5, alpha=0.35)
        orders.set(xlim=(0.0, 30.0), ylim=(1e-3, 20.0))
    figure.supylabel("wheel speed, off its mean [%]", fontsize=8.5, color=INK)
    panels[0, 1].set_title("amplitude of each order [%]")
    panels[-1, 0].set_xlabel("turns of the wheel")
    panels[-1, 1].set_xlabel("cycles a turn (orange: the rollers)")
    return figure


def drift_figure(found: Drift) -> Figure:
    """Return the heading's and the position's errors over time."""
    figure = Figure(figsize=(7.4, 2.3), layout="constrained")
    heading, position = figure.subplots(1, 2)
    heading.plot(*thinned(found.t, found.heading), color=BLUE, linewidth=1.2)
    heading.set(xlabel="time [s]", ylabel="on-board less true [degrees]")
    heading.set_title(f"Heading: {180 * found.rate:.1f} degrees in 3 minutes")
    position.plot(*thinned(found.t, found.position), color=BLUE, linewidth=1.2)
    position.set(xlabel="time [s]", ylabel="on-board from true [m]", ylim=(0.0, None))
    position.set_title(f"Position: {found.largest(180.0):.2f} m at most")
    return figure


def play_figure(found: Mapping[str, Impulses]) -> Figure:
    """Return the wheels' accelerations with and without play."""
    figure = Figure(figsize=(7.4, 3.0), layout="constrained")
    panels = figure.subplots(len(found), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for axes, (name, one) in zip(panels, found.items(), strict=True):
        shown = (one.t > 8.0) & (one.t < 14.0)
        axes.plot(one.t[shown], one.acceleration[shown, 0], color=BLUE, linewidth=0.7)
        axes.set_title(
            f"{name}: up to {one.largest:.0f} rad/s$^2$, kurtosis {one.kurtosis:.1f} times a normal distribution's"
        )
    figure.supylabel("acceleration of wheel 1 [rad/s$^2$]", fontsize=8.5, color=INK)
    panels[-1].set_xlabel("time [s]")
    panels[-1].margins(x=0.01)
    return figure


def resonance_figure(on: Mapping[str, Spectrum], off: Mapping[str, Spectrum]) -> Figure:
    """Return the residuals' spectrum with the resonance switched on and off, without and with play."""
    figure = Figure(figsize=(7.4, 2.6), layout="constrained")
    panels = figure.subplots(1, len(on), sharex=True, sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, on, strict=True):
        for label, one, line in (("off", off[name], _OFF), ("on", on[name], _ON)):
            text = f"{label}: {one.height:.0f} times the median at {one.peak:.0f} Hz"
            axes.semilogy(one.frequency, one.power, label=text, **line)
        axes.axvline(on[name].peak, color=MUTED, linewidth=0.8, linestyle=":")
        axes.set_title(f"Resonance, {name}")
        axes.set_xlabel("frequency [Hz]")
        axes.legend(loc="upper right")
    low, high = panels[0].get_ylim()
    panels[0].set_ylim(low, 8.0 * high)
    panels[0].set_ylabel(r"residual of $\dot{x}$ [m$^2$/s$^2$/Hz]")
    return figure


def _shade_settled(axes: Axes, log: Log) -> None:
    """Shade the times whose errors count."""
    counted = np.concatenate([[False], settled(log, SETTLE), [False]])
    for first, end in np.flatnonzero(np.diff(counted)).reshape(-1, 2):
        axes.axvspan(float(log.t[first]), float(log.t[end - 1]), color=SHADE)
