"""Figures of a designed experiment: what the robot is asked, what it does within its limits, and what that tells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, StrMethodFormatter
from numpy.typing import NDArray

from ballbot.report.style import BLUE, GREEN, INK, MUTED, ORANGE, thinned
from ballbot.workflows.excitation_task import RunLimits, run_on_model
from ballbot.workflows.excite import Excitation

#: a square's bars and the design's
_COLORS = (ORANGE, BLUE)
_MARKS = ("o", "s")
#: the wheels' lines
_STYLES = ("-", "--", ":", "-.")


@dataclass(frozen=True, kw_only=True, eq=False)
class Followed:
    """A run to be drawn: the design on the twin where it was tried, on the model otherwise."""

    title: str
    t: NDArray[np.float64]  #: (N,) [s]
    states: NDArray[np.float64]  #: (N, 10)
    torques: NDArray[np.float64]  #: (N, n) [N m]
    poses: NDArray[np.float64]  #: (N, 3), as asked [m, m, rad]


def followed_run(result: Excitation) -> Followed:
    """Return the designed run to be drawn: as it was on the twin, or on the model where it was not tried there."""
    trial, poses = result.trials.get("designed"), result.design.poses
    if trial is None:
        log = run_on_model(result.task, result.design.reference).log
        return Followed(title="on the model", t=log.t, states=log.states, torques=log.torques, poses=poses)
    log, truth = trial.log, trial.log.truth()
    return Followed(
        title="on the twin", t=log.t, states=truth.states, torques=log.torques, poses=poses[: len(log)]
    )


def run_figure(shown: Followed, limits: RunLimits) -> Figure:
    """Draw the path over the floor, and reference, lean and torques over time, with the limits."""
    figure = Figure(figsize=(7.4, 4.2), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1.0, 1.5))
    _draw_path(figure.add_subplot(grid[:, 0]), shown, limits)
    asked = figure.add_subplot(grid[0, 1])
    lean, torque = (figure.add_subplot(grid[row, 1], sharex=asked) for row in (1, 2))
    for column, (name, color, style) in enumerate(
        (("$x$", BLUE, "-"), ("$y$", ORANGE, "--"), (r"$\psi$", INK, ":"))
    ):
        t, values = thinned(shown.t, shown.poses[:, column])
        asked.plot(t, values, color=color, linestyle=style, linewidth=0.9, label=name)
    asked.set_ylabel("asked for\n[m, rad]")
    asked.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
    asked.tick_params(labelbottom=False)
    lean.tick_params(labelbottom=False)
    leaning = np.degrees(np.arccos(np.cos(shown.states[:, 2]) * np.cos(shown.states[:, 3])))
    lean.plot(*thinned(shown.t, leaning), color=BLUE, linewidth=0.8)
    lean.axhline(np.degrees(limits.lean), color=INK, linewidth=0.8, linestyle="--")
    lean.set_ylabel("lean\n[deg]")
    for torques, color, style in zip(shown.torques.T, (BLUE, ORANGE, GREEN, MUTED), _STYLES, strict=False):
        torque.plot(*thinned(shown.t, torques), color=color, linestyle=style, linewidth=0.7)
    for side in (-1.0, 1.0):
        torque.axhline(side * limits.torque, color=INK, linewidth=0.8, linestyle="--")
    torque.set_ylabel("torques\n[N m]")
    torque.set_xlabel("time [s]")
    return figure


def errors_figure(result: Excitation) -> Figure:
    """Draw the standard errors of each parameter, expected and from the twin's logs, of a square and of the design."""
    labels = result.task.question.labels
    panels = [("expected", {"square": result.square.errors, "designed": result.design.errors})]
    if result.trials:
        panels.append(
            (
                "from the twin's logs (no mark: no number)",
                {name: one.errors for name, one in result.trials.items()},
            )
        )
    figure = Figure(figsize=(7.4, 2.9), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    places = np.arange(len(labels))
    for one, (title, runs) in zip(axes, panels, strict=True):
        for (name, errors), color, mark in zip(runs.items(), _COLORS, _MARKS, strict=True):
            shown = np.where(np.isfinite(errors), 100.0 * errors, np.nan)
            one.plot(places, shown, linestyle="none", marker=mark, color=color, markersize=5, label=name)
        one.set_yscale("log")
        one.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        one.yaxis.set_minor_formatter(LogFormatter(labelOnlyBase=False, minor_thresholds=(2.0, 0.4)))
        one.set_xticks(places, labels, rotation=60)
        one.set_title(title)
        one.grid(axis="y", which="both", linewidth=0.4)
    axes[0].set_ylabel("standard error\n[% of the bounds' width]")
    axes[0].legend(fontsize=7.5)
    return figure


def _draw_path(axes: Axes, shown: Followed, limits: RunLimits) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 100)
    axes.plot(
        limits.floor * np.cos(turn), limits.floor * np.sin(turn), color=INK, linewidth=0.8, linestyle="--"
    )
    axes.plot(*thinned(shown.states[:, 0], shown.states[:, 1]), color=BLUE, linewidth=0.9)
    axes.plot(0.0, 0.0, marker="o", color=MUTED, markersize=3.5)
    axes.set_aspect("equal")
    axes.set_title(f"path {shown.title}, limits dashed")
    axes.set_xlabel("$x$ [m]")
    axes.set_ylabel("$y$ [m]")
