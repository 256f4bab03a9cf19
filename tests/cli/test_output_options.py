"""The options that every command has, --json and --quiet; help, version, completion; what `ballbot` alone prints."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ballbot.cli.app import COMMANDS, START
from ballbot.cli.main import main
from tests.support.log_examples import smooth_log


def printed_json(capsys: pytest.CaptureFixture[str], *words: str, code: int = 0) -> dict[str, object]:
    """Return what a command line prints with --json, which must be all of standard output."""
    assert main([*words, "--json"]) == code
    return json.loads(capsys.readouterr().out)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("webbrowser.open", lambda _: True)
    smooth_log(rows=400).write(tmp_path / "log.csv")
    return tmp_path


def test_ballbot_alone_names_three_commands_that_exist_and_where_help_is(capsys):
    assert main([]) == 0
    assert capsys.readouterr().out == START
    named = [line.split()[1] for line in START.splitlines() if line.startswith("  ballbot ")]
    assert len(named) == 3
    assert set(named) <= {command.name for command in COMMANDS}
    assert "`ballbot help`" in START


@pytest.mark.parametrize(
    ("words", "same"),
    [((), ("--help",)), (("check",), ("check", "--help")), (("run", "wiring"), ("run", "wiring", "--help"))],
)
def test_help_prints_what_the_option_prints(words, same, capsys):
    assert main(["help", *words]) == 0
    helped = capsys.readouterr().out
    assert main(same) == 0
    assert capsys.readouterr().out == helped
    assert "--json" in helped
    assert "--quiet" in helped


@pytest.mark.parametrize(
    ("line", "file"),
    [
        ("new mine", "mine.toml"),
        ("twin scenario --out scenario.toml", "scenario.toml"),
        ("view log.csv --robot alten --save page.html", "page.html"),
    ],
)
def test_json_of_written_files_names_them(line, file, folder, capsys):
    assert printed_json(capsys, *line.split())["files"] == [file]
    assert (folder / file).exists()


def test_refused_result_is_printed_before_the_refusal(folder, capsys):
    log = smooth_log(rows=400)
    log.with_columns({"theta": log["theta"] * 57.3}).write(folder / "degrees.csv")
    assert main(["check-log", "degrees.csv", "--robot", "alten", "--json"]) == 2
    printed = capsys.readouterr()
    assert any(one["severity"] == "error" for one in json.loads(printed.out)["findings"])
    assert printed.err.startswith("ballbot: degrees.csv")


def test_quiet_prints_nothing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-log", "log.csv", "--quiet"]) == 0
    assert main(["--quiet", "new", "mine"]) == 0
    assert capsys.readouterr() == ("", "")
    assert (folder / "mine.toml").exists()


@pytest.mark.parametrize("shell", ["bash", "fish"])
def test_completion_script_is_valid_and_names_every_command(shell, capsys):
    script = printed_json(capsys, "completion", shell)["script"]
    assert isinstance(script, str)
    for word in (*(command.name for command in COMMANDS), "exclude-states", "json", "kalman"):
        assert word in script
    if shutil.which(shell):
        checked = subprocess.run([shell, "-n"], input=script, capture_output=True, text=True, check=False)
        assert (checked.returncode, checked.stderr) == (0, "")


def test_completion_works_without_the_packages_of_extras(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "ballbot.cli.spin", raising=False)
    monkeypatch.setitem(sys.modules, "ballbot.vision.spin", None)
    script = printed_json(capsys, "completion", "bash")["script"]
    assert isinstance(script, str)
    assert "spin" in script
    assert "--frame-rate" not in script


def test_command_that_leaves_no_page_says_how_to_get_one(capsys: pytest.CaptureFixture[str]) -> None:
    hint = "--out FOLDER also writes report.html.\n"
    for options, expected in (((), hint), (("--quiet",), ""), (("--json",), ""), (("--out", "out"), "")):
        assert main(["check-log", "log.csv", *options]) == 0
        assert capsys.readouterr().err == expected
