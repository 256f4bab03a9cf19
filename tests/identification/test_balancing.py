"""Start states estimated together with the parameters: the equations, and what they are good for."""

import numpy as np
import pytest

from ballbot.fitting.fit import descend, profile
from ballbot.fitting.run import Threads
from ballbot.fitting.uncertainty import WindowEquations, covariance
from ballbot.identification.balancing import Balancing
from ballbot.identification.prediction import Predictor
from ballbot.identification.quantities import Bounds, scale_between
from ballbot.identification.windows import cut_windows
from tests.support.control_examples import alten
from tests.support.identification_examples import NOISE, TRUTH, balancing_log, noisy

pytestmark = pytest.mark.slow

DURATION = 10.0  # [s]
STEP = 2.5e-3  # [s], inner step of the fits; it moves a cost by 1e-4 of itself


def problem_of(*, seed: int, bounds: Bounds | None = None, duration: float = DURATION) -> Balancing:
    """Return the fit of a noisy log; where there are bounds, of what they free, the rest held at the truth."""
    coordinates = scale_between(alten(), bounds=bounds)
    predictor = Predictor(robot=alten(), step=STEP, layout=coordinates.layout, threads=1)
    log = noisy(balancing_log(duration=duration), seed=seed)
    windows = cut_windows([log], wheel_count=3, duration=0.25)
    return Balancing(predictor=predictor, windows=windows, coordinates=coordinates, executor=Threads(count=1))


#: frees C_rr alone
TRUE = {"viscous": 0.014, "coulomb": 0.1, "stribeck": 0.05, "stribeck_speed": 0.6, "stribeck_exponent": 1.1}
HELD = Bounds({name: (value, value) for name, value in TRUE.items()} | {"rolling": (0.0, 0.05)})


@pytest.fixture(scope="module")
def problem() -> Balancing:
    return problem_of(seed=1)


@pytest.fixture(scope="module")
def finished(problem):
    return descend(
        problem, problem.coordinates.scaled(1.2 * TRUTH), free=problem.coordinates.free, most_steps=75
    )


def test_estimated_initial_states_are_near_the_true_ones(problem, finished):
    truth = cut_windows([balancing_log(duration=DURATION)], wheel_count=3, duration=0.25).initial
    measured = np.sqrt(((problem.windows.initial - truth) ** 2).mean(axis=0))
    freed = np.sqrt(((finished.end.windows.starts - truth) ** 2).mean(axis=0))
    np.testing.assert_allclose(measured, NOISE, rtol=0.35)  # 40 windows give a deviation to 11 %
    # eleven samples tie a start and its rate: on average over the states at least halved
    assert np.exp(np.log(freed / measured).mean()) < 0.6


def test_a_descent_from_elsewhere_ends_in_the_same_place(problem, finished):
    anywhere = np.where(problem.coordinates.free, 0.4, finished.point)
    other = descend(problem, anywhere, free=problem.coordinates.free, most_steps=75)
    errors = np.sqrt(covariance(finished.equations, problem.coordinates.free).diagonal())
    # a window in another minimum over its start costs 1e-4, and moves parameters by a fraction of their errors
    assert other.cost == pytest.approx(finished.cost, abs=5e-4)
    assert (np.abs(other.point - finished.point) / errors).max() < 0.5


def test_known_friction_is_found_within_its_errors_and_better_than_from_measured_starts(problem, finished):
    free = problem.coordinates.free
    errors = np.sqrt(covariance(finished.equations, free).diagonal())
    deviation = (finished.point - problem.coordinates.scaled(TRUTH)) / errors
    # 3.5 of them: one in 2000 if normal, and twelve are looked at
    assert np.abs(deviation).max() < 3.5
    held = problem.linearize_widely(problem.coordinates.scaled(TRUTH), problem.windows.initial)
    there = WindowEquations(matrices=held.H, scores=held.g)
    from_measured = np.sqrt(covariance(there, free).diagonal())
    assert np.median(from_measured / errors) > 1.5


def test_the_equations_are_the_gradient_of_the_cost_with_starts_that_follow(problem, finished):
    point = finished.point.copy()
    point[3] += 0.01  # c1, off the optimum
    starts = finished.end.windows.starts
    for _ in range(3):  # let the starts settle there
        about = problem.linearize_widely(point, starts)
        starts = starts + about.shift
    about = problem.linearize_widely(point, starts)
    normal = about.equations
    step = 1e-3
    moved = np.stack([point, point])
    moved[0, 3], moved[1, 3] = point[3] + step, point[3] - step
    follow = np.stack([starts + about.shift + about.response @ (one - point) for one in moved])
    rise = problem.costs(moved, follow)
    expected = (rise[0] - rise[1]) / (2 * step) * problem.residual_count
    # differences over sticking steps, and weights taken at the point: a few hundredths
    assert normal.scores.sum(axis=0)[3] == pytest.approx(expected, rel=0.1)


@pytest.mark.slow
def test_a_profile_is_the_interval_where_the_fit_is_nearly_straight():
    problem = problem_of(seed=2, bounds=HELD)
    free = problem.coordinates.free
    place = problem.coordinates.labels.index("C_rr")
    found = descend(problem, problem.coordinates.scaled(TRUTH), free=free, most_steps=20)
    independent = 1.0 / np.sqrt(found.equations.matrix[place, place])
    lower, upper = profile(found, place, free=free, error=2.0 * independent, rise=4.0)
    assert lower is not None
    assert upper is not None
    # rise = ((p - p^) / error)^2, found to a tenth, which is a twentieth of the distance; sticking bends the rest
    assert found.point[place] - lower == pytest.approx(2.0 * independent, rel=0.15)
    assert upper - found.point[place] == pytest.approx(2.0 * independent, rel=0.15)
