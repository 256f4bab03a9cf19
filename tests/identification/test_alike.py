"""Motors that the logs cannot separate: when they are fitted as one, and what their numbers and errors are then."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot.fitting.intervals import Interval, Uncertainty
from ballbot.fitting.uncertainty import WindowEquations
from ballbot.identification import identify
from ballbot.identification import variation as motors
from ballbot.identification.identify import IdentificationOptions
from ballbot.identification.quantities import Coordinates, scale_between
from ballbot.identification.variation import WHEELS_APART, inseparable, uncertainty_of_each
from tests.support.control_examples import FRICTION, alten
from tests.support.identification_examples import TRUTH, balancing_log, noisy

SPEEDS = np.linspace(-3.0, 3.0, 200)[:, None] * np.ones(3)
NONE = np.zeros(12, dtype=bool)
SPACE = scale_between(alten(FRICTION), free=("viscous", "coulomb", "rolling"))


def fitted(*, seen: float, between: float) -> WindowEquations:
    """Return equations that see the friction of all wheels, and of their differences a share."""
    random, p = np.random.default_rng(0), len(TRUTH)
    J = seen * random.normal(size=(80, 50, p)) * SPACE.free
    columns = SPACE.layout.columns("coulomb")
    assert columns is not None
    mean = J[..., columns].mean(axis=-1, keepdims=True)
    J[..., columns] = mean + between * (J[..., columns] - mean)
    r = random.normal(size=(80, 50))
    return WindowEquations(matrices=np.einsum("wki,wkj->wij", J, J), scores=np.einsum("wki,wk->wi", J, r))


def tied(*names: str) -> Coordinates:
    return replace(SPACE, alike=names)


@pytest.mark.parametrize(("between", "names"), [(1.0, ()), (0.02, ("coulomb",))])
def test_wheels_are_fitted_as_one_if_their_differences_are_not_known_to_less_than_their_mean(between, names):
    # a scaled error of 1 / (2 sqrt(4000)) is 0.004 N m of c; with a fiftieth of the sight of differences 0.2 N m
    found = inseparable(SPACE, fitted(seen=2.0, between=between), TRUTH, unknown=NONE, speeds=SPEEDS)
    assert found == names


def test_numbers_that_are_equal_move_together_and_count_once():
    space = tied("coulomb")
    assert int(space.free.sum()) == int(SPACE.free.sum()) - 2
    point = space.scaled(TRUTH)
    point[3] = 0.5
    values = space.physical(point)
    np.testing.assert_allclose(values[3:6], 0.25)  # half of the range
    np.testing.assert_allclose(values[:3], TRUTH[:3])


def test_each_wheels_error_contains_by_how_much_motors_differ():
    space = tied("coulomb")
    point = space.scaled(TRUTH)
    values, scaled = space.physical(point), 0.01 / np.where(space.free, space.slopes(point), np.nan)
    R = np.where(np.outer(space.free, space.free), np.eye(12), np.nan)
    intervals = {
        "c1": Interval(lower=0.09, upper=np.inf, method="clustered"),
        "b1": Interval(lower=0.0, upper=0.02, method="at bound"),
    }
    C = R * np.outer(scaled, scaled)
    common = Uncertainty(coordinates=space, point=point, covariance=C, bootstrap=scaled, intervals=intervals)
    found = uncertainty_of_each(space, common)
    apart = WHEELS_APART * values[3]
    np.testing.assert_allclose(found.standard_errors[3:6], np.hypot(0.01, apart))
    # what is common to the wheels is their mean's error
    np.testing.assert_allclose(found.correlation[3, 4], 0.01**2 / (0.01**2 + apart**2))
    np.testing.assert_allclose(found.correlation[3:6, 3:6].diagonal(), 1.0)
    assert found.intervals["b1"] == Interval(lower=0.0, upper=0.02, method="at bound")
    assert found.intervals["c3"] == found.intervals["c1"]
    assert found.intervals["c1"].upper == np.inf  # what was open stays open
    half = np.hypot(values[3] - 0.09, 1.96 * apart)
    assert found.intervals["c1"].lower == pytest.approx(values[3] - half)
    assert np.isnan(found.standard_errors[6:9]).all()


@pytest.mark.slow
def test_a_fit_of_motors_as_one_says_so_and_has_one_number_for_them(monkeypatch):
    monkeypatch.setattr(motors, "INSEPARABLE", 0.0)
    log = noisy(balancing_log(), seed=4).between(6.0, 10.0)
    options = IdentificationOptions(most_steps=4, step=2.5e-3, most_profiles=0)
    found = identify(alten(), log, law="coulomb", window=0.1, options=options)
    assert next(one.text for one in found.findings if one.code == "motors-alike").startswith("Motors alike: ")
    for symbol in ("b", "c"):
        assert len(set(found.parameters[symbol])) == 1
    assert list(found.robot.friction.coulomb) == found.parameters["c"]
    # dry friction and Stribeck part of the truth together, less what has faded: 0.09 to 0.18 N m
    assert 0.08 < found.parameters["c"][0] < 0.18
    assert min(found.standard_errors["c"]) > WHEELS_APART * found.parameters["c"][0]
    assert {"c1", "c2", "c3"} <= found.intervals.keys() & found.another_log.keys()
    assert found.verdict.usable
