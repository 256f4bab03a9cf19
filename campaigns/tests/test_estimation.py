"""The estimators side by side."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco")

from ballbot.control.references import square
from ballbot.robot import Robot
from ballbot.twin import Scenario
from campaigns.estimation import ALONE, BIASED, FIXED, THESIS, side_by_side

ALTEN = Robot.load("alten")


@pytest.mark.sample
def test_drift_is_a_third_of_the_thesis_s() -> None:
    """A sample of the campaign in docs/generated/evidence.md: its two numbers, on a minute and a half.

    That leaves half a minute of instants with another a minute later; measured: drift 0.12 to 0.14 of the thesis's,
    heading 0.08 to 0.13.

    The gyro's bias turns the frame, too; with some seeds, such as 7, it undoes the drift that the thesis's way suffers.
    """
    scenario = replace(Scenario.nominal(ALTEN), sensor_faults=BIASED)
    found = side_by_side(ALTEN, scenario, square(), seed=11, duration=90.0)
    for name in (ALONE, FIXED):
        assert found[name].position_drift < found[THESIS].position_drift / 3
        assert np.degrees(found[name].lean) < 0.3
        assert found[name].velocity < found[THESIS].velocity
        assert found[name].heading < found[THESIS].heading / 3
