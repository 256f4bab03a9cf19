"""Identification on the bench: friction upside down and of drivelines, geometry, a free swing."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure

from ballbot.arrays import Floats
from ballbot.findings import Finding, by_severity, texts
from ballbot.fitting.uncertainty import correlation
from ballbot.identification.driveline import BALL_NAMES, NAMES, QUANTITIES, DrivelineFit, Sweep
from ballbot.identification.geometry import Geometry
from ballbot.identification.swing import SwingFit
from ballbot.identification.upside_down import UpsideDown, cut_ball_windows, predicted_velocity
from ballbot.log import Log
from ballbot.mechanics.friction import steady_friction
from ballbot.report.blocks import Bullets, Paragraph, Result, Sheet, section
from ballbot.report.series import IN_TURN, Line, Panel, TimeSeries
from ballbot.report.style import LOOKS, drawn_picture, one_panel, thinned
from ballbot.report.words import driveline_symbols, logs_words
from ballbot.results import to_results
from ballbot.robot import Friction, Robot
from ballbot.rounding import digits, interval, value_and_error
from ballbot.summary import counted

#: windows shown of the log, from its middle
_WINDOWS_SHOWN = 8


def swing_series(fit: SwingFit, *, label: str = "measured") -> TimeSeries:
    """Return the recording, called by `label`, with the pendulum fitted to it, and their difference."""
    what, unit = ("angle", "deg") if fit.swing.kind == "angle" else ("rate", "deg/s")
    measured, fitted = (np.degrees(signal - fit.values[5]) for signal in (fit.swing.values, fit.predicted))
    lines = (Line(label, measured, "measured"), Line("pendulum fitted", fitted, "second"))
    difference = (Line("difference", measured - fitted, "first"),)
    return TimeSeries(
        fit.swing.t - fit.swing.t[0],
        (Panel(f"{what} [{unit}]", lines), Panel(f"measured less fitted [{unit}]", difference)),
        "The swing as recorded, and the pendulum with friction that was fitted to it.",
    )


_COMPARISON = (
    "The friction identified while balancing differs from this one for two reasons: there the weight of the robot "
    "rests on the contacts, which adds to c and s, and what the model neglects (play, slip, rollers) is absorbed by "
    "whichever parameter predicts best. Use each in the situation where it was identified."
)


def _parameter_table(fit: UpsideDown) -> Sheet:
    described = fit.described
    old = np.concatenate([quantity.nominal(described) for quantity in QUANTITIES]).tolist()
    units = [quantity.unit for quantity in QUANTITIES for _ in quantity.labels(described.wheel_count)]
    numbers = zip(fit.estimate.values.tolist(), fit.estimate.errors.tolist(), strict=True)
    rows = [
        (label, *value_and_error(*number), digits(in_file), unit)
        for label, number, in_file, unit in zip(fit.estimate.labels, numbers, old, units, strict=True)
    ]
    return Sheet(
        ("parameter", "upside down", "standard error", "robot file", "unit"),
        rows,
        f"Friction of drivelines and ball-wheel contacts. {driveline_symbols([kind.name for kind in QUANTITIES])} "
        "A dash: held at a bound, or the log does not show it.",
    )


#: units of a table's rows: factor from SI, and name
_SHOWN_IN = {"rad": (math.degrees(1.0), "deg"), "s": (1e3, "ms"), "1": (1.0, "")}


def _geometry_table(geometry: Geometry) -> Sheet:
    rows = []
    for estimate in (*geometry.measured, *geometry.wheel_ratios, *geometry.others):
        scale, unit = _SHOWN_IN.get(estimate.unit, (1.0, estimate.unit))
        value, error = value_and_error(scale * estimate.value, scale * estimate.standard_error)
        in_file, _ = value_and_error(scale * estimate.in_file, scale * estimate.standard_error)
        name = estimate.name.replace("ball.radius / wheels.radius, wheel", "r_b / r_w of wheel")
        name = "share of leaning that encoders show" if name == "leaning seen" else name
        # adding zero keeps a minus sign off what prints as nothing
        difference = f"{round(estimate.deviation, 1) + 0.0:+.1f} s.e."
        rows.append((name, value, error, in_file, unit, difference, estimate.kind))
    headings = ("quantity", "from the logs", "standard error", "in the file", "unit", "difference", "from")
    return Sheet(headings, rows, _GEOMETRY_CAPTION)


def upside_down_report(
    fit: UpsideDown,
    logs: Mapping[str, Log] = MappingProxyType({}),
    *,
    findings: Sequence[Finding] | None = None,
) -> Result:
    """Return the page of friction identified upside down."""
    dry, described = np.atleast_1d(np.asarray(fit.parameters["c"])), fit.described
    text = (
        f"In motion, wheels and contacts resist with {digits(float(dry.min()), 2)} to "
        f"{digits(float(dry.max()), 2)} N m and a part that grows with speed."
    )
    has_friction = described.friction != Friction.none(described.wheel_count)
    errors = zip("xyz", *fit.held_out.values(), strict=True)
    error_table = Sheet(
        ("axis", *(_MODELS[name] for name in fit.held_out)),
        [(f"Ω about {axis}", *map(digits, values)) for axis, *values in errors],
        f"Open-loop RMSE [rad/s] on {len(fit.held_out_windows)} held-out windows of {fit.window:g} s.",
    )
    return Result(
        title=f"{described.name}: friction with the ball on its wheels",
        lead=f"The robot clamped upside down, {logs_words(logs)}. Predictions over windows of {fit.window:g} s.",
        verdict=[("Verdict", fit.verdict.sentence), ("Friction", text if fit.verdict.usable else "")],
        sections=[
            section(
                "Friction found",
                _parameter_table(fit),
                Paragraph(_COMPARISON) if has_friction else None,
            ),
            section(
                "Predictions", error_table, *(prediction_series(fit, log) for log in [*logs.values()][:1])
            ),
        ],
        undecided=[
            *texts(fit.findings),
            "The friction while the robot balances: its weight then rests on the contacts, and the ball rolls on a "
            "floor.",
        ],
        findings=findings,
        data={
            "verdict": fit.verdict,
            "parameters": fit.parameters,
            "standard_errors": fit.standard_errors,
            "intervals": fit.intervals,
            "correlation": {"labels": fit.estimate.labels, "matrix": correlation(fit.estimate.covariance)},
            "rmse": {"columns": BALL_NAMES, "held_out": fit.held_out},
            "windows": {"length": fit.window, "fit": fit.fit_windows, "held_out": fit.held_out_windows},
            "findings": by_severity([*(findings or ()), *fit.findings]),
        },
    )


#: names of the models as headings
_MODELS = {
    "found": "with the friction found",
    "none": "without friction",
    "robot file": "with the friction of the robot file",
}


def prediction_series(fit: UpsideDown, log: Log) -> TimeSeries:
    """Return the ball's velocity over some windows of a log: measured, and predicted from each one's start."""
    every = cut_ball_windows(fit.robot, [log], duration=fit.window)
    first = max(0, (len(every) - _WINDOWS_SHOWN) // 2)
    windows = every.take(np.arange(first, min(first + _WINDOWS_SHOWN, len(every))))
    predicted = np.array([predicted_velocity(windows, *fit.models[name]) for name in ("found", "none")])
    predicted[:, :, -1] = np.nan  # a line ends with its window
    samples = windows.sample_time * np.arange(1.0, windows.measured.shape[1] + 1.0)
    held_out = {(span.log, span.start) for span in fit.held_out_windows}
    panels = []
    for axis, name in enumerate("xyz"):
        measured = windows.measured[..., axis].ravel()
        lines = (
            Line("measured", measured, "measured"),
            Line("without friction", predicted[1, ..., axis].ravel(), "second"),
            Line("with the friction found", predicted[0, ..., axis].ravel(), "first"),
        )
        largest = 1.3 * float(np.abs(measured).max())  # without friction it leaves the panel
        panels.append(Panel(f"Ω about {name} [rad/s]", lines, ends=(-largest, largest)))
    return TimeSeries(
        np.concatenate([span.start + samples for span in windows.spans]),
        panels,
        f"{counted(len(windows.spans), 'window')} from the middle of the first log. Predictions start again "
        f"from the measured velocity every {fit.window:g} s. The axes are those of the measured velocity: a "
        "prediction may leave them.",
        across="time of the log [s]",
        shaded=[(span.start, span.end) for span in windows.spans if (span.log, span.start) in held_out],
        shade="held out",
    )


def geometry_report(
    geometry: Geometry, findings: Sequence[Finding], *, robot: Robot, log_findings: Sequence[Finding]
) -> Result:
    """Return the page of a geometry identified from logs."""
    (first, *others), count = texts(findings), len([*geometry.measured, *geometry.wheel_ratios])
    return Result(
        title=f"{robot.name}: geometry and mounting from logs",
        lead="By kinematics alone: wheels, gyro, camera and motion capture measure the same motion.",
        verdict=[("", f"{count} lengths, ratios and angles were identified. {first}")],
        sections=[section("Geometry", _geometry_table(geometry), Bullets(others))],
        undecided=[
            "Ratios stand for lengths: the wheels show r_b / r_w, and only motion capture shows a length itself.",
            "The shape of single rollers, and a ball that is not round.",
        ],
        findings=log_findings,
        data=to_results(geometry) | {"findings": by_severity([*log_findings, *findings])},
    )


_GEOMETRY_CAPTION = (
    "Identified from the logs, beside the value in the robot file or the one that follows from it. Each wheel's own "
    "ratio r_b / r_w stands beside that of all wheels. Difference: file minus logs, in standard errors (s.e.); slip of "
    "the wheels can cause 0.6 % or 0.4 degrees. Azimuths that are off alike are a rotation of the camera's frame. Play "
    "of the gears hides a part of the leaning from the encoders: without play they show all of it (1.00)."
)


def measured_figure(sweeps: Sequence[Sweep]) -> Figure:
    """Return the thesis's Figure 3.1: torque over measured wheel speed."""
    figure, axes = one_panel("wheel speed [rad/s]", "torque [N m]")
    for sweep, look in zip(sweeps, IN_TURN, strict=False):
        axes.plot(*thinned(sweep.speed, sweep.torque), label=f"wheel {sweep.wheel}", **LOOKS[look])
    axes.legend(loc="upper left")
    return figure


def comparison_series(sweep: Sweep, fit: DrivelineFit) -> TimeSeries:
    """Return a wheel's speed over time: measured, with friction, and without."""
    lines = (
        Line("measured", sweep.speed, "reference"),
        Line("without friction", fit.without, "second"),
        Line("with friction", fit.predicted, "first"),
    )
    error = (Line("with friction less measured", fit.predicted - sweep.speed, "first"),)
    return TimeSeries(
        sweep.t,
        (
            Panel(f"speed of wheel {sweep.wheel} [rad/s]", lines),
            Panel("with friction less measured [rad/s]", error),
        ),
        f"Wheel {sweep.wheel} over time, and the error of the model with friction. Where the supply limits the speed, "
        "the torque recorded is not the one that acts, and the model starts anew from the measured speed.",
    )


def curve_figure(curves: Sequence[Callable[[Floats], Floats]], fastest: float) -> Figure:
    """Return each wheel's friction [N m] over speeds (k,) above zero [rad/s]; the right panel looks at low speeds."""
    figure = Figure(figsize=(7.4, 3.2), layout="constrained")
    panels = figure.subplots(1, 2)
    for axes, end in zip(panels, (fastest, min(fastest, 4.0)), strict=True):
        speed = np.geomspace(1e-3, 1.0, 200) * end
        for wheel, (curve, look) in enumerate(zip(curves, IN_TURN, strict=False), start=1):
            axes.plot(speed, curve(speed), label=f"wheel {wheel}", **LOOKS[look])
        axes.set_xlabel("wheel speed [rad/s]")
        axes.set_ylim(bottom=0.0)
    panels[0].set_ylabel("friction torque [N m]")
    panels[0].legend(loc="upper left")
    return figure


def driveline_report(
    robot: str, sweeps: Sequence[Sweep], fits: Sequence[DrivelineFit], findings: Sequence[Finding] = ()
) -> Result:
    """Return the page."""
    seconds = sweeps[0].t[-1] - sweeps[0].t[0]
    largest = max(float(np.abs(sweep.torque).max()) for sweep in sweeps)
    curves = "Friction over speed, up to the speed limit and at low speeds."
    measured = "Torque over the speed of each wheel, free of the ball. The vertical ends are the supply's speed limit."
    laws = [partial(steady_friction, friction=fit.friction) for fit in fits]
    wheels = [f"wheel {fit.wheel}" for fit in fits]
    errors = [(wheel, fit.rmse, fit.rmse_without) for wheel, fit in zip(wheels, fits, strict=True)]
    of_fits = [finding for fit in fits for finding in fit.findings]
    words = (
        "A driveline resists with b ω + (c + s exp(−|ω/v_s|^delta)) sgn ω. Each is identified as an axis of the file's "
        "inertia (docs/axis.md)."
    )
    return Result(
        title=f"{robot}: friction of the drivelines",
        lead=f"Wheels free, {seconds:.0f} s, up to {largest:.3g} N m and {sweeps[0].limit:.4g} rad/s.",
        verdict=[(f"Wheel {fit.wheel}", _sentence(fit)) for fit in fits],
        sections=[
            section(
                "Friction found",
                Paragraph(words),
                Sheet(("parameter", "unit", *wheels), parameter_rows(fits), "With 95 % intervals."),
                Paragraph(
                    "`robot.toml` has b, c and s of each wheel and the means of v_s and delta: of motor and gear. "
                    "The friction of balancing has other losses too; `ballbot identify` finds it, and compares."
                ),
                drawn_picture("curve", curves, curve_figure, laws, sweeps[0].limit),
            ),
            section(
                "Torque and speed, measured", drawn_picture("measured", measured, measured_figure, sweeps)
            ),
            section(
                "Measured and modelled",
                Sheet(("", "RMS [rad/s]", "without friction"), errors, "Errors of the simulated speed."),
                *(comparison_series(*row) for row in zip(sweeps, fits, strict=True)),
            ),
        ],
        undecided=[
            *texts(of_fits),
            "The inertia is from the robot file.",
        ],
        findings=findings,
        data={
            "parameters": _by_symbol([fit.values for fit in fits]),
            "standard_errors": _by_symbol([fit.standard_errors for fit in fits]),
            "intervals": {
                f"wheel {fit.wheel}": dict(zip(NAMES, fit.intervals.tolist(), strict=True)) for fit in fits
            },
            "correlation": {"labels": list(NAMES), "matrices": [fit.correlation for fit in fits]},
            "rmse": [fit.rmse for fit in fits],
            "rmse_without_friction": [fit.rmse_without for fit in fits],
            "findings": by_severity([*findings, *of_fits]),
        },
    )


def _by_symbol(numbers: Sequence[Floats]) -> dict[str, list[float]]:
    return dict(zip(NAMES, np.transpose(numbers).tolist(), strict=True))


def _sentence(fit: DrivelineFit) -> str:
    """Return a wheel's friction in words."""
    b, c, s, *_ = fit.values.tolist()
    return (
        f"The break-away torque is {digits(c + s, 2)} N m; in motion the friction is {digits(c, 2)} N m plus "
        f"{digits(b, 2)} N m per rad/s. Without friction the error of the speed is "
        f"{digits(fit.rmse_without / max(fit.rmse, 1e-12), 2)} times as large."
    )


def parameter_rows(fits: Sequence[DrivelineFit]) -> list[tuple[str, ...]]:
    """Return each parameter's symbol, unit and values by wheel, with 95 % intervals; "unknown" without one."""

    def written(value: float, ends: Floats) -> str:
        if np.isfinite(ends[1]):
            return f"{digits(value)} ({interval(*ends.tolist())})"
        return "unknown" if value else "0, at its bound"

    return [
        (quantity.symbol, quantity.unit, *(written(float(fit.values[i]), fit.intervals[i]) for fit in fits))
        for i, quantity in enumerate(QUANTITIES)
    ]
