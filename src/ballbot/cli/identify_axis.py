"""`ballbot identify-axis`: mass and friction of any single axis."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ballbot.cli.context import RunOptions, input_files, open_long_result
from ballbot.cli.findings import Accept, stop_or_show
from ballbot.files import write_text
from ballbot.findings import Finding, by_severity
from ballbot.fitting.checkpoint import identity_of
from ballbot.identification.axis import AxisRecord
from ballbot.identification.axis import identify_axis as identify_record
from ballbot.identification.axis.inverse import record_findings
from ballbot.identification.axis.record import AxisColumns, read_axis_record
from ballbot.report.axis import axis_parts, axis_report

_WRITTEN = ("report.html", "results.json")


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class MethodOptions:
    """How the axis is identified."""

    law: str | None = None
    """The friction law: viscous, coulomb, stribeck, dahl, lugre or asymmetric. Selected automatically if not given."""

    bandwidth: float | None = None
    """Bandwidth of the motion, in hertz, which sets the filters. Estimated if not given."""

    window: float = 1.0
    """Length of the windows on which laws are compared, in seconds."""

    horizon: float | None = None
    """Length of the windows that the open-loop fit predicts, in seconds; the whole record if not given."""


_COLUMNS, _METHOD = AxisColumns(), MethodOptions()


def identify_axis(
    record: Path,
    /,
    *against: Path,
    out: Path,
    columns: Annotated[AxisColumns, Parameter(name="*")] = _COLUMNS,
    method: MethodOptions = _METHOD,
    accept: Accept = None,
    resume: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Find the mass (or inertia) and friction of one axis in a record of its force and position.

    Three methods: the inverse model by least squares, output error in closed loop if the loop is known, and output
    error in open loop. The friction law is selected by its prediction of held-out windows. Writes report.html and
    results.json. For a robot's own drivelines use `ballbot identify-driveline`.

    Example: ballbot identify-axis DATA_EMPS.mat --position qm --force vir --force-scale gtau --out found

    Parameters
    ----------
    record
        A log file (docs/logs.md), its columns or variables by name.
    against
        Other records of the same axis, with the same columns, used only for validation.
    out
        The folder to write into.
    resume
        Continue an interrupted run in the same folder.
    """
    read = read_axis_record(record, columns)
    others = [read_axis_record(path, columns) for path in against]
    findings = _checked(dict(zip((record, *against), (read, *others), strict=True)), method.bandwidth, accept)
    parts = [getattr(one, field.name) for one in (read, *others) for field in fields(one)]
    depends_on = {f"--{name.replace('_', '-')}": value for name, value in vars(columns).items()}
    depends_on |= {f"--{name}": value for name, value in vars(method).items()}
    with open_long_result(
        out,
        command="identify-axis",
        writes=_WRITTEN,
        inputs=input_files(record, against),
        belongs_to=identity_of({"records": parts}, depends_on),
        run=RunOptions(resume=resume),
    ) as result:
        with result.progress("inverse model") as bar:
            found = identify_record(
                read,
                law=method.law,
                bandwidth=method.bandwidth,
                window=method.window,
                horizon=method.horizon,
                validation_records=others,
                run=result.run_with(bar.report),
            )
        with result.replaced() as new:
            result.write_json(found.to_dict(), new, findings=findings)
            write_text(new / "report.html", axis_report(found, read, result.origin, findings))
    result.show(axis_parts(found, framed=result.console.is_terminal))
    result.show_file("report.html")


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
