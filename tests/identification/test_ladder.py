"""The ladder of friction laws: the gain of each law, its interval, and the selected one."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.fitting.fit import at_bound, descend
from ballbot.fitting.model_selection import gain_between
from ballbot.fitting.uncertainty import covariance
from ballbot.identification import Bounds, identify
from ballbot.identification.balancing import Balancing
from ballbot.identification.identify import IdentificationOptions, estimated_parameters
from ballbot.identification.laws import bounds_of, law_named
from ballbot.identification.prediction import Predictor
from ballbot.identification.result import BLOCK, LawSelection, window_blocks
from ballbot.identification.windows import Span, cut_windows
from ballbot.log import Log
from tests.support.control_examples import FRICTION, alten
from tests.support.identification_examples import TRUTH, balancing_log, noisy


def groups(count: int) -> list[np.ndarray]:
    return window_blocks([Span(log=0, start=0.25 * i, end=0.25 * i + 0.25) for i in range(count)])


def test_the_interval_contains_the_truth_at_its_stated_rate():
    # errors of both laws share what is hard in a window (neighbours in common), and differ by noise without mean
    random, held = np.random.default_rng(1), 0
    repeats = 100
    for _ in range(repeats):
        hard = np.repeat(random.gamma(2.0, size=(40, 1)), BLOCK, axis=0)
        noise = np.repeat(random.normal(size=(2, 40, 10)), BLOCK, axis=1)
        ours, theirs = hard * np.exp(0.2 * noise)
        gain = gain_between(ours, theirs, groups(160))
        held += gain.lower <= 0.0 <= gain.upper
    # 95 % of 100 within three standard deviations, and the percentile bootstrap of 40 blocks is a little short
    assert 0.86 < held / repeats < 1.0


def test_blocks_are_neighbours_of_one_log():
    spans = [
        Span(log=log, start=start, end=start + 0.25) for log in (0, 1) for start in (3.0, 1.0, 2.0, 0.0, 4.0)
    ]
    found = [rows.tolist() for rows in window_blocks(spans)]
    assert found == [[3, 1, 2, 0], [4], [8, 6, 7, 5], [9]]


def test_bounds_that_a_user_gives_stay_but_for_what_a_law_does_not_have():
    given = Bounds({"viscous": (0.0, 0.02), "stribeck": (0.0, 0.3)})
    bounds = bounds_of(law_named("coulomb"), given)
    assert bounds.limits["viscous"] == (0.0, 0.02)
    assert bounds.limits["stribeck"] == (0.0, 0.0)
    with pytest.raises(InputError, match=r"'colomb' is not a friction law; did you mean 'coulomb'\?"):
        law_named("colomb")


@pytest.fixture(scope="module")
def ladder() -> LawSelection:
    """Return the ladder of a log whose friction is the viscous and Coulomb's law."""
    plain = replace(FRICTION, stribeck=(0.0, 0.0, 0.0))
    log = noisy(balancing_log(friction=plain, duration=10.0), seed=8).between(4.0, 9.5)
    options = IdentificationOptions(search_windows=16, most_steps=4, most_profiles=0)
    found = identify(alten(), log, law="best", window=0.1, seed=3, options=options)
    assert found.selection is not None
    return found.selection


@pytest.mark.slow  # six fits
def test_laws_without_a_significant_gain_are_not_selected(ladder):
    assert [one.law.name for one in ladder.candidates if one.accepted] == ["viscous", "coulomb"]
    assert ladder.best.law.name == "coulomb"
    # a law over one that was not accepted is compared with the largest accepted one within it
    assert [one.over for one in ladder.candidates] == [None, "viscous", *["coulomb"] * 4]


#: a log of a robot whose break-away friction differs with direction, and those differences [N m]
STRIBECK_ASYMMETRY = (0.03, -0.03, 0.02)


@pytest.fixture(scope="module")
def directed_log() -> Log:
    return balancing_log(friction=replace(FRICTION, stribeck_asymmetry=STRIBECK_ASYMMETRY), duration=12.0)


def problem_of(log: Log, law: str, *, step: float = 1e-3) -> Balancing:
    """Return the fit of a law to a log, C_rr held at the truth."""
    coordinates = estimated_parameters(
        alten(), free=("friction",), law=law, bounds=Bounds({"rolling": (0.007, 0.007)})
    )
    predictor = Predictor(robot=alten(), step=step, layout=coordinates.layout)
    windows = cut_windows([log], wheel_count=3, duration=0.1)
    return Balancing(predictor=predictor, windows=windows, coordinates=coordinates)


def true_values(problem: Balancing) -> np.ndarray:
    layout, values = problem.coordinates.layout, problem.coordinates.nominal.copy()
    values[: len(TRUTH)] = TRUTH
    part = layout.part("stribeck_asymmetry", values)
    if part is not None:
        part[...] = STRIBECK_ASYMMETRY
    return values


@pytest.mark.slow
def test_stribeck_asymmetry_is_identified_and_separated_from_that_of_coulomb_friction(directed_log):
    log = noisy(directed_log, seed=5)
    found = {}
    for law in ("asymmetric", "directed"):
        problem = problem_of(log, law, step=2.5e-3)
        start = true_values(problem)
        start[12:] = 0.0
        coordinates = problem.coordinates
        fit = descend(problem, coordinates.scaled(start), free=coordinates.free, most_steps=6)
        errors = np.sqrt(covariance(fit.equations, coordinates.free & ~at_bound(fit.point)).diagonal())
        found[law] = (fit, coordinates.physical(fit.point), errors * coordinates.slopes(fit.point))
    (less, _, _), (fit, values, errors) = found["asymmetric"], found["directed"]
    # the geometric mean of the states' errors falls by 6 % or more
    assert fit.history[-1] < less.history[-1] - 0.06
    e, offset = slice(12, 15), slice(15, 18)
    assert (errors[e] < 0.004).all()
    assert (np.abs(values[e] - STRIBECK_ASYMMETRY) < 4.0 * errors[e]).all()
    # none of it is taken for an asymmetry of Coulomb friction
    assert (np.abs(values[offset]) < 4.0 * errors[offset]).all()
