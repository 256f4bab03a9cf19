"""The versions of Ballbot's files: files without a number are read; newer ones and other kinds are refused."""

import json
import tomllib
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.reader import make_reader

import ballbot
from ballbot import InputError
from ballbot.cli.main import main
from ballbot.control.file import controller_text, read_controller
from ballbot.control.presets import nominal_controller
from ballbot.file_formats import NEWEST, Kind, format_line, format_name, read_results, without_format
from ballbot.log.mapping import parse_mapping, read_mapping
from ballbot.robot import Robot
from ballbot.robot.file import robot_text
from ballbot.twin.scenario import Scenario
from ballbot.twin.scenario_file import load_scenario, scenario_text
from ballbot.viewer import replay_page
from ballbot.workflows.controller_prediction import checksum_of
from ballbot.workflows.courses import built_in_sets, read_courses
from ballbot.workflows.record import RecordJob, settings
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
    "courses": lambda path: read_courses(path, ALTEN, "model"),
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


@pytest.mark.parametrize("path", sorted(OLD.glob("controller*.toml")), ids=lambda path: path.name)
def test_old_controller_file_keeps_its_text_and_checksum_but_for_the_format(path: Path) -> None:
    with warnings.catch_warnings(action="ignore"):
        controller = read_controller(path, ALTEN)
    text = controller_text(controller)
    assert format_line("controller") in text.splitlines()
    assert len(without_format(text).splitlines()) == len(text.splitlines()) - 1
    assert without_format(without_format(text)) == without_format(text)


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


@pytest.mark.parametrize("kind", NEWEST)
def test_newer_format_is_refused_with_what_to_do(kind: Kind, tmp_path: Path) -> None:
    path = tmp_path / f"newer_{kind}"
    newer = f"ballbot {kind} {NEWEST[kind] + 1}"
    text = TEXTS[kind].replace(format_name(kind), newer)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(
        InputError, match=rf"newer_{kind}: format is '{newer}'.*pip install --upgrade ballbot"
    ):
        READERS[kind](path)


def test_results_of_an_earlier_format_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    path.write_text('{"format": "ballbot results 3"}')
    with pytest.raises(InputError, match="format is 'ballbot results 3', which an earlier Ballbot wrote"):
        read_results(path)


def test_built_in_courses_state_the_newest_format_of_course_files() -> None:
    text = (Path(ballbot.__file__).parent / "workflows" / "courses.toml").read_text(encoding="utf-8")
    assert f'format = "{format_name("courses")}"' in text
    assert "format" not in built_in_sets()


def test_recorded_run_states_the_version() -> None:
    scenario, controller = Scenario.nominal(ALTEN), nominal_controller(ALTEN)
    job = RecordJob(robot=ALTEN, scenario=scenario, experiment="balance", duration=1.0, controller=controller)
    assert tomllib.loads(settings(job, 1)["record.toml"])["run"]["ballbot"] == VERSION


def test_replay_page_and_mcap_file_state_the_version(tmp_path: Path) -> None:
    log = smooth_log(rows=40)
    page = replay_page({"run": log}, ALTEN, title="run")
    assert f'<meta name="generator" content="Ballbot {VERSION}">' in page
    log.write(tmp_path / "log.mcap")
    with (tmp_path / "log.mcap").open("rb") as stream:
        assert make_reader(stream).get_header().library == f"ballbot {VERSION}"


@pytest.mark.parametrize("kind", NEWEST)
def test_file_of_another_kind_is_refused(kind: Kind, tmp_path: Path) -> None:
    other = "robot" if kind == "mapping" else "mapping"
    path = tmp_path / "other"
    path.write_text(TEXTS[kind].replace(format_name(kind), format_name(other)), encoding="utf-8")
    with pytest.raises(InputError, match=f"format is 'ballbot {other} 1', but this must be a {kind} file"):
        READERS[kind](path)


def test_format_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="format is 3; it must be 'ballbot mapping 1', or be left out"):
        parse_mapping("format = 3", source="mapping.toml")


def test_results_state_their_format_and_the_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    smooth_log(rows=400).write(tmp_path / "log.csv")
    assert main(["check-log", "log.csv", "--out", "out", "--json"]) == 0
    for text in (capsys.readouterr().out, Path("out/results.json").read_text(encoding="utf-8")):
        found = json.loads(text)
        assert list(found)[:2] == ["format", "ballbot"]
        assert (found["format"], found["ballbot"]) == (format_name("results"), ballbot.__version__)
