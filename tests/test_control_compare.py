"""Scores of runs and comparisons of controllers, from Python and from the command line."""

import json

import numpy as np
import pytest
from control_examples import FRICTION, alten

from ballbot import Controller, InputError, Log, Model
from ballbot.cli.main import main
from ballbot.control.nominal import nominal_controller
from ballbot.control.references import square
from ballbot.experiments.compare import compare, score, settled
from ballbot.robot.file import write_robot


def hand_made(**changes: np.ndarray) -> Log:
    """Return 20 s at 10 Hz: the reference jumps at 10 s, the robot is 3 cm, 4 cm off after 6 s."""
    t = np.arange(200) / 10.0
    zero = np.zeros(200)
    columns = {"t": t, "u1": zero, "u2": zero, "u3": zero, "ref_x": np.where(t < 10.0, 0.0, 1.0), "ref_y": zero,
               "ref_psi": zero, "x": np.where(t < 10.0, 0.03, 1.03), "y": zero + 0.04}  # fmt: skip
    return Log(columns | changes)


def test_errors_count_once_settled():
    log = hand_made()
    np.testing.assert_array_equal(np.flatnonzero(settled(log, 6.0)), [*range(60, 100), *range(160, 200)])
    error = np.where((log.t > 11.0) & (log.t < 15.95), 5.0, log["x"])  # while it settles: does not count
    found = score(hand_made(x=error), settle=6.0)
    assert found.peak_position_error == pytest.approx(0.05)
    assert found.rms_position_error == pytest.approx(0.05)


def test_truth_counts_where_there_is_one():
    log = hand_made()
    truth = {f"true_{name}": np.zeros(200) for name in ("theta", "phi", "psi", "x_dot", "y_dot", "theta_dot",
                                                         "phi_dot", "psi_dot")}  # fmt: skip
    found = score(hand_made(**truth, true_x=log["ref_x"] + 0.1, true_y=np.zeros(200)))
    assert found.peak_position_error == pytest.approx(0.1)


def test_torque_and_its_roughness():
    torques = np.where(np.arange(200) % 2, 3.0, -3.0)
    found = score(hand_made(u1=torques, u2=torques, u3=torques))
    assert found.rms_torque == pytest.approx(3.0)
    assert found.rms_torque_change == pytest.approx(6.0)


def test_a_run_too_short_to_settle_is_told():
    with pytest.raises(InputError, match="12 s after the start"):
        score(hand_made(), settle=12.0)
    fallen = Log(hand_made().columns, ended="fallen")
    assert np.isnan(score(fallen, settle=12.0).peak_position_error)


def test_comparing_on_the_model():
    robot = alten(FRICTION)
    controllers = {name: nominal_controller(robot, compensation=name) for name in ("none", "full", "partial")}
    falling = controllers | {"limp": Controller(robot, np.zeros((3, 10)))}
    runs = {"duration": 16.0, "seeds": [4, 5]}
    found = compare(lambda: Model(robot), falling, square(), **runs)
    again = compare(lambda: Model(robot), falling, square(), **runs, threads=2)
    bare = found.summary("none")
    for name in ("full", "partial"):
        better = found.summary(name)
        assert better.falls == 0
        assert better.peak_position_error < 0.5 * bare.peak_position_error
    limp = found.summary("limp")
    assert limp.falls == limp.runs == 2
    assert np.isnan(limp.peak_position_error)
    assert all(found.scores[name] == again.scores[name] for name in controllers)
    assert found.scores["none"][0] != found.scores["none"][1]


def test_nothing_to_compare_is_told():
    with pytest.raises(InputError, match="nothing to compare"):
        compare(lambda: Model(alten()), {}, square(), duration=1.0, seeds=[1])


def test_design_simulate_compare_from_the_command_line(tmp_path, capsys):
    robot = str(tmp_path / "found.toml")
    write_robot(alten(FRICTION), robot)
    out = tmp_path / "out"
    assert main(["design", robot, "--compensation", "full", "--out", str(out / "design")]) == 0
    controller = str(out / "design" / "controller.toml")
    designed = json.loads((out / "design" / "results.json").read_text())
    assert np.array(designed["gain"]).shape == (3, 10)
    assert max(real for real, _ in designed["poles"]) < 0.0

    assert main(["design", robot, "--kind", "precise", "--out", str(out / "precise")]) == 0
    precise = str(out / "precise" / "controller.toml")

    run = ["--reference", "square", "--duration", "8", "--controller", controller, "--out", str(out / "run")]
    assert main(["simulate", robot, *run]) == 0
    assert len(Log.read(out / "run" / "log.csv")) == 1600
    results = json.loads((out / "run" / "results.json").read_text())
    assert results["ended"] is None
    assert results["peak_position_error"] >= results["rms_position_error"]

    runs = ["--duration", "16", "--seeds", "1", "--out", str(out / "compare")]
    assert main(["compare", robot, "none", controller, precise, "precise", *runs]) == 0
    compared = json.loads((out / "compare" / "results.json").read_text())["comparison"]
    assert compared[controller]["peak_position_error"] < 0.5 * compared["none"]["peak_position_error"]
    assert compared[precise] == compared["precise"]
    assert compared[precise]["peak_position_error"] < 0.1 * compared["none"]["peak_position_error"]
    assert "falls" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["design", "alten", "--q", "1,2,many"], "--q is '1,2,many'"),
        (["design", "alten", "--r", "-1"], "R is not positive definite"),
        (["simulate", "alten", "--reference", "triangle"], "There is no reference 'triangle'"),
        (["simulate", "alten", "--controller", "nowhere.toml"], "nowhere.toml cannot be read"),
        (["simulate", "alten", "--duration", "0"], "at least one sample"),
        (["compare", "alten", "nowhere.toml"], "There is no controller file 'nowhere.toml'"),
        (["compare", "alten", "none", "--seeds", "0"], "nothing to compare"),
    ],
)
def test_wrong_input_ends_in_one_sentence_and_exit_code_2(tmp_path, capsys, arguments, sentence):
    assert main([*arguments, "--out", str(tmp_path)]) == 2
    told = capsys.readouterr().err
    assert told.startswith("ballbot: ")
    assert sentence in told
    assert told.count("\n") == 1


@pytest.mark.slow
def test_compensation_halves_the_error_on_the_twin():
    pytest.importorskip("mujoco")
    from ballbot.twin import Scenario, Twin

    robot = alten()
    told = robot.replace(friction=Scenario.nominal(robot).friction)
    controllers = {name: nominal_controller(told, compensation=name) for name in ("none", "full", "partial")}
    found = compare(lambda: Twin(robot), controllers, square(), duration=32.0, seeds=[1, 2])
    for name in ("full", "partial"):
        assert found.summary(name).falls == 0
        assert found.summary(name).worst_position_error < 0.5 * found.summary("none").peak_position_error
