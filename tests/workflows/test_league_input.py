"""What enters the league: courses, controllers of one's own, and the refusals of wrong ones."""

import re
from pathlib import Path

import numpy as np
import pytest

from ballbot import InputError
from ballbot.control.file import write_controller
from ballbot.control.interface import estimator_of
from ballbot.control.presets import precise_controller
from ballbot.fitting.run import Threads
from ballbot.robot import Robot
from ballbot.twin import Twin
from ballbot.workflows.courses import choose_courses
from ballbot.workflows.grid import LoopRobot
from ballbot.workflows.league import run_league
from tests.support.control_examples import FRICTION, alten
from tests.support.league_examples import OWN, controllers_of
from tests.support.paths import ROOT

COURSE = '[mine.one]\nreference = "hold"\nduration = 9.0\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Return a folder with controllers of a user's own."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "own.py").write_text(OWN)
    return folder


def test_the_built_in_courses_are_all_of_the_league():
    courses = choose_courses("league", alten(), "twin")
    both = (*choose_courses("motions", alten(), "twin"), *choose_courses("disturbances", alten(), "twin"))
    assert courses == both
    assert choose_courses("motions,square", alten(), "twin") == courses[:5]


def test_mismatch_changes_the_true_robot_on_either_plant(tmp_path):
    """Mass and height of a body whose inertia goes with them, on either plant; the controllers' robot stays."""
    robot = alten(FRICTION)
    (tmp_path / "courses.toml").write_text(COURSE + "mismatch = { mass = 1.2, height = 0.8, friction = 0.5 }")
    (course,) = choose_courses(str(tmp_path / "courses.toml"), robot, "model")
    on_loop = course.plant(robot)
    assert isinstance(on_loop, LoopRobot)
    true = on_loop.model.robot
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
    make = course.plant(robot)
    assert not isinstance(make, LoopRobot)
    twin = make("onboard")
    assert isinstance(twin, Twin)
    assert twin.robot.body == true.body
    assert twin.scenario.friction.rolling == pytest.approx(0.5 * 0.007)


@pytest.mark.parametrize(
    ("word", "sentence"),
    [
        ("{}/own.py", "Name the class or function that makes the controller"),
        ("{}/own.py:Missing", "has no 'Missing' to call"),
        ("{}/own.py:lazy", "own.py:lazy: A controller is given as an object of type NoneType"),
        ("{}/own.py:broken", "failed when it was made: AttributeError: 'Robot' object has no attribute"),
        ("{}/own.py:Timeless", "own.py:Timeless: The controller's sample time is -1"),
        ("{}/nowhere.py:Mine", "there is no Python file"),
        ("{}/bad.py:Mine", "bad.py cannot be run: NameError: name 'no_such_name' is not defined (line 2)"),
        ("{}/worse.py:Mine", "worse.py cannot be run: SyntaxError"),
        ("=none", "lacks its name or its source"),
        ("none@camera", "There is no estimator 'camera'; the estimators are onboard, kalman"),
    ],
)
def test_a_wrong_controller_is_refused_in_one_sentence(folder, word, sentence):
    (folder / "bad.py").write_text("import numpy\nno_such_name\n")
    (folder / "worse.py").write_text("def broken(:")
    with pytest.raises(InputError) as refusal:
        controllers_of(alten(), word.format(folder))
    assert sentence in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("own", "sentence"),
    [
        ("Late", "failed at t = 0.505 s: ZeroDivisionError: no gain left (line"),
        ("Odd", "own.py:Odd returned at t = 0 s is an array"),
    ],
)
def test_a_controller_that_fails_during_a_run_is_reported(folder, own, sentence):
    robot = alten()
    controllers = controllers_of(robot, f"{folder}/own.py:{own}")
    with pytest.raises(InputError, match=re.escape(sentence)):
        run_league(robot, controllers, choose_courses("hold", robot, "model"), seeds=[1], workers=Threads())


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "holds no courses"),
        ("[mine.one]\nduration = 3.0", "[mine.one]: reference is missing; a course needs it."),
        (COURSE.replace("9.0", "-9.0"), "duration is -9.0; it must be above 0."),
        (COURSE.replace("hold", "holt"), "There is no reference 'holt'; did you mean 'hold'?"),
        (COURSE.replace('"hold"', '{ name = "hold", side = 1.0 }'), "hold has no option side; it has x, y"),
        (COURSE.replace('"hold"', "{ x = 1.0 }"), "a table without a name"),
        (COURSE.replace('"hold"', '"nowhere.csv"'), "nowhere.csv"),
        (COURSE + "lenght = 3.0", "lenght is not a key of a course; the keys there are about"),
        (COURSE + "[mine.one.scenario]\nbacklsh = 0.1", "did you mean 'backlash'?"),
        (COURSE + COURSE.replace("mine", "yours").replace("9.0", "8.0"), "There are two courses 'one'"),
        (COURSE + 'metrics = ["peak_leen"]', "no metric 'peak_leen'; did you mean 'peak_lean'"),
        (COURSE + "stop = 9.0", "stop is 9 s, and the run ends at 9 s"),
        (
            COURSE + "scenario.payload = { mass = 1, position = [0, 0, 0.5], put_on = 5.0, taken_off = 5.0 }",
            "taken_off is 5",
        ),
        (
            COURSE + "scenario.carpet = { rolling = 0.02, pivoting = 0.02, begins = 4.0, ends = 3.0 }",
            "ends is 3 s",
        ),
        (
            COURSE + "largest_push = { time = 3.0, duration = 0.1, height = 0.4 }\n"
            "scenario.carpet = { rolling = 0.02, pivoting = 0.02, begins = 4.0 }",
            "largest_push is the only disturbance",
        ),
    ],
)
def test_a_wrong_course_file_is_refused_in_one_sentence(tmp_path, text, sentence):
    path = tmp_path / "courses.toml"
    path.write_text(text)
    with pytest.raises(InputError) as refusal:
        choose_courses(str(path), alten(), "twin")
    assert sentence in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_course_beside_its_reference(tmp_path):
    (tmp_path / "way.csv").write_text("t,ref_x,ref_y,ref_psi\n0,0,0,0\n1,0.25,0,0\n")
    (tmp_path / "courses.toml").write_text(COURSE.replace("hold", "way.csv"))
    (course,) = choose_courses(str(tmp_path / "courses.toml"), alten(), "model")
    assert course.reference_spec.reference()(2.0)[0] == 0.25


def test_the_examples_in_the_documents_are_ones(tmp_path):
    page = ROOT / "docs" / "compare.md"
    text = page.read_text(encoding="utf-8")
    function, python, *_ = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    (included,) = re.findall(r"```\{literalinclude\} (\S+)\n", text)
    (tmp_path / "mine.py").write_text(f"{function}\n{python}")
    robot = alten()
    controllers = controllers_of(robot, f"{tmp_path}/mine.py:Mine", f"{tmp_path}/mine.py:law", "none")
    assert list(controllers) == ["mine.py:Mine", "mine.py:law", "none"]
    state = np.array([0.1, 0, 0, 0.02, 0, 0, 0, 0, 0, 0])
    *own, nominal = (one.update(0.0, state, np.zeros(10)) for one in controllers.values())
    np.testing.assert_allclose(own, [nominal, nominal])
    shown = [one.name for one in choose_courses(str(page.parent / included), robot, "twin")]
    assert set(shown) > {one.name for one in choose_courses("league", robot, "twin")}


def test_controllers_name_their_estimator_and_a_word_changes_it(tmp_path):
    robot = Robot.load("alten")
    file, own = tmp_path / "stiff.toml", tmp_path / "mine.py"
    write_controller(precise_controller(robot), file)
    own.write_text(
        'class Mine:\n    sample_time, estimator = 0.005, "kalman"\n    __init__ = reset = update = print\n'
    )
    words = ["precise", "precise@onboard", "none", "none@kalman", "mine=full@kalman", str(file)]
    words += [f"own={own}:Mine", f"other={own}:Mine@onboard"]
    found = {name: estimator_of(one) for name, one in controllers_of(robot, *words).items()}
    assert found == {
        "precise": "kalman",
        "precise@onboard": "onboard",
        "none": "onboard",
        "none@kalman": "kalman",
        "mine": "kalman",
        "stiff.toml": "kalman",
        "own": "kalman",
        "other": "onboard",
    }


@pytest.mark.parametrize("preset", Robot.presets())
def test_the_benchmark_can_be_run_on_every_preset(preset):
    robot = Robot.load(preset)
    courses = {course.name: course for course in choose_courses("benchmark", robot, "model")}
    assert len(courses) == 15
    assert all(course.metrics and course.about for course in courses.values())
    assert [name for name, course in courses.items() if course.until_fall] == ["largest_push", "faster"]
    search = courses["largest_push"].largest_push
    assert search is not None
    for seed, toward in ((0, (1.0, 0.0)), (2, (0.0, 1.0)), (11, (-(0.5**0.5), 0.5**0.5))):
        push = search.push(7.0, seed)
        np.testing.assert_allclose(
            push.duration * np.array(push.force[:2]), 7.0 * np.array(toward), atol=1e-12
        )
    changing = courses["payload_on_and_off"].plant(robot)
    assert isinstance(changing, LoopRobot)
    assert [later.time for later in changing.imperfections.later] == [10.0, 20.0]
    masses = [later.model.robot.body.mass for later in changing.imperfections.later]
    assert masses == [pytest.approx(robot.body.mass + 2.0), robot.body.mass]
