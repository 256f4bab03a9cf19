"""`ballbot identify-axis`: mass and friction of any single axis."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Literal

from rich.console import Console

from ballbot.cli.context import long_run
from ballbot.cli.findings import Accept, accept_argv, stop_or_show
from ballbot.cli.output import progress_bar, standard_output, table
from ballbot.files import write_text
from ballbot.findings import Finding, by_severity, finding_results
from ballbot.fitting.checkpoint import identity_of
from ballbot.identification.axis import AxisIdentification, AxisRecord
from ballbot.identification.axis import identify_axis as identify_record
from ballbot.identification.axis.inverse import record_findings
from ballbot.identification.axis.record import AxisColumns, read_axis_record
from ballbot.printable import shell_line
from ballbot.report.axis import axis_report, error_rows, parameter_rows
from ballbot.report.page import as_json, provenance
from ballbot.result_folder import result_folder

_WRITTEN = ("report.html", "results.json")


def identify_axis(
    record: Path,
    /,
    *against: Path,
    out: Path,
    time: str = "t",
    position: str = "position",
    force: str = "force",
    force_scale: str = "1",
    added_force: str | None = None,
    reference: str | None = None,
    position_gain: str | None = None,
    velocity_gain: str | None = None,
    limit: str | None = None,
    unit: Literal["m", "rad"] = "m",
    law: str | None = None,
    bandwidth: float | None = None,
    window: float = 1.0,
    horizon: float | None = None,
    accept: Accept = None,
    resume: bool = False,
) -> None:
    """Find the mass (or inertia) and friction of one axis in a record of its force and position.

    Three methods: the inverse model by least squares, output error in closed loop if the loop is known, and output
    error in open loop. The friction law is selected by its prediction of held-out windows. Writes report.html and
    results.json. For a robot's own drivelines use `ballbot identify-driveline`.

    Example: ballbot identify-axis DATA_EMPS.mat --position qm --force vir --force-scale gtau --out found

    Parameters
    ----------
    record
        A MATLAB file (.mat, its variables by name), CSV or Parquet.
    against
        Other records of the same axis, with the same columns, used only for validation.
    out
        The folder to write into.
    time
        The variable with the time, in seconds.
    position
        The variable with the position, in metres or radians.
    force
        The variable with the force, torque, current or voltage that drives the axis.
    force_scale
        Factor from that variable to newtons or newton metres: a number, or a variable of the file.
    added_force
        The variable with a further force on the axis, in newtons (newton metres).
    reference
        The variable with the reference of the position; with both gains (--reference qg --position-gain kp
        --velocity-gain kv in the example), the closed loop is simulated as well.
    position_gain
        Position gain of the loop, in 1/s: a number, or a variable of the file.
    velocity_gain
        Velocity gain of the loop, from velocity to the force variable: a number, or a variable of the file.
    limit
        Limit of the force variable: a number, or a variable of the file.
    unit
        Unit of positions: m for a sliding mass, rad for a rotating inertia.
    law
        The friction law: viscous, coulomb, stribeck, dahl, lugre or asymmetric. Selected automatically if not given.
    bandwidth
        Bandwidth of the motion, in hertz, which sets the filters. Estimated if not given.
    window
        Length of the windows on which laws are compared, in seconds.
    horizon
        Length of the windows that the open-loop fit predicts, in seconds; the whole record if not given.
    resume
        Continue an interrupted run in the same folder.
    """
    columns = AxisColumns(
        time=time,
        position=position,
        force=force,
        force_scale=force_scale,
        added_force=added_force,
        reference=reference,
        position_gain=position_gain,
        velocity_gain=velocity_gain,
        limit=limit,
        unit=unit,
    )
    read = read_axis_record(record, columns)
    others = [read_axis_record(path, columns) for path in against]
    findings = _checked(dict(zip((record, *against), (read, *others), strict=True)), bandwidth, accept)
    options: dict[str, object] = {f"--{key.replace('_', '-')}": value for key, value in vars(columns).items()}
    options |= {"--law": law, "--bandwidth": bandwidth, "--window": window, "--horizon": horizon}
    words = ["ballbot", "identify-axis", str(record), *map(str, against), "--out", str(out)]
    words += [str(word) for option, value in options.items() if value is not None for word in (option, value)]
    words += accept_argv(accept)
    made = provenance(command=shell_line(words), files=[record, *against], seed=0)

    console = standard_output()
    parts = [getattr(one, field.name) for one in (read, *others) for field in fields(one)]
    belongs_to = identity_of({"records": parts}, options)
    inputs = [record, *against]
    with (
        result_folder(out, command="identify-axis", names=_WRITTEN, inputs=inputs, resumes=True) as folder,
        long_run(folder.path, words=words, belongs_to=belongs_to, resume=resume) as run,
    ):
        with progress_bar(console, "inverse model") as bar:
            found = identify_record(
                read,
                law=law,
                bandwidth=bandwidth,
                window=window,
                horizon=horizon,
                held_against=others,
                run=replace(run, progress=bar.report),
            )
        with folder.replaced() as new:
            more = {"findings": finding_results(findings), "provenance": made.to_dict()}
            write_text(new / "results.json", as_json(found.to_dict() | more))
            write_text(new / "report.html", axis_report(found, read, made, findings))
    _show(found, console)
    console.print(str(folder.path / "report.html"), soft_wrap=True)


def _checked(
    records: dict[Path, AxisRecord], bandwidth: float | None, accept: list[str] | None
) -> tuple[Finding, ...]:
    """Return what is wrong with the records; stop on an error that is not accepted."""
    findings = by_severity(
        replace(one, where=replace(one.where, file=str(path)))
        for path, record in records.items()
        for one in record_findings(record, bandwidth=bandwidth)
    )
    stop_or_show(findings, accept=accept)
    return findings


def _show(found: AxisIdentification, console: Console) -> None:
    framed = console.is_terminal
    headings = ("symbol", "meaning", "unit", *(one.method for one in found.estimates))
    console.print(table(f"law {found.chosen.name}", headings, parameter_rows(found), framed=framed))
    headings = ("method", "law", "record", "open loop, RMS", "closed loop, force", "position")
    rows = [row for one in found.estimates for row in error_rows(one, found.unit)]
    console.print(table("errors", headings, rows, framed=framed))
    for sentence in found.remarks:
        console.print(sentence, markup=False, soft_wrap=True)
