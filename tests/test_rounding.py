"""Numbers as people read them."""

import math

import pytest

from ballbot.rounding import digits, interval, percent, plus_minus


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (0.0, "0 %"),
        (0.0046, "0.5 %"),
        (0.00002, "0.002 %"),
        (0.0096, "1 %"),
        (0.124, "12 %"),
        (12.0, "1200 %"),
    ],
)
def test_a_small_share_is_not_none(share: float, text: str) -> None:
    assert percent(share) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.33, "0.330"), (17.0, "17.0"), (0.0, "0"), (1234.5, "1230"), (-0.02, "-0.0200"), (float("nan"), "–")],
)
def test_digits_keep_what_was_asked_for(value: float, text: str) -> None:
    assert digits(value) == text


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.05069, 0.00293, "0.0507 ± 0.0029"),
        (4.0, math.nan, "4.00 (no standard error)"),
        (math.nan, math.nan, "not identified"),
        (123.4, 25.0, "123 ± 25"),
        (8681156.0, 7803784.0, "8700000 ± 7800000"),
    ],
)
def test_a_value_is_printed_to_its_errors_second_digit(value, error, text):
    assert plus_minus(value, error) == text


def test_an_interval_without_an_end_is_open():
    assert [interval(0.6, math.inf), interval(-1.0, 4.0), interval(math.nan, 1.0)] == [
        "0.600 to open",
        "-1.00 to 4.00",
        "–",
    ]
