"""The pages of a live robot: a run, its wiring, and two controllers in turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ballbot.link.wiring import WiringCheck
from ballbot.log import Log
from ballbot.report.blocks import Bullets, Report, Sheet, section
from ballbot.report.live import alternation_parts, conclusion, wiring_parts
from ballbot.report.provenance import Provenance
from ballbot.report.run import over_time, run_sections, run_verdict
from ballbot.report.series import Line, Look, Panel, TimeSeries, together
from ballbot.robot import Robot
from ballbot.workflows.alternation import Alternation
from ballbot.workflows.metrics import position_error


def live_run_report(
    log: Log, robot: Robot | None, *, balancing: bool, ending: str, about: str, made: Provenance
) -> Report:
    """Return the page of a recorded run; `about` names the robot and its controller, `ending` how the run ended."""
    verdict = run_verdict(log) if balancing else []
    sections = run_sections(log, robot) if balancing else [section("Over time", *over_time(log, robot))]
    undecided = ["How much runs differ: this is one. `ballbot run compare` makes several in turn."]
    if balancing:
        undecided.insert(
            0,
            "Where the robot truly was: position and heading are those that it computes on board, and they drift.",
        )
    if robot is None:
        undecided.append("What is a wheel's share of its limit: the robot is not described (--robot).")
    return Report(
        title="A run of a live robot",
        lead=about,
        verdict=[*verdict, ("Ending", ending)],
        sections=sections,
        undecided=undecided,
        made=made,
    )


def wiring_report(check: WiringCheck, *, about: str, made: Provenance) -> Report:
    """Return the page of a wiring check and, if it passed, of the self-test that must then have passed, too."""
    (turns,) = (one for one in wiring_parts(check) if isinstance(one, Sheet))
    verdict = (
        "The wiring is right. Every motor turns its own encoder forward: the self-test passed."
        if check.passed
        else f"The wiring is not right. {check.findings[0].text}"
    )
    caption = (
        "What the sensors measured of each movement: the attitude about x, y, z; the wheels in their order."
    )
    untested = (
        "The direction of the torques: the self-test of each motor with its encoder waits for the wiring."
    )
    return Report(
        title="Wiring of a robot",
        lead=about,
        verdict=[("", verdict)],
        sections=[section("Turns by hand", replace(turns, caption=caption))],
        undecided=[
            "Scale factors more exactly than the hand turns: `ballbot identify-geometry` finds them from logs.",
            *([] if check.passed else [untested]),
        ],
        made=made,
        findings=check.findings,
        accepted=False,
    )


def alternation_report(
    found: Alternation, logs: Sequence[Log], *, controllers: tuple[str, str], about: str, made: Provenance
) -> Report:
    """Return the page of two controllers in turn; `controllers` names the files of the one before and the one after."""
    before, after = controllers
    tables = [one for one in alternation_parts(found) if isinstance(one, Sheet)]
    verdicts = [
        f"Run {2 * k} against the prediction: {one.recommendation}. {one.reason}"
        for k, one in enumerate(found.verdicts, start=1)
    ]
    t, errors = together([(log.t - log.t[0], 1e3 * position_error(log)) for log in logs])
    # both controllers' runs in turn: the first has the one look, the second the other
    looks: tuple[Look, ...] = ("second", "first", "third", "fourth", "fifth", "sixth")
    lines = [
        Line(name=f"run {k + 1}, {'after' if k % 2 else 'before'}", values=values, look=looks[k % len(looks)])
        for k, values in enumerate(errors)
    ]
    open_ones = [name.replace("_", " ") for name, gain in found.gains.items() if gain.verdict == "undecided"]
    undecided = ["Where the robot truly was: the errors are those of its own position, which drifts."]
    if open_ones:
        text = f"Whether {', '.join(open_ones)} differ: their intervals contain one. More --rounds make them narrow."
        undecided.insert(0, text)
    panel = Panel(label="distance from the reference [mm]", lines=lines, from_zero=True)
    return Report(
        title="Two controllers in turn on a live robot",
        lead=f"{about} Before: {before}. After: {after}.",
        verdict=[("", conclusion(found))],
        sections=[
            section("Compared", *tables, Bullets(items=verdicts)),
            section(
                "Over time",
                TimeSeries(
                    t=t, panels=(panel,), caption="The runs one over another, from the start of each."
                ),
            ),
        ],
        undecided=undecided,
        made=made,
    )
