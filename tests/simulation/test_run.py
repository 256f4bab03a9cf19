"""A plant in closed loop: what the log's rows mean, how a run ends, and what is refused."""

import numpy as np
import pytest

from ballbot import Controller, InputError, Log, Model, simulate
from ballbot.control.presets import nominal_controller
from ballbot.control.references import hold, square
from ballbot.mechanics.geometry import body_rates_matrix
from ballbot.simulation.run import initial_state_of
from tests.support.control_examples import FRICTION, alten, leaning


def limp(_t, _state, _reference):
    return np.zeros(3)


@pytest.fixture(scope="module")
def model() -> Model:
    return Model(alten(FRICTION))


@pytest.fixture(scope="module")
def log(model) -> Log:
    controller = nominal_controller(model.robot, compensation="full")
    return simulate(model, controller, square(), duration=9.0, initial_state=leaning(0.05, 0.02))


def test_a_row_is_what_was_measured_and_the_torque_held_from_there(model, log):
    assert len(log) == 1800
    np.testing.assert_allclose(log.t, 0.005 * np.arange(1800), atol=1e-9)
    controller = nominal_controller(model.robot, compensation="full")
    for k in (0, 17, 1700):
        np.testing.assert_array_equal(log.torques[k], controller.update(0.0, log.states[k], log.reference[k]))
        ahead = model.advance(log.states[k], log.torques[k], 0.005)
        np.testing.assert_array_equal(ahead, log.states[k + 1])


def test_the_models_sensors_are_perfect(model, log):
    np.testing.assert_array_equal(log.truth().states, log.states)
    q, q_dot = log.states[:, :5], log.states[:, 5:]
    np.testing.assert_allclose(log.wheel_speeds, model.wheel_speed(q, q_dot), atol=1e-12)
    turned = np.diff([log["wheel1"], log["wheel2"], log["wheel3"]], axis=1).T
    np.testing.assert_allclose(
        turned / 0.005, 0.5 * (log.wheel_speeds[1:] + log.wheel_speeds[:-1]), atol=1e-9
    )
    B = body_rates_matrix(*q[:, 2:].T)
    gyro = np.stack([log["gyro_x"], log["gyro_y"], log["gyro_z"]], axis=1)
    np.testing.assert_allclose(gyro, np.einsum("tij,tj->ti", B, q_dot[:, 2:]), atol=1e-12)


def test_fall_ends_the_log_and_is_reported():
    model = Model(alten())
    log = simulate(model, limp, hold(), duration=5.0, initial_state=leaning(0.01))
    assert log.ended is not None
    assert "at t =" in log.ended
    assert log.t[-1] < 2.0
    assert np.abs(log.states[:, 2:4]).max() < 1.2
    # the unstable pole is 5.20 rad/s: 0.01 cosh(5.20 t) while the lean is small
    early = log.t < 0.4
    np.testing.assert_allclose(log["theta"][early], 0.01 * np.cosh(5.2015 * log.t[early]), rtol=2e-3)
    kept = (log.truth(), log.without_truth(), log.with_columns({"ref_x": log.t}))
    assert [one.ended for one in kept] == [log.ended] * 3
    assert simulate(model, nominal_controller(model.robot), hold(), duration=1.0).ended is None


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (lambda *_: np.zeros(4), r"shape \(4,\) at t = 0 s; the robot has 3 wheels"),
        (lambda *_: 0.0, r"shape \(\)"),
    ],
)
def test_invalid_torques_are_refused(model, answer, sentence):
    with pytest.raises(InputError, match=sentence):
        simulate(model, answer, hold(), duration=1.0)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        *(({"duration": one}, "at least one sample") for one in (-1.0, np.nan, np.inf)),
        ({"duration": 1e9}, r"32 years has 2e\+11 samples of 0.005 s, .*\. At most 93 minutes"),
        *(({"initial_state": one}, "initial") for one in (np.zeros(9), np.full(10, np.nan), leaning(1.3))),
    ],
)
def test_impossible_runs_are_refused(model, asked, words):
    with pytest.raises(InputError, match=words):
        simulate(model, nominal_controller(model.robot), hold(), **({"duration": 1.0} | asked))


@pytest.mark.parametrize("friction", [None, FRICTION], ids=["without friction", "with friction"])
@pytest.mark.parametrize("seed", range(2))
def test_controllers_that_cannot_work_fall_from_the_default_start(friction, seed):
    robot = alten() if friction is None else alten(friction)
    good = nominal_controller(robot)
    for controller in (Controller(robot, -good.gain), limp):
        assert simulate(robot, controller, hold(), duration=5.0, seed=seed).ended is not None
    log = simulate(robot, good, hold(), duration=5.0, seed=seed)
    assert log.ended is None
    np.testing.assert_array_equal(log.states[0], initial_state_of(seed))
    assert 0.0 < np.abs(log.states[0, 2:4]).max() <= 0.02


def test_start_that_a_caller_states_counts():
    log = simulate("alten", "nominal", "hold", duration=0.1, initial_state=np.zeros(10))
    assert not log.states.any()
