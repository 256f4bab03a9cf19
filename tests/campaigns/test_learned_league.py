"""A small sample of the campaign in campaigns/learned_league.py."""

import pytest

from ballbot.workflows.courses import choose_courses
from campaigns.learned_league import PRESET, TASK_OF, Race, designed, trained


def test_every_course_of_the_benchmark_has_a_task():
    assert {course.name for course in choose_courses("benchmark", PRESET, "model")} == set(TASK_OF)


@pytest.mark.sample
def test_learned_controller_stands_and_the_precise_one_stands_closer():
    """Measured with ten seeds: 13 to 33 mm RMS, the precise controller 1.4 mm."""
    learned = trained(("balance", "learned", 0)).controller
    controllers = {"learned 0": learned, "precise": designed()["precise"]}
    race = Race(controllers=controllers, courses=("benchmark_hold",), plant="model", seeds=(1, 2))
    scores = race.league().scores
    own, precise = (scores["benchmark_hold", name] for name in ("learned 0", "precise"))
    assert all(s.ended is None and s.rms_position_error < 0.1 for s in own)
    assert all(s.rms_position_error < 0.5 * o.rms_position_error for s, o in zip(precise, own, strict=True))
