"""Correct logs are not stopped: a sample of the campaign `python -m campaigns.evidence false_alarms`."""

from dataclasses import replace

import pytest

from campaigns.correct_logs import PRESETS, drawn, record
from campaigns.false_alarms import checked, section

DURATION = 6.0  # [s], a quarter of the campaign's logs


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(len(PRESETS)), ids=PRESETS)
def test_correct_log_of_each_preset_is_not_stopped(seed):
    # references take turns with the presets: another one for each
    draw = replace(drawn(6 * seed), duration=DURATION)
    found = checked(draw, record(draw))
    assert found.errors == ()
    assert found.preset in section([found]).markdown()


def test_draws_are_reproducible_and_cover_presets_and_references():
    draws = [drawn(seed) for seed in range(25)]
    assert draws[7] == drawn(7)
    assert len({(one.preset, one.reference) for one in draws}) == 25
