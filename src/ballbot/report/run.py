"""The page of a run, simulated, recorded or live: its replay, its numbers and its time series."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, cast

import numpy as np

from ballbot.arrays import Floats
from ballbot.control.controller import Controller
from ballbot.errors import InputError
from ballbot.findings import Finding, by_severity
from ballbot.log import Log
from ballbot.log.columns import MAX_WHEELS, STATE_NAMES, TRUE_PREFIX, torque_names, wheel_speed_names
from ballbot.mechanics.parameters import Formulation
from ballbot.report.blocks import (
    Animation,
    Block,
    Column,
    Paragraph,
    Result,
    Sheet,
    entries_of,
    section,
    sheet_of,
)
from ballbot.report.series import Line, Panel, TimeSeries, wheel_lines
from ballbot.report.words import millimetres
from ballbot.robot import Robot
from ballbot.rounding import digits, percent
from ballbot.viewer.page import replay_part
from ballbot.workflows.metrics import (
    BAND,
    SETTLE,
    heading_error,
    leans,
    position_error,
    rms,
    rms_torque_change,
    run_results,
    settled,
    settling_time,
)

if TYPE_CHECKING:  # the link and the twin are extras
    from ballbot.link.tuning import Change
    from ballbot.link.wiring import Turn, WiringCheck
    from ballbot.twin.recording import Recording
    from ballbot.workflows.record import RecordJob

_DEGREES = math.degrees(1.0)
#: names of lines
_TRUE, _ON_BOARD = "true", "on board"


def simulation_report(
    log: Log,
    robot: Robot,
    *,
    reference: str,
    formulation: Formulation,
    scenario: str | None,
    findings: Sequence[Finding],
) -> Result:
    """Return the page of a run of the equations of motion; without a scenario its sensors are perfect."""
    sensors = "perfect sensors" if scenario is None else f"the sensors and faults of the scenario {scenario}"
    equations = "exact" if formulation == "exact" else "thesis's"
    perfect = "What noise, delay and quantisation do: the sensors are perfect; give --scenario nominal."
    return run_report(
        log,
        robot,
        title=f"{robot.name}: a simulated run",
        lead=(
            f"The reference {reference}, {float(log.t[-1] - log.t[0]):.1f} s, by the {equations} equations of motion "
            f"with {sensors}."
        ),
        undecided=[
            perfect if scenario is None else "",
            "How a real robot runs: the equations of motion have point contacts that do not slip, and a rigid body. "
            "`ballbot record` runs a physics engine with rollers and play.",
            "How much runs differ: this is one. `ballbot compare` runs several seeds and gives intervals.",
        ],
        findings=findings,
        data=run_results(log),
    )


_HELD = {"driveline_sweep": "the wheels in the air", "upside_down": "upside down with the ball on its wheels"}
_NOT_A_ROBOT = (
    "How the real robot runs: the twin has the faults of its scenario, and a robot has others. Compare a log with "
    "`ballbot validate`."
)


def recording_report(job: RecordJob, recording: Recording, findings: Sequence[Finding]) -> Result:
    """Return the page of a recorded run of the twin."""
    held, log = job.experiment != "balance", recording.run
    lead, own = f"The reference {job.reference}", job.controller
    if held:
        lead = f"The robot held, {_HELD[job.experiment]}"
    elif isinstance(own, Controller):
        lead += f", {'without' if own.compensation == 'none' else own.compensation} compensation"
    return run_report(
        log,
        job.robot,
        title=f"{job.robot.name}: a run of the twin",
        lead=f"{lead}; scenario {job.scenario.name}, seed {job.seed}.",
        undecided=[_NOT_A_ROBOT, "How much runs differ: this is one seed (--seeds records more)."],
        held=held,
        ending=f"{float(log.t[-1] - log.t[0]):.1f} s were recorded." if held else "",
        findings=findings,
        data={**({} if held else run_results(log)), **recording.results},
    )


def live_run_report(
    log: Log,
    robot: Robot | None,
    *,
    held: bool,
    ending: str,
    about: str,
    changes: Sequence[Change],  # of the controller during the run
    data: Mapping[str, object],
) -> Result:
    """Return the page of a recorded run; `about` names the robot and its controller, `ending` how the run ended."""
    drifts = "The robot's true path: position and heading are computed on board, and they drift."
    limit = "How close the torques come to the wheels' limit: give the robot's file (--robot)."
    page = run_report(
        log,
        robot,
        title="A run of a live robot",
        lead=about,
        undecided=[
            "" if held else drifts,
            "How much runs differ: this is one. `ballbot run compare` makes several alternately.",
            limit if robot is None else "",
        ],
        held=held,
        ending=ending,
        data=data,
    )
    rows = [(f"{change.t:.2f}", change.setting.words()) for change in changes]
    caption = (
        "Weights of the gains and shares of what was exported, to which the robot moved from each time on."
    )
    table = Sheet(("t [s]", "setting"), rows, caption) if rows else None
    return replace(page, sections=[*page.sections, section("Changes of the controller", table)])


def wiring_report(check: WiringCheck, *, about: str) -> Result:
    """Return the page of a wiring check."""
    wrong = "" if check.passed else f" {check.findings[0].text}"
    untested = (
        "The direction of the torques: the self-test of each motor with its encoder waits for the wiring."
    )
    columns: list[Column[Turn]] = [
        Column("the robot was", lambda turn: turn.movement.words, key="movement"),
        Column("attitude [deg]", lambda turn: turn.attitude, _in_degrees, key="attitude"),
        Column("wheels [deg]", lambda turn: turn.wheels, _in_degrees, key="wheels"),
    ]
    caption = (
        "What the sensors measured of each movement: the attitude about x, y, z; the wheels in their order."
    )
    return Result(
        title="Wiring of a robot",
        lead=about,
        verdict=[("", f"The wiring is {'not ' if wrong else ''}right.{wrong}")],
        sections=[section("Turns by hand", sheet_of(check.turns, columns, caption=caption))],
        undecided=[
            "Scale factors more exactly than the hand turns: `ballbot identify-geometry` finds them from logs.",
            untested if wrong else "",
        ],
        findings=check.findings,
        accepted=False,
        data={
            "passed": check.passed,
            "turns": [entries_of(turn, columns) for turn in check.turns],
            "wheel_scales": check.wheel_scales,
            "findings": by_severity(check.findings),
        },
    )


def _in_degrees(angles: Floats) -> str:
    # zero is added to a rounded number so that it is never written as -0
    return "  ".join(f"{angle:.0f}" for angle in np.round(np.degrees(angles)) + 0.0)


#: in the results of each run: the largest distance from the reference, and its root mean square [m]
_DISTANCES = ("peak_position_error_whole_run", "rms_position_error_whole_run")


def recordings_report(
    job: RecordJob, runs: Mapping[str, Mapping[str, object]], findings: Sequence[Finding]
) -> Result:
    """Return the page of runs with several seeds, from the results of each by the name of its folder."""
    early = sum(run["ended"] is not None for run in runs.values())
    verdict = [("Runs", f"{len(runs)} runs of {job.duration:g} s; {early} ended early.")]
    distances = {
        name: [cast("float", run.get(key, np.nan)) for key in _DISTANCES] for name, run in runs.items()
    }
    peaks = np.array([peak for peak, _ in distances.values()])
    if np.isfinite(peaks).any():
        low, middle, high = map(millimetres, np.nanquantile(peaks, [0.0, 0.5, 1.0]))
        text = f"From the reference, over the whole run: {low} to {high} mm, median {middle} mm."
        verdict.append(("Largest distance", text))
    rows = [(name, *map(millimetres, distances[name]), str(run["ended"] or "")) for name, run in runs.items()]
    caption = "The distance is that of the true position from the reference, over the whole run."
    headings = ("folder", "largest distance [mm]", "distance, RMS [mm]", "ended early")
    return Result(
        title=f"{job.robot.name}: {len(runs)} runs of the twin",
        lead=f"Scenario {job.scenario.name}, experiment {job.experiment}, reference {job.reference}.",
        verdict=verdict,
        sections=[section("Each run", Sheet(headings, rows, caption))],
        undecided=[_NOT_A_ROBOT],
        findings=findings,
        data={"runs": runs},
    )


def run_report(
    log: Log,
    robot: Robot | None,
    *,
    title: str,
    lead: str,
    undecided: Sequence[str],
    held: bool = False,
    ending: str = "",
    findings: Sequence[Finding] | None = None,
    data: Mapping[str, object] = MappingProxyType({}),
) -> Result:
    """Return the page of a run; if the robot was `held` and did not balance, with the time series only."""
    return Result(
        title=title,
        lead=lead,
        verdict=[*([] if held else run_verdict(log)), ("Ending", ending)],
        sections=[
            section("The run", *(() if held else (_replay(log, robot), _numbers(log, robot)))),
            section("Over time", *over_time(log, robot)),
        ],
        undecided=undecided,
        findings=findings,
        data=data,
    )


def run_verdict(log: Log) -> list[tuple[str, str]]:
    """Return how a balancing run went, in sentences."""
    length = float(log.t[-1] - log.t[0])
    if log.ended:
        return [("Run", f"It ended early, after {length:.1f} s: {log.ended}.")]
    if not _has_lean(log):
        return [("Run", f"{length:.1f} s were recorded.")]
    leaned = f"The robot balances for {length:.1f} s and leans by {_rounded(_largest_lean(log))}° at most."
    if not _has_reference(log):
        return [("Run", leaned)]
    counted, error = settled(log, SETTLE), position_error(log)
    if counted.any():
        text = (
            f"{_mm(error[counted].max())} mm at most, {_mm(rms(error[counted]))} mm RMS, leaving out the {SETTLE:g} s "
            "after the start and after each jump of the reference."
        )
    else:
        short = "run is" if length < SETTLE else "times between jumps of the reference are"
        text = (
            f"Not rated, as the {short} shorter than the {SETTLE:g} s that it needs to settle; "
            f"{_mm(error[-1])} mm at the end."
        )
    return [("Run", leaned), ("Distance from the reference", text)]


def over_time(log: Log, robot: Robot | None) -> list[Block]:
    """Return the time series of a log's columns: pose, error, lean, torques and speeds of the wheels."""
    limit = () if robot is None else (-robot.drive.torque_limit, robot.drive.torque_limit)
    torques = _columns(log, torque_names(MAX_WHEELS))
    speeds = _columns(log, wheel_speed_names(MAX_WHEELS))
    panels = pose_panels(log)
    if _has_reference(log):
        distance = Line("distance", 1e3 * position_error(log), "measured")
        panels.append(Panel("distance from the reference [mm]", [distance], from_zero=True))
    if _has_lean(log):
        lean = Line("lean", _DEGREES * leans(log), "measured")
        panels.append(Panel("lean [deg]", [lean], from_zero=True))
    if torques:
        reached = robot is not None and _largest(torques) > 0.5 * robot.drive.torque_limit
        panels.append(Panel("torques [N m]", wheel_lines(torques), levels=limit if reached else ()))
    if speeds:
        panels.append(Panel("wheel speeds [rad/s]", wheel_lines(speeds)))
    if not panels:
        return [Paragraph("The log has no column to draw.")]
    caption = "Drag across a plot to zoom in on a time, double-click to see all of it; point at a plot to read values."
    if any(panel.levels for panel in panels):
        caption += " Dashed across: the torque limit."
    names = {line.name for panel in panels for line in panel.lines}
    if {_TRUE, _ON_BOARD} <= names:
        caption += " The true values are the simulation's own; the controller has the on-board ones."
    return [TimeSeries(log.t, panels, caption)]


def pose_panels(log: Log) -> list[Panel]:
    """Return a panel each for position and heading: the reference, the truth and what the robot measures."""
    panels = []
    for name, label, unit in (("x", "x [m]", 1.0), ("y", "y [m]", 1.0), ("psi", "heading ψ [deg]", _DEGREES)):
        reference, true = f"ref_{name}", TRUE_PREFIX + name
        lines = [Line("reference", unit * log[reference], "reference")] if reference in log else []
        if true in log:
            lines.append(Line(_TRUE, unit * log[true], "measured"))
        if name in log and not (true in log and np.array_equal(log[name], log[true])):  # perfect sensors
            lines.append(Line(_ON_BOARD, unit * log[name], "fifth" if true in log else "measured"))
        if lines:
            panels.append(Panel(label, lines))
    return panels


def _columns(log: Log, names: Sequence[str]) -> list[Floats]:
    return [log[name] for name in names if name in log]


def _largest(columns: Sequence[Floats]) -> float:
    return max(
        (float(np.nanmax(np.abs(column))) for column in columns if np.isfinite(column).any()), default=0.0
    )


def _numbers(log: Log, robot: Robot | None) -> Sheet:
    """Return the table of a run's numbers; errors count once the robot has settled."""
    rows = [("length", f"{float(log.t[-1] - log.t[0]):.2f} s", f"{len(log)} rows")]
    if _has_reference(log) and (counted := settled(log, SETTLE)).any():
        error, heading = position_error(log)[counted], _DEGREES * heading_error(log)[counted]
        arriving, always = settling_time(log)
        within = f"until it stays within {1e3 * BAND:g} mm; the longest of the run"
        rows += [
            ("largest distance from the reference", f"{_mm(error.max())} mm", "once settled"),
            ("distance from the reference, RMS", f"{_mm(rms(error))} mm", "once settled"),
            ("largest error of the heading", f"{_rounded(float(heading.max()))}°", "once settled"),
            ("settling time", f"{'' if always else '≥ '}{arriving:.2f} s", within),
        ]
    if _has_lean(log):
        rows.append(("largest lean", f"{_rounded(_largest_lean(log))}°", "whole run"))
    if torques := _columns(log, torque_names(MAX_WHEELS)):
        largest = _largest(torques)
        share = "" if robot is None else f"{percent(largest / robot.drive.torque_limit)} of the robot's limit"
        rows += [
            ("largest torque of a wheel", f"{digits(largest)} N m", share),
            ("torque, RMS", f"{digits(rms(log.torques))} N m", "all wheels, whole run"),
            ("change of torque from row to row, RMS", f"{digits(rms_torque_change(log))} N m", "roughness"),
        ]
    has_truth = all(f"{TRUE_PREFIX}{name}" in log for name in STATE_NAMES)
    caption = (
        f"Errors are of the {'true' if has_truth else 'logged'} position. “Once settled” leaves out the "
        f"{SETTLE:g} s after the start and after each jump of the reference, however far off the robot then is."
    )
    return Sheet(("quantity", "value", ""), rows, caption)


def _replay(log: Log, robot: Robot | None) -> Animation | None:
    """Return the run in three dimensions, if it can be shown."""
    if robot is None:
        return None
    try:
        part = replay_part({"run": log}, robot)
    except InputError:  # a robot that is held, a log without angles, or one too long for a page
        return None
    return Animation(part, "The run. Drag to orbit; the plots' time cursor can be dragged, too.")


def _has_lean(log: Log) -> bool:
    return all(name in log and bool(np.isfinite(log[name]).any()) for name in ("theta", "phi"))


def _largest_lean(log: Log) -> float:
    return _DEGREES * float(np.nanmax(leans(log)))


def _has_reference(log: Log) -> bool:
    return all(name in log for name in ("ref_x", "ref_y", "ref_psi", "x", "y", "psi"))


def _mm(metres: float) -> str:
    return _rounded(1e3 * float(metres))


def _rounded(value: float) -> str:
    return "0" if abs(value) < 0.5e-3 else digits(value, 2)  # of lengths [mm] and angles [deg]
