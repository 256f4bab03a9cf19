"""Test the thesis's recommendations on the twin.

.venv/bin/python -m campaigns.evidence twin_recommendations
"""

from __future__ import annotations

import os

from ballbot import Robot
from ballbot.workflows.twin_recommendations import HEADINGS, rows, try_recommendations
from campaigns.section import Section

SEEDS = range(1, 6)
DURATION = 64.0  # [s]


def campaign() -> Section:
    """Return position error and torque noise before and after."""
    found = try_recommendations(
        Robot.load("alten"), seeds=list(SEEDS), duration=DURATION, threads=os.cpu_count() or 1
    )
    return Section(
        title="The thesis's recommendations, tested",
        before=f"Two rounds of a 0.5 m square, {DURATION:g} s, {len(SEEDS)} seeds, the nominal gain, without "
        "compensation and with partial compensation of the true friction. True position from the reference once "
        "settled, means over the seeds; torque noise is the torque's RMS change from sample to sample. Chapter 6 "
        "recommends the single row, the stiffer ball and less play, Appendix IV the fused fix.",
        columns=list(HEADINGS),
        rows=rows(found),
        after="A fix corrects drift, which is small in a minute. The filter that fuses it has larger errors here "
        "because it models a slow error of the AHRS's lean, which the nominal AHRS does not have: see the on-board "
        "state's section. `ballbot twin recommendations --seeds 1-5 --out DIR` makes the same table.",
    )
