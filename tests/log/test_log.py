"""The `Log` type: what it refuses, what it gives, and that nothing missing travels on unseen."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.errors import InputError
from ballbot.log import STATE_NAMES, Log
from tests.support.log_examples import smooth_log


def test_views_take_their_columns_in_order():
    reference = {f"ref_{name}": np.full(50, k) for k, name in enumerate(("x", "y", "psi"), start=1)}
    log = smooth_log(rows=50).with_columns(reference)
    assert log.states.shape == (50, 10)
    np.testing.assert_array_equal(log.states[:, 6], log["y_dot"])
    np.testing.assert_array_equal(log.torques, np.column_stack([log["u1"], log["u2"], log["u3"]]))
    np.testing.assert_array_equal(log.reference[0], [1, 2, 0, 0, 3, 0, 0, 0, 0, 0])
    assert "theta" in log
    assert "wheel1" not in log
    assert len(log) == 50
    assert not log["x"].flags.writeable
    assert log.sample_time == pytest.approx(0.005, rel=1e-12)  # 5 ms up to rounding of the differences


@given(st.integers(1, 60), st.integers(0, 100), st.integers(0, 100))
def test_between_splits_without_loss_or_overlap(rows, first, second):
    log = Log({"t": 0.5 * np.arange(rows), "x": np.arange(rows, dtype=float)})
    start, middle = sorted((0.5 * first, 0.5 * second))
    kept = []
    for a, b in ((-1.0, start), (start, middle), (middle, 1e9)):
        if np.any((log.t >= a) & (log.t < b)):
            kept.append(log.between(a, b)["x"])
    np.testing.assert_array_equal(np.concatenate(kept), log["x"])


@pytest.mark.parametrize(
    ("columns", "sentence"),
    [
        ({"t": []}, "has no rows"),
        ({"t": [0.0, 1.0], "x": [1.0]}, r"column x has the shape \(1,\)"),
        ({"t": [0.0, 1.0], "x": ["a", "b"]}, "column x does not contain numbers"),
        ({"t": [0.0, 1.0, 0.5]}, "decreases at row 3: t = 0.5 s after 1 s"),
        ({"t": [0.0, 1.0, 1.0]}, "does not increase at row 3"),
    ],
)
def test_invalid_logs_are_refused(columns, sentence):
    with pytest.raises(InputError, match=sentence):
        Log(columns)


@given(st.integers(0, 99), st.sampled_from(STATE_NAMES), st.sampled_from([np.nan, np.inf]))
def test_missing_value_is_kept_and_refused_where_it_is_needed(row, name, value):
    log = smooth_log(rows=100)
    spoiled = log[name].copy()
    spoiled[row] = value
    log = log.with_columns({name: spoiled})
    assert not np.isfinite(log[name][row])
    with pytest.raises(InputError, match=f"column {name} has 1 of 100 .* row {row + 1} "):
        _ = log.states
    assert log.torques.shape == (100, 3)


def test_require_names_every_missing_column_and_the_nearest_there():
    log = smooth_log(rows=3)
    log.require("t", "theta")
    with pytest.raises(InputError, match=r"no columns thetaa, ref_x \(it has theta\)"):
        log.require("thetaa", "x", "ref_x")
    with pytest.raises(InputError, match="no column wheel1_dot"):
        _ = log.wheel_speeds
