"""What is identified on the bench: friction upside down (figures and tables), geometry (table), a free swing (figure).

Upside down: the ball's measured and predicted velocity. Swing: the record, the pendulum
fitted to it, and the residual.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from ballbot.findings import Finding, finding_results, texts
from ballbot.identification.driveline import QUANTITIES
from ballbot.identification.geometry import Geometry, GeometryQuantity
from ballbot.identification.swing import SwingFit
from ballbot.identification.upside_down import UpsideDown, cut_ball_windows
from ballbot.log import Log
from ballbot.report.blocks import Bullets, Paragraph, Result, Sheet, section
from ballbot.report.series import Line, Panel, TimeSeries
from ballbot.report.style import (
    MEASURED,
    WITHOUT_FRICTION,
    thinned,
)
from ballbot.report.words import driveline_symbols, logs_words
from ballbot.robot import Friction, Robot
from ballbot.rounding import digits, unit_heading, value_and_error
from ballbot.simulation.upside_down import ClampedBall, simulate_balls
from ballbot.summary import counted

#: windows shown of the log, from its middle
_WINDOWS_SHOWN = 8


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
    upper.set_ylabel(unit_heading("angle" if swing.kind == "angle" else "rate", unit))
    figure.legend(loc="outside upper center", ncols=2)
    lower.plot(t, in_degrees * (measured - predicted), color=MEASURED["color"], linewidth=0.8)
    lower.set_ylabel(f"difference\n[{unit}]")
    lower.set_xlabel("time [s]")
    return figure


_COMPARISON = (
    "The friction identified while balancing differs from this one for two reasons: there the weight of the robot "
    "rests on the contacts, which adds to c and s, and what the model neglects (play, slip, rollers) is absorbed by "
    "whichever parameter predicts best. Use each in the situation where it was identified."
)


def _parameter_table(found: UpsideDown, described: Robot) -> Sheet:
    rows = []
    for quantity in QUANTITIES:
        symbol = quantity.symbol
        values, errors = (np.atleast_1d(one[symbol]) for one in (found.parameters, found.standard_errors))
        numbers = zip(values.tolist(), errors.tolist(), quantity.nominal(described), strict=True)
        for i, (one, error, old) in enumerate(numbers, start=1):
            name = f"{symbol}{i}" if len(values) > 1 else symbol
            rows.append((name, *value_and_error(one, error), digits(old), quantity.unit))
    return Sheet(
        headings=("parameter", "upside down", "standard error", "robot file", "unit"),
        rows=rows,
        caption="Friction of drivelines and ball-wheel contacts. "
        f"{driveline_symbols([one.name for one in QUANTITIES])} A dash: held at a bound, or the log does not show it.",
    )


def _error_table(found: UpsideDown) -> Sheet:
    rows = [
        (f"Ω about {axis}", *(digits(float(errors[i])) for errors in found.held_out.values()))
        for i, axis in enumerate("xyz")
    ]
    title = f"Open-loop RMSE [rad/s] on {len(found.held_out_windows)} held-out windows of {found.window:g} s."
    headings = ("axis", *(_MODELS[name] for name in found.held_out))
    return Sheet(headings=headings, rows=rows, caption=title)


#: units of a table's rows: factor from SI, and name
_SHOWN_IN = {"rad": (math.degrees(1.0), "deg"), "s": (1e3, "ms"), "1": (1.0, "")}


def _row(one: GeometryQuantity) -> list[str]:
    scale, unit = _SHOWN_IN.get(one.unit, (1.0, one.unit))
    off = f"{round(one.deviation, 1) + 0.0:+.1f} s.e."  # adding zero keeps a minus sign off what prints as nothing
    error = scale * one.standard_error
    decimals = max(0, 1 - math.floor(math.log10(error)))
    numbers = (f"{number:.{decimals}f}" for number in (scale * one.value, error, scale * one.in_file))
    return [_quantity(one), *numbers, unit, off, one.kind]


def _quantity(one: GeometryQuantity) -> str:
    """Return a quantity's name in a table."""
    if one.name == "leaning seen":
        return "share of leaning that encoders show"
    return one.name.replace("ball.radius / wheels.radius, wheel", "r_b / r_w of wheel")


def upside_down_report(
    found: UpsideDown,
    described: Robot,
    logs: Mapping[str, Log],
    *,
    findings: Sequence[Finding],
) -> Result:
    """Return the page of friction identified upside down."""
    verdict = [("Verdict", found.verdict.sentence)]
    if found.verdict.usable:
        dry = np.atleast_1d(np.asarray(found.parameters["c"]))
        text = (
            f"In motion, wheels and contacts resist with {digits(float(dry.min()), 2)} to "
            f"{digits(float(dry.max()), 2)} N m and a part that grows with speed."
        )
        verdict.append(("Friction", text))
    return Result(
        title=f"{described.name}: friction with the ball on its wheels",
        lead=f"The robot clamped upside down, {logs_words(logs)}. Predictions over windows of {found.window:g} s.",
        verdict=verdict,
        sections=[
            section(
                "Friction found",
                _parameter_table(found, described),
                Paragraph(text=_COMPARISON)
                if described.friction != Friction.none(described.wheel_count)
                else None,
            ),
            section(
                "Predictions",
                _error_table(found),
                prediction_series(found, next(iter(logs.values()))),
            ),
        ],
        undecided=[
            *texts(found.findings),
            "The friction while the robot balances: its weight then rests on the contacts, and the ball rolls on a "
            "floor.",
        ],
        findings=findings,
        data=found.to_dict() | {"findings": finding_results([*findings, *found.findings])},
    )


#: the models by those names, in words
_MODELS = {
    "found": "with the friction found",
    "none": "without friction",
    "robot file": "with the friction of the robot file",
}


def prediction_series(found: UpsideDown, log: Log) -> TimeSeries:
    """Return the ball's velocity over some windows of a log: measured, and predicted from each one's start."""
    every = cut_ball_windows(found.robot, [log], duration=found.window)
    first = max(0, (len(every) - _WINDOWS_SHOWN) // 2)
    windows = every.take(np.arange(first, min(first + _WINDOWS_SHOWN, len(every))))
    predicted = simulate_balls(
        ClampedBall.of_robot(found.robot),
        frictions=[found.robot.friction, Friction.none(found.robot.wheel_count)],
        initial=windows.initial,
        torques=windows.torques,
        sample_time=windows.sample_time,
    )
    predicted[:, :, -1] = np.nan  # a line ends with its window
    samples = windows.sample_time * np.arange(1.0, windows.measured.shape[1] + 1.0)
    held_out = {(span.log, span.start) for span in found.held_out_windows}
    panels = []
    for axis, name in enumerate("xyz"):
        measured = windows.measured[..., axis].ravel()
        lines = (
            Line(name="measured", values=measured, look="measured"),
            Line(name="without friction", values=predicted[1, ..., axis].ravel(), look="second"),
            Line(name="with the friction found", values=predicted[0, ..., axis].ravel(), look="first"),
        )
        largest = 1.3 * float(np.abs(measured).max())  # without friction it leaves the panel
        panels.append(Panel(label=f"Ω about {name} [rad/s]", lines=lines, ends=(-largest, largest)))
    return TimeSeries(
        t=np.concatenate([span.start + samples for span in windows.spans]),
        panels=panels,
        caption=f"{counted(len(windows.spans), 'window')} from the middle of the first log. Predictions start again "
        f"from the measured velocity every {found.window:g} s. The axes are those of the measured velocity: a "
        "prediction may leave them.",
        across="time of the log [s]",
        shaded=[(one.start, one.end) for one in windows.spans if (one.log, one.start) in held_out],
        shade="held out",
    )


def geometry_report(
    found: Geometry,
    findings: Sequence[Finding],
    *,
    robot: Robot,
    log_findings: Sequence[Finding],
) -> Result:
    """Return the page of a geometry identified from logs."""
    (first, *others), count = texts(findings), len([*found.measured, *found.wheel_ratios])
    rows = [_row(one) for one in (*found.measured, *found.wheel_ratios, *found.others)]
    headings = ("quantity", "from the logs", "standard error", "in the file", "unit", "difference", "from")
    return Result(
        title=f"{robot.name}: geometry and mounting from logs",
        lead="By kinematics alone: wheels, gyro, camera and motion capture measure the same motion.",
        verdict=[("", f"{count} lengths, ratios and angles were identified. {first}")],
        sections=[
            section(
                "Geometry",
                Sheet(headings=headings, rows=rows, caption=_GEOMETRY_CAPTION),
                Bullets(items=others) if others else None,
            )
        ],
        undecided=[
            "Ratios stand for lengths: the wheels show r_b / r_w, and only motion capture shows a length itself.",
            "The shape of single rollers, and a ball that is not round.",
        ],
        findings=log_findings,
        data=found.to_dict() | {"findings": finding_results([*log_findings, *findings])},
    )


_GEOMETRY_CAPTION = (
    "Identified from the logs, beside the value in the robot file or the one that follows from it. Each wheel's own "
    "ratio r_b / r_w stands beside that of all wheels. Difference: file minus logs, in standard errors (s.e.); slip of "
    "the wheels can cause 0.6 % or 0.4 degrees. Azimuths that are off alike are a rotation of the camera's frame. Play "
    "of the gears hides a part of the leaning from the encoders: without play they show all of it (1.00)."
)
