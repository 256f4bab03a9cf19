"""Robots as MJCF and URDF: MuJoCo finds their masses, they read back, and foreign ones are safe to read."""

import math
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ballbot.cli.main import main
from ballbot.errors import InputError
from ballbot.robot import Robot
from ballbot.robot.components import BY_NAME
from ballbot.robot.parameters import value_of
from ballbot.robot.robot import with_values
from ballbot.twin.model_files import LARGEST_MODEL, read_model, write_model
from ballbot.twin.parts import wheel_frames

ALTEN = Robot.load("alten")
both = pytest.mark.parametrize("suffix", [".xml", ".urdf"])


@both
@pytest.mark.parametrize("name", ["alten", "rezero", "cmu"])
def test_a_robot_comes_back_whole(tmp_path, suffix, name):
    robot, path = Robot.load(name), tmp_path / f"robot{suffix}"
    write_model(robot, path)
    read = read_model(path, like=ALTEN)
    assert read.robot == robot
    assert read.robot.sources == robot.sources
    assert read.robot.standard_deviations == robot.standard_deviations
    assert (read.stated, read.assumed, read.notes) == ((), (), ())


@pytest.mark.parametrize("name", ["robot.xml", "robot.urdf", "twin.xml"])
def test_a_file_has_zeros_for_rounding_errors(tmp_path, name):
    path = tmp_path / name
    words = ("twin", "export", "alten", "--out") if name == "twin.xml" else ("new", "--from", "alten")
    assert main([*words, str(path)]) == 0
    numbers, least = 0, math.inf
    for element in ET.parse(path).iter():
        for name, text in element.items():
            if name in ("pos", "quat", "xyaxes", "fullinertia", "xyz", "rpy", "ixy", "ixz", "iyz"):
                values = [abs(float(word)) for word in text.split()]
                numbers += len(values)
                least = min([least, *(value for value in values if value)])
    assert numbers > 300
    assert least > 1e-6  # lengths [m], sines and inertias [kg m^2] of the robot are not smaller
    assert len(path.read_text().splitlines()) > 200


@pytest.mark.parametrize("name", ["alten", "cmu"])
def test_a_robot_is_recognized_in_its_exported_twin(tmp_path, name):
    """Each wheel of the twin has a second hinge, its gear's play."""
    robot, path = Robot.load(name), tmp_path / "twin.xml"
    assert main(["twin", "export", name, "--out", str(path)]) == 0
    read = read_model(path, like=robot).robot
    assert read.wheel_count == robot.wheel_count
    assert read.body.mass == pytest.approx(robot.body.mass)
    assert read.body.center_of_mass == pytest.approx(robot.body.center_of_mass)
    assert read.wheels.tilt == pytest.approx(robot.wheels.tilt)
    assert read.wheels.azimuths == pytest.approx(robot.wheels.azimuths)
    assert read.ball.radius == pytest.approx(robot.ball.radius)


@both
def test_mujoco_finds_the_robots_masses_and_wheels(tmp_path, suffix):
    path = tmp_path / f"robot{suffix}"
    write_model(ALTEN, path)
    text = path.read_text()
    assert "with one contact" in text
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    body, wheel = ("body", "wheel {}") if suffix == ".xml" else ("base_link", "wheel{}")
    first = model.joint(body).dofadr[0]
    # of a free joint: three translations, then three rotations about the frame's origin, the ball's centre
    inertia = mass[first + 3 : first + 6, first + 3 : first + 6]
    np.testing.assert_allclose(mass[first, first], ALTEN.body.mass, rtol=1e-12)
    np.testing.assert_allclose(
        inertia, ALTEN.body.inertia_about_ball_center(), atol=1e-9
    )  # 4.37: rounding of sums
    assert np.isclose(model.body("ball").mass[0], ALTEN.ball.mass)
    for i, frame in enumerate(wheel_frames(ALTEN), start=1):
        joint = model.joint(wheel.format(i))
        np.testing.assert_allclose(data.xaxis[joint.id], frame[:, 2], atol=1e-12)
        rotor = model.dof_armature[joint.dofadr[0]]
        np.testing.assert_allclose(
            mass[joint.dofadr[0], joint.dofadr[0]] - rotor, ALTEN.wheels.inertia, rtol=1e-9
        )
    ball = model.body("ball").id
    pairs = model.geom_bodyid[data.contact.geom]
    assert (pairs == ball).any(axis=1).all()  # no roller touches another part
    rollers = ALTEN.wheel_count * ALTEN.wheels.rollers.rows * ALTEN.wheels.rollers.per_row
    touching = [k for k in range(model.ngeom) if model.geom_conaffinity[k] and model.geom_bodyid[k]]
    assert len(touching) in (rollers, rollers + 1)  # the ball's own, which in MJCF is only a contype
    reach = ALTEN.ball.radius + ALTEN.wheels.radius
    lowest = [
        np.linalg.norm(data.geom_xpos[k] - data.body("ball").xpos)
        for k in touching
        if model.geom_bodyid[k] != model.body("ball").id
    ]
    assert abs(min(lowest) - (ALTEN.ball.radius + ALTEN.wheels.rollers.radius)) < 1e-4 * reach


@st.composite
def robots(draw):
    scale = st.floats(0.9, 1.1)
    shift = draw(st.floats(0.0, 1.9))
    changes = {
        "wheels.tilt": draw(st.floats(0.5, 0.9)),
        "wheels.azimuths": tuple(shift + 2.0 * math.pi * k / 3.0 for k in range(3)),
        "wheels.radius": ALTEN.wheels.radius * draw(scale),
        "wheels.rollers.rows": draw(st.integers(1, 2)),
        "ball.mass": ALTEN.ball.mass * draw(st.floats(1.0, 1.1)),
        "body.center_of_mass": ALTEN.body.center_of_mass * draw(st.floats(0.9, 1.0)),
        "body.inertia.xy": draw(st.floats(-0.01, 0.01)),
        "friction.viscous": tuple(draw(st.floats(0.01, 1.0)) for _ in range(3)),
        "drive.torque_limit": draw(st.floats(1.0, 10.0)),
    }
    return with_values(ALTEN, changes)


@both
def test_every_number_that_a_model_states_is_recognized(tmp_path, suffix):
    path = tmp_path / f"robot{suffix}"

    @settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(robot=robots())
    def check(robot):
        write_model(robot, path)
        path.write_text(without_robot_file(path.read_text()))
        read = read_model(path, like=ALTEN)
        assert {"ball.radius", "body.inertia.xx", "wheels.rollers.radius", "friction.viscous"} <= set(
            read.stated
        )
        assert ("drive.motor_inertia" in read.stated) == (suffix == ".xml")
        for name in read.stated:
            if name == "friction.coulomb":
                wanted = np.add(robot.friction.coulomb, robot.friction.stribeck)
            elif name in ("drive.motor_inertia", "drive.gear_inertia"):
                continue
            else:
                wanted = value_of(robot, BY_NAME[name])
            found = value_of(read.robot, BY_NAME[name])
            np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-9, err_msg=name)
        drive, other = read.robot.drive, robot.drive
        rotor = drive.motor_inertia + drive.gear_inertia
        np.testing.assert_allclose(rotor, other.motor_inertia + other.gear_inertia, rtol=1e-12)

    check()


def without_robot_file(text: str) -> str:
    root = ET.fromstring(text)
    for name in ("custom", "ballbot"):
        for one in root.findall(name):
            root.remove(one)
    return ET.tostring(root, encoding="unicode")


@both
def test_what_was_changed_in_a_model_is_read_and_the_rest_keeps_its_source(tmp_path, suffix):
    path = tmp_path / f"robot{suffix}"
    write_model(ALTEN, path)
    old = 'mass="3.0"' if suffix == ".xml" else 'mass value="3.0"'
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, old.replace("3.0", "2.9")))
    read = read_model(path, like=Robot.load("cmu"))
    assert read.stated == ("ball.mass",)
    assert read.robot.ball.mass == 2.9
    assert read.robot.sources["ball.mass"] == f"calculated: from the model robot{suffix}"
    assert read.robot.sources["ball.radius"] == ALTEN.sources["ball.radius"]


def foreign(
    *, inertial: str = '<inertial pos="0 0 0.3" mass="4" diaginertia="0.2 0.2 0.1"/>', extra: str = ""
) -> str:
    """Return a model as somebody may write it: degrees, classes, wheels as cylinders and no rollers."""
    wheels = "".join(
        f"""<frame euler="0 0 {120 * k + 30}"><body name="w{k}" pos="0.12 0 0.12" euler="0 45 0">
        <joint name="w{k}" class="wheel"/><geom class="wheel"/></body></frame>"""
        for k in range(3)
    )
    return f"""<mujoco><compiler angle="degree" eulerseq="xyz" meshdir="/etc"/>
    <option gravity="0 0 -9.8"/>
    <default><default class="wheel"><joint type="hinge" axis="1 0 0" damping="0.01" armature="0.002"/>
    <geom type="cylinder" size="0.0497056 0.01" zaxis="1 0 0" mass="0.3"/></default></default>
    <asset><mesh name="hull" file="../../etc/passwd"/></asset>
    <worldbody><geom type="plane" size="1 1 1"/>
    <body name="ball" pos="0 0 0.12"><freejoint/><geom type="sphere" size="0.12" mass="0.6"/></body>
    <body name="base" pos="0 0 0.12"><freejoint/>{inertial}<geom type="mesh" mesh="hull"/>{wheels}{extra}</body>
    </worldbody>
    <actuator><motor joint="w0" ctrlrange="-2 2"/><motor joint="w1" ctrlrange="-2 2"/>
    <motor joint="w2" ctrlrange="-2 2" gear="3"/></actuator></mujoco>"""


def test_a_model_of_others_becomes_a_robot(tmp_path):
    path = tmp_path / "theirs.xml"
    # a solid ball of 0.6 kg has 0.4 m r^2, which is a robot's least
    path.write_text(foreign())
    read = read_model(path, like=ALTEN)
    robot = read.robot
    np.testing.assert_allclose(robot.wheels.azimuths, np.radians([30.0, 150.0, 270.0]), atol=1e-9)
    np.testing.assert_allclose(robot.wheels.tilt, math.pi / 4, atol=1e-9)
    np.testing.assert_allclose(robot.wheels.radius, 0.12 * math.sqrt(2) - 0.12, rtol=1e-9)
    assert (robot.gravity, robot.drive.torque_limit, robot.ball.mass) == (9.8, 2.0, 0.6)
    np.testing.assert_allclose(robot.body.mass, 4.0 + 3 * 0.3)
    np.testing.assert_allclose(robot.body.center_of_mass, (4.0 * 0.3 + 0.9 * 0.12) / 4.9)
    assert robot.friction.viscous == (0.01,) * 3
    assert robot.friction.coulomb == robot.friction.stribeck == (0.0,) * 3
    n = robot.drive.gear_ratio
    np.testing.assert_allclose(n**2 * (robot.drive.motor_inertia + robot.drive.gear_inertia), 0.002)
    assert "sensors.encoder_counts" in read.assumed
    assert robot.sources["sensors.encoder_counts"] == "assumed: as in alten"
    assert read.notes == ()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "is not a model that MuJoCo reads"),
        ("<mujoco><worldbody>", "is not a model that MuJoCo reads: .* Line number=1"),
        ("<html/>", "is not a model that MuJoCo reads: .* 'html'"),
        ("<mujoco/>", "It has no ball"),
        ("<robot name='a'><link name='b'/></robot>", "It has no ball|is not a model that MuJoCo reads"),
        ('<mujoco><include file="b.xml"/></mujoco>', "is not a model that MuJoCo reads"),
        (foreign(inertial=""), "the mass of the body 'base' comes from a mesh"),
        (foreign().replace('size="0.12"', 'size="0.1"'), "has a radius of 49.71 mm by its shape, but 69.71 mm lie"),
        (foreign().replace('axis="1 0 0"', 'axis="0 1 0"'), "It has 0 wheels on the ball, .* w0, w1, w2"),
        (foreign().replace('mass="4"', 'mass="nan"'), "is not a model that MuJoCo reads|a mass, an inertia"),
        (foreign().replace('mass="4"', 'mass="4e9"'), "It has a mass, an inertia or a place of 1e\\+09 or more"),
        (foreign().replace('mass="4"', 'mass="4e30"'), "is not a model that MuJoCo reads: Inertia matrix is too close"),
        (foreign().replace('mass="0.3"', 'mass="-1"'), "is not a model that MuJoCo reads"),
    ],
)  # fmt: skip
def test_a_bad_model_ends_in_a_sentence(tmp_path, text, sentence):
    path = tmp_path / "theirs.xml"
    path.write_text(text)
    with pytest.raises(InputError, match=sentence) as caught:
        read_model(path, like=ALTEN)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_an_oversized_model_is_refused_before_reading(tmp_path):
    path = tmp_path / "theirs.urdf"
    with path.open("wb") as stream:
        stream.truncate(LARGEST_MODEL + 1)
    with pytest.raises(InputError, match="at most 10 MB are read"):
        read_model(path, like=ALTEN)


def test_new_makes_models_and_reads_them(tmp_path, capsys):
    model, robot = tmp_path / "a.urdf", tmp_path / "b.toml"
    assert main(["new", "first", "--out", str(model)]) == 0
    assert "every roller as one contact" in capsys.readouterr().out
    assert main(["new", "second", "--from", str(model), "--like", "cmu", "--out", str(robot)]) == 0
    assert "the robot file in it, with no value changed" in capsys.readouterr().out
    assert Robot.load(str(robot)) == ALTEN.replace(name="second")
    assert main(["check", str(model)]) == 2
    assert f"make it a robot file with: ballbot new NAME --from {model}" in capsys.readouterr().err
    (tmp_path / "c.xml").write_text(foreign())
    assert main(["new", "third", "--from", str(tmp_path / "c.xml"), "--out", str(tmp_path / "c.toml")]) == 0
    printed = capsys.readouterr().out
    assert "Read from" in printed
    assert "Assumed, mostly as in alten: " in printed
    assert Robot.load(str(tmp_path / "c.toml")).sources["drive.gear_ratio"] == "assumed: as in alten"
