"""Rolling friction: its compiled form is NumPy's, and its size is the weight times C_rr."""

import numpy as np
import pytest

from ballbot.mechanics.floor import floor_friction, rolling_friction
from ballbot.mechanics.parameters import Parameters
from tests.support.control_examples import FRICTION, alten


def test_rolling_force_is_the_weight_times_the_coefficient() -> None:
    robot = alten(FRICTION)
    weight = (robot.ball.mass + robot.body.mass) * robot.gravity
    assert robot.weight == weight
    assert robot.rolling_force == weight * FRICTION.rolling


def test_rolling_friction_acts_against_the_velocity_and_is_zero_at_rest() -> None:
    force = rolling_friction([[0.3, -0.4], [0.0, 0.0], [0.003, -0.004]], 2.0, slowest=0.01)
    assert force == pytest.approx(np.array([[-1.2, 1.6], [0.0, 0.0], [-0.6, 0.8]]))


def test_the_compiled_form_is_that_of_numpy() -> None:
    from numba import njit

    @njit
    def compiled(P, v):
        return floor_friction(P, v).force

    six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    P = Parameters(
        1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, (1.0, 1.0), 2.5, 1.0, 1.0, 0.0, six, six, ()
    )._replace(
        wheels=(0,)  # pyright: ignore[reportArgumentType] (not read)
    )
    for v in np.random.default_rng(3).normal(size=(20, 2)):
        assert compiled(P, tuple(v)) == pytest.approx(rolling_friction(v, 2.5), rel=1e-14)
    assert compiled(P, (0.0, 0.0)) == (0.0, 0.0)
