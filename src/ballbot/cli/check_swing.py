"""The part of `ballbot check` that looks at a swing of the hanging body."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rich.console import RenderableType
from rich.text import Text

from ballbot.cli.output import table
from ballbot.identification.swing import (
    Pivot,
    SwingFit,
    SwingInertia,
    fit_swing,
    inertia_of_swing,
    swing_findings,
    swing_in_log,
    swing_results,
    swing_rows,
)
from ballbot.log import Log
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


@dataclass(frozen=True, kw_only=True)
class CheckedSwing:
    """A swing with all that `ballbot check` says about it."""

    robot: Robot
    pivot: Pivot
    fit: SwingFit
    found: SwingInertia

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        findings = swing_findings(self.fit, self.found, self.robot)
        return {"findings": findings} | swing_results(self.fit, self.found, self.pivot)

    def parts(self, *, framed: bool) -> list[RenderableType]:
        """Return what is printed."""
        headings = ("quantity", "value, 95 %", "unit")
        title = f"Swing, by {self.fit.swing.source}"
        sentences = swing_findings(self.fit, self.found, self.robot)
        rows = swing_rows(self.fit, self.found)
        return [Text(""), table(title, headings, rows, framed=framed), *(Text(one) for one in sentences)]


def examine_swing(robot: Robot, options: SwingOptions) -> CheckedSwing:
    """Return what the swing in a file says of a robot's inertia; InputError where the file has none."""
    pivot = Pivot.of(robot, distance=options.pivot_distance, deviation=options.pivot_deviation)
    if options.file.suffix.lower() in _LOGS:
        swing = swing_in_log(Log.read(options.file), column=options.column)
    else:
        from ballbot.vision.swing import swing_in_video  # only a video needs OpenCV

        swing = swing_in_video(options.file)
    fit = fit_swing(swing)
    return CheckedSwing(robot=robot, pivot=pivot, fit=fit, found=inertia_of_swing(fit, robot, pivot))
