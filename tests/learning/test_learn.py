"""A learned controller: its file, its end by the user, and its policy in the law as it was in the training."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot.control.controller import torque_of_lean
from ballbot.control.file import read_controller, write_controller
from ballbot.control.presets import precise_controller
from ballbot.control.presets.nominal import design_gain
from ballbot.control.presets.precise import PRECISE_STATE_WEIGHTS
from ballbot.errors import InputError
from ballbot.fitting.run import Run
from ballbot.learning.lanes import TaskLanes
from ballbot.learning.learn import base_controller, confirm, film, learn, policy_of, start_law
from ballbot.learning.ppo import Training, forward, new_layers, random_of
from ballbot.learning.ppo import new_actor as new_start
from ballbot.learning.tasks import task_named
from ballbot.twin.scenario import Scenario
from tests.learning.test_lanes import ROBOTS

KNOWN = ROBOTS[0].imperfections.known or ROBOTS[0].model.robot
SMALL = Training(lanes=40, decisions=8, updates=2, batches=2)


def controller_of(lanes, actor, *, residual=False, scale=3.0):
    base = base_controller(KNOWN)
    policy = policy_of(actor, lanes, torque_scale=scale, residual=residual)
    policy = replace(policy, largest_lean=lanes.task.fallen)  # so that it acts wherever it is tried here
    return base.with_parts(replace(base.parts, policy=policy))


def new_actor(lanes, last=0.3):
    return new_layers((lanes.observations.shape[1], 64, 64, 3), np.random.default_rng(4), last=last)


@pytest.mark.parametrize("task", ["balance", "track"])
def test_law_decides_what_the_network_did_in_the_training(task):
    lanes = TaskLanes(ROBOTS, task_named(task), lanes=40, seed=3)
    actor = new_actor(lanes)
    controller = controller_of(lanes, actor)
    lanes.start()
    for _ in range(40):
        decided = 3.0 * forward(actor, lanes.observations)[0].astype(np.float64)
        wanted = np.clip(decided, -lanes.torque_limit, lanes.torque_limit)
        reference = np.where(np.arange(10) < 5, lanes.references[7], 0.0)
        found = [controller.update(0.0, lanes.states[7], reference) for _ in range(lanes.repeat)]
        # the network is evaluated in single precision there, in double precision here
        np.testing.assert_allclose(found, [wanted[7]] * lanes.repeat, atol=1e-5 * lanes.torque_limit)
        lanes.step(decided)
    lanes.close()


def test_linear_law_acts_beyond_the_lean_of_the_training():
    lanes = TaskLanes(ROBOTS, task_named("balance"), lanes=1)
    controller, base = controller_of(lanes, new_actor(lanes)), base_controller(KNOWN)
    for lean, alike in ((0.1, False), (0.36, True)):
        state = np.array([0.0, 0.0, lean, *7 * [0.0]])
        torques = [law.update(0.0, state, np.zeros(10)) for law in (controller, base)]
        controller.reset()
        assert np.array_equal(*torques) == alike


def test_policy_added_to_a_law_adds_its_torques():
    lanes = TaskLanes(ROBOTS, task_named("balance"), lanes=1)
    actor, base = new_actor(lanes, last=0.05), base_controller(KNOWN)
    state = np.array([0.0, 0.0, 0.01, *7 * [0.0]])
    alone, added = (
        controller_of(lanes, actor, residual=residual).update(0.0, state, np.zeros(10))
        for residual in (False, True)
    )
    np.testing.assert_allclose(added, alone + base.update(0.0, state, np.zeros(10)), atol=1e-12)


def test_learned_controller_is_read_from_its_file_as_it_was(tmp_path):
    learned = learn(ROBOTS, task_named("balance"), training=SMALL)
    write_controller(learned.controller, tmp_path / "controller.toml")
    read = read_controller(tmp_path / "controller.toml", KNOWN)
    np.testing.assert_array_equal(read.packed, learned.controller.packed)
    scenario = Scenario.named("nominal", KNOWN)
    tried = confirm(read, task_named("balance"), KNOWN, scenario, runs=2, duration=1.0)
    assert (tried.plant, tried.runs) == ("loop", 2)
    assert len(learned.plot().axes) == 2
    assert "1,280 samples" in repr(learned)
    assert [point.samples for point in learned.curve] == [640, 1280]


def test_stopped_by_the_user_it_keeps_what_it_has_and_acts_where_it_recovers(monkeypatch):
    def recovers(tried, _, sizes):
        policy = tried.parts.policy
        kept = sizes < 10.0 if policy is None else policy.largest_lean < 0.06 and sizes < 8.0
        return np.broadcast_to(kept, sizes.shape)

    def stop(progress):
        if progress.done == 1:
            raise KeyboardInterrupt

    monkeypatch.setattr("ballbot.learning.learn._recovers", recovers)
    learned = learn(ROBOTS, task_named("drive"), training=SMALL, run=Run(seed=0, progress=stop))
    assert learned.stopped
    assert len(learned.curve) == 1
    policy = learned.controller.parts.policy
    assert policy is not None
    # the largest share that is tried below a half
    assert (policy.largest_lean, policy.largest_speed) == pytest.approx((0.35 * 0.12, 0.35 * 2.0))


def test_film_has_the_robot_after_the_seconds_of_learning(monkeypatch):
    clock = iter([0.0, 4.0, 9.0, 14.0, 20.0, 25.0, 30.0])
    monkeypatch.setattr("ballbot.learning.learn.monotonic", lambda: next(clock))
    learned = learn(ROBOTS, task_named("balance"), training=replace(SMALL, updates=6))
    assert list(learned.stages) == [0.0, 4.0, 9.0, 30.0]
    np.testing.assert_array_equal(learned.stages[30.0].packed, learned.controller.packed)
    runs = film(learned, KNOWN, Scenario.named("nominal", KNOWN))
    assert list(runs) == [f"{seconds} s" for seconds in (0, 4, 9, 30)]
    assert not runs["0 s"].ended


def test_training_starts_as_the_gain_with_a_bounded_lean_command():
    lanes = TaskLanes(ROBOTS, task_named("balance"), lanes=1)
    scale = 2.0 * lanes.torque_limit
    actor = new_start(lanes, SMALL, random_of(0), start_law(lanes, scale))
    controller = controller_of(lanes, actor, scale=scale)
    gain = design_gain(
        KNOWN, state_weights=(8000.0, 8000.0, *PRECISE_STATE_WEIGHTS[2:]), sample_time=0.01
    ).gain

    def torques(place, size):
        state = np.zeros(10)
        state[place] = size
        controller.reset()
        return controller.update(0.0, state, np.zeros(10))

    for place, size in enumerate((1e-3, 1e-3, 1e-3, 1e-3, 1e-2, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2)):
        # the other units are random with outputs of a hundredth
        np.testing.assert_allclose(torques(place, size), -gain[:, place] * size, atol=0.02)
    # farther away it commands no more than half of the lean that the torque limit holds
    lean = 0.5 * (lanes.torque_limit - max(KNOWN.friction.breakaway)) / torque_of_lean(KNOWN)
    bound = np.linalg.norm(gain[:, 3]) * lean
    assert np.linalg.norm(torques(0, 0.5)) < bound + 0.05
    assert np.linalg.norm(gain[:, 0]) * 0.5 > 1.5 * bound


def test_policy_for_another_sample_time_is_refused():
    base = precise_controller(KNOWN)
    slow = base_controller(KNOWN.replace({"sensors.sample_time": 0.01}))
    with pytest.raises(InputError, match=r"0\.01 s"):
        learn(ROBOTS, task_named("balance"), base=slow, training=SMALL)
    learned = learn(ROBOTS, task_named("balance"), base=base, training=replace(SMALL, updates=1))
    policy = learned.controller.parts.policy
    assert policy is not None
    assert policy.feedback == 1.0


@pytest.mark.parametrize(
    ("other", "named"), [(KNOWN.replace(name="other"), "'alten', not for 'other'"),
                         (KNOWN.replace({"drive.torque_limit": 1.0}), "up to 1.5 N m"),
                         (KNOWN.replace({"sensors.sample_time": 0.01}), "samples of 0.005 s")],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore::ballbot.errors.UnsuitedController")
def test_policy_of_another_robot_is_refused_where_its_file_is_read(tmp_path, other, named):
    lanes, base = TaskLanes(ROBOTS, task_named("balance"), lanes=1), base_controller(KNOWN)
    write_controller(controller_of(lanes, new_actor(lanes)), tmp_path / "controller.toml")
    write_controller(base, tmp_path / "linear.toml")
    with pytest.raises(InputError, match=f"learned for .*{named}.*ballbot learn"):
        read_controller(tmp_path / "controller.toml", other)
    read_controller(tmp_path / "controller.toml", KNOWN.replace({"body.mass": 1.2 * KNOWN.body.mass}))
    text = (tmp_path / "controller.toml").read_text()
    assert "\nversion = 0\n" in text
    (tmp_path / "controller.toml").write_text(text.replace("\nversion = 0\n", "\nversion = 7\n"))
    with pytest.raises(InputError, match=r"controller\.toml: .* version 7 "):
        read_controller(tmp_path / "controller.toml", KNOWN)
    read_controller(tmp_path / "linear.toml", other)  # a design is only warned of


@pytest.mark.parametrize(
    ("change", "named"), [({"last": np.zeros((4, 65))}, "3 wheels"), ({"first": np.zeros((64, 19))}, "shapes"),
                          ({"period": 0.0075}, "0.0075"), ({"torque_scale": np.nan}, "torque_scale"),
                          ({"version": 7}, "version 7 .* here it is version 0. Learn one again")],
)  # fmt: skip
def test_impossible_policy_is_refused(change, named):
    lanes = TaskLanes(ROBOTS, task_named("balance"), lanes=1)
    policy = policy_of(new_actor(lanes), lanes, torque_scale=3.0, residual=False)
    if "last" in change:
        change = change | {"first": np.zeros((64, 10 + 3 * 4 + 1))}
    base = base_controller(KNOWN)
    with pytest.raises(InputError, match=named):
        base.with_parts(replace(base.parts, policy=replace(policy, **change)))
