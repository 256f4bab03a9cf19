"""The study from end to end, small: a simulated log whose friction is known."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.cli import study as study_command
from ballbot.cli.main import main
from ballbot.control.file import read_controller
from ballbot.control.overcompensation import certain_friction
from ballbot.errors import InputError
from ballbot.file_formats import results_text
from ballbot.files import write_text
from ballbot.fitting.run import Run
from ballbot.identification import Bounds, identify
from ballbot.identification.stages import IdentificationOptions, holdout_intervals
from ballbot.log import STATE_NAMES, Log
from ballbot.progress import Progress, ProgressCallback
from ballbot.report.blocks import Provenance, provenance
from ballbot.report.page import page_of
from ballbot.report.study import (
    compensation_sentence,
    controller_sentence,
    study_report,
    study_results,
    study_texts,
)
from ballbot.results import as_json
from ballbot.robot import Robot
from ballbot.robot.file import write_robot
from ballbot.workflows import study as study_workflow
from ballbot.workflows import twin_confirmation
from ballbot.workflows.controller_choice import (
    CANDIDATES,
    STEPS,
    NamedCourse,
    compensated_robot,
    draw_plants,
)
from ballbot.workflows.controller_prediction import (
    DISCREPANCY,
    Prediction,
    checksum_of,
    performance_intervals,
)
from ballbot.workflows.study import Study, StudyOptions, study
from ballbot.workflows.twin_confirmation import confirm
from tests.support.control_examples import FRICTION
from tests.support.report_pages import LARGEST_PAGE, figure_count, shown_text
from tests.support.screen import assert_fits_a_screen
from tests.support.validation_examples import noisy_log

#: v_s and delta are held: the search follows their long valley in half of its steps
SMALL = StudyOptions(
    duration=8.0,
    draws=2,
    confirm=False,
    bounds=Bounds({"stribeck_speed": (0.6, 0.6), "stribeck_exponent": (1.1, 1.1)}),
)
#: profiles have tests of their own (tests/fitting/test_intervals.py)
BRIEF = partial(IdentificationOptions, evolution_windows=32, most_profiles=0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Brief(StudyOptions):
    """The effort of a study of whose candidates nothing is asked."""

    duration: float = 8.0


def walk() -> Log:
    """Return the log studied: once around the square."""
    return noisy_log().between(0.0, 16.0)


def run(progress: ProgressCallback) -> Study:
    watched = Run(seed=3, progress=progress)
    return study(Robot.load("alten"), {"walk": walk()}, options=SMALL, run=watched)


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def little_effort() -> Iterator[None]:
    """Identify with little effort, and compare in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study_workflow, "IdentificationOptions", BRIEF)
        patch.setattr("ballbot.workflows.comparison.os.cpu_count", lambda: 1)
        yield


@pytest.fixture(scope="module")
def shown() -> list[Progress]:
    return []


@pytest.fixture(scope="module")
def small(shown: list[Progress]) -> Study:
    return run(shown.append)


@pytest.fixture(scope="module")
def folder(small: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("study") / "made" / "deep"
    source = tmp_path_factory.mktemp("logs") / "walk.csv"
    walk().write(source)
    made = provenance(command="ballbot study alten walk.csv --out made", files=[source], seed=3)
    write_study(small, out, made=made)
    return out


def write_study(study: Study, out: Path, *, made: Provenance) -> None:
    """Write a study into a folder as its command does."""
    for name, text in study_texts(study, out).items():
        write_text(out / name, text)
    write_text(out / "results.json", results_text(study_results(study) | {"provenance": made}))
    write_text(out / "report.html", page_of(replace(study_report(study), made=made)))


# --- what is held out ---


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


def test_study_and_what_it_holds_fit_a_screen_and_can_be_plotted(small: Study):
    for result in (small, small.found, small.validation):
        assert_fits_a_screen(result)
        assert result.plot().axes


@pytest.mark.usefixtures("small")
def test_progress_names_each_stage(shown: list[Progress]):
    stages = ["identifying friction", "validating", "comparing controllers"]
    stages += ["measuring what brings the gain", "measuring where friction matters"]
    assert list(dict.fromkeys(one.stage for one in shown)) == stages
    assert all(0.0 <= one.share <= 1.0 for one in shown)


def test_windows_of_the_fit_lie_outside_the_holdout_intervals(small: Study):
    (studied,) = small.logs
    assert studied.held_out
    for span in small.found.fit_windows:
        assert all(span.end <= start or end <= span.start for start, end in studied.held_out)


def test_study_and_identify_report_the_same_numbers_and_doubts(small: Study):
    (studied,) = small.logs
    found = identify(
        small.robot,
        studied.log,
        seed=small.seed,
        bounds=small.options.bounds,
        options=BRIEF(),
    )
    # the findings of the log have its name in the study alone
    ours, theirs = (replace(one, log_findings=()).to_dict() for one in (found, small.found))
    assert as_json(ours) == as_json(theirs)


def test_a_design_for_the_robot_found_compensates_what_the_study_does(small: Study, tmp_path):
    write_robot(small.found.robot, tmp_path / "robot.toml")
    designed = certain_friction(Robot.load(tmp_path / "robot.toml"))
    studied = compensated_robot(small.found).friction
    for name in ("viscous", "coulomb", "stribeck", "rolling"):
        # the file's digits
        np.testing.assert_allclose(getattr(designed, name), getattr(studied, name), rtol=2e-3)


# --- end to end ---


def test_the_friction_found_is_near_the_truth(small: Study):
    found = small.found.robot.friction
    # a short log and a small effort: c + s, the friction of a slow wheel, is determined best
    sums = np.array(found.coulomb) + np.array(found.stribeck)
    np.testing.assert_allclose(sums, np.array(FRICTION.coulomb) + np.array(FRICTION.stribeck), rtol=0.35)
    assert np.all(small.validation.open_loop.errors.ratio > 1.0)
    # measured 8 mm and 0.25 m: the seeds share little else than the course
    trials = small.choice.trials
    assert (trials["precise"].peaks < 0.2 * trials["none"].peaks).all()
    # on two plants the two are equal, or nearly: the smoother one wins
    assert small.choice.chosen in ("precise", "precise_without_compensation")


def test_plants_are_drawn_from_the_identified_uncertainty(small: Study):
    count = 2000
    plants = draw_plants(small.found, scenario=small.scenario, count=count, seed=1)
    frictions = [plant.robot.friction for plant in plants]
    assert min(min(one.viscous + one.coulomb + one.stribeck) for one in frictions) >= 0.0
    # C_rr lies far from its bounds, so that nothing is clipped: 4 sigma of a sampled mean and standard deviation
    rolling = np.array([one.rolling for one in frictions])
    deviation = float(np.sqrt(small.found.covariance[11, 11]))
    assert 0.0 < deviation < small.found.robot.friction.rolling / 4.0
    assert abs(rolling.mean() - small.found.robot.friction.rolling) < 4.0 * deviation / np.sqrt(count)
    assert rolling.std() == pytest.approx(deviation, rel=4.0 / np.sqrt(2.0 * count))
    # b and c of a wheel trade against each other, and so they are drawn: sampled to 4 / sqrt(count)
    expected = small.found.correlation[0, 3]
    drawn = np.corrcoef([one.viscous[0] for one in frictions], [one.coulomb[0] for one in frictions])[0, 1]
    assert drawn == pytest.approx(expected, abs=0.15)  # and clipping at zero, which takes some of it away


def test_results_keep_their_keys(folder: Path, small: Study):
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    for key in ("parameters", "standard_errors"):
        table = results[key]
        assert set(table) == {"b", "c", "s", "v_s", "delta", "C_rr"}
        assert [len(table[name]) for name in "bcs"] == [3, 3, 3]
    for loop in ("closed_loop", "open_loop"):
        for which in ("with_friction", "without_friction"):
            errors = results["validation"][loop][which]
            assert tuple(errors) == STATE_NAMES
            assert all(error > 0.0 for error in errors.values())
    prediction = results["validation"]["prediction"]
    assert len(prediction["labels"]) == 13
    assert np.shape(prediction["correlation"]) == (13, 13)
    comparison = results["comparison"]
    pairs = [(step["before"], step["after"]) for step in comparison["steps"]]
    assert [tuple(one["controller"] for one in pair) for pair in pairs] == [
        (step.before, step.after) for step in STEPS
    ]
    for entry in (*(comparison[name] for name in CANDIDATES), *(one for pair in pairs for one in pair)):
        assert entry["falls"] or 0.0 < entry["rms_position_error"] <= entry["peak_position_error"]
    assert comparison["gain"]["low"] <= comparison["gain"]["median"] <= comparison["gain"]["high"]
    gains = [one["position_gain"] for one in comparison["stiffness"]["gains"]]
    assert gains == sorted(gains)
    # the little integral action that it can have makes it a tenth stiffer than the nominal one
    assert gains[0] == pytest.approx(np.linalg.norm(small.design.gain[:, 0]), rel=0.12)
    assert results["controller"]["kind"] == small.choice.chosen
    assert results["controller"]["estimator"] == "kalman"
    made = results["provenance"]
    assert made["seed"] == 3
    assert re.fullmatch(r"[0-9a-f]{64}", made["files"][0]["sha256"])


def test_the_files_read_back(folder: Path, small: Study):
    robot = Robot.load(folder / "robot.toml")
    assert robot.friction == small.found.robot.friction
    controller = read_controller(folder / "controller.toml", robot)
    chosen = small.choice.controller
    assert chosen is not None
    np.testing.assert_array_equal(controller.packed, chosen.packed)
    assert controller.estimator == chosen.estimator == "kalman"
    assert {path.name for path in folder.glob("[!.]*")} == {
        "report.html",
        "results.json",
        "robot.toml",
        "controller.toml",
        "previous_controller.toml",
        *(["compensated_controller.toml"] if chosen.compensation == "none" else []),
    }


@pytest.mark.usefixtures("undrawn")
def test_a_controller_that_compensates_nothing_has_the_best_compensated_one_beside_it(
    small: Study, tmp_path: Path
):
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


def test_a_gain_over_runs_that_all_fell_is_not_shown(small: Study):
    trials = dict(small.choice.trials)
    fallen = tuple(replace(one, ended="fallen") for one in trials["none"].scores)
    trials["none"] = replace(trials["none"], scores=fallen)
    choice = replace(small.choice, trials=trials)
    assert "times smaller" not in controller_sentence(choice)
    assert "divides" not in compensation_sentence(choice)


@pytest.mark.usefixtures("undrawn")
def test_report_shows_the_predicted_performance(small: Study):
    seen = small.choice.trials["precise"].performances
    intervals = performance_intervals(seen * 3, discrepancy=DISCREPANCY["precise"])
    controller = small.choice.controller
    assert controller is not None
    assert small.prediction is None  # two plants are too few
    prediction = Prediction(
        course=small.choice.course,
        controller="precise",
        checksum=checksum_of(controller),
        torque_limit=controller.torque_limit,
        scenario="nominal",
        draws=6,
        chosen=intervals,
        none={},
    )
    page = page_of(study_report(replace(small, prediction=prediction)))
    assert f"{1e3 * intervals['peak_error'].low:.1f} to {1e3 * intervals['peak_error'].high:.1f}" in page
    assert "--prediction results.json LOG" in page
    assert study_results(replace(small, prediction=prediction))["prediction"] == prediction


def test_report_is_self_contained(folder: Path):
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"""(?:src|href)\s*=\s*["'](?!#|data:)""", page)
    assert "@import" not in page
    assert "<script src" not in page
    assert not re.search(r"url\((?!#)", page)
    assert len(page) < LARGEST_PAGE
    figures = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    assert figure_count(page) >= 9
    assert max(len(figure) for figure in figures) < 300_000
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    for anchor in re.findall(r'href="#([^"]+)"', page):
        assert anchor in ids
    assert not re.search(r"\b(nan|None|inf)\b", shown_text(page))


@pytest.mark.usefixtures("undrawn")
def test_the_twin_confirms_the_choice_beside_the_loop(small: Study, tmp_path: Path, monkeypatch):
    pytest.importorskip("mujoco")
    monkeypatch.setattr(twin_confirmation, "CONFIRMED_ON", NamedCourse(name="square", duration=7.0))
    monkeypatch.setattr(twin_confirmation, "CONFIRMED_RUNS", 1)
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
def test_measured_logs_are_predicted_better_with_friction(
    shared_data: Path, tmp_path: Path, monkeypatch, capsys
):
    monkeypatch.setattr(study_command, "StudyOptions", Brief)
    bounds = tmp_path / "bounds.toml"
    # for time's sake v_s and delta are held: no profile is computed for them
    bounds.write_text("stribeck_speed = [0.6, 0.6]\nstribeck_exponent = [1.0, 1.0]\n")
    log = tmp_path / "square_soft.csv"
    # once and a half around the square: 72 windows for ten parameters, and a quarter held out
    Log.read(shared_data / "bbr" / "square_soft.csv").between(0.0, 24.0).write(log)
    options = ["--no-confirm", "--draws", "2", "--bounds", str(bounds), "--out", str(tmp_path / "out")]
    assert main(["study", "alten", str(log), *options]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("Next: `ballbot run PORT")
    results = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    open_loop = results["validation"]["open_loop"]
    assert all(open_loop["with_friction"][name] < open_loop["without_friction"][name] for name in STATE_NAMES)


# --- the commands ---


@pytest.mark.usefixtures("undrawn")
def test_validate_writes_tables_and_results(folder: Path, tmp_path: Path, capsys):
    log = tmp_path / "walk.csv"
    walk().write(log)
    assert main(["validate", str(folder / "robot.toml"), str(log), "--out", str(tmp_path / "checked")]) == 0
    printed = capsys.readouterr().out
    assert "Open loop, " in printed
    results = json.loads((tmp_path / "checked" / "results.json").read_text(encoding="utf-8"))
    assert set(results["validation"]["by_log"]) == {"walk"}
    assert (tmp_path / "checked" / "report.html").read_text(encoding="utf-8").startswith("<!doctype html>")


@pytest.mark.parametrize("command", ["study", "validate"])
def test_bad_input_ends_in_one_sentence_and_exit_code_2(command, folder: Path, tmp_path: Path, capsys):
    good, robot = tmp_path / "good.csv", str(folder / "robot.toml")
    log = noisy_log().between(0.0, 3.0)
    log.write(good)
    broken = tmp_path / "broken.csv"
    Log({name: values for name, values in log.columns.items() if name != "phi_dot"}).write(broken)
    a_file = tmp_path / "a_file"
    a_file.write_text("")
    out = str(tmp_path / "out")
    cases = {
        "no log": [robot, "--out", out],
        "a log that is not there": [robot, str(tmp_path / "none.csv"), "--out", out],
        "a log without a column": [robot, str(broken), "--out", out],
        "no such robot": ["nobody", str(good), "--out", out],
        "out is a file": [robot, str(good), "--out", str(a_file)],
        "no such mapping": [robot, str(good), "--out", out, "--mapping", str(tmp_path / "none.toml")],
    }
    for what, words in cases.items():
        assert main([command, *words]) == 2, what
        said = capsys.readouterr().err
        assert said.startswith("ballbot: "), what
        assert said.count("\n") == 1, what
        assert "Traceback" not in said


def test_a_study_refuses_before_it_works():
    robot, log = Robot.load("alten"), noisy_log().between(0.0, 3.0)
    with pytest.raises(InputError, match="give one or more"):
        study(robot, {})
    with pytest.raises(InputError, match=r"walk: .*u3"):
        study(robot, {"walk": Log({name: v for name, v in log.columns.items() if name != "u3"})})
    with pytest.raises(InputError, match=r"walk: .*u4"):
        study(robot, {"walk": log.with_columns({"u4": log["u3"]})})
    for draws in (1, 10_001):
        with pytest.raises(InputError, match="must be 2 to 10000"):
            study(robot, {"walk": log}, options=StudyOptions(draws=draws))
