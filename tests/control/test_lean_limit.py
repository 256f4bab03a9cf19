"""The bound on the lean that errors ask for: NumPy's words for it, and what it saves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from ballbot import Controller, Model, Robot
from ballbot.control.parts import Parts
from ballbot.control.parts.lean_limit import LeanLimit
from ballbot.control.presets import design_integral_gain
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.workflows.limits import ControlledRobot, leaning_state, pushed_state, reach
from tests.support.control_examples import alten, four_wheeled

BOUND = LeanLimit(lean=0.1, turn=0.4)
ROBOT = alten()
designed = st.deferred(
    lambda: st.sampled_from(
        [(robot, design_integral_gain(robot).gain) for robot in (ROBOT, four_wheeled(friction=False))]
    )
)
states = st.lists(st.floats(-1.0, 1.0), min_size=10, max_size=10).map(np.array)


def torques(robot: Robot, gain: np.ndarray, state: np.ndarray, bound: LeanLimit | None) -> np.ndarray:
    controller = Controller(robot, gain, torque_limit=1e6, parts=Parts(lean_limit=bound))
    return controller.update(0.0, state, np.zeros(10))


def asked(gain: np.ndarray, state: np.ndarray, by: list[int], of: slice) -> float:
    """Return the size of the error `of` lean or heading whose feedback is nearest to that of others."""
    return float(np.linalg.norm(np.linalg.lstsq(gain[:, of], gain[:, by] @ state[by], rcond=None)[0]))


@settings(max_examples=60, deadline=None)
@given(design=designed, state=states, size=st.sampled_from([0.01, 0.1, 1.0]))
def test_lean_limit_equals_its_numpy_reference(design, state, size):
    robot, gain = design
    state = size * state
    state[4] = 0.0  # as it stands the frames agree
    turn = asked(gain, state, [4, 9], slice(4, 5))
    bounded = state.copy()
    bounded[:2] *= min(1.0, BOUND.lean / max(asked(gain, state, [0, 1], slice(2, 4)), 1e-300))
    bounded[[0, 1, 5, 6]] *= min(
        1.0, BOUND.lean / max(asked(gain, bounded, [0, 1, 5, 6], slice(2, 4)), 1e-300)
    )
    bounded[[4, 9]] *= min(1.0, BOUND.turn / max(turn, 1e-300))
    # gains reach 50 N m/rad, and short polynomials for sines are good to 1e-12
    np.testing.assert_allclose(torques(robot, gain, state, BOUND), -gain @ bounded, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_a_stiff_gain_with_the_bound_comes_back_from_nearly_all_that_the_motors_can_save():
    stiff = design_integral_gain(ROBOT).gain
    weak = ROBOT.replace({"drive.torque_limit": 2.0})
    directions = np.radians([0.0, 90.0])

    def edges(bound: LeanLimit | None) -> tuple[np.ndarray, np.ndarray]:
        controller = Controller(weak, stiff, torque_limit=2.0, parts=Parts(lean_limit=bound))
        loop = ControlledRobot(robot=weak, controller=controller, grip=np.inf)
        leans = reach(loop.recovers, lambda s: leaning_state(directions, s), shape=(2,), end=LARGEST_LEAN)
        height = weak.body.center_of_mass
        blows = reach(
            loop.recovers, lambda s: pushed_state(loop.model, directions, s, height), shape=(2,), end=60.0
        )
        return leans, blows

    (lean, blow), (bare_lean, bare_blow) = edges(BOUND), edges(None)
    assert (blow > 2.0 * bare_blow).all()
    # what no controller can pass: the linear model's falling part kept from growing by the motors' whole torque
    linear = Model(weak).linearize()
    values, vectors = np.linalg.eig(linear.A.T)
    falls = values.real > 1.0
    rates, left = values[falls].real, vectors[:, falls].real.T
    for edge, most in (
        (lean[0], _most(rates, left, linear.B, leaning_state(0.0, 1.0))),
        (
            blow[0],
            _most(rates, left, linear.B, pushed_state(Model(weak), 0.0, 1.0, weak.body.center_of_mass)),
        ),
    ):
        assert 0.9 * most < edge < 1.05 * most  # the exact model's own fall is slower at a lean
    assert (lean >= bare_lean).all()


def _most(rates: np.ndarray, left: np.ndarray, B: np.ndarray, start: np.ndarray) -> float:
    """Return how many times a start some torques within 2 N m can keep from falling further."""
    kept = np.column_stack([rates * (left @ start), left @ B])
    found = linprog([-1, 0, 0, 0], A_eq=kept, b_eq=[0, 0], bounds=[(0, None), *[(-2, 2)] * 3])
    return float(found.x[0])
