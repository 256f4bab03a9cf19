"""What `ballbot identify` prints: parameters, errors on windows held out, laws and other logs."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.table import Table

from ballbot.cli.output import table
from ballbot.identification.holdout import HoldoutResult
from ballbot.identification.laws import Gain, ModelSelection
from ballbot.identification.quantities import BY_NAME
from ballbot.identification.result import Identification
from ballbot.report.tables import digits


def parameter_table(found: Identification, *, framed: bool) -> Table:
    """Return each parameter with its standard error, 95 % interval and unit."""
    units = [
        BY_NAME[name].unit
        for name in found.layout.names
        for _ in BY_NAME[name].labels(found.layout.wheel_count)
    ]
    values, errors = _flat(found.parameters), _flat(found.standard_errors)
    rows = [
        (label, digits(value), digits(error, 2), _interval(found, label), unit)
        for label, value, error, unit in zip(found.labels, values, errors, units, strict=True)
    ]
    headings = ("parameter", "value", "standard error", "95 % interval", "unit")
    return table("found", headings, rows, framed=framed)


def error_table(found: Identification, judged: Sequence[HoldoutResult], *, framed: bool) -> Table:
    """Return the open-loop errors of each state: on windows held out, and their ratios on other logs."""
    ours = found.held_out
    rows = [
        (
            state,
            digits(ours.with_friction[state]),
            digits(ours.without_friction[state]),
            f"{ratio:.2f}",
            *(f"{one.errors.ratios[state]:.2f}" for one in judged),
        )
        for state, ratio in ours.ratios.items()
    ]
    title = f"Open-loop error (4.1) on {ours.windows} held-out windows" + (
        "; ratio on other logs" * bool(judged)
    )
    headings = ("state", "with friction", "without", "ratio", *(one.name for one in judged))
    return table(title, headings, rows, framed=framed)


def horizon_table(judged: HoldoutResult, *, framed: bool) -> Table:
    """Return the errors of the wheels' speeds and of the lean by horizon, on another log."""
    rows = [
        (
            f"{one.horizon:.3g}",
            digits(one.wheel_speed.with_friction),
            digits(one.wheel_speed.viscous_part),
            digits(one.wheel_speed.without_friction),
            digits(one.wheel_speed.share, 2),
            digits(math.degrees(one.lean.with_friction)),
            digits(math.degrees(one.lean.without_friction)),
            digits(one.lean.share, 2),
        )
        for one in judged.horizons
    ]
    known = "past rows" if judged.causal else "its rows"
    title = f"{judged.name}, RMSE of {judged.horizons[0].starts} predictions from {known}"
    headings = (
        "after, s",
        "wheel speed, rad/s",
        "viscous part",
        "without friction",
        "friction wanted",
        "lean, deg",
        "without friction",
        "friction wanted",
    )
    return table(title, headings, rows, framed=framed)


def ladder_table(ladder: ModelSelection, *, framed: bool) -> Table:
    """Return the laws with their errors and gains on windows held out."""
    rows = [
        (
            rung.law.name,
            rung.law.formula,
            f"{rung.error:.3f}",
            rung.law.within or "no friction",
            _gain(rung.gain),
            "best" if rung is ladder.best else "taken" if rung.taken else "not selected",
        )
        for rung in ladder.rungs
    ]
    headings = ("law", "friction", "error", "compared with", "gain, 95 % interval", "")
    return table(
        "Friction laws on held-out windows: error relative to no friction", headings, rows, framed=framed
    )


def _flat(values: dict[str, list[float] | float]) -> list[float]:
    return [one for value in values.values() for one in (value if isinstance(value, list) else [value])]


def _interval(found: Identification, label: str) -> str:
    interval = found.intervals.get(label)
    return "" if interval is None else f"{digits(interval.lower)} .. {digits(interval.upper)}"


def _gain(gain: Gain) -> str:
    return f"{100 * gain.share:.1f} % ({100 * gain.lower:.1f} .. {100 * gain.upper:.1f})"
