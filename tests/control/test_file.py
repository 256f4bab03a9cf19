"""Controller files: what is written reads back, and a wrong file ends in one sentence."""

import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ballbot import InputError, Robot
from ballbot.control.controller import Controller
from ballbot.control.file import controller_text, read_controller, write_controller
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.errors import UnsuitedController
from ballbot.robot.components import scaled_friction
from tests.support.control_examples import FRICTION, alten, everything, four_wheeled


@pytest.mark.parametrize("robot", [alten(FRICTION), four_wheeled(friction=True)], ids=["three", "four"])
def test_what_is_written_reads_back_to_the_bit(tmp_path, robot):
    whole = everything(robot)
    written = Controller(
        robot,
        whole.gain,
        compensation="partial",
        torque_limit=3.3,
        speed_band=0.1,
        parts=whole.parts,
        estimator="kalman",
    )
    path = tmp_path / "folder" / "controller.toml"
    write_controller(written, path)
    read = read_controller(path, robot)
    np.testing.assert_array_equal(read.packed, written.packed)
    assert read.sample_time == written.sample_time
    assert read.compensation == "partial"
    assert controller_text(read) == controller_text(written)  # by which a prediction knows its controller
    assert read.estimator == "kalman"


def test_a_file_without_an_estimator_is_for_the_thesis_s_state(tmp_path):
    path, robot = tmp_path / "controller.toml", alten(FRICTION)
    write_controller(precise_controller(robot), path)
    text = path.read_text()
    assert 'estimator = "kalman"' in text
    path.write_text(text.replace('estimator = "kalman"\n', ""))
    assert read_controller(path, robot).estimator == "onboard"
    path.write_text(text.replace('estimator = "kalman"', 'estimator = "kalmann"'))
    with pytest.raises(InputError, match="estimator"):
        read_controller(path, robot)


def test_the_parts_of_a_file_are_for_the_robot_that_it_is_read_with(tmp_path):
    path = tmp_path / "controller.toml"
    write_controller(everything(alten(FRICTION)), path)
    heavy = alten(FRICTION)
    heavy = heavy.replace({"body.mass": 1.2 * heavy.body.mass})
    with pytest.warns(UnsuitedController, match="body.mass"):
        read = read_controller(path, heavy)
    designed = everything(heavy).record["feed_forward"]["by_second"]
    np.testing.assert_array_equal(read.record["feed_forward"]["by_second"], designed)


def test_the_files_friction_with_its_terms_is_compensated_and_not_the_robots(tmp_path):
    terms = {"coulomb_asymmetry": (0.03, -0.02, 0.04), "load": (0.2, 0.1, 0.3)}
    known = replace(FRICTION, stribeck_asymmetry=(-0.02, 0.01, 0.05), **terms)
    write_controller(nominal_controller(alten(known), compensation="full"), tmp_path / "controller.toml")
    assert read_controller(tmp_path / "controller.toml", alten()).robot.friction == known


@cache
def good_file() -> str:
    return controller_text(nominal_controller(alten(FRICTION), compensation="full"))


@cache
def file_of_every_part() -> str:
    return controller_text(everything(alten(FRICTION)))


@pytest.mark.parametrize(
    ("good", "bad", "sentence"),
    [
        ("sample_time = 0.005", "", "sample_time is missing"),
        ("sample_time = 0.005", "sample_time = -0.005", "sample_time is -0.005; it must be above 0"),
        ("sample_time = 0.005", "sample_time = nan", "sample_time is nan"),
        ("sample_time = 0.005", "sample_time = 0.005\ngains = 3", "gains is not a key of a controller file"),
        ('compensation = "full"', 'compensation = "most"', "compensation is 'most'"),
        ("gain = [\n  [", "gain = [\n  [1.0, ", r"gain\[1\] has 11 entries; it must have at most 10"),
        ("gain = [\n", "gain = [\n  [0, 0, 0, 0, 0, 0, 0, 0, 0, 0],\n", "gain has 4 rows; .* has 3 wheels"),
        ("gain = [\n", 'gain = [\n  ["much"],\n', r"gain\[1\]"),
        ("viscous = [0.014", "viscous = [-0.014", r"friction.viscous\[0\] is -0.014"),
        ("rolling = 0.007", "rolling = 0.007\nstatic = 3", "friction.static is not a key"),
        ("robot =", "robot ==", "not valid TOML"),
        (
            "yaw_frequency = 2.5",
            "yaw_frequency = 0.0",
            "planner: yaw_frequency is 0 rad/s; it must be at least 1e-12",
        ),
        ("depth = 0.2", "depth = 2", "The notch: depth is 2; it must be at most 1"),
    ],
)
def test_invalid_controller_file_ends_in_one_sentence(tmp_path, good, bad, sentence):
    text = good_file() if good in good_file() else file_of_every_part()
    assert good in text
    path = tmp_path / "controller.toml"
    path.write_text(text.replace(good, bad, 1))
    with pytest.raises(InputError, match=sentence) as caught:
        read_controller(path, alten())
    text = str(caught.value)
    assert text.startswith(f"{path}")
    assert "\n" not in text


def warnings_of(path: Path, robot: Robot) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read_controller(path, robot)
    return [str(one.message) for one in caught if one.category is UnsuitedController]


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"body.mass": 11.0}, "body.mass was 17.076 and is 11 kg."),
        ({"sensors.sample_time": 0.01}, "sensors.sample_time was 0.005 and is 0.01 s."),
        ({"drive.torque_limit": 4.0}, "drive.torque_limit was 6 and is 4 N m."),
        ({"wheels.azimuths": (0.0, 2.0, 4.0)}, "wheels.azimuths was 0, 2.0944, 4.18879 and is 0, 2, 4 rad."),
    ],
)
def test_file_for_other_values_of_the_robot_names_them(tmp_path, changed, named):
    path, robot = tmp_path / "controller.toml", alten(FRICTION)
    write_controller(precise_controller(robot), path)
    assert warnings_of(path, robot) == []
    (text,) = warnings_of(path, robot.replace(changed))
    assert text.startswith(f"{path}: The controller was designed for other values: {named}")


def test_friction_inertia_s_point_and_rounding_are_no_other_values(tmp_path):
    path, robot = tmp_path / "controller.toml", alten(FRICTION)
    write_controller(nominal_controller(robot), path)
    about_mass = robot.body.inertia_about_center_of_mass().diagonal().tolist()
    body = replace(robot.body, inertia=(*about_mass, 0.0, 0.0, 0.0), inertia_about="center_of_mass")
    assert warnings_of(path, robot.replace(body=body)) == []
    assert warnings_of(path, alten(scaled_friction(FRICTION, 1.5))) == []
    rounded = replace(robot.wheels, tilt=0.7853982)
    assert warnings_of(path, robot.replace(wheels=rounded)) == []


def test_controller_that_cannot_work_with_its_robot_is_named(tmp_path):
    path, robot = tmp_path / "controller.toml", alten()
    write_controller(Controller(robot, -nominal_controller(robot).gain), path)
    (text,) = warnings_of(path, robot)
    assert "does not stabilise the robot 'alten'" in text
    write_controller(Controller(robot, 0.53 * nominal_controller(robot).gain), path)  # stable from 0.47 on
    assert warnings_of(path, robot) == []
    write_controller(Controller(robot, 0.5 * nominal_controller(robot).gain), path)
    (text,) = warnings_of(path, robot)
    assert "has no stability margin" in text
    free = nominal_controller(robot).gain.copy()
    free[:, [4, 9]] = 0.0  # the heading is left free: on the border, and allowed
    write_controller(Controller(robot, free), path)
    assert warnings_of(path, robot) == []
