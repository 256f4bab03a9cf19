"""The league: the same numbers wherever it is played, falls counted, intervals that hold what they promise."""

import json
import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from control_examples import FRICTION, alten
from league_examples import OWN
from scipy import stats

from ballbot import InputError, Robot
from ballbot.cli.main import main
from ballbot.experiments.league import play as playing
from ballbot.experiments.league.course import Unlike
from ballbot.experiments.league.course_file import choose_courses
from ballbot.experiments.league.entrants import entrants_of
from ballbot.experiments.league.play import League, play
from ballbot.experiments.league.standings import league_results, overall, standing
from ballbot.experiments.league.statistics import mean_with_interval, paired_difference, share_with_interval
from ballbot.report.league_page import league_report
from ballbot.report.provenance import provenance
from ballbot.robot.file import write_robot
from ballbot.twin import Twin
from benchmarks.league import section

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
    write_robot(alten(FRICTION), folder / "robot.toml")
    (folder / "courses.toml").write_text(COURSES)
    (folder / "own.py").write_text(OWN)
    return folder


def short_league(folder: Path, *, processes: int) -> League:
    robot = Robot.load(str(folder / "robot.toml"))
    words = ("none", "full", f"softer={folder}/own.py:Softer", f"limp={folder}/own.py:Limp")
    controllers = {one.name: one.controller(robot) for one in entrants_of(words)}
    courses = choose_courses(str(folder / "courses.toml"), robot, "model")
    return play(robot, controllers, courses, seeds=[4, 5], processes=processes)


@pytest.fixture(scope="module")
def league(folder) -> League:
    return short_league(folder, processes=1)


def test_processes_change_nothing(folder, league):
    again = short_league(folder, processes=2)
    assert json.dumps(league_results(again)) == json.dumps(league_results(league))
    for key, track in league.tracks.items():
        np.testing.assert_array_equal(again.tracks[key].x, track.x)


def test_a_fall_is_counted_and_nothing_else_of_it(league):
    limp = standing(league, "stand", "limp")
    assert limp.falls == limp.runs == 2
    assert limp.means["peak_position_error"].runs == 0
    assert np.isnan(limp.means["rms_torque"].mean)
    assert np.isnan(limp.differences["energy"].mean)
    assert overall(league, "limp").falls == 4
    assert league.tracks["stand", "limp"].ended is not None
    assert standing(league, "stand", "none").falls == 0


def test_differences_are_seed_by_seed(league):
    for course in ("stand", "step"):
        peaks = [[one.rms_position_error for one in league.scores[course, name]] for name in ("full", "none")]
        found = standing(league, course, "full").differences["rms_position_error"]
        assert found.mean == pytest.approx(np.mean(peaks[0]) - np.mean(peaks[1]))
        assert found.runs == 2
    assert standing(league, "stand", "none").differences == {}


def test_ratios_over_all_courses(league):
    logs = [
        np.log(own.energy / first.energy)
        for course in ("stand", "step")
        for own, first in zip(league.scores[course, "softer"], league.scores[course, "none"], strict=True)
    ]
    found = overall(league, "softer").ratios["energy"]
    assert found.mean == pytest.approx(np.exp(np.mean(logs)))
    assert found.low < found.mean < found.high


def test_compensation_helps_on_the_model(league):
    """The known friction compensated in full: the step of 0.2 m ends nearer to its end."""
    assert overall(league, "full").ratios["rms_position_error"].mean < 0.9


def test_the_page_says_who_fell_and_who_is_better(league):
    page = league_report(league, provenance(command="ballbot compare", files=[], seed="4,5"))
    assert page.count("<svg") == 3  # the overview, and a figure for each course
    assert "4 of 4 runs ended in a fall." in page
    assert re.search(r"Peak position error 0\.\d+ times that of none", page)
    assert "A step of 0.2 m. 4 s." in page
    assert "Seed 4,5;" in page


def test_the_evidence_has_a_row_for_each_course_and_controller(league):
    made = section(league).markdown()
    assert made.count("| stand |") == made.count("| step |") == len(league.controllers)
    assert "| step | limp | – | – | – | – | – | – | 2 of 2 |" in made


def test_a_league_in_which_all_fall_has_a_page(folder):
    robot = alten()
    courses = choose_courses(str(folder / "courses.toml"), robot, "model")
    controllers = {"limp": entrants_of([f"{folder}/own.py:Limp"])[0].controller(robot)}
    found = play(robot, controllers, courses[:1], seeds=[1], processes=1)
    page = league_report(found, provenance(command="ballbot compare", files=[], seed="1"))
    assert "1 of 1 runs ended in a fall." in page


def test_intervals_hold_the_truth_as_often_as_they_say():
    """2000 leagues of 10 seeds: 95 % of the intervals of the difference hold it, within 3.5 standard deviations."""
    draw = np.random.default_rng(7)
    of_seed = draw.normal(0.0, 1.0, (2000, 10))  # what a seed does to both
    ours = 0.3 + of_seed + draw.normal(0.0, 0.2, (2000, 10))
    theirs = of_seed + draw.normal(0.0, 0.2, (2000, 10))
    found = [paired_difference(one, other) for one, other in zip(ours, theirs, strict=True)]
    share = np.mean([one.low <= 0.3 <= one.high for one in found])
    assert share == pytest.approx(0.95, abs=3.5 * np.sqrt(0.95 * 0.05 / 2000))
    apart = np.array([mean_with_interval(one).high - mean_with_interval(one).low for one in ours[:200]])
    paired = np.array([one.high - one.low for one in found[:200]])
    assert np.median(paired) < 0.4 * np.median(apart)  # sqrt(2) 0.2 against sqrt(1.04)


def test_intervals_of_skewed_numbers_are_nearly_right():
    """Peaks are skewed: of log-normal ones with a shape of 0.5, intervals of ten seeds hold 92 % and more."""
    draw = np.random.default_rng(8)
    peaks = np.exp(draw.normal(0.0, 0.5, (2000, 10)))
    found = [mean_with_interval(one) for one in peaks]
    assert np.mean([one.low <= np.exp(0.125) <= one.high for one in found]) > 0.92 - 3.5 * 0.005


@pytest.mark.parametrize("runs", [1, 7, 30])
def test_the_interval_of_falls_holds_at_least_what_it_says(runs):
    """Summed over all outcomes: no probability is left out more often than once in twenty."""
    low, high = np.array([share_with_interval(count, runs) for count in range(runs + 1)]).T
    p = np.linspace(0.0, 1.0, 201)[:, None]
    held = stats.binom.pmf(np.arange(runs + 1), runs, p) * ((low <= p) & (p <= high))
    assert held.sum(axis=1).min() >= 0.95 - 1e-9
    assert high[0] == pytest.approx(1.0 - 0.025 ** (1.0 / runs))  # of no fall


def test_few_seeds_have_no_interval():
    one = paired_difference([2.0, np.nan], [1.0, 0.0])
    assert one.mean == 1.0
    assert one.runs == 1
    assert np.isnan([one.low, one.high]).all()
    assert one.sign == 0
    assert mean_with_interval([]).runs == 0
    assert paired_difference([2.0, 3.0], [1.0, 2.0]).sign == 1


def test_a_league_goes_on_where_it_was_killed(folder, tmp_path, monkeypatch, capsys):
    words = [str(folder / "robot.toml"), "none", f"own={folder}/own.py:Softer"]
    options = ["--scenarios", str(folder / "courses.toml"), "--seeds", "4,5", "--processes", "1"]

    def run(name: str, *more: str) -> int:
        monkeypatch.chdir(tmp_path)
        return main(["compare", *words, *options, *more, "--out", name])

    played: list[int] = []
    whole = playing._play

    def until_third(robot, game):
        if len(played) == 3:
            raise KeyboardInterrupt
        played.append(game.seed)
        return whole(robot, game)

    monkeypatch.setattr(playing, "_play", until_third)
    assert run("league") == 130
    assert "--resume" in capsys.readouterr().err
    assert sorted(path.name for path in Path("league").iterdir()) == ["checkpoint.jsonl"]
    assert run("league") == 2
    assert "was not finished" in capsys.readouterr().err

    monkeypatch.setattr(playing, "_play", lambda robot, game: played.append(game.seed) or whole(robot, game))
    assert run("league", "--resume") == 0
    assert len(played) == 8  # two controllers, courses and seeds; none twice
    assert sorted(path.name for path in Path("league").iterdir()) == ["report.html", "results.json"]
    Path("league").rename("killed")
    assert run("league") == 0
    for name in ("report.html", "results.json"):
        assert Path("league", name).read_bytes() == Path("killed", name).read_bytes()
    assert "0 of 2" in capsys.readouterr().out


def test_a_push_on_the_twin_is_a_course(tmp_path):
    pytest.importorskip("mujoco")
    robot = alten()
    course = '[mine.{0}]\nreference = "hold"\nduration = 3.0\nsettle = 1.0\n'
    push = (
        "[[mine.push.scenario.pushes]]\ntime = 1.5\nduration = 0.2\nforce = [40.0, 0.0, 0.0]\nheight = 0.4\n"
    )
    (tmp_path / "courses.toml").write_text(course.format("calm") + course.format("push") + push)
    courses = choose_courses(str(tmp_path / "courses.toml"), robot, "twin")
    controllers = {one.name: one.controller(robot) for one in entrants_of(["none"])}
    found = play(robot, controllers, courses, seeds=[1], processes=1)
    calm, pushed = (found.scores[name, "none"][0] for name in ("calm", "push"))
    assert pushed.peak_position_error > calm.peak_position_error + 0.1  # 8 N s on 20 kg
    assert pushed.settling_time == pytest.approx(1.5, abs=0.01)  # since the push, to the end
    assert not pushed.arrived


def test_the_built_in_courses_are_all_of_the_league():
    courses = choose_courses("league", alten(), "twin")
    assert {one.name for one in courses} == {
        "hold", "square", "circle", "figure_eight", "change_pose", "push", "ramp", "payload", "floor", "heading",
    }  # fmt: skip
    both = (*choose_courses("motions", alten(), "twin"), *choose_courses("disturbances", alten(), "twin"))
    assert courses == both
    assert choose_courses("motions,square", alten(), "twin") == courses[:5]
    changed = {one.name: one.scenario for one in courses}
    assert changed["floor"].friction.rolling == pytest.approx(3 * changed["hold"].friction.rolling)
    assert changed["heading"].sensors.heading_drift == pytest.approx(
        5 * changed["hold"].sensors.heading_drift, rel=1e-3
    )


def test_a_robot_unlike_the_one_described(tmp_path):
    """Mass and height of a body whose inertia goes with them, on either plant; the controllers' robot stays."""
    robot = alten(FRICTION)
    (tmp_path / "courses.toml").write_text(COURSE + "unlike = { mass = 1.2, height = 0.8, friction = 0.5 }")
    (course,) = choose_courses(str(tmp_path / "courses.toml"), robot, "model")
    true = course.plant(robot).robot
    assert true.body.mass == pytest.approx(1.2 * robot.body.mass)
    assert true.body.center_of_mass == pytest.approx(0.8 * robot.body.center_of_mass)
    # J_0 = J_c + m l^2 about either lying axis
    own, ml2 = robot.body.inertia_about_ball_center()[0, 0], robot.body.mass * robot.body.center_of_mass**2
    expected = 1.2 * (own - ml2) + 1.2 * 0.8**2 * ml2
    assert true.body.inertia_about_ball_center()[0, 0] == pytest.approx(expected)
    assert true.friction.coulomb == pytest.approx([0.5 * one for one in FRICTION.coulomb])
    assert true.friction.stribeck_speed == FRICTION.stribeck_speed
    pytest.importorskip("mujoco")
    (course,) = choose_courses(str(tmp_path / "courses.toml"), robot, "twin")
    twin = course.plant(robot)
    assert isinstance(twin, Twin)
    assert twin.robot.body == true.body
    assert twin.scenario.friction.rolling == pytest.approx(0.5 * 0.007)


def test_the_robots_of_the_set_unlike_are_all_corners():
    courses = choose_courses("unlike", alten(), "model")
    corners = {(one.unlike.mass, one.unlike.height, one.unlike.friction) for one in courses}
    assert corners == set(product((0.8, 1.2), repeat=3))
    assert choose_courses("light_low_smooth", alten(), "model")[0].unlike == Unlike(
        mass=0.8, height=0.8, friction=0.8
    )


@pytest.mark.parametrize(
    ("word", "sentence"),
    [
        ("{}/own.py", "say what in it makes the controller"),
        ("{}/own.py:Missing", "has no 'Missing' to call"),
        ("{}/own.py:GAIN", "has no 'GAIN' to call"),
        ("{}/own.py:lazy", "has no sample_time"),
        ("{}/own.py:broken", "failed when it was made: AttributeError: 'Robot' object has no attribute"),
        ("{}/own.py:Timeless", "the sample_time of"),
        ("{}/nowhere.py:Mine", "there is no Python file"),
        ("{}/nowhere.toml", "There is no controller file"),
        ("{}/bad.py:Mine", "bad.py cannot be run: NameError: name 'no_such_name' is not defined (line 2)"),
        ("{}/worse.py:Mine", "worse.py cannot be run: SyntaxError"),
        ("=none", "lacks its name or its source"),
    ],
)
def test_a_wrong_controller_is_told_in_a_sentence(folder, word, sentence):
    (folder / "bad.py").write_text("import numpy\nno_such_name\n")
    (folder / "worse.py").write_text("def (:\n")
    with pytest.raises(InputError) as told:
        entrants_of([word.format(folder)])[0].controller(alten())
    assert sentence in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("own", "sentence"),
    [
        ("Late", "failed at t = 0.505 s: ZeroDivisionError: no gain left (line"),
        ("Odd", "returned str at t = 0 s, which is no array of torques"),
    ],
)
def test_a_controller_that_fails_on_its_way_is_told(folder, own, sentence):
    robot = alten()
    controllers = {"own": entrants_of([f"{folder}/own.py:{own}"])[0].controller(robot)}
    with pytest.raises(InputError) as told:
        play(robot, controllers, choose_courses("hold", robot, "model"), seeds=[1], processes=1)
    assert sentence in str(told.value)


COURSE = '[mine.one]\nreference = "hold"\nduration = 9.0\n'


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "holds no courses"),
        ("duration = 3.0", "duration holds no courses; write each below a line [duration.NAME]"),
        ("[mine.one]\nduration = 3.0", "[mine.one]: reference is missing; add it."),
        (COURSE.replace("9.0", "-9.0"), "duration is -9.0; input should be greater than 0"),
        (COURSE.replace("9.0", "nan"), "duration is nan"),
        (COURSE.replace("hold", "holt"), "there is no reference 'holt'; did you mean 'hold'?"),
        (
            COURSE.replace('"hold"', '{ name = "hold", side = 1.0 }'),
            "the reference hold has no side; it has x, y, psi.",
        ),
        (COURSE.replace('"hold"', "{ x = 1.0 }"), "a table without a name"),
        (
            COURSE.replace('"hold"', '{ name = "hold", x = "far" }'),
            "reference.x is 'far'; it must be a number.",
        ),
        (COURSE.replace('"hold"', '"nowhere.csv"'), "nowhere.csv"),
        (COURSE + "lenght = 3.0", "lenght is not a key of a course; it has about, reference, duration"),
        (COURSE + "unlike = { mass = 0.0 }", "unlike.mass is 0.0; input should be greater than 0"),
        (COURSE + "[mine.one.scenario]\nbacklsh = 0.1", "did you mean 'backlash'?"),
        (COURSE + '[mine.one.scenario]\npivoting = "much"', "pivoting is 'much'; it must be a number."),
        (COURSE + COURSE.replace("mine", "yours").replace("9.0", "8.0"), "there are two courses 'one'"),
        ("[mine", "is not valid TOML"),
    ],
)
def test_a_wrong_course_file_is_told_in_a_sentence(tmp_path, text, sentence):
    path = tmp_path / "courses.toml"
    path.write_text(text)
    with pytest.raises(InputError) as told:
        choose_courses(str(path), alten(), "twin")
    assert sentence in str(told.value)
    assert "\n" not in str(told.value)


def test_a_course_beside_its_reference(tmp_path):
    (tmp_path / "way.csv").write_text("t,ref_x,ref_y,ref_psi\n0,0,0,0\n1,0.25,0,0\n")
    (tmp_path / "courses.toml").write_text(COURSE.replace("hold", "way.csv"))
    (course,) = choose_courses(str(tmp_path / "courses.toml"), alten(), "model")
    assert course.asked.reference()(2.0)[0] == 0.25


def test_the_examples_in_the_documents_are_ones(tmp_path):
    text = (Path(__file__).parents[1] / "docs" / "compare.md").read_text(encoding="utf-8")
    python, *_ = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    (courses,) = re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL)
    (tmp_path / "mine.py").write_text(python)
    (tmp_path / "courses.toml").write_text(courses)
    robot = alten()
    mine = entrants_of([f"{tmp_path}/mine.py:Mine"])[0]
    assert mine.name == "mine.py:Mine"
    state = np.array([0.1, 0, 0, 0.02, 0, 0, 0, 0, 0, 0])
    nominal = entrants_of(["none"])[0].controller(robot).update(0.0, state, np.zeros(10))
    np.testing.assert_allclose(mine.controller(robot).update(0.0, state, np.zeros(10)), nominal)
    (course,) = choose_courses(str(tmp_path / "courses.toml"), robot, "twin")
    assert course.scenario.timing.delay == 1
    for name in (one.name for one in choose_courses("league", robot, "twin")):
        assert f"`{name}`" in text


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["alten", "none", "none"], "two controllers are called 'none'"),
        (["alten", "none", "--seeds", "0-"], "the seeds are '0-'"),
        (["alten", "none", "--scenarios", "push"], "choose --plant twin"),
        (
            ["alten", "none", "--scenarios", "moon"],
            "there is no set or course 'moon'; the sets are league, motions",
        ),
        (["alten", "none", "--scenarios", "moon.toml"], "moon.toml cannot be read"),
        (["alten", "nowhere.toml"], "There is no controller file 'nowhere.toml'"),
    ],
)
def test_wrong_input_ends_in_one_sentence_and_exit_code_2(tmp_path, capsys, arguments, sentence):
    assert main(["compare", *arguments, "--out", str(tmp_path)]) == 2
    told = capsys.readouterr().err
    assert told.startswith("ballbot: ")
    assert sentence in told
    assert told.count("\n") == 1
