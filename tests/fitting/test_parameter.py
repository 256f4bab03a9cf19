"""Scaled parameters: there and back, their slopes, and their bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ballbot.fitting.parameter import Limits, Parameter, ParameterSpace, RelativeSpace, Scale


def parameter(symbol: str, scale: Scale, bounds: Limits, default: float) -> Parameter:
    return Parameter(name=symbol, symbol=symbol, unit="", scale=scale, bounds=bounds, default=default)


BOUNDED = ParameterSpace(
    parameters=(
        parameter("c", "amount", (0.0, 0.5), 0.1),
        parameter("v_s", "ratio", (0.1, 3.0), 0.6),
        parameter("offset", "signed", (-0.2, 0.2), 0.0),
    )
)
RELATIVE = RelativeSpace(
    parameters=(
        parameter("b", "amount", (0.0, math.inf), 3.0),
        parameter("mass", "ratio", (0.0, math.inf), 3.0),
        parameter("offset", "signed", (-math.inf, math.inf), -0.3),
        parameter("s", "amount", (0.0, math.inf), 0.0),
    )
)
CASES = [(BOUNDED, np.array([0.2, 1.1, -0.05])), (RELATIVE, np.array([2.0, 4.0, 0.1, 0.7]))]


@pytest.mark.parametrize(("space", "values"), CASES, ids=["bounded", "relative"])
def test_scaling_round_trips(space, values):
    np.testing.assert_allclose(space.physical(space.scaled(values)), values, rtol=1e-12)


@pytest.mark.parametrize(("space", "values"), CASES, ids=["bounded", "relative"])
def test_slopes_equal_differences(space, values):
    z, step = space.scaled(values), 1e-6
    ahead = np.array([space.physical(z + step * one)[i] for i, one in enumerate(np.eye(len(z)))])
    np.testing.assert_allclose((ahead - values) / step, space.slopes(z), rtol=1e-4)


def test_relative_bounds_follow_the_sign_and_the_size():
    lower, upper = RELATIVE.bounds()
    np.testing.assert_array_equal(lower, [0.0, math.log(3.0) - 7.0, -math.inf, 0.0])
    np.testing.assert_array_equal(upper, [math.inf, math.log(3.0) + 7.0, math.inf, math.inf])


def test_bounded_space_clips_to_its_bounds():
    np.testing.assert_allclose(BOUNDED.scaled(np.array([0.9, 0.01, 0.5])), [1.0, 0.0, 1.0], atol=1e-12)
