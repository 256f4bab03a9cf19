"""A small sample of the campaign in benchmarks/coverage.py; `make evidence` runs the whole."""

import pytest

from benchmarks.coverage import TRUTHS, held, repeat, truth_of


@pytest.mark.slow
def test_intervals_hold_the_truth():
    done, truth = [repeat(TRUTHS["all"], seed=seed) for seed in range(3)], truth_of("all")
    inside = {label: sum(held(label, done, truth)) for label in truth}
    # of 3 right 95 % intervals fewer than 2 hold the truth in one case of 140, and twelve are looked at
    assert min(inside.values()) >= 2
    # 36 in all, of which 1.8 fail on average; those of one log go together, hence the wide margin
    assert sum(inside.values()) >= 29


@pytest.mark.slow
def test_what_has_no_influence_is_given_no_number():
    found, truth = repeat(TRUTHS["no break-away"], seed=0), truth_of("no break-away")
    assert found.estimates["v_s"] is None
    assert found.estimates["delta"] is None
    assert not {"v_s", "delta"} & set(found.intervals)
    # break-away friction itself is told: near zero, by an interval that begins there
    assert all(found.intervals[label].lower == 0.0 for label in ("s1", "s2", "s3"))
    assert max(found.intervals[label].upper for label in ("s1", "s2", "s3")) < 0.02
    assert sum(truth[label] in one for label, one in found.intervals.items()) >= 8
