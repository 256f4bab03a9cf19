"""The firmware's control law in single precision against the float64 law of Python (`tests.support.law_comparison`).

.venv/bin/python -m campaigns.evidence firmware_numbers          a million states
"""

import math

from campaigns.section import Section
from tests.support.law_comparison import LANES, TOLERANCE, compare, controllers


def campaign(states: int = 1_000_000) -> Section:
    """Return the differences of each controller's torques over so many states together."""
    chosen = controllers()
    count = math.ceil(states / (len(chosen) * LANES))
    table = {
        name: compare(design(), lanes=LANES, count=count, seed=number)
        for number, (name, design) in enumerate(chosen.items())
    }
    total = sum(row.states for row in table.values())
    beyond = sum(row.beyond for row in table.values())
    return Section(
        title="The firmware's control law in single precision",
        before=f"Torques of the C law against those of Python's float64 law, single updates from {total:,} equal "
        "states, over the torque limit: positions and headings up to 10 m and 10 rad from the origin, leans up to "
        "0.3 rad, rates up to 2 rad/s, references that move and jump. Where the law switches, a torque may be that of "
        f"the other branch: then it differs by more than {TOLERANCE:g}.",
        columns=["controller", "states", "largest difference", "of the other branch"],
        rows=[[name, f"{row.states:,}", f"{row.worst:.1e}", str(row.beyond)] for name, row in table.items()],
        after=f"Of the other branch may be at most 0.1 % of the states; here {100.0 * beyond / total:.4f} %.",
    )
