"""Numbers as people read them."""

import ast
import re

import pytest

from ballbot.rounding import digits, percent, unit_heading
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
    other = re.compile(rf"\w,? \((?:{units})\)$|\[(?:degrees(?:/s)?|°)\]$")
    for folder in ("src/ballbot", "campaigns"):
        for path in (ROOT / folder).rglob("*.py"):
            literals = (
                one for one in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(one, ast.Constant)
            )
            texts = [one.value for one in literals if isinstance(one.value, str) and other.search(one.value)]
            assert not texts, path


@pytest.mark.parametrize(
    ("value", "beside", "text"),
    [(5.4e-11, 0.009, "0"), (0.0032, 0.009, "0.0032"), (0.00012, 0.009, "0.0001"), (-0.2, 0.3, "-0.20")],
)
def test_nearly_nothing_beside_a_number_is_zero(value: float, beside: float, text: str) -> None:
    assert digits(value, 2, beside=beside) == text


def test_a_quantity_without_a_unit_has_its_name_alone() -> None:
    assert [unit_heading("lean", unit) for unit in ("deg", "1", "")] == ["lean [deg]", "lean", "lean"]
