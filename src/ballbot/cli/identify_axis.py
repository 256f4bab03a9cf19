"""`ballbot identify-axis`: mass and friction of any single axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ballbot.cli.context import PAGE, RunOptions, WholeNumber, input_files, open_long_result
from ballbot.cli.findings import Accept, stop_or_show
from ballbot.findings import Finding, by_severity, check_codes
from ballbot.fitting.checkpoint import identity_of
from ballbot.identification.axis import AxisOptions, AxisRecord
from ballbot.identification.axis import identify_axis as identify_record
from ballbot.identification.axis.checks import ERROR_CODES, record_findings
from ballbot.identification.axis.file_columns import AxisColumns
from ballbot.identification.axis.laws import PARAMETERS
from ballbot.identification.axis.reading import read_axis_records
from ballbot.progress import TimedStage, by_stage_times
from ballbot.report.axis import axis_parts, axis_report

_WRITTEN = (PAGE, "results.json")
#: usual times of stages of records with `_USUAL_ROWS` rows [s], and the stage that each of them follows
_STAGES = {
    "inverse model": (2.0, ""),
    "horizon": (1.0, ""),
    "forces": (0.5, ""),
    "open loop, law viscous": (0.3, "horizon"),
    "open loop, law coulomb": (0.3, "horizon"),
    "open loop, law stribeck": (1.6, "horizon"),
    "open loop, law dahl": (0.8, "horizon"),
    "open loop, law lugre": (1.7, "horizon"),
    "open loop, law asymmetric": (0.6, "horizon"),
    "law viscous": (0.3, "open loop, law viscous"),
    "law coulomb": (0.3, "open loop, law coulomb"),
    "law stribeck": (0.6, "open loop, law stribeck"),
    "law dahl": (0.45, "open loop, law dahl"),
    "law lugre": (0.6, "open loop, law lugre"),
    "law asymmetric": (0.35, "open loop, law asymmetric"),
    "closed loop": (0.4, "horizon"),
    "whole records": (1.2, "horizon"),
}
_USUAL_ROWS, _POWER = 5000, 0.6
_WRITING = 1.5  #: of the page [s]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class MethodOptions:
    """How the axis is identified; what is not given is selected by held-out errors."""

    law: str | None = None
    """The friction law: viscous, coulomb, stribeck, dahl, lugre or asymmetric."""

    bandwidth: float | None = None
    """Bandwidth of the motion, in hertz, which sets the filters."""

    harmonics: Annotated[tuple[WholeNumber, ...] | None, Parameter(negative="--no-harmonics")] = None
    """Harmonics of a force that depends on position: 1 is gravity on an axis that turns, higher ones are cogging.
    --no-harmonics searches none."""

    spring: bool | None = None
    """Whether a force is proportional to position, as of a spring or a cable."""

    load_friction: str | None = None
    """The load that dry friction depends on: position (the force over position), drive (the drive's force),
    transmitted (their mean), recorded (the column --load) or none."""

    drift: bool | None = None
    """Whether the constant force drifts slowly."""

    period: float | None = None
    """Travel of the first harmonic, in metres or radians; one turn if not given."""

    separate: tuple[str, ...] = ()
    """Parameters of which each record has its own, such as offset, by name or symbol; the others are common to all."""

    def options(self) -> AxisOptions:
        """Return what the identification takes."""
        names = {one.symbol: name for name, one in PARAMETERS.items()}
        named = replace(self, separate=tuple(names.get(one, one) for one in self.separate))
        return AxisOptions(**vars(named))


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
    resume: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Find the mass (or inertia) and friction of one axis in records of its force and position.

    Four methods: the inverse model by least squares, output error in open loop over windows and over whole records,
    and output error in closed loop if the loop is known. Forces over position, a drift, the length of the windows and
    the friction law are selected by the prediction of held-out blocks of time. Writes report.html and results.json.
    For a robot's own drivelines use `ballbot identify-driveline`.

    Example: ballbot identify-axis axis.csv --reference reference --position-gain 160 --velocity-gain 8505 --out found

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
    resume
        Continue an interrupted run in the same folder.
    """
    options = method.options()  # wrong ones are refused before anything is read
    check_codes(accept or (), listed=ERROR_CODES)
    fitted = (record, *(also or ()))
    paths = (*fitted, *against)
    read = read_axis_records(paths, columns)
    findings = _checked(dict(zip(paths, read, strict=True)), method.bandwidth, accept)
    parts = [getattr(one, field.name) for one in read for field in fields(one)]
    depends_on = {f"--{name.replace('_', '-')}": value for name, value in vars(columns).items()}
    depends_on |= {f"--{name.replace('_', '-')}": value for name, value in vars(method).items()}
    depends_on["--also"] = len(fitted)
    with (
        open_long_result(
            out,
            command="identify-axis",
            writes=_WRITTEN,
            inputs=input_files(record, (*fitted[1:], *against)),
            belongs_to=identity_of({"records": parts}, depends_on),
            run=RunOptions(resume=resume),
        ) as result,
        result.progress("inverse model", writing=_WRITING) as bar,
    ):
        found = identify_record(
            read[: len(fitted)],
            options=options,
            validation_records=read[len(fitted) :],
            run=result.run_with(by_stage_times(bar.report, stage_times(read[: len(fitted)]))),
        )
        bar.begin_writing()
        with result.replaced() as new:
            result.write_json(found.to_dict(), new, findings=[*findings, *found.findings])
            result.write_page(axis_report(found, read[0], result.origin, findings), new)
    result.show(axis_parts(found, framed=result.console.is_terminal))
    result.show_file(PAGE)


def stage_times(records: Sequence[AxisRecord]) -> dict[str, TimedStage]:
    """Return the stages of the identification of records, with the times that they usually take."""
    rows = sum(len(one) for one in records)
    looped = all(one.loop is not None for one in records)
    return {
        name: TimedStage(
            seconds=seconds * (rows / _USUAL_ROWS) ** _POWER, follows=follows, typical=name != "inverse model"
        )
        for name, (seconds, follows) in _STAGES.items()
        if looped or name != "closed loop"
    }


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
