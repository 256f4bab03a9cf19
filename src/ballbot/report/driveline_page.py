"""The page of the driveline stage, as HTML, and what its results.json holds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, finding_results
from ballbot.identification.driveline import NAMES, DrivelineFit, PrintedFit, Sweep
from ballbot.report.driveline_figures import (
    comparison_figure,
    curve_figure,
    measured_figure,
    torque_speed_figure,
)
from ballbot.report.page import figure_markup, render
from ballbot.report.provenance import Provenance
from ballbot.report.style import drawn
from ballbot.report.tables import digits, with_error

UNITS = ("N m s/rad", "N m", "N m", "rad/s", "")
#: beyond this correlation two parameters are better told together
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
) -> str:
    """Return the page."""
    figures = {
        "measured_figure": partial(measured_figure, sweeps),
        "curve_figure": partial(curve_figure, fits, sweeps[0].limit),
        "torque_speed_figure": partial(torque_speed_figure, sweeps[0], fits[0]),
    }
    comparisons = [
        figure_markup(drawn(partial(comparison_figure, *row), name=f"wheel-{row[0].wheel}"))
        for row in zip(sweeps, fits, printed, strict=True)
    ]
    svgs = {name: figure_markup(drawn(draw, name=name.replace("_", "-"))) for name, draw in figures.items()}
    seconds = sweeps[0].t[-1] - sweeps[0].t[0]
    largest = max(float(np.abs(sweep.torque).max()) for sweep in sweeps)
    values: dict[str, object] = {
        "title": f"{robot}: friction of the drivelines",
        "lead": f"Wheels free, {seconds:.0f} s, up to {largest:.3g} N m and {sweeps[0].limit:.4g} rad/s.",
        "wheels": [f"wheel {fit.wheel}" for fit in fits],
        "parameters": parameter_rows(fits),
        "errors": error_rows(fits, printed),
        "remarks": remarks(fits, printed),
        "comparison_figures": comparisons,
        "made": made,
        "log_findings": findings,
    }
    return render("driveline", values | svgs)


def parameter_rows(fits: Sequence[DrivelineFit]) -> list[tuple[str, ...]]:
    """Return each parameter's symbol, unit and values by wheel, with standard errors."""
    return [
        (name, unit, *(_written(fit, i) for fit in fits))
        for i, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True))
    ]


def _written(fit: DrivelineFit, place: int) -> str:
    """Return a parameter with its standard error, or that it is unknown."""
    if fit.unknown[place]:
        return "unknown"
    return with_error(float(fit.values[place]), float(fit.standard_errors[place]))


def error_rows(fits: Sequence[DrivelineFit], printed: Sequence[PrintedFit]) -> list[tuple[str, ...]]:
    """Return RMS errors [rad/s] by wheel: with friction, without, and with (3.2) as printed."""
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


def remarks(fits: Sequence[DrivelineFit], printed: Sequence[PrintedFit]) -> list[str]:
    """Return what the sweep tells and what it does not, as sentences."""
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
            "With the clamp (3.2) as printed, the best five parameters leave up to "
            f"{ratio:.1f} times the error: the integrated speed winds up at the limit and "
            "leaves it late, and the search compensates with friction that does not exist."
        )
    return sentences


def _sureness(fit: DrivelineFit) -> str:
    """Return how sure b and the least sure parameter are; at a bound there is no telling."""
    # delta and v_s are above zero, the others may have ended there
    known = (np.asarray(fit.values) > 0.0) & ~fit.unknown
    shares = np.divide(fit.standard_errors, fit.values, out=np.full(len(NAMES), np.nan), where=known)
    told = np.flatnonzero(np.isfinite(shares))
    if not told.size:
        return "no parameter has a standard error"
    worst = int(told[shares[told].argmax()])
    viscous = f"b to {100 * shares[0]:.2g} %, " if 0 in told else ""
    return f"{viscous}least sure is {NAMES[worst]}, to {100 * shares[worst]:.2g} %"


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
        "unknown": {f"wheel {fit.wheel}": [NAMES[i] for i in np.flatnonzero(fit.unknown)] for fit in fits},
        "findings": finding_results(findings),
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
        "remarks": remarks(fits, printed),
        "provenance": made.to_dict(),
    }
