"""A sample of the campaign on changes of a running controller."""

import numpy as np
import pytest

from campaigns.tune_sequences import counted, upper_bound


@pytest.mark.sample
def test_no_run_of_alten_falls_by_changes():
    row = counted("alten", "nominal", runs=20, seed=3)
    assert row.changes > 200
    assert (row.untuned, row.added) == (0, 0)


def test_bound_of_no_fall_is_that_of_the_binomial_distribution():
    assert upper_bound(0, 1000) == pytest.approx(1.0 - 0.05 ** (1 / 1000))
    assert upper_bound(3, 3) == 1.0
    assert np.isclose(upper_bound(1, 10), 0.3942, atol=1e-4)
