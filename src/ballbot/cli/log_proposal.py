"""What `ballbot check-log` shows and writes of a foreign file: the mapping it proposes, and why."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path

from rich.table import Table
from rich.text import Text

from ballbot.cli.output import standard_output, table
from ballbot.files import write_text
from ballbot.log import Finding, Log
from ballbot.log.mapping_file import parse_mapping
from ballbot.log.odometry import with_odometry
from ballbot.log.proposal.findings import findings_of
from ballbot.log.proposal.mapping_text import mapping_text
from ballbot.log.proposal.proposal import Proposal, propose
from ballbot.printable import shell_line
from ballbot.report.json_text import as_json
from ballbot.result_folder import ResultFolder
from ballbot.robot import Robot


def propose_mapping(
    file: Path, robot: Robot, *, source: str, folder: ResultFolder | None
) -> tuple[Finding, ...]:
    """Show the mapping proposed for a foreign file; with a folder, write it, the log it makes and results.json."""
    console = standard_output()
    with console.status("reading the encoder times"):
        proposal = propose(file, robot)
    findings, text = findings_of(proposal), mapping_text(proposal, robot, file=file)
    console.print(Text(f"{file}: not in Ballbot's format; this mapping is proposed"), soft_wrap=True)
    console.print(_role_table(proposal, framed=console.is_terminal))
    if proposal.lean_test:
        console.print(_placement_table(proposal, framed=console.is_terminal))
    for finding in findings:
        console.print(Text(f"{finding.severity}: {finding.text}"), soft_wrap=True)
    if folder is None:
        console.print(Text("\n" + text), soft_wrap=True)
        return findings
    out = folder.path
    log = Log.read(file, mapping=parse_mapping(text, source=str(out / "mapping.toml")))
    complete = with_odometry(log, robot) if proposal.roles.attitude else log
    with folder.replaced() as new:
        write_text(new / "mapping.toml", text)
        complete.write(new / "log.csv")
        write_text(new / "results.json", as_json(_results(file, proposal, complete, findings)))
    for name in ("mapping.toml", "log.csv"):
        console.print(str(out / name), markup=False, soft_wrap=True)
    if proposal.commands:
        command = "identify" if proposal.roles.attitude else "identify-driveline"
        words = [
            "ballbot",
            command,
            source,
            str(file),
            "--mapping",
            str(out / "mapping.toml"),
            "--out",
            "found",
        ]
        console.print(f"Next: {shell_line(words)}", markup=False, soft_wrap=True)
    return findings


def _role_table(proposal: Proposal, *, framed: bool) -> Table:
    roles, lean, wheel, duty = proposal.roles, proposal.lean, proposal.wheel, proposal.duty
    rows = [
        ("time", roles.time or "-", "s", ""),
        (
            "roll, pitch, yaw",
            ", ".join(roles.attitude) or "-",
            lean.unit if lean else "-",
            lean.reason if lean else "",
        ),
        ("wheel angles", ", ".join(roles.angles), wheel.unit, wheel.reason),
        (
            "commands",
            ", ".join(roles.commands) or "-",
            duty.unit if duty else "-",
            duty.reason if duty else "",
        ),
    ]
    return table("Columns", ("what", "of the file", "unit", "because"), rows, framed=framed)


def _placement_table(proposal: Proposal, *, framed: bool) -> Table:
    placements = proposal.lean_test.placements if proposal.lean_test else ()
    least = min((one.misfit for one in placements), default=1.0)
    rows = [
        (
            one.words,
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


def _results(file: Path, proposal: Proposal, log: Log, findings: tuple[Finding, ...]) -> dict[str, object]:
    tested, heading, commands = proposal.lean_test, proposal.heading, proposal.commands
    return {
        "file": str(file),
        "roles": asdict(proposal.roles),
        "wheel_unit": asdict(proposal.wheel),
        "lean_unit": asdict(proposal.lean) if proposal.lean else None,
        "duty": asdict(proposal.duty) if proposal.duty else None,
        "speed_noise": {"before": proposal.timing.before, "after": proposal.timing.after},
        "handedness": None if tested is None else "mirrored" if tested.placements[0].mirrored else "direct",
        "phase_deg": None if tested is None else math.degrees(tested.placements[0].phase),
        "phase_error_deg": None
        if tested is None or tested.phase_error is None
        else math.degrees(tested.phase_error),
        "placements": [] if tested is None else [asdict(one) for one in tested.placements],
        "margin": None if tested is None else tested.margin,
        "sensor_delay": None if tested is None else tested.lag,
        "command_delay": None if commands is None else commands.delay,
        "disturbance": None if tested is None else tested.disturbance,
        "heading": None if heading is None else asdict(heading),
        "commands": None if commands is None else asdict(commands),
        "frame": asdict(proposal.frame),
        "keep": proposal.keep,
        "rows": len(log),
        "columns": list(log.names),
        "findings": [asdict(finding) for finding in findings],
    }
