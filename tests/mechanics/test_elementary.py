"""The branch-free sine, cosine, power and logarithm against the library's."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.mechanics.engine.compiled import compiled
from ballbot.mechanics.engine.elementary import (
    binary_logarithm,
    power_of_two,
    sine_cosine,
    sine_cosine_of_lean,
)


@compiled
def found(angle, lean, x, positive):
    return sine_cosine(angle), sine_cosine_of_lean(lean), power_of_two(x), binary_logarithm(positive)


# Two units in the last place of 1: the polynomial's rounding and the library's own
ULP2 = 2 * np.finfo(float).eps


@given(st.floats(-1e6, 1e6), st.floats(-1.3, 1.3), st.floats(-1000.0, 1000.0), st.floats(1e-300, 1e300))
def test_functions_are_the_library_s_but_for_rounding(angle, lean, x, positive):
    of_angle, of_lean, power, logarithm = found(angle, lean, x, positive)
    assert of_angle == pytest.approx((math.sin(angle), math.cos(angle)), rel=0.0, abs=ULP2)
    # the fits err by up to 2.3e-16, and rounding as elsewhere; 5e-16 was the worst of millions
    assert of_lean == pytest.approx((math.sin(lean), math.cos(lean)), rel=0.0, abs=2 * ULP2)
    # the fit errs by 4.4e-16 of the power, and rounding comes to it: 7.6e-16 was the worst of millions
    assert power == pytest.approx(2.0**x, rel=3 * ULP2)
    assert logarithm == pytest.approx(math.log2(positive), rel=2 * ULP2, abs=ULP2)


def test_ends_of_the_range():
    assert found(0.0, 0.0, 0.0, 1.0) == ((0.0, 1.0), (0.0, 1.0), 1.0, 0.0)
    assert np.isnan(found(np.nan, 0.0, 0.0, 1.0)[0][0])
