"""What `ballbot check --reference` says: a motion's demands against the robot's limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

from ballbot.cli.output import table

if TYPE_CHECKING:
    from ballbot.control.margins import Margins  # compiled: only who asks for margins loads it


def margins_parts(margins: Margins, *, framed: bool) -> list[Table | Text]:
    """Return a table of the demands, and a sentence for each that is out of reach."""
    demands = (margins.lean, margins.torque, margins.speed)
    rows = [
        [
            one.what,
            *(f"{number:.3g} {one.unit}" for number in (one.most, one.limit)),
            f"{100 * one.share:.0f} %",
            f"{one.at:.2f}",
        ]
        for one in demands
    ]
    rows.append(["power of all wheels", f"{margins.power:.3g} W", "", "", ""])
    told = margins.refusals or ("The robot can follow this reference.",)
    headings = ("of", "asked", "there is", "share", "at (s)")
    return [
        table("What the motion asks for", headings, rows, framed=framed),
        *(Text(sentence) for sentence in told),
    ]


def margins_results(margins: Margins) -> dict[str, object]:
    """Return what results.json holds."""
    demands = {"lean": margins.lean, "torque": margins.torque, "speed": margins.speed}
    return {
        **{name: {"most": one.most, "limit": one.limit, "at": one.at} for name, one in demands.items()},
        "power": margins.power,
        "refusals": list(margins.refusals),
    }
