"""Agreement of loop and twin: its page from scores that are known, and a stopped campaign that goes on."""

from dataclasses import replace

import numpy as np
import pytest

from tests.support.scores import score_of

pytest.importorskip("mujoco")

from campaigns.agreement import FEWEST, Both, section


def known(
    controller: str, loop: float, twin: float, *, course: str = "nominal, hold", falls: int = 0
) -> Both:
    """Return peak errors [m] within 10 % of these on the loop and on the twin, some of the twin's runs fallen."""
    scores = [[score_of(size * factor) for factor in np.linspace(0.9, 1.1, 20)] for size in (loop, twin)]
    scores[1][:falls] = [replace(one, ended="fallen") for one in scores[1][:falls]]
    return Both(course=course, controller=controller, scores=(tuple(scores[0]), tuple(scores[1])))


def test_orders_count_where_intervals_are_apart_on_both():
    soft, full, other = known("soft", 0.4, 0.3), known("full", 0.1, 0.1), known("partial", 0.1, 0.2)
    assert soft.orders(full, "peak") == full.orders(soft, "peak") == 1
    assert full.orders(other, "peak") == 0  # apart on the twin alone
    assert known("precise", 0.1, 0.4).orders(soft, "peak") == -1
    assert soft.orders(known("full", 0.1, 0.1, falls=FEWEST + 10), "peak") == 0  # of four runs left
    words = section([soft, full, other, known("precise", 0.1, 0.4)], []).after
    assert "peak of soft and precise (nominal, hold)" in words
    assert "0 of 0 by roughness" in words
