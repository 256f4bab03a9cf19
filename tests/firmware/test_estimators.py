"""The estimators in C against those in Python, on readings with and without gaps."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ballbot import Robot
from ballbot.control.records import schema_of
from ballbot.errors import InputError
from ballbot.estimation import OnboardState
from ballbot.estimation.interface import EstimatorName, Fix, Reading
from ballbot.estimation.kalman import KalmanFilter
from ballbot.firmware.estimators import (
    KalmanMemory,
    OnboardMemory,
    ReadingRecord,
    firmware_states,
    kalman_record,
    onboard_record,
    reading_record,
    single,
    step_of,
)
from ballbot.firmware.host import compilers, library
from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms

pytestmark = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")

ALTEN = Robot.load("alten")
H = 0.005
MEMORIES = {"onboard": OnboardMemory, "kalman": KalmanMemory}


def address(array: NDArray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


class Compiled:
    """An estimator in C, with the interface of one in Python."""

    def __init__(self, name: EstimatorName, robot: Robot, *, sample_time: float = H) -> None:
        make = {"onboard": onboard_record, "kalman": kalman_record}[name]
        self.robot, self.name = robot, name
        self.record = single(make(robot, sample_time=sample_time))
        self.memory = np.zeros(1, schema_of(MEMORIES[name]).dtype("single"))

    def reset(self, *, position: tuple[float, float] = (0.0, 0.0)) -> None:
        call = getattr(library().functions, f"ballbot_{self.name}_reset")
        call(address(self.memory), address(np.array(position, dtype=np.float32)))

    def update(self, reading: Reading) -> NDArray[np.float64]:
        return self.take(reading_record(reading, robot=self.robot))[0]

    def take(self, record: NDArray[np.void]) -> tuple[NDArray[np.float64], bool]:
        """Take a reading's record; return the state and whether the reading was whole."""
        state = np.zeros(10, dtype=np.float32)
        call = getattr(library().functions, f"ballbot_{self.name}_update")
        call.restype = ctypes.c_int32
        given = (address(self.record), address(self.memory), self.robot.wheel_count, address(record))
        whole = call(*given, address(state))
        return state.astype(np.float64), bool(whole)


def readings(
    robot: Robot, *, samples: int, seed: int = 1, missing: float = 0.0, fixes: float = 0.0, h: float = H
) -> Iterator[Reading]:
    """Return what the sensors of a robot show that sways, turns and rolls; single-precision numbers, whole counts."""
    random = np.random.default_rng(seed)
    step, wheels = step_of(robot), transforms(robot).T_owb
    bias, drift = random.normal(0.0, 2e-3, 3), 1.5e-3
    angles = counted = np.zeros(robot.wheel_count)
    for k in range(samples):
        t = k * h
        attitude = np.array(
            [0.04 * np.sin(1.3 * t), -0.03 * np.cos(1.7 * t), 0.05 * t - 1.5 * np.cos(0.2 * t)]
        )
        rate = np.array([0.052 * np.cos(1.3 * t), 0.051 * np.sin(1.7 * t), 0.05 + 0.3 * np.sin(0.2 * t)])
        gyro = body_rates_matrix(*attitude) @ rate
        v_x, v_y = 0.4 * np.sin(0.5 * t), 0.3 * np.cos(0.3 * t)
        ball = rotation(*attitude).T @ np.array([-v_y, v_x, 0.0]) / robot.ball.radius
        angles = angles + h * (wheels @ (ball - gyro))
        before, counted = counted, np.floor(angles / step) * step
        gyro = gyro + bias + random.normal(0.0, robot.sensors.gyro_noise, 3)
        shown = attitude + random.normal(0.0, robot.sensors.attitude_noise, 3) + [0.0, 0.0, drift * t]
        speeds, gyro, shown = (
            one.astype(np.float32).astype(np.float64) for one in ((counted - before) / h, gyro, shown)
        )
        lost = random.random(3) < missing
        yield Reading(
            wheel_angles=np.full_like(counted, np.nan) if lost[0] else counted,
            wheel_speeds=np.full_like(speeds, np.nan) if lost[0] else speeds,
            gyro=np.array([gyro[0], np.nan, 1e9]) if lost[1] else gyro,
            attitude=np.array([shown[0], np.nan, shown[2]]) if lost[2] else shown,
            fix=_fix(random, float(attitude[2])) if random.random() < fixes else None,
        )


def _fix(random: np.random.Generator, heading: float) -> Fix:
    return Fix(position=random.normal(0.0, 0.01, 2), heading=heading + 2.0 * np.pi * random.integers(-2, 3))


def compared(
    name: EstimatorName, robot: Robot, given: list[Reading], h: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], Compiled, OnboardState | KalmanFilter]:
    """Return the states (N, 10) of the estimator in C and of the one in Python, and both estimators."""
    of_python = (OnboardState if name == "onboard" else KalmanFilter)(robot, sample_time=h)
    of_c = Compiled(name, robot, sample_time=h)
    rows = [(of_c.update(reading), of_python.update(reading)) for reading in given]
    found, exact = (np.array(column) for column in zip(*rows, strict=True))
    return found, exact, of_c, of_python


ULP = 2.0**-24  #: relative rounding of one operation


@pytest.mark.parametrize("preset", ["alten", "cmu"])
@pytest.mark.parametrize("missing", [0.0, 0.05])
def test_onboard_state_is_python_s_but_for_rounding(preset, missing):
    robot = Robot.load(preset)
    found, exact, *_ = compared("onboard", robot, list(readings(robot, samples=1500, missing=missing)), H)
    assert (np.isnan(found) == np.isnan(exact)).all()
    speed = (
        np.nanmax(np.abs(transforms(robot).T_obw)) * 60.0 * robot.ball.radius
    )  # wheels turn by up to 60 rad/s
    # a velocity is a sum of some 20 products, each rounded, of numbers up to that size; angles only pass through, or
    # grow by a rate for a sample
    bound = 20.0 * ULP * speed
    assert np.nanmax(np.abs(found - exact)[:, 5:7]) <= bound
    assert np.nanmax(np.abs(found - exact)[:, 2:5]) <= 4.0 * ULP * np.nanmax(np.abs(exact[:, 2:5]))
    assert np.nanmax(np.abs(found - exact)[:, 7:]) <= 20.0 * ULP * np.nanmax(np.abs(exact[:, 7:])) + ULP
    # a position's sum is compensated: errors of the velocity remain, which have either sign
    assert np.nanmax(np.abs(found - exact)[:, :2]) <= bound * H * np.sqrt(1500.0) * 4.0 + 2.0 * ULP


@pytest.mark.parametrize("preset", ["alten", "cmu"])
@pytest.mark.parametrize(("missing", "fixes"), [(0.0, 0.0), (0.05, 0.0), (0.02, 0.01)])
def test_kalman_state_is_python_s_within_a_fraction_of_its_own_uncertainty(preset, missing, fixes):
    robot = Robot.load(preset)
    given = list(readings(robot, samples=1500, missing=missing, fixes=fixes))
    found, exact, of_c, of_python = compared("kalman", robot, given, H)
    assert (np.isnan(found) == np.isnan(exact)).all()
    assert isinstance(of_python, KalmanFilter)
    deviation = np.sqrt(np.diagonal(of_python.covariance))  # x, y, theta, phi, psi, velocity
    error = np.nanmax(np.abs(found - exact), axis=0)
    assert (error[:7] <= 0.02 * deviation + 4.0 * ULP * np.nanmax(np.abs(exact[:, :7]), axis=0)).all()
    T = firmware_states()
    P = T @ of_python._P @ T.T
    scale = np.sqrt(np.diagonal(P))
    kept = np.triu(of_c.memory["P"][0].astype(np.float64))
    kept = kept + np.triu(kept, 1).T
    assert np.abs((kept - P) / np.outer(scale, scale)).max() < 0.01
    assert np.linalg.eigvalsh(kept / np.outer(scale, scale)).min() > 0.0


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


@settings(max_examples=100, deadline=None)
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


def test_sample_time_must_be_positive():
    for make in (onboard_record, kalman_record):
        with pytest.raises(InputError, match="sample time"):
            make(ALTEN, sample_time=0.0)
