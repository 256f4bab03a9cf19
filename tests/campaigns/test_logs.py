"""Samples of the campaigns on input: what checks make of faulty and sound logs, and fuzzed input."""

import sys
import warnings
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from ballbot.errors import InputError
from campaigns.fuzz import COUNTS, attempt, limits, outcome, outcomes, run, target_names
from campaigns.fuzz_commands import WORK
from campaigns.fuzz_targets import loader_names
from campaigns.log_faults import KINDS, SOUND, section
from campaigns.log_faults import outcome as log_outcome
from campaigns.log_recordings import drawn


@pytest.mark.sample
def test_sound_logs_pass_and_a_negated_torque_is_named():
    found = [*(log_outcome(SOUND, number) for number in range(3)), log_outcome("a torque negated", 0)]
    assert [one.refused for one in found[:3]] == [False] * 3
    assert found[3].named
    assert [row[0] for row in section(found).rows] == [*KINDS, "all", "none"]


def test_draws_are_reproducible_and_cover_presets_and_references():
    draws = [drawn(seed) for seed in range(25)]
    assert draws[7] == drawn(7)
    assert len({(one.preset, one.reference) for one in draws}) == 25


#: inputs of each loader; the campaign has thousands
COUNT, COMMANDS = 8, 30
SEED = 99


@pytest.mark.parametrize("name", loader_names())
def test_damaged_files_are_accepted_or_refused(tmp_path, name):
    attempted = attempt(name, SEED, tmp_path)
    with limits():
        found = [outcome(attempted, number) for number in range(COUNT)]
    assert [one["words"] for one in found if one["kind"] == "failed"] == []
    assert {"refused"} <= {one["kind"] for one in found}


@pytest.mark.sample
def test_damaged_command_lines_are_accepted_or_refused():
    tally = run("command line", COMMANDS, seed=SEED)
    assert tally.failures == []
    assert tally.accepted > 0
    assert tally.refused > COMMANDS // 4


def test_same_seed_gives_the_same_fuzzed_input(tmp_path):
    contents = []
    for seed in (1, 1, 2):
        folder = tmp_path / str(len(contents))
        folder.mkdir()
        outcome(attempt("bounds", seed, folder), 7)
        contents.append((folder / "input.toml").read_bytes())
    assert contents[0] == contents[1] != contents[2]


def test_every_target_has_a_number_of_inputs():
    assert set(COUNTS) == set(target_names())
    assert sum(COUNTS.values()) >= 100_000


def _warns(_: int) -> None:
    warnings.warn("overflow", RuntimeWarning, stacklevel=1)


def _refuses_in_lines(_: int) -> None:
    raise InputError("two\nlines")


def _asks_for_memory(_: int) -> None:
    np.ones(2**29)  # 4 GB


def _lacks_a_key(_: int) -> None:
    raise KeyError("x")


@pytest.mark.parametrize(
    ("attempted", "words"),
    [
        (_warns, "RuntimeWarning: overflow"),
        (_refuses_in_lines, "no sentence"),
        (_asks_for_memory, "MemoryError"),
        (_lacks_a_key, "KeyError"),
    ],
)
def test_fuzzing_detects_failures(attempted, words):
    with limits():
        found = outcome(attempted, 0)
    assert found["kind"] == "failed"
    assert words in str(found["words"])


def test_crash_and_hang_of_the_worker_count_as_failures_of_the_input():
    line = 'print(\'{"kind": "accepted"}\', flush=True)'
    ended = list(outcomes([sys.executable, "-c", f"import os; {line}; os.abort()"], 3))
    assert [one.kind for one in ended] == ["accepted", "failed"]
    assert "ends the process (-6)" in ended[1].words
    hanging = list(outcomes([sys.executable, "-c", "import time; time.sleep(60)"], 3, patience=0.5))
    assert [one.words for one in hanging] == ["hangs"]


def test_fuzzing_writes_only_into_its_folder(tmp_path):
    before = set(Path(tmp_path).parent.iterdir())
    with limits():
        outcome(attempt("reference", SEED, tmp_path), 1)
    assert set(Path(tmp_path).parent.iterdir()) == before


@pytest.mark.parametrize(("module", "name"), WORK)
def test_work_that_fuzzed_command_lines_leave_out_exists(module, name):
    assert hasattr(import_module(module), name)
