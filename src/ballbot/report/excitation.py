"""A designed excitation: figures of the run, its limits and the expected errors, and its tables as text."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, MaxNLocator, StrMethodFormatter
from numpy.typing import NDArray

from ballbot.identification.quantities import BY_NAME
from ballbot.report.blocks import Paragraph, Report, Sheet, section, table
from ballbot.report.palette import BLUE, INK, MUTED, ORANGE
from ballbot.report.provenance import Provenance
from ballbot.report.series import Line, Look, Panel, TimeSeries, wheel_lines
from ballbot.report.style import drawn_picture, thinned
from ballbot.robot.parameters import DIMENSIONLESS
from ballbot.rounding import digits, unit_heading
from ballbot.workflows.excite import Excitation
from ballbot.workflows.metrics import leans


def path_figure(result: Excitation) -> Figure:
    """Draw the path over the floor on the loop, with its limit."""
    limits, truth = result.task.limits, result.on_loop["designed"].log.truth()
    figure = Figure(figsize=(3.8, 3.6), layout="constrained")
    axes = figure.subplots()
    turn = np.linspace(0.0, 2.0 * np.pi, 100)
    axes.plot(
        limits.floor * np.cos(turn), limits.floor * np.sin(turn), color=INK, linewidth=0.8, linestyle="--"
    )
    axes.plot(*thinned(truth["x"], truth["y"]), color=BLUE, linewidth=0.9)
    axes.plot(0.0, 0.0, marker="o", color=MUTED, markersize=3.5)
    axes.set_aspect("equal")
    for along in (axes.xaxis, axes.yaxis):
        along.set_major_locator(MaxNLocator(5))
    axes.set_xlabel("$x$ [m]")
    axes.set_ylabel("$y$ [m]")
    return figure


def errors_figure(result: Excitation) -> Figure:
    """Draw the standard errors of each parameter expected of a square and of the design."""
    labels = result.task.labels
    figure = Figure(figsize=(7.4, 2.9), layout="constrained")
    axes = figure.subplots()
    for (name, errors), color, mark in zip(result.errors.items(), (ORANGE, BLUE), "os", strict=True):
        shown = np.where(np.isfinite(errors), 100.0 * errors, np.nan)
        axes.plot(shown, linestyle="none", marker=mark, color=color, markersize=5, label=name)
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_formatter(LogFormatter(labelOnlyBase=False, minor_thresholds=(2.0, 0.4)))
    axes.set_xticks(np.arange(len(labels)), labels, rotation=60)
    axes.grid(axis="y", which="both", linewidth=0.4)
    axes.set_ylabel("standard error\n[% of the bounds' width]")
    axes.legend(fontsize=7.5)
    return figure


#: how a limit is shown: its unit, and by what its SI number is multiplied
_SHOWN = {"lean": ("deg", 180.0 / np.pi), "floor": ("m", 1.0), "torque": ("N m", 1.0)}


def _limits_table(result: Excitation) -> Sheet:
    """Return each limit with the peaks of the square and of the design, on the model and on the loop."""
    runs = {**result.peaks, **{f"{name}, loop": one.peaks for name, one in result.on_loop.items()}}
    rows = [
        (
            unit_heading(name, unit),
            *(digits(getattr(one, name) * scale) for one in (result.task.limits, *runs.values())),
        )
        for name, (unit, scale) in _SHOWN.items()
    ]
    return table("Limits, and the largest values of each run", ("quantity", "limit", *runs), rows)


def _errors_table(result: Excitation) -> Sheet:
    """Return the standard errors expected, the worst of each run last."""
    task = result.task
    units = {
        label: "" if one.unit == DIMENSIONLESS else one.unit
        for one in BY_NAME.values()
        for label in one.labels(task.robot.wheel_count)
    }
    columns = [task.in_units(errors).tolist() for errors in result.errors.values()]
    rows = [
        (label, units[label], digits(believed), *(digits(one, 2) for one in errors))
        for label, believed, *errors in zip(task.labels, task.believed.tolist(), *columns, strict=True)
    ]
    rows.append(("worst, % of bounds", "", "", *map(_worst, result.errors.values())))
    headings = ("parameter", "unit", "assumed", *result.errors)
    return table("Standard errors expected", headings, rows)


def _verdict(result: Excitation) -> list[str]:
    """Return what to know of the design, in sentences."""
    sentences = [gain_sentence(float(result.errors["square"].max() / result.errors["designed"].max()))]
    trial = result.on_loop["designed"]
    if trial.ended:
        return [*sentences, f"On the loop with sensors a run ended early: {trial.ended}. Lower the limits."]
    exceeded = trial.peaks.exceeding(result.task.limits)
    kept = (
        f"The loop with sensors exceeded the limit on {' and '.join(exceeded)}; lower that limit"
        if exceeded
        else "The loop with sensors stayed within all limits"
    )
    return [*sentences, f"{kept}."]


def gain_sentence(gain: float) -> str:
    """Return the sentence on the ratio of a square's worst standard error to the design's."""
    if not np.isfinite(gain):
        return (
            "With a square of the same length some parameters cannot be identified; with the design all can."
        )
    if gain < 1.0:
        return (
            f"The worst expected standard error is {1.0 / gain:.1f} times a square's, so the "
            "square is more informative. Drive that."
        )
    return f"The worst expected standard error is {gain:.1f} times smaller than a square's."


def _worst(errors: NDArray[np.float64]) -> str:
    """Return the worst of scaled errors, and how many parameters got none where some did."""
    none = int(np.count_nonzero(~np.isfinite(errors)))
    if none == len(errors):
        return "none identified"
    text = f"{100.0 * float(errors[np.isfinite(errors)].max()):.1f}"
    return f"{text} ({none} not identified)" if none else text


def excitation_report(result: Excitation, made: Provenance) -> Report:
    """Return the page."""
    limits = result.task.limits
    errors = (
        "Standard errors in percent of the bounds' width, of a square and of the design. Those expected are the least "
        "that are possible with the noise assumed: they compare runs."
    )
    undecided = [
        "How much the real robot's friction differs from the assumed one: the errors are those with the friction of "
        "the file.",
        "Whether the real robot stays within the limits: the simulation is not the robot. Have a hand near "
        "it.",
    ]
    return Report(
        title=f"{result.task.robot.name}: an informative excitation",
        lead=(
            f"{result.task.duration:.0f} s within {np.degrees(limits.lean):.2g}° of lean, {limits.floor:g} m of floor "
            f"and {limits.torque:.3g} N m of torque."
        ),
        verdict=[("", " ".join(_verdict(result)))],
        sections=[
            section(
                "The run",
                _limits_table(result),
                drawn_picture(
                    "path", partial(path_figure, result), "On the loop. Dashed: the limit of the floor."
                ),
                _followed_series(result),
                Paragraph(text=_HOW_TO_RUN),
            ),
            section(
                "Expected errors",
                _errors_table(result),
                drawn_picture("errors", partial(errors_figure, result), errors),
            ),
        ],
        undecided=undecided,
        made=made,
    )


_HOW_TO_RUN = (
    "Let the robot follow reference.csv of this folder: `ballbot run --reference reference.csv --controller "
    "controller.toml`; any other controller that follows positions will do. Then give the log of the run to "
    "`ballbot identify`."
)


#: of x, y and the heading beside wheels and lean
_POSE_LOOKS: tuple[Look, ...] = ("fifth", "sixth", "quiet")


def _followed_series(result: Excitation) -> TimeSeries:
    """Return reference, lean and torques over time on the loop, with the limits."""
    limits, log = result.task.limits, result.on_loop["designed"].log
    asked = [
        Line(name=name, values=values, look=look)
        for name, values, look in zip(
            ("x [m]", "y [m]", "ψ [rad]"), result.design.sines.poses()[: len(log)].T, _POSE_LOOKS, strict=True
        )
    ]
    lean = Line(name="lean", values=np.degrees(leans(log)), look="measured")
    return TimeSeries(
        t=log.t,
        panels=(
            Panel(label="reference [m, rad]", lines=asked),
            Panel(
                label="lean [deg]", lines=(lean,), levels=(float(np.degrees(limits.lean)),), from_zero=True
            ),
            Panel(
                label="torques [N m]",
                lines=wheel_lines(list(log.torques.T)),
                levels=(-limits.torque, limits.torque),
            ),
        ),
        caption="Reference, lean and torques on the loop.",
        level="limit",
    )
