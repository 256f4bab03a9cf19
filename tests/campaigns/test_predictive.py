"""The predictive controller that the lean limit is compared with (campaigns/predictive.py)."""

import numpy as np
import pytest

pytest.importorskip("daqp")  # of the extra "peers"; the toolkit itself has no use for it

from scipy.optimize import minimize

from ballbot import Controller
from ballbot.control.presets import PRECISE_TORQUE_WEIGHT
from campaigns import predictive
from campaigns.feedback_options import ROBOT, bound_of_any, stiff
from campaigns.predictive import Predictive, heading_error

STIFF = stiff()


def test_predictive_controller_equals_lqr_within_the_limits():
    law = Controller(ROBOT, STIFF.gain)
    correcting = Predictive(law, STIFF, torque_weight=PRECISE_TORQUE_WEIGHT)
    random = np.random.default_rng(0)
    for _ in range(200):
        state, reference = 0.02 * random.standard_normal(10), np.zeros(10)
        reference[[0, 1, 4]] = 0.02 * random.standard_normal(3)
        np.testing.assert_array_equal(
            correcting.update(0.0, state, reference), law.update(0.0, state, reference)
        )
    assert not correcting.times


def test_correction_beyond_the_limits_equals_the_quadratic_program(monkeypatch):
    # few nodes and looks, so that SciPy's quasi-Newton method can solve the same program as smooth and unconstrained
    monkeypatch.setattr(predictive, "NODES", (0, 10, 30))
    monkeypatch.setattr(predictive, "LOOKS", (0, 5, 15))
    law = Controller(ROBOT, STIFF.gain, torque_limit=2.0)
    correcting = Predictive(law, STIFF, torque_weight=PRECISE_TORQUE_WEIGHT)
    state = np.zeros(10)
    state[[0, 3, 5]] = 1.5, 0.05, 0.4
    ahead = correcting._of_error @ heading_error(state, np.zeros(10))

    lengths = np.linalg.norm(correcting._rows, axis=1)

    def cost(z: np.ndarray) -> float:
        over = np.maximum(np.abs(ahead + correcting._rows @ z) - 1.0, 0.0) / lengths
        return 0.5 * float(z @ z + over @ over / predictive.SOFTNESS)

    expected = minimize(cost, np.zeros(correcting._rows.shape[1]), method="BFGS", options={"gtol": 1e-8}).x
    found = correcting.correction(ahead)
    assert np.abs(found).max() > 0.1
    np.testing.assert_allclose(found, correcting._first @ expected, atol=1e-4)  # BFGS on finite differences


def test_correction_scales_at_most_with_the_torque_limit():
    lean, impulse = bound_of_any(2.0)
    assert bound_of_any(6.0) == pytest.approx((3.0 * lean, 3.0 * impulse))
