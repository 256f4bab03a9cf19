"""Derived quantities against published numbers and against sums over small pieces."""

import pytest

from ballbot.robot import Robot
from ballbot.robot.derived import derived_quantities


def test_wheel_speed_limit_is_that_of_appendix_i() -> None:
    drive = Robot.load("alten").drive
    assert drive.top_speed * drive.gear_ratio == pytest.approx(761.5, abs=0.05)
    assert drive.top_speed == pytest.approx(27.59, abs=0.005)


def test_derived_quantities_of_alten() -> None:
    found = {one.name: one.value for one in derived_quantities(Robot.load("alten"))}
    assert found["total_mass"] == pytest.approx(20.076)
    assert found["body_inertia_central_xx"] == pytest.approx(4.37 - 2.637, abs=5e-4)
    # the swing that Appendix III measured: its inertia must come out of it again
    swing = found["swing_frequency"]
    assert 17.076 * 9.81 * 0.393 / swing**2 == pytest.approx(4.37, rel=1e-12)
    assert found["break_away_torque"] == 0.0
    assert found["rolling_resistance"] == 0.0
