"""Stages compared, and what a robot file states."""

import math

import numpy as np

from ballbot import Robot
from ballbot.control.overcompensation import certain_friction, stated_covariance
from ballbot.identification.quantities import FRICTION as QUANTITIES
from ballbot.identification.quantities import Layout
from ballbot.identification.stated_uncertainty import (
    LEAST_P_VALUE,
    StageEstimate,
    agreement_findings,
    of_robot_file,
    with_uncertainty,
)
from ballbot.robot.variations import draw_robots

LABELS = ("b1", "b2", "c1", "c2")
SWEEP = np.array([0.014, 0.016, 0.11, 0.09])
ERRORS = np.array([2e-4, 2e-4, 1e-3, 1e-3])


def estimate(values: np.ndarray, *, source: str = "the balancing logs", factor: float = 1.0) -> StageEstimate:
    R = np.eye(4)
    R[0, 2] = R[2, 0] = R[1, 3] = R[3, 1] = -0.9
    covariance = R * np.outer(factor * ERRORS, factor * ERRORS)
    return StageEstimate(source, LABELS, values, covariance)


def test_chance_is_reported_as_rarely_as_it_should_be():
    random = np.random.default_rng(0)
    first, second = estimate(SWEEP), estimate(SWEEP, factor=2.0)
    draws, reported = 2000, 0
    for _ in range(draws):
        one, other = (
            estimate(random.multivariate_normal(SWEEP, stage.covariance), factor=factor)
            for stage, factor in ((first, 1.0), (second, 2.0))
        )
        reported += bool(agreement_findings(one, other))
    # binomial: 5.4 expected, three deviations either way
    assert abs(reported - draws * LEAST_P_VALUE) < 3.0 * np.sqrt(draws * LEAST_P_VALUE)


def test_a_difference_beyond_the_errors_names_the_numbers_that_differ_most():
    (found,) = agreement_findings(estimate(SWEEP, source="the sweep"), estimate(SWEEP * [1.9, 1.0, 0.8, 1.0]))
    assert (found.code, found.severity) == ("methods-differ", "warning")
    assert found.text.startswith("The sweep and the balancing logs differ")
    assert all(f"{label} " in found.text for label in ("b1", "c1"))


P = np.array([0.014, 0.016, 0.013, 0.11, 0.09, 0.12, 0.05, 0.04, 0.06, 0.6, 1.1, 0.007])
LAYOUT = Layout(wheel_count=3)
NAMES = [f"friction.{name}" for name in QUANTITIES]


def test_a_number_without_an_error_has_its_interval_and_leaves_the_others_theirs(tmp_path):
    """s2 is at its bound, delta has no influence: in the file, in robots drawn and in what is compensated."""
    robot, p = Robot.load("alten"), P.copy()
    p[7] = 0.0
    covariance = np.diag((0.05 * P) ** 2)
    covariance[[7, 10]] = covariance[:, [7, 10]] = np.nan
    found = with_uncertainty(
        LAYOUT.robot_of(robot, p),
        lambda q: LAYOUT.robot_of(robot, q),
        p,
        covariance,
        names=NAMES,
        ends={7: (0.0, 0.03), 10: (0.3, 10.0)},
    )
    found.write(tmp_path / "found.toml")
    read = Robot.load(tmp_path / "found.toml")
    assert read.standard_deviations["friction.stribeck"] == (0.0025, math.inf, 0.003)
    assert read.standard_deviations["friction.stribeck_exponent"] == math.inf
    assert read.intervals == {"friction.stribeck[1]": (0.0, 0.03), "friction.stribeck_exponent": (0.3, 10.0)}
    stated = of_robot_file(read)
    assert stated is not None
    np.testing.assert_allclose(stated.covariance.diagonal()[3:6], (0.05 * P[3:6]) ** 2, rtol=1e-3)
    assert np.isinf(stated.covariance.diagonal()[[7, 10]]).all()
    assert {"s2", "delta"}.isdisjoint(stated.known)
    robots = draw_robots(read, 100, seed=0)
    drawn = np.array([(one.friction.stribeck[1], one.friction.stribeck_exponent) for one in robots])
    assert (drawn >= [0.0, 0.3]).all()
    assert (drawn <= [0.03, 10.0]).all()
    assert (drawn.std(axis=0) > [0.003, 1.0]).all()
    # at its bound, s2 is at its lowest already
    fraction = np.array(certain_friction(read).coulomb) / np.array(read.friction.coulomb)
    assert 0.85 < fraction[1] < 0.95
    # numbers that change lose both
    moved = read.replace({"friction.stribeck": (0.05, 0.01, 0.06)})
    assert set(moved.intervals) == {"friction.stribeck_exponent"}


def test_a_robot_written_and_read_again_has_the_same_covariance(tmp_path):
    robot, random = Robot.load("alten"), np.random.default_rng(5)
    p = P
    factors = random.standard_normal((12, 12)) @ np.diag(np.geomspace(3.0, 0.3, 12))
    covariance = factors @ factors.T
    sizes = np.sqrt(covariance.diagonal())
    covariance *= np.outer(0.05 * p / sizes, 0.05 * p / sizes)
    found = with_uncertainty(
        LAYOUT.robot_of(robot, p), lambda q: LAYOUT.robot_of(robot, q), p, covariance, names=NAMES
    )
    found.write(tmp_path / "found.toml")
    stated = stated_covariance(Robot.load(tmp_path / "found.toml"))
    assert stated is not None
    scale = np.outer(0.05 * p, 0.05 * p)
    # four digits are within 5e-4 of each of two deviations, five decimals within 5e-6 of the correlation
    np.testing.assert_allclose(stated[:12, :12] / scale, covariance / scale, rtol=0.0, atol=1.01e-3)
