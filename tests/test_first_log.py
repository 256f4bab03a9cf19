"""The document "From a CSV file to a report": its file and messages are those of the commands."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from ballbot.cli.main import main
from tests.support.paths import ROOT

pytest.importorskip("mujoco")
pytestmark = pytest.mark.sample

DOCUMENT = (ROOT / "docs" / "first_log.md").read_text(encoding="utf-8")


def test_file_of_the_document_is_asked_about_once_and_its_mapping_is_the_truth(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    record = "record nominal --reference figure_eight --duration 40 --seed 3 --out"
    stated = "--robot alten --command current --out"
    assert record in DOCUMENT
    assert stated in DOCUMENT
    assert main([*record.split(), "run"]) == 0
    script = [sys.executable, str(ROOT / "examples" / "05_foreign_csv.py"), "run/log.csv", "balance.csv"]
    subprocess.run(script, check=True)
    capsys.readouterr()
    assert main(["check-log", "balance.csv", "--robot", "alten"]) == 2
    # only the kind of the command is asked
    assert capsys.readouterr().err.split("balance.csv: ")[-1].strip() in DOCUMENT
    assert main(["check-log", "balance.csv", *stated.split(), "checked"]) == 0
    found = tomllib.loads(Path("checked/mapping.toml").read_text(encoding="utf-8"))
    wheels, attitude = found["wheels"], found["attitude"]
    assert (wheels["order"], wheels["sign"]) == ([1, 3, 2], [1, 1, -1])
    assert wheels["angle"]["counts_per_turn"] == 55200.0
    assert (attitude["turn"], attitude["unit"], attitude["rates"]["unit"]) == (30.0, "deg", "deg/s")
    assert found["columns"]["t"]["unit"] == "ms"
    assert (found["file"]["separator"], found["file"]["decimal"]) == ("semicolon", "comma")
