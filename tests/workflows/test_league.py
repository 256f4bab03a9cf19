"""The league: the same numbers wherever it runs, falls counted, intervals that hold what they promise, and its page."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from ballbot import Robot, simulate
from ballbot.control.references import hold
from ballbot.report.blocks import Cell
from ballbot.report.comparison import course_sheet, league_report, metric_rows
from ballbot.twin.scenario import Scenario
from ballbot.workflows.bounds import bounds_of
from ballbot.workflows.courses import choose_courses
from ballbot.workflows.league import (
    League,
    compare,
    overall,
    run_league,
    standing,
    with_assumed_friction,
)
from ballbot.workflows.metrics import score_results
from ballbot.workflows.statistics import fraction_with_interval, mean_ratio, mean_with_interval
from tests.support.control_examples import FRICTION, alten
from tests.support.league_examples import OWN, controllers_of
from tests.support.screen import assert_fits_a_screen

#: two short courses on the model, so that a league takes seconds
COURSES = """\
[mine.stand]
about = "Stand."
reference = "hold"
duration = 3.0
settle = 1.0

[mine.step]
about = "A step of 0.2 m."
reference = { name = "change_pose", x = 0.2, y = 0.0, psi = 0.0, at = 0.5, ramp = 0.0 }
duration = 4.0
settle = 2.0
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Return a folder with a robot, courses and controllers of a user's own."""
    folder = tmp_path_factory.mktemp("league")
    alten(FRICTION).write(folder / "robot.toml")
    (folder / "courses.toml").write_text(COURSES)
    (folder / "own.py").write_text(OWN)
    return folder


@pytest.fixture(scope="module")
def league(folder) -> League:
    robot = Robot.load(str(folder / "robot.toml"))
    own = f"softer={folder}/own.py:Softer", f"limp={folder}/own.py:Limp"
    courses = choose_courses(str(folder / "courses.toml"), robot, "model")
    return run_league(robot, controllers_of(robot, "none", "full", *own), courses, seeds=[4, 5])


@pytest.mark.slow
def test_a_fall_is_counted_and_nothing_else_of_it(league):
    limp = standing(league, "stand", "limp")
    assert limp.falls == limp.runs == 2
    assert limp.means["peak_position_error"].runs == 0
    assert np.isnan(limp.means["rms_torque"].mean)
    assert np.isnan(limp.differences["energy"].mean)
    assert overall(league, "limp").falls == 4
    assert league.tracks["stand", "limp"].ended is not None
    assert standing(league, "stand", "none").falls == 0


@pytest.mark.slow
def test_league_fits_a_screen_and_is_drawn(league):
    assert_fits_a_screen(league)


def test_differences_are_seed_by_seed(league):
    for course in ("stand", "step"):
        peaks = [[one.rms_position_error for one in league.scores[course, name]] for name in ("full", "none")]
        found = standing(league, course, "full").differences["rms_position_error"]
        assert found.mean == pytest.approx(np.mean(peaks[0]) - np.mean(peaks[1]))
        assert found.runs == 2
    assert standing(league, "stand", "none").differences == {}


@pytest.mark.slow
def test_a_push_on_the_twin_is_a_course(tmp_path):
    pytest.importorskip("mujoco")
    robot = alten()
    course = '[mine.{0}]\nreference = "hold"\nduration = 3.0\nsettle = 1.0\n'
    push = (
        "[[mine.push.scenario.pushes]]\ntime = 1.5\nduration = 0.2\nforce = [40.0, 0.0, 0.0]\nheight = 0.4\n"
    )
    (tmp_path / "courses.toml").write_text(course.format("calm") + course.format("push") + push)
    courses = choose_courses(str(tmp_path / "courses.toml"), robot, "twin")
    found = run_league(robot, controllers_of(robot, "none"), courses, seeds=[1])
    calm, pushed = (found.scores[name, "none"][0] for name in ("calm", "push"))
    assert pushed.peak_position_error > calm.peak_position_error + 0.1  # 8 N s on 20 kg
    assert pushed.settling_time == pytest.approx(1.5, abs=0.01)  # since the push, to the end
    assert not pushed.arrived
    assert score_results(pushed)["settling_time"] is None
    assert score_results(pushed)["settling_time_at_least"] == pushed.settling_time


def test_league_intervals_cover_at_their_level():
    """2000 leagues of 10 seeds: 95 % of the intervals of the difference hold it, within 3.5 standard deviations."""
    draw = np.random.default_rng(7)
    of_seed = draw.normal(0.0, 1.0, (2000, 10))  # what a seed does to both
    ours = 0.3 + of_seed + draw.normal(0.0, 0.2, (2000, 10))
    theirs = of_seed + draw.normal(0.0, 0.2, (2000, 10))
    found = [mean_with_interval(one - other) for one, other in zip(ours, theirs, strict=True)]
    share = np.mean([one.low <= 0.3 <= one.high for one in found])
    assert share == pytest.approx(0.95, abs=3.5 * np.sqrt(0.95 * 0.05 / 2000))
    apart = np.array([mean_with_interval(one).high - mean_with_interval(one).low for one in ours[:200]])
    paired = np.array([one.high - one.low for one in found[:200]])
    assert np.median(paired) < 0.4 * np.median(apart)  # sqrt(2) 0.2 against sqrt(1.04)


@pytest.mark.parametrize("runs", [1, 7, 30])
def test_fall_interval_covers_at_least_its_level(runs):
    """Summed over all outcomes: no probability is left out more often than once in twenty."""
    low, high = np.array([fraction_with_interval(count, runs) for count in range(runs + 1)]).T
    p = np.linspace(0.0, 1.0, 201)[:, None]
    held = stats.binom.pmf(np.arange(runs + 1), runs, p) * ((low <= p) & (p <= high))
    assert held.sum(axis=1).min() >= 0.95 - 1e-9
    assert high[0] == pytest.approx(1.0 - 0.025 ** (1.0 / runs))  # of no fall


def test_few_seeds_have_no_interval():
    one = mean_with_interval([1.0, np.nan])
    assert one.mean == 1.0
    assert one.runs == 1
    assert np.isnan([one.low, one.high]).all()
    assert one.sign == 0
    assert mean_with_interval([]).runs == 0
    assert mean_with_interval([1.0, 1.0]).sign == 1


def test_paired_ratio_over_courses_has_one_value_for_each_run():
    """Twice as far off on one course and half as far on the other: one in all, in each of the runs."""
    ones = np.ones((2, 5))
    found = mean_ratio(ones * [[2.0], [0.5]], ones)
    assert found.mean == pytest.approx(1.0)
    assert found.runs == 5


def test_equal_controllers_differ_by_nothing(folder):
    """A robot without friction, whose compensation changes rounding alone; the page shows 0, not its digits."""
    robot = alten()
    (course,) = choose_courses(str(folder / "courses.toml"), robot, "model")[:1]
    league = run_league(robot, controllers_of(robot, "none", "full"), [course], seeds=range(1, 4))
    peak = metric_rows(league, course)[0]
    assert isinstance(peak[2], Cell)
    assert peak[2].below.startswith("0 (")
    assert "*" not in peak[2].below


@pytest.mark.parametrize(
    ("preset", "factor"), [("alten", 1.0), ("rob311", 1.7194 * 0.048 / (17.076 * 0.063))]
)
def test_robot_without_friction_runs_with_the_nominal_scenarios_for_its_load(monkeypatch, preset, factor):
    """All wheels of both are tilted alike, so that the load goes as the body's mass."""
    ran = {}

    def stop(robot, controllers, courses, **_: object) -> None:
        ran.update(robot=robot, known=controllers["full"].robot, plant=courses[0].plant(robot))
        raise KeyboardInterrupt

    monkeypatch.setattr("ballbot.workflows.league.run_league", stop)
    nominal = Scenario.nominal(preset).friction
    for plant in ("model", "twin"):
        with pytest.raises(KeyboardInterrupt):
            compare(preset, ["full"], courses="floor", plant=plant)
        made = ran["plant"]
        true = made.scenario.friction if plant == "twin" else made.model.robot.friction
        for friction in (ran["known"].friction, true):
            for name in ("viscous", "coulomb", "stribeck"):
                np.testing.assert_allclose(getattr(friction, name), factor * np.array(getattr(nominal, name)))
            assert (friction.stribeck_speed, friction.stribeck_exponent) == (0.6, 1.1)
        assert ran["known"].friction.rolling == nominal.rolling
        assert plant == "model" or true.rolling == 0.021  # the course's carpet


@pytest.mark.slow
def test_page_says_which_friction_was_assumed(folder):
    league = compare("rob311", ["none"], courses=str(folder / "courses.toml"), seeds=[1])
    page = league_report(league)
    assert "times 0.077" in league.friction
    assert league.friction in [text for _, text in page.verdict]
    assert league.friction in page.sections[0].blocks[0].caption
    robot = Robot.load(str(folder / "robot.toml"))
    assert with_assumed_friction(robot) == (robot, "")


def test_the_largest_push_is_where_single_pushes_let_the_robot_fall():
    robot = alten(FRICTION)
    (course,) = choose_courses("largest_push", robot, "model")
    controllers, seeds = controllers_of(robot, "precise"), (3, 6)
    scores = run_league(robot, controllers, [course], seeds=seeds).scores[course.name, "precise"]
    search, bound = course.largest_push, bounds_of(course, robot)["largest_impulse"]
    step = 1.1 * bound / 2**9
    assert search is not None
    for seed, score in zip(seeds, scores, strict=True):
        assert score.ended is None
        assert 20.0 < score.largest_impulse < bound
        for impulse, falls in ((score.largest_impulse, False), (score.largest_impulse + step, True)):
            plant = course.plant(robot, search.push(impulse, seed))
            log = simulate(
                plant("kalman"), controllers["precise"], hold(), duration=course.duration, seed=seed
            )
            assert (log.ended is not None) == falls


@pytest.mark.slow
def test_a_bound_stands_beside_its_numbers(league):
    """Half of what the first controller has."""
    assert course_sheet(league).headings == ("course", *league.controllers)
    mean = standing(league, "stand", "none").means["peak_position_error"].mean
    bounded = replace(league, bounds={"stand": {"peak_position_error": 0.5 * mean}})
    sheet = course_sheet(bounded)
    assert sheet.headings == ("course", "bound", *league.controllers)
    (_, bound, first, *_), (_, none, other, *_) = sheet.rows
    assert float(str(bound)) == pytest.approx(500.0 * mean, rel=0.01)
    assert "× 2.0" in str(first)
    assert none == ""
    assert "×" not in str(other)
