"""The prior that is fitted to many robots."""

import numpy as np
import pytest

from campaigns.between_logs import RobotLogs, fit_prior
from tests.fitting.test_between_logs import RIDGE, drawn


@pytest.mark.slow
def test_the_prior_of_many_robots_is_recovered() -> None:
    random, robots = np.random.default_rng(2), 20
    made = [
        RobotLogs(
            estimates=drawn(random, 2, 8.0), covariances=np.tile(RIDGE, (2, 1, 1)), groups=np.array([0, 0, 1])
        )
        for _ in range(robots)
    ]
    sizes, degrees = fit_prior(made, groups=2)
    # a size from 20 differences errs by 1 / sqrt(40), more with tau's own scatter and beside errors within logs
    np.testing.assert_allclose(sizes, [0.03, 0.05], rtol=4.0 / np.sqrt(2.0 * robots))
    assert 4.0 < degrees < 40.0
