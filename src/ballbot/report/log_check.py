"""A log as `ballbot check-log` shows it: its columns, its wheels and its findings, or the mapping proposed for it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from ballbot.errors import InputError
from ballbot.findings import Finding, note
from ballbot.log import Log
from ballbot.log.checks import check
from ballbot.log.checks.kinematics import WheelAgreement, wheel_agreement
from ballbot.log.log import ColumnSummary, summarize
from ballbot.log.mapping_inference.proposal import Proposal
from ballbot.log.mapping_inference.report import Evaluation
from ballbot.log.pose import with_position
from ballbot.report.console import finding_line, table
from ballbot.robot import Robot


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckedLog:
    """A log with what its checks found."""

    file: Path
    log: Log
    columns: tuple[ColumnSummary, ...]
    findings: tuple[Finding, ...]
    wheels: WheelAgreement | None  #: compared with the robot's kinematics, if the robot is given

    @staticmethod
    def of(file: Path, log: Log, robot: Robot | None) -> CheckedLog:
        """Check a log that was read from a file, against a robot if it is given.

        A log without x and y is checked as every command uses it: with those that the wheels give.
        """
        completed = _completed(log, robot) if robot else log
        computed = [name for name in completed.names if name not in log]
        notes = [note("use", f"The wheels give {', '.join(computed)}, which the file does not have.")]
        return CheckedLog(
            file=file,
            log=completed,
            columns=summarize(completed),
            findings=(*check(completed, robot=robot), *(notes if computed else ())),
            wheels=wheel_agreement(completed, robot) if robot else None,
        )

    def results(self) -> dict[str, object]:
        """Return the entries of results.json."""
        log = self.log
        return {
            "file": str(self.file),
            "rows": len(log),
            "start": float(log.t[0]),
            "end": float(log.t[-1]),
            "sample_time": log.sample_time if len(log) > 1 else None,
            "columns": self.columns,
            "findings": self.findings,
            "wheels": self.wheels,
        }


def _completed(log: Log, robot: Robot) -> Log:
    """Return the log with the ball's position by its wheels if it has none; as it is if it cannot have one."""
    try:
        return with_position(log, robot)
    except InputError:
        return log  # the findings name what it lacks


def checked_log_parts(checked: CheckedLog, *, framed: bool) -> Iterator[RenderableType]:
    """Yield the log's length, its columns, its wheels if they were compared, and the findings."""
    log = checked.log
    rate = f", {1.0 / log.sample_time:.4g} Hz" if len(log) > 1 else ""
    yield Text(f"{checked.file}: {len(log)} rows, {log.t[-1] - log.t[0]:.6g} s{rate}")
    yield _column_table(checked.columns, framed=framed)
    if checked.wheels:
        yield _wheel_table(checked.wheels, framed=framed)
    for finding in checked.findings:
        yield finding_line(finding)
    if not checked.findings:
        yield Text("No problems were found.")


def _column_table(summaries: tuple[ColumnSummary, ...], *, framed: bool) -> Table:
    rows = [
        (
            column.name,
            column.unit or "?",
            *("-" if limit is None else f"{limit:.4g}" for limit in (column.least, column.greatest)),
            f"{column.change_rate:.4g}",
            str(column.missing),
        )
        for column in summaries
    ]
    headings = ("column", "unit", "from", "to", "changes per second", "missing")
    return table("Columns", headings, rows, framed=framed)


def _wheel_table(wheels: WheelAgreement, *, framed: bool) -> Table:
    found = zip(wheels.order, wheels.signs, wheels.gains, wheels.correlations, strict=True)
    rows = [
        (str(i), str(place), f"{sign:+d}", f"{gain:.4f}", f"{correlation:.4f}")
        for i, (place, sign, gain, correlation) in enumerate(found, start=1)
    ]
    headings = ("robot's wheel", "log's wheel", "sign", "gain", "correlation")
    return table("Wheels, compared with the robot's kinematics", headings, rows, framed=framed)


def proposal_parts(file: Path, found: Evaluation, *, framed: bool) -> Iterator[RenderableType]:
    """Yield the conclusions on a foreign file, the tested wheel orders, and the findings."""
    yield Text(f"{file}: not in Ballbot's format; proposed mapping:")
    yield _conclusion_table(found, framed=framed)
    if found.proposal.lean_test:
        yield _placement_table(found.proposal, framed=framed)
    for finding in found.findings:
        yield Text(f"{finding.severity}: {finding.text}")


def _conclusion_table(found: Evaluation, *, framed: bool) -> Table:
    rows = [
        (
            one.name,
            one.value if one.determined else f"cannot determine: {one.question}",
            one.percent,
            one.evidence + (f"; standard error {one.error_text}" if one.error_text else ""),
        )
        for one in found.conclusions
    ]
    return table("Conclusions", ("question", "answer", "confidence [%]", "evidence"), rows, framed=framed)


def _placement_table(proposal: Proposal, *, framed: bool) -> Table:
    placements = proposal.lean_test.placements if proposal.lean_test else ()
    least = min((one.misfit for one in placements), default=1.0)
    rows = [
        (
            one.description,
            f"{math.degrees(one.phase):.1f}",
            f"{one.gain:.2f}",
            f"{100.0 * one.unexplained:.1f}",
            f"{100.0 * one.together:.1f}",
            f"{one.misfit / least:.1f}",
        )
        for one in placements
    ]
    headings = (
        "wheel order",
        "phase [deg]",
        "gain",
        "lean unexplained [%]",
        "wheels together [%]",
        "misfit",
    )
    return table("Wheel orders, by the response of the lean", headings, rows, framed=framed)


def proposal_results(file: Path, found: Evaluation) -> dict[str, object]:
    """Return the entries of results.json for a proposed mapping and the log that it makes."""
    proposal, drive = found.proposal, found.proposal.drive
    tested, heading, commands = proposal.lean_test, proposal.heading, proposal.commands
    return {
        "file": str(file),
        "roles": proposal.roles,
        "conclusions": found.conclusions,
        "undetermined": [one.name for one in found.undetermined],
        "refusal": found.refusal,
        "time_unit": proposal.time,
        "wheel_unit": proposal.wheel,
        "lean_unit": proposal.lean,
        "gyro": proposal.gyro,
        "speed_noise": {"before": proposal.timing.before, "after": proposal.timing.after},
        "handedness": None if tested is None else "mirrored" if tested.placements[0].mirrored else "direct",
        "phase_deg": None if tested is None else math.degrees(tested.placements[0].phase),
        "phase_error_deg": None
        if tested is None or tested.phase_error is None
        else math.degrees(tested.phase_error),
        "placements": [] if tested is None else tested.placements,
        "margin": None if tested is None else tested.margin,
        "sensor_delay": None if tested is None else tested.lag,
        "sensor_delay_error": None if tested is None else tested.lag_error,
        "command_delay": None if commands is None else commands.delay,
        "command_delay_error": None if commands is None else commands.delay_error,
        "disturbance": None if tested is None else tested.disturbance,
        "heading": heading,
        "commands": commands,
        "command_assignment": drive.assigned if drive else None,
        "command_response": drive.response if drive else None,
        "command_units": {unit.description: p for unit, p in drive.units.items() if p > 1e-3}
        if drive
        else {},
        "dead_band": proposal.dead_band if drive else None,
        "frame": proposal.frame,
        "keep": proposal.keep,
        "rows": None if found.log is None else len(found.log),
        "columns": [] if found.log is None else list(found.log.names),
        "findings": found.findings,
    }
