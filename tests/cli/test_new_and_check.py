"""The command line: `new`, `check`, and what becomes of bad input in any command."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ballbot.cli import main as program
from ballbot.cli.app import COMMANDS, Command
from ballbot.cli.main import main
from ballbot.log import Log
from ballbot.robot import Robot


def refused(capsys: pytest.CaptureFixture[str], *tokens: str) -> str:
    """Run a command line that must end in one sentence and exit code 2; return the sentence."""
    assert main(tokens) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("ballbot: ")
    assert printed.err.count("\n") == 1
    assert "Traceback" not in printed.err
    return printed.err


def test_new_overwrites_only_when_forced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("precious")
    assert "already exists" in refused(capsys, "new", "mine", "--out", str(path))
    assert path.read_text() == "precious"
    assert main(["new", "mine", "--out", str(path), "--force"]) == 0
    assert Robot.load(path).name == "mine"


@pytest.mark.usefixtures("undrawn")
def test_check_refuses_inconsistent_robots(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "light.toml", tmp_path / "out"
    assert main(["new", "light", "--out", str(path)]) == 0
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("value = 17.076", "value = 0.017076"), encoding="utf-8")
    sentence = refused(capsys, "check", str(path), "--out", str(out))
    assert "Did you mean body.mass 17.08 kg?" in sentence
    assert "--accept robot-body" in sentence
    assert not out.exists()
    codes = [word for code in ("ball", "body", "wheels") for word in ("--accept", f"robot-{code}")]
    assert main(["check", str(path), "--out", str(out), *codes]) == 0
    findings = json.loads((out / "results.json").read_text(encoding="utf-8"))["findings"]
    assert {"robot-ball", "robot-body", "robot-wheels"} <= {one["code"] for one in findings}
    assert "error (accepted)" in capsys.readouterr().out


def test_check_prints_and_writes_derived_quantities(tmp_path, capsys):
    assert main(["check", "alten", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    page = " ".join((tmp_path / "report.html").read_text(encoding="utf-8").split())
    # (V.2), (V.3) of the thesis, digit by digit; on the page only
    for row in ("0.6173 -1.0692 1.2346", "-0.5400 0.2700 0.2700"):
        assert row in page
        assert row not in " ".join(printed.split())
    assert "Unstable pole: 5.20" in printed
    assert "Plausible" in printed
    assert "27.59" in printed
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["unstable_pole"] == pytest.approx(5.20, abs=0.005)


def test_robot_that_its_own_swing_contradicts_is_not_called_plausible(tmp_path, capsys):
    t = np.arange(0.0, 20.0, 0.01)
    stiffness = 17.076 * 9.81 * 0.393  # of alten, hung up at the ball's centre [N m/rad]
    swing = 0.05 * np.exp(-0.01 * t) * np.cos(np.sqrt(stiffness / 4.1) * t)  # the file has 4.37 kg m^2
    Log({"t": t, "theta": swing}).write(tmp_path / "swing.csv")
    assert main(["check", "alten", "--swing", str(tmp_path / "swing.csv")]) == 0
    printed = capsys.readouterr().out
    assert "Plausible" not in printed
    assert "Doubtful" in printed
    assert "0.938 times the file's 4.37" in printed


def test_a_package_that_is_not_installed_is_named(monkeypatch, capsys):
    def lack(tokens: list[str]) -> int:
        raise ModuleNotFoundError(f"No module for {tokens}", name="mujoco")

    monkeypatch.setattr(program, "_run", lack)
    assert "pip install 'ballbot[twin]'" in refused(capsys, "record", "alten")


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_every_command_has_help_with_an_example(command: Command, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command.name, "--help"]) == 0
    assert f"ballbot {command.name} " in capsys.readouterr().out.replace(f"Usage: ballbot {command.name}", "")


def test_help_lists_the_commands_without_loading_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    printed = capsys.readouterr().out
    for command in COMMANDS:
        assert command.summary.split(";")[0] in printed
    heavy = ["numba", "scipy", "matplotlib", "mujoco", "pyarrow", "ballbot.robot"]
    script = (
        "import sys; from ballbot.cli.main import main; main(['--help']); "
        f"sys.exit(len([name for name in {heavy!r} if name in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    assert done.returncode == 0


@pytest.mark.slow
def test_a_terminal_of_ascii_gets_question_marks_instead_of_an_error(tmp_path: Path) -> None:
    words = ["new", "mine", "--out", str(tmp_path / "Kugelrobotér.toml")]
    script = f"import sys; from ballbot.cli.main import main; sys.exit(main({words}))"
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        env=os.environ | {"PYTHONIOENCODING": "ascii"},
        check=False,
    )
    assert done.returncode == 0
    assert b"robot?r.toml" in done.stdout
