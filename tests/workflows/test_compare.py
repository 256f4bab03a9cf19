"""The commands from a design to a comparison."""

import json

import numpy as np
import pytest

from ballbot import InputError, Log
from ballbot.cli.main import main
from ballbot.robot.file import write_robot
from ballbot.workflows.comparison import run_comparison
from tests.support.control_examples import FRICTION, alten


def test_empty_comparison_is_refused():
    with pytest.raises(InputError, match="nothing to compare"):
        run_comparison([])


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_design_simulate_compare_from_the_command_line(tmp_path, capsys):
    robot = str(tmp_path / "found.toml")
    write_robot(alten(FRICTION), robot)
    out = tmp_path / "out"
    assert main(["design", robot, "--compensation", "full", "--out", str(out / "design")]) == 0
    controller = str(out / "design" / "controller.toml")
    designed = json.loads((out / "design" / "results.json").read_text())
    assert np.array(designed["gain"]).shape == (3, 10)
    assert max(real for real, _ in designed["poles"]) < 0.0

    run = ["--reference", "square", "--duration", "8", "--controller", controller, "--out", str(out / "run")]
    assert main(["simulate", robot, *run]) == 0
    assert len(Log.read(out / "run" / "log.csv")) == 1600
    results = json.loads((out / "run" / "results.json").read_text())
    assert results["ended"] is None
    assert results["peak_position_error"] >= results["rms_position_error"]

    (tmp_path / "courses.toml").write_text('[mine.short]\nreference = "square"\nduration = 16.0\n')
    runs = ["--scenarios", str(tmp_path / "courses.toml"), "--seeds", "1", "--processes", "1"]
    assert (
        main(["compare", robot, "none", f"designed={controller}", *runs, "--out", str(out / "compare")]) == 0
    )
    compared = json.loads((out / "compare" / "results.json").read_text())["courses"]["short"]["controllers"]
    peaks = {name: one["means"]["peak_position_error"]["mean"] for name, one in compared.items()}
    assert peaks["designed"] < 0.5 * peaks["none"]
    assert "falls" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["design", "alten", "--q", "1,2,many"], "--q is '1,2,many'"),
        (["design", "alten", "--r", "-1"], "R is not positive definite"),
        (["simulate", "alten", "--reference", "triangle"], "There is no reference 'triangle'"),
        (
            ["simulate", "alten", "--controller", "nowhere.toml"],
            "no controller file or ready-made controller 'nowhere.toml'",
        ),
        (["simulate", "alten", "--duration", "0"], "at least one sample"),
    ],
)
def test_wrong_input_ends_in_one_sentence_and_exit_code_2(tmp_path, capsys, arguments, sentence):
    assert main([*arguments, "--out", str(tmp_path)]) == 2
    told = capsys.readouterr().err
    assert told.startswith("ballbot: ")
    assert sentence in told
    assert told.count("\n") == 1
