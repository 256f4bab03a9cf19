"""The page of `ballbot check-log`: a log's columns, wheels and findings, or the mapping proposed for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError, every
from ballbot.findings import Finding, note
from ballbot.log import Log
from ballbot.log.checks import check, check_uses, missing_columns
from ballbot.log.checks.kinematics import WheelAgreement, wheel_agreement
from ballbot.log.columns import unit_of
from ballbot.log.pose import with_position, with_rates
from ballbot.log.proposal import Proposal, answer_lines
from ballbot.report.blocks import Column, Result, Sheet, Verbatim, entries_of, section, sheet_of
from ballbot.report.run import over_time
from ballbot.report.words import capital
from ballbot.robot import Robot
from ballbot.summary import counted

#: a column's name, its finite values, its number of rows, and the log's duration [s]
_Summed = tuple[str, Floats, int, float]


def summed_columns(log: Log) -> list[_Summed]:
    """Return the rows of the table of a log's columns."""
    duration = float(log.t[-1] - log.t[0])
    return [(name, log[name][np.isfinite(log[name])], len(log), duration) for name in log.names]


def _limit(value: float | None) -> str:
    return "-" if value is None else f"{value + 0.0:.4g}"


#: of a sensor slower than the log, the changes per second are its own rate
COLUMNS: tuple[Column[_Summed], ...] = (
    Column("column", lambda row: row[0], key="name"),
    Column("unit", lambda row: unit_of(row[0]), lambda unit: unit or "?", key="unit"),
    Column("from", lambda row: float(row[1].min()) if row[1].size else None, _limit, key="least"),
    Column("to", lambda row: float(row[1].max()) if row[1].size else None, _limit, key="greatest"),
    Column(
        "changes per second",
        lambda row: int(np.count_nonzero(np.diff(row[1]))) / row[3] if row[3] > 0.0 else 0.0,
        _limit,
        key="change_rate",
    ),
    Column("missing", lambda row: row[2] - row[1].size, key="missing"),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckedLog:
    """A log with the findings of its checks."""

    file: Path
    log: Log
    findings: tuple[Finding, ...]
    wheels: WheelAgreement | None = None  #: compared with the robot's kinematics, if the robot is given
    uses: Sequence[str] = ()  #: that the log has the columns for, if the robot is given

    @staticmethod
    def of(file: Path, log: Log, robot: Robot | None) -> CheckedLog:
        """Check a log that was read from a file, against a robot if it is given.

        A log without x and y is checked as every command uses it: with those computed from the wheels. If rates are
        missing, lean and torques are checked with the derivatives of the angles.
        """
        if robot is None:
            return CheckedLog(file=file, log=log, findings=check(log))
        placed = _placed(log, robot)
        completed = _placed(with_rates(placed, robot), robot)
        computed = [name for name in completed.names if name not in log]
        findings = [finding for finding in check(completed, robot=robot) if finding.code != "use"]
        findings += check_uses(placed, wheel_count=robot.wheel_count)
        if computed:
            text = f"By angles and wheels: {', '.join(computed)}, which the file does not have."
            findings.append(note("use", text, *computed))
        missing = missing_columns(placed, wheel_count=robot.wheel_count)
        return CheckedLog(
            file=file,
            log=completed,
            findings=tuple(findings),
            wheels=wheel_agreement(completed, robot),
            uses=[use for use, columns in missing.items() if not columns],
        )


def _placed(log: Log, robot: Robot) -> Log:
    """Return the log with the ball's position from its wheels if it has none; unchanged if that is impossible."""
    try:
        return with_position(log, robot)
    except InputError:
        return log  # the findings name the missing columns


def _wheel_table(wheels: WheelAgreement) -> Sheet:
    agreement = zip(wheels.order, wheels.signs, wheels.gains, wheels.correlations, strict=True)
    rows = [
        (str(wheel), str(own), f"{sign:+d}", f"{gain:.4f}", f"{correlation:.4f}")
        for wheel, (own, sign, gain, correlation) in enumerate(agreement, start=1)
    ]
    headings = ("robot's wheel", "log's wheel", "sign", "gain", "correlation")
    return Sheet(headings, rows, "Wheels, compared with the robot's kinematics.")


def log_check_report(checked: CheckedLog, robot: Robot | None) -> Result:
    """Return the page of a checked log."""
    log, findings = checked.log, checked.findings
    rate = f" at {1.0 / log.sample_time:.4g} Hz" if len(log) > 1 else ""
    wheels = _wheel_table(checked.wheels) if checked.wheels else None
    return Result(
        title=f"{checked.file.name}: what the log shows",
        lead=f"{checked.file}: {len(log)} rows, {log.t[-1] - log.t[0]:.6g} s{rate}.",
        verdict=[("", _log_verdict(findings, checked.uses))],
        sections=[
            section("Columns", sheet_of(summed_columns(log), COLUMNS), wheels),
            section("Over time", *over_time(log, robot)),
        ],
        undecided=[
            "" if robot else "Whether wheels, signs and units are a robot's: name it with --robot.",
            *(finding.text for finding in findings if finding.code in ("use", "physics")),
            "Errors that a robot of other masses, gains or friction would make as well.",
        ],
        findings=findings,
        accepted=False,
        data={
            "file": checked.file,
            "rows": len(log),
            "start": log.t[0],
            "end": log.t[-1],
            "sample_time": log.sample_time if len(log) > 1 else None,
            "columns": [entries_of(row, COLUMNS) for row in summed_columns(log)],
            "findings": findings,
            "wheels": checked.wheels,
        },
    )


def _log_verdict(findings: Sequence[Finding], uses: Sequence[str]) -> str:
    errors = [finding for finding in findings if finding.severity == "error"]
    warnings = sum(finding.severity == "warning" for finding in findings)
    if errors:
        others = len(errors) - 1
        more = f" {counted(others, 'more error')} {'is' if others == 1 else 'are'} listed below."
        return f"This log must not be used as it is: {errors[0].text}{more if others else ''}"
    use = f" for {every(uses)}" if uses else ""
    if warnings:
        words = "warning" if warnings == 1 else f"{warnings} warnings"
        return f"The log can be used{use}; read the {words} below first."
    return f"A good log{use}." if use else "No problems were found."


def proposal_report(proposal: Proposal, *, kept: bool) -> Result:
    """Return the page of the mapping proposed for a foreign file; `kept`: it was written."""
    file, robot = proposal.base.path, proposal.robot
    verdict = (
        proposal.refusal or "Every entry of the mapping was determined, and its log agrees with the robot."
    )
    return Result(
        title=f"{file.name}: proposed mapping",
        lead=f"{file} is not in Ballbot's format. Its columns were compared with the equations of {robot.name}.",
        verdict=[("", capital(verdict))],
        sections=[
            section("What was found", Verbatim("\n".join(answer_lines(proposal)))),
            section("The mapping file", Verbatim(proposal.text)),
            section("The log that it makes", *(over_time(log, robot) if (log := proposal.log) else ())),
        ],
        undecided=[f"{capital(question.text)}." for question in proposal.questions],
        findings=proposal.findings,
        accepted=False,
        data={
            "files": [_proposal_data(proposal)],
            **({} if kept else {"mapping_file": proposal.text}),
        },
    )


def _proposal_data(proposal: Proposal) -> dict[str, object]:
    """Return the entries of results.json for the mapping proposed for a foreign file."""
    motion, tested, log = proposal.motion, proposal.tested, proposal.log
    return {
        "file": str(proposal.base.path),
        "what": proposal.what,
        "roles": proposal.roles,
        "time_unit": proposal.base.time,
        "wheel_unit": motion and motion.units[1],
        "lean_unit": proposal.lean,
        "gyro": motion and motion.gyro,
        "sequence": motion and motion.tilts.sequence,
        "placements": tested.placements if tested else [],
        "margin": tested and tested.margin,
        "confidence": tested and tested.confidence,
        "phase_deg": tested and math.degrees(tested.placements[0].phase),
        "lean_lag": tested and tested.lag,
        "disturbance": tested and tested.disturbance,
        "heading": tested and tested.heading,
        "frame": proposal.frame,
        "drive": proposal.drive,
        "keep": proposal.keep,
        "questions": proposal.questions,
        "refusal": proposal.refusal,
        "rows": None if log is None else len(log),
        "columns": log.names if log else [],
        "findings": proposal.findings,
    }
