"""The Python interface as its users expect it: changed values, functions as controllers, packages, dictionaries."""

import json
from dataclasses import replace

import numpy as np
import pytest

import ballbot
from ballbot import InputError, Log, Model, Robot, simulate, simulate_batch
from ballbot.control.presets import nominal_controller
from ballbot.results import as_json
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin.imperfections import imperfections_of
from ballbot.twin.scenario import Scenario
from tests.support.control_examples import FRICTION, alten, leaning
from tests.test_summary import RESULTS

ROBOT = alten(FRICTION)


def test_values_are_replaced_by_dotted_name():
    changed = ROBOT.replace(
        {"body.mass": 9.0, "friction.coulomb": 0.2, "friction.viscous": [0.01, 0.02, 0.03]}
    )
    assert changed.body.mass == 9.0
    assert changed.friction.coulomb == (0.2, 0.2, 0.2)
    assert changed.friction.viscous == (0.01, 0.02, 0.03)
    assert changed.friction.stribeck == FRICTION.stribeck
    assert changed.ball == ROBOT.ball
    assert "body.mass" not in changed.sources
    assert changed.sources["ball.mass"] == ROBOT.sources["ball.mass"]


def test_a_function_is_a_controller():
    nominal = nominal_controller(ROBOT)
    by_function = simulate(Model(ROBOT), nominal.update, "hold", duration=1.0, seed=3)
    assert by_function.ended is None
    assert by_function.sample_time == pytest.approx(ROBOT.sensors.sample_time)
    by_object = simulate(Model(ROBOT), nominal, "hold", duration=1.0, seed=3)
    np.testing.assert_array_equal(by_function.states, by_object.states)


class Own:
    """The nominal controller as a user's own."""

    def __init__(self) -> None:
        self.inner = nominal_controller(ROBOT)
        self.sample_time, self.estimator = self.inner.sample_time, self.inner.estimator

    def reset(self):
        self.inner.reset()

    def update(self, t, state, reference):
        return self.inner.update(t, state, reference)


@pytest.mark.parametrize("imperfections", [None, Imperfections(delay=1, torque_noise=0.01, seed=4)])
def test_own_controllers_run_in_a_batch_as_compiled_ones_do(imperfections):
    starts = np.array([leaning(0.01), leaning(-0.02, 0.01), leaning(0.6, 0.6)])
    options = {"duration": 1.0, "initial_states": starts, "imperfections": imperfections, "every": 2}
    compiled, own = (
        simulate_batch(Model(ROBOT), one, "hold", **options) for one in (nominal_controller(ROBOT), Own())
    )
    np.testing.assert_array_equal(own.survived, compiled.survived)
    assert own.survived.tolist() == [True, True, False]
    np.testing.assert_array_equal(own.t, compiled.t)
    # lanes and one robot alone round in another order
    for name in ("states", "seen", "commanded", "wheel_speeds", "gyro"):
        np.testing.assert_allclose(getattr(own, name)[:2], getattr(compiled, name)[:2], atol=1e-6)
    np.testing.assert_allclose(own.torque_change[:2], compiled.torque_change[:2], rtol=0.02)


LINEAR = Model(Robot.load("alten")).linearize
LOG = Log({"t": np.array([0.0, 1.0]), "x": np.zeros(2), "y": np.zeros(2)})


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: LOG.select(["x", "y"]), r"select takes rows, such as log.select\(slice\(0, 100\)\)"),
        (lambda: LOG[["x", "y"]], "indexed by the name of one column"),
        (lambda: LOG[0:10], r"not by a slice; log.select\(slice\(0, 10\)\)"),
        (lambda: simulate(ROBOT, 5, "square", duration=1.0), "controller is given as .* of type int"),
        (lambda: simulate(ROBOT, "nominal", 5, duration=1.0), "reference is given as .* of type int"),
        (lambda: ballbot.loop_margins("nominal"), "loop_margins\\('nominal', robot='alten'\\)"),
        (
            lambda: ballbot.lqr(LINEAR().A, LINEAR().B, np.eye(10), np.eye(3)),
            r"lqr\(StateSpace\(A, B\), Q, R\)",
        ),
    ],
)
def test_refusal_says_what_to_give(call, sentence):
    with pytest.raises(InputError, match=sentence):
        call()


def test_misspelt_name_of_the_package_has_the_nearest():
    with pytest.raises(AttributeError, match="Did you mean 'Robot'"):
        ballbot.Robt  # noqa: B018


@pytest.mark.parametrize("name", ["batch", "gain", "controller design", "limits", "driveline"])
def test_results_are_dictionaries_that_json_holds(name):
    found = RESULTS[name]().to_dict()
    assert found
    assert json.loads(as_json(found))


def test_a_scenario_is_given_by_name_value_or_in_the_plant():
    found = Scenario.nominal(ROBOT)
    words = {"duration": 0.5, "seed": 3}
    by_name = simulate(ROBOT, "precise", "hold", scenario="nominal", **words)
    by_value = simulate(Model(ROBOT), "precise", "hold", scenario=found, **words)
    identified = replace(found, friction=ROBOT.friction, wheel_contact="point")
    plant = SensedPlant(Model(ROBOT), imperfections_of(identified), estimator="kalman")
    in_plant = simulate(plant, "precise", "hold", **words)
    np.testing.assert_array_equal(by_name.states, in_plant.states)
    np.testing.assert_array_equal(by_value.states, in_plant.states)
    with pytest.raises(InputError, match=r"Twin\(robot, scenario\)"):
        simulate(plant, "precise", "hold", scenario="nominal", **words)
