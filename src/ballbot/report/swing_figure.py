"""A free swing, the pendulum fitted to it, and what the fit leaves."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ballbot.identification.swing import SwingFit
from ballbot.report.style import MEASURED, WITHOUT_FRICTION, thinned


def swing_figure(fit: SwingFit, *, label: str = "measured") -> Figure:
    """Return the recording, called by `label`, with the fitted pendulum, and below it their difference."""
    swing, in_degrees = fit.swing, float(np.degrees(1.0))
    unit = "deg" if swing.kind == "angle" else "deg/s"
    t, measured, predicted = thinned(
        swing.t - swing.t[0], swing.values - fit.values[5], fit.predicted - fit.values[5]
    )
    figure = Figure(figsize=(7.4, 3.8), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    upper.plot(t, in_degrees * measured, label=label, **MEASURED)
    upper.plot(t, in_degrees * predicted, label="pendulum fitted", **WITHOUT_FRICTION)
    upper.set_ylabel(f"{'angle' if swing.kind == 'angle' else 'rate'} [{unit}]")
    upper.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    lower.plot(t, in_degrees * (measured - predicted), color=MEASURED["color"], linewidth=0.8)
    lower.set_ylabel(f"difference\n[{unit}]")
    lower.set_xlabel("time [s]")
    return figure
