"""Over-compensation: what is refused drives a robot on, what is accepted does not, by the engine."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ballbot import Controller, InputError, Model, simulate
from ballbot.cli.main import main
from ballbot.control.file import read_controller, write_controller
from ballbot.control.overcompensation import (
    compensation_margin,
    overcompensation_warning,
    refuse_overcompensation,
)
from ballbot.control.presets import design_gain, nominal_controller
from ballbot.errors import UnsuitedController
from ballbot.mechanics.friction import wheel_friction
from ballbot.robot.components import Correlation, scaled_friction
from tests.support.control_examples import FRICTION, alten

ROBOT = alten(FRICTION)


@cache
def designed_gain() -> np.ndarray:
    return design_gain(ROBOT).gain


@pytest.mark.parametrize(("share", "overcompensates"), [(0.8, False), (1.0, False), (1.1, True), (1.3, True)])
def test_refused_compensation_drives_a_turning_robot_and_accepted_lets_it_rest(share, overcompensates):
    """A robot turns on the spot for 6 s, its heading left free."""
    assumed = ROBOT.replace(friction=scaled_friction(FRICTION, share))
    controller = Controller(assumed, designed_gain(), compensation="full")
    assert compensation_margin(controller, FRICTION).overcompensates is overcompensates
    free = designed_gain().copy()
    free[:, [4, 9]] = 0.0
    loose = Controller(assumed, free, compensation="full")
    # 1 rad/s of the body is 1.2 rad/s of the wheels, far above the band in which the sign is a ramp
    log = simulate(ROBOT, loose, "hold", duration=6.0, initial_state=np.eye(10)[9])
    later = abs(log["psi_dot"][-1])
    if overcompensates:
        assert later > 1.2
        with pytest.raises(InputError, match=r"injects energy and can destabilise"):
            refuse_overcompensation(controller, FRICTION)
    else:
        assert later < 1.0 + 1e-9  # the whole of it: the robot coasts
        refuse_overcompensation(controller, FRICTION)


def test_excess_of_rolling_friction_or_of_one_wheel_is_found():
    rolling = ROBOT.replace(friction=replace(FRICTION, rolling=1.5 * FRICTION.rolling))
    margin = compensation_margin(Controller(rolling, designed_gain(), compensation="partial"), FRICTION)
    assert margin.rolling_fraction == pytest.approx(1.5)
    assert max(margin.wheel_fractions) == pytest.approx(1.0)
    assert "rolling friction is 150 %" in margin.sentence
    wheel = ROBOT.replace(friction=replace(FRICTION, coulomb=(0.11, 0.12, 0.12)))
    margin = compensation_margin(Controller(wheel, designed_gain(), compensation="full"), FRICTION)
    assert margin.overcompensates
    assert margin.rolling_fraction == pytest.approx(1.0)
    assert "wheel 2" in margin.sentence
    none = Controller(wheel, designed_gain())
    assert not compensation_margin(none, FRICTION).overcompensates


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_design_overcompensates_with_a_flag_and_says_so(tmp_path, capsys):
    ROBOT.write(tmp_path / "robot.toml")
    words = ["design", str(tmp_path / "robot.toml"), "--compensation", "full", "--out", str(tmp_path / "out")]
    assert main([*words, "--compensation-gain", "1.2", "--allow-overcompensation"]) == 0
    assert "WARNING: the compensation" in capsys.readouterr().out


def test_controller_file_is_checked_against_the_robot_it_is_read_with(tmp_path):
    path = tmp_path / "controller.toml"
    write_controller(nominal_controller(ROBOT, compensation="full"), path)
    assert overcompensation_warning(read_controller(path, ROBOT), ROBOT) is None
    # of which no friction is known
    assert overcompensation_warning(read_controller(path, alten()), alten()) is None
    with pytest.warns(UnsuitedController, match=r"controller.toml: More friction .* 200 % of"):
        read_controller(path, alten(scaled_friction(FRICTION, 0.5)))
    unsure = ROBOT.annotated(standard_deviations={"friction.coulomb": (0.01, 0.01, 0.01)})
    with pytest.warns(UnsuitedController, match="More friction is compensated than is certain"):
        read_controller(path, unsure)


ASYMMETRY = {"coulomb_asymmetry": (0.03, -0.02, 0.04), "stribeck_asymmetry": (-0.02, 0.01, 0.05)}
DIRECTED = replace(FRICTION, load=(0.2, 0.1, 0.3), **ASYMMETRY)


def test_compensation_is_the_friction_of_the_direction_and_the_load():
    robot = alten(replace(DIRECTED, rolling=0.0))
    state = np.array([0.0, 0.0, 0.01, -0.02, 0.0, 0.3, -0.2, 0.1, 0.0, 0.6])
    speeds = Model(robot).wheel_speed(state[:5], state[5:])
    assert (np.abs(speeds) > 0.2).all()
    assert len(set(np.sign(speeds))) == 2
    torques = []
    for compensation in ("none", "full"):
        controller = Controller(robot, designed_gain(), compensation=compensation, speed_band=0.1)
        controller.reset()
        torques.append(controller.update(0.0, state, np.zeros(10)))
    feedback, whole = torques
    unloaded = wheel_friction(speeds, robot.friction)
    expected = wheel_friction(speeds, robot.friction, torque=feedback + unloaded)
    np.testing.assert_allclose(whole - feedback, expected, rtol=1e-9)


def test_directed_friction_is_checked_in_both_directions():
    knowing = Controller(alten(DIRECTED), designed_gain(), compensation="full")
    assert compensation_margin(knowing, DIRECTED).largest == pytest.approx(1.0)
    symmetric = Controller(alten(FRICTION), designed_gain(), compensation="full")
    margin = compensation_margin(symmetric, DIRECTED)
    assert margin.largest > 1.1
    assert min(margin.at_speeds) < 0.0 < max(margin.at_speeds)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_controller_designed_from_a_written_robot_raises_no_alarm_with_it(tmp_path, capsys):
    """The friction's errors are correlated, and rounded in the file."""
    labels = ("friction.viscous[0]", "friction.coulomb[0]", "friction.rolling")
    near = np.array([[1.0, -0.987654321, 0.123456789], [-0.987654321, 1.0, -0.12], [0.123456789, -0.12, 1.0]])
    deviations = {
        "friction.viscous": (0.003,) * 3,
        "friction.coulomb": (0.01,) * 3,
        "friction.rolling": 0.001,
    }
    known = ROBOT.annotated(standard_deviations=deviations, correlation=Correlation.of_matrix(labels, near))
    known.write(tmp_path / "robot.toml")
    robot, out = str(tmp_path / "robot.toml"), str(tmp_path / "out")
    assert main(["design", robot, "--kind", "precise", "--out", out]) == 0
    assert "warning" not in capsys.readouterr().err
    page = Path(out, "report.html").read_text()
    assert "Only the friction that is certain is compensated" in page
    assert "because more would spin the wheels on the ball" in page
    controller = f"{out}/controller.toml"
    words = ["simulate", robot, "--controller", controller, "--duration", "0.1", "--out", f"{out}/run"]
    assert main(words) == 0
    assert "warning" not in capsys.readouterr().err
