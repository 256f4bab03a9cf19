"""The notch: SciPy's sampling of its transfer function, what it does in a loop, and what a controller file refuses."""

from functools import cache

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import bilinear, lfilter

from ballbot import Controller
from ballbot.control.parts import Parts
from ballbot.control.parts.notch import Notch
from ballbot.control.presets import design_gain
from tests.support.control_examples import alten

SAMPLE = 0.005
ROBOT = alten()


@cache
def designed_gain() -> np.ndarray:
    return design_gain(ROBOT).gain


def sampled(notch: Notch) -> tuple[np.ndarray, np.ndarray]:
    """Return the filter's coefficients by SciPy: the analog notch, its frequency warped so that it stays in place."""
    w = 2.0 / SAMPLE * np.tan(np.pi * notch.frequency * SAMPLE)
    return bilinear(
        [1.0, notch.depth * notch.width * w, w * w], [1.0, notch.width * w, w * w], fs=1.0 / SAMPLE
    )


notches = st.builds(
    Notch, frequency=st.floats(3.0, 80.0), width=st.floats(0.1, 2.0), depth=st.floats(0.0, 0.9)
)


@settings(max_examples=20, deadline=None)
@given(notch=notches, seed=st.integers(0, 99))
def test_the_law_filters_each_wheels_torque_as_scipy_would(notch, seed):
    states = 0.02 * np.random.default_rng(seed).standard_normal((60, 10))
    bare = Controller(ROBOT, designed_gain(), torque_limit=1e6)
    torques = np.array([bare.update(0.0, state, np.zeros(10)) for state in states])
    controller = Controller(ROBOT, designed_gain(), torque_limit=1e6, parts=Parts(notch=notch))
    found = np.array([controller.update(0.0, state, np.zeros(10)) for state in states])
    # sums of 60 terms of at most 10 N m
    np.testing.assert_allclose(found, lfilter(*sampled(notch), torques, axis=0), rtol=0, atol=1e-10)
    controller.reset()
    np.testing.assert_array_equal(controller.update(0.0, states[0], np.zeros(10)), found[0])
