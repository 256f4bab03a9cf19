"""`ballbot run` on an emulated robot: its logs, every end, and the arming that only a person at a terminal confirms."""

import json
import os
import signal
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest

from ballbot.cli.main import main
from ballbot.control.file import write_controller
from ballbot.control.presets import nominal_controller
from ballbot.errors import InputError
from ballbot.firmware.build import compilers
from ballbot.link.operators import TerminalOperator
from ballbot.log import Log
from ballbot.robot import Robot
from tests.support.processes import PATIENCE, Child

pytestmark = [
    pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)"),
    pytest.mark.skipif(os.name != "posix", reason="signals and terminals are those of POSIX"),
]


def run(words, folder):
    return main(["run", *words.split(), "--emulated", "--out", str(folder)])


def results(folder):
    return json.loads((folder / "results.json").read_text())


def test_torque_limit_rises_with_the_ramp(tmp_path, capsys):
    robot = Robot.load("alten")
    write_controller(nominal_controller(robot, compensation="none"), tmp_path / "controller.toml")
    words = f"--robot alten --controller {tmp_path / 'controller.toml'} --ramp 0.3 --duration 0.6"
    assert run(words, tmp_path / "run") == 0
    assert "ballbot: 0.0 s" in capsys.readouterr().err  # the monitor, in lines
    log = Log.read(tmp_path / "run" / "log.csv")
    limit = robot.drive.torque_limit
    largest = np.abs(log.torques).max(axis=1)
    assert (largest <= limit * np.minimum(1.0, (log.t + 2 * log.sample_time) / 0.3)).all()
    assert largest.max() > 0.0


class Listener:
    """Takes what a stream's server would send."""

    def __init__(self, *_):
        self.rows, self.events = [], []
        Listener.last = self

    def send_row(self, _time, message, _pose):
        self.rows.append(json.loads(message))

    def send_event(self, _time, text):
        self.events.append(text)

    def close(self):
        pass


def test_a_run_and_a_monitor_stream_their_rows_and_events(tmp_path, monkeypatch):
    monkeypatch.setattr("ballbot.link.foxglove_server.FoxgloveServer", Listener)
    assert run("--duration 0.3 --stream foxglove", tmp_path / "run") == 0
    log = Log.read(tmp_path / "run" / "log.csv")
    assert Listener.last.events == ["The robot is armed.", "The run of 0.3 s is over."]
    assert [row["t"] for row in Listener.last.rows] == log.t.tolist()
    assert [row["u2"] for row in Listener.last.rows] == log["u2"].tolist()
    assert main(["run", "monitor", "--emulated", "--duration", "0.2", "--stream", "foxglove"]) == 0
    assert len(Listener.last.rows) > 20
    assert {"theta", "gyro_x", "wheel1"} <= Listener.last.rows[0].keys()


@contextmanager
def balancing(folder):
    """Hold a process that balances an emulated robot, from when its recording grows."""
    words = ["-m", "ballbot", "run", "--emulated", "--duration", "6000", "--out", str(folder)]
    with Child(*words) as child:
        recording, end = folder / "log.recording.csv", time.monotonic() + PATIENCE
        while not (recording.exists() and recording.stat().st_size > 20_000):
            assert child.running, child.errors()
            assert time.monotonic() < end, f"no recording of 20 kB within {PATIENCE:g} s"
            time.sleep(0.02)
        yield child


def test_recording_of_a_run_that_was_cut_off_is_never_overwritten(tmp_path, capsys):
    (tmp_path / "log.recording.csv").write_text("t,whole\n0.0,1\n")
    assert run("--duration 0.5", tmp_path) == 2
    assert "is the log of a run that was cut off" in capsys.readouterr().err


@pytest.mark.slow
def test_interrupt_disarms_and_keeps_the_log(tmp_path):
    with balancing(tmp_path / "run") as child:
        child.send(signal.SIGINT)
        assert child.end() == 130, child.errors()
        assert "interrupted; the robot is disarmed" in child.errors()
    assert len(Log.read(tmp_path / "run" / "log.csv")) > 20
    assert results(tmp_path / "run")["ended"] == "interrupt"
    assert not (tmp_path / "run" / "log.recording.csv").exists()


def test_nobody_but_a_person_at_a_terminal_confirms(monkeypatch, tmp_path):
    with open(tmp_path / "answers", "w+") as answers:
        answers.write("arm\n")
        answers.seek(0)
        monkeypatch.setattr(sys, "stdin", answers)
        with pytest.raises(InputError, match="confirmed at a terminal"):
            TerminalOperator(print).confirm_arming()


@pytest.mark.parametrize(("typed", "confirmed"), [("arm", True), ("yes", False), ("", False)])
def test_confirmation_is_typed(typed, confirmed, monkeypatch):
    import pty

    driver, own = pty.openpty()
    os.write(driver, f"{typed}\n".encode())
    with open(own) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        assert TerminalOperator(print).confirm_arming() is confirmed
    os.close(driver)
