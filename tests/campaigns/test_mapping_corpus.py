"""A sample of the corpus of foreign logs: no mapping is wrong with confidence, and most are right without an edit."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot import Log
from campaigns.foreign_logs import draw
from campaigns.mapping_corpus import judged
from tests.support.foreign_log_examples import small_robot, swaying_log

SEEDS = range(12)


def sensed() -> Log:
    """Return the swaying robot's log with a gyro and with noise of its angles."""
    log, random = swaying_log(), np.random.default_rng(1)
    turn = np.exp(-1j * log["psi"])
    rates = (log["theta_dot"] + 1j * log["phi_dot"]) * turn
    noise = 3e-4 * random.standard_normal((2, len(log)))
    return log.with_columns(
        {
            "theta": log["theta"] + noise[0],
            "phi": log["phi"] + noise[1],
            "gyro_x": rates.real,
            "gyro_y": rates.imag,
            "gyro_z": log["psi_dot"],
        }
    )


@pytest.mark.sample
def test_no_mapping_is_wrong_with_confidence_and_most_are_right():
    log, robot = sensed(), small_robot()
    results = {}
    for seed in SEEDS:
        drawn = draw(seed, robot, dead_band=False, whole=float(log.t[-1]), longest=25.0)
        # the torques of this log have noise that slower rows would miss
        habits = replace(drawn, interval=0.0)
        results[seed] = judged(log, robot, habits, dead_band=0.0)
    assert {
        seed: found
        for seed, found in results.items()
        if {found.result, found.answered} & {"wrong", "doubtful"}
    } == {}
    assert sum(found.answered == "right" for found in results.values()) >= len(SEEDS) // 2, results
