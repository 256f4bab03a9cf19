"""An alignment with motion capture: its page, and what its results.json holds."""

from collections.abc import Sequence

import numpy as np

from ballbot.findings import Finding, by_severity
from ballbot.identification.turning import ANGLE_NAMES
from ballbot.log import Log
from ballbot.report.blocks import Bullets, Result, Sheet, section
from ballbot.report.series import Line, Panel, TimeSeries
from ballbot.report.words import state_mark, with_symbols
from ballbot.results import to_results
from ballbot.rounding import digits, plus_minus, signed
from ballbot.validation.alignment import POSITIONS, PREFIX, Alignment, SensorErrors, alignment_findings


def alignment_report(
    alignment: Alignment, *, title: str, lead: str, log_findings: Sequence[Finding]
) -> Result:
    """Return the page of an alignment."""
    verdict, *others = (finding.text for finding in alignment_findings(alignment))
    sensors, signal = alignment.sensors, _CLOCK_SIGNALS[alignment.clock_signal]
    estimates = Sheet(
        ("", "estimate", "unit"),
        _estimate_rows(alignment),
        "Clocks, frames and path. ±: half width of the 95 % interval, from blocks of time.",
    )
    sections = [section("What was found", estimates, Bullets([with_symbols(text) for text in others]))]
    if sensors is not None:
        caption = (
            "On board minus cameras. ±: half width of the 95 % interval, from blocks of time. Delays are relative to "
            f"{signal}, by which the clocks were aligned."
        )
        sections.append(section("Errors", Sheet(_ERROR_HEADINGS, _error_rows(sensors), caption)))
        for heading, names in (("Orientation", ANGLE_NAMES), ("Position", POSITIONS)):
            if heading == "Orientation" or sensors.position is not None:
                seen = _seen_series(alignment.log, names)
                sections.append(section(heading, seen, errors_series(alignment, sensors, names)))
    without_angles = "The errors of the angles: the log has no theta, phi and psi to compare."
    without_position = "The errors of x and y: the log has no position to compare."
    return Result(
        title=title,
        lead=lead,
        verdict=[("", verdict)],
        sections=sections,
        undecided=[
            "Which of the two is right where they differ: the cameras are taken as the truth.",
            f"A delay of {signal}, which cannot be separated from the clock's offset.",
            without_angles if sensors is None else without_position if sensors.position is None else "",
        ],
        findings=log_findings,
        data=_data(alignment, log_findings),
    )


def _seen_series(log: Log, names: Sequence[str]) -> TimeSeries:
    """Return columns as measured by the cameras and by the sensors on board."""
    panels = []
    for name in names:
        scale, unit = (1.0, "m") if name in POSITIONS else _UNITS[name]
        own, seen = scale * log[name], scale * log[PREFIX + name]
        lines = (Line("on board", own, "second"), Line("cameras", seen, "measured"))
        panels.append(Panel(f"{state_mark(name)} [{unit}]", lines))
    return TimeSeries(log.t, panels, "On board and by the cameras.", across=_ACROSS)


def errors_series(alignment: Alignment, sensors: SensorErrors, names: Sequence[str]) -> TimeSeries:
    """Return errors of angles or positions over time: each sample, the running mean, and what explains them.

    The drift explains an angle's error, the heading's error explains a position's.
    """
    from pandas import Series  # takes longer to import than the rest

    t, samples, panels = alignment.log.t, max(1, round(1.0 / alignment.log.sample_time)), []
    for name in names:
        scale, unit = _UNITS[name]
        error = scale * sensors.errors[name]
        known = np.isfinite(error)
        mean = Series(error).rolling(samples, min_periods=1, center=True).mean()
        if name in POSITIONS:
            position, label = sensors.position, "from the heading's error"
            beside = (
                scale * position.predicted[:, POSITIONS.index(name)] if position else np.full(len(t), np.nan)
            )
        else:
            beside = error[known].mean() + scale * sensors.of[name].drift * (t - t[known].mean())
            label = "drift"
        lines = (
            Line("each sample", error, "quiet"),
            Line("mean over 1 s", np.where(known, mean, np.nan), "measured"),
            Line(label, beside, "second"),
        )
        panels.append(Panel(f"error of {state_mark(name)} [{unit}]", lines))
    caption = (
        "On board minus cameras. Drift: the straight line fitted to the error; from the heading's error: the path "
        "rotated by it, less the path."
    )
    return TimeSeries(t, panels, caption, across=_ACROSS)


_ACROSS = "time of the log [s]"
#: factor and unit of an error
_UNITS = {
    **dict.fromkeys(ANGLE_NAMES, (float(np.degrees(1.0)), "deg")),
    **dict.fromkeys(POSITIONS, (1e3, "mm")),
}
_ERROR_HEADINGS = ("", "unit", "RMS", "largest", "drift per minute", "RMS about the drift", "delay [ms]")
#: the signal by which the clocks of log and cameras are aligned
_CLOCK_SIGNALS = {"gyro": "the gyro", "angles": "the log's angles"}


def _estimate_rows(alignment: Alignment) -> list[tuple[str, ...]]:
    """Return name, value with half width, and unit of clock, frames, lever arm and scale of the path."""
    motion, frame, path = alignment.motion, alignment.frame, alignment.path
    rows: list[tuple[str, float, float, str]] = [
        ("cameras' clock at the log's zero", motion.clock.offset, motion.offset_half_width, "s"),
        ("rate of that clock above the log's", 1e6 * motion.clock.rate, 1e6 * motion.rate_half_width, "ppm"),
    ]
    turned = np.degrees(np.column_stack([motion.body_marker.as_rotvec(), motion.rotation_half_width]))
    rows += [
        (f"markers' frame against the body's, about {axis}", value, half, "deg")
        for axis, (value, half) in zip("xyz", turned.tolist(), strict=True)
    ]
    if frame is not None:
        up = frame.camera_world.apply([0.0, 0.0, 1.0])
        tilt = float(np.degrees(np.arccos(np.clip(up[2], -1.0, 1.0))))
        rows.append(("tilt of the cameras' frame", tilt, float(np.degrees(frame.tilt_half_width)), "deg"))
    if path is not None:
        arms = np.column_stack([path.arm, path.arm_half_width])
        rows += [
            (f"lever arm, {axis}", 1e3 * value, 1e3 * half, "mm")
            for axis, (value, half) in zip("xyz", arms.tolist(), strict=True)
        ]
        rows.append(("distances, log over cameras", path.scale, path.scale_half_width, ""))
    return [(name, plus_minus(value, half), unit) for name, value, half, unit in rows]


def _error_rows(sensors: SensorErrors) -> list[tuple[str, ...]]:
    """Return name, unit, rms, largest, drift a minute with half width, wander and delay [ms] of each."""
    rows = []
    for name, sensor in sensors.of.items():
        scale, unit = _UNITS[name]
        drift = signed(plus_minus(60 * scale * sensor.drift, 60 * scale * sensor.drift_half_width))
        value, half = sensor.delay, sensor.delay_half_width
        delay = "–" if value is None or half is None else signed(plus_minus(1e3 * value, 1e3 * half))
        sizes = (digits(scale * value) for value in (sensor.rms, sensor.largest))
        rows.append((state_mark(name), unit, *sizes, drift, digits(scale * sensor.wander), delay))
    return rows


def _data(alignment: Alignment, log_findings: Sequence[Finding]) -> dict[str, object]:
    """Return what results.json holds: SI units, quaternions wxyz, half widths of 95 %."""
    motion, sensors = alignment.motion, alignment.sensors
    return {
        "findings": by_severity([*log_findings, *alignment_findings(alignment)]),
        "clock": to_results(motion.clock)
        | {
            "offset_half_width": motion.offset_half_width,
            "rate_half_width": motion.rate_half_width,
            "follows": alignment.clock_signal,
            "rival": alignment.rival_clock,
        },
        "body_marker": {"wxyz": motion.body_marker, "half_width": motion.rotation_half_width},
        "unseen": alignment.unseen,
        "frame": alignment.frame,
        "path": alignment.path,
        "increments": {"count": motion.increments, "rms_error": motion.error, "rms": motion.motion},
        "sensors": sensors and {**sensors.of, "position": sensors.position, "duration": sensors.duration},
    }
