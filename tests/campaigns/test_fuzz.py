"""A sample of the campaign on damaged input."""

import warnings
from importlib import import_module

import numpy as np
import pytest

from ballbot.errors import InputError
from campaigns.fuzz import COMMANDS, attempt, limits, outcome, outcomes
from campaigns.fuzz_commands import WORK
from campaigns.fuzz_targets import MAKERS

#: inputs of each loader; the campaign has thousands
COUNT = 5
SEED = 6


@pytest.mark.parametrize("name", MAKERS)
def test_damaged_files_are_accepted_or_refused(tmp_path, name):
    attempted = attempt(name, SEED, tmp_path)
    with limits():
        found = [outcome(attempted, number) for number in range(COUNT)]
    assert [one.words for one in found if one.kind == "failed"] == []
    assert {"refused"} <= {one.kind for one in found}


@pytest.mark.sample
def test_damaged_command_lines_are_accepted_or_refused():
    found = list(outcomes(COMMANDS, 30, seed=SEED))
    assert [one.words for one in found if one.kind == "failed"] == []
    assert sum(one.kind == "refused" for one in found) > 7
    assert any(one.kind == "accepted" for one in found)


@pytest.mark.parametrize(("module", "name"), WORK)
def test_work_that_fuzzed_command_lines_leave_out_exists(module, name):
    assert hasattr(import_module(module), name)


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
    assert found.kind == "failed"
    assert words in found.words
