"""The presets of published robots, their printed matrices and gains, mistake 16, and the page."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot.control.lqr import lqr
from ballbot.control.presets import design_gain
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.components import PARAMETERS
from ballbot.thesis.reproduce import mistakes
from campaigns import published
from campaigns.published import SourceModel, unstable_poles
from tests.support.lagrangian import corrections_of, equations
from tests.support.symbolic_oracle import random_state

ALTEN, KUGLE = Robot.load("alten"), Robot.load("kugle")
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


# --- printed matrices and gains: what comes out, and by which convention ---------------------------


def matrices(shared_data: Path) -> tuple[NDArray, NDArray, NDArray]:
    """Return the authors' A (12, 12), B (12, 3) and gain (3, 6)."""
    scipy_io = pytest.importorskip("scipy.io")
    folder = shared_data / "kugle"
    if not folder.is_dir():
        pytest.skip(f"no data at {folder}")
    linear = scipy_io.loadmat(folder / "LinearizedModelMatrices.mat", variable_names=["A", "B"])
    return linear["A"], linear["B"], scipy_io.loadmat(folder / "BalanceLQRgain.mat")["BalanceLQRgain"]


def test_the_preset_counts_the_inertia_once() -> None:
    ml2 = KUGLE.body.mass * KUGLE.body.center_of_mass**2
    central = KUGLE.body.inertia_about_center_of_mass()
    # the CAD's own inertia about the centre of mass, and 1.7e-4 for the 3.2 mm to the side
    assert central[0, 0] == pytest.approx(1.29465, abs=2e-4)
    assert central[1, 1] == pytest.approx(1.30640, abs=2e-4)
    doubled = published.inertia_counted_twice(KUGLE).body.inertia_about_ball_center()
    assert doubled[0, 0] - KUGLE.body.inertia_about_ball_center()[0, 0] == pytest.approx(ml2)


def test_authors_matrices_come_out(shared_data: Path) -> None:
    A, B, _ = matrices(shared_data)
    ours = published.in_quaternion(Model(published.kugle_as_modelled(KUGLE)))
    places = [6, 7, 9, 10, 11]  # accelerations of x y q2 q3 q4; q1's are zero
    assert ours.A[5:, 2:5] == pytest.approx(A[np.ix_(places, [3, 4, 5])], abs=5.1e-5)
    assert ours.B[5:] == pytest.approx(B[places], abs=5.1e-5)


def test_authors_gain_follows_from_their_matrices(shared_data: Path) -> None:
    A, B, gain = matrices(shared_data)
    own = np.zeros((6, 6))
    own[:3, 3:] = 0.5 * np.eye(3)
    own[3:, :3] = 2.0 * A[9:, 3:6]
    model = SourceModel(A=own, B=np.vstack([np.zeros((3, 3)), 2.0 * B[9:]]))
    # weights of q2 q3 q4 and of the body's rates, and of each torque (GainComputation_UsingLinearizedMatrices)
    designed = lqr(model, (1000.0, 1000.0, 1.0, 0.1, 0.1, 0.01), (0.05,) * 3)
    # two Riccati solvers agree to 1e-12 of the largest entry; 3e-13 was seen
    assert np.abs(designed.gain - gain).max() < 1e-12 * np.abs(gain).max()


def test_kugles_printed_matrices_come_out_and_rezeros_within_a_percent() -> None:
    assert all(one.comes_out for one in published.kugle_entries(KUGLE))
    rezero = published.rezero_entries(Robot.load("rezero"))
    assert max(abs(one.difference) for one in rezero) < 0.012
    assert all(one.comes_out for one in rezero if one.name.startswith("theta_z"))


@pytest.mark.slow  # derives Rezero's equations
def test_rezeros_printed_gain_comes_out() -> None:
    robot = Robot.load("rezero")
    model = published.in_rezero_state(published.rezero_as_modelled(robot), robot)
    weights = (100.0, 100.0, 40.0, 20.0, 20.0, 50.0, 50.0, 20.0, 10.0, 10.0)
    printed = (22.34, 0.0, -0.36, 0.36, 0.0, 4.63, 0.0, -0.29, 0.53, 0.0)
    # its digits are cut off, and its matrices are 1 % off
    np.testing.assert_allclose(lqr(model, weights, (100.0,) * 3).gain[0], printed, rtol=5e-3, atol=0.01)


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
