"""Poles in the complex plane."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ballbot.report.palette import BLUE, MUTED, ORANGE, SHADE


def poles_of_robot_figure(poles: NDArray[np.complex128]) -> Figure:
    """Return a robot's poles without control."""
    figure = Figure(figsize=(4.6, 2.6), layout="constrained")
    axes = figure.subplots()
    axes.plot(poles.real, poles.imag, "x", color=ORANGE, markersize=7)
    _finish(axes, poles)
    return figure


def poles_figure(open_loop: NDArray[np.complex128], closed_loop: NDArray[np.complex128]) -> Figure:
    """Return the robot's poles without control and those of the closed loop."""
    figure = Figure(figsize=(4.6, 2.6), layout="constrained")
    axes = figure.subplots()
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
    _finish(axes, np.concatenate([open_loop, closed_loop]))
    axes.legend(loc="upper left")
    return figure


def _finish(axes: Axes, poles: NDArray[np.complex128]) -> None:
    """Draw the axes and the unstable half, and leave room around the poles."""
    axes.axvspan(0.0, 1e3, color=SHADE)
    axes.axvline(0.0, color=MUTED, linewidth=0.8)
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    height = max(1.0, 1.25 * float(np.abs(poles.imag).max()))
    left, right = min(-1.0, 1.12 * float(poles.real.min())), max(1.0, 1.5 * float(poles.real.max()))
    axes.set(xlim=(left, right), ylim=(-height, height))
    axes.set_xlabel("real part [rad/s]")
    axes.set_ylabel("imaginary part [rad/s]")
