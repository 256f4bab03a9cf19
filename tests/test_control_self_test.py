"""The self-test before balancing: it passes a robot that is wired right, and names what is wrong with another."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from control_examples import FRICTION, alten, four_wheeled

from ballbot import InputError, Model, Robot, simulate
from ballbot.control.references import hold
from ballbot.control.safety import SELF_TEST_DURATION, SelfTest, evaluate_self_test
from ballbot.simulation.model_plant import ModelPlant
from ballbot.simulation.plant import Measurement


class Miswired:
    """A plant whose motors' cables are mixed up: motor i gets sign[i] times the torque of motor order[i]."""

    def __init__(self, robot: Robot, *, order: tuple[int, ...], signs: tuple[int, ...]) -> None:
        self._plant = ModelPlant(Model(robot))
        self.robot = robot
        self._order, self._signs = list(order), np.array(signs)

    def reset(self, initial_state: np.ndarray | None, *, seed: int) -> Measurement:
        return self._plant.reset(initial_state, seed=seed)

    def step(self, torques: np.ndarray, duration: float) -> Measurement:
        return self._plant.step(self._signs * torques[self._order], duration)


def findings_of(plant) -> list[str]:
    robot = plant.robot
    log = simulate(plant, SelfTest(robot), hold(), duration=SELF_TEST_DURATION)
    return list(evaluate_self_test(robot, log).findings)


@pytest.mark.parametrize("robot", [alten(FRICTION), four_wheeled(friction=True)], ids=["three", "four"])
def test_a_robot_that_is_wired_right_passes(robot):
    n = robot.wheel_count
    assert findings_of(Miswired(robot, order=tuple(range(n)), signs=(1,) * n)) == []


def test_the_nominal_twin_passes_and_stays_upright():
    pytest.importorskip("mujoco")
    from ballbot.twin import Twin

    robot = alten()
    log = simulate(Twin(robot), SelfTest(robot), hold(), duration=SELF_TEST_DURATION, seed=3)
    result = evaluate_self_test(robot, log)
    assert result.passed
    assert log.ended is None
    # one degree of play is 0.017 rad: motors move through it, the robot does not
    assert np.abs(log.truth().states[:, 2:4]).max() < 0.02


@pytest.mark.parametrize("wrong", [0, 1, 2])
def test_a_wrong_sign_is_named(wrong):
    signs = tuple(-1 if i == wrong else 1 for i in range(3))
    (finding,) = findings_of(Miswired(alten(FRICTION), order=(0, 1, 2), signs=signs))
    assert f"Motor {wrong + 1} was driven forward and its encoder turned back" in finding


@pytest.mark.parametrize("order", [(1, 0, 2), (2, 0, 1), (0, 2, 1)])
def test_a_wrong_order_is_named(order):
    findings = findings_of(Miswired(alten(FRICTION), order=order, signs=(1, 1, 1)))
    wrong = [motor for motor in range(3) if order[motor] != motor]
    assert len(findings) == len(wrong)
    for motor, finding in zip(wrong, findings, strict=True):
        turning = order.index(motor) + 1
        assert f"Motor {motor + 1} was driven and encoder {turning} turned the most" in finding


def test_a_motor_without_power_is_named():
    (finding,) = findings_of(Miswired(alten(FRICTION), order=(0, 1, 2), signs=(1, 0, 1)))
    assert "Motor 2 was driven and no encoder turned" in finding


def test_the_example_in_the_documents_runs(capsys):
    pytest.importorskip("mujoco")
    text = (Path(__file__).parents[1] / "docs" / "control.md").read_text(encoding="utf-8")
    examples = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    (example,) = (one for one in examples if "SelfTest" in one)
    exec(compile(example, "docs/control.md", "exec"), {})
    assert capsys.readouterr().out == "True\n"


def test_wrong_input_is_told():
    with pytest.raises(InputError, match=r"above the largest break-away torque, 0\.18 N m"):
        SelfTest(alten(FRICTION), torque=0.1)
    strong = alten(replace(FRICTION, coulomb=(7.0, 7.0, 7.0)))
    with pytest.raises(InputError, match="the torque limit of the drive, 6 N m"):
        SelfTest(strong, torque=8.0)
    robot = alten(FRICTION)
    short = simulate(Model(robot), SelfTest(robot), hold(), duration=0.2)
    with pytest.raises(InputError, match=r"lasts 0\.2 s; it must last 0\.5 s"):
        evaluate_self_test(robot, short)
