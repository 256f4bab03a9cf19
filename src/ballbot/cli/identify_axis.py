"""`ballbot identify-axis`: mass and friction of any single axis."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ballbot.cli.context import PAGE, input_files, open_result
from ballbot.cli.findings import Accept, stop_or_show
from ballbot.findings import by_severity, check_codes
from ballbot.fitting.run import Run
from ballbot.identification.axis import AxisOptions
from ballbot.identification.axis import identify_axis as identify_record
from ballbot.identification.axis.checks import ERROR_CODES, record_findings
from ballbot.identification.axis.reading import AxisColumns, read_axis_record
from ballbot.report.axis import axis_parts, axis_report

_WRITTEN = (PAGE, "results.json")


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
    out: Path,
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
    out
        The folder to write into.
    also
        A further record that is fitted together with the first one; may be given several times.
    """
    options = AxisOptions(**vars(method))  # wrong ones are refused before anything is read
    check_codes(accept or (), listed=ERROR_CODES)
    fitted = (record, *(also or ()))
    paths = (*fitted, *against)
    read = [read_axis_record(path, columns) for path in paths]
    findings = by_severity(
        replace(one, where=replace(one.where, file=str(path)))
        for path, each in zip(paths, read, strict=True)
        for one in record_findings(each, bandwidth=method.bandwidth)
    )
    stop_or_show(findings, accept=accept)
    inputs = input_files(record, (*fitted[1:], *against))
    with (
        open_result(out, command="identify-axis", writes=_WRITTEN, inputs=inputs) as result,
        result.progress("forces") as bar,
    ):
        found = identify_record(
            read[: len(fitted)],
            options=options,
            validation_records=read[len(fitted) :],
            run=Run(progress=bar.report),
        )
        bar.begin_writing()
        with result.replaced() as new:
            result.write_json(found.to_dict(), new, findings=[*findings, *found.findings])
            result.write_page(axis_report(found, read[0], result.origin, findings), new)
    result.show(axis_parts(found))
    result.show_file(PAGE)
