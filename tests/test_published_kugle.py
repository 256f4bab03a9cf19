"""Kugle's printed matrices and gain, by its own double counting; and what they should be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.thesis.published import kugle
from ballbot.thesis.published.printed import SourceModel, unstable_poles

KUGLE = Robot.load("kugle")


def matrices(shared_data: Path) -> tuple[NDArray, NDArray, NDArray]:
    """Return the authors' A (12, 12), B (12, 3) and gain (3, 6)."""
    scipy_io = pytest.importorskip("scipy.io")
    folder = shared_data / "kugle"
    if not folder.is_dir():
        pytest.skip(f"no data at {folder}")
    linear = scipy_io.loadmat(folder / "LinearizedModelMatrices.mat", variable_names=["A", "B"])
    return linear["A"], linear["B"], scipy_io.loadmat(folder / "BalanceLQRgain.mat")["BalanceLQRgain"]


@pytest.mark.parametrize("entry", kugle.entries(KUGLE), ids=lambda entry: entry.name)
def test_every_printed_number_comes_out_to_its_last_digit(entry: kugle.Entry) -> None:
    assert entry.comes_out, f"{entry.reproduced} is not {entry.printed}"


def test_printed_numbers_are_far_from_right() -> None:
    """So that what reproduces them is the mistake and not the robot."""
    lean = [entry for entry in kugle.entries(KUGLE) if not entry.name.startswith("ddq4")]
    assert all(abs(entry.right) > 1.5 * abs(entry.reproduced) for entry in lean)


def test_each_of_the_two_peculiarities_is_needed() -> None:
    twice_alone = Model(kugle.inertia_counted_twice(KUGLE)).linearize()
    relative_alone = Model(kugle.all_on_relative_speed(KUGLE)).linearize()
    assert abs(0.5 * twice_alone.B[9, 0] + 6.8957) > 0.1  # heading: only with the relative speed
    assert unstable_poles(relative_alone)[0] > 5.9  # fall: only with the doubled inertia


def test_the_robot_falls_with_what_the_design_page_says() -> None:
    # design.md and published_numbers.md print 3.74 and 5.93
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
