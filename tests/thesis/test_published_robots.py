"""Rezero's and Kugle's printed matrices and gains: what comes out, by which convention, and what they should be.

Kugle's matrices contain its own double counting.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from campaigns.published import kugle, rezero
from campaigns.published.printed import Entry, SourceModel, mixture_model, unstable_poles
from tests.support.lagrangian import corrections_of

REZERO = Robot.load("rezero")


@pytest.fixture(scope="module")
def entries() -> dict[str, Entry]:
    """Return the printed numbers by name; no constant, as each collection of the tests would derive them."""
    return {entry.name: entry for entry in rezero.entries(REZERO)}


@pytest.mark.slow
@pytest.mark.parametrize("wheel", [1, 2, 3])
def test_heading_column_matches_to_the_last_digit_with_absolute_wheel_rotation(
    entries: dict[str, Entry], wheel: int
) -> None:
    entry = entries[f"theta_z dd/T{wheel}"]
    assert entry.comes_out
    assert entry.right == pytest.approx(-12.47, abs=5e-3)


@pytest.mark.slow
def test_heading_column_needs_the_whole_convention() -> None:
    printed = -10.76
    right = Model(REZERO).linearize()
    rotors_apart = mixture_model(REZERO, replace(corrections_of("exact"), locked_wheels_once=False))
    wheels_once = mixture_model(
        rezero.as_modelled(REZERO), replace(corrections_of("exact"), reflected_rotors=False)
    )
    assert all(abs(model.B[9, 0] / printed - 1.0) > 0.03 for model in (right, rotors_apart, wheels_once))


@pytest.mark.slow
def test_lean_comes_within_the_published_percent(entries: dict[str, Entry]) -> None:
    """The published numbers are 37.49, -72.21, 3.983, -13.32 from a planar reduction, within 1.2 % of print."""
    expected = {
        "theta_x dd/theta_x": 37.49,
        "phi_x dd/theta_x": -72.21,
        "theta_x dd/T1": 3.983,
        "phi_x dd/T1": -13.32,
    }
    for name, value in expected.items():
        assert entries[name].reproduced == pytest.approx(value, rel=4e-4)  # half of a last digit
    assert max(abs(entry.difference) for entry in entries.values()) < 0.012


def test_printed_matrices_fit_each_other_and_the_parameters_gravity() -> None:
    """Only if the torques act relative to the body: the missing counter-torque would show here."""
    body = REZERO.body
    tipping = body.mass * REZERO.gravity * body.center_of_mass
    # the entries' rounding, 0.005 of 4.02, allows 0.13 %
    assert rezero.printed_tipping(REZERO) == pytest.approx(tipping, rel=1.3e-3)


def test_three_dimensional_gain_follows_from_the_printed_matrices() -> None:
    gain = rezero.balance_lqr(rezero.printed_model()).gain
    # the source cuts after two digits (0.01), and A and B are rounded themselves (0.001 in the gain)
    assert gain[0] == pytest.approx(np.array(rezero.PRINTED_GAIN), abs=0.011)


def test_the_figure_misprints_a_sign() -> None:
    gain = rezero.balance_lqr(rezero.printed_model(misprinted=True)).gain
    assert abs(gain[0, 0] - rezero.PRINTED_GAIN[0]) > 3.0
    assert abs(gain[0, 2]) > 3.0  # where the printed gain is zero


def test_planar_gain_follows_from_the_printed_matrices() -> None:
    planar = rezero.Planar()
    # four decimals are printed, of A, B and K alike; 1.5e-4 was seen
    assert rezero.planar_lqr(planar).gain[0] == pytest.approx(np.array(planar.gain), abs=2e-4)


def test_planar_matrices_do_not_follow_from_the_sources_own_table() -> None:
    planar = rezero.Planar()
    tipping = rezero.implied_tipping(
        lean_by_lean=planar.lean_by_lean,
        ball_by_lean=planar.ball_by_lean,
        lean_by_torque=planar.lean_by_torque,
        ratio=REZERO.ball.radius / REZERO.wheels.radius,
    )
    assert tipping / rezero.tipping_of_table(REZERO, planar) == pytest.approx(0.967, abs=1e-3)


def test_implied_tipping_finds_what_a_planar_model_was_made_with() -> None:
    M, tipping, ratio = np.array([[0.3, 0.5], [0.5, 2.1]]), 41.0, 2.1
    by_lean, by_torque = np.linalg.solve(M, [0.0, tipping]), np.linalg.solve(M, [ratio, -ratio])
    found = rezero.implied_tipping(
        lean_by_lean=by_lean[1], ball_by_lean=by_lean[0], lean_by_torque=by_torque[1], ratio=ratio
    )
    assert found == pytest.approx(tipping)


def test_source_state_turns_the_ball_as_it_rolls() -> None:
    """Rolling towards +y turns the ball about -x, towards +x about +y: the poles stay what they are."""
    model = Model(REZERO).linearize()
    source = rezero.in_source_state(model, REZERO)
    assert np.sort(np.linalg.eigvals(source.A).real) == pytest.approx(np.sort(model.poles().real), abs=1e-6)
    assert source.B[7] == pytest.approx(-model.B[6] / REZERO.ball.radius)
    assert source.B[9] == pytest.approx(model.B[5] / REZERO.ball.radius)


def test_wheel_and_rotor_make_the_sources_theta_w() -> None:
    assert rezero.as_modelled(REZERO).wheels.inertia == pytest.approx(0.00315, abs=5e-6)  # as printed


KUGLE = Robot.load("kugle")


def matrices(shared_data: Path) -> tuple[NDArray, NDArray, NDArray]:
    """Return the authors' A (12, 12), B (12, 3) and gain (3, 6)."""
    scipy_io = pytest.importorskip("scipy.io")
    folder = shared_data / "kugle"
    if not folder.is_dir():
        pytest.skip(f"no data at {folder}")
    linear = scipy_io.loadmat(folder / "LinearizedModelMatrices.mat", variable_names=["A", "B"])
    return linear["A"], linear["B"], scipy_io.loadmat(folder / "BalanceLQRgain.mat")["BalanceLQRgain"]


def test_every_printed_number_comes_out_to_its_last_digit() -> None:
    missed = [entry for entry in kugle.entries(KUGLE) if not entry.comes_out]
    assert not missed, [f"{entry.name}: {entry.reproduced} is not {entry.printed}" for entry in missed]
    assert len(kugle.entries(KUGLE)) == 17


def test_printed_numbers_are_far_from_right() -> None:
    """So that what reproduces them is the mistake and not the robot."""
    lean = [entry for entry in kugle.entries(KUGLE) if not entry.name.startswith("ddq4")]
    assert all(abs(entry.right) > 1.5 * abs(entry.reproduced) for entry in lean)


def test_each_of_the_two_peculiarities_is_needed() -> None:
    twice_alone = Model(kugle.inertia_counted_twice(KUGLE)).linearize()
    relative_alone = Model(kugle.all_on_relative_speed(KUGLE)).linearize()
    assert abs(0.5 * twice_alone.B[9, 0] + 6.8957) > 0.1  # heading: only with the relative speed
    assert unstable_poles(relative_alone)[0] > 5.9  # fall: only with the doubled inertia


def test_kugle_s_unstable_poles_as_modelled_and_exact() -> None:
    # [1/s], independently computed
    assert unstable_poles(Model(kugle.as_modelled(KUGLE)).linearize())[1] == pytest.approx(3.74, abs=5e-3)
    assert unstable_poles(Model(KUGLE).linearize())[0] == pytest.approx(5.93, abs=5e-3)


def test_the_preset_counts_the_inertia_once() -> None:
    ml2 = KUGLE.body.mass * KUGLE.body.center_of_mass**2
    central = KUGLE.body.inertia_about_center_of_mass()
    # the CAD's own inertia about the centre of mass, and 1.7e-4 for the 3.2 mm to the side
    assert central[0, 0] == pytest.approx(1.29465, abs=2e-4)
    assert central[1, 1] == pytest.approx(1.30640, abs=2e-4)
    doubled = kugle.inertia_counted_twice(KUGLE).body.inertia_about_ball_center()
    assert doubled[0, 0] - KUGLE.body.inertia_about_ball_center()[0, 0] == pytest.approx(ml2)


def test_authors_matrices_come_out(shared_data: Path) -> None:
    A, B, _ = matrices(shared_data)
    ours = kugle.in_quaternion(Model(kugle.as_modelled(KUGLE)))
    places = [6, 7, 9, 10, 11]  # accelerations of x y q2 q3 q4; q1's are zero
    assert ours.A[5:, 2:5] == pytest.approx(A[np.ix_(places, [3, 4, 5])], abs=5.1e-5)
    assert ours.B[5:] == pytest.approx(B[places], abs=5.1e-5)


def test_authors_gain_follows_from_their_matrices(shared_data: Path) -> None:
    A, B, gain = matrices(shared_data)
    own = np.zeros((6, 6))
    own[:3, 3:] = 0.5 * np.eye(3)
    own[3:, :3] = 2.0 * A[9:, 3:6]
    designed = kugle.balance_lqr(SourceModel(A=own, B=np.vstack([np.zeros((3, 3)), 2.0 * B[9:]])))
    # two Riccati solvers agree to 1e-12 of the largest entry; 3e-13 was seen
    assert np.abs(designed.gain - gain).max() < 1e-12 * np.abs(gain).max()


def test_authors_gain_follows_from_the_printed_rows_and_from_the_robot(shared_data: Path) -> None:
    _, _, gain = matrices(shared_data)
    printed = kugle.balance_lqr(kugle.printed_attitude()).gain
    from_robot = kugle.balance_lqr(kugle.attitude(Model(kugle.as_modelled(KUGLE)).linearize())).gain
    assert printed == pytest.approx(
        gain, rel=1e-12, abs=1e-9
    )  # the file holds no more digits than are printed
    assert from_robot == pytest.approx(gain, abs=1e-4 * np.abs(gain).max())  # four decimals of A and B
