"""`ballbot identify`: what it prints, its page and exit codes."""

import json
from functools import partial

import numpy as np
import pytest

from ballbot import Log
from ballbot.cli import identify as identify_command
from ballbot.cli.main import main
from ballbot.identification.identify import IdentificationOptions
from ballbot.robot import Friction
from tests.support.identification_examples import balancing_log, noisy
from tests.support.report_pages import LARGEST_PAGE


@pytest.fixture(autouse=True)
def small_effort(monkeypatch):
    """Search less; how well parameters are found is tested in tests/identification."""
    brief = partial(IdentificationOptions, most_steps=5, step=2.5e-3, most_profiles=1)
    monkeypatch.setattr(identify_command, "IdentificationOptions", brief)


@pytest.fixture
def log_file(tmp_path):
    path = tmp_path / "log.csv"
    noisy(balancing_log(), seed=6).between(6.0, 10.0).write(path)
    return path


@pytest.mark.slow
def test_verdict_and_next_step_are_printed_and_the_page_has_what_is_held(tmp_path, log_file, capsys):
    bounds = tmp_path / "bounds.toml"
    bounds.write_text("rolling = [0.007, 0.007]\n")
    options = ["--bounds", str(bounds), "--window", "0.1"]
    command = ["identify", "alten", str(log_file), "--out", str(tmp_path / "out"), *options]
    assert main(command) == 0

    shown = capsys.readouterr().out.splitlines()
    assert any(line.startswith("Verdict: Usable") for line in shown)
    assert shown[-1].startswith("Next: `ballbot validate")
    page = (tmp_path / "out" / "report.html").read_text()
    assert "held at 0.00700" in page
    assert len(page) < LARGEST_PAGE


@pytest.mark.slow
def test_friction_that_does_not_help_to_predict_is_not_written(tmp_path, capsys):
    path, out = tmp_path / "log.csv", tmp_path / "out"
    noisy(balancing_log(friction=Friction.none(3), duration=10.0), seed=6).write(path)
    command = ["identify", "alten", str(path), "--out", str(out), "--window", "0.1", "--law", "coulomb"]
    assert main(command) == 2
    shown = capsys.readouterr()
    assert "Not usable: " in shown.out
    assert "No robot.toml was written." in shown.err
    assert not (out / "robot.toml").exists()
    results = json.loads((out / "results.json").read_text())
    assert results["verdict"]["usable"] is False
    assert results["verdict"]["sentence"] in shown.out.replace("\n", " ")
    assert "Not usable" in (out / "report.html").read_text().partition("<h2")[0]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["{log}", "--bounds", "{log}"], "is not valid TOML"),
        (["{log}", "--window", "1"], "windows of 1 s"),
        (["{log}", "--estimate", "frixion"], "did you mean 'friction'?"),
        (["{log}", "--exclude-states", "psy"], "'psy' is not a state"),
        (["{log}", "--estimate", ""], "There is nothing to estimate. Name some of friction"),
        (["{unread}"], "The log's column theta has no value in any row"),
        (["{dead}", "--window", "0.05"], "--accept dead-motor"),
        (["{row}"], "The log has one row"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(tmp_path, log_file, capsys, words, sentence):
    log, files = Log.read(log_file), {"log": log_file}
    spoilt = {"dead": log.with_columns(_filled(log, dict.fromkeys(("u1", "u2", "u3"), 0.1)))}
    spoilt |= {"unread": log.with_columns(_filled(log, {"theta": np.nan})), "row": log.select(slice(0, 1))}
    for name, one in spoilt.items():
        files[name] = tmp_path / f"{name}.csv"
        one.write(files[name])
    command = ["identify", "alten", *words, "--out", str(tmp_path / "out")]
    assert main([word.format(**files) for word in command]) == 2
    assert not list(tmp_path.glob("out/*"))
    results = capsys.readouterr().err
    assert results.startswith("ballbot: ")
    assert sentence in results
    assert results.count("\n") == 1


def _filled(log: Log, values: dict[str, float]) -> dict[str, np.ndarray]:
    return {name: np.full(len(log), value) for name, value in values.items()}
