"""Faults of a motor within a log are named with the motor and the time; sound logs have none."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ballbot.control.presets import nominal_controller
from ballbot.control.references import square
from ballbot.errors import InputError
from ballbot.findings import Finding
from ballbot.log import Log
from ballbot.log.checks import check_logs, checked_logs
from ballbot.robot import Robot
from ballbot.simulation.imperfections import Push
from ballbot.simulation.run import simulate
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin import Scenario
from ballbot.twin.imperfections import imperfections_of, true_model
from tests.support.failing_motor import FailingMotor, Fault

ROBOT = Robot.load("alten")
NOMINAL = Scenario.nominal(ROBOT)


@cache
def recorded(fault: Fault | None = None, *, pushes: tuple[Push, ...] = ()) -> Log:
    """Return a log of 20 s around a square, of a motor that fails or of a sound robot."""
    scenario = replace(NOMINAL, pushes=pushes)
    plant = SensedPlant(true_model(ROBOT, scenario), imperfections_of(scenario, known=ROBOT))
    driven = plant if fault is None else FailingMotor(plant, fault)
    course = square(side=0.6, period=12.0)
    return simulate(driven, nominal_controller(ROBOT), course, duration=20.0, seed=3).without_truth()


def errors(log: Log) -> list[Finding]:
    return [one for one in check_logs({"run.csv": log}, robot=ROBOT) if one.severity == "error"]


def exchanged(log: Log, rows: np.ndarray, *patterns: str) -> Log:
    pairs = [(one.format(a), one.format(b)) for one in patterns for a, b in ((1, 2), (2, 1))]
    return log.with_columns({to: np.where(rows, log[of], log[to]) for to, of in pairs})


@pytest.mark.parametrize(
    ("kind", "length", "code", "words"),
    [
        ("0", np.inf, "dead-motor", "Motor 1 gives no torque from"),
        ("0.4", 6.0, "torque-scale", "Motor 1 gives 0."),
    ],
)
def test_a_motor_that_fails_is_named_with_the_time(kind, length, code, words):
    log = recorded(Fault(kind=kind, motors=(0,), start=7.3, length=length))
    found = [one for one in errors(log) if one.where.time is not None]
    assert [(one.code, one.where.columns) for one in found] == [(code, ("u1",))]
    # the filter reaches over 0.3 s, blocks are of a quarter of a second
    assert found[0].where.time == pytest.approx(7.3, abs=0.6)
    assert words in found[0].text


@pytest.mark.parametrize("patterns", [("u{}",), ("u{}", "wheel{}", "wheel{}_dot")])
def test_motors_exchanged_in_the_second_half_are_named(patterns):
    log = recorded()
    found = errors(exchanged(log, log.t >= 10.0, *patterns))
    assert [(one.code, one.where.columns) for one in found] == [("torque-order", ("u1", "u2"))]
    assert found[0].where.time == pytest.approx(10.0, abs=0.6)


def test_a_torque_negated_for_a_while_is_named():
    log = recorded()
    rows = (log.t >= 8.0) & (log.t < 11.0)
    (found,) = errors(log.with_columns({"u1": np.where(rows, -log["u1"], log["u1"])}))
    assert (found.code, found.where.columns) == ("torque-sign", ("u1",))
    assert found.where.time == pytest.approx(8.0, abs=0.6)
    assert " to 11" in found.text or " to 10." in found.text


def test_a_fault_stops_a_command_until_it_is_accepted():
    log = recorded(Fault(kind="0", motors=(0,), start=7.3, length=np.inf))
    with pytest.raises(InputError, match="Motor 1 gives no torque"):
        checked_logs(ROBOT, log)
    assert checked_logs(ROBOT, log, accept=[one.code for one in errors(log)]).findings


def test_sound_logs_have_no_fault():
    pushes = tuple(Push(time=t, duration=0.2, force=(40.0, 10.0, 0.0), height=0.3) for t in (5.0, 9.0, 13.0))
    assert [errors(recorded()), errors(recorded(pushes=pushes))] == [[], []]
