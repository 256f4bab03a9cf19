"""A block of robots in short loops over lanes against one robot's step in one piece, and robots among others."""

import numpy as np
from numba import njit

from ballbot import Model, Robot
from ballbot.mechanics.compiled import FAST
from ballbot.mechanics.engine import simulate_lanes
from ballbot.mechanics.lanes import LANES, ROWS, STATE, STEP, TORQUE, TRIAL
from ballbot.mechanics.parameters import load
from ballbot.mechanics.smooth import runge_kutta_step
from ballbot.mechanics.smooth_block import begin_steps, smooth_block
from ballbot.mechanics.steps import load_state, load_torques
from ballbot.robot import Friction

FRICTION = Friction(
    viscous=(0.014, 0.016, 0.013),
    coulomb=(0.11, 0.09, 0.12),
    stribeck=(0.05, 0.04, 0.06),
    stribeck_speed=0.6,
    stribeck_exponent=1.1,
    rolling=0.007,
)


@njit(error_model="numpy", fastmath=FAST)
def _in_one_piece(selected, work, lane):
    """The step as a GPU's thread takes it."""
    P, state, u = (
        load(selected, work, lane),
        load_state(selected, work, lane),
        load_torques(selected, work, lane),
    )
    return runge_kutta_step(selected, P, state, u, work[STEP * LANES + lane])


@njit
def _in_a_block(selected, work, width):
    begin_steps(selected, work, width)
    smooth_block(selected, work, width)


def random_states(count: int, rng: np.random.Generator) -> np.ndarray:
    """Return states from leaning upright to nearly fallen, at any heading, slow to fast."""
    states = np.zeros((count, 10))
    states[:, 2:4] = rng.uniform(-1.1, 1.1, (count, 2))
    states[:, 4] = rng.uniform(-1e3, 1e3, count)
    states[:, 5:] = rng.normal(size=(count, 5)) * 10.0 ** rng.uniform(-3, 0.5, (count, 1))
    return states


def test_the_stages_of_a_block_are_the_step_in_one_piece() -> None:
    rng = np.random.default_rng(5)
    model = Model(Robot.load("alten").replace(friction=FRICTION))
    work = np.zeros(ROWS * LANES)
    lanes = work.reshape(ROWS, LANES)
    lanes[: len(model.packed)] = model.packed[:, None]
    lanes[STATE : STATE + 10] = random_states(LANES, rng).T
    lanes[TORQUE : TORQUE + 3] = rng.normal(size=(3, LANES))
    lanes[STEP] = 1e-3
    _in_a_block(model.selected, work, LANES)
    for lane in range(LANES):
        end, _ = _in_one_piece(model.selected, work, lane)
        # the same operations, summed in another order: rounding, relative to each state's largest number
        assert np.abs(lanes[TRIAL : TRIAL + 10, lane] - end).max() < 1e-14 * np.abs(end).max()


def test_a_robot_s_motion_does_not_depend_on_its_neighbours() -> None:
    """Robots that slide, stick and fall, sorted within their blocks by what they do, against each one alone."""
    rng = np.random.default_rng(6)
    model = Model(Robot.load("alten").replace(friction=FRICTION))
    robots = 2 * LANES - 5  # a whole block and one with empty lanes
    starts = random_states(robots, rng)
    starts[:, 2:] *= rng.choice([0.0, 0.01, 1.0], (robots, 1))  # some at rest
    torques = rng.normal(size=(robots, 20, 3)) * rng.choice([0.0, 0.1, 1.0], (robots, 1, 1))
    common = {"sample_time": 0.005, "steps": 5}
    together = simulate_lanes(
        model.selected,
        parameters=model.packed[None],
        parameter_of=np.zeros(robots, int),
        initial=starts,
        torques=torques,
        **common,
    )
    for i in range(robots):
        alone = simulate_lanes(
            model.selected,
            parameters=model.packed[None],
            initial=starts[i : i + 1],
            torques=torques[i : i + 1],
            **common,
        )
        assert alone.ended[0] == together.ended[i]
        # one lane's code rounds elsewhere than eight's; 100 steps of an unstable robot let it grow a hundredfold
        scale = 1.0 + np.abs(alone.states[0, :, [4]]).max()
        assert np.abs(alone.states[0] - together.states[i]).max() < 1e-10 * scale
