"""An alignment with motion capture: figures (the thesis's IV.1 to IV.4), page, and what its results.json holds."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.findings import Finding, finding_results
from ballbot.report.page import Provenance, figure_markup, render
from ballbot.report.style import MEASURED, MUTED, STATE_SYMBOLS, WITHOUT_FRICTION, Line, drawn, with_peaks
from ballbot.report.tables import digits, state_mark, with_symbols
from ballbot.validation.alignment import Alignment, SensorError, SensorErrors, alignment_findings

_LOGGED = _EXPLAINED = WITHOUT_FRICTION
_SEEN = MEASURED
_THIN: Line = {"color": MUTED, "linestyle": "-", "linewidth": 0.6}


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
        axes.set_ylabel(f"{STATE_SYMBOLS[name]} [{unit}]")
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
        error = _smoothed(error, samples)
    axes.plot(*with_peaks(alignment.log.t, error), label="mean over 1 s", **_SEEN)


def _draw_line(
    axes: Axes, t: NDArray[np.float64], error: NDArray[np.float64], one: SensorError, *, scale: float
) -> None:
    known = np.isfinite(error)
    ends = np.array([t[known][0], t[known][-1]])
    line = error[known].mean() + scale * one.drift * (ends - t[known].mean())
    axes.plot(ends, line, label="drift", **_EXPLAINED)


def _smoothed(values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return the running mean over `count` samples of those that are known; NaN where the sample itself is not."""
    known = np.isfinite(values)
    window = np.ones(count)
    total = np.convolve(np.where(known, values, 0.0), window, mode="same")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(known, total / np.convolve(known.astype(np.float64), window, mode="same"), np.nan)


def _legend(figure: Figure, panels: Sequence[Axes]) -> None:
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))


def alignment_report(
    alignment: Alignment, *, title: str, lead: str, made: Provenance, log_findings: Sequence[Finding]
) -> str:
    """Return the page."""
    verdict, *others = (with_symbols(finding.text) for finding in alignment_findings(alignment))
    has_angles = alignment.sensors is not None
    has_place = alignment.sensors is not None and alignment.sensors.position is not None
    draws = {
        "orientation": orientation_figure if has_angles else None,
        "orientation_error": orientation_error_figure if has_angles else None,
        "position": position_figure if has_place else None,
        "position_error": position_error_figure if has_place else None,
    }
    figures = {
        name: figure_markup(drawn(partial(draw, alignment), name=name.replace("_", "-"))) if draw else None
        for name, draw in draws.items()
    }
    values: dict[str, object] = {
        "title": title,
        "lead": lead,
        "verdict": verdict,
        "findings": others,
        "errors": error_rows(alignment.sensors) if alignment.sensors is not None else [],
        "figures": figures,
        "made": made,
        "log_findings": log_findings,
    }
    return render("alignment", values)


def error_rows(sensors: SensorErrors) -> list[tuple[str, ...]]:
    """Return name, unit, rms, largest, drift a minute with half width, wander and delay [ms] of each."""
    rows = []
    for name, one in sensors.of.items():
        scale, unit = (1e3, "mm") if name in ("x", "y") else (float(np.degrees(1.0)), "deg")
        drift = f"{60 * scale * one.drift:+.2g} ± {60 * scale * one.drift_half_width:.1g}"
        delay = "–"
        if one.delay is not None and one.delay_half_width is not None:
            delay = f"{1e3 * one.delay:+.1f} ± {1e3 * one.delay_half_width:.1f}"
        sizes = (digits(scale * value) for value in (one.rms, one.largest))
        rows.append((state_mark(name), unit, *sizes, drift, digits(scale * one.wander), delay))
    return rows


def alignment_results(alignment: Alignment, *, log_findings: Sequence[Finding] = ()) -> dict[str, object]:
    """Return what results.json holds: SI units, quaternions wxyz, half widths of 95 %."""
    motion, lever, rival = alignment.motion, alignment.lever, alignment.rival_clock
    return {
        "findings": finding_results([*log_findings, *alignment_findings(alignment)]),
        "clock": {
            "offset": motion.clock.offset,
            "offset_half_width": motion.offset_half_width,
            "rate": motion.clock.rate,
            "rate_half_width": motion.rate_half_width,
            "follows": alignment.clock_signal,
            "rival": rival,
        },
        "body_marker": {
            "wxyz": _wxyz(motion.body_marker),
            "half_width": motion.rotation_half_width,
            "unobservable_axis": motion.unobservable_axis,
        },
        "flips": alignment.flips,
        "unseen": alignment.unseen,
        "frame": _frame_results(alignment),
        "lever_arm": None
        if lever is None
        else {"fitted": lever.arm, "half_width": lever.half_width, "used": lever.used},
        "increments": {"count": motion.increments, "rms_error": motion.error, "rms": motion.motion},
        "sensors": None if alignment.sensors is None else _sensor_results(alignment.sensors),
    }


def _frame_results(alignment: Alignment) -> dict[str, object] | None:
    frame = alignment.frame
    if frame is None:
        return None
    return {
        "camera_world_wxyz": _wxyz(frame.camera_world),
        "tilt_half_width": frame.tilt_half_width,
        "heading_half_width": frame.heading_half_width,
        "origin": frame.origin,
    }


def _sensor_results(sensors: SensorErrors) -> dict[str, object]:
    results: dict[str, object] = dict(sensors.of)
    position = sensors.position
    results["position"] = None
    if position is not None:
        results["position"] = {
            "largest": position.largest,
            "path": position.path,
            "explained_by_heading": position.by_heading,
            "scale": position.scale,
        }
    return results | {"duration": sensors.duration}


def _wxyz(rotation: Rotation) -> NDArray[np.float64]:
    return rotation.as_quat(canonical=True)[[3, 0, 1, 2]]
