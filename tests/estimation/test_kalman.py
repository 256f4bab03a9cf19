"""The Kalman filter: its parts against independent values, its errors against its covariance."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.stats import chi2

from ballbot.control.presets import nominal_controller
from ballbot.control.references import figure_eight
from ballbot.errors import InputError
from ballbot.estimation.interface import Fix, Reading
from ballbot.estimation.kalman import KalmanFilter, kalman_record
from ballbot.estimation.kalman_model import (
    BIAS,
    DRIFT,
    ENTRIES,
    FIRST,
    LEAN_ERROR,
    PSI,
    SENSORS,
    SHOWN_PSI,
    STATES,
    FilterNoise,
    G,
    KalmanRecord,
    Numbers,
    S,
    X,
    motion,
    tilt,
    transition,
)
from ballbot.estimation.swing import swing, turned_about_vertical
from ballbot.mechanics.geometry import body_rates_matrix, rotation
from ballbot.mechanics.model import Model, contact_momentum
from ballbot.robot import Friction
from ballbot.simulation.run import simulate
from tests.support.estimation_examples import (
    ALTEN,
    H,
    Run,
    all_covariances,
    covariance_of,
    light_wheels,
    swaying,
    turned,
)

LIGHT = light_wheels()
NOISE = FilterNoise.of(ALTEN)
#: a mean over no time, which adds nothing to the density of the pivoting [s]
NEVER = 1e-9
leans = arrays(np.float64, 2, elements=st.floats(-0.6, 0.6))


def ran(run: Run, noise: FilterNoise = NOISE) -> tuple[KalmanFilter, NDArray[np.float64]]:
    """A filter after a run, and its states (N, 10)."""
    kalman = KalmanFilter(LIGHT, sample_time=H, noise=noise)
    return kalman, np.array([kalman.update(reading) for reading in run.readings])


# the parts


@settings(deadline=None)  # the first example compiles
@given(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), st.floats(-9, 9), st.floats(-3, 3))
def test_heading_and_lean_are_the_attitude_and_know_nothing_of_each_other(theta, phi, psi, turn) -> None:
    *lean, heading = swing(theta, phi, psi)
    s, c = np.sin(heading), np.cos(heading)
    about_vertical = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    assert_allclose(about_vertical @ np.array(tilt(tuple(lean))), rotation(theta, phi, psi), atol=1e-12)
    turned = turned_about_vertical(np.array([theta, phi, psi]), turn)
    assert_allclose(swing(*turned), [*lean, heading + turn], atol=1e-9)
    assert_allclose(turned_about_vertical(turned, -turn), [theta, phi, psi], atol=1e-9)


def test_momentum_with_massless_wheels_equals_the_planar_two_body_formula() -> None:
    body, ball = LIGHT.body, LIGHT.ball
    mass = ball.mass + ball.inertia / ball.radius**2 + body.mass
    whole = mass + body.mass * body.center_of_mass / ball.radius
    lever = (4.37 / ball.radius + body.mass * body.center_of_mass) / whole
    pull = body.mass * body.center_of_mass * LIGHT.gravity / ball.radius / whole
    found = contact_momentum(LIGHT)
    assert_allclose(found.lever, [[0, lever, 0], [-lever, 0, 0]], atol=1e-9)
    assert_allclose(found.pull, pull * np.eye(2), atol=1e-9)


def test_only_gravity_changes_the_momentum_whatever_the_driveline_does() -> None:
    """The exact model with dry friction and wild torques keeps d/dt (v + C w) = -Lambda g; torques alone do not."""
    rough = replace(Friction.none(3), viscous=(0.02,) * 3, coulomb=(0.1,) * 3, stribeck=(0.05,) * 3)
    robot = ALTEN.replace(friction=rough)
    model, law = Model(robot), contact_momentum(robot)
    random = np.random.default_rng(1)
    state = np.array([0, 0, 0.03, -0.02, 0.7, 0.1, -0.05, 0.0, 0.02, 0.3])
    momenta, leans_ = [], []
    for _ in range(61):
        s3, c3 = np.sin(state[4]), np.cos(state[4])
        turn = np.array([[c3, -s3], [s3, c3]])
        rate = body_rates_matrix(*state[2:5]) @ state[7:]
        momenta.append(state[5:7] + turn @ law.lever @ rate)
        leans_.append(turn @ law.pull @ swing(*state[2:5])[:2])
        state = model.advance(state, random.uniform(-1.5, 1.5, 3), H)
    by_gravity = -H * (np.sum(leans_, axis=0) - 0.5 * (leans_[0] + leans_[-1]))
    # 0.3 s; the speed itself has changed by more; neglected: squares of lean and rates, up to 0.1^2
    assert np.linalg.norm(by_gravity) > 0.05
    assert_allclose(momenta[-1] - momenta[0], by_gravity, atol=0.01 * float(np.linalg.norm(by_gravity)))
    assert np.linalg.norm(state[5:7] - [0.1, -0.05] - by_gravity) > 0.5 * np.linalg.norm(by_gravity)


class Dense:
    """A sample of the filter by the textbook's matrices; the ball does not pivot."""

    def __init__(self, model: KalmanRecord, gyro: NDArray[np.float64], shown: NDArray[np.float64]) -> None:
        lever, pull = (tuple(map(tuple, one.tolist())) for one in (model.lever, model.pull))
        self.model, self.gyro, self.shown = model, tuple(gyro), shown
        self.numbers = Numbers(model.sample_time, model.radius, (), lever, pull, 0.0, model.forgotten)

    def moved(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        change, v = (np.array(one) for one in motion(self.numbers, tuple(x), self.gyro))
        middle = x[PSI] + 0.5 * change[PSI]
        turn = np.array([[np.cos(middle), -np.sin(middle)], [np.sin(middle), np.cos(middle)]])
        return x + np.append(change, H * turn @ v), v

    def F(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        F, turn = np.eye(STATES), (np.sin(x[PSI]), np.cos(x[PSI]))
        for (rows, j), value in zip(
            ENTRIES, transition(self.numbers, tuple(x), self.gyro, turn), strict=True
        ):
            F[list(rows), j] += value
        F[:, LEAN_ERROR : LEAN_ERROR + 2] *= 1.0 - self.model.forgotten
        return F

    def seen(self, x: NDArray[np.float64], v: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
        """Residuals, and H."""
        residuals, rows = [], []
        for one in SENSORS:
            shown = tuple(self.shown[FIRST[one.name] :][: len(one.states)])
            found, entries = one.seen(self.numbers, tuple(x), shown, self.gyro, tuple(v))
            residuals += found
            numbers = iter(entries)
            rows += [{state: next(numbers) for state in states} for states in one.states]
        return np.array(residuals), np.array([[row.get(k, 0.0) for k in range(STATES)] for row in rows])


def dense(random: np.random.Generator) -> Dense:
    model = kalman_record(ALTEN, sample_time=H, noise=NOISE)
    return Dense(model, random.uniform(-1, 1, 3), random.uniform(-3, 3, FIRST["fix"] + 3))


@pytest.mark.parametrize("seed", range(2))
def test_derivatives_are_those_of_the_functions(seed: int) -> None:
    """At random states that lean by up to 6 degrees, against central differences."""
    random = np.random.default_rng(seed)
    x, one = random.uniform(-0.1, 0.1, STATES), dense(random)
    # F is to first order in h: h^2/2 times gravity's 7 m/s^2 and rates of some 1 rad/s
    assert_allclose(one.F(x), numerical(lambda x: one.moved(x)[0], x), atol=5e-4)

    def expected(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return -one.seen(x, x[S : S + 2] - one.model.lever @ (one.gyro - x[BIAS : BIAS + 3]))[0]

    # rows are to first order: lean times ball's rate
    for lean, tolerance in ((0.0, 1e-6), (0.1, 0.1 * 2 * 3.0)):
        x[G : G + 2] = lean
        assert_allclose(one.seen(x, np.zeros(2))[1], numerical(expected, x), atol=tolerance)


def numerical(
    function: Callable[[NDArray[np.float64]], NDArray[np.float64]], x: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Central differences: a column for each state."""
    steps = 1e-5 * np.eye(STATES)
    return np.array([(function(x + step) - function(x - step)) / 2e-5 for step in steps]).T


# the whole


def normalized(run: Run, kalman: KalmanFilter, state: NDArray[np.float64]) -> tuple[float, float]:
    """Squared errors over the covariance: of place, attitude and velocity together (7), and of the bias (3)."""
    error = (state - run.truth[-1])[:7]
    bias = kalman._x[BIAS : BIAS + 3] - run.bias
    spread = all_covariances(kalman)[BIAS : BIAS + 3, BIAS : BIAS + 3]
    return float(error @ np.linalg.solve(covariance_of(kalman), error)), float(
        bias @ np.linalg.solve(spread, bias)
    )


@pytest.mark.slow
def test_filter_errors_match_its_covariance() -> None:
    """24 robots that sway, turn and slip with noise of the filter's sizes: errors are chi-squared."""
    found = []
    for seed in range(24):
        run = swaying(samples=600, seed=seed, noise=NOISE)
        kalman, states = ran(run)
        found.append(normalized(run, kalman, states[-1]))
    for total, degrees in zip(np.sum(found, axis=0), (7, 3), strict=True):
        low, high = chi2.ppf([1e-4, 1 - 1e-4], degrees * len(found))
        assert low < total < high


def test_heading_uncertainty_walks_by_pivoting_without_references() -> None:
    """A gyro of any bias and an AHRS of any drift leave the wheels: the heading walks by `pivoting` a root second.

    An unsure lean adds to that, for the ball's turning is then not known to be level; a sure one, seen to turn in the
    body's frame, contains a little information on the bias.
    """
    blind = replace(NOISE, gyro_bias=1.0, heading_bias=1.0, heading_drift=1.0, pivoting_time=NEVER)
    run = swaying(samples=4000, seed=1, noise=replace(NOISE, gyro_bias=0.01, heading_bias=0.01))
    walked = blind.pivoting * np.sqrt(4000 * H)
    assert 0.9 * walked < np.sqrt(covariance_of(ran(run, blind)[0])[4, 4]) < 1.5 * walked
    level = replace(blind, lean_error=1e-6)
    assert np.sqrt(covariance_of(ran(run, level)[0])[4, 4]) == pytest.approx(walked, rel=0.1)


def test_drift_of_the_ahrs_is_not_taken_for_a_bias_of_the_gyro() -> None:
    run = swaying(samples=1000, seed=3, noise=replace(NOISE, gyro_bias=1e-9, heading_bias=1e-9))
    kalman, _ = ran(run, replace(NOISE, pivoting=1e3))  # the wheels show nothing of the heading
    drifted = kalman._x[DRIFT]
    assert abs(drifted) > 1e-3
    assert abs(kalman._x[BIAS + 2]) < 0.1 * abs(
        drifted
    )  # 0.5 with independent priors; what the lean shows is 0.03


def test_the_exact_model_s_figure_of_eight_is_followed() -> None:
    """Perfect encoders and a gyro with bias, an AHRS whose heading runs away by 16 degrees in 3 minutes."""
    log = simulate(Model(ALTEN), nominal_controller(ALTEN), figure_eight(), duration=40.0)
    random = np.random.default_rng(1)
    sensors, truth = ALTEN.sensors, log.truth().states
    rate = np.einsum("nij,nj->ni", body_rates_matrix(*truth[:, 2:5].T), truth[:, 7:])
    bias = np.array([0.002, -0.001, 0.0015])
    kalman = KalmanFilter(ALTEN, sample_time=H)
    attitude = truth[:, 2:5] + sensors.attitude_noise * random.standard_normal((len(log), 3))
    attitude = turned(attitude, sensors.heading_drift * log.t)
    found = []
    for k in range(len(log)):
        gyro = rate[k] + bias + sensors.gyro_noise * random.standard_normal(3)
        angles = np.array([log[f"wheel{i}"][k] for i in (1, 2, 3)])
        found.append(
            kalman.update(
                Reading(wheel_angles=angles, wheel_speeds=np.zeros(3), gyro=gyro, attitude=attitude[k])
            )
        )
    error = np.array(found) - truth
    assert np.degrees(attitude[-1, 2] - truth[-1, 4]) == pytest.approx(3.55, abs=0.4)
    assert np.abs(np.degrees(error[:, 4])).max() < 1.2  # 0.005 rad a root second would be 1.8
    assert np.abs(error[:, :2]).max() < 0.012  # that heading's over 0.5 m
    assert np.degrees(np.sqrt(np.mean(error[400:, 2:4] ** 2))) < 0.05
    assert_allclose(kalman._x[BIAS : BIAS + 3], bias, atol=5e-4)
    assert np.degrees(kalman._x[SHOWN_PSI] - kalman._x[PSI]) == pytest.approx(3.55, abs=1.2)


def test_fix_removes_the_drift_and_missing_fix_changes_nothing() -> None:
    run = swaying(samples=1000, seed=4, noise=NOISE)
    kalman, _ = ran(run)
    before, drifted = covariance_of(kalman), kalman._x.copy()
    for lost in (Fix(), Fix(position=np.full(2, np.nan), heading=float("nan"))):
        kalman._take_fix(lost)
        assert (kalman._x == drifted).all()
    place = np.array([3.0, -1.0])
    kalman._take_fix(Fix(position=place, heading=drifted[PSI] + 0.3 + 4 * np.pi, heading_deviation=1e-3))
    assert_allclose(kalman._x[X : X + 2], place, atol=5.0)
    assert (np.diag(covariance_of(kalman))[:2] < 0.005**2).all()
    assert np.diag(covariance_of(kalman))[4] < 1e-3**2 < before[4, 4]
    assert kalman._x[PSI] == pytest.approx(drifted[PSI] + 0.3, abs=0.02)  # whole turns do not matter


def test_a_pivoting_ball_does_not_take_the_heading_along() -> None:
    spin = np.where((np.arange(4000) >= 3000) & (np.arange(4000) < 3200), 0.8, 0.0)  # 46 degrees in 1 s
    run = swaying(samples=4000, seed=1, noise=replace(NOISE, gyro_bias=1e-4, heading_bias=1e-4), pivot=spin)
    watchful, trusting = NOISE, replace(NOISE, pivoting_time=NEVER)
    errors = [np.degrees(ran(run, noise)[1][-1, 4] - run.truth[-1, 4]) for noise in (watchful, trusting)]
    assert abs(errors[0]) < 3.5  # of 46; eight seeds have 0.8 to 3.0
    assert abs(errors[1]) > 5 * abs(errors[0])


def test_a_robot_file_that_lets_the_ball_pivot_makes_the_wheels_count_less() -> None:
    known = FilterNoise.of(ALTEN.replace({"friction.pivoting": 0.0005}))
    assert known.pivoting > 2 * NOISE.pivoting == 2 * FilterNoise.pivoting
    assert replace(known, pivoting=NOISE.pivoting) == NOISE


def test_reset_restores_the_initial_state() -> None:
    run = swaying(samples=50, seed=1, noise=NOISE)
    kalman, fresh = ran(run)[0], KalmanFilter(LIGHT, sample_time=H)
    for one in (kalman, fresh):
        one.reset(position=(1.0, 2.0))
    for reading in run.readings:
        assert (kalman.update(reading) == fresh.update(reading)).all()
    assert_allclose(fresh.update(run.readings[-1])[:2], [1.0, 2.0], atol=0.1)


def test_invalid_filter_parameters_are_refused() -> None:
    with pytest.raises(InputError, match="above 0 s"):
        KalmanFilter(ALTEN, sample_time=0.0)
    with pytest.raises(InputError, match="position_deviation"):
        Fix(position_deviation=0.0)
    with pytest.raises(InputError, match="x and y"):
        Fix(position=np.zeros(3))
