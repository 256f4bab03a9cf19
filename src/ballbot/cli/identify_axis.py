"""`ballbot identify-axis`: mass and friction of any single axis."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ballbot.cli.context import OutFolder, open_result
from ballbot.cli.findings import Accept, in_file, stop_or_show
from ballbot.findings import check_codes
from ballbot.fitting.run import Run
from ballbot.identification.axis import AxisOptions
from ballbot.identification.axis import identify_axis as identify_record
from ballbot.identification.axis.checks import ERROR_CODES, record_findings
from ballbot.identification.axis.reading import AxisColumns, read_axis_record
from ballbot.report.axis import axis_report


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class MethodOptions:
    """How the axis is identified; what is not given is selected by held-out errors."""

    law: str | None = None
    """The friction law: viscous, coulomb, stribeck or asymmetric."""

    bandwidth: float | None = None
    """Bandwidth of the motion, in hertz, which sets the filters."""

    gravity: bool | None = None
    """Whether gravity acts on an axis that turns: S sin q + C cos q."""

    load_friction: bool | None = None
    """Whether dry friction grows with the load that the gears transmit, |F + G| / 2."""


_COLUMNS, _METHOD = AxisColumns(), MethodOptions()


def identify_axis(
    record: Path,
    /,
    *against: Path,
    out: OutFolder,
    also: Annotated[list[Path] | None, Parameter(negative="")] = None,
    columns: Annotated[AxisColumns, Parameter(name="*")] = _COLUMNS,
    method: MethodOptions = _METHOD,
    accept: Accept = None,
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
    options = AxisOptions(**vars(method))  # wrong ones are refused before anything is read
    check_codes(accept or (), listed=ERROR_CODES)
    fitted = (record, *(also or ()))
    paths = (*fitted, *against)
    read = [read_axis_record(path, columns) for path in paths]
    findings = stop_or_show(
        [
            finding
            for path, one in zip(paths, read, strict=True)
            for finding in in_file(path, record_findings(one, bandwidth=method.bandwidth))
        ],
        accept=accept,
    )
    with open_result(out, command="identify-axis", doing="identifying the axis", inputs=[paths]) as result:
        found = identify_record(
            read[: len(fitted)],
            options=options,
            validation_records=read[len(fitted) :],
            run=Run(progress=result.report),
        )
        page = axis_report(found, read[0], findings)
        result.write(found.to_dict(), page, findings=[*findings, *found.findings])
