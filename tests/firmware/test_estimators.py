"""The estimators in C against those in Python, on readings with and without gaps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ballbot import Robot
from ballbot.control.records import schema_of
from ballbot.estimation import OnboardState
from ballbot.estimation.interface import EstimatorName, Reading
from ballbot.estimation.kalman import KalmanFilter
from ballbot.firmware.build import compilers
from ballbot.firmware.estimators import ReadingRecord, reading_record
from ballbot.firmware.processor_load import readings
from ballbot.mechanics.geometry import transforms
from campaigns.firmware_estimators import (
    MEMORIES,
    ROUNDOFF,
    Compiled,
    H,
    Rounded,
    covariances,
    driven_run,
    long_run,
)

pytestmark = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")

ALTEN = Robot.load("alten")


def compared(
    name: EstimatorName, robot: Robot, given: list[Reading], h: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], Compiled, OnboardState | KalmanFilter]:
    """Return the states (N, 10) of the estimator in C and of the one in Python, and both estimators."""
    of_python = (OnboardState if name == "onboard" else KalmanFilter)(robot, sample_time=h)
    of_c = Compiled(name, robot, sample_time=h)
    rows = [(of_c.update(reading), of_python.update(reading)) for reading in given]
    found, exact = (np.array(column) for column in zip(*rows, strict=True))
    return found, exact, of_c, of_python


@pytest.mark.parametrize(("preset", "missing"), [("alten", 0.0), ("cmu", 0.05)])
def test_onboard_state_is_python_s_but_for_rounding(preset, missing):
    robot = Robot.load(preset)
    found, exact, *_ = compared("onboard", robot, list(readings(robot, samples=800, missing=missing)), H)
    assert (np.isnan(found) == np.isnan(exact)).all()
    speed = (
        np.nanmax(np.abs(transforms(robot).T_obw)) * 60.0 * robot.ball.radius
    )  # wheels turn by up to 60 rad/s
    # a velocity is a sum of some 20 products, each rounded, of numbers up to that size; angles only pass through, or
    # grow by a rate for a sample
    bound = 20.0 * ROUNDOFF * speed
    assert np.nanmax(np.abs(found - exact)[:, 5:7]) <= bound
    assert np.nanmax(np.abs(found - exact)[:, 2:5]) <= 4.0 * ROUNDOFF * np.nanmax(np.abs(exact[:, 2:5]))
    assert (
        np.nanmax(np.abs(found - exact)[:, 7:])
        <= 20.0 * ROUNDOFF * np.nanmax(np.abs(exact[:, 7:])) + ROUNDOFF
    )
    # a position's sum is compensated: errors of the velocity remain, which have either sign
    assert np.nanmax(np.abs(found - exact)[:, :2]) <= bound * H * np.sqrt(800.0) * 4.0 + 2.0 * ROUNDOFF


@pytest.mark.parametrize(
    ("preset", "missing", "fixes"), [("alten", 0.0, 0.0), ("cmu", 0.05, 0.0), ("alten", 0.02, 0.01)]
)
def test_kalman_state_is_python_s_but_for_rounding(preset, missing, fixes):
    robot = Robot.load(preset)
    given = list(readings(robot, samples=800, missing=missing, fixes=fixes))
    found, exact, of_c, of_python = compared("kalman", robot, given, H)
    assert (np.isnan(found) == np.isnan(exact)).all()
    assert isinstance(of_python, KalmanFilter)
    rounded = Rounded(robot)
    strayed = np.array([rounded.update(reading) for reading in given])
    error, bound = (np.nanmax(np.abs(one - exact), axis=0) for one in (found, strayed))
    # a state that is given is computed from those of the filter by a few operations more
    # 0.01 to 0.6 of it measured
    assert (error <= bound + 4.0 * ROUNDOFF * np.nanmax(np.abs(exact), axis=0)).all()
    kept, P = covariances(of_c, of_python)
    memory = of_c.memory["P"][0][:12, :12]  # of x and y, what lies below the diagonal is not kept
    assert (memory == memory.T).all()
    scale = np.sqrt(np.outer(np.diagonal(P), np.diagonal(P)))
    assert np.abs((kept - P) / scale).max() < 0.01
    assert np.linalg.eigvalsh(kept / scale).min() > 0.0


@pytest.mark.sample
@pytest.mark.parametrize("fixes", [0.0, 1e-3])
def test_filter_stays_python_s_for_two_minutes(fixes):
    """`make evidence` runs two hours."""
    (look,) = long_run(ALTEN, minutes=[2.0], fixes=fixes)
    assert look.state < 0.02
    assert look.covariance < 0.01
    assert look.correlation > 0.5 * look.exact_correlation


@pytest.mark.sample
@pytest.mark.parametrize("fixes", [0.0, 1e-4])
def test_covariance_in_single_precision_stays_positive(fixes):
    """`make evidence` runs four hours."""
    looks = driven_run(ALTEN, minutes=[1.0, 20.0], fixes=fixes, looks=20)
    for look in looks:
        assert look.state < 0.05
        assert look.covariance < 0.02
        assert look.correlation > 0.5 * look.exact_correlation > 0.0


def test_nothing_is_known_before_a_whole_reading():
    first = next(readings(ALTEN, samples=1))
    for name in MEMORIES:
        record = reading_record(first, robot=ALTEN)
        record["gyro"][0, 1] = np.nan
        estimator = Compiled(name, ALTEN)
        state, whole = estimator.take(record)
        assert np.isnan(state).all()
        assert not whole
        assert not estimator.memory["started"]


@pytest.mark.parametrize("name", MEMORIES)
def test_reset_starts_at_the_position(name):
    estimator, fresh = Compiled(name, ALTEN), Compiled(name, ALTEN)
    given = list(readings(ALTEN, samples=20))
    for reading in given:
        estimator.update(reading)
    for one in (estimator, fresh):
        one.reset(position=(1.5, -2.0))
    again = [(estimator.update(reading), fresh.update(reading)) for reading in given]
    assert all((a == b).all() for a, b in again)
    np.testing.assert_allclose(again[0][0][:2], [1.5, -2.0], rtol=1e-6)


def test_encoder_counts_may_wrap_around():
    given = [reading_record(reading, robot=ALTEN) for reading in readings(ALTEN, samples=300)]
    plain, wrapped = Compiled("kalman", ALTEN), Compiled("kalman", ALTEN)
    for record in given:
        moved = record.copy()
        counts = record["wheel_counts"].astype(np.int64) + 2**31 - 5
        moved["wheel_counts"] = counts.astype(np.uint64).astype(np.uint32).view(np.int32)
        assert (plain.take(record)[0] == wrapped.take(moved)[0]).all()


values = st.one_of(
    st.floats(width=32, allow_nan=True, allow_infinity=True), st.floats(-4.0, 4.0, width=32), st.just(np.nan)
)


@st.composite
def any_reading(draw: st.DrawFn) -> NDArray[np.void]:
    record = np.zeros(1, schema_of(ReadingRecord).dtype("single"))
    for name in record.dtype.names or ():
        whole = record.dtype[name].base == np.int32
        one = st.integers(-(2**31), 2**31 - 1) if whole else values
        size = record[name].size
        record[name] = np.reshape(draw(st.lists(one, min_size=size, max_size=size)), record[name].shape)
    record["encoders_valid"] = draw(st.integers(0, 1))
    return record


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(sorted(MEMORIES)), st.lists(any_reading(), min_size=1, max_size=4))
def test_wrong_readings_do_no_lasting_harm(name, wrong):
    """Every variance stays positive and finite, or the state is lost until a reset."""
    estimator = Compiled(name, ALTEN)
    good = list(readings(ALTEN, samples=8))
    for reading in good[:4]:
        estimator.update(reading)
    for record in wrong:
        state, _ = estimator.take(record)
        assert np.isfinite(state).all() or estimator.memory["started"] != 1 or name == "onboard"
    if name == "kalman" and estimator.memory["started"] == 1:
        variances = np.diagonal(estimator.memory["P"][0])
        assert (variances > 0.0).all()
        assert np.isfinite(variances).all()
    fresh = Compiled(name, ALTEN)
    estimator.reset()
    assert all((estimator.update(reading) == fresh.update(reading)).all() for reading in good[4:])
