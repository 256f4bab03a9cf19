"""A sample of the campaign on the course's robot: its mapping of duties, and the row of a pair."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from ballbot.fitting.intervals import Interval
from campaigns import course_robot
from campaigns.course_robot import Found, filled_in, pair_row
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


def test_a_row_counts_what_each_interval_holds() -> None:
    def interval(lower: float, upper: float) -> Interval:
        return Interval(lower=lower, upper=upper, method="clustered")

    one = Found(
        values={"b1": 1.0, "b2": 1.0, "C_rr": 1.0},
        conditional={"b1": interval(0.9, 1.1), "b2": interval(0.9, 1.1), "C_rr": interval(0.9, float("inf"))},
        prediction={"b1": interval(0.8, 1.2), "b2": interval(0.5, 1.5), "C_rr": interval(0.5, 1.5)},
    )
    other = Found(values={"b1": 1.0, "b2": 1.4, "C_rr": 2.0}, conditional={}, prediction={})
    cells, counts = pair_row(one, other)
    assert counts == [3, 2, 2]
    # widths 0.4 over 0.2; and 1 over 0.2 + 40 * 0.3. An interval that is open has no score
    assert cells == ["1, 2 of 2", "0, 0 of 0", "1, 0 of 1", f"{(2.0 + 1.0 / 12.2) / 2.0:.2f}"]


def test_the_pages_text_is_the_campaigns(monkeypatch: pytest.MonkeyPatch) -> None:
    certain = Interval(lower=0.9, upper=1.1, method="clustered")
    found = Found(values={"b1": 1.0}, conditional={"b1": certain}, prediction={"b1": certain})
    monkeypatch.setattr(course_robot, "log_file", Path)
    monkeypatch.setattr(course_robot, "found_in", lambda *_: found)
    section = course_robot.campaign()
    page = written_sections()["course_robot"]
    assert f"## {section.title}\n\n{section.before}\n\n| {' | '.join(section.columns)} |\n" in page
    assert [line.split(" | ")[0] for line in page.splitlines() if " for " in line and line[0] == "|"][1:] == [
        f"| {row[0]}" for row in section.rows
    ]
