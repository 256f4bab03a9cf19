"""A small sample of the campaign in campaigns/learned_league.py, and its verdicts."""

import pytest

from ballbot.workflows.courses import choose_courses
from ballbot.workflows.league import League
from ballbot.workflows.metrics import Score
from campaigns.learned_league import PRESET, TASK_OF, Race, designed, trained, verdict


def test_every_course_of_the_benchmark_has_a_task():
    assert {course.name for course in choose_courses("benchmark", PRESET, "model")} == set(TASK_OF)


def score(error, *, fell=False):
    return Score(
        peak_position_error=error,
        rms_position_error=error,
        peak_heading_error=0.0,
        settling_time=1.0,
        arrived=True,
        rms_torque=0.1,
        rms_torque_change=0.1,
        high_frequency_torque=0.1,
        energy=1.0,
        ended="fell" if fell else None,
    )


@pytest.mark.parametrize(
    ("trainings", "sentence"),
    [
        ([[0.5, 0.6], [0.4, 0.5], [0.3, 0.4]], "beats precise"),
        ([[1.5, 1.6], [1.4, 1.5], [1.3, 1.4]], "loses to precise"),
        ([[0.5, 0.6], [1.4, 1.5], [1.0, 1.1]], "precise: 1 better, 1 worse"),
        ([[0.5, None], [0.4, 0.5], [0.3, 0.4]], "precise: 2 better, 1 worse"),  # a fall
    ],
)
def test_verdict_holds_for_all_trainings(trainings, sentence):
    (course,) = choose_courses("benchmark_hold", PRESET, "model")
    controllers = {"full": [9.0, 9.1], "partial": [8.0, 8.1], "precise": [1.0, 1.1]}
    controllers |= {f"learned {k}": errors for k, errors in enumerate(trainings)}
    league = League(
        robot=PRESET,
        courses=(course,),
        controllers=tuple(controllers),
        seeds=(1, 2),
        scores={
            (course.name, name): tuple(score(e or 0.0, fell=e is None) for e in errors)
            for name, errors in controllers.items()
        },
        tracks={},
    )
    assert verdict(league, course, "learned") == sentence


@pytest.mark.sample
def test_learned_controller_stands_and_the_precise_one_stands_closer():
    """Measured with ten seeds: 13 to 33 mm RMS, the precise controller 1.4 mm."""
    learned = trained(("balance", "learned", 0)).controller
    race = Race(
        controllers={"learned 0": learned, "precise": designed()["precise"]},
        courses=("benchmark_hold",),
        plant="model",
        seeds=(1, 2),
    )
    scores = race.league().scores
    own, precise = (scores["benchmark_hold", name] for name in ("learned 0", "precise"))
    assert all(s.ended is None and s.rms_position_error < 0.1 for s in own)
    assert all(s.rms_position_error < 0.5 * o.rms_position_error for s, o in zip(precise, own, strict=True))
