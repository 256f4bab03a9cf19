"""The check of arrays before compiled code reads them: accepted arrays, copies and messages."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot import InputError, Model, Robot
from ballbot.arrays import index_array, positive_number, real_array, real_number, whole_number

CLEAN = np.arange(1.0, 7.0).reshape(2, 3)


@pytest.mark.parametrize(
    "value",
    [
        CLEAN.tolist(),
        CLEAN.astype(int),
        CLEAN.astype(np.uint8),
        CLEAN.astype(np.float32),
        CLEAN.astype(">f8"),
        np.asfortranarray(CLEAN),
        np.repeat(CLEAN, 2, axis=1)[:, ::2],
        CLEAN[::-1, ::-1].copy()[::-1, ::-1],
        np.ma.masked_array(CLEAN),
        np.lib.stride_tricks.as_strided(CLEAN, writeable=False),
    ],
)
def test_any_real_array_becomes_one_layout(value):
    array = real_array(value, (2, 3), "The value")
    assert array.dtype == np.float64
    assert array.flags.carray
    np.testing.assert_array_equal(array, CLEAN)


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        (np.zeros(2), r"shape \(2,\); it must be 3 numbers"),
        (0.0, r"shape \(\)"),
        (["1", "2", "3"], "must be of real numbers"),
        ([True, False, True], "bool"),
        ([1.0, None, 2.0], "object"),
        ([[1.0], [2.0, 3.0]], "array of"),
        (np.ma.masked_array([1.0, 2.0, 3.0], [False, True, False]), "masked"),
        ([1.0, np.nan, 2.0], r"not finite \(nan at 1\)"),
        ([1, 2, 10**400], "object"),
    ],
)
def test_non_numeric_arrays_are_refused(value, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        real_array(value, (3,), "The value")
    assert str(caught.value).startswith("The value ")


@settings(max_examples=50)
@given(st.lists(st.floats(width=64), min_size=1, max_size=2000))
def test_finite_check_equals_numpys(values):
    """Numbers whose squares overflow are finite; no other shortcut may be seen."""
    if np.isfinite(values).all():
        np.testing.assert_array_equal(real_array(values, ("n",), "The value"), values)
    else:
        with pytest.raises(InputError, match="not finite"):
            real_array(values, ("n",), "The value")


def test_scalar_arguments_are_checked():
    assert real_number(np.array(2), "It") == real_number(np.float32(2.0), "It") == 2.0
    assert whole_number(np.int64(3), "It", least=0) == 3
    for wrong in ("1", 1j, None, np.nan, np.inf, [1.0], True, 10**400):
        with pytest.raises(InputError, match=r"^It is "):
            real_number(wrong, "It")
    for wrong in (1.0, "1", True, -1):
        with pytest.raises(InputError, match=r"^It is "):
            whole_number(wrong, "It", least=0)
    with pytest.raises(InputError, match="above zero"):
        positive_number(0.0, "It")


def test_invalid_row_indices_are_refused():
    assert index_array([1, 0], "It", count=2, length=2).dtype == np.int64
    for wrong in ([0, 2], [-1, 0], [0.0, 1.0], [0], [[0, 1]], ["0", "1"], [[0], [1, 2]]):
        with pytest.raises(InputError, match=r"^It "):
            index_array(wrong, "It", count=2, length=2)


def test_a_state_that_is_too_short_is_refused():
    """It was read past its end, which answered wrongly and then ended the process."""
    model = Model(Robot.load("alten"))
    with pytest.raises(InputError, match=r"The state has the shape \(9,\); it must be 10 numbers"):
        model.advance(np.full(9, 0.01), np.zeros(3), 0.005)
    with pytest.raises(InputError, match=r"The array of torques has the shape \(2,\)"):
        model.advance(np.full(10, 0.01), np.zeros(2), 0.005)
    clean = model.advance(np.full(10, 0.01), np.zeros(3), 0.005)
    np.testing.assert_array_equal(model.advance([0.01] * 10, [0, 0, 0], 0.005), clean)
