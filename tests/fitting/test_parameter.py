"""Scaled parameters: there and back, their slopes, and their bounds."""

from __future__ import annotations

import numpy as np

from ballbot.fitting.parameter import Limits, Parameter, ParameterSpace, Scale


def parameter(symbol: str, scale: Scale, bounds: Limits, default: float) -> Parameter:
    return Parameter(name=symbol, symbol=symbol, unit="", scale=scale, bounds=bounds, default=default)


SPACE = ParameterSpace(
    parameters=(
        parameter("c", "amount", (0.0, 0.5), 0.1),
        parameter("v_s", "ratio", (0.1, 3.0), 0.6),
        parameter("offset", "signed", (-0.2, 0.2), 0.0),
    )
)
VALUES = np.array([0.2, 1.1, -0.05])


def test_scaling_round_trips_and_clips():
    np.testing.assert_allclose(SPACE.physical(SPACE.scaled(VALUES)), VALUES, rtol=1e-12)
    np.testing.assert_allclose(SPACE.scaled(np.array([0.9, 0.01, 0.5])), [1.0, 0.0, 1.0], atol=1e-12)


def test_slopes_equal_differences():
    z, step = SPACE.scaled(VALUES), 1e-6
    ahead = np.array([SPACE.physical(z + step * one)[i] for i, one in enumerate(np.eye(len(z)))])
    np.testing.assert_allclose((ahead - VALUES) / step, SPACE.slopes(z), rtol=1e-4)
