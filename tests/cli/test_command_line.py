"""What all commands share: whole numbers, groups of --help, refusals, the provenance."""

import dataclasses
import importlib
import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from ballbot.cli import ARGV
from ballbot.cli.app import COMMANDS
from ballbot.cli.context import argv, input_files
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
    """Yield a type and what it consists of, up to what has a converter, as a whole number does."""
    yield hint
    if not any(getattr(one, "converter", None) for one in getattr(hint, "__metadata__", ())):
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
        ("check altn", "There is no robot file or preset 'altn'; did you mean the preset 'alten'?"),
        ("simulate alten --referense circle --out out", "Did you mean --reference?"),
        ("simulate alten", "--out"),
        ("simulate", "ROBOT"),
        ("study alten --out out", "LOGS"),
        ("identify-geometry alten log.csv --out out", "log.csv"),
        ("simulate alten --duration long --out out", "--duration"),
        (
            "simulate alten --controller precise --compensation full --out out",
            "--compensation belongs to the nominal controller, and --controller names precise; leave one of them out.",
        ),
        ("excite alten --lean 90 --out out", "The lean limit is 90 degrees; it must be below 90 degrees."),
        ("run sweep alten", "--out"),
    ],
)
def test_bad_command_line_is_answered_in_one_sentence(
    line: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line.split()) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert len(said.splitlines()) == 1
