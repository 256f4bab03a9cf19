"""Stages compared: chance is reported as often as it should be, and real differences with the effect they show."""

import numpy as np
import pytest

from ballbot import Robot
from ballbot.control.overcompensation import certain_friction, stated_covariance
from ballbot.identification.agreement import (
    LEAST_P_VALUE,
    StageEstimate,
    agreement_findings,
    compare,
    of_robot_file,
)
from ballbot.identification.quantities import Layout, with_friction
from ballbot.identification.stated_uncertainty import (
    joint_covariance,
    joint_errors,
    parameter_covariance,
    with_uncertainty,
)
from ballbot.robot.file import write_robot
from ballbot.robot.variations import correlations, draw_robots, uncertain

LABELS = ("b1", "b2", "c1", "c2")
SWEEP = np.array([0.014, 0.016, 0.11, 0.09])
ERRORS = np.array([2e-4, 2e-4, 1e-3, 1e-3])


def estimate(values: np.ndarray, *, source: str = "the balancing logs", factor: float = 1.0) -> StageEstimate:
    R = np.eye(4)
    R[0, 2] = R[2, 0] = R[1, 3] = R[3, 1] = -0.9
    covariance = R * np.outer(factor * ERRORS, factor * ERRORS)
    return StageEstimate(source=source, labels=LABELS, values=values, covariance=covariance)


def test_chance_is_reported_as_rarely_as_it_should_be():
    random = np.random.default_rng(0)
    first, second = estimate(SWEEP), estimate(SWEEP, factor=2.0)
    draws, reported = 4000, 0
    for _ in range(draws):
        one, other = (
            estimate(random.multivariate_normal(SWEEP, stage.covariance), factor=factor)
            for stage, factor in ((first, 1.0), (second, 2.0))
        )
        reported += bool(agreement_findings(one, other))
    # binomial: 10.8 expected, three deviations either way
    assert abs(reported - draws * LEAST_P_VALUE) < 3.0 * np.sqrt(draws * LEAST_P_VALUE)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        (1.3 * SWEEP, "One factor of 1.3"),
        (SWEEP * [1.9, 1.9, 0.8, 0.8], "More b and less c by the balancing logs is what losses of rollers"),
        (SWEEP * [1.9, 1.9, 0.8, 0.8], "b also represents losses of the rollers and their slip"),
        (SWEEP * [1.9, 1.9, 0.8, 0.8], "c also represents dry friction less what slip"),
        (SWEEP * [0.5, 0.5, 1.4, 1.4], "More b and less c by the sweep is what losses of rollers"),
        (SWEEP * [1.9, 1.9, 1.4, 1.4], "do not explain it"),
    ],
)
def test_a_difference_names_the_effect_that_it_shows(values, says):
    (found,) = agreement_findings(estimate(SWEEP, source="the sweep"), estimate(values))
    assert (found.code, found.severity) == ("methods-differ", "warning")
    assert found.text.startswith("The sweep and the balancing logs differ by more than their errors")
    assert says in found.text


def test_more_rolling_friction_alone_names_what_it_represents():
    robot, found = (
        StageEstimate(
            source=source,
            labels=("b1", "C_rr"),
            values=np.array([0.014, rolling]),
            covariance=np.diag([1e-3, 5e-4]) ** 2,
        )
        for source, rolling in (("the robot file", 0.007), ("the balancing logs", 0.014))
    )
    (one,) = agreement_findings(robot, found)
    assert "More C_rr by the balancing logs" in one.text
    assert "C_rr also represents losses of the rollers on the ball, and play of the gears" in one.text
    assert "b also" not in one.text


def test_wheels_that_differ_in_opposite_directions_are_not_explained_by_rollers():
    (one,) = agreement_findings(estimate(SWEEP), estimate(SWEEP * [1.5, 0.5, 1.0, 1.0]))
    assert "do not explain it" in one.text


def test_numbers_without_errors_are_not_compared():
    unknown = StageEstimate(
        source="the sweep", labels=LABELS, values=SWEEP, covariance=np.full((4, 4), np.nan)
    )
    assert compare(unknown, estimate(SWEEP)) is None
    assert agreement_findings(unknown, estimate(2.0 * SWEEP)) == []


def test_a_robot_file_without_deviations_is_not_compared():
    robot = Robot.load("alten")
    assert of_robot_file(robot) is None
    stated = of_robot_file(robot.annotated(standard_deviations={"friction.coulomb": (0.01, 0.02, 0.03)}))
    assert stated is not None
    assert stated.known == ["c1", "c2", "c3"]


def test_the_robot_states_the_covariance_of_its_parameters():
    robot = Robot.load("alten")
    errors = np.array([2e-4, 1e-3, 5e-4])
    R = np.array([[1.0, -0.9, 0.2], [-0.9, 1.0, 0.0], [0.2, 0.0, 1.0]])

    def robot_of(p: np.ndarray) -> Robot:
        friction = robot.friction.none(3)
        values = {"viscous": (float(p[0]),) * 3, "coulomb": (float(p[1]), 0.1, 0.1), "rolling": float(p[2])}
        return robot.replace(friction=type(friction)(**{**vars(friction), **values}))

    p = np.array([0.014, 0.11, 0.007])
    covariance = parameter_covariance(2.0 * errors, errors, R)
    # variation between logs has no correlation: twice the deviation leaves a quarter of the correlation
    assert covariance[0, 1] == pytest.approx(-0.9 * errors[0] * errors[1])
    names = ("friction.viscous", "friction.coulomb", "friction.rolling")
    found = with_uncertainty(robot_of(p), robot_of, p, covariance, names=names)
    # of the wheels' c only one follows from the parameters
    assert set(found.standard_deviations) == {"friction.viscous", "friction.rolling"}
    assert found.standard_deviations["friction.viscous"] == pytest.approx((4e-4,) * 3)
    assert found.standard_deviations["friction.rolling"] == pytest.approx(1e-3)
    labels = [one.label for one in uncertain(found)]
    # one b of three wheels, and its correlation with C_rr, to the fifth decimal
    np.testing.assert_allclose(
        correlations(found)[labels.index("friction.rolling")], [0.05, 0.05, 0.05, 1.0], atol=1e-5
    )


def test_only_rolling_friction_has_its_variation_between_logs_in_the_joint_errors():
    layout = Layout(wheel_count=3)
    errors, deviations = np.full(12, 0.1), np.full(12, 0.3)
    errors[0], deviations[3] = np.nan, np.nan
    assert joint_errors(layout, errors, deviations)[-1] == 0.3
    np.testing.assert_array_equal(joint_errors(layout, errors, deviations)[:-1], errors[:-1])
    assert joint_errors(layout, errors, np.full(12, np.nan))[-1] == 0.1
    errors[-1] = np.nan  # at a bound
    assert np.isnan(joint_errors(layout, errors, deviations)[-1])


def test_numbers_that_make_up_for_one_another_between_logs_keep_their_friction(tmp_path):
    """c and s vary by half between logs while their sum hardly does: each is stated so, and all are used together."""
    robot, n = Robot.load("alten"), 3
    p = np.array([0.014, 0.016, 0.013, 0.11, 0.09, 0.12, 0.05, 0.04, 0.06, 0.6, 1.1, 0.007])
    errors, deviations = 0.05 * p, 0.5 * p
    errors[10] = np.nan  # delta is at a bound
    R = np.eye(12)
    for wheel in range(n):
        R[n + wheel, 2 * n + wheel] = R[2 * n + wheel, n + wheel] = -0.9
    R[10] = R[:, 10] = np.nan
    joint = joint_covariance(errors, R)
    names = [f"friction.{name}" for name in ("viscous", "coulomb", "stribeck")]
    names += [f"friction.{name}" for name in ("stribeck_speed", "stribeck_exponent", "rolling")]
    found = with_uncertainty(
        with_friction(robot, p),
        lambda q: with_friction(robot, q),
        p,
        parameter_covariance(deviations, errors, R),
        names=names,
        joint=joint,
    )
    write_robot(found, tmp_path / "found.toml")
    read = Robot.load(tmp_path / "found.toml")
    assert read.standard_deviations["friction.coulomb"] == pytest.approx(deviations[3:6], rel=1e-3)
    stated = stated_covariance(read)
    assert stated is not None
    # four digits of two errors, and five decimals of a correlation
    tolerance = 1.1e-3 * np.outer(0.05 * p, 0.05 * p)
    assert (np.abs(stated[:12, :12] - joint) <= tolerance).all()
    labels = [one.label for one in uncertain(read)]
    assert "friction.stribeck_exponent" not in labels
    # compensation, and robots drawn, are as far off as the errors together, not as the numbers by themselves
    fraction = np.array(certain_friction(read).coulomb) / np.array(read.friction.coulomb)
    assert (fraction > 0.85).all()
    breakaway = np.array(
        [np.add(one.friction.coulomb, one.friction.stribeck) for one in draw_robots(read, 400, seed=0)]
    )
    g = np.eye(12)[3:6] + np.eye(12)[6:9]
    # 400 draws give a standard deviation to 3.5 %; four of those
    np.testing.assert_allclose(breakaway.std(axis=0), np.sqrt((g @ joint @ g.T).diagonal()), rtol=0.14)
    # another log's b and c are compared one by one
    by_number = of_robot_file(read)
    assert by_number is not None
    np.testing.assert_allclose(np.sqrt(by_number.covariance.diagonal()), deviations, rtol=1e-3)


def test_a_robot_written_and_read_again_has_the_same_covariance(tmp_path):
    robot, random = Robot.load("alten"), np.random.default_rng(5)
    p = np.array([0.014, 0.016, 0.013, 0.11, 0.09, 0.12, 0.05, 0.04, 0.06, 0.6, 1.1, 0.007])
    factors = random.standard_normal((12, 12)) @ np.diag(np.geomspace(3.0, 0.3, 12))
    covariance = factors @ factors.T
    sizes = np.sqrt(covariance.diagonal())
    covariance *= np.outer(0.05 * p / sizes, 0.05 * p / sizes)
    names = [f"friction.{name}" for name in ("viscous", "coulomb", "stribeck")]
    names += [f"friction.{name}" for name in ("stribeck_speed", "stribeck_exponent", "rolling")]
    found = with_uncertainty(
        with_friction(robot, p), lambda q: with_friction(robot, q), p, covariance, names=names
    )
    write_robot(found, tmp_path / "found.toml")
    stated = stated_covariance(Robot.load(tmp_path / "found.toml"))
    assert stated is not None
    scale = np.outer(0.05 * p, 0.05 * p)
    # four digits are within 5e-4 of each of two deviations, five decimals within 5e-6 of the correlation
    np.testing.assert_allclose(stated[:12, :12] / scale, covariance / scale, rtol=0.0, atol=1.01e-3)
