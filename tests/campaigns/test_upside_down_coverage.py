"""A sample of the coverage of friction upside down: one twin of the campaign."""

import numpy as np
import pytest

from campaigns.upside_down_coverage import QUANTITIES, covered, numbers_of, places_of, recorded, scenario_of


def test_coverage_counts_intervals_that_contain_the_truth():
    one = {"truth": [1.0, 2.0, 3.0], "lower": [0.5, 2.5, np.nan], "upper": [np.inf, 3.0, np.nan]}
    assert covered([one], [0, 1, 2]) == (1, 2)
    assert places_of("c") == [3, 4, 5]
    assert sum(QUANTITIES.values()) == 6


@pytest.mark.sample
def test_a_twin_slips_and_plays_and_its_friction_is_found():
    pytest.importorskip("mujoco")
    scenario = scenario_of(201)
    found = numbers_of(recorded(scenario, 201), scenario.friction)
    inside, count = covered([found], range(6))
    assert inside >= count - 1  # of intervals of 95 %, two miss in one twin of ten
    values, truth = np.array(found["values"]), np.array(found["truth"])
    # c to some per cent, b with the contacts' own
    assert np.abs(values / truth - 1.0).max() < 0.1
    assert found["usable"] == [1.0]
