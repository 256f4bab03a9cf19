"""`ballbot identify-axis`: mass and friction of any single axis."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ballbot.cli import options
from ballbot.cli.context import open_result
from ballbot.cli.findings import in_file, stop_or_show
from ballbot.findings import check_codes
from ballbot.fitting.run import Run
from ballbot.identification.axis import AxisOptions
from ballbot.identification.axis import identify_axis as identify_record
from ballbot.identification.axis.checks import ERROR_CODES, record_findings
from ballbot.identification.axis.reading import AxisColumns, read_axis_record
from ballbot.report.axis import axis_report

_COLUMNS, _METHOD = AxisColumns(), AxisOptions()


def identify_axis(
    record: Path,
    /,
    *against: Path,
    out: options.Out,
    also: Annotated[list[Path] | None, Parameter(negative="")] = None,
    columns: Annotated[AxisColumns, Parameter(name="*")] = _COLUMNS,
    method: Annotated[AxisOptions, Parameter(name="*")] = _METHOD,
    accept: options.Accept = None,
) -> None:
    """Find the mass (or inertia) and friction of one axis in records of its force and position.

    The inverse model by least squares begins, output error over windows refines it. Forces over position, friction
    under load and the friction law are selected by the prediction of held-out blocks of time. Writes report.html and
    results.json.
    For a robot's own drivelines use `ballbot identify-driveline`.

    Example: ballbot identify-axis axis.csv --out found

    Parameters
    ----------
    record
        A log file (docs/logs.md), its columns or variables by name.
    against
        Other records of the same axis, with the same columns, used only for validation.
    also
        A further record that is fitted together with the first one; may be given several times.
    """
    check_codes(accept or (), listed=ERROR_CODES)
    fitted = (record, *(also or ()))
    paths = (*fitted, *against)
    read = [read_axis_record(path, columns) for path in paths]
    findings = stop_or_show(
        [
            finding
            for path, one in zip(paths, read, strict=True)
            for finding in in_file(path, record_findings(one))
        ],
        accept=accept,
    )
    with open_result(out, doing="identifying the axis", inputs=[paths]) as result:
        found = identify_record(
            read[: len(fitted)],
            options=method,
            validation_records=read[len(fitted) :],
            run=Run(progress=result.report),
        )
        page = axis_report(found, read[0], findings)
        step = (
            "name another record of the axis after this one, to validate what was found"
            if not against
            else ""
        )
        result.write(page, next_step=step)
