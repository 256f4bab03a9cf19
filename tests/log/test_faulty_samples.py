"""Faulty samples of a log are missing values, or refused by what they are; the sound log beside them is used."""

import numpy as np
import pytest

from ballbot.log.checks import check
from ballbot.log.signals import dropouts
from tests.support.faulty_samples import FAULTS, HABITS, REFUSALS, fault_outcome, proposed
from tests.support.foreign_log_examples import foreign_columns, swaying_log

SEEDS = [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("fault", FAULTS)
def test_faulty_samples_are_right_or_refused_by_what_they_are(tmp_path, fault, seed):
    expected = "refused" if fault in REFUSALS else "right"
    assert fault_outcome(tmp_path, fault, seed=seed, sound=False) == expected


@pytest.mark.slow
@pytest.mark.parametrize("seed", [35291, 35294])
def test_readings_that_fail_in_the_first_or_the_last_row_are_missing_values(tmp_path, seed):
    assert fault_outcome(tmp_path, "failed readings", seed=seed, sound=False) == "right"


def test_the_noise_of_a_heading_that_stands_still_shows_no_sign_of_the_gyro(tmp_path):
    columns = foreign_columns(HABITS)
    columns["theta_z"] = 0.5 * np.random.default_rng(4).standard_normal(len(columns["theta_z"]))
    found = proposed(tmp_path, columns, {name: name for name in columns})
    assert found.motion
    assert found.motion.gyro
    assert found.motion.gyro.signs == (1, 1, 1)
    assert len(found.motion.gyro.correlations) == 2


def counts(seed: int) -> np.ndarray:
    random, t = np.random.default_rng(seed), 0.01 * np.arange(3000)
    rates = random.uniform(0.3, 3.0, 3)
    return np.round(2000.0 * np.sin(np.outer(t, rates) + random.uniform(0.0, 6.0, 3)).sum(axis=1))


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("value", [0.0, -1.0, 65535.0])
def test_dropouts_are_found_and_sound_counts_have_none(seed, value):
    read, random = counts(seed), np.random.default_rng([1, seed])
    assert not dropouts(read).any()
    lost = np.zeros(len(read), dtype=bool)
    lost[random.integers(0, 9) :: int(random.integers(2, 200))] = True
    cleared = np.where(dropouts(np.where(lost, value, read)), np.nan, np.where(lost, value, read))
    # a failed reading stays where the wheel passes that value anyway: it is then within three rows' motion of the truth
    assert np.nanmax(np.abs(cleared - read)) <= 3.0 * np.abs(np.diff(read)).max()


def test_checks_of_a_log_name_dropouts_and_copies():
    log = swaying_log()
    rows = np.arange(len(log)) % 7 == 3
    changed = log.with_columns({"wheel1": np.where(rows, 0.0, log["wheel1"]), "wheel3": log["wheel2"]})
    codes = {(one.code, *one.where.columns) for one in check(changed)}
    assert {("spike", "wheel1"), ("copied", "wheel2", "wheel3")} <= codes
    assert not {"spike", "copied"} & {one.code for one in check(log)}


@pytest.mark.parametrize("seed", range(4))
def test_speeds_by_counts_of_an_encoder_have_no_dropouts(seed):
    random = np.random.default_rng([2, seed])
    log = swaying_log()
    t = np.cumsum(random.uniform(0.009, 0.011, len(log)))
    angle = 0.01 * np.round(random.uniform(20.0, 60.0) * np.sin(0.5 * t))
    changed = log.with_columns({"t": t, "wheel1_dot": np.gradient(angle, t)})
    assert ("spike", ("wheel1_dot",)) not in {(one.code, one.where.columns) for one in check(changed)}
