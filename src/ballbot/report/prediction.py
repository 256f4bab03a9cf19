"""The verdict of `ballbot validate --prediction` on a controller: results.json, the page, and the next steps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from ballbot.findings import Finding, finding_results, texts
from ballbot.printable import shell_line
from ballbot.report.blocks import Block, Bullets, Report, Section, Sheet, section, table
from ballbot.report.provenance import Provenance
from ballbot.results import to_results
from ballbot.rounding import unit_heading
from ballbot.workflows.controller_choice import CANDIDATES
from ballbot.workflows.controller_differences import NUMBERS
from ballbot.workflows.controller_prediction import Prediction, PredictionInterval
from ballbot.workflows.controller_verdict import SHOWN, QuantityResult, Verdict

#: factor on the compensated friction that is tried first
_WEAKER = 0.8


@dataclass(frozen=True, kw_only=True)
class StudyFolder:
    """The files of a study that a verdict's advice names."""

    results: Path  #: its results.json
    robot: Path
    controller: Path

    @property
    def previous(self) -> Path:
        """The controller that was used before this one."""
        return self.results.with_name("previous_controller.toml")


def prediction_results(verdict: Verdict, prediction: Prediction, steps: Sequence[str]) -> dict[str, object]:
    """Return what results.json holds of a verdict."""
    return {
        "confirmed": verdict.confirmed,
        "recommendation": verdict.recommendation,
        "reason": verdict.reason,
        "ended": verdict.ended,
        "quantities": {
            one.name: {
                "value": one.value,
                "place": one.place,
                "worse": one.worse,
                "factor": one.factor,
                **to_results(one.predicted),
            }
            for one in verdict.quantities
        },
        "none": verdict.none,
        "differences": verdict.differences,
        "findings": finding_results(verdict.findings),
        "next_steps": steps,
        "course": prediction.course,
        "controller": prediction.controller,
    }


def prediction_report(
    verdict: Verdict,
    prediction: Prediction,
    *,
    title: str,
    steps: Sequence[str],
    series: Sequence[Block],
    findings: Sequence[Finding],
    made: Provenance,
) -> Report:
    """Return the page of a verdict; `series` shows the run over time."""
    course = prediction.course
    rows = quantity_rows(verdict)
    notice = frozenset(place for place, row in enumerate(rows) if "worse" in row[4] or "early" in row[4])
    caption = (
        "Each interval is to hold the value of one new run with 95 % probability on a robot with faults like those "
        "that the intervals were calibrated on. On 50 other simulated robots with unknown faults 92 % of all "
        "quantities were inside, 87 % of the peak errors."
    )
    headings = ("quantity", "measured", "predicted", "95 % interval", "verdict", "without compensation")
    quantities = Sheet(headings=headings, rows=rows, caption=caption, shaded=notice)
    undecided = [
        "Whether another run of the same controller would be inside: one log is one run.",
        "What caused a difference: several faults move one number alike, and several may act at once.",
    ]
    return Report(
        title=title,
        lead=(
            f"The course {course.name}, {course.duration:g} s, with the controller {prediction.controller} of a "
            f"study that predicted it from {prediction.draws} simulated robots (scenario "
            f"{prediction.scenario})."
        ),
        verdict=[("", headline(verdict))],
        sections=[
            section(
                "Predicted and measured",
                quantities,
                Bullets(items=texts(verdict.findings)) if verdict.findings else None,
            ),
            *([_difference_section(verdict)] if verdict.differences else []),
            section("What to do next", Bullets(items=steps)),
            section("The run", *series),
        ],
        undecided=undecided,
        made=made,
        findings=findings,
    )


_DIFFERENCE_HEADINGS = ("what differs", "measured", "predicted", "times its usual difference")


def _difference_section(verdict: Verdict) -> Section:
    caption = (
        "Predicted: by a simulated run, the friction's numbers by the study's logs. The usual difference is one of "
        "robots without faults."
    )
    return section(
        "What differs from the logs",
        Sheet(headings=_DIFFERENCE_HEADINGS, rows=difference_rows(verdict), caption=caption),
    )


def difference_rows(verdict: Verdict) -> list[tuple[str, ...]]:
    """Return rows: number and unit, measured, predicted, by how many times its usual difference it is off."""
    return [
        (
            unit_heading(number.meaning, number.unit) if number.unit else number.meaning,
            f"{number.scale * one.measured:.3g}",
            f"{number.scale * one.predicted:.3g}",
            f"{one.usual_sizes:.0f}",
        )
        for one, number in ((one, NUMBERS[one.name]) for one in verdict.differences)
    ]


def headline(verdict: Verdict) -> str:
    """Return the verdict in one line."""
    return f"{verdict.reason} {verdict.recommendation.capitalize()} this controller."


def quantity_rows(verdict: Verdict) -> list[tuple[str, ...]]:
    """Return rows: quantity and unit, measured, predicted, its 95 % interval, its place, predicted without."""
    return [
        (
            unit_heading(SHOWN[one.name].words, SHOWN[one.name].unit),
            SHOWN[one.name].shown(one.value),
            SHOWN[one.name].shown(one.predicted.median),
            _interval(one.name, one.predicted),
            _place(one),
            _interval(one.name, verdict.none[one.name]) if verdict.none else "falls",
        )
        for one in verdict.quantities
    ]


def predicted_rows(prediction: Prediction) -> list[tuple[str, ...]]:
    """Return rows: quantity and unit, predicted, its 95 % interval, predicted without compensation."""
    return [
        (
            unit_heading(SHOWN[name].words, SHOWN[name].unit),
            SHOWN[name].shown(one.median),
            _interval(name, one),
            _interval(name, prediction.none[name]) if prediction.none else "falls",
        )
        for name, one in prediction.chosen.items()
    ]


def next_steps(verdict: Verdict, prediction: Prediction, files: StudyFolder) -> list[str]:
    """Return what to do, in sentences that name the study's files."""
    steps = _advice(verdict, prediction, files)
    if not verdict.findings:
        return steps
    own = f"Make sure first that the log was made with {files.controller}: the verdict is about that controller only."
    return [own, *steps]


def _advice(verdict: Verdict, prediction: Prediction, files: StudyFolder) -> list[str]:
    if verdict.recommendation == "keep":
        return [f"Go on with {files.controller}."]
    before = (
        f"Go back to {files.previous}, the controller before this one."
        if files.previous.exists()
        else (
            "Go back to the controller before this one, or to one without compensation: "
            f"`{_design(files, 'nominal', 'none')} --out nominal`."
        )
    )
    again = "Run `ballbot study` again with this log among its logs."
    if verdict.recommendation == "revert":
        return [before, again]
    kind, compensation = CANDIDATES[prediction.controller]
    weaker = f"{_design(files, kind, compensation)} --compensation-gain {_WEAKER:g}"
    return [f"Compensate less friction: `{weaker} --out weaker`.", again]


def _design(files: StudyFolder, kind: str, compensation: str) -> str:
    words = ["ballbot", "design", str(files.robot), "--kind", kind, "--compensation", compensation]
    return shell_line(words)


def _place(one: QuantityResult) -> str:
    if one.place == "inside":
        return "inside"
    if not np.isfinite(one.value):
        return "outside (the run ended too early)"
    return f"outside, {'better' if not one.worse else 'worse'}"


def _interval(name: str, one: PredictionInterval) -> str:
    return f"{SHOWN[name].shown(one.low)} to {SHOWN[name].shown(one.high)}"


_PREDICTION_HEADINGS = ("quantity", "measured", "predicted", "95 % interval", "", "without compensation")


def verdict_parts(verdict: Verdict, steps: Sequence[str]) -> Iterator[RenderableType]:
    """Yield the verdict, its findings, the predicted and measured quantities, what differs, and the next steps."""
    yield Text(headline(verdict), style="bold")
    for finding in verdict.findings:
        yield Text(finding.text)
    yield table("Predicted and measured", _PREDICTION_HEADINGS, quantity_rows(verdict))
    if verdict.differences:
        rows = difference_rows(verdict)
        yield table("What differs from the logs", _DIFFERENCE_HEADINGS, rows)
    for line in steps:
        yield Text(line)
