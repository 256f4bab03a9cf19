"""The driveline stage: its figures (the thesis's Figures 3.1 and 3.2, the friction), its page, and its results.json."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ballbot.findings import Finding, finding_results, texts
from ballbot.identification.driveline import NAMES, QUANTITIES, DrivelineFit, Sweep
from ballbot.mechanics.friction import stribeck_gradient
from ballbot.report.blocks import Cell, Paragraph, Result, Sheet, section
from ballbot.report.palette import BLUE, GREEN, INK, ORANGE
from ballbot.report.series import Line, Panel, TimeSeries
from ballbot.report.style import REFERENCE, WITH_FRICTION, WITHOUT_FRICTION, LineStyle, drawn_picture, thinned
from ballbot.rounding import between, digits

_WHEELS = ((INK, "-"), (BLUE, "--"), (ORANGE, "-."), (GREEN, ":"))
#: a broad pale line beneath, for the model's with friction lies on it
_MEASURED: LineStyle = {**REFERENCE, "linewidth": 3.2}


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


def comparison_series(sweep: Sweep, fit: DrivelineFit) -> TimeSeries:
    """Return a wheel's speed over time: measured, with friction, and without."""
    lines = (
        Line(name="measured", values=sweep.speed, look="reference"),
        Line(name="without friction", values=fit.without, look="second"),
        Line(name="with friction", values=fit.predicted, look="first"),
    )
    error = (Line(name="with friction less measured", values=fit.predicted - sweep.speed, look="first"),)
    return TimeSeries(
        t=sweep.t,
        panels=(
            Panel(label=f"speed of wheel {sweep.wheel} [rad/s]", lines=lines),
            Panel(label="with friction less measured [rad/s]", lines=error),
        ),
        caption=(
            f"Wheel {sweep.wheel} over time, and the error of the model with friction. "
            "Where the supply limits the speed, the torque recorded is not the one that acts, and the model starts "
            "anew from the measured speed."
        ),
    )


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
    law = fit.law
    gradient = stribeck_gradient(
        speed, stribeck=law.stribeck, stribeck_speed=law.stribeck_speed, stribeck_exponent=1.0
    )[:, : len(NAMES)]
    errors = np.nan_to_num(fit.standard_errors)
    covariance = fit.correlation * np.outer(errors, errors)
    return np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", gradient, covariance, gradient), 0.0))


def driveline_report(
    robot: str,
    sweeps: Sequence[Sweep],
    fits: Sequence[DrivelineFit],
    findings: Sequence[Finding] = (),
) -> Result:
    """Return the page."""
    seconds = sweeps[0].t[-1] - sweeps[0].t[0]
    largest = max(float(np.abs(sweep.torque).max()) for sweep in sweeps)
    words = (
        "A driveline resists with b ω + (c + s exp(−|ω/v_s|)) sgn ω. Each is identified as an axis of the file's "
        "inertia (docs/axis.md)."
    )
    rows = [
        # the interval in a second line, so that four wheels fit on a page
        (name, unit, *(Cell(text=text, below=below) for text, _, below in parted))
        for name, unit, *cells in parameter_rows(fits)
        for parted in [[cell.removesuffix(")").partition(" (") for cell in cells]]
    ]
    return Result(
        title=f"{robot}: friction of the drivelines",
        lead=f"Wheels free, {seconds:.0f} s, up to {largest:.3g} N m and {sweeps[0].limit:.4g} rad/s.",
        verdict=[(f"Wheel {fit.wheel}", _sentence(fit)) for fit in fits],
        sections=[
            section(
                "Friction found",
                Paragraph(text=words),
                Sheet(
                    headings=("parameter", "unit", *(f"wheel {fit.wheel}" for fit in fits)),
                    rows=rows,
                    caption="With 95 % intervals.",
                ),
                Paragraph(
                    text="`ballbot identify --sweep results.json` takes b and c of each wheel from here, with their "
                    "standard errors and correlation, and finds s, v_s and δ from its logs alone. `robot.toml` has b, "
                    "c and s of each wheel and the mean of v_s."
                ),
                drawn_picture(
                    "curve",
                    partial(curve_figure, fits, sweeps[0].limit),
                    "Friction over speed with its 95 % band, up to the speed limit and at low speeds.",
                ),
            ),
            section(
                "Torque and speed, measured",
                drawn_picture(
                    "measured",
                    partial(measured_figure, sweeps),
                    "Torque over the speed of each wheel, free of the ball. The "
                    "vertical ends are the supply's speed limit.",
                ),
            ),
            section(
                "Measured and modelled",
                Sheet(
                    headings=("", "RMS [rad/s]", "without friction"),
                    rows=[(f"wheel {one.wheel}", digits(one.rmse), digits(one.rmse_without)) for one in fits],
                    caption="Errors of the simulated speed.",
                ),
                *(comparison_series(*row) for row in zip(sweeps, fits, strict=True)),
            ),
        ],
        undecided=[*texts([one for fit in fits for one in fit.findings]), _CLOSING],
        findings=findings,
        data=_data(fits, findings),
    )


_CLOSING = (
    "A slow sweep stays long at high speeds and passes the low ones, where s and v_s act, in a few tenths of a second "
    "each time. The inertia is from the robot file."
)


def _sentence(fit: DrivelineFit) -> str:
    """Return a wheel's friction in words."""
    b, c, s, _ = fit.values.tolist()
    return (
        f"The break-away torque is {digits(c + s, 2)} N m; in motion the friction is {digits(c, 2)} N m plus "
        f"{digits(b, 2)} N m per rad/s. Without friction the error of the speed is "
        f"{digits(fit.rmse_without / max(fit.rmse, 1e-12), 2)} times as large."
    )


def parameter_rows(fits: Sequence[DrivelineFit]) -> list[tuple[str, ...]]:
    """Return each parameter's symbol, unit and values by wheel, with 95 % intervals."""
    return [(one.symbol, one.unit, *(_written(fit, i) for fit in fits)) for i, one in enumerate(QUANTITIES)]


def _written(fit: DrivelineFit, place: int) -> str:
    """Return a parameter with its 95 % interval, or that it has none."""
    value, (low, high) = float(fit.values[place]), fit.intervals[place]
    if np.isfinite(high):
        return between(value, low, high)
    return "unknown" if value else "0, at its bound"


def _data(fits: Sequence[DrivelineFit], findings: Sequence[Finding]) -> dict[str, object]:
    """Return what results.json holds."""

    def table(numbers: Sequence[NDArray[np.float64]]) -> dict[str, list[float]]:
        return dict(zip(NAMES, np.transpose(numbers).tolist(), strict=True))

    return {
        "parameters": table([fit.values for fit in fits]),
        "standard_errors": table([fit.standard_errors for fit in fits]),
        "intervals": {
            f"wheel {fit.wheel}": dict(zip(NAMES, fit.intervals.tolist(), strict=True)) for fit in fits
        },
        "correlation": {"labels": list(NAMES), "matrices": [fit.correlation for fit in fits]},
        "rmse": [fit.rmse for fit in fits],
        "rmse_without_friction": [fit.rmse_without for fit in fits],
        "findings": finding_results([*findings, *(one for fit in fits for one in fit.findings)]),
    }
