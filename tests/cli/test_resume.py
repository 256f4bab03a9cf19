"""`ballbot identify` interrupted with Ctrl-C or killed: it can be resumed, and gives the same bytes as undisturbed."""

import shlex
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from ballbot.cli import identify as identify_command
from ballbot.cli.main import main
from ballbot.identification.stages import IdentificationOptions
from benchmarks.workloads import measured_square, nominal_robot
from campaigns.resume import OUTPUTS, Identification, answers_on_file
from tests.support.identification_examples import balancing_log, noisy

#: few parameters are free, so that a run takes a second
BOUNDS = """\
stribeck = [0.0, 0.0]
stribeck_speed = [0.6, 0.6]
stribeck_exponent = [1.0, 1.0]
viscous = [0.015, 0.015]
rolling = [0.007, 0.007]
"""


@pytest.fixture(autouse=True)
def small_effort(monkeypatch):
    """Search less in this process; how well parameters are found is tested in tests/identification."""
    brief = partial(IdentificationOptions, generations=12, population=12, step=2.5e-3, most_profiles=1)
    monkeypatch.setattr(identify_command, "IdentificationOptions", brief)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    noisy(balancing_log(), seed=6).between(6.0, 10.0).write(folder / "log.csv")
    (folder / "bounds.toml").write_text(BOUNDS)
    return folder


def words(inputs: Path, *more: str) -> list[str]:
    options = ["--bounds", str(inputs / "bounds.toml"), "--window", "0.1", "--out", "out"]
    return ["identify", "alten", str(inputs / "log.csv"), *options, *more]


def outputs() -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in Path("out").glob("[!.]*")}


@pytest.fixture
def interrupted(inputs, tmp_path, monkeypatch, capsys) -> str:
    """Interrupt a run in a fresh working folder after five steps, and return its message."""
    monkeypatch.chdir(tmp_path)
    shown = 0

    def interrupt(*_: object, **__: object) -> None:
        nonlocal shown
        shown += 1
        if shown == 5:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("ballbot.cli.output._WrittenLines.report", interrupt)
        assert main(words(inputs)) == 130
    return capsys.readouterr().err


@pytest.mark.slow
def test_printed_resume_command_ends_in_the_same_bytes(inputs, interrupted, tmp_path, monkeypatch, capsys):
    assert interrupted.count("\n") == 1
    printed, command = interrupted.rstrip().split(": ballbot identify ")
    assert printed == "ballbot: interrupted; continue with"
    assert main(["identify", *shlex.split(command)]) == 0
    resumed = outputs()
    assert set(resumed) == {"report.html", "results.json", "robot.toml"}  # and no checkpoint any more
    (tmp_path / "undisturbed").mkdir()
    monkeypatch.chdir(tmp_path / "undisturbed")
    assert main(words(inputs)) == 0
    assert outputs() == resumed
    capsys.readouterr()


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ((), "holds a run that was not finished; resume it (--resume)"),
        (("--resume", "--seed", "1"), "belongs to another run, which differs in: seed;"),
    ],
)
def test_interrupted_run_is_neither_overwritten_nor_mixed(inputs, interrupted, capsys, more, sentence):
    assert interrupted
    kept = outputs()
    assert main(words(inputs, *more)) == 2
    printed = capsys.readouterr().err
    assert sentence in printed
    assert printed.count("\n") == 1
    assert outputs() == kept


OPTIONS = ("--bounds", "bounds.toml")


def folder_with_log(folder: Path) -> Path:
    folder.mkdir(parents=True)  # of one name in each run: a page names a log.csv by it
    # once around in 5 s, so that a short log turns every wheel
    measured_square(nominal_robot(), duration=5.0, period=5.0).write(folder / "log.csv")
    (folder / "bounds.toml").write_text(BOUNDS)
    return folder


def run(folder: Path, *, resume: bool) -> Identification:
    return Identification(folder=folder, resume=resume, options=OPTIONS)


@pytest.mark.sample  # a second way to end a run, at full effort
def test_run_killed_twice_ends_in_the_same_bytes(tmp_path):
    undisturbed = run(folder_with_log(tmp_path / "undisturbed" / "robot"), resume=False).finish()
    killed = folder_with_log(tmp_path / "killed" / "robot")
    random = np.random.default_rng()  # the moment within a step is left to chance
    for number, moment in enumerate((1, 1)):  # answers on file, the inputs' first
        process = run(killed, resume=number > 0).start()
        while answers_on_file(killed) < moment and process.poll() is None:
            time.sleep(1e-3)
        time.sleep(random.uniform(0.0, 0.03))
        process.kill()
        process.communicate()
        assert answers_on_file(killed) >= moment
    assert run(killed, resume=True).finish() == undisturbed
    assert {path.name for path in (killed / "out").glob("[!.]*")} == set(OUTPUTS)
