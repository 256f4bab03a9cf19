"""Poles in the complex plane: unstable to the right, fast to the left, without oscillation on the real line."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ballbot.report.palette import BLUE, MUTED, ORANGE, SHADE

_NONE = np.zeros(0, np.complex128)


def poles_figure(
    *, open_loop: NDArray[np.complex128] = _NONE, closed_loop: NDArray[np.complex128] = _NONE
) -> Figure:
    """Return a robot's poles without control, those of the closed loop, or both; the unstable half is shaded."""
    figure = Figure(figsize=(4.6, 2.6), layout="constrained")
    axes = figure.subplots()
    if open_loop.size:
        axes.plot(open_loop.real, open_loop.imag, "x", color=ORANGE, markersize=7, label="without control")
    if closed_loop.size:
        real, imaginary = closed_loop.real, closed_loop.imag
        axes.plot(real, imaginary, "o", color=BLUE, markersize=4.5, mfc="none", label="closed loop")
    axes.axvspan(0.0, 1e3, color=SHADE)
    axes.axvline(0.0, color=MUTED, linewidth=0.8)
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    poles = np.concatenate([open_loop, closed_loop])
    height = max(1.0, 1.25 * float(np.abs(poles.imag).max()))
    left, right = min(-1.0, 1.12 * float(poles.real.min())), max(1.0, 1.5 * float(poles.real.max()))
    axes.set(xlim=(left, right), ylim=(-height, height))
    axes.set_xlabel("real part [rad/s]")
    axes.set_ylabel("imaginary part [rad/s]")
    axes.legend(loc="upper left")
    return figure
