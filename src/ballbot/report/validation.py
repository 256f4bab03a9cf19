"""The page of a validation; the page of a study shows the same sections."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import NullLocator

from ballbot.arrays import Bools, Floats
from ballbot.findings import by_severity
from ballbot.fitting.comparison import LEAST_RUNS
from ballbot.log import STATE_NAMES
from ballbot.report.blocks import Block, Bullets, Paragraph, Result, Section, Sheet, details, section
from ballbot.report.palette import BLUE, INK, MUTED, ORANGE
from ballbot.report.series import IN_TURN, Line, Panel, TimeSeries
from ballbot.report.style import (
    LOOKS,
    MARKS,
    STATE_SYMBOLS,
    STATE_UNITS,
    drawn_picture,
    label_of,
    one_panel,
)
from ballbot.report.words import state_mark, with_symbols
from ballbot.rounding import DASH, digits, interval, unit_heading
from ballbot.validation import ErrorPair, ModelPair, Validation, findings
from ballbot.validation.horizons import Horizons
from ballbot.validation.models import FINEST, Trajectories
from ballbot.validation.residuals import Prediction, SpeedEffect
from ballbot.validation.ways import VALIDATIONS


def validation_report(
    validation: Validation,
    *,
    title: str = "",
    lead: str = "",
    by_log: Mapping[str, Validation] = MappingProxyType({}),
) -> Result:
    """Return the page of a validation; with several logs, results.json also has the validation of each."""
    texts = model_findings(validation)
    first, *rest = validation_sections(validation)
    logs = {"by_log": {name: part.results() for name, part in by_log.items()}} if by_log else {}
    return Result(
        title=title
        or f"Validation of the model {validation.models.first.name} on {validation.duration:.3g} s",
        lead=lead,
        verdict=[("", text) for text in texts[:2]],  # adequacy, then improvement
        sections=[first, details("What else was found", Bullets(texts[2:])), *rest],
        undecided=undecided_by(validation),
        findings=validation.log_findings,
        data={"validation": validation.results() | logs, "findings": by_severity(validation.log_findings)},
    )


def model_findings(validation: Validation) -> list[str]:
    """Return the findings except those on the residuals, which stand with their figure."""
    return [with_symbols(finding.text) for finding in findings(validation) if finding.code != "residuals"]


def undecided_by(validation: Validation) -> list[str]:
    """Return what the logs cannot show of the two models."""
    if validation.no_evidence is not None:
        return [validation.no_evidence]
    refused = [(way.heading.lower(), validation.refused.get(way.key)) for way in VALIDATIONS]
    sentences = [f"Which model is better in {where}: {why}" for where, why in refused if why]
    if no_wheels := validation.prediction.no_wheels:
        sentences.append(f"Whether the wheels' residual torques depend on their speeds: {no_wheels}.")
    return [*sentences, "How well either model predicts motions, floors or loads that are not in these logs."]


def validation_sections(validation: Validation) -> list[Section]:
    """Return a section for each way of validating, all but the first folded, with its verdict."""
    if validation.no_evidence is not None:
        return [section("Which model is better", Paragraph(validation.no_evidence))]
    results = validation.verdicts()
    results["prediction"] = validation.prediction.remarks()[0].text
    return [
        replace(
            section(way.heading, *_way_blocks(validation, way.key)), folded=k > 0, result=results[way.key]
        )
        for k, way in enumerate(VALIDATIONS)
    ]


def _way_blocks(validation: Validation, key: str) -> Iterator[Block]:
    comparison, models = validation.comparisons.get(key), validation.models
    if comparison is None:
        yield Paragraph(f"Not possible. {validation.refused[key]}")
        return
    first, second = models.names
    for caption, shown in comparison.shown():
        match shown:
            case ErrorPair():
                yield error_sheet(models, shown, caption)
            case Trajectories():
                panels = [
                    Panel(
                        unit_heading(state_mark(name), STATE_UNITS[name]),
                        (
                            Line("measured", shown.measured[:, i], "measured"),
                            Line(f"model {first}", shown.first[:, i], "first"),
                            Line(f"model {second}", shown.second[:, i], "second"),
                        ),
                    )
                    for i, name in enumerate(STATE_NAMES)
                    if name in ("x", "y", "theta", "phi", "psi", "psi_dot")
                ]
                yield TimeSeries(shown.t, panels, caption, across="time of the log [s]")
            case None:
                yield Paragraph(caption)
    if isinstance(comparison, Horizons):
        yield drawn_picture(
            "horizon",
            "Root mean square error of the forecast against how far ahead it looks. Dotted: the error that noise of "
            "the measured start alone causes in a perfect model. A filled dot: the interval of the ratio is wholly "
            f"above one, the model {first} is better.",
            horizon_figure,
            comparison,
            models.names,
        )
    if isinstance(comparison, Prediction):
        yield from _residual_blocks(comparison, models)


def _residual_blocks(prediction: Prediction, models: ModelPair) -> Iterator[Block]:
    matrix, by_speed = prediction.correlations, prediction.by_speed
    yield Paragraph(f"ε: the measured next state less the one that the model {models.first.name} predicts.")
    yield Bullets([with_symbols(finding.text) for finding in prediction.remarks()])
    caption = (
        "Correlation of residuals and torques. Framed cells are significant, given the autocorrelation of both series; "
        "the chance of any false frame is 5 %."
    )
    yield drawn_picture(
        "residuals", caption, correlation_figure, symbols(matrix.labels), matrix.matrix, matrix.significant
    )
    if by_speed:
        caption = "The residuals as additional torques of each wheel, against its speed; bars: 95 %."
        yield drawn_picture("wheels", caption, wheels_figure, by_speed)


def error_sheet(models: ModelPair, pair: ErrorPair, caption: str) -> Sheet:
    """Return the errors of both models by state, as Tables 4.1 and 4.2 of the thesis, with intervals and verdicts."""
    ends, verdicts, known = pair.ratio_interval.T, pair.verdicts(), pair.runs >= LEAST_RUNS

    def of_models(i: int, values: Floats) -> list[str]:
        # below the rounding error digits mean nothing
        return [
            "≈ 0" if rmse <= FINEST else digits(value)
            for value, rmse in zip(values[:, i], pair.rmse[:, i], strict=True)
        ]

    rows = [
        (
            unit_heading(state_mark(name), STATE_UNITS[name]),
            *of_models(i, 1e3 * pair.error),
            digits(pair.ratio[i]),
            interval(*ends[i]) if known else "too few",
            verdicts[i] if known else DASH,
            *of_models(i, pair.rmse),
        )
        for i, name in enumerate(STATE_NAMES)
    ]
    return Sheet(
        groups=(("", 1), ("1000 |x−x̂|/n", 2), ("ratio", 3), ("RMSE", 2)),
        headings=("state", *models.names, "", "95 %", "verdict", *models.names),
        rows=rows,
        caption=caption,
        brief=(0, 3, 4, 5),
        shaded=frozenset(i for i, row in enumerate(rows) if row[5] != "better"),
    )


def horizon_figure(horizon: Horizons, names: tuple[str, str]) -> Figure:
    """Return the forecast's RMSE against how far it looks ahead, a panel for each state.

    A dot is filled if the first model is significantly better at that horizon.
    """
    figure = Figure(figsize=(7.4, 3.6), layout="constrained")
    panels = figure.subplots(2, 5, sharex=True)
    ahead, better = 1e3 * horizon.horizons, horizon.ratio_interval[0] > 1.0
    # errors below any sensor's resolution are drawn at that resolution
    shown = [*np.maximum(horizon.rmse, FINEST), horizon.noise_floor, better]
    for axes, name, *columns in zip(panels.flat, STATE_NAMES, *(each.T for each in shown), strict=True):
        first, second, noise, filled = columns
        axes.loglog(ahead, first, label=label_of(names[0]), **LOOKS["first"])
        axes.loglog(ahead, second, label=label_of(names[1]), **LOOKS["second"])
        axes.loglog(ahead, noise, label="noise of the start alone", color=MUTED, linestyle=":")
        for which, face in ((filled, BLUE), (~filled, "white")):
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


def correlation_figure(labels: Sequence[str], correlation: Floats, marked: Bools | None = None) -> Figure:
    """Return a correlation matrix as a map with its numbers, without rows that are NaN throughout.

    Cells that are `marked` as significant have a frame.
    """
    known = np.flatnonzero(np.isfinite(correlation).any(axis=1))
    inches = 5.6  # of the whole matrix; a smaller one has a smaller map
    if 0 < len(known) < len(labels):
        inches = max(3.2, inches * len(known) / len(labels))
        labels, correlation = [labels[int(k)] for k in known], correlation[np.ix_(known, known)]
        marked = None if marked is None else marked[np.ix_(known, known)]
    figure, axes = one_panel("", "", width=inches, height=inches)
    for (row, column), value in np.ndenumerate(correlation[::-1]):
        if not np.isfinite(value):
            continue
        # colors are transparent, so that a small number is pale in either theme
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
