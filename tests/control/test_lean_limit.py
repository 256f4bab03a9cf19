"""The bound on the lean that errors ask for: NumPy's words for it, and what it saves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot import Controller
from ballbot.control.parts import Parts
from ballbot.control.parts.lean_limit import LeanLimit
from ballbot.control.presets import design_integral_gain
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.workflows.limits import Loop, leaning_state, pushed_state, reach
from tests.support.control_examples import alten, four_wheeled

BOUND = LeanLimit(lean=0.1, turn=0.4)
ROBOT = alten()
ROBOTS = ROBOT, four_wheeled(friction=False)
designed = st.deferred(lambda: st.sampled_from([(one, design_integral_gain(one).gain) for one in ROBOTS]))
states = st.lists(st.floats(-1.0, 1.0), min_size=10, max_size=10).map(np.array)


def asked(gain: np.ndarray, state: np.ndarray, by: list[int], of: slice) -> float:
    """Return the size of the error `of` lean or heading whose feedback is nearest to that of others."""
    return float(np.linalg.norm(np.linalg.lstsq(gain[:, of], gain[:, by] @ state[by], rcond=None)[0]))


@given(design=designed, state=states, size=st.sampled_from([0.01, 0.1, 1.0]))
def test_lean_limit_equals_its_numpy_reference(design, state, size):
    robot, gain = design
    state = size * state
    state[4] = 0.0  # as it stands the frames agree
    turn = asked(gain, state, [4, 9], slice(4, 5))
    bounded = state.copy()
    bounded[:2] *= min(1.0, BOUND.lean / max(asked(gain, state, [0, 1], slice(2, 4)), 1e-300))
    moving = [0, 1, 5, 6]
    bounded[moving] *= min(1.0, BOUND.lean / max(asked(gain, bounded, moving, slice(2, 4)), 1e-300))
    bounded[[4, 9]] *= min(1.0, BOUND.turn / max(turn, 1e-300))
    found = Controller(robot, gain, torque_limit=1e6, parts=Parts(lean_limit=BOUND)).update(
        0.0, state, np.zeros(10)
    )
    # gains reach 50 N m/rad, and short polynomials for sines are good to 1e-12
    np.testing.assert_allclose(found, -gain @ bounded, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_a_stiff_gain_with_the_bound_comes_back_from_larger_leans_and_twice_the_blows():
    """How near that comes to what no controller can pass: tests/workflows/test_limits.py."""
    weak, directions = ROBOT.replace({"drive.torque_limit": 2.0}), np.radians([0.0, 90.0])
    stiff, height = design_integral_gain(ROBOT).gain, weak.body.center_of_mass
    edges = []
    for bound in (BOUND, None):
        controller = Controller(weak, stiff, torque_limit=2.0, parts=Parts(lean_limit=bound))
        loop = Loop(robot=weak, controller=controller, grip=np.inf)
        starts = (
            (lambda size: leaning_state(directions, size), LARGEST_LEAN),
            (lambda size, model=loop.model: pushed_state(model, directions, size, height), 60.0),
        )
        edges.append([reach(loop.recovers, start, shape=(2,), end=end) for start, end in starts])
    (lean, blow), (bare_lean, bare_blow) = edges
    assert (lean >= bare_lean).all()
    assert (blow > 2.0 * bare_blow).all()
