"""Figures of the driveline stage: the thesis's Figures 3.1 and 3.2, and the friction found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ballbot.identification.driveline import DrivelineFit, PrintedFit, Sweep
from ballbot.report.axis_figures import panels_over_time
from ballbot.report.style import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    REFERENCE,
    WITH_FRICTION,
    WITHOUT_FRICTION,
    Line,
    thinned,
)

_WHEELS = ((INK, "-"), (BLUE, "--"), (ORANGE, "-."), (GREEN, ":"))
#: a broad pale line beneath, for the model's with friction lies on it
_MEASURED: Line = {**REFERENCE, "linewidth": 3.2}


def measured_figure(sweeps: Sequence[Sweep]) -> Figure:
    """Return the thesis's Figure 3.1: torque over measured wheel speed."""
    figure = Figure(figsize=(7.4, 3.4), layout="constrained")
    axes = figure.subplots()
    for sweep, (color, dash) in zip(sweeps, _WHEELS, strict=False):
        speed, torque = thinned(sweep.speed, sweep.torque)
        axes.plot(speed, torque, color=color, linestyle=dash, linewidth=1.1, label=f"wheel {sweep.wheel}")
    axes.set_xlabel("wheel speed [rad/s]")
    axes.set_ylabel("torque [N m]")
    axes.legend(loc="upper left")
    return figure


def comparison_figure(sweep: Sweep, fit: DrivelineFit, printed: PrintedFit) -> Figure:
    """Return the thesis's Figure 3.2 over time: speed measured, with friction, without, and with (3.2) as printed."""
    figure, upper, lower = panels_over_time(height=4.6, ratios=(3, 1))
    # a line of friction is broken where the speed is limited, so no row is left out of what is thinned
    t, measured, found, clamped, without = thinned(
        sweep.t, sweep.speed, fit.predicted, printed.predicted, fit.without
    )
    upper.plot(t, measured, label="measured", **_MEASURED)
    upper.plot(t, without, label="without friction", **WITHOUT_FRICTION)
    upper.plot(t, clamped, color=GREEN, linestyle=":", linewidth=1.4, label="clamp (3.2) as printed")
    upper.plot(t, found, label="with friction", **WITH_FRICTION)
    upper.set_ylabel(f"speed of wheel {sweep.wheel} [rad/s]")
    upper.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4)
    lower.plot(t, found - measured, color=BLUE, linewidth=0.9)
    lower.set_ylabel("with friction\nless measured")
    return figure


def torque_speed_figure(sweep: Sweep, fit: DrivelineFit) -> Figure:
    """Return the thesis's Figure 3.2 as a torque-speed characteristic."""
    figure = Figure(figsize=(7.4, 3.4), layout="constrained")
    axes = figure.subplots()
    torque, measured, found, without = thinned(sweep.torque, sweep.speed, fit.predicted, fit.without)
    axes.plot(measured, torque, label="measured", **_MEASURED)
    axes.plot(without, torque, label="without friction", **WITHOUT_FRICTION)
    axes.plot(found, torque, label="with friction", **WITH_FRICTION)
    axes.set_xlabel(f"speed of wheel {sweep.wheel} [rad/s]")
    axes.set_ylabel("torque [N m]")
    axes.legend(loc="upper left")
    return figure


def curve_figure(fits: Sequence[DrivelineFit], limit: float) -> Figure:
    """Return each wheel's friction over speed with its 95 % band; the right panel looks at low speeds."""
    figure = Figure(figsize=(7.4, 3.2), layout="constrained")
    panels = figure.subplots(1, 2)
    for axes, fastest in zip(panels, (limit, 4.0), strict=True):
        speed = np.geomspace(1e-3, 1.0, 200) * fastest
        for fit, (color, dash) in zip(fits, _WHEELS, strict=False):
            torque = fit.law.steady_friction(speed)
            half = 1.96 * curve_error(fit, speed)
            axes.fill_between(speed, torque - half, torque + half, color=color, alpha=0.2, linewidth=0)
            axes.plot(speed, torque, color=color, linestyle=dash, linewidth=1.3, label=f"wheel {fit.wheel}")
        axes.set_xlabel("wheel speed [rad/s]")
        axes.set_ylim(bottom=0.0)
    panels[0].set_ylabel("friction torque [N m]")
    panels[0].legend(loc="upper left")
    return figure


def curve_error(fit: DrivelineFit, speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard error [N m] of the friction at speeds (k,) above zero, by the delta method."""
    _, _, s, v_s, delta = fit.values
    decay = (speed / v_s) ** delta
    E = np.exp(-decay)
    gradient = np.column_stack(
        [speed, np.ones_like(speed), E, s * E * decay * delta / v_s, -s * E * decay * np.log(speed / v_s)]
    )
    errors = np.nan_to_num(fit.standard_errors)
    covariance = np.nan_to_num(fit.correlation) * np.outer(errors, errors)
    return np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", gradient, covariance, gradient), 0.0))
