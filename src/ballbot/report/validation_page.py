"""The page of a validation, and its sections, which the page of a study has as well."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from ballbot.errors import InputError
from ballbot.fitting.comparison import LEAST_RUNS
from ballbot.log import STATE_NAMES, Log
from ballbot.report.blocks import Block, Bullets, Film, Paragraph, Report, Section, Sheet, section
from ballbot.report.provenance import Provenance
from ballbot.report.series import Line, Panel, TimeSeries
from ballbot.report.style import STATE_UNITS, drawn_picture
from ballbot.report.tables import error_rows
from ballbot.report.validation import swing_digits, whole_log_words
from ballbot.report.validation_figures import (
    correlation_figure,
    horizon_figure,
    ratio_figure,
    spectrum_figure,
    symbols,
    wheels_figure,
    whole_log_figure,
)
from ballbot.report.words import state_mark, with_symbols
from ballbot.rounding import unit_heading
from ballbot.summary import counted
from ballbot.validation import ErrorPair, Validation
from ballbot.validation.models import ModelPair, Trajectories
from ballbot.validation.residuals import residual_findings
from ballbot.validation.result import model_findings, whole_log_verdict
from ballbot.validation.statistics import Whiteness
from ballbot.validation.whole_log import RUNS, WholeLog
from ballbot.viewer.page import replay_part


def validation_report(
    validation: Validation, *, title: str, lead: str, example_of: str, made: Provenance
) -> Report:
    """Return a validation's own page; `example_of` names the log that its examples are of."""
    verdict, *others = (finding.text for finding in model_findings(validation))
    return Report(
        title=title,
        lead=lead,
        verdict=[("", verdict)],
        sections=[
            *(
                [section("What was found", Bullets(items=[with_symbols(one) for one in others]))]
                if others
                else []
            ),
            *validation_sections(validation, example_of=example_of),
        ],
        undecided=undecided_by(validation),
        made=made,
        findings=validation.log_findings,
    )


def undecided_by(validation: Validation) -> list[str]:
    """Return what the logs cannot show of the two models."""
    first, second = validation.models.names
    if validation.no_evidence is not None:
        return [validation.no_evidence]
    sentences = []
    for loop, refused, errors in (
        ("open loop", validation.no_open_loop, validation.open_loop and validation.open_loop.errors),
        (
            "closed loop",
            validation.no_closed_loop,
            validation.closed_loop and validation.closed_loop.restarted,
        ),
    ):
        if errors is None:
            sentences.append(f"Which model is better in {loop}: {refused}")
        elif not np.isfinite(errors.ratio_interval()).any():
            sentences.append(
                f"Which model is better in {loop}: intervals need {LEAST_RUNS} runs, and there "
                f"{'is one' if errors.runs == 1 else f'are {errors.runs}'}."
            )
        else:
            verdicts_of = zip(STATE_NAMES, errors.verdicts(), strict=True)
            open_ones = [state_mark(name) for name, verdict in verdicts_of if verdict == "undecided"]
            if open_ones:
                sentences.append(
                    f"Whether the model {first} predicts {', '.join(open_ones)} better than the one {second} in "
                    f"{loop}: the interval of the ratio of errors contains one."
                )
    found = validation.residuals
    if found.no_wheels:
        sentences.append(f"Whether the wheels' residual torques depend on their speeds: {found.no_wheels}.")
    return [*sentences, "How well either model predicts motions, floors or loads that are not in these logs."]


def validation_sections(validation: Validation, *, example_of: str) -> list[Section]:
    """Return the sections on a validation; `example_of` names the log of the examples."""
    if validation.no_evidence is not None:
        return [section("Which model is better where", Paragraph(text=validation.no_evidence))]
    return [
        _ratio_section(validation),
        _open_loop_section(validation, example_of),
        _closed_loop_section(validation, example_of),
        _horizon_section(validation),
        _residual_section(validation),
    ]


def _ratio_section(validation: Validation) -> Section:
    first, second = validation.models.names
    loop, closed = validation.open_loop, validation.closed_loop
    heading = "Which model is better where"
    if loop is None and closed is None:
        return section(heading, Paragraph(text="Neither loop could be compared; the sections below say why."))
    few = [
        one for one in (loop and loop.errors, closed and closed.restarted) if one and one.runs < LEAST_RUNS
    ]
    bars = "Bars: 95 % intervals, from a bootstrap of blocks of runs"
    bars += f"; below {LEAST_RUNS} runs there are none." if few else "."
    caption = f"Error of the model {second} over the error of the one {first}. {bars}"
    return section(
        heading, drawn_picture("ratios", partial(ratio_figure, loop, closed, (first, second)), caption)
    )


def _open_loop_section(validation: Validation, example_of: str) -> Section:
    loop, first = validation.open_loop, validation.models.first.name
    if loop is None:
        return section("Open loop", Paragraph(text=f"Not possible. {validation.no_open_loop}"))
    words = (
        "Both models start from the measured state and get the measured torques. The robot is unstable, so every run "
        "ends in a fall; a run is cut where the first of the two models leans past recovery, so that both are "
        "compared over the same samples."
    )
    caption = (
        "Open-loop errors. Error: |x − x̂| / n, the mean over "
        f"{counted(loop.errors.runs, 'run')}. It shrinks with a run's length n, where RMSE does not. "
        "Normalised: RMSE over the "
        f"standard deviation of what was measured. Better or worse: the model {first}, where the interval is wholly "
        "above or below one. A shaded line: not shown to be better."
    )
    example = f"One open-loop run of {example_of}, the one with the median error."
    return section(
        "Open loop",
        Paragraph(text=words),
        error_sheet(validation, loop.errors, caption),
        _trajectories(loop.example, validation.models.names, example),
    )


def _closed_loop_section(validation: Validation, example_of: str) -> Section:
    closed = validation.closed_loop
    if closed is None:
        return section("Closed loop", Paragraph(text=f"Not possible. {validation.no_closed_loop}"))
    every = f"{closed.restart_every:.2g}"
    words = (
        "Both models start from the measured state and are driven by the controller that drove the "
        f"robot{_controller_words(validation)}. The first table restarts them from the measured state every {every} s, "
        "before model and robot lose each other's phase in the limit cycle that friction causes."
    )
    restarted = f"Closed-loop errors, restarted every {every} s, the mean over "
    return section(
        "Closed loop",
        Paragraph(text=words),
        error_sheet(
            validation,
            closed.restarted,
            f"{restarted}{counted(closed.restarted.runs, 'run')}.",
            folded=validation.open_loop is not None,
        ),
        *(
            block
            for place in range(len(closed.whole))
            for block in _whole_log_blocks(validation, place, example_of)
        ),
    )


def _whole_log_blocks(validation: Validation, place: int, example_of: str) -> Iterator[Block | None]:
    """Yield what is shown of both models' runs over a whole log; the first log's is the one of the examples."""
    closed, names = validation.closed_loop, validation.models.names
    assert closed is not None
    whole = closed.whole[place]
    which = f", log {place + 1} of {len(closed.whole)}" if len(closed.whole) > 1 else ""
    yield Paragraph(text=whole_log_verdict(whole, validation.models))
    caption = (
        f"{RUNS} runs of each model over {whole.duration:.3g} s{which}, with the noise of a measured state drawn: RMS "
        "of the deviation from the reference, mean amplitude and mean period of its swings, over the log's own. Dot: "
        "the median, bar: 95 % of the runs. A bar that contains one contains the log."
    )
    yield drawn_picture(f"whole_log_{place + 1}", partial(whole_log_figure, whole, names), caption)
    yield _whole_log_sheet(whole, names, which)
    yield error_sheet(
        validation,
        whole.errors,
        f"Closed-loop errors over {whole.duration:.3g} s without a restart{which}, the median of {RUNS} runs.",
        folded=True,
    )
    if place == 0:
        example = f"The first seconds of {example_of} in closed loop, without a restart, beside one run of each model."
        yield _trajectories(whole.example, names, example)
        yield _replay(whole.example, validation.models)


def _whole_log_sheet(whole: WholeLog, names: tuple[str, str], which: str) -> Sheet:
    """Return RMS, amplitude and period of the log and of both models' runs, by state."""
    words, (least, median, largest) = whole_log_words(whole), whole.ranges

    def cells(k: int, i: int) -> Iterator[str]:
        yield swing_digits(whole.measured[k, i])
        for model in range(2):
            ends = (swing_digits(least[model, k, i]), swing_digits(largest[model, k, i]))
            yield swing_digits(median[model, k, i])
            yield "–" if ends == ("–", "–") else " to ".join(ends)
            yield words[model][k][i]

    rows = [
        (unit_heading(state_mark(name), STATE_UNITS[name]), quantity, *cells(k, i))
        for k, quantity in enumerate(("RMS", "amplitude", "period [s]"))
        for i, name in enumerate(STATE_NAMES)
    ]
    return Sheet(
        groups=(("", 3), (names[0], 3), (names[1], 3)),
        headings=("state", "of the deviation", "log", *("median", "95 % of the runs", "the log is") * 2),
        rows=rows,
        caption=f"The log among {RUNS} runs of each model over {whole.duration:.3g} s{which}. –: no whole swing.",
        shaded=frozenset(place for place, row in enumerate(rows) if row[5] != "inside"),
        folded=True,
    )


def _horizon_section(validation: Validation) -> Section:
    names = validation.models.names
    words = (
        "From which horizon on do the models differ? One sample ahead, the sensors' noise dominates. The dotted line "
        "is the error that the noise of the measured start alone would cause in a perfect model."
    )
    caption = (
        "Root mean square error of the forecast against how far ahead it looks, both axes logarithmic. A filled dot: "
        f"the interval of the ratio is wholly above one, the model {names[0]} is better."
    )
    figure = drawn_picture("horizon", partial(horizon_figure, validation.horizon, names), caption)
    return section("Error against horizon", Paragraph(text=words), figure)


def _residual_section(validation: Validation) -> Section:
    found, first = validation.residuals, validation.models.first.name
    matrix = found.correlations
    draw = partial(correlation_figure, symbols(matrix.labels), matrix.matrix, marked=matrix.significant)
    words = (
        f"From each measured state and torque, the model {first} predicts the next state; the measured state less "
        "the predicted one is the residual ε."
    )
    correlation = (
        "Correlation of residuals and torques; cells below 0.1 carry no number. Framed "
        "cells are significant: the memory of both series counted, and the chance of any false frame 5 %."
    )
    peaks = " Arrows and numbers: peaks [Hz]." if found.spectrum and found.spectrum.peaks else ""
    return section(
        "Residuals of the next sample",
        Paragraph(text=words),
        Bullets(items=[with_symbols(finding.text) for finding in residual_findings(found)]),
        drawn_picture("residuals", draw, correlation),
        _whiteness_sheet(found.whiteness) if found.whiteness else None,
        drawn_picture(
            "spectrum", partial(spectrum_figure, found), f"Power spectral densities of the residuals.{peaks}"
        )
        if found.spectrum
        else None,
        drawn_picture(
            "wheels",
            partial(wheels_figure, found),
            "The residuals as wheel torques: what each wheel would have had to push more for the model to be right, "
            "against its speed. Bars: 95 %.",
        )
        if found.by_speed
        else None,
    )


def error_sheet(validation: Validation, pair: ErrorPair, caption: str, *, folded: bool = False) -> Sheet:
    """Return the errors of both models by state; a narrow page folds all tables of them but the first."""
    both = validation.models.names
    rows = error_rows(pair, dict(STATE_UNITS))
    return Sheet(
        groups=(
            ("", 1),
            ("1000 × |x − x̂| / n", 2),
            ("ratio of the errors", 3),
            ("RMSE", 2),
            ("normalised RMSE", 2),
        ),
        headings=("state", *both, "", "95 % interval", "verdict", *both, *both),
        rows=[
            (
                unit_heading(row.state, row.unit),
                *(row.first, row.second, row.ratio, row.interval, row.verdict),
                *(row.rmse_first, row.rmse_second, row.normalised_first, row.normalised_second),
            )
            for row in rows
        ],
        caption=caption,
        shaded=frozenset(place for place, row in enumerate(rows) if row.verdict != "better"),
        folded=folded,
    )


#: the states that an example shows
_SHOWN = ("x", "y", "theta", "phi", "psi", "psi_dot")


def _trajectories(shown: Trajectories, names: tuple[str, str], caption: str) -> TimeSeries:
    """Return the measured states beside those of both models."""
    panels = []
    for name in _SHOWN:
        place = STATE_NAMES.index(name)
        lines = (
            Line(name="measured", values=shown.measured[:, place], look="measured"),
            Line(name=f"model {names[0]}", values=shown.first[:, place], look="first"),
            Line(name=f"model {names[1]}", values=shown.second[:, place], look="second"),
        )
        panels.append(Panel(label=f"{state_mark(name)} [{STATE_UNITS[name]}]", lines=lines))
    return TimeSeries(t=shown.t, panels=panels, caption=caption, across="time of the log [s]")


def _replay(shown: Trajectories, models: ModelPair) -> Film | None:
    """Return the measured run and both models' side by side in three dimensions, if they can be shown."""
    runs = [
        ("measured", shown.measured, models.first),
        (f"model {models.first.name}", shown.first, models.first),
        (f"model {models.second.name}", shown.second, models.second),
    ]
    logs = {
        name: Log({"t": shown.t, **dict(zip(STATE_NAMES, states.T, strict=True))}) for name, states, _ in runs
    }
    robots = {name: one.model.robot for name, _, one in runs}
    try:
        part = replay_part(logs, robots, name="validation", colors=("ink", "blue", "orange"))
    except InputError:  # a model whose run has no value
        return None
    caption = "The same seconds in three dimensions; the models can be shown as ghosts of the measured run."
    return Film(part=part, caption=caption)


def _whiteness_sheet(found: Whiteness) -> Sheet:
    """Return state, verdict, p, correlation with the sample before, and predicted share of the variance."""
    rows = [
        (
            f"ε({state_mark(name)})",
            found.colours[place],
            "< 0.001" if found.p_value[place] < 1e-3 else f"{found.p_value[place]:.3f}",
            f"{found.autocorrelation[1, place]:+.2f}",
            f"{100 * found.predicted_share[place]:.0f} %",
        )
        for place, name in enumerate(STATE_NAMES)
    ]
    caption = (
        "Are the residuals white? p: of a Ljung–Box test over 20 samples. Predictable: the share of the variance "
        "that the previous 20 residuals predict."
    )
    headings = ("residual", "verdict", "p", "correlation with the sample before", "predictable")
    return Sheet(headings=headings, rows=rows, caption=caption)


def _controller_words(validation: Validation) -> str:
    recovered = validation.recovered
    if recovered is None:
        return ""
    worst = float(recovered.r_squared.min())
    late = "" if recovered.delay == 0 else f", {counted(recovered.delay, 'sample')} late"
    return f" (its gain recovered from the log, R² = {worst:.4f}{late})"
