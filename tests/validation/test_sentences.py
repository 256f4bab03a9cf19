"""The length that residuals of a log need to be asked."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from ballbot.validation.residuals import _no_wheels


def test_a_log_of_just_the_needed_length_is_long_enough():
    wheels = np.zeros((1, 3))
    steps = SimpleNamespace(wheel_speeds=wheels, segments=(3999,), sample_time=0.005)
    steps.residuals = np.zeros((3999, 10))
    assert _no_wheels(cast(Any, steps)) is None
    steps.residuals = np.zeros((3989, 10))
    assert _no_wheels(cast(Any, steps)) == "19.95 s are too short; at least 20 s are needed"
