"""The rolling friction under a study's twins: the twin's own losses are not counted twice."""

import math

import pytest

from ballbot import Robot
from ballbot.robot import Friction
from ballbot.workflows.twin_confirmation import TwinRolling
from campaigns.between_logs import NOMINAL
from campaigns.twin_rolling import rolling_from


@pytest.mark.parametrize(
    ("drawn", "added", "floor"),
    [(0.014, 0.006, 0.008), (0.004, 0.006, 0.0), (0.014, 0.0, 0.014), (0.014, math.nan, 0.014)],
)
def test_floor_has_what_the_twin_does_not_add(drawn, added, floor):
    rolling = TwinRolling(identified=0.014, added=added)
    friction = Robot.load("alten").friction
    changed = rolling.on_twin(Friction(**{**vars(friction), "rolling": drawn}))
    assert changed.rolling == pytest.approx(floor, abs=1e-15)
    assert changed.viscous == friction.viscous


@pytest.mark.sample
def test_floor_of_the_nominal_twin_is_found_from_its_log(tmp_path, monkeypatch):
    monkeypatch.setattr("campaigns.section.BUILD", tmp_path)
    rolling = rolling_from(1)
    true = NOMINAL.friction.rolling
    assert rolling.identified > 1.5 * true
    # two and a half deviations over the ten seeds of `python -m campaigns.evidence twin_rolling`
    assert rolling.identified - rolling.added == pytest.approx(true, abs=0.003)
