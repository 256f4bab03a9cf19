"""The page of an identification from balancing logs: parameters, friction, laws, and errors on held-out windows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from ballbot.findings import Finding, texts
from ballbot.fitting.model_selection import ModelSelection
from ballbot.identification import HoldoutResult, Identification
from ballbot.identification.coulomb import coulomb_sentence
from ballbot.identification.result import represents_sentence
from ballbot.log import Log
from ballbot.report.blocks import Block, Paragraph, Picture, Report, Section, Sheet, section
from ballbot.report.friction import (
    error_table,
    friction_figure,
    horizon_table,
    log_series,
    parameter_table,
    selection_table,
)
from ballbot.report.provenance import Provenance
from ballbot.report.study import friction_sentence
from ballbot.report.study_page import parameter_symbols
from ballbot.report.style import drawn_picture
from ballbot.report.validation_figures import correlation_figure
from ballbot.report.words import digits
from ballbot.workflows.study import StudiedLog


def identification_report(
    found: Identification,
    logs: Mapping[str, Log],
    *,
    findings: Sequence[Finding],
    selection: ModelSelection[Identification] | None,
    ladder_svg: str | None,
    holdouts: Sequence[HoldoutResult],
    made: Provenance,
) -> Report:
    """Return the page; `ladder_svg` is the figure of the compared laws."""
    studied = [_studied(found, name, place, log) for place, (name, log) in enumerate(logs.items())]
    names = ", ".join(logs)
    seconds = sum(float(log.t[-1] - log.t[0]) for log in logs.values())
    return Report(
        title=f"{found.robot.name}: friction from balancing logs",
        lead=f"{seconds:.0f} s of {names}, predicted over windows of {found.window:g} s.",
        verdict=[("Friction", friction_sentence(found.robot)), ("Prediction", _prediction_sentence(found))],
        sections=[
            _parameter_section(found, studied),
            *([_law_section(selection, ladder_svg)] if selection and ladder_svg else []),
            section("Errors on held-out windows", *_error_blocks(found, holdouts)),
            section("The logs", *(log_series(one) for one in studied)),
        ],
        undecided=_undecided(found, holdouts),
        made=made,
        findings=findings,
    )


def _studied(found: Identification, name: str, place: int, log: Log) -> StudiedLog:
    held = tuple((span.start, span.end) for span in found.held_out_windows if span.log == place)
    return StudiedLog(name=name, log=log, held_out=held)


def _prediction_sentence(found: Identification) -> str:
    errors = found.held_out
    ratios = np.array(list(errors.ratios.values()))
    return (
        f"On {errors.windows} windows that the fit did not see, the error without friction is "
        f"{digits(float(np.median(ratios)), 2)} times that with the friction found (median of the states)."
    )


def _parameter_section(found: Identification, logs: Sequence[StudiedLog]) -> Section:
    caption = (
        "Friction of each wheel over its speed, with the 95 % band that the standard errors leave, and how often the "
        "logs have such a speed."
    )
    correlation = (
        "Correlation of the parameters' errors. A dark cell is a pair of which the data determine a combination "
        "better than each; an empty line is a parameter without a standard error."
    )
    symbols = parameter_symbols(found.labels)
    return section(
        "Parameters",
        Sheet.of(parameter_table(found, framed=False), caption="Standard errors are clustered by window."),
        Paragraph(text=f"{represents_sentence(found.layout)} {coulomb_sentence(found.coulomb)}"),
        drawn_picture("friction", partial(friction_figure, found, logs), caption),
        drawn_picture("parameters", partial(correlation_figure, symbols, found.correlation), correlation),
    )


def _law_section(selection: ModelSelection[Identification], ladder_svg: str) -> Section:
    caption = (
        "Left: the error of each law on held-out windows, relative to no friction. Right: its gain over the law "
        "within it, with 95 % intervals; a cross: not accepted."
    )
    return section(
        "Friction laws",
        Sheet.of(selection_table(selection, framed=False)),
        Picture(markup=ladder_svg, caption=caption),
    )


def _error_blocks(found: Identification, holdouts: Sequence[HoldoutResult]) -> Iterator[Block]:
    yield Sheet.of(error_table(found, holdouts, framed=False))
    for one in holdouts:
        if one.horizons:
            yield Sheet.of(horizon_table(one, framed=False))


def _undecided(found: Identification, holdouts: Sequence[HoldoutResult]) -> list[str]:
    sentences = texts((*found.warnings, *(remark for one in holdouts for remark in one.remarks)))
    if found.variation.logs == 1:
        sentences.append("How much the estimate differs from log to log: there is one log.")
    return [*sentences, "The friction at speeds, loads and temperatures that the logs do not have."]
