"""The driveline stage: its figures (the thesis's Figures 3.1 and 3.2, the friction), its page, and its results.json."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.console import RenderableType
from rich.text import Text

from ballbot.findings import Finding, finding_results, note, texts
from ballbot.identification.driveline import NAMES, QUANTITIES, DrivelineFit, PrintedFit, Sweep
from ballbot.mechanics.friction import stribeck_gradient
from ballbot.report.blocks import Block, Cell, Paragraph, Report, Sheet, section, table
from ballbot.report.palette import BLUE, GREEN, INK, ORANGE
from ballbot.report.provenance import Provenance
from ballbot.report.series import Line, Panel, TimeSeries
from ballbot.report.style import REFERENCE, WITH_FRICTION, WITHOUT_FRICTION, LineStyle, drawn_picture, thinned
from ballbot.report.words import with_error
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


def comparison_series(sweep: Sweep, fit: DrivelineFit, printed: PrintedFit) -> TimeSeries:
    """Return a wheel's speed over time: measured, with friction, without, and with (3.2) as printed."""
    lines = (
        Line(name="measured", values=sweep.speed, look="reference"),
        Line(name="without friction", values=fit.without, look="second"),
        Line(name="with wind-up at the limit", values=printed.predicted, look="third"),
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
    _, _, s, v_s, delta = fit.values
    gradient = stribeck_gradient(speed, stribeck=s, stribeck_speed=v_s, stribeck_exponent=delta)
    errors = np.nan_to_num(fit.standard_errors)
    covariance = np.nan_to_num(fit.correlation) * np.outer(errors, errors)
    return np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", gradient, covariance, gradient), 0.0))


#: beyond this correlation two parameters are better known together
_CLOSE = 0.9
#: an error so many times larger is the clamp's, not the search's
_WINDS_UP = 1.5


def driveline_report(
    robot: str,
    sweeps: Sequence[Sweep],
    fits: Sequence[DrivelineFit],
    printed: Sequence[PrintedFit],
    made: Provenance,
    findings: Sequence[Finding] = (),
) -> Report:
    """Return the page."""
    seconds = sweeps[0].t[-1] - sweeps[0].t[0]
    largest = max(float(np.abs(sweep.torque).max()) for sweep in sweeps)
    words = (
        "A driveline resists with b ω + (c + s exp(−|ω/v_s|^δ)) sgn ω. The five parameters of each are those whose "
        'simulated speed comes closest to the measured one, by the norm of its error, the cost. "Unknown" means that '
        "the sweep cannot identify it."
    )
    headings = ("parameter", "unit", *(f"wheel {fit.wheel}" for fit in fits))
    rows = [(name, unit, *map(_interval_below, cells)) for name, unit, *cells in parameter_rows(fits)]
    parameters = Sheet(headings=headings, rows=rows, caption="With 95 % intervals.")
    return Report(
        title=f"{robot}: friction of the drivelines",
        lead=f"Wheels free, {seconds:.0f} s, up to {largest:.3g} N m and {sweeps[0].limit:.4g} rad/s.",
        verdict=[(f"Wheel {fit.wheel}", _sentence(fit)) for fit in fits],
        sections=[
            section(
                "Friction found",
                Paragraph(text=words),
                parameters,
                Paragraph(text=_use(fits)),
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
            section("Measured and modelled", *_modelled(sweeps, fits, printed)),
        ],
        undecided=texts(driveline_findings(fits, printed)),
        made=made,
        findings=findings,
    )


def _use(fits: Sequence[DrivelineFit]) -> str:
    """Return which of the numbers other commands read."""
    needed = [
        f"{name} of wheel {fit.wheel}"
        for fit in fits
        for name in ("b", "c")
        if fit.unknown[NAMES.index(name)]
    ]
    lacking = f" It needs all of them; unknown here: {', '.join(needed)}." if needed else ""
    return (
        "`ballbot identify --sweep results.json` takes b and c of each wheel from here, with their standard errors and "
        f"correlation, and finds s, v_s and δ from its logs alone.{lacking} `robot.toml` has b, c and s of each wheel "
        "and the means of v_s and δ."
    )


def _modelled(
    sweeps: Sequence[Sweep], fits: Sequence[DrivelineFit], printed: Sequence[PrintedFit]
) -> Iterator[Block]:
    caption = (
        "Errors of the simulated speed. The last two columns are for a model that limits only the speed that friction "
        "and sensors see, while the integrated speed winds up beyond the supply's limit: with five parameters fitted "
        "to that model, and with the friction found here."
    )
    headings = (
        *("wheel", "cost [rad/s]", "RMS error [rad/s]", "without friction"),
        *("wind-up at the limit, refitted", "wind-up at the limit, this friction"),
    )
    yield Sheet(headings=headings, rows=error_rows(fits, printed), caption=caption)
    yield drawn_picture(
        "torque-speed",
        partial(torque_speed_figure, sweeps[0], fits[0]),
        f"The characteristic of wheel {sweeps[0].wheel}. Without friction a wheel is at "
        "the limit, or on its way between the two, all the time.",
    )
    for row in zip(sweeps, fits, printed, strict=True):
        yield comparison_series(*row)


def _sentence(fit: DrivelineFit) -> str:
    """Return a wheel's friction in words."""
    b, c, s, *_ = fit.values
    unknown = {name for name, is_unknown in zip(NAMES, fit.unknown, strict=True) if is_unknown}
    words = ["unknown" if "c" in unknown else f"{digits(float(c), 2)} N m"]
    words.append("an unknown torque" if "b" in unknown else f"{digits(float(b), 2)} N m per rad/s")
    start = "is unknown" if unknown & {"c", "s"} else f"is {digits(float(c + s), 2)} N m"
    ratio = (
        ""
        if fit.rmse <= 0.0
        else f" Without friction the error of the speed is {digits(fit.rmse_without / fit.rmse, 2)} times"
    )
    larger = f"{ratio} as large." if ratio else ""
    return f"The break-away torque {start}; in motion the friction is {words[0]} plus {words[1]}.{larger}"


def parameter_rows(fits: Sequence[DrivelineFit]) -> list[tuple[str, ...]]:
    """Return each parameter's symbol, unit and values by wheel, with 95 % intervals."""
    return [(one.symbol, one.unit, *(_written(fit, i) for fit in fits)) for i, one in enumerate(QUANTITIES)]


def _interval_below(text: str) -> Cell:
    """Return a cell with the interval in a second line, so that four wheels fit on a page."""
    value, _, interval = text.partition(" (")
    return Cell(text=value, below=interval.removesuffix(")"))


def _written(fit: DrivelineFit, place: int) -> str:
    """Return a parameter with its 95 % interval, or that it is unknown."""
    if fit.unknown[place]:
        return "unknown"
    interval = fit.intervals.get(NAMES[place])
    if interval is not None:
        return between(float(fit.values[place]), interval.lower, interval.upper)
    return with_error(float(fit.values[place]), float(fit.standard_errors[place]))


def error_rows(fits: Sequence[DrivelineFit], printed: Sequence[PrintedFit]) -> list[tuple[str, ...]]:
    """Return RMS errors [rad/s] by wheel: with friction, without, and with a speed that winds up."""
    return [
        (
            f"wheel {fit.wheel}",
            digits(fit.cost),
            digits(fit.rmse),
            digits(fit.rmse_without),
            digits(clamp.rmse),
            digits(clamp.rmse_restarted),
        )
        for fit, clamp in zip(fits, printed, strict=True)
    ]


def driveline_findings(fits: Sequence[DrivelineFit], printed: Sequence[PrintedFit]) -> list[Finding]:
    """Return what the sweep shows and what it does not."""
    sentences = []
    for fit in fits:
        pairs = [
            f"{NAMES[i]} and {NAMES[j]} ({fit.correlation[i, j]:+.2f})"
            for i in range(5)
            for j in range(i + 1, 5)
            if abs(fit.correlation[i, j]) > _CLOSE and not (fit.unknown[i] or fit.unknown[j])
        ]
        close = f" Poorly separated: {', '.join(pairs)}." if pairs else ""
        bound = [NAMES[i] for i in range(5) if not (np.isfinite(fit.standard_errors[i]) or fit.unknown[i])]
        held = f" At a bound, without a standard error: {', '.join(bound)}." if bound else ""
        open_ones = [NAMES[i] for i in np.flatnonzero(fit.unknown)]
        unknown = (
            f" The sweep does not identify {', '.join(open_ones)}: "
            "any value within the bounds fits about as well."
            if open_ones
            else ""
        )
        sentences.append(f"Wheel {fit.wheel}: {_sureness(fit)}.{close}{held}{unknown}")
    ratio = max(clamp.rmse / fit.rmse for fit, clamp in zip(fits, printed, strict=True))
    sentences.append(
        "A slow sweep stays long at high speeds and passes the low ones, where s, v_s "
        "and delta act, in a few tenths of a second each time, so these and c are "
        "known better together than each by itself. The inertia is from the robot file."
    )
    if ratio > _WINDS_UP:
        sentences.append(
            "With a speed that winds up at the supply's limit, as in the thesis's equation (3.2), the best five "
            f"parameters leave up to {ratio:.1f} times the error: the speed leaves the limit late, and the search "
            "compensates with friction that does not exist."
        )
    return [note("driveline", sentence) for sentence in sentences]


def _sureness(fit: DrivelineFit) -> str:
    """Return how sure b and the least sure parameter are; at a bound there is no telling."""
    # delta and v_s are above zero, the others may have ended there
    known = (np.asarray(fit.values) > 0.0) & ~fit.unknown
    shares = np.divide(_deviations(fit), fit.values, out=np.full(len(NAMES), np.nan), where=known)
    known = np.flatnonzero(~np.isnan(shares))
    if not known.size:
        return "no parameter has a standard error"
    worst = int(known[shares[known].argmax()])
    viscous = f"b to {_percent(shares[0])} %, " if 0 in known else ""
    surely = f"to {_percent(shares[worst])} %" if np.isfinite(shares[worst]) else "with an open interval"
    return f"{viscous}least sure is {NAMES[worst]}, {surely}"


def _percent(share: float) -> str:
    """Return a share in percent with two significant digits and no exponent."""
    return f"{float(f'{100.0 * share:.2g}'):g}"


def _deviations(fit: DrivelineFit) -> NDArray[np.float64]:
    """Return the standard errors (5,), or what a profile's interval is worth; infinite if it is open."""
    errors = np.array(fit.standard_errors, dtype=np.float64)
    for place, name in enumerate(NAMES):
        interval = fit.intervals.get(name)
        if interval is not None and interval.method == "profile":
            errors[place] = np.nan_to_num(interval.deviation, nan=np.inf)
    return errors


def _known(fit: DrivelineFit, numbers: NDArray[np.float64], place: int) -> float:
    """Return a number of a parameter, NaN (null in the file) if the parameter is unknown."""
    return math.nan if fit.unknown[place] else float(numbers[place])


def driveline_results(
    fits: Sequence[DrivelineFit],
    printed: Sequence[PrintedFit],
    made: Provenance,
    findings: Sequence[Finding] = (),
) -> dict[str, object]:
    """Return what results.json holds."""
    return {
        "parameters": {name: [_known(fit, fit.values, i) for fit in fits] for i, name in enumerate(NAMES)},
        "standard_errors": {
            name: [_known(fit, fit.standard_errors, i) for fit in fits] for i, name in enumerate(NAMES)
        },
        "intervals": {f"wheel {fit.wheel}": fit.intervals for fit in fits},
        "torque_delay": [fit.delay for fit in fits],
        "rmse_of_one_step": [fit.innovation for fit in fits],
        "unknown": {f"wheel {fit.wheel}": [NAMES[i] for i in np.flatnonzero(fit.unknown)] for fit in fits},
        "findings": finding_results([*findings, *driveline_findings(fits, printed)]),
        "correlation": {"labels": list(NAMES), "matrices": [fit.correlation for fit in fits]},
        "cost": [fit.cost for fit in fits],
        "samples": [fit.samples for fit in fits],
        "rmse": [fit.rmse for fit in fits],
        "rmse_without_friction": [fit.rmse_without for fit in fits],
        "clamp_as_printed": {
            "parameters": {name: [float(one.values[i]) for one in printed] for i, name in enumerate(NAMES)},
            "rmse": [one.rmse for one in printed],
            "rmse_of_the_friction_found": [one.rmse_restarted for one in printed],
        },
        "provenance": made,
    }


def driveline_parts(fits: Sequence[DrivelineFit], printed: Sequence[PrintedFit]) -> Iterator[RenderableType]:
    """Yield the friction of each wheel, the errors of the speed, and the findings."""
    headings = ("parameter", "unit", *(f"wheel {fit.wheel}" for fit in fits))
    yield table("Friction of the drivelines", headings, parameter_rows(fits))
    headings = (
        "",
        "cost (3.5)",
        "RMS [rad/s]",
        "without friction",
        "(3.2) as printed",
        "same friction in (3.2)",
    )
    yield table("Speed errors", headings, error_rows(fits, printed))
    for finding in driveline_findings(fits, printed):
        yield Text(finding.text)
