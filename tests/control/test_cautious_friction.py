"""Compensation limited by what is certain: against robots drawn from the covariance itself."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot.control.overcompensation import cautious_friction, certain_friction
from ballbot.mechanics.friction import wheel_friction
from ballbot.robot import Friction, Robot
from ballbot.robot.components import Correlation
from tests.support.control_examples import FRICTION

SPEEDS = np.array([0.05, 0.3, 1.0, 4.0])


def drawn_covariance(seed: int) -> np.ndarray:
    """Return a covariance (12, 12) as identification leaves them: b against c and c against s at -0.9."""
    errors = np.array([0.003] * 3 + [0.012] * 3 + [0.012] * 3 + [0.05, 0.05, 0.0005])
    correlation = np.eye(12)
    for i in range(3):
        for j, k, value in ((i, 3 + i, -0.8), (3 + i, 6 + i, -0.5)):
            correlation[j, k] = correlation[k, j] = value
    return np.random.default_rng(seed).uniform(0.5, 1.5) ** 2 * errors[:, None] * correlation * errors


def curve(values: np.ndarray, wheel: int) -> np.ndarray:
    b, c, s, v_s, delta = values[[wheel, 3 + wheel, 6 + wheel, 9, 10]]
    return b * SPEEDS + c + s * np.exp(-((SPEEDS / v_s) ** delta))


@pytest.mark.parametrize("load", [0.0, 1.5])
def test_few_robots_with_terms_by_direction_and_load_have_less_friction(load):
    friction = replace(FRICTION, coulomb_asymmetry=(0.03, -0.02, 0.01), load=(0.05, 0.04, 0.06))
    covariance = np.zeros((21, 21))
    covariance[:12, :12] = drawn_covariance(1)
    covariance[12:, 12:] = np.diag([0.01] * 3 + [0.005] * 3 + [0.02] * 3) ** 2
    cautious = cautious_friction(friction, covariance)
    mean = np.concatenate([FRICTION.viscous, FRICTION.coulomb, FRICTION.stribeck, [0.6, 1.1, 0.007]])
    mean = np.concatenate([mean, friction.coulomb_asymmetry, np.zeros(3), friction.load])
    robots = np.random.default_rng(0).multivariate_normal(mean, covariance, 4000)
    for wheel, direction in itertools.product(range(3), (1.0, -1.0)):
        speeds = np.tile(direction * SPEEDS[:, None], 3)
        safe = direction * wheel_friction(speeds, cautious, torque=np.full_like(speeds, load))[:, wheel]
        d, e, mu = robots[:, 12 + wheel, None], robots[:, 15 + wheel, None], robots[:, 18 + wheel, None]
        b, c, s = robots[:, wheel, None], robots[:, 3 + wheel, None], robots[:, 6 + wheel, None]
        decay = np.exp(-((SPEEDS / robots[:, 9, None]) ** robots[:, 10, None]))
        true = b * SPEEDS + c + direction * d + (s + direction * e) * decay + mu * load
        assert (true < safe).mean(axis=0).max() < 0.065
    # the uncertain terms make it more cautious than b, c and s alone do
    assert np.all(np.array(cautious.coulomb) < cautious_friction(friction, covariance[:12, :12]).coulomb)


def test_certain_friction_is_compensated_whole_and_uncertain_friction_not_at_all():
    assert cautious_friction(FRICTION, np.zeros((12, 12))) == FRICTION
    unknown = np.zeros((12, 12))
    unknown[3, 3] = 1.0
    cautious = cautious_friction(FRICTION, unknown)
    assert cautious.coulomb[0] == cautious.viscous[0] == 0.0
    assert cautious.coulomb[1:] == FRICTION.coulomb[1:]
    unknown[:] = np.nan  # nothing has an error, and nothing limits it but zero
    cautious = cautious_friction(FRICTION, unknown)
    assert not any((*cautious.viscous, *cautious.coulomb, *cautious.stribeck, cautious.rolling))


LABELS = [
    *(f"friction.{name}[{wheel}]" for name in ("viscous", "coulomb", "stribeck") for wheel in range(3)),
    *("friction.stribeck_speed", "friction.stribeck_exponent", "friction.rolling"),
]
VALUES = np.array([*FRICTION.viscous, *FRICTION.coulomb, *FRICTION.stribeck, 0.6, 1.1, 0.007])


def shares(friction: Friction) -> np.ndarray:
    """Return which shares of the wheels' and of the rolling friction are left, means over the speeds."""
    speeds = np.tile(np.geomspace(0.02, 8.0, 60)[:, None], 3)  # those by which the shares are chosen
    wheels = (wheel_friction(speeds, friction) / wheel_friction(speeds, FRICTION)).mean(axis=0)
    return np.array([*wheels, friction.rolling / FRICTION.rolling])


@settings(max_examples=30)
@given(seed=st.integers(0, 2**16), unknown=st.sets(st.integers(0, 11), min_size=1))
def test_an_unknown_error_never_leads_to_more_than_a_known_one(seed: int, unknown: set[int]):
    """Of any covariance: whatever stays within an interval leaves no less friction than the interval does."""
    covariance = drawn_covariance(seed)
    missing, places = covariance.copy(), sorted(unknown)
    missing[places] = missing[:, places] = np.nan
    half = 3.0 * np.sqrt(covariance.diagonal())  # 1.64 of them count; the curve bends by less than the rest
    intervals = {LABELS[i]: (max(VALUES[i] - half[i], 1e-3), VALUES[i] + half[i]) for i in places}
    known = shares(cautious_friction(FRICTION, covariance))
    assert (shares(cautious_friction(FRICTION, missing, intervals=intervals)) <= known + 1e-12).all()
    # and no less than without any interval, by the range alone
    assert (shares(cautious_friction(FRICTION, missing)) <= known + 1e-12).all()


def test_an_unknown_error_costs_what_its_interval_allows():
    covariance = np.zeros((12, 12))
    covariance[[7, 11]] = covariance[:, [7, 11]] = np.inf
    intervals = {"friction.stribeck[1]": (0.03, 0.05), "friction.rolling": (0.005, 0.02)}
    cautious = cautious_friction(FRICTION, covariance, intervals=intervals)
    # at rest 0.12 of 0.13 N m are certain: the least share of all speeds, where s acts
    assert cautious.coulomb[1] / FRICTION.coulomb[1] == pytest.approx(0.12 / 0.13, abs=5e-3)
    assert cautious.rolling == 0.005
    assert cautious.coulomb[0] == FRICTION.coulomb[0]
    # a parameter at its lower bound is at its lowest already
    none = replace(FRICTION, stribeck=(0.05, 0.0, 0.06))
    assert cautious_friction(none, covariance).coulomb == FRICTION.coulomb


def test_an_error_that_friction_shares_with_the_torque_constant_does_not_weaken_compensation():
    """Whatever a commanded torque is worth, the logs show what was commanded against the friction."""
    none = (0.0, 0.0, 0.0)
    dry = replace(FRICTION, viscous=none, stribeck=none, rolling=0.0)
    robot = Robot.load("alten").replace(friction=dry)
    names = [f"friction.coulomb[{i}]" for i in range(3)]
    k_t = robot.drive.torque_constant
    shared = robot.annotated(
        standard_deviations={
            "friction.coulomb": tuple(0.05 * c for c in FRICTION.coulomb),
            "drive.torque_constant": 0.05 * k_t,
        },
        correlation=Correlation.of_matrix([*names, "drive.torque_constant"], np.ones((4, 4))),
    )
    assert certain_friction(shared).coulomb == pytest.approx(FRICTION.coulomb, rel=1e-3)
    apart = certain_friction(shared.annotated(correlation=Correlation()))
    assert max(np.array(apart.coulomb) / FRICTION.coulomb) < 0.9
