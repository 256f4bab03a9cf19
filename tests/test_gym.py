"""Gymnasium's environments: its own checkers, and its own vectors of the single environment as the oracle."""

import os
import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.error import InvalidAction
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from numpy.testing import assert_allclose, assert_array_equal

import ballbot.gym
from ballbot import InputError
from ballbot.learning.tasks import TASKS

NAMES = [f"ballbot/{name}-v0" for name in TASKS]
MODES = [mode.value for mode in AutoresetMode]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_gymnasiums_checker_passes_without_a_warning(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(name).unwrapped, skip_render_check=True)  # OpenGL may be missing


@pytest.mark.slow
@pytest.mark.parametrize("options", [{"base": "nominal"}, {"observe": "state"}, {"randomize": "boxes"}])
def test_the_checker_passes_on_the_twin(options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make("ballbot/Push-v0", plant="twin", **options).unwrapped
        check_env(env, skip_render_check=True)


def same(mine, its, where=""):
    """Compare what two vectors return, to the rounding of single precision."""
    if isinstance(its, dict):
        assert mine.keys() == its.keys(), where
        for key in its:
            same(mine[key], its[key], f"{where}/{key}")
    elif its.dtype == object:
        for a, b in zip(mine, its, strict=True):
            assert (a is None) == (b is None), where
            if b is not None:
                assert_allclose(a, b, atol=1e-4, err_msg=where)
    else:
        assert mine.dtype == its.dtype, where
        assert_allclose(mine, its, atol=1e-4, err_msg=where)


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_the_vector_does_as_gymnasiums_own_vector_of_single_environments(mode):
    options = {"num_envs": 3, "randomize": "boxes"}
    mine = gymnasium.make_vec("ballbot/Track-v0", autoreset_mode=mode, **options)
    its = gymnasium.make_vec(
        "ballbot/Track-v0", vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **options
    )
    assert mine.metadata["autoreset_mode"] == its.metadata["autoreset_mode"] == AutoresetMode(mode)
    assert mine.observation_space == its.observation_space
    assert mine.action_space == its.action_space
    same(mine.reset(seed=5)[1], its.reset(seed=5)[1])
    ends, random = 0, np.random.default_rng(1)
    for _ in range(120):
        actions = random.uniform(-0.2, 0.2, (3, 3)).astype(np.float32)
        results = mine.step(actions), its.step(actions)
        for a, b in zip(*results, strict=True):
            same(a, b)
        ended = results[0][2] | results[0][3]
        ends += ended.sum()
        if mode == "Disabled" and ended.any():
            results = (each.reset(options={"reset_mask": ended}) for each in (mine, its))
            for a, b in zip(*results, strict=True):
                if isinstance(a, np.ndarray):
                    same(a, b)
    assert ends >= 3


@pytest.mark.slow
def test_an_episode_that_runs_out_of_time_is_truncated():
    task = TASKS["Balance"].__class__(name="Balance", duration=0.05)
    env = gymnasium.make("ballbot/Balance-v0", task=task, base="nominal")
    env.reset(seed=1)
    ends = [env.step(np.zeros(3))[2:4] for _ in range(5)]
    assert ends == [*4 * [(False, False)], (False, True)]


@pytest.mark.slow
def test_wrong_actions_raise_gymnasiums_error_and_leave_the_robot_as_it_is():
    env, other = (gymnasium.make("ballbot/Balance-v0").unwrapped for _ in range(2))
    for each in (env, other):
        each.reset(seed=2)
    with pytest.raises(InvalidAction, match=r"shape \(2,\); it must have \(3,\)"):
        env.step(np.zeros(2))
    with pytest.raises(InvalidAction, match="must be finite"):
        env.step(np.array([0.0, np.nan, 0.0]))
    with pytest.raises(InvalidAction, match="must be numbers"):
        env.step("left")
    assert_array_equal(env.step(np.zeros(3))[0], other.step(np.zeros(3))[0])


@pytest.mark.slow
def test_wrong_actions_of_a_lane_leave_all_lanes_as_they_are():
    envs, others = (gymnasium.make_vec("ballbot/Balance-v0", num_envs=3) for _ in range(2))
    for each in (envs, others):
        each.reset(seed=2)
    actions = np.zeros((3, 3), np.float32)
    actions[2, 0] = np.inf
    with pytest.raises(InvalidAction, match="must be finite"):
        envs.step(actions)
    with pytest.raises(InvalidAction, match=r"shape \(3,\)"):
        envs.step(np.zeros(3))
    assert_array_equal(envs.step(np.zeros((3, 3)))[0], others.step(np.zeros((3, 3)))[0])


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"plant": "twins"}, "did you mean 'twin'"),
        ({"observe": "everything"}, "it is one of"),
        ({"task": "walk"}, "There is no task 'walk'"),
        ({"base": lambda *given: given[1][:3]}, "must be a ballbot.Controller"),
        ({"randomize": "nowhere"}, "it can only be 'boxes'"),
    ],
)
def test_wrong_options_are_refused_in_a_sentence(options, sentence):
    with pytest.raises(InputError, match=sentence):
        ballbot.gym.BallbotEnv(**options)


#: prints the shape of a picture and the share of it that another state changes
DRAWN = """
import gymnasium, numpy as np, ballbot.gym
env = gymnasium.make("ballbot/Balance-v0", render_mode="rgb_array")
env.reset(seed=1)
first = env.render()
for _ in range(30):
    env.step(np.ones(3, np.float32))
print(*first.shape, np.mean(first != env.render()))
env.close()
"""


@pytest.mark.slow
def test_another_state_gives_another_picture():
    done = subprocess.run(
        [sys.executable, "-c", DRAWN],
        env=os.environ | {"MUJOCO_GL": "egl"},  # which MuJoCo reads as it is imported
        capture_output=True,
        text=True,
    )
    if "finds no OpenGL" in done.stderr:
        pytest.skip("no OpenGL by EGL")
    *shape, changed = map(float, done.stdout.split())
    assert shape == [480, 480, 3]
    assert changed > 0.05


def test_an_unknown_render_mode_is_named():
    with pytest.raises(InputError, match="'ansi'"):
        ballbot.gym.BallbotEnv(render_mode="ansi")
