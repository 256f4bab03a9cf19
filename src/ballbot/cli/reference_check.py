"""What `ballbot check --reference` adds: whether the robot can follow a reference."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rich.console import RenderableType
from rich.text import Text

from ballbot.cli.output import table
from ballbot.control.file import read_controller
from ballbot.control.presets import nominal_controller
from ballbot.control.references import is_reference_file, reference_from
from ballbot.experiments.limits.reference_margins import ReferenceMargins, check_reference
from ballbot.experiments.limits.reference_words import HEADINGS, margin_results, rows, verdict
from ballbot.log import Log
from ballbot.robot import Robot

#: how long a reference that has a name is looked at [s]: the longest of them goes once around
_DURATION = 40.0
#: and one in a file beyond its last row
_BEYOND = 3.0


@dataclass(frozen=True, kw_only=True)
class CheckedReference:
    """A reference with what it takes of a robot."""

    name: str
    margins: ReferenceMargins

    def parts(self, *, framed: bool) -> list[RenderableType]:
        """Return the parts of what is printed."""
        words = [Text(line) for line in verdict(self.margins, self.name)]
        found = table("Largest use of each limit", HEADINGS, rows(self.margins), framed=framed)
        return [Text(f"\nFollowing {self.name}", style="bold"), *words, found]

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {"name": self.name, **margin_results(self.margins)}


def checked_reference(robot: Robot, source: str, controller: Path | None) -> CheckedReference:
    """Return what following the reference of that name or file takes, by a controller file or the nominal one."""
    reference = reference_from(source)
    duration = float(Log.read(source).t[-1]) + _BEYOND if is_reference_file(source) else _DURATION
    chosen = read_controller(controller, robot) if controller else nominal_controller(robot)
    return CheckedReference(name=source, margins=check_reference(robot, chosen, reference, duration=duration))
