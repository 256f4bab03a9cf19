"""Changes of a balancing robot's controller: a hundred without a fall, and commands that are refused in a sentence."""

import json
import os
import re

import numpy as np
import pytest

from ballbot import Controller, InputError, Robot
from ballbot.cli.main import main
from ballbot.control.file import write_controller
from ballbot.control.gain_set import tunable
from ballbot.control.presets import design_gain, nominal_controller
from ballbot.control.tuning import Setting
from ballbot.firmware.build import compilers
from ballbot.link.messages import AnswerResult, ControllerPlace
from ballbot.link.tuning import FileLines, Tuner, TypedLines
from ballbot.log import Log
from tests.link.test_emulated import balancing, emulated

ROBOT = Robot.load("alten")
STIFFER = Controller(ROBOT, design_gain(ROBOT, state_weights=[60, 60, 500, 500, 10, 60, 60, 20, 20, 3]).gain)
CYCLE = (
    ("gain 1", ((0.0, 1.0), 1.0)),
    ("compensation 0.5", ((0.0, 1.0), 0.5)),
    ("gain 0.5 0.5", ((0.5, 0.5), 0.5)),
    ("back", ((0.0, 1.0), 0.5)),
    ("gain 0", ((1.0, 0.0), 0.5)),
    ("compensation 1", ((1.0, 0.0), 1.0)),
    ("gain 0.3", ((0.7, 0.3), 1.0)),
    ("compensation 0", ((0.7, 0.3), 0.0)),
    ("gain 0.6", ((0.4, 0.6), 0.0)),
    ("compensation 1", ((0.4, 0.6), 1.0)),
)


@pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")
def test_hundred_changes_without_a_fall(tmp_path, capsys):
    write_controller(nominal_controller(ROBOT), tmp_path / "soft.toml")
    write_controller(STIFFER, tmp_path / "stiff.toml")
    rows = [f"{1.0 + 0.1 * k:.1f} {CYCLE[k % 10][0]}" for k in range(100)]
    (tmp_path / "changes").write_text("0.5 gain -1  # outside\n0.6 jump\n\n" + "\n".join(rows))
    words = f"run --emulated --robot alten --controller {tmp_path}/soft.toml --with {tmp_path}/stiff.toml"
    words += f" --tune {tmp_path}/changes --reference square --duration 12 --out {tmp_path}/run"
    assert main(words.split()) == 0
    results = json.loads((tmp_path / "run" / "results.json").read_text())
    assert results["ended"] == "time"
    assert len(results["changes"]) == 100
    for k, change in enumerate(results["changes"]):
        weights, compensation = CYCLE[k % 10][1]
        assert change["t"] == pytest.approx(1.0 + 0.1 * k, abs=0.011)
        assert change["setting"]["weights"] == pytest.approx(weights)
        assert change["setting"]["compensation"] == compensation
    assert "Changes of the controller" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    printed = capsys.readouterr().out
    assert "it is 1 away." in printed
    assert "There is no command 'jump'; they are gain, compensation, back." in printed
    log = Log.read(tmp_path / "run" / "log.csv")
    assert np.abs(log["theta"]).max() < 0.1
    assert len(log) == 12.0 / ROBOT.sensors.sample_time


@pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")
def test_robot_takes_changes_only_while_its_own_controller_balances():
    assert balancing(emulated(), controller=ControllerPlace.HOST).tune(Setting())[0] is AnswerResult.DISARMED
    session = balancing(emulated())
    assert session.tune(Setting(weights=(0.9, 0.1)))[0] is AnswerResult.GAINS  # it has one gain
    result, time = session.tune(Setting(compensation=0.25))
    assert result is AnswerResult.OK
    assert session.tune(None)[0] is AnswerResult.OK
    assert session.state.time - 0.02e6 <= time <= session.state.time
    session.disarm()
    assert session.tune(None)[0] is AnswerResult.DISARMED


class Accepting:
    """A session with a robot that accepts every setting, two samples later."""

    def __init__(self):
        self.asked = []

    def tune(self, setting):
        self.asked.append(setting)
        return AnswerResult.OK, 2**32 - 10


def told(lines):
    """Return what a tuner says to lines, and its changes, on a robot with two gains."""
    controller, said = tunable(nominal_controller(ROBOT), [STIFFER]), []

    class Given:
        def until(self, _):
            yield from lines

    tuner = Tuner(Given(), controller.record["tuning"][0], say=said.append)
    tuner.update(Accepting(), 3.0, 2**32 - 20)
    return said, tuner.changes


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("gain 1.5", r"it is 0\.5 away\.$"),
        ("gain", "must be a command and numbers"),
        ("compensation far", "must be a command and numbers"),
        ("torque 0.9", "There is no command 'torque'"),
        ("gian 0.3", "did you mean 'gain'"),
    ],
)
def test_wrong_command_is_one_sentence(line, words):
    said, changes = told([line])
    assert len(said) == 1
    assert not changes
    assert re.search(words, said[0]), said[0]


def test_change_has_the_time_of_the_robot():
    said, changes = told(["gain 0.25", ""])
    assert said == ["3.00 s: gain 0.75 0.25, compensation 1"]
    assert changes[0].t == pytest.approx(3.0 + 10e-6)


def test_same_setting_again_leaves_the_former_one():
    _, changes = told(["compensation 0.5", "gain 0", "back"])
    assert [change.setting.compensation for change in changes] == [0.5, 0.5, 1.0]


@pytest.mark.parametrize("text", ["gain 0.3", "1 gain 0.3\n0.5 back", "nan back"])
def test_file_needs_times_in_order(text, tmp_path):
    (tmp_path / "changes").write_text(text)
    with pytest.raises(InputError, match=r"row \d: .* is no time"):
        FileLines(tmp_path / "changes")


@pytest.mark.skipif(os.name != "posix", reason="terminals are those of POSIX")
def test_lines_are_typed():
    import pty

    driver, own = pty.openpty()
    lines = TypedLines(own)
    assert list(lines.until(0.0)) == []
    os.write(driver, b"gain 0.3\nback\n")
    typed = []
    while len(typed) < 2:
        typed += lines.until(0.0)
    assert typed == ["gain 0.3", "back"]
    os.close(driver)
    os.close(own)
