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

PROPOSED = """# proposed
complete = false  # fill in the lines with cannot determine

[time]
keep = [[1.0, 2.0]]

[attitude]
# cannot determine: delay of the lean (is it 0.0 ms?); the wheels explain the lean best 16.6 ms earlier, as
delay = 0.0  # assumed; the wheels explain the lean best 16.6 ms earlier

[input]
# cannot determine: kind of the command
kind = "torque"  # 74 %: torque in N m
scale = 1.0
# if it is a current, these lines in place of those above in [input]:
#   kind = "current"  # 24 %
#   torque_constant = 0.0069
# if it is a duty, these lines in place of those above in [input]:
#   kind = "pwm"  # 2 %
#   dead_band = 0.031
from = ["T1", "T2", "T3"]
delay = 0.008
"""


def test_the_lines_for_duties_replace_those_for_torques_and_the_delay_is_the_wheels() -> None:
    assert tomllib.loads(filled_in(PROPOSED)) == {
        "time": {"keep": [[1.0, 2.0]]},
        "attitude": {"delay": 0.0166},
        "input": {"kind": "pwm", "dead_band": 0.031, "from": ["T1", "T2", "T3"], "delay": 0.008},
    }


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
