"""The firmware's functions against float64, at a sample of all floats."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.firmware_math import STATED, called, largest_errors

#: a prime, so that every last bit of the mantissa takes part
STEP = 20011

single = st.floats(width=32, allow_nan=False, allow_infinity=False)


def of(name: str, *arguments: float, results: int = 1):
    """Call a function on single numbers."""
    found = called(name, *(np.array([one], np.float32) for one in arguments), results=results)
    return [float(one[0]) for one in found]


def test_errors_stay_within_what_the_header_states():
    found = largest_errors(STEP, 1)
    assert {name: error for name, error in found.items() if not error <= STATED[name]} == {}


@given(single)
def test_sine_is_odd_and_cosine_even_to_the_bit(angle):
    sine, cosine = of("sine_cosine", angle, results=2)
    assert of("sine_cosine", -angle, results=2) == [-sine, cosine]


@given(st.floats(0.0, 2.0**100, width=32), st.floats(0.0, 2.0**100, width=32))
def test_arctangent_is_symmetric_to_the_bit(y, x):
    (angle,) = of("arctangent", y, x)
    assert of("arctangent", -y, x) == [-angle]
    assert 0.0 <= angle <= float(np.float32(math.pi / 2))


@given(single)
def test_functions_of_any_number_are_numbers(x):
    sine, cosine = of("sine_cosine", x, results=2)
    assert abs(sine) <= 1.0
    assert abs(cosine) <= 1.0
    assert 1.6e-38 < of("exponential", x)[0] < 6.1e37
    assert of("square_root", x)[0] >= 0.0


@given(single, single)
def test_power_of_any_numbers_is_a_number(base, exponent):
    assert 0.0 <= of("power", base, exponent)[0] < 5e37


@pytest.mark.parametrize(
    ("name", "arguments", "wanted"),
    [
        ("exponential", (0.0,), 1.0),
        ("power", (0.0, 0.0), 1.0),
        ("power", (0.0, 0.5), 0.0),
        ("power", (-1.0, 2.0), 0.0),
        ("power", (1.0, 8.0), 1.0),
        ("power", (1e-45, 1.0), 0.0),
        ("power", (math.inf, 1.0), 2.0**125),
        ("power", (math.inf, -1.0), 2.0**-125),
        ("square_root", (0.0,), 0.0),
        ("square_root", (-1.0,), 0.0),
        ("square_root", (4.0,), 2.0),
        ("square_root", (math.inf,), math.inf),
        ("arctangent", (0.0, 0.0), 0.0),
        ("arctangent", (0.0, -1.0), float(np.float32(math.pi))),
        ("arctangent", (math.inf, 1.0), float(np.float32(math.pi / 2))),
        ("arctangent", (1.0, math.inf), 0.0),
        *((name, (math.nan,), math.nan) for name in ("exponential", "square_root")),
        *(
            (name, two, math.nan)
            for name in ("power", "arctangent")
            for two in ((math.nan, 1.0), (1.0, math.nan))
        ),
    ],
)
def test_values_at_special_points(name, arguments, wanted):
    np.testing.assert_array_equal(of(name, *arguments), [wanted])
    assert np.isnan([of("sine_cosine", one, results=2) for one in (math.nan, math.inf)]).all()
