"""The page of an alignment with motion capture, as HTML, and what its results.json holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.findings import Finding, finding_results
from ballbot.report.alignment_figures import (
    orientation_error_figure,
    orientation_figure,
    position_error_figure,
    position_figure,
)
from ballbot.report.page import figure_markup, render
from ballbot.report.provenance import Provenance
from ballbot.report.style import drawn
from ballbot.report.tables import digits, state_mark, with_symbols
from ballbot.validation.alignment import Alignment, SensorErrors, alignment_findings


def alignment_report(
    alignment: Alignment, *, title: str, lead: str, made: Provenance, log_findings: Sequence[Finding]
) -> str:
    """Return the page."""
    verdict, *others = (with_symbols(sentence) for sentence in alignment_findings(alignment))
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
    found = [
        Finding(code="alignment", severity="note", text=sentence)
        for sentence in alignment_findings(alignment)
    ]
    motion, lever, rival = alignment.motion, alignment.lever, alignment.rival_clock
    return {
        "findings": finding_results([*log_findings, *found]),
        "clock": {
            "offset": motion.clock.offset,
            "offset_half_width": motion.offset_half_width,
            "rate": motion.clock.rate,
            "rate_half_width": motion.rate_half_width,
            "follows": alignment.clock_signal,
            "rival": asdict(rival) if rival is not None else None,
        },
        "body_marker": {
            "wxyz": _wxyz(motion.body_marker),
            "half_width": motion.rotation_half_width,
            "untold_axis": motion.untold_axis,
        },
        "flips": [asdict(flip) for flip in alignment.flips],
        "unseen": alignment.unseen,
        "frame": _frame(alignment),
        "lever_arm": None
        if lever is None
        else {"fitted": lever.arm, "half_width": lever.half_width, "used": lever.used},
        "increments": {"count": motion.increments, "rms_error": motion.error, "rms": motion.motion},
        "sensors": None if alignment.sensors is None else _sensors(alignment.sensors),
    }


def _frame(alignment: Alignment) -> dict[str, object] | None:
    frame = alignment.frame
    if frame is None:
        return None
    return {
        "camera_world_wxyz": _wxyz(frame.camera_world),
        "tilt_half_width": frame.tilt_half_width,
        "heading_half_width": frame.heading_half_width,
        "origin": frame.origin,
    }


def _sensors(sensors: SensorErrors) -> dict[str, object]:
    results: dict[str, object] = {name: asdict(one) for name, one in sensors.of.items()}
    position = sensors.position
    results["position"] = None
    if position is not None:
        results["position"] = {
            "largest": position.largest,
            "path": position.path,
            "explained_by_heading": position.by_heading,
            "scale": asdict(position.scale) if position.scale is not None else None,
        }
    return results | {"duration": sensors.duration}


def _wxyz(rotation: Rotation) -> NDArray[np.float64]:
    return rotation.as_quat(canonical=True)[[3, 0, 1, 2]]
