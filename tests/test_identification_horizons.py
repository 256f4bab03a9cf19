"""Errors by horizon, and how much of the friction found a log asks for."""

import json

import numpy as np
import pytest
from identification_examples import TRUTH, balancing_log, noisy

from ballbot import Robot
from ballbot.identification.holdout import horizon_errors
from ballbot.identification.prediction import Predictor

PREDICTOR = Predictor(robot=Robot.load("alten"), formulation="exact", step=1e-3)
LOG = noisy(balancing_log(), seed=3)
#: b, c, s of three wheels and C_rr are amounts of friction; v_s and delta are its form
AMOUNTS = np.array([*range(9), 11])


def errors(factor: float):
    values = TRUTH.copy()
    values[AMOUNTS] *= factor
    return horizon_errors(PREDICTOR, values, LOG)


def test_a_log_asks_for_all_of_its_own_friction():
    for one in errors(1.0):
        for part in (one.wheel_speed, one.lean):
            # starts are noisy: four standard errors
            assert abs(part.share - 1.0) < 4.0 * part.share_error
            assert part.with_friction < part.viscous_part < part.without_friction


@pytest.mark.parametrize("factor", [0.5, 1.6])
def test_a_friction_of_another_size_is_asked_for_in_proportion(factor):
    first = errors(factor)[0]
    # not quite one over the factor, as wheels that stand still do not feel it in proportion
    for part in (first.wheel_speed, first.lean):
        assert part.share == pytest.approx(1.0 / factor, rel=0.25)
        assert abs(part.share - 1.0) > 3.0 * part.share_error


def test_without_friction_there_is_no_share_and_no_nan_in_the_file():
    first = errors(0.0)[0]
    assert np.isnan(first.wheel_speed.share)
    json.dumps(first.to_dict(), allow_nan=False)
