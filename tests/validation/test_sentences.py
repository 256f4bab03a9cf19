"""The sentences of a validation: plurals, lengths and directions."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from ballbot.robot import Robot
from ballbot.validation.residuals import _no_wheels, _pair_findings, _whiteness_finding
from ballbot.validation.statistics import Correlations, Whiteness


def test_a_log_of_just_the_needed_length_is_long_enough():
    wheels = np.zeros((1, 3))
    steps = SimpleNamespace(wheel_speeds=wheels, segments=(3999,), sample_time=0.005)
    steps.residuals = np.zeros((3999, 10))
    assert _no_wheels(cast(Any, steps)) is None
    steps.residuals = np.zeros((3989, 10))
    assert _no_wheels(cast(Any, steps)) == "19.95 s are too short; at least 20 s are needed"


def test_one_is_not_several():
    labels = (*(f"e_{i}" for i in range(10)), "u1")
    significant = np.zeros((11, 11), dtype=bool)
    significant[0, 1] = True
    none = Correlations(labels=labels, matrix=np.eye(11), counts=np.ones((11, 11)), significant=significant)
    assert (
        "1 of the 55 pairs of a residual with another or a torque is significant" in _pair_findings(none)[0]
    )
    both = replace(none, significant=significant | np.roll(significant, 1, axis=1))
    assert (
        "2 of the 55 pairs of a residual with another or a torque are significant" in _pair_findings(both)[0]
    )
    memory = np.tile(0.9, (21, 10))
    coloured = Whiteness(
        autocorrelation=memory,
        statistic=np.ones(10),
        p_value=np.zeros(10),
        rejected=np.ones(10, dtype=bool),
        predicted_share=np.ones(10),
    )
    assert "(100 % of the variance)" in _whiteness_finding(coloured)


def test_a_robot_names_the_ball_s_centre_one_way():
    assert "ball center" not in str(Robot.load("alten").summary())
