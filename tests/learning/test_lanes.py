"""Robots side by side that are commanded from outside: the loop's numbers, their tasks, their streams."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ballbot import Controller, InputError, simulate_batch
from ballbot.control.law import MEMORY_SIZE, control_law
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.references import hold
from ballbot.learning.lanes import SAME_STEP, TaskLanes
from ballbot.learning.robots import drawn_robots
from ballbot.learning.tasks import SCALES, TASKS, task_named
from ballbot.mechanics.geometry import rotation
from ballbot.robot import Robot
from ballbot.simulation import batch
from ballbot.simulation.loop import Draws
from ballbot.simulation.sensors import SensorFaults
from ballbot.twin import Scenario
from ballbot.twin.faults import Timing

ALTEN = Robot.load("alten")
SCENARIO = replace(
    Scenario.nominal(ALTEN),
    sensor_faults=SensorFaults(gyro_bias=0.002, gyro_bias_walk=1e-4, lean_error=0.003, latency=0.005),
    timing=Timing(delay=1),
)
ROBOTS = drawn_robots(ALTEN, SCENARIO, None)
CONTROLLER = nominal_controller(ALTEN).with_estimator("kalman")


def made(task="balance", lanes=3, **options):
    return TaskLanes(ROBOTS, task_named(task), lanes=lanes, threads=options.pop("threads", 1), **options)


@pytest.mark.slow
def test_a_base_controller_with_the_same_random_numbers_gives_what_simulate_batch_gives(monkeypatch):
    """45 lanes are two blocks; a robot has all of the sensors' faults, play, noise and delay."""
    lanes, samples = made(lanes=45, base=CONTROLLER, repeat=1), 300
    lanes.start()
    starts, draws = lanes._world.inputs.initial.copy(), lanes._world.draws
    noise, faults = [draws.noise[:, :6].copy()], [draws.faults.copy()]
    truths, seen, torques = [], [], []
    for _ in range(samples):
        seen.append(lanes.states.copy())
        lanes.step(np.zeros((45, 3)))
        noise += [draws.noise[:, 6:].copy(), draws.noise[:, :6].copy()]
        faults.append(draws.faults[:, 5:].copy())
        truths.append(lanes.truths.copy())
        torques.append(lanes._world.memory.commanded.copy())
    assert not lanes.ended.any()
    noise, faults = np.concatenate(noise, axis=1), np.concatenate(faults, axis=1)
    first = iter((0, 40))

    def same_numbers(_, width, **__):
        rows = slice(start := next(first), start + width)
        given = (one[rows] for one in (noise, faults, draws.positions, draws.turns))
        return Draws(*given, durations=np.zeros((width, 0)), samples=samples)

    monkeypatch.setattr(batch, "draws_of", same_numbers)
    expected = simulate_batch(
        ROBOTS[0].model,
        CONTROLLER,
        hold(),
        duration=samples * lanes.sample_time,
        initial_states=starts,
        imperfections=ROBOTS[0].imperfections,
        threads=1,
    )
    assert_allclose(np.stack(torques, axis=1), expected.commanded, atol=1e-9)
    assert_allclose(np.stack(seen, axis=1), expected.seen, atol=1e-9)
    assert_allclose(np.stack(truths, axis=1), expected.next_states, atol=1e-9)


@pytest.mark.slow
def test_a_base_controller_is_shown_poses_as_on_a_course_and_its_torque_limit_holds():
    base = precise_controller(ROBOTS[0].model.robot)
    task, memory, expected = replace(TASKS["Drive"], grip=1e9), np.zeros(MEMORY_SIZE), np.zeros(3)
    lanes = TaskLanes(ROBOTS, task, lanes=3, base=base, repeat=1, threads=1)
    lanes.start()
    for action in [*100 * [0.0], *3 * [5.0]]:
        seen = lanes.states[0].copy()
        lanes.step(np.full((3, 3), action))
        pose = np.where(np.isin(np.arange(10), (0, 1, 4)), lanes.references[0], 0.0)
        control_law(base.packed, memory, seen, pose, expected)
        expected = np.clip(expected + action, -base.torque_limit, base.torque_limit)
        memory[:3] = expected  # the torques that act
        assert_allclose(lanes._world.memory.commanded[0], expected, atol=1e-9)
    assert np.any(lanes.references[0, 5:7])


@pytest.mark.slow
def test_lanes_are_the_same_bit_for_bit_in_any_number_of_threads():
    random, runs = np.random.default_rng(1), []
    torques = random.uniform(-2.0, 2.0, (60, 130, 3))
    for threads in (1, 2, 3):
        lanes, kept = made("drive", lanes=130, threads=threads), []
        lanes.start()
        for row in torques:
            lanes.step(row, ending=SAME_STEP)
            kept.append((lanes.observations.copy(), lanes.rewards.copy(), lanes.ended.copy()))
        lanes.close()
        runs.append(kept)
    assert np.any([ended for *_, ended in runs[0]])
    for other in runs[1:]:
        for mine, its in zip(runs[0], other, strict=True):
            for a, b in zip(mine, its, strict=True):
                assert_array_equal(a, b)


@pytest.mark.slow
def test_an_episode_does_not_depend_on_the_one_before():
    used, fresh = made(lanes=7), made(lanes=7)
    used.start()
    for _ in range(40):
        used.step(np.full((7, 3), 0.3))
    for lanes in (used, fresh):
        for lane in range(7):
            lanes.reseed(lane, 100 + lane)
        lanes.start()
    for _ in range(40):
        for lanes in (used, fresh):
            lanes.step(np.full((7, 3), 0.3))
        assert_array_equal(used.observations, fresh.observations)
        assert_array_equal(used.truths, fresh.truths)


@pytest.mark.slow
def test_observation_and_reward_are_those_of_the_documented_formulas():
    lanes, random = made("drive", lanes=5, repeat=1), np.random.default_rng(2)
    lanes.start()
    limit, past = lanes.torque_limit, np.zeros((4, 5, 3))
    drives = lanes.robot.drive.torque_limit
    assert limit < drives
    for _ in range(12):
        torques = random.uniform(-1.5 * limit, 1.5 * limit, (5, 3))
        past = np.concatenate([np.clip(torques, -limit, limit)[None], past[:-1]])
        lanes.step(torques)
    w = lanes.task.weights
    for lane in range(5):
        x, r, truth = lanes.states[lane], lanes.references[lane], lanes.truths[lane]
        turn = rotation(0.0, 0.0, x[4])[:2, :2].T
        error = r - x
        for pair in (slice(0, 2), slice(2, 4), slice(5, 7), slice(7, 9)):
            error[pair] = turn @ error[pair]
        expected = np.clip(error / SCALES, [-2.0, -2.0, *8 * [-4.0]], [2.0, 2.0, *8 * [4.0]])
        assert_allclose(lanes.observations[lane, :10], expected, atol=1e-6)
        assert_allclose(lanes.observations[lane, 10:], past[:3, lane].ravel() / limit, atol=1e-6)
        cost = (
            w.position * min(np.sum((r - truth)[:2] ** 2), 0.25) / 0.05**2
            + w.velocity * np.sum((r - truth)[5:7] ** 2) / 0.1**2
            + w.heading * (r - truth)[4] ** 2 / 0.1**2
            + w.lean_rate * np.sum(truth[7:9] ** 2) / 0.1**2
            + w.turning * truth[9] ** 2 / 0.2**2
            + w.torque_change * np.sum((past[0, lane] - past[1, lane]) ** 2) / (0.1 * drives) ** 2
        )
        reward = 0.005 * (w.upright + (1.0 - w.upright) / (1.0 + cost))
        assert_allclose(lanes.rewards[lane], reward, rtol=1e-9)


@pytest.mark.slow
def test_a_push_moves_the_robot_along_its_force():
    """Halfway through each lane's first push, against the same lane with pushes of nothing."""
    options = {"lanes": 200, "repeat": 1, "threads": 1, "estimator": None}
    pushed, calm = (
        TaskLanes(ROBOTS, replace(TASKS["Push"], impulse=size, interval=0.2), **options)
        for size in (8.0, 1e-9)
    )
    for lanes in (pushed, calm):
        lanes.start()
    pushes, moved = pushed._world.inputs.pushes[:, 0].copy(), np.zeros((200, 2))
    assert np.all(pushes[:, 0] < 40)
    forces = np.hypot(*pushes[:, 2:4].T)
    assert forces.max() < 80.0  # 8 N s in 0.1 s
    assert_allclose(forces.mean(), 40.0, atol=6.0)  # 3.7 standard errors of 200 uniform numbers
    for age in range(1, 60):
        for lanes in (pushed, calm):
            lanes.step(np.zeros((200, 3)))
        due = pushes[:, 0] + 4 == age
        moved[due] = (pushed.truths - calm.truths)[due, 5:7]
    assert np.all(np.sum(moved * pushes[:, 2:4], axis=1) > 0.0)


def test_robots_of_different_kinds_or_sample_times_are_refused():
    other = drawn_robots(ALTEN, replace(SCENARIO, backlash=0.0), None)
    with pytest.raises(InputError, match="of one kind"):
        TaskLanes([*ROBOTS, *other], TASKS["Balance"], lanes=2)
    slower = Controller(ALTEN, CONTROLLER.gain, sample_time=0.01)
    with pytest.raises(InputError, match=r"0\.01 s, the robot one of 0\.005 s"):
        TaskLanes(ROBOTS, TASKS["Balance"], lanes=2, base=slower)
