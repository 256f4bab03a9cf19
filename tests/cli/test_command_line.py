"""What all commands share: the inputs of a result, and refusals in one sentence, which name what is nearest."""

import json
from pathlib import Path

import pytest

from ballbot.cli.context import input_files
from ballbot.cli.main import main
from ballbot.robot import Robot
from tests.support.log_examples import smooth_log

OVER = "design alten --set friction.coulomb=0.1 --compensation full --out out"
REFUSALS = [
    # words, values and files of every kind of command
    ("zzz", "Available commands: study, demo, new, check"),
    ("studdy alten", "'study'"),
    ("check alten too much", "ballbot check --help"),
    ("check alten --swinng log.csv", "--swing"),
    ("check altn", "did you mean the preset 'alten'"),
    ("check nowhere/robot.toml", "the presets are alten"),
    ("simulate alten", "--out"),
    ("simulate", "ROBOT"),
    ("study alten --out out", "LOGS"),
    ("study alten nowhere.csv --out out", "nowhere.csv"),
    ("study alten log.csv --draws 1.5 --out out", "whole number"),
    ("identify alten log.csv --law stribek --out out", "'stribeck'"),
    ("identify-geometry alten log.csv --out out", "log.csv"),
    ("identify-geometry alten --out out", "geometry needs a log"),
    ("identify-geometry alten --balancing log.csv --out out", "given 1 time and --motion-capture 0 times"),
    ("convert log.csv log.csv", "already exists"),
    ("convert log.csv log.xls", ".parquet"),
    ("reproduce --only Table --out out", "no 'Table' to reproduce; there are Figure 3.1, "),
    ("validate alten log.csv", "--out is missing"),
    ("validate alten log.csv --against thessis --out out", "'thesis'"),
    ("validate rezero log.csv --seed -1 --out out", "The seed is -1"),
    ("validate --prediction log.csv more.csv new.csv", "--prediction compares one log"),
    ("twin exprt", "'export'"),
    ("completion bsh", "'bash'"),
    ("new no/where", "--out"),
    # a controller and its run
    ("plan alten --to 2 0 0 --margin 120 --out out", "--margin is 120 %; it must be 0 to 90 %"),
    ("design alten --kind precize --out out", "'precise'"),
    ("design alten --q 1,2,many --out out", "--q is '1,2,many'"),
    ("design alten --r -1 --out out", "R is not positive definite"),
    ("design alten --set body.mass --out out", "--set body.mass"),
    ("design alten --set body.mass=heavy --out out", "--set body.mass"),
    ("design alten --set body.mas=9.0 --out out", "did you mean 'body.mass'"),
    (f"{OVER} --compensation-gain 1.2", "120 % of its friction"),
    (f"{OVER} --compensation-gain 1.2", "--allow-overcompensation"),
    (f"{OVER} --compensation-gain=-1", "--compensation-gain"),
    ("design alten --delay 0 --out out", "The prediction: delay is 0 s; it must be above zero"),
    ("design alten --delay 0.3 --out out", "it can be at most 0.1 s"),
    ("design alten --notch 200 --out out", "A notch at 200 Hz needs a sample time below 0.0023 s"),
    # it turns the phase at the loop's own frequency
    ("design alten --notch 1.0 --out out", "does not stabilise"),
    ("simulate alten --controller precice --out out", "'precise'"),
    ("simulate alten --controller nowhere.toml --out out", "'nowhere.toml'"),
    ("record nominal --controller log.csv --out out", "log.csv"),
    ("simulate alten --format parquett --out out", "must end in .csv, .parquet"),
    ("simulate alten --reference triangle --out out", "There is no reference 'triangle'"),
    ("simulate alten --duration 0 --out out", "at least one sample"),
    ("compare alten --seeds 9-1 --out out", "The seeds are '9-1'"),
    ("record nominal --experiment dance --out out", "dance"),
    ("record nominal --estimator kalmann --out out", "'kalman'"),
    ("record nominl --out out", "did you mean 'nominal'?"),
    ("excite alten --lean 90 --out out", "The lean limit is 90 degrees; it must be below 90 degrees."),
    ("excite alten --floor -1 --out out", "The floor limit is -1; it must be above zero."),
    # several controllers
    ("compare alten partal --out out", "'partial'"),
    ("compare alten none none --out out", "Two controllers are called 'none'"),
    ("compare alten none --courses moon --out out", "no set or course 'moon'; did you mean 'motions'"),
    ("compare alten none --courses moon.toml --out out", "moon.toml cannot be read"),
    ("plan alten --to 1 0 0 --runs 0 --out out", "for --runs. It must be above 0"),
    ("limits alten --twin --scenario storm --out out", "no scenario or scenario file 'storm'"),
    ("limits alten a=none b=none c=none d=none e=none f=none g=none --out out", "There are 7 controllers"),
    # a live robot and a live view
    ("run --emulated --tune", "terminal to type them, or a file"),
    ("run sweep alten", "--out"),
    ("run /dev/ttyACM9 --emulated", "Give the robot's port"),
    ("run /dev/ttyACM9", "The serial port /dev/ttyACM9 cannot be opened"),
    ("run --emulated --duration -1", "--duration. It must be above 0."),
    ("run --emulated --reference /dev/input/js99", "keyboard"),
    ("run --emulated --reference sqare", "There is no reference 'sqare'"),
    ("run /dev/ttyACM9 --controller none.toml", "give --robot"),
    ("run compare --emulated --prediction none.json --out out", "none.json"),
    ("view", "nothing to show"),
    ("view alten log.csv", "--robot alten"),
    ("view a=log.csv a=other.csv --robot alten", "label 'a'"),
    ("view missing.csv --robot alten", "missing.csv cannot be read"),
    ("view log.csv --robot alten --plant twin", "name a robot to simulate"),
    ("view /dev/ttyACM0 --robot alten", "ballbot run monitor /dev/ttyACM0"),
    ("view alten --port 70000", "from 0 (any free one) to 65535"),
]


@pytest.mark.parametrize(("line", "sentence"), REFUSALS)
def test_bad_command_line_is_answered_before_any_work(line, sentence, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    smooth_log(rows=400).write(tmp_path / "log.csv")
    assert main(line.split()) == 2
    said = capsys.readouterr().err
    assert said.startswith("ballbot: ")
    assert sentence in said.replace('"', "'")
    assert len(said.splitlines()) == 1
    assert [one.name for one in tmp_path.iterdir()] == ["log.csv"]


def test_controllers_are_taken_after_options(tmp_path: Path) -> None:
    words = ["--courses", "hold", "--seeds", "1", "none", "full", "--set", "body.mass=18.0"]
    assert main(["compare", "alten", *words, "--out", str(tmp_path)]) == 0
    found = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert list(found["overall"]) == ["none", "full"]


def test_input_files_are_named_once_and_presets_are_none(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t\n")
    assert Robot.presets()
    assert input_files(["alten", str(log), f"mine={log}@kalman", f"--mapping={log},{log}", "nominal"]) == [
        log
    ]
