"""Rezero's and Kugle's printed matrices and gains: what comes out, by which convention, and what they should be.

Kugle's matrices contain its own double counting. The page's other numbers are compared as a whole (test_published.py).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from campaigns.published import kugle, rezero
from campaigns.published.printed import Entry, SourceModel

REZERO = Robot.load("rezero")


@pytest.fixture(scope="module")
def entries() -> dict[str, Entry]:
    """Return the printed numbers by name; no constant, as each collection of the tests would derive them."""
    return {entry.name: entry for entry in rezero.entries(REZERO)}


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


def test_three_dimensional_gain_follows_from_the_printed_matrices() -> None:
    gain = rezero.balance_lqr(rezero.printed_model()).gain
    # the source cuts after two digits (0.01), and A and B are rounded themselves (0.001 in the gain)
    assert gain[0] == pytest.approx(np.array(rezero.PRINTED_GAIN), abs=0.011)


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
