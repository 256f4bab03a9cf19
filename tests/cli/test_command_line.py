"""What all commands share: whole numbers, groups of --help, refusals, the provenance."""

from pathlib import Path

import pytest

from ballbot.cli import ARGV
from ballbot.cli.context import argv, input_files
from ballbot.cli.main import main
from ballbot.robot import Robot


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


def test_provenance_is_the_command_line_without_what_has_no_effect() -> None:
    running = ARGV.set(
        ("study", "alten", "a.csv", "--cluster", "tcp://a:1", "--cluster=b", "--json", "--seed", "2")
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
        ("zzz", "Available commands: study, demo, new, check"),
        ("check alten too much", "ballbot check --help"),
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
