"""The versions of Ballbot's files: files without a number are read; newer ones and other kinds are refused."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import ballbot
from ballbot import InputError
from ballbot.cli.main import main
from ballbot.control.file import controller_text, read_controller
from ballbot.file_formats import NEWEST, Kind, format_line, format_name, read_results, without_format
from ballbot.log import Log
from ballbot.log.mapping import read_mapping
from ballbot.robot import Robot
from ballbot.robot.file import robot_text
from ballbot.twin.scenario_file import load_scenario, scenario_text
from ballbot.workflows.controller_prediction import checksum_of
from ballbot.workflows.courses import choose_courses
from tests.support.log_examples import smooth_log

VERSION = ballbot.__version__
#: files of before formats had numbers
OLD = Path(__file__).parent / "golden" / "files"
ALTEN = Robot.load("alten")
COURSES = """
[mine.one]
reference = "hold"
duration = 9.0
mismatch = { mass = 1.1 }
"""
#: by the kind of a file: how it is read
READERS: dict[Kind, Callable[[Path], object]] = {
    "robot": Robot.load,
    "controller": lambda path: controller_text(read_controller(path, ALTEN)),
    "scenario": lambda path: load_scenario(path, ALTEN),
    "mapping": read_mapping,
    "courses": lambda path: choose_courses(str(path.rename(f"{path}.toml")), ALTEN, "model"),
    "results": read_results,
}
#: by the kind: a text that reads, of the present version
TEXTS: dict[Kind, str] = {
    "robot": robot_text(ALTEN),
    "controller": f"{format_line('controller')}\n{(OLD / 'controller_full.toml').read_text(encoding='utf-8')}",
    "scenario": scenario_text(load_scenario("nominal", ALTEN)),
    "mapping": f"{format_line('mapping')}\n{(OLD / 'mapping.toml').read_text(encoding='utf-8')}",
    "courses": f"{format_line('courses')}{COURSES}",
    "results": json.dumps({"format": format_name("results")}),
}


@pytest.mark.parametrize("path", sorted(OLD.glob("robot*.toml")), ids=lambda path: path.name)
def test_old_robot_file_is_written_with_the_same_values_and_a_format(path: Path, tmp_path: Path) -> None:
    robot = Robot.load(path)
    written = tmp_path / "robot.toml"
    written.write_text(robot_text(robot), encoding="utf-8")
    assert format_line("robot") in written.read_text(encoding="utf-8").splitlines()
    assert Robot.load(written) == robot


def test_checksum_of_a_controller_does_not_depend_on_the_number_of_the_format() -> None:
    # what `checksum_of` gave before formats had numbers
    controller = read_controller(OLD / "controller_full.toml", ALTEN)
    assert checksum_of(controller) == CHECKSUM


CHECKSUM = "207b4704be437a666943af470f96cd4d1c7f42e15cd8f151eb92c10ccb29932e"


@pytest.mark.parametrize("kind", NEWEST)
def test_file_of_the_present_format_reads_as_one_without_it(kind: Kind, tmp_path: Path) -> None:
    now, before = tmp_path / "now", tmp_path / "before"
    now.write_text(TEXTS[kind], encoding="utf-8")
    before.write_text("{}" if kind == "results" else without_format(TEXTS[kind]), encoding="utf-8")
    assert now.read_bytes() != before.read_bytes()
    if kind == "scenario":  # is named after its file unless it states a name
        assert 'name = "nominal"' in TEXTS[kind]
    assert READERS[kind](now) == READERS[kind](before)


@pytest.mark.parametrize(
    ("kind", "lines", "sentence"),
    [
        ("robot", "[correlation]\nof = []\nlower = []\nstandard_errors = []", "standard_errors: remove"),
        ("controller", "[lean_bound]\nlean = 0.1\n[standstill]", r"call it lean_limit\. standstill: remove"),
        ("controller", "[shaping]\nfeed_forward = true", r"shaping.feed_forward: .* a line \[feed_forward\]"),
        ("scenario", '[[driveline_laws]]\nlaw = "dahl"', "driveline_laws: remove"),
        ("scenario", "[load_dependence]\nshare = 0.6", "load_dependence.share: call it fraction"),
        ("scenario", "asymmetry = 0.1", "asymmetry is gone: give coulomb_asymmetry"),
        ("mapping", '[file]\nrepeated_rows = "drop"', "file.repeated_rows: remove the line"),
        ("mapping", "[input]\nresistance = 2.0", "input.resistance: write it into the robot file"),
        (
            "scenario",
            "[supply]\nwinding_resistance = 0.6",
            "supply.winding_resistance: write it into the rob",
        ),
        ("mapping", '[columns.t]\nfrom = "s"\nnanoseconds = "ns"', "columns.t.nanoseconds: write seconds"),
        ("courses", "[mine.one]\nunlike = { mass = 1.1 }", "mine.one.unlike: call it mismatch"),
    ],
)
def test_key_of_an_earlier_version_is_refused_with_what_to_write(kind, lines, sentence, tmp_path):
    path = tmp_path / "old.toml"
    path.write_text(lines, encoding="utf-8")
    with pytest.raises(InputError, match=sentence):
        READERS[kind](path)


def test_numpy_log_of_an_earlier_version_is_converted_by_the_line_that_refuses_it(tmp_path: Path) -> None:
    log, path = smooth_log(rows=20), tmp_path / "log.npz"
    np.savez(path, t=log.t, theta=log["theta"])
    with pytest.raises(InputError, match="Convert it in Python: ") as refusal:
        Log.read(path)
    exec(str(refusal.value).partition("in Python: ")[2], {"ballbot": ballbot, "numpy": np})
    assert np.array_equal(Log.read(path.with_suffix(".csv")).t, log.t)


@pytest.mark.parametrize("kind", NEWEST)
def test_newer_format_is_refused_with_what_to_do(kind: Kind, tmp_path: Path) -> None:
    path = tmp_path / f"newer_{kind}"
    newer = f"ballbot {kind} {NEWEST[kind] + 1}"
    text = TEXTS[kind].replace(format_name(kind), newer)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=rf"newer_{kind}(\.toml)?: format is '{newer}'.*--upgrade ballbot"):
        READERS[kind](path)


@pytest.mark.parametrize("kind", NEWEST)
def test_file_of_another_kind_is_refused(kind: Kind, tmp_path: Path) -> None:
    other = "robot" if kind == "mapping" else "mapping"
    path = tmp_path / "other"
    path.write_text(TEXTS[kind].replace(format_name(kind), format_name(other)), encoding="utf-8")
    with pytest.raises(InputError, match=f"format is 'ballbot {other} 1', but this must be a {kind} file"):
        READERS[kind](path)


def test_results_state_their_format_and_the_version(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    smooth_log(rows=400).write(tmp_path / "log.csv")
    assert main(["check-log", "log.csv", "--out", "out", "--json"]) == 0
    for text in (capsys.readouterr().out, Path("out/results.json").read_text(encoding="utf-8")):
        found = json.loads(text)
        assert list(found)[:2] == ["format", "ballbot"]
        assert (found["format"], found["ballbot"]) == (format_name("results"), ballbot.__version__)
