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
from ballbot.report.blocks import Block, Bullets, Report, Section, Sheet, section
from ballbot.report.console import table
from ballbot.report.provenance import Provenance
from ballbot.results import to_results
from ballbot.rounding import unit_heading
from ballbot.workflows.controller_causes import Cause
from ballbot.workflows.controller_choice import CANDIDATES
from ballbot.workflows.controller_prediction import Prediction, PredictionInterval
from ballbot.workflows.controller_verdict import BETTER, QUANTITY_NAMES, QuantityResult, Verdict

#: of each quantity: by what it is multiplied to be shown, its unit and decimals
_SHOWN = {
    "peak_error": (1e3, "mm", 1),
    "rms_error": (1e3, "mm", 1),
    "roughness": (1.0, "N m", 3),
    "lean": (1.0, "rad", 3),
    "torque_margin": (1e2, "%", 0),
}
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
        "recommendation": verdict.recommendation,
        "reason": verdict.reason,
        "ended": verdict.ended,
        "quantities": {
            one.name: {
                "value": one.value,
                "place": one.place,
                "worse": one.worse,
                **to_results(one.predicted),
            }
            for one in verdict.quantities
        },
        "none": verdict.none,
        "causes": verdict.causes,
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
        *(
            [
                "The causes of what differs, for sure: they are ranked by likeness, and several may act at once."
            ]
            if verdict.causes
            else []
        ),
    ]
    if not verdict.causes and (verdict.outside or verdict.ended is not None):
        undecided.insert(
            0, "The cause of the difference: nothing else in the log differs from the predicted run."
        )
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
            *([_cause_section(verdict)] if verdict.causes else []),
            section("What to do next", Bullets(items=steps)),
            section("The run", *series),
        ],
        undecided=undecided,
        made=made,
        findings=findings,
    )


def _cause_section(verdict: Verdict) -> Section:
    rows = [(cause.name, cause.meaning, cause.confidence, _evidence(cause)) for cause in verdict.causes]
    caption = (
        "Ranked by how far the log is from the predicted run, in the variation usual between runs of a robot without "
        "faults."
    )
    headings = ("cause", "which means that", "confidence", "evidence")
    return section("Likely causes", Sheet(headings=headings, rows=rows, caption=caption))


def headline(verdict: Verdict) -> str:
    """Return the verdict in one line."""
    return f"{verdict.recommendation.capitalize()} this controller. {verdict.reason}"


def quantity_rows(verdict: Verdict) -> list[tuple[str, ...]]:
    """Return rows: quantity and unit, measured, predicted, its 95 % interval, its place, predicted without."""
    return [
        (
            unit_heading(QUANTITY_NAMES[one.name], _SHOWN[one.name][1]),
            _number(one.name, one.value),
            _number(one.name, one.predicted.median),
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
            unit_heading(QUANTITY_NAMES[name], _SHOWN[name][1]),
            _number(name, one.median),
            _interval(name, one),
            _interval(name, prediction.none[name]) if prediction.none else "falls",
        )
        for name, one in prediction.chosen.items()
    ]


def cause_lines(verdict: Verdict) -> list[str]:
    """Return the causes in words, the likeliest first; one line without a cause if only the quantities are outside."""
    if not verdict.outside and verdict.ended is None:
        return []
    if not verdict.causes:
        return ["The cause cannot be determined: nothing else in the log differs from the predicted run."]
    return [
        f"{place}. {cause.name} ({cause.meaning}), {cause.confidence}: {_evidence(cause)}"
        for place, cause in enumerate(verdict.causes, start=1)
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
    causes = [cause.name for cause in verdict.causes[:1]]
    repair = [_REPAIRS[name].format(robot=files.robot) for name in causes]
    if verdict.recommendation == "revert":
        return [before, *repair, "Run `ballbot study` again with this log among its logs."]
    kind, compensation = CANDIDATES[prediction.controller]
    weaker = f"{_design(files, kind, compensation)} --compensation-gain {_WEAKER:g}"
    return [f"Compensate less friction: `{weaker} --out weaker`.", *repair]


_REPAIRS = {
    "delay": (
        "Find the delay with `ballbot identify {robot} LOG --estimate delays --out delays`; give it to "
        "`ballbot design --delay`."
    ),
    "grip": "Clean ball and wheels, or press them together more firmly, and record the course again.",
    "friction": "Run `ballbot study` on new logs: the friction identified is not that of the robot as it is now.",
    "sensor": "Check the IMU's mounting and its calibration at rest, and record the course again.",
    "mapping": "Check torque constants, gear ratios and columns with `ballbot check-log LOG --robot {robot}`.",
    "body": "Measure mass and height of the robot as it is now, correct {robot}, and run `ballbot study` again.",
    "floor": "Record the course on a level floor, or design with `--adaptive`.",
}


def _design(files: StudyFolder, kind: str, compensation: str) -> str:
    words = ["ballbot", "design", str(files.robot), "--kind", kind, "--compensation", compensation]
    return shell_line(words)


def _evidence(cause: Cause) -> str:
    size = f" ({cause.strength:.0f} times the usual variation)" if np.isfinite(cause.strength) else ""
    return f"{cause.finding.text}{size}"


def _place(one: QuantityResult) -> str:
    if one.place == "inside":
        return "inside"
    if not np.isfinite(one.value):
        return "outside (the run ended too early)"
    return f"outside, {'better' if one.place == BETTER[one.name] else 'worse'}"


def _number(name: str, value: float) -> str:
    factor, _, decimals = _SHOWN[name]
    return f"{factor * value:.{decimals}f}" if np.isfinite(value) else "–"


def _interval(name: str, one: PredictionInterval) -> str:
    return f"{_number(name, one.low)} to {_number(name, one.high)}"


_PREDICTION_HEADINGS = ("quantity", "measured", "predicted", "95 % interval", "", "without compensation")


def verdict_parts(verdict: Verdict, steps: Sequence[str], *, framed: bool) -> Iterator[RenderableType]:
    """Yield the verdict, its findings, the predicted and measured quantities, likely causes, and the next steps."""
    yield Text(headline(verdict), style="bold")
    for finding in verdict.findings:
        yield Text(finding.text)
    yield table("Predicted and measured", _PREDICTION_HEADINGS, quantity_rows(verdict), framed=framed)
    lines = cause_lines(verdict)
    if lines:
        yield Text("Likely causes", style="bold")
    for line in (*lines, *steps):
        yield Text(line)
