"""The study from end to end, small: a simulated log whose friction is known."""

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.cli import study as study_command
from ballbot.cli.main import main
from ballbot.control.file import read_controller
from ballbot.errors import InputError
from ballbot.file_formats import results_text
from ballbot.files import write_text
from ballbot.fitting.run import Run
from ballbot.identification import Bounds
from ballbot.identification.identify import IdentificationOptions
from ballbot.identification.windows import holdout_intervals
from ballbot.log import STATE_NAMES, Log
from ballbot.report.blocks import Provenance, provenance
from ballbot.report.page import page_of
from ballbot.report.study import study_report, study_results, study_texts
from ballbot.robot import Robot
from ballbot.workflows import controller_choice
from ballbot.workflows import study as study_workflow
from ballbot.workflows.controller_choice import NamedCourse, confirm
from ballbot.workflows.study import Study, StudyOptions, study
from tests.support.control_examples import FRICTION
from tests.support.screen import assert_fits_a_screen
from tests.support.validation_examples import noisy_log

#: v_s and delta are held: the search follows their long valley in half of its steps
SMALL = StudyOptions(
    duration=8.0,
    draws=6,
    confirm=False,
    bounds=Bounds({"stribeck_speed": (0.6, 0.6), "stribeck_exponent": (1.1, 1.1)}),
)
#: profiles have tests of their own (tests/fitting/test_intervals.py)
BRIEF = partial(IdentificationOptions, search_windows=32, most_profiles=0)


def walk() -> Log:
    """Return the log studied: once around the square."""
    return noisy_log().between(0.0, 16.0)


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def little_effort() -> Iterator[None]:
    """Identify with little effort, and compare in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study_workflow, "IdentificationOptions", BRIEF)
        patch.setattr("ballbot.fitting.run.os.cpu_count", lambda: 1)
        yield


@pytest.fixture(scope="module")
def small() -> Study:
    return study(Robot.load("alten"), {"walk": walk()}, options=SMALL, run=Run(seed=3))


def write_study(study: Study, out: Path, *, made: Provenance) -> None:
    """Write a study into a folder as its command does."""
    for name, text in study_texts(study, out).items():
        write_text(out / name, text)
    write_text(out / "results.json", results_text(study_results(study) | {"provenance": made}))
    write_text(out / "report.html", page_of(replace(study_report(study), provenance=made)))


@given(st.floats(1.0, 400.0), st.floats(-50.0, 50.0))
def test_holdout_is_a_quarter_of_the_log_in_separate_intervals(duration, first):
    log = Log({"t": first + np.linspace(0.0, duration, 500)})
    stretches = holdout_intervals(log)
    share = sum(end - start for start, end in stretches) / duration
    assert 0.15 < share < 0.4
    edges = [edge for stretch in stretches for edge in stretch]
    assert edges == sorted(edges)
    assert edges[0] > first
    assert edges[-1] <= first + duration + 1e-9
    assert all(end - start <= 8.0 + 1e-9 for start, end in stretches)


def test_study_and_what_it_holds_fit_a_screen(small: Study):
    for result in (small, small.found, small.validation):
        assert_fits_a_screen(result)


def test_the_friction_found_is_near_the_truth(small: Study):
    found = small.found.robot.friction
    # a short log and a small effort: c + s, the friction of a slow wheel, is determined best
    sums = np.array(found.coulomb) + np.array(found.stribeck)
    np.testing.assert_allclose(sums, np.array(FRICTION.coulomb) + np.array(FRICTION.stribeck), rtol=0.35)
    assert np.all(small.validation.open_loop.errors.ratio > 1.0)
    # measured 8 mm and 0.25 m: the seeds share little else than the course
    trials = small.choice.trials
    assert (trials["precise"].peaks < 0.2 * trials["none"].peaks).all()
    # the two are equal, or nearly: the smoother one wins
    assert small.choice.chosen in ("precise", "precise_without_compensation")


@pytest.mark.usefixtures("undrawn")
def test_a_controller_that_compensates_nothing_has_the_best_compensated_one_beside_it(small, tmp_path):
    choice = replace(small.choice, chosen="precise_without_compensation")
    write_study(replace(small, choice=choice), tmp_path, made=provenance(command="", files=[], seed=3))
    robot = Robot.load(tmp_path / "robot.toml")
    chosen, compensated = (
        read_controller(tmp_path / name, robot) for name in ("controller.toml", "compensated_controller.toml")
    )
    assert choice.compensated == "precise"
    assert (chosen.compensation, compensated.compensation) == ("none", "full")
    np.testing.assert_array_equal(chosen.gain, compensated.gain)
    results = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert results["comparison"]["compensated"] == "precise"
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "The best that compensates friction, precise, is compensated_controller.toml" in page


@pytest.mark.usefixtures("undrawn")
def test_the_twin_confirms_the_choice_beside_the_loop(small: Study, tmp_path: Path, monkeypatch):
    pytest.importorskip("mujoco")
    monkeypatch.setattr(controller_choice, "CONFIRMED_ON", NamedCourse(name="square", duration=7.0))
    monkeypatch.setattr(controller_choice, "CONFIRMED_RUNS", 1)
    found = confirm(small.choice)
    assert found is not None
    assert list(found.on_twin) == ["none", small.choice.chosen]
    assert found.contradiction is None
    # the friction is the robot's on both, the twin's rollers come on top: within a factor of three
    for name, twin in found.on_twin.items():
        assert 1.0 / 3.0 < twin.peak.median / found.on_loop[name].peak.median < 3.0
    confirmed = replace(small, confirmation=found)
    write_study(confirmed, tmp_path, made=provenance(command="", files=[], seed=3))
    results = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert results["comparison"]["confirmation"]["none"]["twin"]["runs"] == 1
    assert "On the physics-engine twin, 7 s of the square" in (tmp_path / "report.html").read_text(
        encoding="utf-8"
    )


@pytest.mark.sample
def test_measured_logs_are_predicted_better_with_friction(shared_data, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(study_command, "StudyOptions", partial(StudyOptions, duration=8.0))
    bounds = tmp_path / "bounds.toml"
    # for time's sake v_s and delta are held: no profile is computed for them
    bounds.write_text("stribeck_speed = [0.6, 0.6]\nstribeck_exponent = [1.0, 1.0]\n")
    log = tmp_path / "square_soft.csv"
    # once and a half around the square: 72 windows for ten parameters, and a quarter held out
    Log.read(shared_data / "bbr" / "square_soft.csv").between(0.0, 24.0).write(log)
    options = ["--no-confirm", "--draws", "6", "--bounds", str(bounds), "--out", str(tmp_path / "out")]
    assert main(["study", "alten", str(log), *options]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("Next: `ballbot run PORT")
    results = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    open_loop = results["validation"]["open_loop"]
    assert all(open_loop["with_friction"][name] < open_loop["without_friction"][name] for name in STATE_NAMES)


def test_a_study_refuses_before_it_works():
    robot, log = Robot.load("alten"), noisy_log().between(0.0, 3.0)
    with pytest.raises(InputError, match="give one or more"):
        study(robot, {})
    with pytest.raises(InputError, match=r"walk: .*u3"):
        study(robot, {"walk": Log({name: v for name, v in log.columns.items() if name != "u3"})})
    with pytest.raises(InputError, match=r"walk: .*u4"):
        study(robot, {"walk": log.with_columns({"u4": log["u3"]})})
    for draws in (5, 10_001):
        with pytest.raises(InputError, match="must be 6 to 10000"):
            study(robot, {"walk": log}, options=StudyOptions(draws=draws))
