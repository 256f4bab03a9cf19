"""What the one-step residuals are asked, each question on residuals whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from ballbot.findings import texts
from ballbot.log import STATE_NAMES, Log
from ballbot.log.evidence import autocovariance
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.validation import ModelPair
from ballbot.validation.models import Case, stretches
from ballbot.validation.residuals import Prediction, predict, wheel_torque_residuals
from ballbot.validation.statistics import (
    blocks_of,
    correlations,
    holm,
    lagged,
    spectrum,
)
from tests.support.validation_examples import noisy_log, true_robot, wheel_log

LABELS = tuple(f"c{i}" for i in range(13))


def _at_most(tests: int, level: float) -> float:
    """Return the share of false alarms that a test of that level exceeds once in a thousand tries."""
    return float(stats.binom.isf(1e-3, tests, level)) / tests


def _filtered(b: list[float], a: list[float], values: np.ndarray) -> np.ndarray:
    return np.asarray(lfilter(b, a, values, axis=0), dtype=np.float64)


def _predicted(robot: Robot, log: Log) -> Prediction:
    return predict(Case(models=ModelPair.by_friction(Model(robot)), log=log, parts=stretches(log)))


# --- series in segments ---


def test_autocovariances_and_lags_do_not_cross_from_segment_to_segment():
    values = np.random.default_rng(1).normal(size=(30, 2))
    segments = (11, 1, 18)
    deviation = values - values.mean(axis=0)
    parts = np.split(deviation, np.cumsum(segments)[:-1])
    by_hand = [sum(np.sum(p[lag:] * p[: len(p) - lag], axis=0) for p in parts) / 30 for lag in range(5)]
    np.testing.assert_allclose(autocovariance(values, segments, lags=4), by_hand, atol=1e-14)
    before = lagged(values, segments, lag=3)
    np.testing.assert_array_equal(np.isnan(before[:, 0]), [k < 3 or k in (11, 12, 13, 14) for k in range(30)])
    np.testing.assert_array_equal(before[20], values[17])
    blocks = blocks_of(segments, length=6)
    assert all(len({int(blocks[k]) for k in (a, b)}) == 2 for a, b in ((10, 11), (11, 12)))


def test_holm_keeps_fewer_than_plain_levels_and_the_surest_first():
    p = np.array([0.001, 0.013, 0.04, np.nan, 0.03])
    # 4 tests: 0.001 < 0.05/4, 0.013 < 0.05/3, 0.03 > 0.05/2
    np.testing.assert_array_equal(holm(p, level=0.05), [True, True, False, False, False])


# --- correlation ---


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_independent_series_have_no_marked_cells_whatever_their_memory(memory):
    random = np.random.default_rng(2)
    marked = []
    for _ in range(60):
        columns = _filtered([1.0], [1.0, -memory], random.normal(size=(700, 13)))[100:]
        marked.append(correlations(columns, LABELS, (600,)).significant.any())
    assert np.mean(marked) <= _at_most(60, 0.05)


def test_a_true_correlation_is_marked_and_no_other():
    columns = np.random.default_rng(4).normal(size=(1000, 13))
    columns[:, 7] += 0.3 * columns[:, 2]
    found = correlations(columns, LABELS, (400, 600))
    assert set(map(tuple, np.argwhere(found.significant).tolist())) == {(2, 7), (7, 2)}
    assert found.between("c2", "c7") == (pytest.approx(0.3, abs=0.1), True)


# --- spectrum ---


@pytest.mark.parametrize(("b", "a"), [([1.0], [1.0]), ([1.0, -0.95], [1.0]), ([1.0], [1.0, -0.95])])
def test_noise_without_a_peak_has_none(b, a):
    random = np.random.default_rng(7)
    false = 0
    for _ in range(10):
        found = spectrum(_filtered(b, a, random.normal(size=(3000, 10))), (3000,), sample_time=0.005)
        assert found is not None
        false += len(found.peaks) > 0
    # one log in a hundred has a false peak
    assert false / 10 <= _at_most(10, 0.01)


@pytest.mark.parametrize("frequency", [12.0, 71.0])
def test_a_resonance_is_named_within_the_resolution(frequency):
    # a mode that noise excites, damped by 0.3 %, narrower than the resolution; the gyro sees 0.01 rad/s rms of it
    # beside its noise of 0.004
    h, random = 0.005, np.random.default_rng(9)
    pole = np.exp((-0.003 + 1j) * 2.0 * np.pi * frequency * h)
    ringing = _filtered([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], random.normal(size=4801))
    log = noisy_log()
    shaken = log.with_columns({"theta_dot": log["theta_dot"] + 0.01 * ringing[: len(log)] / ringing.std()})
    found = _predicted(true_robot(), shaken)
    assert found.spectrum is not None
    (peak,) = found.spectrum.peaks
    assert abs(peak.frequency - frequency) < found.spectrum.resolution < 0.6
    assert peak.state == STATE_NAMES.index("theta_dot")
    assert any(f"{peak.frequency:.1f} Hz in " in sentence for sentence in texts(found.remarks()))
    bare = _predicted(true_robot(), log).spectrum
    assert bare is not None
    assert bare.peaks == ()


# --- wheels ---


def test_residual_torques_are_those_that_were_missing():
    # the model gets each sample's torque with a known error
    log = noisy_log()
    wrong = 0.2 * np.sin(np.outer(log.t, [1.0, 1.7, 2.3]))
    biased = log.with_columns({f"u{i + 1}": log[f"u{i + 1}"] - wrong[:, i] for i in range(3)})
    residual = wheel_torque_residuals(_predicted(true_robot(), biased))
    slopes = [np.polyfit(w, r, 1)[0] for w, r in zip(wrong[:-1].T, residual.T, strict=True)]
    # while a wheel sticks, friction takes up what is missing; the log rolls nearly always
    np.testing.assert_allclose(slopes, 1.0, atol=0.15)


def test_fault_free_robot_gets_no_residual_finding():
    said = " ".join(texts(_predicted(true_robot(), wheel_log()).remarks()))
    for nothing in ("does not depend on the wheel speeds", "no distinct peak"):
        assert nothing in said


def test_wrong_friction_shows_as_a_speed_effect():
    robot = true_robot()
    less = replace(robot.friction, coulomb=tuple(c - 0.03 for c in robot.friction.coulomb))
    found = _predicted(robot.replace(friction=less), wheel_log())
    assert found.by_speed
    for effect in found.by_speed:
        assert effect.p_value < 1e-3
        rolling = np.abs(effect.speeds) > 0.5
        # the model brakes 0.03 N m too little, whichever way the wheel turns
        missing = -0.03 * np.sign(effect.speeds[rolling])
        assert np.all(np.abs(effect.torques[rolling] - missing) < 1.5 * effect.half_widths[rolling])
    assert "depends on the speed" in " ".join(texts(found.remarks()))


# --- refusals ---


def test_log_without_encoders_is_reported():
    log = noisy_log()
    bare = Log({name: values for name, values in log.columns.items() if not name.startswith("wheel")})
    found = _predicted(true_robot(), bare)
    assert not found.by_speed
    assert any("lacks the encoder speeds" in sentence for sentence in texts(found.remarks()))


@pytest.mark.parametrize("rows", [12, 450, 1500])
def test_short_logs_give_the_reason_instead_of_an_effect(rows):
    found = _predicted(true_robot(), wheel_log().select(slice(0, rows)))
    said = " ".join(texts(found.remarks()))
    assert "too short" in said
    assert "nan" not in said
    assert not found.by_speed
