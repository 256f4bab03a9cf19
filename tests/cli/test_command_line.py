"""What all commands share: whole numbers, old names of options, groups of --help, the provenance."""

import dataclasses
import importlib
import inspect
import json
from collections.abc import Iterator
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from ballbot.cli import ARGV
from ballbot.cli.app import COMMANDS, RENAMED_OPTIONS, version
from ballbot.cli.context import WholeNumber, argv, input_files
from ballbot.cli.main import main
from ballbot.robot import Robot


def functions() -> Iterator[tuple[str, object]]:
    for command in COMMANDS:
        found = getattr(importlib.import_module(command.module), command.function)
        if inspect.isfunction(found):
            yield command.name, found


def hints(kind: object) -> Iterator[tuple[str, object]]:
    """Yield each option of a function, and of the dataclasses that it takes, with its type."""
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if dataclasses.is_dataclass(hint) and not isinstance(kind, type):
            yield from hints(hint)
        else:
            yield name, hint


def kinds(hint: object) -> Iterator[object]:
    """Yield a type and what it consists of, up to a whole number."""
    yield hint
    if hint != WholeNumber:
        for one in get_args(hint):
            yield from kinds(one)


@pytest.mark.parametrize(("name", "function"), list(functions()))
def test_every_integer_option_takes_whole_numbers_only(name: str, function: object) -> None:
    for option, hint in hints(function):
        assert int not in kinds(hint), f"{name} --{option}: write WholeNumber"


@pytest.mark.parametrize(
    "line",
    [
        "study alten log.csv --draws 1.5 --out out",
        "limits alten --seed 1.0 --out out",
        "identify alten log.csv --seed 1e3 --out out",
        "design alten --robust --robots 2.5 --out out",
    ],
)
def test_fraction_for_an_integer_option_is_refused_in_one_sentence(
    line: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(line.split()) == 2
    said = capsys.readouterr().err
    assert "whole number" in said
    assert len(said.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("command", "old"), RENAMED_OPTIONS)
def test_renamed_option_answers_to_its_old_name_with_a_hint(
    command: str, old: str, capsys: pytest.CaptureFixture[str]
) -> None:
    new = RENAMED_OPTIONS[command, old]
    assert main([command, "alten", old, "x", "--bogus", "--out", "out"]) == 2
    said = capsys.readouterr().err
    assert f"{old} is now called {new}" in said
    assert "--bogus" in said.splitlines()[-1] or "bogus" in said


def test_help_groups_the_commands(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    printed = capsys.readouterr().out
    places = [printed.index(f" {one} ") for one in dict.fromkeys(command.group for command in COMMANDS)]
    assert places == sorted(places)


def test_provenance_is_the_command_line_without_what_has_no_effect() -> None:
    running = ARGV.set(
        (
            "study",
            "alten",
            "a.csv",
            "--cluster",
            "tcp://a:1",
            "--cluster=b",
            "--json",
            "--seed",
            "2",
        )
    )
    try:
        assert argv() == ["ballbot", "study", "alten", "a.csv", "--seed", "2"]
    finally:
        ARGV.reset(running)


def test_input_files_are_named_once_and_presets_are_none(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t\n")
    assert Robot.presets()
    assert input_files("alten", [log, log], None, str(log), "nominal") == [log]


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("simulate altn", "There is no robot file or preset 'altn'; did you mean the preset 'alten'?"),
        ("simulate alten --referense circle", "There is no option --referense; did you mean --reference?"),
        ("check --robot alten", "There is no option --robot: write ROBOT without a name, in its place. Try:"),
        ("run --port", "There is no option --port: write PORT without a name, in its place. Try:"),
        ("simulate alten", "simulate needs --out FOLDER."),
        (
            "simulate alten --controller precise --compensation full --out out",
            "--compensation belongs to the nominal controller, and --controller names precise; leave one of them out.",
        ),
        ("excite alten --lean 90 --out out", "The lean limit is 90 degrees; it must be below 90 degrees."),
        ("simulate", "simulate needs ROBOT."),
        ("run sweep alten", "run sweep needs --out FOLDER."),
        ("convert log.csv --out c.npz", "the file to write is the second argument, without a name."),
    ],
)
def test_bad_command_line_is_answered_in_one_sentence(
    line: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line.split()) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize("line", ["-V --json", "--json --version", "version --json"])
def test_version_as_json(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(line.split()) == 0
    assert json.loads(capsys.readouterr().out) == {"version": version()}


@pytest.mark.parametrize(
    "command",
    ["compare", "design", "excite", "identify", "identify-axis", "identify-upside-down", "record", "study"],
)
def test_resume_of_old_command_lines_is_answered_by_one_sentence(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "alten", "--resume", "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr().err
    assert printed.startswith(
        f"ballbot: --resume is no longer an option of {command}: finished runs are kept"
    )
    assert printed.count("\n") == 1
    assert not (tmp_path / "out").exists()
