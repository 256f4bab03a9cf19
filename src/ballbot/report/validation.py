"""A validation's results.json and its page, whose sections the page of a study has as well.

In results.json a model's numbers stand under its name, with_friction and without_friction where these are compared.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from ballbot.findings import finding_results
from ballbot.fitting.comparison import verdicts
from ballbot.log import STATE_NAMES
from ballbot.report.blocks import Block, Bullets, Paragraph, Result, Section, Sheet, details, section
from ballbot.report.palette import BLUE, INK, MUTED, ORANGE
from ballbot.report.series import IN_TURN, Line, TimeSeries
from ballbot.report.style import (
    LOOKS,
    MARKS,
    STATE_SYMBOLS,
    STATE_UNITS,
    drawn_picture,
    label_of,
    one_panel,
    state_panels,
)
from ballbot.report.words import state_mark, with_symbols
from ballbot.results import to_results
from ballbot.rounding import digits, interval, unit_heading
from ballbot.summary import counted
from ballbot.validation import ErrorPair, ModelPair, Validation, findings
from ballbot.validation.models import FINEST, Trajectories
from ballbot.validation.prediction import HorizonComparison
from ballbot.validation.residuals import SpeedEffect, residual_findings
from ballbot.validation.result import model_findings, whole_log_verdict
from ballbot.validation.whole_log import QUANTITIES, RUNS, WholeLog


def validation_results(
    validation: Validation, by_log: Mapping[str, Validation] = MappingProxyType({})
) -> dict[str, object]:
    """Return what results.json holds of one validation, and of its logs if there are several."""
    loop, closed, models = validation.open_loop, validation.closed_loop, validation.models
    horizon, residuals = validation.horizon, validation.residuals
    white, spectrum, errors = residuals.whiteness, residuals.spectrum, horizon.errors
    intervals = errors.ratio_interval().swapaxes(0, 1)  # (horizons, 2, 10)
    # a state that did not move has no scale
    spread = np.where(horizon.spread > FINEST, horizon.spread, np.nan)
    return {
        "models": [
            {"name": one.name, "robot": one.model.robot.name, "formulation": one.model.formulation}
            for one in (models.first, models.second)
        ],
        "findings": finding_results(findings(validation)),
        "duration": validation.duration,
        "open_loop": loop
        and {
            **_pair_results(loop.errors, models),
            "noise_floor_rmse": _by_state(loop.noise_floor),
            "past_recovery": loop.past_recovery,
            "recoverable_lean": loop.recoverable_lean,
        },
        "no_open_loop": validation.no_open_loop,
        "closed_loop": closed
        and {
            **_pair_results(closed.restarted, models),
            "restart_every": closed.restart_every,
            "whole_logs": [_whole_log_results(one, models) for one in closed.whole],
        },
        "no_closed_loop": validation.no_closed_loop,
        "prediction": {
            "labels": validation.prediction.labels,
            "correlation": residuals.correlations.matrix,
            "significant": residuals.correlations.significant,
            "effective_samples": residuals.correlations.counts,
            **_pair_results(validation.prediction.errors, models),
            "whiteness": white
            and {
                "verdict": _by_state(np.array(white.colours)),
                "p_value": _by_state(white.p_value),
                "predicted_share": _by_state(white.predicted_share),
                "autocorrelation": _by_state(white.autocorrelation),
            },
            "spectrum": spectrum
            and {
                "resolution": spectrum.resolution,
                "peaks": [to_results(peak) | {"state": STATE_NAMES[peak.state]} for peak in spectrum.peaks],
            },
            "wheels": {"refused": residuals.no_wheels, "by_speed": residuals.by_speed or ()},
        },
        "horizon": {
            "seconds": errors.horizons,
            **_by_model("rmse_", models, errors.rmse),
            **_by_model("normalised_rmse_", models, errors.rmse / spread),
            "ratio": _by_state(errors.ratio),
            "ratio_interval": _by_state(intervals),
            "verdict": [verdicts(interval) for interval in intervals],
            "noise_floor_rmse": _by_state(horizon.noise_floor),
        },
        "recovered_gain": validation.recovered,
        **({"by_log": {name: validation_results(one) for name, one in by_log.items()}} if by_log else {}),
    }


def _by_state(values: NDArray[np.generic]) -> dict[str, object]:
    """Return values (.., 10) by the states' names."""
    return {name: values[..., index].tolist() for index, name in enumerate(STATE_NAMES)}


def _by_model(prefix: str, models: ModelPair, both: Iterable[NDArray[np.float64]]) -> dict[str, object]:
    names = (prefix + re.sub(r"\W+", "_", name).strip("_") for name in models.names)
    return dict(zip(names, map(_by_state, both), strict=True))


def _pair_results(pair: ErrorPair, models: ModelPair) -> dict[str, object]:
    return {
        **_by_model("", models, (pair.first.error, pair.second.error)),
        **_by_model("rmse_", models, (pair.first.rmse, pair.second.rmse)),
        **_by_model("normalised_rmse_", models, pair.normalised_rmse),
        "ratio": _by_state(pair.ratio),
        "ratio_interval": _by_state(np.array(pair.ratio_interval())),
        "verdict": _by_state(np.array(pair.verdicts())),
        "runs": pair.runs,
        "samples": int(pair.first.samples.sum()),
    }


def _whole_log_results(whole: WholeLog, models: ModelPair) -> dict[str, object]:
    """Return RMS, amplitude and period of the log, and median and range of each model's runs."""
    keys = (re.sub(r"\W+", "_", name).strip("_") for name in models.names)
    return {
        "duration": whole.duration,
        "runs": RUNS,
        **{
            quantity: {
                "log": _by_state(whole.measured[k]),
                **_by_model("median_", models, whole.ranges[1, :, k]),
                **_by_model("range_95_", models, whole.ranges[::2, :, k].swapaxes(0, 1)),
            }
            for k, quantity in enumerate(QUANTITIES)
        },
        "ended_early": dict(zip(keys, whole.fell, strict=True)),
    }


def validation_report(
    validation: Validation,
    *,
    title: str = "Validation",
    lead: str = "",
    by_log: Mapping[str, Validation] = MappingProxyType({}),
) -> Result:
    """Return a validation's own page."""
    verdict, *others = (finding.text for finding in model_findings(validation))
    first, *rest = validation_sections(validation)
    further = details("What else was found", Bullets([with_symbols(one) for one in others]))
    return Result(
        title=title,
        lead=lead,
        verdict=[("", verdict)],
        sections=[first, further if others else None, *rest],
        undecided=undecided_by(validation),
        findings=validation.log_findings,
        data={
            "validation": validation_results(validation, by_log),
            "findings": finding_results(validation.log_findings),
        },
    )


def undecided_by(validation: Validation) -> list[str]:
    """Return what the logs cannot show of the two models."""
    if validation.no_evidence is not None:
        return [validation.no_evidence]
    refused = {"open loop": validation.no_open_loop, "closed loop": validation.no_closed_loop}
    sentences = [f"Which model is better in {where}: {why}" for where, why in refused.items() if why]
    residuals = validation.residuals
    if residuals.no_wheels:
        sentences.append(
            f"Whether the wheels' residual torques depend on their speeds: {residuals.no_wheels}."
        )
    return [*sentences, "How well either model predicts motions, floors or loads that are not in these logs."]


def validation_sections(validation: Validation) -> list[Section]:
    """Return the sections on a validation."""
    if validation.no_evidence is not None:
        return [section("Which model is better", Paragraph(validation.no_evidence))]
    names = validation.models.names
    horizon = (
        "Root mean square error of the forecast against how far ahead it looks. Dotted: the error that noise of the "
        "measured start alone causes in a perfect model. A filled dot: the interval of the ratio is wholly above one, "
        f"the model {names[0]} is better."
    )
    return [
        section("Open loop", *_open_loop_blocks(validation)),
        details("Closed loop", *_closed_loop_blocks(validation)),
        details(
            "Error against horizon",
            drawn_picture("horizon", horizon, horizon_figure, validation.horizon, names),
        ),
        details("Residuals of the next sample", *_residual_blocks(validation)),
    ]


def _open_loop_blocks(validation: Validation) -> Iterator[Block]:
    loop = validation.open_loop
    if loop is None:
        yield Paragraph(f"Not possible. {validation.no_open_loop}")
        return
    caption = (
        f"Open-loop errors over {counted(loop.errors.runs, 'run')}, each from the measured state under the measured "
        "torques until the first of the two models leans past recovery. A shaded line: the model "
        f"{validation.models.first.name} is not shown to be better."
    )
    yield error_sheet(validation, loop.errors, caption)
    yield _trajectories(loop.example, validation, "The open-loop run with the median error.")


def _closed_loop_blocks(validation: Validation) -> Iterator[Block]:
    closed, recovered = validation.closed_loop, validation.recovered
    if closed is None:
        yield Paragraph(f"Not possible. {validation.no_closed_loop}")
        return
    controller = "the controller that drove the robot"
    if recovered is not None:
        late = f", {counted(recovered.delay, 'sample')} late" if recovered.delay else ""
        controller = f"the gain recovered from the log (R² = {float(recovered.r_squared.min()):.4f}{late})"
    caption = (
        f"Closed-loop errors over {counted(closed.restarted.runs, 'run')} under {controller}, restarted from the "
        f"measured state every {closed.restart_every:.2g} s."
    )
    yield error_sheet(validation, closed.restarted, caption)
    for whole in closed.whole:
        yield Paragraph(whole_log_verdict(whole, validation.models))
    for whole in closed.whole[:1]:
        yield _trajectories(whole.example, validation, "The first seconds without a restart.")


def _residual_blocks(validation: Validation) -> Iterator[Block]:
    residuals, first = validation.residuals, validation.models.first.name
    matrix = residuals.correlations
    yield Paragraph(f"ε: the measured next state less the one that the model {first} predicts.")
    yield Bullets([with_symbols(finding.text) for finding in residual_findings(residuals)])
    caption = (
        "Correlation of residuals and torques. Framed cells are significant: the memory of both series counted, and "
        "the chance of any false frame 5 %."
    )
    yield drawn_picture(
        "residuals", caption, correlation_figure, symbols(matrix.labels), matrix.matrix, matrix.significant
    )
    if residuals.by_speed:
        caption = "The residuals as torques that each wheel would have had to push more, against its speed; bars: 95 %."
        yield drawn_picture("wheels", caption, wheels_figure, residuals.by_speed)


def error_sheet(validation: Validation, pair: ErrorPair, caption: str) -> Sheet:
    """Return the errors of both models by state, as Tables 4.1 and 4.2 of the thesis, with what they lack."""
    names = validation.models.names
    both, verdicts_of, ends = (
        (pair.first, pair.second),
        pair.verdicts(),
        np.transpose(pair.ratio_interval()),
    )
    known = np.isfinite(ends[:, 0])

    def shown(value: float, rmse: float) -> str:
        return "≈ 0" if rmse <= FINEST else digits(value)  # no digits of what is only rounding

    rows = [
        (
            unit_heading(state_mark(name), STATE_UNITS[name]),
            *(shown(1e3 * one.error[i], one.rmse[i]) for one in both),
            digits(pair.ratio[i]),
            interval(*ends[i]) if known[i] else "too few",
            verdicts_of[i] if known[i] else "–",
            *(shown(one.rmse[i], one.rmse[i]) for one in both),
        )
        for i, name in enumerate(STATE_NAMES)
    ]
    return Sheet(
        groups=(("", 1), ("1000 |x−x̂|/n", 2), ("ratio", 3), ("RMSE", 2)),
        headings=("state", *names, "", "95 %", "verdict", *names),
        rows=rows,
        caption=caption,
        shaded=frozenset(i for i, row in enumerate(rows) if row[5] != "better"),
    )


def _trajectories(shown: Trajectories, validation: Validation, caption: str) -> TimeSeries:
    """Return the measured states beside those of both models."""
    first, second = validation.models.names
    lines = (
        Line("measured", shown.measured, "measured"),
        Line(f"model {first}", shown.first, "first"),
        Line(f"model {second}", shown.second, "second"),
    )
    panels = state_panels(("x", "y", "theta", "phi", "psi", "psi_dot"), lines)
    return TimeSeries(shown.t, panels, caption, across="time of the log [s]")


def horizon_figure(horizon: HorizonComparison, names: tuple[str, str]) -> Figure:
    """Return the forecast's RMSE against how far it looks ahead, a panel for each state.

    A filled dot is a horizon at which the first model is better by the whole interval, an empty one where it is not.
    """
    figure = Figure(figsize=(7.4, 3.6), layout="constrained")
    panels = figure.subplots(2, 5, sharex=True)
    errors = horizon.errors
    ahead, better = 1e3 * errors.horizons, errors.ratio_interval()[0] > 1.0
    # what is below any sensor's resolution is drawn at it
    first_model, second_model = np.maximum(errors.rmse, FINEST)
    for index, (axes, name) in enumerate(zip(panels.flat, STATE_NAMES, strict=True)):
        first = first_model[:, index]
        axes.loglog(ahead, first, label=label_of(names[0]), **LOOKS["first"])
        axes.loglog(ahead, second_model[:, index], label=label_of(names[1]), **LOOKS["second"])
        axes.loglog(
            ahead, horizon.noise_floor[:, index], label="noise of the start alone", color=MUTED, linestyle=":"
        )
        for which, face in ((better[:, index], BLUE), (~better[:, index], "white")):
            axes.loglog(ahead[which], first[which], "o", color=BLUE, markerfacecolor=face, markersize=3)
        axes.set_title(f"{STATE_SYMBOLS[name]} [{STATE_UNITS[name]}]")
        axes.set_xticks([10, 100, 500], ["10", "100", "500"])
        axes.xaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_minor_locator(NullLocator())
        axes.tick_params(labelsize=7)
    for axes in panels[-1]:
        axes.set_xlabel("ahead [ms]")
    for axes in panels[:, 0]:
        axes.set_ylabel("RMSE")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=2)
    return figure


def correlation_figure(
    labels: Sequence[str], correlation: NDArray[np.float64], marked: NDArray[np.bool_] | None = None
) -> Figure:
    """Return a correlation matrix as a map with its numbers; what correlates with nothing is left out.

    Cells that are `marked`, the significant ones, have a frame.
    """
    known = np.flatnonzero(np.isfinite(correlation).any(axis=1))
    inches = 5.6  # of all; a map of few cells is smaller
    if 0 < len(known) < len(labels):
        inches = max(3.2, inches * len(known) / len(labels))
        labels, correlation = [labels[int(k)] for k in known], correlation[np.ix_(known, known)]
        marked = None if marked is None else marked[np.ix_(known, known)]
    figure, axes = one_panel("", "", width=inches, height=inches)
    for (row, column), value in np.ndenumerate(correlation[::-1]):
        if not np.isfinite(value):
            continue
        # the page shows through a color, so that a small number is pale in either theme
        fill = to_rgba(ORANGE if value > 0.0 else BLUE, alpha=min(abs(value), 1.0))
        axes.add_patch(Rectangle((column, row), 1.0, 1.0, facecolor=fill, edgecolor="white", linewidth=0.6))
        if abs(value) >= 0.095:
            text = f"{value:.2f}".replace("0.", ".").removesuffix(".00")
            ink = "white" if abs(value) > 0.6 else INK
            axes.text(column + 0.5, row + 0.5, text, ha="center", va="center", fontsize=6.3, color=ink)
    for row, column in [] if marked is None else np.argwhere(marked[::-1]):
        frame = Rectangle((column + 0.06, row + 0.06), 0.88, 0.88, fill=False, edgecolor=INK, linewidth=0.8)
        axes.add_patch(frame)
    count = len(labels)
    axes.set(xlim=(0.0, count), ylim=(0.0, count), aspect="equal")
    axes.set_xticks(np.arange(count) + 0.5, labels, rotation=90)
    axes.set_yticks(np.arange(count) + 0.5, labels[::-1])
    axes.grid(visible=False)
    axes.tick_params(length=0, labelsize=7.5, labelcolor=INK)
    axes.spines[:].set_visible(False)
    legend = [Patch(color=ORANGE, label="positive"), Patch(color=BLUE, label="negative")]
    if marked is not None:
        legend.append(Patch(facecolor="none", edgecolor=INK, label="significant"))
    figure.legend(handles=legend, loc="outside upper left", ncols=len(legend))
    return figure


def symbols(labels: Sequence[str]) -> list[str]:
    """Return labels such as e_theta_dot or u1 as the thesis's symbols."""
    return [
        rf"$\varepsilon$({STATE_SYMBOLS[label[2:]]})" if label.startswith("e_") else rf"$u_{{{label[1:]}}}$"
        for label in labels
    ]


def wheels_figure(by_speed: Sequence[SpeedEffect]) -> Figure:
    """Return the wheels' residual torques against their speed."""
    figure, axes = one_panel("wheel speed [rad/s]", "residual torque [N m]", height=2.7)
    axes.axhline(0.0, color=INK, linewidth=0.8)
    for wheel, (effect, look, mark) in enumerate(zip(by_speed, IN_TURN, MARKS, strict=False), start=1):
        axes.errorbar(effect.speeds, effect.torques, yerr=effect.half_widths, fmt=mark, color=LOOKS[look]["color"],
                      markersize=3.2, linewidth=0.9, label=f"wheel {wheel}")  # fmt: skip
    figure.legend(loc="outside upper left", ncols=len(by_speed))
    return figure
