"""Numbers as people read them."""

import pytest

from ballbot.rounding import percent


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
