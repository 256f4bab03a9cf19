"""A small sample of the campaigns on control; `make evidence` runs them."""

import numpy as np
import pytest

from ballbot import Log
from ballbot.robot.components import scaled_friction
from tests.support.control_examples import FRICTION, alten

pytest.importorskip("mujoco")

from campaigns.precise_controller import ALTEN, another, cycle_amplitude, outcome, task_run

#: a friction that somebody has found: a fifth too large
KNOWN = alten(scaled_friction(FRICTION, 1.2))


@pytest.mark.sample
@pytest.mark.parametrize("name", ["square", "square, robot 20 % off"])
def test_precise_controller_follows_the_square_on_the_twin(name):
    found = outcome(task_run(KNOWN, name, 300).result())
    assert not found.fell
    assert found.peak < 0.03
    assert found.heading < 0.05


def test_perturbed_robot_is_twenty_percent_off_and_valid():
    ratios = set()
    for seed in range(12):
        robot, scenario = another(seed)
        mass, height = (
            getattr(robot.body, name) / getattr(ALTEN.body, name) for name in ("mass", "center_of_mass")
        )
        assert {round(mass, 6), round(height, 6)} <= {0.8, 1.2}
        ratios.add((round(mass, 6), round(height, 6), round(scenario.friction.coulomb[0] / 0.11, 6)))
        # about the centre of mass it goes with the mass alone
        assert robot.body.inertia_about == "center_of_mass"
        own = robot.body.inertia[0]
        known = ALTEN.body.inertia[0] - ALTEN.body.mass * ALTEN.body.center_of_mass**2
        assert own == pytest.approx(mass * known)
    assert len(ratios) > 4


def hold_log(x: np.ndarray) -> Log:
    t = np.arange(len(x)) * 0.005
    return Log({"t": t, "x": x, "y": 0.0 * t})


def test_limit_cycle_is_distinguished_from_drift():
    t = np.arange(8000) * 0.005
    drift = 0.02 * np.sin(0.1 * t) + 0.0005 * t
    # a steady tone through a Hann window, off a bin by up to half of one: 15 % too small at the most
    assert cycle_amplitude(hold_log(drift + 0.002 * np.sin(2 * np.pi * 3.2 * t))) == pytest.approx(
        0.002, rel=0.15
    )
    assert cycle_amplitude(hold_log(drift)) < 2e-5
