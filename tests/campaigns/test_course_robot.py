"""A sample of the campaign on the course's robot: its mapping of duties, and the row of a pair."""

from __future__ import annotations

import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ballbot.fitting.intervals import Interval
from campaigns import course_robot
from campaigns.course_robot import filled_in
from campaigns.evidence import written_sections

PROPOSED = """[attitude]
from = ["roll", "pitch"]

[input]
kind = "duty"
# dead_band = 0.0  # what the firmware adds
"""


def test_what_the_firmware_adds_and_the_lean_s_delay_are_filled_in() -> None:
    found = tomllib.loads(filled_in(PROPOSED, course_robot.SOURCES["lab10_data_trial_408"]))
    assert found["attitude"]["delay"] == 0.0166
    assert found["input"] == {"kind": "duty", "dead_band": 0.0314}


def test_the_pages_text_is_the_campaigns(monkeypatch: pytest.MonkeyPatch) -> None:
    def interval(lower: float, upper: float) -> Interval:
        return Interval(lower=lower, upper=upper, method="clustered")

    found = SimpleNamespace(
        labels=("b1", "v_s"),
        values=np.array([1.0, 1.0]),
        bounds=np.array([[0.0, 2.0], [0.0, 2.0]]),
        intervals={"b1": interval(0.9, 1.1), "v_s": interval(0.9, 1.1)},
        another_log={"b1": interval(0.8, np.inf), "v_s": interval(0.8, np.inf)},
    )
    other = SimpleNamespace(**{**vars(found), "values": np.array([1.5, 1.0])})
    made = iter((found, other, found))
    monkeypatch.setattr(course_robot, "log_file", Path)
    monkeypatch.setattr(course_robot, "found_in", lambda *_: next(made))
    section = course_robot.campaign()
    first = section.rows[0]
    assert first[1].startswith("0 of 1, 0 %")
    # 0.2 and 1.2, up to the bound, over 3.92 standard deviations of 0.5 / sqrt(2)
    assert [float(cell) for cell in first[2::2]] == pytest.approx([0.144, 0.866], abs=0.006)
    assert first[3].startswith("1 of 1, 100 %")
    assert section.rows[-1][1].startswith("4 of 6")
    page = written_sections()["course_robot"]
    assert f"## {section.title}\n\n{section.before}\n\n| {' | '.join(section.columns)} |\n" in page
    assert [line.split(" | ")[0] for line in page.splitlines() if " for " in line and line[0] == "|"] == [
        f"| {row[0]}" for row in section.rows[:-1]
    ]
