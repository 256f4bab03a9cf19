"""The page of two controllers in turn on a live robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle

from ballbot.log import Log
from ballbot.report.blocks import Bullets, Column, Result, Sheet, section, sheet_of
from ballbot.report.series import Look, Panel, TimeSeries, together
from ballbot.results import to_results
from ballbot.rounding import unit_heading
from ballbot.workflows.alternation import Alternation
from ballbot.workflows.controller_prediction import SHOWN
from ballbot.workflows.metrics import position_error

LOOKS_IN_TURN: tuple[Look, ...] = ("second", "first", "third", "fourth", "fifth", "sixth")


def alternation_report(
    found: Alternation,
    logs: Sequence[Log],
    *,
    controllers: tuple[str, str],  # the files of the one before and the one after
    about: str,
    origin: Mapping[str, object],  # the provenance with the robot's
) -> Result:
    """Return the page of two controllers in turn."""
    runs = [f"{k} {'after' if k % 2 == 0 else 'before'}" for k in range(1, len(logs) + 1)]
    verdicts = [
        f"Run {2 * k} against the prediction: {one.recommendation}. {one.reason}"
        for k, one in enumerate(found.verdicts, start=1)
    ]
    undecided = ["Where the robot truly was: the errors are those of its own position, which drifts."]
    open_ones = [name.replace("_", " ") for name, gain in found.gains.items() if gain.verdict == "undecided"]
    if open_ones:
        text = f"Whether {', '.join(open_ones)} differ: their intervals contain one. More --rounds make them narrow."
        undecided.insert(0, text)
    return Result(
        title="Two controllers in turn on a live robot",
        lead=f"{about} Before: {controllers[0]}. After: {controllers[1]}.",
        verdict=[("", _conclusion(found))],
        sections=[
            section("Compared", *_gains_and_runs(found, runs), Bullets(verdicts)),
            section("Over time", _errors_in_turn(runs, logs)),
        ],
        undecided=undecided,
        data={
            "recommendation": found.recommendation,
            "conclusion": _conclusion(found),
            "runs": found.performances,
            "gains": {
                name: to_results(gain) | {"verdict": gain.verdict} for name, gain in found.gains.items()
            },
            "verdicts": [
                {
                    "recommendation": one.recommendation,
                    "reason": one.reason,
                    "outside": [quantity.name for quantity in one.quantities if quantity.place != "inside"],
                }
                for one in found.verdicts
            ],
            "controllers": dict(zip(("before", "after"), controllers, strict=True)),
            "provenance": origin,
        },
    )


def _gains_and_runs(found: Alternation, runs: Sequence[str]) -> tuple[Sheet, Sheet]:
    names = {name: one.words for name, one in SHOWN.items()} | {"torque_margin": "torque used"}
    gains = sheet_of(
        found.gains.items(),
        [
            Column("quantity", lambda one: names[one[0]]),
            Column("factor", lambda one: f"{one[1].factor:.2f}"),
            Column("95 % interval", lambda one: f"{one[1].low:.2f} to {one[1].high:.2f}"),
            Column("", lambda one: one[1].verdict),
            Column("drift from run to run", lambda one: f"{round(100.0 * (one[1].drift - 1.0)):+d} %"),
        ],
        caption="After over before, the drift removed.",
    )
    performances = [
        (
            unit_heading(shown.words, shown.unit),
            *(shown.shown(getattr(one, name)) for one in found.performances),
        )
        for name, shown in SHOWN.items()
    ]
    return gains, Sheet(("quantity", *runs), performances, "Runs in turn.")


def _errors_in_turn(runs: Sequence[str], logs: Sequence[Log]) -> TimeSeries:
    looked = zip(runs, cycle(LOOKS_IN_TURN), logs, strict=False)
    t, lines = together(
        [(f"run {name}", look, log.t - log.t[0], 1e3 * position_error(log)) for name, look, log in looked]
    )
    panel = Panel("distance from the reference [mm]", lines, from_zero=True)
    return TimeSeries(t, (panel,), "The runs one over another, from their starts.")


def _conclusion(found: Alternation) -> str:
    """Return the result of runs in turn in one or two sentences."""
    advice = f"{found.recommendation.capitalize()} the controller by the study's prediction."
    gain = found.gains.get("peak_error")
    if gain is None:
        return f"{advice} A run ended before it settled, so that the errors are not compared."
    size = f"The peak error is {gain.factor:.2f} times as large ({gain.low:.2f} to {gain.high:.2f})"
    if gain.verdict == "undecided":
        return f"{advice} {size}, which decides nothing; repeat the comparison with more --rounds."
    return f"{advice} {size}."
