"""The presets of published robots, mistake 16 against the symbolic Lagrangian, and the page."""

import re
from dataclasses import replace

import numpy as np
import pytest

from ballbot.control.presets import design_gain
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.components import PARAMETERS
from ballbot.thesis.reproduce import mistakes
from campaigns import published
from campaigns.published import unstable_poles
from tests.support.lagrangian import corrections_of, equations
from tests.support.symbolic_oracle import random_state

ALTEN = Robot.load("alten")
PUBLISHED = ("alten", "rezero", "kugle", "rob311", "cmu")

# --- presets --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PUBLISHED)
def test_every_parameter_of_a_preset_has_a_source(name: str) -> None:
    assert set(Robot.load(name).sources) == {parameter.name for parameter in PARAMETERS}


@pytest.mark.parametrize(("name", "wheels"), [("rezero", 3), ("kugle", 3), ("rob311", 3), ("cmu", 4)])
def test_a_preset_is_a_robot_that_falls_and_can_be_held(name: str, wheels: int) -> None:
    robot = Robot.load(name)
    model = Model(robot).linearize()
    assert robot.wheel_count == wheels
    assert 3.0 < unstable_poles(model)[1] <= unstable_poles(model)[0] < 7.0
    assert design_gain(robot).poles.real.max() < 0.0


def test_cmus_own_planar_equations_are_ours_without_the_wheels_inertia() -> None:
    cmu = Robot.load("cmu")
    ours = unstable_poles(Model(published.without_wheel_inertia(cmu)).linearize())
    assert ours == pytest.approx((published.planar_pole(cmu),) * 2, rel=1e-12)


# --- the thesis -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_force_of_mistake_16_is_that_of_the_symbolic_lagrangian() -> None:
    """(II.34) as printed less (II.34) with d'Alembert's principle first, derived by SymPy, at some states."""
    printed = corrections_of("thesis")
    first, second = (
        equations(ALTEN, replace(printed, nonholonomic_wheels=mended)) for mended in (False, True)
    )
    rng = np.random.default_rng(16)
    for _ in range(20):
        q, q_dot, u = random_state(rng, 3)
        force = mistakes.nonholonomic_force(ALTEN, q, q_dot)
        # central differences at 1e-5: truncation and rounding are 1e-10 of numbers up to 0.1
        wanted = first.dynamics(q, q_dot, u)[1] - second.dynamics(q, q_dot, u)[1]
        np.testing.assert_allclose(force, wanted, rtol=0.0, atol=1e-9)


# --- the page -------------------------------------------------------------------------------------

NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")


@pytest.mark.slow  # derives Rezero's equations
def test_the_page_in_docs_is_what_the_command_computes() -> None:
    """Words exactly; numbers to 1 %, as processors differ in their last digits."""
    committed = published.PAGE.read_text(encoding="utf-8")
    made = published.published_page()
    assert NUMBER.sub("\0", made) == NUMBER.sub("\0", committed)
    numbers, computed = ([float(one) for one in NUMBER.findall(text)] for text in (committed, made))
    assert computed == pytest.approx(numbers, rel=1e-2, abs=5e-4)
