"""The identified friction: figures of the logs, the friction and the compared laws, and its tables as text.

A wheel's friction is drawn over its speed, with the band in which the standard errors leave it.

    tau(w) = b w + (c + s E) sgn(w),      E = exp(-r),      r = |w/v_s|^delta

The band is the delta method's: variance g' C g with g the gradient of tau by (b, c, s, v_s, delta) and C their
covariance; a parameter that has no standard error has that of an even distribution over its interval.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from rich.console import RenderableType
from rich.text import Text

from ballbot.fitting.model_selection import Candidate, Gain, ModelSelection
from ballbot.identification.coulomb import coulomb_sentence
from ballbot.identification.holdout import HoldoutResult
from ballbot.identification.laws import law_named
from ballbot.identification.quantities import BY_NAME
from ballbot.identification.result import Identification, represents_sentence
from ballbot.log.columns import MAX_WHEELS, torque_names
from ballbot.mechanics.friction import stribeck_gradient, wheel_friction
from ballbot.report.blocks import Block, Paragraph, Sheet, table
from ballbot.report.palette import BLUE, INK, MUTED, ORANGE
from ballbot.report.series import Line, Panel, TimeSeries, wheel_lines
from ballbot.report.style import STATE_UNITS, drawn_picture
from ballbot.report.validation_figures import correlation_figure
from ballbot.report.words import interval_text
from ballbot.rounding import digits, unit_heading, value_and_error
from ballbot.summary import counted
from ballbot.workflows.study import StudiedLog


@dataclass(frozen=True, kw_only=True, eq=False)
class FrictionCurve:
    """One wheel's friction torque at some speeds."""

    speed: NDArray[np.float64]  #: (k,) [rad/s]
    torque: NDArray[np.float64]  #: (k,) [N m]
    standard_error: NDArray[np.float64]  #: (k,) [N m]


def friction_curve(found: Identification, wheel: int, speed: NDArray[np.float64]) -> FrictionCurve:
    """Return the friction of wheel `wheel` (from 0) at speeds (k,) [rad/s] other than zero."""
    friction = found.robot.friction
    n = found.robot.wheel_count
    gradient = np.zeros((len(speed), len(found.labels)))
    of_wheel = (f"b{wheel + 1}", f"c{wheel + 1}", f"s{wheel + 1}", "v_s", "delta")
    by_parameter = stribeck_gradient(
        speed,
        stribeck=friction.stribeck[wheel],
        stribeck_speed=friction.stribeck_speed,
        stribeck_exponent=friction.stribeck_exponent,
    )
    for label, column in zip(of_wheel, by_parameter.T, strict=True):
        if label in found.labels:  # a simpler law has fewer parameters
            gradient[:, found.labels.index(label)] = column
    if friction.coulomb_asymmetry:  # found as a torque against it
        gradient[:, found.labels.index(f"offset{wheel + 1}")] = -1.0
    variance = np.einsum("ki,ij,kj->k", gradient, found.assumed_covariance, gradient)
    torque = wheel_friction(np.repeat(speed[:, None], n, axis=1), friction)[:, wheel]
    return FrictionCurve(speed=speed, torque=torque, standard_error=np.sqrt(np.maximum(variance, 0.0)))


#: wheel speeds shown reach this quantile of those in the logs
_SHOWN = 0.995


def log_series(studied: StudiedLog) -> TimeSeries:
    """Return position, heading and torques in a log over time, with what was held out shaded."""
    log = studied.log
    panels = []
    for name, label in (("x", "x [m]"), ("y", "y [m]"), ("psi", "heading ψ [rad]")):
        reference = (
            [Line(name="reference", values=log[f"ref_{name}"], look="reference")]
            if f"ref_{name}" in log
            else []
        )
        panels.append(
            Panel(label=label, lines=[*reference, Line(name="measured", values=log[name], look="measured")])
        )
    torques = [log[name] for name in torque_names(MAX_WHEELS) if name in log]
    panels.append(Panel(label="torques [N m]", lines=wheel_lines(torques)))
    return TimeSeries(
        t=log.t,
        panels=panels,
        caption=f"{studied.name}: position, heading and the wheels' torques.",
        across="time of the log [s]",
        shaded=studied.held_out,
        shade="held out",
    )


#: logs drawn over time: a page has about 0.1 MB for each
MOST_LOGS = 8


def log_blocks(logs: Sequence[StudiedLog]) -> Iterator[Block]:
    """Yield the time series of logs, of the first if there are many."""
    yield from (log_series(one) for one in logs[:MOST_LOGS])
    if len(logs) > MOST_LOGS:
        names = ", ".join(one.name for one in logs[MOST_LOGS:])
        yield Paragraph(text=f"Not drawn, as the page would be too large: {names}.", quiet=True)


def parameter_blocks(found: Identification, logs: Sequence[StudiedLog]) -> Iterator[Block]:
    """Yield the figures of the parameters: their intervals, each wheel's friction, their errors' correlation."""
    intervals = (
        "Each parameter with an interval: as found, its 95 % interval and that for the estimate from "
        "another log of this robot, and its value in the robot file. An interval that reaches the border has no limit "
        "on that side."
    )
    yield drawn_picture("intervals", partial(interval_figure, found), intervals)
    curve = (
        "Friction of each wheel against its speed, with the 95 % band from the standard errors; below, the share of "
        "the logs at each speed."
    )
    yield drawn_picture("friction", partial(friction_figure, found, logs), curve)
    if np.isfinite(found.correlation).any():
        pairs = (
            "Correlation of the parameters' errors. A strong colour marks two parameters of which the data determine "
            "a combination better than either alone. Parameters without a standard error are left out."
        )
        draw = partial(correlation_figure, _symbols(found.labels), found.correlation)
        yield drawn_picture("parameters", draw, pairs)


def _symbols(labels: Sequence[str]) -> list[str]:
    """Return labels of parameters as the symbols of figures."""
    special = {"v_s": "$v_s$", "delta": r"$\delta$", "C_rr": "$C_{rr}$"}
    return [special.get(label, f"${label[0]}_{{{label[1:]}}}$") for label in labels]


def friction_figure(found: Identification, logs: Sequence[StudiedLog]) -> Figure:
    """Return each wheel's friction over its speed with a 95 % band, above how often the logs have such a speed."""
    n = found.robot.wheel_count
    speeds = [studied.wheel_speeds(found.robot) for studied in logs]
    fastest = max(float(np.quantile(np.abs(speed), _SHOWN)) for speed in speeds)
    figure = Figure(figsize=(7.4, 3.1), layout="constrained")
    panels = figure.subplots(2, n, sharex=True, sharey="row", height_ratios=(3, 1), squeeze=False)
    for wheel in range(n):
        _draw_curve(panels[0, wheel], found, wheel, fastest)
        _draw_speeds(panels[1, wheel], np.concatenate([speed[:, wheel] for speed in speeds]), fastest)
    panels[0, 0].set_ylabel("friction torque [N m]")
    panels[1, 0].set_ylabel("share of\nthe logs [%]")
    return figure


def interval_figure(found: Identification) -> Figure:
    """Return the parameters' 95 % intervals beside the robot file's values; a panel for each quantity with some."""
    layout = found.layout
    before = layout.by_symbol(layout.nominal(found.predictor.robot))
    limited = found.intervals.keys() | found.another_log.keys()
    shown = []
    for name, (symbol, value) in zip(layout.names, found.parameters.items(), strict=True):
        labels = BY_NAME[name].labels(layout.wheel_count)
        if not limited or limited.intersection(labels):
            shown.append((symbol, BY_NAME[name].unit, labels, value))
    figure = Figure(figsize=(7.4, 2.5 * -(-len(shown) // _ACROSS)), layout="constrained")
    panels = figure.subplots(-(-len(shown) // _ACROSS), _ACROSS, squeeze=False).ravel()
    for axes in panels[len(shown) :]:
        axes.remove()
    for axes, (symbol, unit, labels, value) in zip(panels, shown, strict=False):
        axes.set_title(unit_heading(symbol, unit))
        _draw_intervals(axes, found, labels, np.atleast_1d(value), np.atleast_1d(before[symbol]))
    entries = {
        words: handle
        for axes in figure.axes
        for handle, words in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(entries.values(), entries.keys(), loc="outside upper left", ncols=2)
    return figure


#: panels in a row
_ACROSS = 3


def _draw_intervals(
    axes: Axes,
    found: Identification,
    labels: Sequence[str],
    values: NDArray[np.float64],
    before: NDArray[np.float64],
) -> None:
    """Draw the numbers of one quantity; a side that is not limited goes on to the border of the panel."""
    places = np.arange(len(labels))
    kinds = (
        (found.another_log, MUTED, 1.2, 0.13, "95 %, another log"),
        (found.intervals, BLUE, 3.0, -0.13, "95 %"),
    )
    ends = np.array(
        [(one.lower, one.upper) for kind, *_ in kinds for label in labels if (one := kind.get(label))]
    )
    known = np.concatenate([values, before, ends.ravel()])
    known = known[np.isfinite(known)]
    room = 0.12 * float(np.ptp(known)) or 1.0
    low, high = float(known.min()) - room, float(known.max()) + room
    for intervals, color, width, beside, words in kinds:
        for place, label in zip(places, labels, strict=True):
            one = intervals.get(label)
            if one is not None:
                at = [place + beside] * 2
                axes.plot(
                    at, np.clip([one.lower, one.upper], low, high), color=color, linewidth=width, label=words
                )
            words = f"_{words}"  # named once
    axes.plot(
        places, before, linestyle="none", marker="s", mfc="none", color=ORANGE, label="in the robot file"
    )
    axes.plot(places, values, linestyle="none", marker="o", color=INK, markersize=4, label="found")
    axes.set_ylim(low, high)
    axes.set_xticks(places, labels)
    axes.set_xlim(-0.6, len(labels) - 0.4)
    axes.grid(visible=False, axis="x")


#: speeds shown without logs reach this many Stribeck speeds
_SHOWN_SPEEDS = 8.0


def wheel_friction_figure(found: Identification) -> Figure:
    """Return each wheel's friction over its speed with a 95 % band, without the logs."""
    n = found.robot.wheel_count
    figure = Figure(figsize=(7.4, 2.6), layout="constrained")
    panels = figure.subplots(1, n, sharex=True, sharey=True, squeeze=False)[0]
    for wheel, axes in enumerate(panels):
        _draw_curve(axes, found, wheel, _SHOWN_SPEEDS * found.robot.friction.stribeck_speed)
        axes.set_xlabel("wheel speed [rad/s]")
    panels[0].set_ylabel("friction torque [N m]")
    return figure


def _draw_curve(axes: Axes, found: Identification, wheel: int, fastest: float) -> None:
    for side in (-1.0, 1.0):
        curve = friction_curve(found, wheel, side * np.geomspace(1e-3, 1.0, 160) * fastest)
        half = 1.96 * curve.standard_error
        axes.fill_between(
            curve.speed, curve.torque - half, curve.torque + half, color=BLUE, alpha=0.2, linewidth=0
        )
        axes.plot(curve.speed, curve.torque, color=BLUE, linewidth=1.4)
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.axvline(0.0, color=MUTED, linewidth=0.6)
    axes.set_title(f"wheel {wheel + 1}")


def _draw_speeds(axes: Axes, speed: np.ndarray, fastest: float) -> None:
    shares, edges = np.histogram(speed, bins=61, range=(-fastest, fastest))
    axes.stairs(100.0 * shares / len(speed), edges, fill=True, color=MUTED, alpha=0.55)
    axes.set_xlabel("wheel speed [rad/s]")


def ladder_figure(ladder: ModelSelection[Identification]) -> Figure:
    """Draw, for each law, its error over that without friction and its gain with the 95 % interval."""
    figure = Figure(figsize=(7.4, 0.75 + 0.36 * len(ladder.candidates)), layout="constrained")
    errors, gains = figure.subplots(1, 2, sharey=True, width_ratios=[1.0, 1.4])
    for place, one in enumerate(ladder.candidates):
        color = BLUE if one.accepted else MUTED
        errors.barh(place, one.error, height=0.55, color=color, alpha=1.0 if one is ladder.best else 0.6)
        errors.text(one.error, place, f" {one.error:.3f}", va="center", color=INK, fontsize=7.5)
        gain = one.gain
        assert gain is not None  # no friction is the baseline
        gains.plot([100 * gain.lower, 100 * gain.upper], [place, place], color=color, linewidth=1.6)
        gains.plot(100 * gain.share, place, marker="o" if one.accepted else "x", color=color, markersize=5)
        gains.text(100 * gain.upper, place, f"  {_law_label(one)}", va="center", color=INK, fontsize=7.5)
    errors.set_yticks(range(len(ladder.candidates)), [one.name for one in ladder.candidates])
    errors.invert_yaxis()
    errors.set_xlim(0.0, 1.25 * max(one.error for one in ladder.candidates))
    errors.set_title("error relative to no friction")
    gains.axvline(0.0, color=INK, linewidth=0.8)
    gains.set_xscale("symlog", linthresh=1.0)
    lowest = min(0.0, *(100 * one.gain.lower for one in ladder.candidates if one.gain))
    gains.set_xlim(min(-2.0, 1.5 * lowest), 5e3)  # room for the words beside a gain near 100 %
    ticks = [tick for tick in (-100, -10, -1, 0, 1, 10, 100) if tick >= 1.5 * lowest]
    gains.set_xticks(ticks, [str(tick) for tick in ticks], minor=False)
    gains.minorticks_off()
    gains.set_title("gain in error, 95 % interval [%]")
    return figure


def search_blocks(found: Identification) -> Iterator[Block]:
    """Yield how the error fell during the search."""
    before, costs = found.evolution_cost, found.gauss_newton_cost
    evolution = f"{counted(len(before), 'generation')} of an evolution strategy"
    search = evolution if before else "Descents from fixed starts"
    steps = f"{counted(len(costs), 'step')} of Gauss-Newton"
    yield Paragraph(text=f"{search} on some of the windows, then {steps} on all windows fitted.")
    if costs:
        caption = (
            "Error relative to no friction, the geometric mean of the states, after each step. A line that is level at "
            "its end has settled."
        )
        yield drawn_picture("search", partial(search_figure, found), caption)


def search_figure(found: Identification) -> Figure:
    """Return the cost after each step of Gauss-Newton."""
    figure = Figure(figsize=(7.4, 2.2), layout="constrained")
    axes, costs = figure.subplots(), found.gauss_newton_cost
    marker = "o" if len(costs) < _MOST_MARKERS else ""
    axes.plot(range(1, len(costs) + 1), np.exp(costs), color=BLUE, linewidth=1.2, marker=marker, markersize=3)
    axes.set_xlabel("step of Gauss-Newton")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=6))
    _with_few_digits(axes, np.exp(costs))
    axes.set_ylabel("error / no friction")
    return figure


def _with_few_digits(axes: Axes, values: NDArray[np.float64]) -> None:
    """Let a vertical axis cover at least a hundredth of its values, so that its labels differ in three digits."""
    lower, upper, middle = values.min(), values.max(), values.mean()
    if upper - lower < _LEAST_RANGE * middle:
        axes.set_ylim(middle - _LEAST_RANGE * middle, middle + _LEAST_RANGE * middle)
    axes.yaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))
    axes.ticklabel_format(axis="y", useOffset=False)


#: points of a line that carry a marker each
_MOST_MARKERS = 40
#: of the search's errors, as a share: what is less than that is no difference between models
_LEAST_RANGE = 0.01


#: of laws in words
_DECISIONS = {
    "accepted": "taken",
    "rejected": "no useful gain",
    "undecided": "the data cannot decide",
}


def _law_label(one: Candidate[Identification]) -> str:
    return f"{_DECISIONS[one.decision]}, over {one.within or 'no friction'}"


def identification_parts(
    found: Identification,
    selection: ModelSelection[Identification] | None,
    holdouts: Sequence[HoldoutResult],
) -> Iterator[RenderableType]:
    """Yield the verdict, the laws compared, the parameters, the errors on held-out windows, and the findings."""
    yield Text(found.verdict.sentence)
    if selection:
        yield selection_table(selection)
    yield parameter_table(found)
    sentences = (represents_sentence(found.names), coulomb_sentence(found.coulomb, found.names))
    yield from (Text(one) for one in sentences if one)
    yield error_table(found, holdouts)
    for one in holdouts:
        if one.horizons:
            yield horizon_table(one)
    for finding in (*found.findings, *(finding for one in holdouts for finding in one.findings)):
        yield Text(finding.text)


def parameter_table(found: Identification) -> Sheet:
    """Return each parameter that the law has with its standard error, both 95 % intervals and unit."""
    wheels = found.layout.wheel_count
    kinds = [BY_NAME[name] for name in found.layout.names for _ in range(len(BY_NAME[name].labels(wheels)))]
    values, errors = _flat(found.parameters), _flat(found.standard_errors)
    other = found.other
    rows = [
        (
            label,
            *value_and_error(value, error),
            interval_text(found.intervals.get(label)),
            interval_text(found.another_log.get(label)),
            *([] if other is None else [digits(float(other.values[place]))]),
            kind.unit,
        )
        for place, (label, value, error, kind) in enumerate(
            zip(found.labels, values, errors, kinds, strict=True)
        )
        if kind.name in found.names
    ]
    headings = ("parameter", "value", "standard error", "95 %", "95 %, another log")
    headings = (*headings, *([] if other is None else ["other optimum"]), "unit")
    return table("Identified parameters", headings, rows)


def error_table(found: Identification, holdouts: Sequence[HoldoutResult]) -> Sheet:
    """Return the open-loop errors of each state (RMSE), and those with over those without friction on other logs."""
    ours = found.held_out
    rows = [
        (
            state,
            STATE_UNITS[state],
            digits(with_friction),
            digits(without),
            f"{ratio:.2f}",
            *(f"{one.errors.with_over_without[state]:.2f}" for one in holdouts),
        )
        for (state, ratio), with_friction, without in zip(
            ours.with_over_without.items(), ours.rmse_with, ours.rmse_without, strict=True
        )
    ]
    others = "; with / without friction on other logs" if holdouts else ""
    title = f"Open-loop RMSE on {ours.windows} held-out windows{others}"
    headings = (
        "state",
        "unit",
        "with friction",
        "without",
        "with / without",
        *(one.name for one in holdouts),
    )
    return table(title, headings, rows)


def horizon_table(holdout: HoldoutResult) -> Sheet:
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
        for one in holdout.horizons
    ]
    known = "past rows" if holdout.causal else "its rows"
    title = f"{holdout.name}, RMSE of {holdout.horizons[0].starts} predictions from {known}"
    headings = (
        "after, s",
        "wheel speed, rad/s",
        "viscous part",
        "without friction",
        "missing friction",
        "lean, deg",
        "without friction",
        "missing friction",
    )
    return table(title, headings, rows)


def selection_table(selection: ModelSelection[Identification]) -> Sheet:
    """Return the laws with their errors and gains on windows held out."""
    rows = [
        (
            one.name,
            law_named(one.name).formula,
            f"{one.error:.3f}",
            one.within or "no friction",
            _gain(one.gain) if one.gain else "",
            "best" if one is selection.best else _DECISIONS[one.decision],
        )
        for one in selection.candidates
    ]
    headings = ("law", "friction", "error", "compared with", "gain, 95 % interval", "")
    return table("Friction laws on held-out windows: error relative to no friction", headings, rows)


def _flat(values: dict[str, list[float] | float]) -> list[float]:
    return [one for value in values.values() for one in (value if isinstance(value, list) else [value])]


def _gain(gain: Gain) -> str:
    return f"{100 * gain.share:.1f} % ({100 * gain.lower:.1f} .. {100 * gain.upper:.1f})"
