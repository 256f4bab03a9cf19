"""A sample of the corpus of foreign logs: no mapping is wrong, and most are right without an edit."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot import Log
from ballbot.log.formats import is_foreign
from campaigns.foreign_logs import STYLES, Habits, columns_of, draw, write
from campaigns.mapping_corpus import judged
from tests.support.foreign_log_examples import small_robot, swaying_log

SEEDS = range(12)


def sensed() -> Log:
    """Return the swaying robot's log with a gyro and with noise of its angles."""
    log, random = swaying_log(), np.random.default_rng(1)
    turn = np.exp(-1j * log["psi"])
    rates = (log["theta_dot"] + 1j * log["phi_dot"]) * turn
    gyro = {"gyro_x": rates.real, "gyro_y": rates.imag, "gyro_z": log["psi_dot"]}
    noise = zip(("theta", "phi"), 3e-4 * random.standard_normal((2, len(log))), strict=True)
    return log.with_columns(gyro | {name: log[name] + one for name, one in noise})


@pytest.mark.parametrize("names", STYLES)
@pytest.mark.parametrize("layout", ["comma", "decimal_comma", "json", "mat"])
def test_no_foreign_log_is_taken_for_ballbots(tmp_path, names, layout):
    habits = Habits(start=0.0, duration=1.0, names=names, layout=layout)
    path, _ = write(tmp_path / "log", columns_of(sensed(), habits, small_robot(), dead_band=0.0), habits)
    assert is_foreign(path)


@pytest.mark.sample
def test_no_mapping_is_wrong_and_most_are_right():
    log, robot = sensed(), small_robot()
    results = []
    for seed in SEEDS:
        drawn = draw(seed, robot, dead_band=False, whole=float(log.t[-1]), longest=25.0)
        # the torques of this log have noise that slower rows would miss
        results.append(judged(log, robot, replace(drawn, interval=0.0), dead_band=0.0))
    assert [one for one in results if one[0] == "wrong"] == []
    assert sum(result == "right" for result, _ in results) >= len(SEEDS) // 2, results
