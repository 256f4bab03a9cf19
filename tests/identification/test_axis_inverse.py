"""The inverse model of one axis, against the published numbers of EMPS and against simulated truth."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot.errors import InputError
from ballbot.fitting.uncertainty import covariance_in_time
from ballbot.identification.axis import AxisRecord, inverse_fit
from ballbot.identification.axis.file_columns import AxisColumns
from ballbot.identification.axis.inverse import asymmetry_over_time
from ballbot.identification.axis.motion import decimated
from ballbot.identification.axis.reading import read_axis_record
from tests.support.axis_examples import TRUTH, simulated_record

#: Janot, Gautier and Brunot, Data set and reference models of EMPS, 2019
PUBLISHED = {
    "mass": (95.1089, 0.1085),
    "viscous": (203.5034, 1.1460),
    "coulomb": (20.3935, 0.1012),
    "offset": (-3.1648, 0.0444),
}
PUBLISHED_ASYMMETRIC = {
    "mass": 95.1540,
    "viscous_plus": 166.7061,
    "coulomb_plus": 20.1440,
    "viscous_minus": 240.4236,
    "coulomb_minus": 20.6277,
}


@pytest.fixture(scope="module")
def emps(shared_data) -> AxisRecord:
    columns = AxisColumns(
        position="qm", force="vir", force_scale="gtau", reference="qg", position_gain="kp", velocity_gain="kv"
    )
    return read_axis_record(shared_data / "emps" / "DATA_EMPS.mat", columns)


def test_published_parameters_and_standard_deviations_to_every_digit(emps):
    found = inverse_fit(emps)
    for name, (value, deviation) in PUBLISHED.items():
        assert round(found.value(name), 4) == value
        assert round(float(found.standard_deviations[found.names.index(name)]), 4) == deviation
    assert round(100.0 * found.relative_force_error, 4) == 4.0834


def test_published_asymmetric_parameters_to_every_digit(emps):
    found = inverse_fit(emps, form="asymmetric")
    assert {name: round(found.value(name), 4) for name in found.names} == PUBLISHED_ASYMMETRIC
    assert round(100.0 * found.relative_force_error, 4) == 3.1117


def test_clustered_standard_errors_are_larger(emps):
    found = inverse_fit(emps)
    assert np.all(found.clustered_errors > 1.5 * found.standard_deviations)


def test_the_loop_recorded_is_recognised(emps):
    # the description's filter [0.5 0.5] before a difference makes it one over two samples
    assert emps.loop is not None
    assert emps.loop.span == 2


def test_known_parameters_come_back():
    found = inverse_fit(simulated_record())
    for name, value in TRUTH.items():
        # the filter rounds off the reversals, and forces held over a sample act half a sample late
        assert found.value(name) == pytest.approx(value, rel=0.05)


def test_neither_rests_nor_held_forces_bias_the_fit_of_the_moving_axis():
    """An axis that rests between strokes, its position with 1 um of noise, of which the speed at rest consists."""
    way = np.sin(2.0 * np.pi * np.arange(9000) * 1e-3 / 3.0)
    strokes = 0.2e-3 * np.cumsum(np.sign(way) * np.clip(4.0 * (np.abs(way) - 0.3), 0.0, 1.0))
    record = simulated_record(wanted=strokes)
    noise = 1e-6 * np.random.default_rng(1).standard_normal(len(strokes))
    noisy = replace(record, position=record.position + noise)
    assert inverse_fit(noisy).value("coulomb") < 0.8 * TRUTH["coulomb"]
    found = inverse_fit(noisy, moving=True)
    for name, value in TRUTH.items():
        assert found.value(name) == pytest.approx(value, rel=0.015)


def test_an_axis_that_moves_one_way_is_refused():
    t = np.arange(3000) * 1e-3
    forwards = AxisRecord(
        name="one way", sample_time=1e-3, force=20.0 + 200.0 * t, position=0.1 * t + 0.01 * np.sin(2.0 * t)
    )
    with pytest.raises(InputError, match="in both directions"):
        inverse_fit(forwards)


def test_an_asymmetry_over_time_takes_parts_that_move_both_ways():
    assert asymmetry_over_time(simulated_record()).shape == (4, 2)
    t = 1e-3 * np.arange(20_000)
    speed = np.sin(2.0 * np.pi * t / 20.0) * (1.5 + np.sin(2.0 * np.pi * t))  # ten seconds forth, ten back
    strokes = AxisRecord(
        name="strokes",
        sample_time=1e-3,
        force=95.0 * np.gradient(speed, 1e-3) + 200.0 * speed + 20.0 * np.sign(speed),
        position=1e-3 * np.cumsum(speed),
    )
    short = replace(
        strokes, sample_time=0.02, force=strokes.force[::20][:700], position=strokes.position[::20][:700]
    )
    assert asymmetry_over_time(short).shape == (0, 2)
    fit = inverse_fit(strokes, form="asymmetric")  # the whole record moves in both directions
    assert fit.value("viscous_minus") == pytest.approx(200.0, rel=0.01)
    assert asymmetry_over_time(strokes).shape == (0, 2)


def test_a_bandwidth_beyond_the_sampling_is_refused():
    with pytest.raises(InputError, match="below 100 Hz"):
        inverse_fit(simulated_record(), bandwidth=150.0)


@given(rows=st.integers(400, 2000), factor=st.integers(2, 12), slope=st.floats(-5.0, 5.0))
@settings(max_examples=30, deadline=None)
def test_decimation_keeps_straight_lines_and_the_last_row(rows, factor, slope):
    line = 1.0 + slope * np.arange(rows) / rows
    kept = decimated(line, factor)
    assert len(kept) == -(-rows // factor)
    expected = line[(rows - 1) % factor :: factor]
    # the Chebyshev filter's gain at rest is its ripple, 0.05 dB twice: a share of 1.2 %; a filter's ends are worse
    np.testing.assert_allclose(kept[3:-3], expected[3:-3], rtol=0.015, atol=0.015)


def test_covariance_of_independent_rows_is_the_textbook_one():
    random = np.random.default_rng(3)
    J = random.standard_normal((20_000, 3)) * [1.0, 10.0, 0.1]
    residual = 0.5 * random.standard_normal(20_000)
    found = covariance_in_time(J, residual, np.arange(20_000) // 10)
    textbook = 0.25 * np.linalg.inv(J.T @ J)
    # 2000 blocks: a variance's own relative error is sqrt(2/2000), 3 %; five of them
    np.testing.assert_allclose(found.diagonal(), textbook.diagonal(), rtol=0.16)


def test_covariance_covers_the_truth_where_residuals_are_alike_in_each_block():
    random = np.random.default_rng(4)
    count, rows = 60, 40
    block = np.repeat(np.arange(count), rows)
    J = np.ones((count * rows, 1))
    inside = 0
    for _ in range(400):
        residual = np.repeat(random.standard_normal(count), rows)
        error = np.sqrt(covariance_in_time(J, residual - residual.mean(), block)[0, 0])
        inside += abs(residual.mean()) < 1.96 * error
    # binomial: 0.95 +- 3 sqrt(.95 .05 / 400) = 0.033, and t instead of normal costs 0.5 %
    assert 0.91 < inside / 400 < 0.985
