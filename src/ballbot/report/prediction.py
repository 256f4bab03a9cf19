"""The verdict of `ballbot validate --prediction` on a controller: its page and the next steps."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ballbot.findings import Finding, by_severity
from ballbot.printable import shell_line
from ballbot.report.blocks import Block, Bullets, Column, Result, Sheet, section, sheet_of
from ballbot.results import to_results
from ballbot.rounding import interval, unit_heading
from ballbot.workflows.controller_choice import CANDIDATES
from ballbot.workflows.controller_prediction import (
    SHOWN,
    ControllerPrediction,
    ControllerVerdict,
    PredictionInterval,
    QuantityResult,
)


def prediction_report(
    verdict: ControllerVerdict,
    prediction: ControllerPrediction,
    *,
    title: str,
    series: Sequence[Block],
    findings: Sequence[Finding],
    steps: Sequence[str],
) -> Result:
    """Return the page of a verdict; `series` shows the run over time."""
    course, differences = prediction.course, verdict.differences
    quantities = {
        quantity.name: to_results(quantity) | to_results(quantity.predicted)
        for quantity in verdict.quantities
    }
    own = {"next_steps": steps, "course": course, "controller": prediction.controller}
    none = verdict.none
    columns: list[Column[QuantityResult]] = [
        Column("quantity", lambda quantity: _name(quantity.name)),
        Column("measured", lambda quantity: SHOWN[quantity.name].shown(quantity.value)),
        Column("predicted", lambda quantity: SHOWN[quantity.name].shown(quantity.predicted.median)),
        Column("95 % interval", lambda quantity: _interval(quantity.name, quantity.predicted)),
        Column("verdict", _verdict),
        Column(
            "without compensation",
            lambda quantity: _interval(quantity.name, none[quantity.name]) if none else "falls",
        ),
    ]
    caption = (
        "Predicted and measured. Of 50 simulated robots with unknown faults 92 % of all quantities were inside their "
        f"intervals, 87 % of the peak errors.{prediction.calibration}"
    )
    table = sheet_of(verdict.quantities, columns, caption=caption, shaded=lambda quantity: quantity.worse)
    return Result(
        title=title,
        lead=(
            f"The course {course.name}, {course.duration:g} s, with the controller {prediction.controller} of a "
            f"study that predicted it from {prediction.draws} simulated robots (scenario "
            f"{prediction.scenario})."
        ),
        verdict=[("", f"{verdict.reason} {verdict.recommendation.capitalize()} this controller.")],
        sections=[
            section("Predicted and measured", table),
            section("What differs from the study's logs", Bullets(differences)),
            section("The run", *series),
        ],
        undecided=[
            "Whether another run of the same controller would be inside: one log is one run.",
            "What caused a difference: several faults move one number alike, and several may act at once.",
        ],
        findings=findings,
        data={
            "prediction": to_results(verdict) | {"quantities": quantities} | own,
            "findings": by_severity(findings),
        },
    )


def predicted_sheet(prediction: ControllerPrediction) -> Sheet:
    """Return each quantity as predicted, with the chosen controller and without compensation."""
    none = prediction.none
    columns: list[Column[tuple[str, PredictionInterval]]] = [
        Column("quantity", lambda row: _name(row[0])),
        Column("predicted", lambda row: SHOWN[row[0]].shown(row[1].median)),
        Column("95 % interval", lambda row: _interval(*row)),
        Column(
            "soft gain, no compensation", lambda row: _interval(row[0], none[row[0]]) if none else "falls"
        ),
    ]
    caption = f"Each interval holds the value of one new run with 95 % probability.{prediction.calibration}"
    return sheet_of(prediction.chosen.items(), columns, caption=caption)


def _name(quantity: str) -> str:
    return unit_heading(SHOWN[quantity].words, SHOWN[quantity].unit)


def next_steps(
    verdict: ControllerVerdict,
    prediction: ControllerPrediction,
    *,
    results: Path,
    robot: Path,
    controller: Path,
) -> list[str]:
    """Return what to do, in sentences that name the study's files."""
    steps = []
    if verdict.foreign:
        steps.append(
            "The torques are not those that the controller gives for the logged states. Make sure that the log was "
            f"made with {controller}, from the start of a run: the verdict is about that controller only."
        )
    if verdict.recommendation == "keep":
        return [*steps, f"Go on with {controller}."]
    if verdict.recommendation == "revert":
        previous = results.with_name("previous_controller.toml")
        steps.append(f"Go back to {previous}, the controller before this one.")
    else:
        kind, compensation = CANDIDATES[prediction.controller]
        words = ["ballbot", "design", str(robot), "--kind", kind.name, "--compensation", compensation]
        steps.append(f"Compensate less friction: `{shell_line(words)} --compensation-gain 0.8 --out weaker`.")
    return [*steps, "Run `ballbot study` again with this log among its logs."]


def _verdict(quantity: QuantityResult) -> str:
    if not np.isfinite(quantity.value):
        return "outside (the run ended too early)"
    return "inside" if quantity.place == "inside" else f"outside, {'worse' if quantity.worse else 'better'}"


def _interval(name: str, bounds: PredictionInterval) -> str:
    return interval(bounds.low, bounds.high, SHOWN[name].shown)
