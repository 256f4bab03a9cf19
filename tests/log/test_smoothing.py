"""The filter of the checks: what it makes of rows that come faster than its own."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot.log.signals import INTERVAL, smooth


@settings(deadline=None)
@given(interval=st.floats(0.0003, 0.01), offset=st.floats(-5e-3, 5e-3))
def test_a_cubic_keeps_its_value_and_its_derivatives(interval: float, offset: float) -> None:
    rows = np.arange(0.0, 2.0, INTERVAL)
    t = np.arange(-0.1, 2.1, interval) + offset
    x = t - 1.0
    found = smooth(rows, t, (1.0 + 2.0 * x - 3.0 * x**2 + 0.5 * x**3)[:, None])
    inner, x = slice(60, -60), rows - 1.0
    # straight lines between rows are off by a sixteenth of the curvature 9 over the squared interval, on average
    np.testing.assert_allclose(
        found.value[inner, 0], (1.0 + 2.0 * x - 3.0 * x**2 + 0.5 * x**3)[inner], atol=6e-4
    )
    np.testing.assert_allclose(found.rate[inner, 0], (2.0 - 6.0 * x + 1.5 * x**2)[inner], atol=3e-3)


@pytest.mark.parametrize("interval", [0.001, 0.002, 0.004])
def test_noise_of_a_derivative_cancels_from_row_to_row(interval: float) -> None:
    """The rate of a noisy angle is as quiet whether the filter or the log differentiates it."""
    t = np.arange(0.0, 20.0, interval)
    angle = np.random.default_rng(1).standard_normal((len(t), 1))
    rows = np.arange(0.0, 20.0, INTERVAL)
    inner = slice(100, -100)
    own = smooth(rows, t, angle).rate[inner]
    logged = smooth(rows, t, np.gradient(angle, t, axis=0)).value[inner]
    # single values of the logged rate would have 36, 9 and 1.5 times the noise
    assert np.std(logged) < 1.3 * np.std(own)
