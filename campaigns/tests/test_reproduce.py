"""The page of the reproduction."""

import pytest

from ballbot.robot import Robot
from ballbot.thesis.reproduce import figures
from ballbot.thesis.reproduce.bench import Bench
from ballbot.thesis.reproduce.mistakes import MISTAKES
from campaigns.reproduce import PAGE, item_markdown, mistake_markdown


@pytest.mark.sample
def test_documented_page_is_what_a_fresh_run_gives() -> None:
    """All that needs no recording; campaigns/reproduce.py writes the whole."""
    bench, page = Bench(robot=Robot.load("alten"), seed=0), PAGE.read_text(encoding="utf-8")
    for number, make in enumerate(MISTAKES, 1):
        if make.__name__ != "residual_pairs":
            assert mistake_markdown(number, make(bench)) in page
    assert item_markdown("Figure III.1", figures.figure_iii_1(bench)) in page
