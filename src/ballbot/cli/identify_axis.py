"""`ballbot identify-axis`: mass and friction of any single axis."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.console import Console

from ballbot.cli.context import RunOptions, input_files, open_long_result
from ballbot.cli.findings import Accept, stop_or_show
from ballbot.cli.output import table
from ballbot.files import write_text
from ballbot.findings import Finding, by_severity
from ballbot.fitting.checkpoint import identity_of
from ballbot.identification.axis import AxisIdentification, AxisRecord
from ballbot.identification.axis import identify_axis as identify_record
from ballbot.identification.axis.inverse import record_findings
from ballbot.identification.axis.record import AxisColumns, read_axis_record
from ballbot.report.axis import axis_report, error_rows, parameter_rows

_WRITTEN = ("report.html", "results.json")


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ColumnOptions:
    """The variables of the record."""

    time: str = "t"
    """The variable with the time, in seconds."""

    position: str = "position"
    """The variable with the position, in metres or radians."""

    force: str = "force"
    """The variable with the force, torque, current or voltage that drives the axis."""

    force_scale: str = "1"
    """Factor from that variable to newtons or newton metres: a number, or a variable of the file."""

    added_force: str | None = None
    """The variable with a further force on the axis, in newtons (newton metres)."""

    reference: str | None = None
    """The variable with the reference of the position; with both gains (--reference qg --position-gain kp --velocity-
    gain kv in the example), the closed loop is simulated as well."""

    position_gain: str | None = None
    """Position gain of the loop, in 1/s: a number, or a variable of the file."""

    velocity_gain: str | None = None
    """Velocity gain of the loop, from velocity to the force variable: a number, or a variable of the file."""

    limit: str | None = None
    """Limit of the force variable: a number, or a variable of the file."""

    unit: Literal["m", "rad"] = "m"
    """Unit of positions: m for a sliding mass, rad for a rotating inertia."""


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


_COLUMNS, _METHOD = ColumnOptions(), MethodOptions()


def identify_axis(
    record: Path,
    /,
    *against: Path,
    out: Path,
    variables: ColumnOptions = _COLUMNS,
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
        A MATLAB file (.mat, its variables by name), CSV or Parquet.
    against
        Other records of the same axis, with the same columns, used only for validation.
    out
        The folder to write into.
    resume
        Continue an interrupted run in the same folder.
    """
    columns = AxisColumns(**vars(variables))
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
    _show(found, result.console)
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


def _show(found: AxisIdentification, console: Console) -> None:
    framed = console.is_terminal
    headings = ("symbol", "meaning", "unit", *(one.method for one in found.estimates))
    console.print(table(f"law {found.chosen.name}", headings, parameter_rows(found), framed=framed))
    headings = ("method", "law", "record", "open loop, RMS", "closed loop, force", "position")
    rows = [row for one in found.estimates for row in error_rows(one, found.unit)]
    console.print(table("errors", headings, rows, framed=framed))
    for remark in found.remarks:
        console.print(remark.text, markup=False, soft_wrap=True)
