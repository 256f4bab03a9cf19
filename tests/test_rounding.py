"""Numbers as people read them."""

import re

import pytest

from ballbot.rounding import digits, percent
from tests.support.paths import ROOT


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


def test_every_heading_has_its_unit_in_brackets():
    units = "mm|m|s|ms|rad|deg|degrees|°|N|N m|N s|rad/s|deg/s|m/s|mm/s|Hz|J|W|kg|%"
    # at the end of a text, or before what is put into it
    other = re.compile(rf"""\w,? \((?:{units})\)["'{{]|\[(?:degrees(?:/s)?|°)\]["'{{]""")
    for folder in ("src/ballbot", "campaigns"):
        for path in (ROOT / folder).rglob("*.py"):
            assert not other.findall(path.read_text("utf-8")), path


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.33, "0.330"), (17.0, "17.0"), (0.0, "0"), (1234.5, "1230"), (-0.02, "-0.0200"), (float("nan"), "–")],
)
def test_digits_keep_what_was_asked_for(value: float, text: str) -> None:
    assert digits(value) == text
