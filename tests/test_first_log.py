"""The document "From a CSV file to a report": its file and messages are those of the commands."""

import re
import subprocess
import sys

import pytest

from ballbot.cli.main import main
from ballbot.files import read_toml
from tests.support.paths import ROOT

pytest.importorskip("mujoco")
pytestmark = pytest.mark.slow

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
def refused(folder):
    """Return the exit code of the document's first check."""
    out = str(folder / "checked")
    return main(["check-log", str(folder / "balance.csv"), "--robot", "alten", "--out", out])


def test_file_begins_as_the_document_shows(folder):
    header = (folder / "balance.csv").read_text().splitlines()[0]
    assert f"    {header}\n" in DOCUMENT


def test_one_line_is_left_and_the_rest_is_the_truth(folder, refused):
    assert refused == 2
    mapping = read_toml(folder / "checked" / "mapping.toml")
    assert mapping["complete"] is False
    text = (folder / "checked" / "mapping.toml").read_text()
    asked = [line for line in text.splitlines() if line.startswith("# cannot determine: ")]
    assert len(asked) == 1
    assert asked[0].startswith("# cannot determine: kind of the command (torque or current)")
    wheels, attitude = mapping["wheels"], mapping["attitude"]
    assert (wheels["order"], wheels["sign"], wheels["angle"]["counts_per_turn"]) == (
        [1, 3, 2],
        [1, 1, -1],
        55200.0,
    )
    assert (attitude["turn"], attitude["unit"], attitude["rates"]["unit"]) == (30.0, "deg", "deg/s")
    assert mapping["columns"]["t"]["unit"] == "ms"
    assert (mapping["file"]["separator"], mapping["file"]["decimal"]) == ("semicolon", "comma")


@pytest.mark.usefixtures("refused")
def test_filled_in_as_the_document_says_the_log_is_the_recording(folder, capsys):
    text = (folder / "checked" / "mapping.toml").read_text()
    alternative = re.search(r"# if it is a current, these lines instead:\n((?:#   .*\n)+)", text)
    assert alternative
    lines = re.sub(r"^#   ", "", alternative[1], flags=re.MULTILINE).replace("scale = 1.0\n", "")
    text = text.replace(alternative[0], lines)
    text = re.sub(r"^kind = \"torque\".*\n", "", text, flags=re.MULTILINE)
    text = re.sub(r"^complete = false.*\n", "", text, flags=re.MULTILINE)
    filled = folder / "filled.toml"
    filled.write_text(text)
    words = ["check-log", str(folder / "balance.csv"), "--robot", "alten", "--mapping", str(filled)]
    assert main(words) == 0
    shown = capsys.readouterr().out
    for message in (
        "The wheels give x, y, x_dot, y_dot, which the file does not have",
        "Not enough for closed-loop validation: the log lacks the columns ref_x, ref_y, ref_psi",
    ):
        assert f"`{message}`" in DOCUMENT
        assert message in shown
