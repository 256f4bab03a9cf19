"""The contract between a policy and an environment."""

import re
from dataclasses import replace

import pytest

from ballbot import InputError
from ballbot.learning.contract import Contract
from ballbot.learning.tasks import TASKS, Weights, task_named
from tests.support.paths import ROOT

CONTRACT = Contract.of("alten", wheels=3, torque_limit=6.0, period=0.01, delay=1)


def test_a_contract_is_read_as_it_was_written(tmp_path):
    CONTRACT.write(tmp_path / "contract.json")
    assert Contract.read(tmp_path / "contract.json") == CONTRACT
    assert replace(CONTRACT, delay=0) != CONTRACT


def test_a_file_that_holds_no_contract_is_refused(tmp_path):
    for text in ("[]", '{"version": 0}', '{"robot": 3}'):
        (tmp_path / "contract.json").write_text(text)
        with pytest.raises(InputError):
            Contract.read(tmp_path / "contract.json")


def test_tasks_are_known_by_name_and_their_numbers_are_checked():
    assert task_named("DRIVE").drive == 0.5
    with pytest.raises(InputError, match="did you mean 'Balance'"):
        task_named("balanse")
    with pytest.raises(InputError):
        Weights(position=-1.0)


def test_the_document_has_the_weights_of_the_tasks():
    text = (ROOT / "docs" / "learning.md").read_text(encoding="utf-8")
    for name in ("position", "velocity", "heading", "lean_rate", "turning", "torque_change"):
        row = re.search(rf"^\| `{name}`.*", text, re.MULTILINE)
        assert row, name
        written = [float(cell) for cell in row[0].strip("| ").split("|")[2:]]
        assert written == [getattr(TASKS[task].weights, name) for task in ("Balance", "Track", "Drive")], name
        assert getattr(TASKS["Push"].weights, name) == written[0]
