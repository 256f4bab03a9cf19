"""The branch-free sine, cosine, power and logarithm against the library's."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot.mechanics.engine.compiled import compiled
from ballbot.mechanics.engine.elementary import (
    binary_logarithm,
    power_of_two,
    sine_cosine,
    sine_cosine_of_lean,
)


@compiled
def sine_cosine_of(angle):
    return sine_cosine(angle)


@compiled
def sine_cosine_of_lean_of(angle):
    return sine_cosine_of_lean(angle)


@compiled
def power_of_two_of(x):
    return power_of_two(x)


@compiled
def binary_logarithm_of(x):
    return binary_logarithm(x)


# Two units in the last place of 1: the polynomial's rounding and the library's own
ULP2 = 2 * np.finfo(float).eps


@given(st.floats(-1e6, 1e6))
@settings(deadline=None)  # the first call compiles
def test_sine_and_cosine_at_any_heading(angle):
    sine, cosine = sine_cosine_of(angle)
    assert sine == pytest.approx(math.sin(angle), abs=ULP2)
    assert cosine == pytest.approx(math.cos(angle), abs=ULP2)


def test_ends_of_the_range():
    assert sine_cosine_of(0.0) == (0.0, 1.0)
    assert power_of_two_of(0.0) == 1.0
    assert binary_logarithm_of(1.0) == 0.0
    assert np.isnan(sine_cosine_of(np.nan)[0])


@given(st.floats(-1.3, 1.3))
@settings(deadline=None)
def test_sine_and_cosine_of_a_lean(angle):
    sine, cosine = sine_cosine_of_lean_of(angle)
    # the fits err by up to 2.3e-16, and rounding as elsewhere; 5e-16 was the worst of millions
    assert sine == pytest.approx(math.sin(angle), abs=2 * ULP2)
    assert cosine == pytest.approx(math.cos(angle), abs=2 * ULP2)


@given(st.floats(-1000.0, 1000.0))
@settings(deadline=None)
def test_power_of_two(x):
    # the fit errs by 4.4e-16 of the power, and rounding comes to it: 7.6e-16 was the worst of millions
    assert power_of_two_of(x) == pytest.approx(2.0**x, rel=3 * ULP2)


@given(st.floats(1e-300, 1e300))
@settings(deadline=None)
def test_binary_logarithm(x):
    assert binary_logarithm_of(x) == pytest.approx(math.log2(x), rel=2 * ULP2, abs=ULP2)
