"""The part of `ballbot check` that looks at a swing of the hanging body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import RenderableType
from rich.text import Text

from ballbot.cli.findings import finding_line
from ballbot.cli.output import table
from ballbot.findings import Finding, by_severity, check_codes, finding_results, nowhere, stop_on_errors
from ballbot.identification.inertia import (
    Pivot,
    SwingInertia,
    inertia_of_swing,
    recording_findings,
    swing_findings,
    swing_results,
    swing_rows,
    swing_sentences,
)
from ballbot.identification.swing import SwingFit, fit_swing, swing_in_log
from ballbot.log import Log
from ballbot.log.time_checks import check_gaps, check_jitter
from ballbot.robot import Robot

#: file names of logs; every other is a video's
_LOGS = (".csv", ".parquet")


@dataclass(frozen=True, kw_only=True)
class SwingOptions:
    """What the command line says of a swing."""

    file: Path
    column: str | None
    pivot_distance: float | None
    pivot_deviation: float | None
    accept: tuple[str, ...] = ()  #: codes of errors to go on in spite of


@dataclass(frozen=True, kw_only=True)
class CheckedSwing:
    """A swing with all that `ballbot check` says about it."""

    robot: Robot
    pivot: Pivot
    fit: SwingFit
    found: SwingInertia
    findings: tuple[Finding, ...]

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        said: dict[str, object] = {
            "findings": finding_results(self.findings),
            "remarks": swing_sentences(self.fit, self.found, self.robot),
        }
        return said | swing_results(self.fit, self.found, self.pivot)

    def parts(self, *, framed: bool) -> list[RenderableType]:
        """Return what is printed."""
        headings = ("quantity", "value, 95 %", "unit")
        title = f"Swing from {self.fit.swing.source}"
        rows = swing_rows(self.fit, self.found)
        return [
            Text(""),
            table(title, headings, rows, framed=framed),
            *(finding_line(one, accepted=one.severity == "error") for one in self.findings),
            *(Text(one) for one in swing_sentences(self.fit, self.found, self.robot)),
        ]


def examine_swing(robot: Robot, options: SwingOptions) -> CheckedSwing:
    """Return what the swing in a file says of a robot's inertia.

    Raises
    ------
    InputError
        If the file has no free swing, or the swing has an error that is not accepted.
    """
    pivot = Pivot.of(robot, distance=options.pivot_distance, deviation=options.pivot_deviation)
    of_log: list[Finding] = []
    if options.file.suffix.lower() in _LOGS:
        log = Log.read(options.file)
        of_log = [*check_gaps(log), *check_jitter(log)]
        swing = swing_in_log(log, column=options.column)
    else:
        from ballbot.vision.swing import swing_in_video  # only a video needs OpenCV

        swing = swing_in_video(options.file)
    of_recording = recording_findings(swing)
    _stop(of_recording, options)
    fit = fit_swing(swing)
    found = inertia_of_swing(fit, robot, pivot)
    findings = by_severity([*of_log, *of_recording, *swing_findings(fit, found, robot, pivot)])
    _stop(findings, options)
    return CheckedSwing(robot=robot, pivot=pivot, fit=fit, found=found, findings=findings)


def _stop(findings: Sequence[Finding], options: SwingOptions) -> None:
    named = [replace(one, where=replace(one.where, file=str(options.file))) for one in findings]
    stop_on_errors(named, accept=check_codes(options.accept), more=nowhere)
