"""The document "From a CSV file to a report": its file and messages are those of the commands."""

import subprocess
import sys
import tomllib

import pytest

from ballbot.cli.main import main
from tests.support.paths import ROOT

pytest.importorskip("mujoco")
pytestmark = pytest.mark.sample

DOCUMENT = (ROOT / "docs" / "first_log.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with the document's file."""
    path = tmp_path_factory.mktemp("first_log")
    words = "record nominal --reference figure_eight --duration 40 --seed 3 --out"
    assert words in DOCUMENT
    assert main([*words.split(), str(path / "run")]) == 0
    script = [sys.executable, str(ROOT / "examples" / "05_foreign_csv.py"), "run/log.csv", "balance.csv"]
    subprocess.run(script, cwd=path, check=True)
    return path


@pytest.fixture(scope="module")
def mapping(folder):
    """Return the mapping of the document's second check."""
    words = "--robot alten --command current --out"
    assert words in DOCUMENT
    out = folder / "checked"
    assert main(["check-log", str(folder / "balance.csv"), *words.split(), str(out)]) == 0
    return out / "mapping.toml"


def test_only_the_kind_of_the_command_is_asked(folder, capsys):
    assert main(["check-log", str(folder / "balance.csv"), "--robot", "alten"]) == 2
    said = capsys.readouterr().err
    assert said.split("balance.csv: ")[-1].strip() in DOCUMENT


def test_the_mapping_is_the_truth(mapping):
    found = tomllib.loads(mapping.read_text(encoding="utf-8"))
    wheels, attitude = found["wheels"], found["attitude"]
    assert (wheels["order"], wheels["sign"], wheels["angle"]["counts_per_turn"]) == (
        [1, 3, 2],
        [1, 1, -1],
        55200.0,
    )
    assert (attitude["turn"], attitude["unit"], attitude["rates"]["unit"]) == (30.0, "deg", "deg/s")
    assert found["columns"]["t"]["unit"] == "ms"
    assert (found["file"]["separator"], found["file"]["decimal"]) == ("semicolon", "comma")
