"""A sample of the campaign on the course's robot: its mapping of duties."""

from __future__ import annotations

import tomllib

from campaigns import course_robot
from campaigns.course_robot import filled_in

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
