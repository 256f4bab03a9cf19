"""The Python interface as its users expect it: changed values, functions as controllers, packages, dictionaries."""

import json
from dataclasses import replace

import numpy as np
import pytest

import ballbot
from ballbot import InputError, Model, Robot, simulate, simulate_batch
from ballbot.cli.main import main
from ballbot.control.presets import nominal_controller
from ballbot.results import as_json
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin.imperfections import imperfections_of
from ballbot.twin.scenario import Scenario
from tests.support.control_examples import FRICTION, Altered, alten, leaning
from tests.test_summary import RESULTS

ROBOT = alten(FRICTION)


def test_functions_of_commands_take_names_and_own_controllers(tmp_path):
    course = '[mine.short]\nreference = "hold"\nduration = 7.0\n'
    (tmp_path / "courses.toml").write_text(course)
    controllers = {"none": "none", "mine": nominal_controller(ROBOT).update}
    league = ballbot.compare(ROBOT, controllers, courses=str(tmp_path / "courses.toml"), seeds=[3])
    assert league.controllers == ("none", "mine")
    assert [score.ended for name in controllers for score in league.scores["short", name]] == [None, None]


def test_export_writes_the_files_of_the_command(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("ballbot.cli.export.what_to_install", lambda: ["ziglang"])  # counts no instructions
    ballbot.export("nominal", "alten", lean=0.3).write(tmp_path / "python")
    assert main(["export", "nominal", "--robot", "alten", "--lean", "0.3", "--out", str(tmp_path / "c")]) == 0
    written = [path.relative_to(tmp_path / "python") for path in (tmp_path / "python").rglob("*.[ch]")]
    assert len(written) > 20
    for path in written:
        assert (tmp_path / "c" / path).read_bytes() == (tmp_path / "python" / path).read_bytes()
    assert "README.md" in capsys.readouterr().out


@pytest.mark.parametrize(
    "imperfections", [None, Imperfections(delay=1, torque_noise=0.01, missing=3, missing_from=50, seed=4)]
)
def test_own_controllers_run_in_a_batch_as_compiled_ones_do(imperfections):
    starts = np.array([leaning(0.01), leaning(-0.02, 0.01), leaning(0.6, 0.6)])
    both = [
        simulate_batch(
            Model(ROBOT),
            one,
            "hold",
            duration=1.0,
            initial_states=starts,
            imperfections=imperfections,
            every=2,
        )
        for one in (nominal_controller(ROBOT), Altered(nominal_controller(ROBOT)))
    ]
    compiled, own = both
    np.testing.assert_array_equal(own.survived, compiled.survived)
    assert own.survived.tolist() == [True, True, False]
    np.testing.assert_array_equal(own.t, compiled.t)
    # blocks of lanes and one robot alone round in another order
    for name in ("states", "seen", "commanded", "wheel_speeds", "gyro", "torque_change"):
        np.testing.assert_allclose(getattr(own, name), getattr(compiled, name), atol=1e-9)
    with pytest.raises(InputError, match="controller returned at t = 0 s"):
        simulate_batch(ROBOT, lambda *_: np.full(3, np.nan), "hold", duration=1.0)


def test_lqr_called_as_python_control_s_says_what_is_expected():
    linear = Model(Robot.load("alten")).linearize()
    with pytest.raises(InputError, match=r"lqr\(StateSpace\(A, B\), Q, R\)"):
        ballbot.lqr(linear.A, linear.B, np.eye(10), np.eye(3))


@pytest.mark.parametrize("name", ["batch", "gain", "controller design", "limits"])
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
