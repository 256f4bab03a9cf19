"""A small sample of the campaigns in benchmarks/control_targets.py and control_parts.py; `make evidence` runs them."""

import numpy as np
import pytest
from control_examples import FRICTION, alten

from ballbot import InputError, Log
from ballbot.experiments.hold_cycle import cycle_amplitude

pytest.importorskip("mujoco")

from benchmarks.control_parts import interval
from benchmarks.control_targets import ALTEN, another, run, scaled

#: a friction that somebody has found: a fifth too large
KNOWN = alten(scaled(FRICTION, 1.2))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["square", "square, robot 20 % off"])
def test_the_precise_controller_keeps_to_the_square_on_the_twin(name):
    outcome = run(KNOWN, (name, 300))
    assert not outcome.fell
    assert outcome.peak < 0.03
    assert outcome.heading < 0.05


def test_another_robot_is_twenty_percent_off_and_a_robot():
    ratios = set()
    for seed in range(12):
        robot, scenario = another(seed)
        mass, height = (
            getattr(robot.body, name) / getattr(ALTEN.body, name) for name in ("mass", "center_of_mass")
        )
        assert {round(mass, 6), round(height, 6)} <= {0.8, 1.2}
        ratios.add((round(mass, 6), round(height, 6), round(scenario.friction.coulomb[0] / 0.11, 6)))
        # about the centre of mass it goes with the mass alone
        own = robot.body.inertia[0] - robot.body.mass * robot.body.center_of_mass**2
        known = ALTEN.body.inertia[0] - ALTEN.body.mass * ALTEN.body.center_of_mass**2
        assert own == pytest.approx(mass * known)
    assert len(ratios) > 4


def hold_log(x: np.ndarray) -> Log:
    t = np.arange(len(x)) * 0.005
    return Log({"t": t, "x": x, "y": 0.0 * t})


def test_a_cycle_is_told_apart_from_drift():
    t = np.arange(8000) * 0.005
    drift = 0.02 * np.sin(0.1 * t) + 0.0005 * t
    # a steady tone through a Hann window, off a bin by up to half of one: 15 % too small at the most
    assert cycle_amplitude(hold_log(drift + 0.002 * np.sin(2 * np.pi * 3.2 * t))) == pytest.approx(
        0.002, rel=0.15
    )
    assert cycle_amplitude(hold_log(drift)) < 2e-5
    with pytest.raises(InputError, match="less than 4 s"):
        cycle_amplitude(hold_log(drift[:1500]))


def test_an_interval_is_students():
    assert interval([1.0, 2.0, 3.0]) == "+2.000 (-0.484 to +4.484)"  # t(0.975, 2) = 4.303, over sqrt(3)
    assert interval([1.0]) == "-"
