"""The document "From a CSV file to a report": its file and messages are those of the commands."""

import io
import json
import re
import subprocess
import sys
from contextlib import redirect_stdout

import pytest

from ballbot import Robot
from ballbot.cli.main import main
from ballbot.files import read_toml
from ballbot.twin import Scenario
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
def test_numbers_of_the_first_check_are_those_of_the_document(folder):
    found = json.loads((folder / "checked" / "results.json").read_text())["conclusions"]
    time = next(one for one in found if one["name"] == "unit of the time")
    assert f"the milliseconds ({100 * time['confidence']:.0f} %)" in DOCUMENT
    drive = Robot.load("alten").drive
    assert f"1 A gives {drive.gear_ratio * drive.torque_constant:.2f} N m" in DOCUMENT


@pytest.fixture(scope="module")
def filled(folder, refused):
    """Return the mapping, filled in as the document shows."""
    assert refused == 2
    text = (folder / "checked" / "mapping.toml").read_text()
    above = r"(?<=\[input\]\n)(?:.+\n)*"
    alternative = r"# if it is a current, these lines in place of those above in \[input\]:\n((?:#   .*\n)+)"
    found = re.search(above + alternative, text)
    assert found
    text = text.replace(found[0], re.sub(r"^#   ", "", found[1], flags=re.MULTILINE))
    text = re.sub(r"^complete = false.*\n", "", text, flags=re.MULTILINE)
    path = folder / "filled.toml"
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def identified(folder, filled):
    """Return the folder of the identification, with what the command prints in printed.txt."""
    words = ["identify", "alten", str(folder / "balance.csv"), "--mapping", str(filled)]
    printed = io.StringIO()
    with redirect_stdout(printed):
        assert main([*words, "--out", str(folder / "found")]) == 0
    (folder / "found" / "printed.txt").write_text(printed.getvalue())
    return folder / "found"


def explained(section):
    """Return code and message of each item of a section's list of codes."""
    text = DOCUMENT.split(f"\n## {section}")[1].split("\n## ")[0]
    return re.findall(r"^- `([\w-]+)`: `([^`]+)`\. ", text, flags=re.MULTILINE)


def fixed_words(text):
    """Return a message without numbers and parameters, which differ in the last digits between processors."""
    return re.sub(r"(?:[bcs]\d|v_s|delta|C_rr|-?\d[\d.]*|,| and )\s*", "", text)


def assert_explained(findings, section):
    """Assert that a section explains every finding, and nothing that is not found."""
    rows = explained(section)
    for one in findings:
        meant = [message for code, message in rows if code == one["code"]]
        assert any(fixed_words(message) in fixed_words(one["text"]) for message in meant), one
    for code, message in rows:
        assert any(
            code == one["code"] and fixed_words(message) in fixed_words(one["text"]) for one in findings
        )


@pytest.mark.usefixtures("refused")
def test_every_finding_of_the_first_check_is_explained(folder):
    results = json.loads((folder / "checked" / "results.json").read_text())
    assert_explained(results["findings"], "1.")


def test_every_warning_of_the_identification_is_explained(identified):
    results = json.loads((identified / "results.json").read_text())
    printed = " ".join((identified / "printed.txt").read_text().split())
    warnings = [one for one in results["findings"] if one["severity"] == "warning"]
    assert all(one["text"] in printed for one in warnings)
    assert_explained(warnings, "3.")
    assert "`with other logs and robots`" in DOCUMENT
    assert "with other logs and robots" in printed
    assert "95 %, another log" in printed


def test_rolling_friction_of_the_log_is_about_twice_the_floors(identified):
    found = Robot.load(identified / "robot.toml").friction.rolling
    floor = Scenario.named("nominal", Robot.load("alten")).friction.rolling
    assert f"On this twin, C_rr is about twice the floor's {floor:g}." in DOCUMENT
    assert 1.5 < found / floor < 2.5


def test_filled_in_as_the_document_says_the_log_is_the_recording(folder, filled, capsys):
    words = ["check-log", str(folder / "balance.csv"), "--robot", "alten", "--mapping", str(filled)]
    assert main([*words, "--out", str(folder / "again")]) == 0
    shown = capsys.readouterr().out
    assert_explained(json.loads((folder / "again" / "results.json").read_text())["findings"], "2.")
    for _, message in explained("2."):
        assert message in shown
