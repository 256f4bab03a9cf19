"""What the commands write equals the goldens: a sample here, all of it by `python -m tests.golden`."""

import json
import os
import subprocess
import sys

import pytest

from ballbot.cli.app import COMMANDS
from tests.golden.cases import CASES
from tests.golden.compare import differences
from tests.golden.workshop import RESULTS, is_same_machine
from tests.support.paths import ROOT

#: `ballbot reproduce` takes ten minutes; test_reproduce compares what needs no recording. `ballbot demo` writes a page
#: of recorded runs and no results; its identification is that of `ballbot identify`. `help` and `completion`
#: write no files. `ballbot learn` writes times, and sums whose order differs between machines; tests/learning has it.
#: `ballbot convert` writes the log that it reads, in another format; the round trips have their tests
_NOT_FROZEN = {"reproduce", "demo", "convert", "completion", "learn"}


@pytest.mark.sample
def test_sampled_commands_write_what_they_wrote(tmp_path):
    """Alone, and where last digits count with a cache of their own: they depend on what was compiled before."""
    names = [case.name for case in CASES if case.sampled]
    words = [sys.executable, "-m", "tests.golden", *names]
    environment = os.environ | ({"NUMBA_CACHE_DIR": str(tmp_path)} if is_same_machine() else {})
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]


def test_every_command_has_a_golden():
    covered = {case.words[0] for case in CASES if case.words}
    assert {command.name for command in COMMANDS} - covered == _NOT_FROZEN
    frozen = {case.name for case in CASES if case.frozen}
    assert {path.stem for path in RESULTS.glob("*.json")} == frozen


# --- where two differ ---

OLD = {"results.json": {"ladder": {"rungs": [{"law": "coulomb", "gain": 0.1}, {"law": "load", "gain": 0.2}]}}}


def with_gain(gain):
    return json.loads(json.dumps(OLD).replace("0.2", json.dumps(gain)))


def test_last_digit_counts_on_the_same_machine_only():
    other = with_gain(0.20000000000000004)
    assert differences("identify", OLD, OLD, same_machine=True) == []
    (found,) = differences("identify", OLD, other, same_machine=True)
    assert found == "identify/results.json/ladder/rungs/1/gain: 0.2 -> 0.20000000000000004"
    assert differences("identify", OLD, other, same_machine=False) == []
    assert differences("identify", OLD, with_gain("much"), same_machine=False)
