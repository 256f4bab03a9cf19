"""Stages compared, and logs and a free-wheel sweep in one estimate: as joint least squares, without bias."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot import Robot
from ballbot.cli.main import main
from ballbot.control.overcompensation import certain_friction, stated_covariance
from ballbot.errors import InputError
from ballbot.identification import identify
from ballbot.identification.identify import IdentificationOptions
from ballbot.identification.quantities import FRICTION as QUANTITIES
from ballbot.identification.quantities import Layout
from ballbot.identification.stages import (
    LEAST_P_VALUE,
    StageEstimate,
    agreement_findings,
    combine,
    of_robot_file,
    read_sweep,
    sweep_of,
)
from ballbot.identification.stated_uncertainty import with_uncertainty
from ballbot.robot.variations import draw_robots
from tests.support.control_examples import FRICTION, alten
from tests.support.identification_examples import balancing_log, noisy

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


DRY = replace(FRICTION, coulomb=(0.15, 0.12, 0.17), stribeck=(0.0,) * 3, stribeck_exponent=1.0)
WITH_GAINS = Layout(wheel_count=3, extra=("torque_gain",))
#: b and c of three wheels, C_rr and three gains are determined by the logs here; s, v_s and delta are not
KNOWN = np.array([*range(6), 11, 12, 13, 14])
TRUE = np.array([*DRY.viscous, *DRY.coulomb, 0.0, 0.0, 0.0, 1.0, 1.0, 0.007, 0.9, 1.1, 1.05])


def some_covariance(random: np.random.Generator, errors: np.ndarray) -> np.ndarray:
    """Return a covariance with these standard errors and correlations of any size."""
    spread = random.standard_normal((len(errors), 2 * len(errors)))
    C = spread @ spread.T
    deviations = np.sqrt(C.diagonal())
    return C * np.outer(errors / deviations, errors / deviations)


def of_logs(random: np.random.Generator) -> np.ndarray:
    """Return a covariance (15, 15) from logs, NaN for parameters that they do not determine."""
    full = np.full((15, 15), np.nan)
    errors = np.array([*[3e-3] * 3, *[1e-2] * 3, 2e-3, *[2e-2] * 3])
    full[np.ix_(KNOWN, KNOWN)] = some_covariance(random, errors)
    return full


def of_sweep(random: np.random.Generator) -> np.ndarray:
    """Return the covariances (3, 2, 2) of b and c by a sweep."""
    return np.stack([some_covariance(random, np.array([2e-4, 1.5e-3])) for _ in range(3)])


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_without_a_gain_it_is_the_joint_least_squares_of_both(seed):
    random = np.random.default_rng(seed)
    layout, own = Layout(wheel_count=3), KNOWN[:7]
    C, P = of_logs(random)[:12, :12], of_sweep(random)
    values = TRUE[:12].copy()
    values[own] += 0.5 * np.sqrt(C.diagonal()[own]) * random.uniform(-1.0, 1.0, 7)
    swept = np.stack([TRUE[:3], TRUE[3:6]], axis=1)
    moved, covariance, _ = combine(layout, values, C, sweep_of(swept, P))
    # the normal equations of both kinds of measurement at once, in the form that has the inverse covariances
    normal = np.linalg.inv(C[np.ix_(own, own)])
    right = normal @ values[own]
    for i in range(3):
        places = [i, 3 + i]
        normal[np.ix_(places, places)] += np.linalg.inv(P[i])
        right[places] += np.linalg.inv(P[i]) @ swept[i]
    np.testing.assert_allclose(moved[own], np.linalg.solve(normal, right), rtol=1e-6, atol=1e-9)
    # relative to the errors; the matrices' condition is up to 1e6
    found, joint = covariance[np.ix_(own, own)], np.linalg.inv(normal)
    np.testing.assert_allclose(found, joint, atol=1e-6 * joint.diagonal().max())
    assert np.isnan(covariance[6]).all()
    assert moved[9] == values[9]


def test_estimated_gains_give_smaller_errors_of_the_stated_size():
    random = np.random.default_rng(3)
    C, P = of_logs(random), of_sweep(random)
    draws, found = 400, []
    gains = TRUE[12:]
    # the sweep takes the logged torque for the true one
    by_sweep = np.stack([TRUE[:3], TRUE[3:6]], axis=1) / gains[:, None]
    for _ in range(draws):
        values = TRUE.copy()
        values[KNOWN] = random.multivariate_normal(TRUE[KNOWN], C[np.ix_(KNOWN, KNOWN)])
        swept = np.stack([random.multivariate_normal(by_sweep[i], P[i]) for i in range(3)])
        found.append(combine(WITH_GAINS, values, C, sweep_of(swept, P)))
    off = np.array([one[KNOWN] - TRUE[KNOWN] for one, _, _ in found])
    errors = np.array([np.sqrt(one.diagonal()[KNOWN]) for _, one, _ in found])
    deviations = off.std(axis=0)
    assert (np.abs(off.mean(axis=0)) < 4.0 * deviations / np.sqrt(draws)).all()  # ten means
    # a deviation is known to 1 / sqrt(2 * 400) = 3.5 %; the gains enter in products with b and c too
    np.testing.assert_allclose((off / errors).std(axis=0), 1.0, rtol=0.15)
    logs = np.sqrt(C.diagonal()[KNOWN])
    assert (errors.mean(axis=0) < logs).all()
    assert (errors.mean(axis=0)[:6] < 0.5 * logs[:6]).all()  # b and c, which the sweep is about


def test_contradicting_sweep_is_excluded_and_reported():
    random = np.random.default_rng(5)
    C, P = of_logs(random)[:12, :12], of_sweep(random)
    swept = np.stack([TRUE[:3], TRUE[3:6]], axis=1)
    swept[1, 1] -= 0.06  # six of the logs' errors
    sweep = sweep_of(swept, P)
    moved, covariance, (together, single) = combine(Layout(wheel_count=3), TRUE[:12], C, sweep)
    # the five others still count
    assert (covariance.diagonal()[[0, 1, 2, 3, 5]] < 0.5 * C.diagonal()[[0, 1, 2, 3, 5]]).all()
    assert (together.code, single.code) == ("methods-differ", "sweep")
    assert "c2 0.06 and 0.12" in together.text
    assert single.text.startswith("c2 of the sweep, 0.06, and of the balancing logs")
    np.testing.assert_allclose(moved, TRUE[:12], rtol=1e-12)


@pytest.mark.slow
def test_a_log_and_a_sweep_of_the_same_robot_together():
    log = noisy(balancing_log(friction=DRY), seed=4).between(4.0, 9.0)
    random = np.random.default_rng(6)
    true = np.stack([DRY.viscous, DRY.coulomb], axis=1)
    errors = np.array([3e-4, 2e-3])
    swept = true + errors * random.standard_normal((3, 2))
    sweep = sweep_of(swept, np.stack([np.diag(errors**2)] * 3))
    options = IdentificationOptions(search_windows=16, most_steps=5, step=2.5e-3, most_profiles=0)
    alone = identify(alten(), log, law="coulomb", window=0.1, options=options)
    both = identify(alten(), log, law="coulomb", window=0.1, options=replace(options, sweep=sweep))
    for symbol in ("b", "c"):
        before, after = np.array(alone.standard_errors[symbol]), np.array(both.standard_errors[symbol])
        assert (after < before).all()
        off = np.array(both.parameters[symbol]) - getattr(DRY, {"b": "viscous", "c": "coulomb"}[symbol])
        assert (np.abs(off) < 4.0 * after).all()
    assert both.standard_errors["C_rr"] < alone.standard_errors["C_rr"]
    assert abs(both.parameters["C_rr"] - DRY.rolling) < 4.0 * both.standard_errors["C_rr"]
    assert both.intervals["c1"].method == "with sweep"
    assert both.robot.friction.coulomb == tuple(both.parameters["c"])


def results(**more: object) -> dict[str, object]:
    """Return what identify-driveline writes of three wheels, as far as it counts here."""
    names = ["b", "c", "s", "v_s", "delta"]
    table = {name: [0.01, 0.02, 0.03] for name in names}
    correlation = {"labels": names, "matrices": [np.eye(5).tolist()] * 3}
    return {"parameters": table, "standard_errors": table, "correlation": correlation} | more


def test_a_sweep_of_another_robot_is_refused(tmp_path):
    path = tmp_path / "results.json"
    bound = {name: [0.01, None if name == "b" else 0.02, 0.03] for name in ("b", "c", "s", "v_s", "delta")}
    path.write_text(json.dumps(results(standard_errors=bound)))
    assert np.isnan(read_sweep(path, wheel_count=3).covariance[1, 1])
    with pytest.raises(InputError, match=r"has 3 wheels, but the robot has 4"):
        read_sweep(path, wheel_count=4)


@pytest.mark.parametrize("text", ["[]", json.dumps(results(correlation={}))])
def test_another_file_is_refused_in_a_sentence(tmp_path, text, capsys):
    path = tmp_path / "results.json"
    path.write_text(text)
    command = ["identify", "alten", "log.csv", "--sweep", str(path), "--out", str(tmp_path / "out")]
    assert main(command) == 2
    told = capsys.readouterr().err
    assert "is not a results.json of `ballbot identify-driveline`" in told
    assert told.count("\n") == 1
