"""The thesis's Figures IV.1 to IV.4: the sensors on board beside the cameras, and their differences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ballbot.report.alignment import smoothed
from ballbot.report.palette import MUTED
from ballbot.report.style import MEASURED, STATE_SYMBOLS, WITHOUT_FRICTION, LineStyle, with_peaks
from ballbot.rounding import unit_heading
from ballbot.validation.alignment import Alignment, SensorError

_LOGGED = _EXPLAINED = WITHOUT_FRICTION
_SEEN = MEASURED
_THIN: LineStyle = {"color": MUTED, "linestyle": "-", "linewidth": 0.6}


def orientation_figure(alignment: Alignment) -> Figure:
    """Return the angles as logged and as seen (Figure IV.1)."""
    return _comparison(alignment, ("theta", "phi", "psi"), unit="deg", scale=float(np.degrees(1.0)))


def position_figure(alignment: Alignment) -> Figure:
    """Return x and y as logged and as seen (Figure IV.3)."""
    return _comparison(alignment, ("x", "y"), unit="m", scale=1.0)


def orientation_error_figure(alignment: Alignment) -> Figure:
    """Return the errors of the angles, smoothed over a second beside each sample's, with their lines (Figure IV.2)."""
    sensors = alignment.sensors
    assert sensors is not None
    figure, panels = _stacked(3)
    degrees = float(np.degrees(1.0))
    for axes, name in zip(panels, ("theta", "phi", "psi"), strict=True):
        error = degrees * sensors.errors[name]
        _draw_error(axes, alignment, error)
        _draw_line(axes, alignment.log.t, error, sensors.of[name], scale=degrees)
        axes.set_ylabel(f"error of {STATE_SYMBOLS[name]} [deg]")
    _legend(figure, panels)
    return figure


def position_error_figure(alignment: Alignment) -> Figure:
    """Return the errors of x and y, and what of them the heading's error makes (Figure IV.4)."""
    sensors = alignment.sensors
    assert sensors is not None
    figure, panels = _stacked(2)
    for index, (axes, name) in enumerate(zip(panels, ("x", "y"), strict=True)):
        _draw_error(axes, alignment, 1e3 * sensors.errors[name])
        if sensors.position is not None:
            explained = 1e3 * sensors.position.predicted[:, index]
            axes.plot(
                *with_peaks(alignment.log.t, explained), label="made by the heading's error", **_EXPLAINED
            )
        axes.set_ylabel(f"error of {STATE_SYMBOLS[name]} [mm]")
    _legend(figure, panels)
    return figure


def _comparison(alignment: Alignment, names: Sequence[str], *, unit: str, scale: float) -> Figure:
    figure, panels = _stacked(len(names))
    for axes, name in zip(panels, names, strict=True):
        log = alignment.log
        axes.plot(*with_peaks(log.t, scale * log[f"mocap_{name}"]), label="cameras", **_SEEN)
        axes.plot(*with_peaks(log.t, scale * log[name]), label="on board", **_LOGGED)
        axes.set_ylabel(unit_heading(STATE_SYMBOLS[name], unit))
    _legend(figure, panels)
    return figure


def _stacked(count: int) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(7.4, 0.5 + 1.35 * count), layout="constrained")
    panels = [figure.add_subplot(count, 1, index + 1) for index in range(count)]
    for axes in panels:
        axes.sharex(panels[0])
        axes.margins(x=0.01)
        axes.label_outer()
    panels[-1].set_xlabel("time of the log [s]")
    return figure, panels


def _draw_error(axes: Axes, alignment: Alignment, error: NDArray[np.float64]) -> None:
    samples = max(1, round(1.0 / alignment.log.sample_time))
    if len(error) > 2 * samples:
        axes.plot(*with_peaks(alignment.log.t, error), label="each sample", **_THIN)
        error = smoothed(error, samples)
    axes.plot(*with_peaks(alignment.log.t, error), label="mean over 1 s", **_SEEN)


def _draw_line(
    axes: Axes, t: NDArray[np.float64], error: NDArray[np.float64], one: SensorError, *, scale: float
) -> None:
    known = np.isfinite(error)
    ends = np.array([t[known][0], t[known][-1]])
    line = error[known].mean() + scale * one.drift * (ends - t[known].mean())
    axes.plot(ends, line, label="drift", **_EXPLAINED)


def _legend(figure: Figure, panels: Sequence[Axes]) -> None:
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
