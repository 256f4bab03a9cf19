"""Figures of the logs and of the friction found in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ballbot.experiments.study import StudiedLog
from ballbot.identification.result import Identification
from ballbot.report.friction_curve import friction_curve
from ballbot.report.style import BLUE, INK, MUTED, ORANGE, REFERENCE, SHADE, label_of, thinned

#: wheel speeds shown reach this quantile of those in the logs
_SHOWN = 0.995


def logs_figure(logs: Sequence[StudiedLog]) -> Figure:
    """Return the position and heading in each log over time, with what was held out shaded."""
    figure = Figure(figsize=(7.4, 0.5 + 1.75 * len(logs)), layout="constrained")
    panels = figure.subplots(len(logs), 1, squeeze=False)[:, 0]
    for axes, studied in zip(panels, logs, strict=True):
        _draw_log(axes, studied)
    panels[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.12), ncols=6, borderpad=0.0)
    panels[-1].set_xlabel("time of the log [s]")
    return figure


def _draw_log(axes: Axes, studied: StudiedLog) -> None:
    log = studied.log
    for number, (start, end) in enumerate(studied.held_out):
        axes.axvspan(start, end, color=SHADE, label="held out" if number == 0 else None)
    for name, color, style in (("x", BLUE, "-"), ("y", ORANGE, "--")):
        if f"ref_{name}" in log:
            t, reference = thinned(log.t, log[f"ref_{name}"])
            label = "reference" if name == "x" else None
            axes.plot(t, reference, color=REFERENCE["color"], linestyle=style, linewidth=1.8, label=label)
        t, values = thinned(log.t, log[name])
        axes.plot(t, values, color=color, linestyle=style, linewidth=1.1, label=f"${name}$ [m]")
    t, heading = thinned(log.t, log["psi"])
    axes.plot(t, heading, color=INK, linestyle=":", linewidth=1.1, label=r"$\psi$ [rad]")
    axes.set_title(label_of(studied.name))
    axes.margins(x=0.01)


def friction_figure(found: Identification, logs: Sequence[StudiedLog]) -> Figure:
    """Return each wheel's friction over its speed with a 95 % band, above how often the logs have such a speed."""
    n = found.robot.wheel_count
    speeds = [studied.wheel_speeds(found.robot) for studied in logs]
    fastest = max(float(np.quantile(np.abs(speed), _SHOWN)) for speed in speeds)
    figure = Figure(figsize=(7.4, 3.1), layout="constrained")
    panels = figure.subplots(2, n, sharex=True, sharey="row", height_ratios=(3, 1), squeeze=False)
    for wheel in range(n):
        _draw_curve(panels[0, wheel], found, wheel, fastest)
        _draw_speeds(panels[1, wheel], np.concatenate([speed[:, wheel] for speed in speeds]), fastest)
    panels[0, 0].set_ylabel("friction torque [N m]")
    panels[1, 0].set_ylabel("share of\nthe logs [%]")
    return figure


def _draw_curve(axes: Axes, found: Identification, wheel: int, fastest: float) -> None:
    for side in (-1.0, 1.0):
        curve = friction_curve(found, wheel, side * np.geomspace(1e-3, 1.0, 160) * fastest)
        half = 1.96 * curve.standard_error
        axes.fill_between(
            curve.speed, curve.torque - half, curve.torque + half, color=BLUE, alpha=0.2, linewidth=0
        )
        axes.plot(curve.speed, curve.torque, color=BLUE, linewidth=1.4)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.axvline(0.0, color=MUTED, linewidth=0.6)
    axes.set_title(f"wheel {wheel + 1}")


def _draw_speeds(axes: Axes, speed: np.ndarray, fastest: float) -> None:
    shares, edges = np.histogram(speed, bins=61, range=(-fastest, fastest))
    axes.stairs(100.0 * shares / len(speed), edges, fill=True, color=MUTED, alpha=0.55)
    axes.set_xlabel("wheel speed [rad/s]")
