"""Many robots in closed loop: the same numbers as one at a time."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot import Controller, InputError, Model, simulate, simulate_batch
from ballbot.control.presets import design_gain, nominal_controller
from ballbot.control.references import hold, square
from ballbot.simulation.imperfections import Imperfections
from tests.support.control_examples import FRICTION, alten, four_wheeled, leaning


@pytest.mark.parametrize("compensation", ["full", "partial"])
@pytest.mark.parametrize(
    "robot",
    [
        pytest.param(alten(FRICTION), id="three"),
        # compiles the engine of four wheels
        pytest.param(four_wheeled(friction=True), id="four", marks=pytest.mark.sample),
    ],
)
def test_a_lane_is_a_run_of_its_own(robot, compensation):
    model = Model(robot)
    controller = nominal_controller(robot, compensation=compensation)
    starts = 0.02 * np.random.default_rng(1).normal(size=(3, 10))
    batch = simulate_batch(model, controller, square(period=8.0), duration=3.0, initial_states=starts)
    assert batch.survived.all()
    for lane, start in enumerate(starts):
        log = simulate(model, controller, square(period=8.0), duration=3.0, initial_state=start)
        # vector code rounds in another order, and a balancing robot's rounding stays small
        np.testing.assert_array_equal(batch.t, log.t)  # rows of both are at the same instants
        np.testing.assert_allclose(batch.states[lane], log.states, atol=1e-7)
        np.testing.assert_array_equal(batch.log(lane).t, log.t)
        np.testing.assert_allclose(batch.torques[lane], log.torques, atol=1e-6)


def test_every_lane_has_its_own_robot_start_and_controller():
    # more than one block of lanes
    robots = [alten(FRICTION), alten(), alten(replace(FRICTION, rolling=0.0))] * 15
    robots = [r.replace({"body.mass": r.body.mass * (1.0 + 0.003 * i)}) for i, r in enumerate(robots)]
    gains = [design_gain(alten(), torque_weight=30.0 + i).gain for i in range(45)]
    controllers = [
        Controller(robot, gains[i], compensation="full", torque_limit=2.0 + i)
        for i, robot in enumerate(robots)
    ]
    starts = np.array([leaning(0.002 * i, -0.001 * i) for i in range(45)])
    models = [Model(robot) for robot in robots]
    batch = simulate_batch(models, controllers, hold(), duration=1.0, initial_states=starts, every=0)
    np.testing.assert_array_equal(batch.states[:, 0], starts)
    for lane in (0, 7, 31, 32, 44):
        one = simulate_batch(
            models[lane], controllers[lane], hold(), duration=1.0, initial_states=starts[lane], every=200
        )
        np.testing.assert_allclose(batch.finals[lane], one.finals[0], atol=1e-9)


def test_threads_change_no_bit():
    model = Model(alten(FRICTION))
    controller = nominal_controller(model.robot, compensation="partial")
    starts = 0.02 * np.random.default_rng(2).normal(size=(70, 10))
    one, two = (
        simulate_batch(
            model, controller, square(), duration=1.0, initial_states=starts, every=10, threads=threads
        )
        for threads in (1, 2)
    )
    np.testing.assert_array_equal(one.states, two.states)
    np.testing.assert_allclose(one.t, 0.05 * np.arange(20))


def test_lanes_end_as_runs_do():
    model = Model(alten())
    controller = Controller(model.robot, np.zeros((3, 10)))
    thrown = leaning(0.5)
    thrown[7] = 9.0  # centripetal acceleration of the centre of mass: l 81 cos(0.5) > g (m_b + m_r)/m_r
    starts = np.array([leaning(0.0), leaning(0.01), leaning(0.3, 0.2), thrown])
    batch = simulate_batch(model, controller, hold(), duration=3.0, initial_states=starts)
    np.testing.assert_array_equal(batch.survived, [True, False, False, False])
    np.testing.assert_array_equal(batch.lifted, [False, False, False, True])
    for lane in (1, 2, 3):
        log = simulate(model, controller, hold(), duration=3.0, initial_state=starts[lane])
        assert log.ended is not None
        assert batch.lifted[lane] == log.ended.startswith("lifted")
        assert f"{batch.ended[lane]:.3f} s" in log.ended
        frozen = batch.states[lane, batch.t >= batch.ended[lane] - 1e-9]
        np.testing.assert_array_equal(frozen, np.broadcast_to(batch.finals[lane], frozen.shape))


THREE = {"initial_states": np.zeros((3, 10))}
ALTEN, NOMINAL = Model(alten()), nominal_controller(alten())


@pytest.mark.parametrize(
    ("models", "controllers", "reference", "more", "words"),
    [
        ([ALTEN] * 2, NOMINAL, hold(), THREE, "3 initial states, 2 models, 1 controllers"),
        (ALTEN, NOMINAL, hold(), THREE | {"imperfections": [Imperfections()] * 2}, "2 imperfections"),
        *(
            ([ALTEN, other], NOMINAL, hold(), {}, "models are of 2 kinds")
            for other in (Model(alten(), "thesis"), Model(alten(), step=2e-3), Model(alten(), pivoting=0.01))
        ),
        ([], NOMINAL, hold(), {}, "sequence of models is empty"),
        (ALTEN, [NOMINAL, Controller(alten(), NOMINAL.gain, sample_time=0.01)], hold(), {}, "sample times"),
        (ALTEN, nominal_controller(four_wheeled(friction=False)), hold(), {}, "wheels"),
        (ALTEN, NOMINAL, lambda _: leaning(0.1), {}, r"theta = 0\.1.*A r"),
        (ALTEN, NOMINAL, lambda _: np.full(10, np.nan), {}, "not finite"),
        (ALTEN, NOMINAL, lambda _: np.zeros(3), {}, "10 numbers"),
    ],
)
def test_inconsistent_batches_are_refused(models, controllers, reference, more, words):
    with pytest.raises(InputError, match=words):
        simulate_batch(models, controllers, reference, duration=1.0, **more)
