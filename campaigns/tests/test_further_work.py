"""A small sample of the campaign in campaigns/further_work.py; `make evidence` runs the whole."""

import pytest

from campaigns.further_work import Changed, changed_scores, speed_run


@pytest.mark.sample
def test_soft_gain_holds_closer_through_speeds_without_knowing_the_friction():
    torques = changed_scores(Changed(name="soft", words="as it is", seeds=(700,)))["hold"][0]
    speeds = speed_run(("hold", 700, False))
    assert torques.ended is None
    assert speeds.ended is None
    # 42 and 4.5 mm in the campaign
    assert speeds.rms_position_error < 0.5 * torques.rms_position_error


@pytest.mark.sample
def test_stiff_gain_holds_worse_without_compensation_of_rolling_friction():
    has, lacks = (
        changed_scores(Changed(name="precise", words=words, seeds=tuple(range(700, 708))))["hold"]
        for words in ("as it is", "rolling friction not compensated")
    )
    # 1.4 and 2.0 mm in the campaign
    assert sum(run.rms_position_error for run in has) < sum(run.rms_position_error for run in lacks)
