"""A sample of the corpus of foreign logs: no mapping is wrong, and most are right without an edit.

A dead band that nobody states is counted as less dry friction; here the friction that is then identified is compared.
"""

from dataclasses import replace

import numpy as np
import pytest

from ballbot import Log, Model, Robot, identify, simulate
from ballbot.control.presets import nominal_controller
from ballbot.identification.identify import IdentificationOptions
from ballbot.log.columns import torque_names
from ballbot.log.formats import is_foreign
from ballbot.robot.components import Friction
from campaigns.mapping_corpus import draw, judged
from campaigns.mapping_recordings import FirmwareDeadBand
from tests.support.foreign_log_examples import small_robot, swaying_log
from tests.support.foreign_logs import STYLES, Habits, columns_of, commands, write

SEEDS = range(12)
#: enough for the numbers themselves
QUICK = IdentificationOptions(most_profiles=0)


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


@pytest.mark.sample
def test_a_dead_band_that_nobody_states_is_less_dry_friction():
    """The identified c is that of the wheels less the torque that the firmware adds, and predicts nearly as well."""
    robot = Robot.load("alten")
    coulomb, added = np.array([0.14, 0.11, 0.13]), 0.05  # [N m]
    friction = replace(Friction.none(3), coulomb=tuple(coulomb), viscous=(0.02, 0.02, 0.02))
    true = robot.replace(friction=friction)

    def reference(t: float) -> np.ndarray:
        pose = np.zeros(10)
        pose[:2] = 0.3 * np.sin(0.8 * t), 0.3 * np.sin(1.1 * t)
        return pose

    firmware = FirmwareDeadBand(nominal_controller(true), true, added / true.drive.torque_limit)
    log = simulate(Model(true), firmware, reference, duration=14.0)
    duty = commands(true, log.torques, log.wheel_speeds, "duty")
    without = log.torques - added * np.sign(duty)
    as_mapped = log.with_columns(dict(zip(torque_names(3), without.T, strict=True)))
    stated, not_stated = (identify(robot, one, law="coulomb", options=QUICK) for one in (log, as_mapped))
    c, less = (np.array(one.parameters["c"]) for one in (stated, not_stated))
    # what the rows make of it in which a wheel turns against its duty: 0.012 of the dead band measured
    np.testing.assert_allclose(c, coulomb, atol=0.01)
    np.testing.assert_allclose(c - less, added, atol=0.02)
    # in the log without noise, friction with the dead band stated leaves nothing, and without it 0.15
    kept = not_stated.held_out.squares_with.sum(axis=0) / not_stated.held_out.squares_without.sum(axis=0)
    assert np.median(np.sqrt(kept)) < 0.2
