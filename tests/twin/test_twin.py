"""The twin as a plant: it balances, repeats, falls, and its sensors see what they should."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ballbot.control.presets import nominal_controller
from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.twin import Scenario, Twin
from tests.support.control_examples import leaning

ALTEN = Robot.load("alten")


def balanced(twin: Twin, duration: float, *, seed: int) -> Log:
    """Return a run at rest with the nominal gain, whose states are measured and true."""
    return simulate(twin, nominal_controller(ALTEN), "hold", duration=duration, seed=seed)


def test_balances_ten_seconds_and_wanders_as_the_thesis_saw() -> None:
    log = balanced(Twin(ALTEN), 10.0, seed=1)
    seen, truth = log.states, log.truth().states
    assert log.ended is None
    assert log.t[-1] == pytest.approx(10.0, abs=0.005)
    assert np.abs(truth[:, 2:4]).max() < np.radians(3)
    # issue 2: friction without compensation makes it wander by 0.1 to 1 m
    assert 0.05 < np.abs(truth[:, :2]).max() < 1.0
    # what the sensors say is near it: drift of the heading and slip, not more
    assert np.abs(seen[:, :2] - truth[:, :2]).max() < 0.05
    assert np.abs(seen[:, 2:4] - truth[:, 2:4]).max() < np.radians(1.0)


def test_equal_seeds_give_equal_runs_and_others_do_not() -> None:
    twin = Twin(ALTEN)
    first, other, again = (balanced(twin, 0.5, seed=seed) for seed in (3, 4, 3))  # one after another
    for log in (again, balanced(Twin(ALTEN), 0.5, seed=3)):
        assert all(np.array_equal(first[name], log[name]) for name in first.names)
    assert (first.truth().states[-1] != other.truth().states[-1]).all()


def test_fall_is_reported() -> None:
    log = simulate(
        Twin(ALTEN), lambda *_: np.zeros(3), "hold", duration=0.5, initial_state=leaning(0.5), seed=1
    )
    assert str(log.ended).startswith("fallen: lean past 0.6 rad at t = ")


def test_diverging_numbers_are_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo leaves a MUJOCO_LOG.TXT where it warns
    twin = Twin(ALTEN)
    twin.reset(None, seed=1)
    twin.engine.qvel[8] = np.nan
    measurement = twin.step(np.zeros(3), 0.005)
    assert measurement.ended == "the simulation diverged at t = 0.005 s"
    assert twin.reset(None, seed=1).ended is None


def test_robots_own_friction_is_not_used() -> None:
    """Else identification would be handed its own answer."""
    identified = ALTEN.replace(friction=replace(Scenario.nominal(ALTEN).friction, rolling=0.5))
    runs = []
    for robot in (ALTEN, identified):
        twin = Twin(robot)
        twin.reset(None, seed=1)
        for _ in range(20):
            measurement = twin.step(np.array([0.3, -0.1, 0.2]), 0.005)
        runs.append(measurement.truth)
    assert (runs[0] == runs[1]).all()


def test_torque_limit_holds_against_any_command() -> None:
    limited = ALTEN.replace(drive=replace(ALTEN.drive, torque_limit=0.5))
    twins = [Twin(robot, Scenario.ideal(robot)) for robot in (limited, ALTEN)]
    for twin, torque in zip(twins, (50.0, 0.5), strict=True):
        twin.reset(None, seed=1)
        last = [twin.step(torque * np.array([1.0, -1.0, 0.0]), 0.005) for _ in range(10)]
    assert (twins[0].engine.qpos == twins[1].engine.qpos).all()
    assert np.abs(last[-1].truth).max() > 0.0


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"rollers": {"rows": 3}}, "one or two rows"),
        ({"rollers": {"radius": 0.09}}, "below the wheel's"),
        ({"sensors": {"sample_time": 0.0051234}}, "whole multiple"),
        ({"friction": {"coulomb": (0.1, 0.1)}}, "friction for 2 wheels"),
        ({}, r"wheels\.inertia"),
    ],
)
def test_refuses_a_scenario_or_a_robot_that_does_not_fit(change, sentence):
    nominal = Scenario.nominal(ALTEN)
    parts = {name: replace(getattr(nominal, name), **values) for name, values in change.items()}
    robot = ALTEN if change else ALTEN.replace(wheels=replace(ALTEN.wheels, inertia=1.0))
    with pytest.raises(InputError, match=sentence):
        Twin(robot, replace(nominal, **parts))
