"""The page of an identification from balancing logs: parameters, friction, laws, and errors on held-out windows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.findings import Finding, texts
from ballbot.fitting.model_selection import ModelSelection
from ballbot.identification import HoldoutResult, Identification
from ballbot.identification.coulomb import coulomb_sentence
from ballbot.identification.result import represents_sentence
from ballbot.identification.stages import windows_for
from ballbot.identification.windows import Windows, standstill_torques
from ballbot.log import STATE_NAMES, Log
from ballbot.report.blocks import Block, Film, Paragraph, Picture, Report, Section, Sheet, section
from ballbot.report.friction import (
    error_table,
    horizon_table,
    ladder_figure,
    log_blocks,
    parameter_blocks,
    parameter_table,
    search_blocks,
    selection_table,
)
from ballbot.report.provenance import Provenance
from ballbot.report.series import Line, Panel, TimeSeries
from ballbot.report.study import friction_sentence
from ballbot.report.style import STATE_UNITS, drawn_picture
from ballbot.report.words import driveline_symbols, logs_words, state_mark
from ballbot.rounding import digits
from ballbot.viewer.page import replay_part
from ballbot.workflows.study import StudiedLog


def identification_report(
    found: Identification,
    logs: Mapping[str, Log],
    *,
    findings: Sequence[Finding],
    selection: ModelSelection[Identification] | None,
    ladder: Picture | None,
    holdouts: Sequence[HoldoutResult],
    made: Provenance,
) -> Report:
    """Return the page; `ladder` is the `ladder_picture` of the compared laws."""
    studied = [_studied(found, name, place, log) for place, (name, log) in enumerate(logs.items())]
    return Report(
        title=f"{found.robot.name}: friction from balancing logs",
        lead=f"Identified from {logs_words(logs)}, with predictions over windows of {found.window:g} s.",
        verdict=[("Verdict", found.verdict.sentence), ("Friction", friction_sentence(found))],
        sections=[
            _parameter_section(found, studied),
            *([_law_section(selection, ladder)] if selection and ladder else []),
            section(
                "Errors on held-out windows",
                *_error_blocks(found, holdouts),
                _predictions(found, studied),
                _replay(found, studied),
            ),
            section("The logs", *log_blocks(studied)),
            section("How the search went", *search_blocks(found)),
        ],
        undecided=_undecided(found, holdouts),
        made=made,
        findings=findings,
    )


def _studied(found: Identification, name: str, place: int, log: Log) -> StudiedLog:
    held: list[tuple[float, float]] = []
    for span in found.held_out_windows:
        if span.log == place:
            follows = bool(held) and span.start - held[-1][1] < 0.5 * log.sample_time
            start = held.pop()[0] if follows else span.start
            held.append((start, span.end))
    return StudiedLog(name=name, log=log, held_out=tuple(held))


def _parameter_section(found: Identification, logs: Sequence[StudiedLog]) -> Section:
    return section(
        "Parameters",
        _parameter_sheet(found),
        Paragraph(text=represents_sentence(found.names)),
        Paragraph(text=coulomb_sentence(found.coulomb, found.names)),
        *parameter_blocks(found, logs),
    )


def _parameter_sheet(found: Identification) -> Sheet:
    """Return the table that the command prints, with the robot file's values beside those found."""
    made = parameter_table(found)
    before = dict(zip(found.labels, found.layout.nominal(found.predictor.robot), strict=True))
    allowed = dict(zip(found.labels, found.bounds.tolist(), strict=True))
    rows = [
        (label, unit, digits(before[label]), *numbers, _range(*allowed[label]))
        for label, *numbers, unit in (map(str, row) for row in made.rows)
    ]
    name, _, *others, unit = made.headings
    headings = (name, unit, "in the robot file", "found", *others, "allowed")
    together = any(one.method == "with sweep" for one in found.intervals.values())
    rolling = " C_rr: the ball's rolling friction over its load." * ("rolling" in found.names)
    caption = (
        f"{driveline_symbols(found.names)}{rolling} Standard errors contain the variation between logs. A dash: held "
        "at a bound, or the logs do not show it. Open: the logs set no limit within the values allowed."
    )
    with_sweep = " Numbers and errors are those of the logs and the sweep together."
    return Sheet(headings=headings, rows=rows, caption=caption + with_sweep * together)


def _range(lower: float, upper: float) -> str:
    return f"{digits(lower)} .. {digits(upper)}" if upper > lower else f"held at {digits(lower)}"


#: windows in a time series: more would be a hand's breadth each
_MOST_WINDOWS = 40
#: the states that a prediction shows
_SHOWN = ("theta", "phi", "x_dot", "y_dot", "theta_dot", "phi_dot", "psi_dot")
#: the models of predictions
_FOUND, _WITHOUT = "with the friction found", "without friction"


def _predictions(found: Identification, logs: Sequence[StudiedLog]) -> TimeSeries | None:
    """Return measured and predicted states over held-out windows of the first log that has some."""
    studied = next((one for one in logs if one.held_out), None)
    if studied is None:
        return None
    predictor = found.predictor
    supplied = standstill_torques(studied.log, predictor.robot, predictor.back_emf)
    windows = windows_for(predictor, found.values, [supplied], duration=found.window)
    rows = _rows_within(windows, studied.held_out)[:_MOST_WINDOWS]
    if not len(rows):
        return None
    windows = windows.take(rows)
    ours, without = _predicted(found, windows)
    t, measured = _in_a_row(windows, windows.measured)
    panels = []
    for state in _SHOWN:
        column = STATE_NAMES.index(state)
        lines = (
            Line(name="measured", values=measured[:, column], look="measured"),
            Line(name=_FOUND, values=_in_a_row(windows, ours)[1][:, column], look="first"),
            Line(name=_WITHOUT, values=_in_a_row(windows, without)[1][:, column], look="second"),
        )
        panels.append(Panel(label=f"{state_mark(state)} [{STATE_UNITS[state]}]", lines=lines))
    caption = (
        f"Predictions of {len(windows)} windows of “{studied.name}” that the fit did not see, each from the state "
        "measured at its start and with the torques of the log."
    )
    return TimeSeries(t=t, panels=panels, caption=caption, across="time of the log [s]")


def _predicted(found: Identification, windows: Windows) -> NDArray[np.float64]:
    """Return the states (2, w, m, 10) that the models with the friction found and without friction predict."""
    predictor = found.predictor
    both = np.stack([found.values, predictor.layout.without_friction(found.values)])
    return predictor.residuals(both, windows, every=1) + windows.measured


#: time after which the models of a replay start again from the measured state, and its longest duration [s]
_RESTART, _LONGEST = 1.0, 10.0


def _replay(found: Identification, logs: Sequence[StudiedLog]) -> Film | None:
    """Return the longest stretch of a log that the fit did not see, measured and predicted, if it can be shown."""
    stretches = [(end - start, place) for place, one in enumerate(logs) for start, end in one.held_out]
    if not stretches:
        return None
    studied, predictor = logs[max(stretches)[1]], found.predictor
    start, end = max(studied.held_out, key=lambda one: one[1] - one[0])
    part = standstill_torques(studied.log, predictor.robot, predictor.back_emf).between(
        start, min(end, start + _LONGEST)
    )
    try:
        windows = _without_gap(windows_for(predictor, found.values, [part], duration=_RESTART))
        runs = {
            "measured": windows.measured,
            **dict(zip((_FOUND, _WITHOUT), _predicted(found, windows), strict=True)),
        }
        shown = {name: _on_end(windows, states) for name, states in runs.items()}
        film = replay_part(shown, found.robot, layout="ghosts", colors=("ink", "blue", "orange"))
    except InputError:  # a stretch without a whole run, or a model whose run has no value
        return None
    caption = (
        f"{len(windows) * windows.samples * windows.sample_time:.0f} s of “{studied.name}” that the fit did not see, "
        "in three dimensions, with both models as ghosts of the measured robot. The models have the torques of the log "
        f"and start again from the measured state every {_RESTART:g} s: left alone, either falls in time."
    )
    return Film(part=film, caption=caption)


def _without_gap(windows: Windows) -> Windows:
    """Return the first windows that lie end to end."""
    starts = np.array([one.start for one in windows.spans])
    gaps = np.flatnonzero(np.diff(starts) > (windows.samples + 0.5) * windows.sample_time)
    return windows.take(np.arange(gaps[0] + 1 if len(gaps) else len(windows)))


def _on_end(windows: Windows, states: NDArray[np.float64]) -> Log:
    """Return states (w, m, 10) of windows that lie end to end as a log, each window from its measured start."""
    whole = np.concatenate([windows.initial[:, None], states[:, :-1]], axis=1).reshape(-1, len(STATE_NAMES))
    columns = dict(zip(STATE_NAMES, whole.T, strict=True))
    return Log(
        {
            "t": windows.spans[0].start + windows.sample_time * np.arange(len(whole), dtype=np.float64),
            **columns,
        }
    )


def _rows_within(windows: Windows, intervals: Sequence[tuple[float, float]]) -> NDArray[np.intp]:
    """Return which windows of a log lie within intervals (start, end) [s].

    The windows of the fit begin later where a delay was estimated: they keep room for the longest that it may be.
    """
    slack = 0.5 * windows.sample_time  # times are rounded
    inside = [
        any(start - slack <= one.start and one.end <= end + slack for start, end in intervals)
        for one in windows.spans
    ]
    return np.flatnonzero(inside)


def _in_a_row(
    windows: Windows, states: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return time (k,) and states (k, 10) of windows (w, m, 10) one after another, each from its start, then a gap."""
    steps = windows.sample_time * np.arange(windows.samples + 2)
    t = np.array([one.start for one in windows.spans])[:, None] + np.minimum(steps, steps[-2])
    gap = np.full((len(windows), 1, states.shape[2]), np.nan)
    whole = np.concatenate([windows.initial[:, None], states, gap], axis=1)
    return t.ravel(), whole.reshape(-1, states.shape[2])


def ladder_picture(selection: ModelSelection[Identification]) -> Picture:
    """Return the figure of the compared laws."""
    caption = (
        "First the error of each law on held-out windows, relative to no friction, then its gain over the law "
        "within it, with 95 % intervals; a cross: not accepted."
    )
    return drawn_picture("ladder", partial(ladder_figure, selection), caption)


def _law_section(selection: ModelSelection[Identification], ladder: Picture) -> Section:
    return section("Friction laws", selection_table(selection), ladder)


def _error_blocks(found: Identification, holdouts: Sequence[HoldoutResult]) -> Iterator[Block]:
    made = error_table(found, holdouts)
    yield Sheet(
        headings=made.headings,
        rows=[(state_mark(str(row[0])), *row[1:]) for row in made.rows],
        caption=f"{made.caption}: of all their samples together.",
    )
    for one in holdouts:
        if one.horizons:
            yield horizon_table(one)


def _undecided(found: Identification, holdouts: Sequence[HoldoutResult]) -> list[str]:
    sentences = texts((*found.findings, *(finding for one in holdouts for finding in one.findings)))
    if found.variation.logs == 1:
        sentences.append("How much the estimate differs from log to log: there is one log.")
    return [*sentences, "The friction at speeds, loads and temperatures that the logs do not have."]
