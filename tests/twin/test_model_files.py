"""Robots as MJCF and URDF: MuJoCo finds their masses, they read back, and foreign ones are safe to read."""

import math

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
from ballbot.twin.engine import Engine
from ballbot.twin.model_files import read_model, robot_urdf
from ballbot.twin.parts import wheel_frames
from tests.support.twin_examples import block_of, mass_matrix

ALTEN = Robot.load("alten")


@pytest.mark.parametrize("name", ["alten", "cmu"])
def test_a_robot_is_recognized_in_its_exported_twin(tmp_path, name):
    """Each wheel of the twin has a second hinge, its gear's play."""
    robot, path = Robot.load(name), tmp_path / "twin.xml"
    assert main(["twin", "export", name, "--out", str(path)]) == 0
    read = read_model(path, like=robot).robot
    for one in ("body.mass", "body.center_of_mass", "wheels.tilt", "wheels.azimuths", "ball.radius"):
        assert value_of(read, BY_NAME[one]) == pytest.approx(value_of(robot, BY_NAME[one])), one


def test_mujoco_finds_the_masses_and_wheels_in_urdf():
    text = robot_urdf(ALTEN)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    engine = Engine(text)
    block, masses = block_of(engine, "body"), np.diag(mass_matrix(engine))
    np.testing.assert_allclose(block[0, 0], ALTEN.body.mass, rtol=1e-12)
    # 4.37: rounding of sums
    np.testing.assert_allclose(block[3:, 3:], ALTEN.body.inertia_about_ball_center(), atol=1e-9)
    assert np.isclose(model.body("ball").mass[0], ALTEN.ball.mass)
    for i, frame in enumerate(wheel_frames(ALTEN), start=1):
        joint = model.joint(f"wheel_{i}")
        np.testing.assert_allclose(data.xaxis[joint.id], frame[:, 2], atol=1e-12)
        np.testing.assert_allclose(masses[joint.dofadr[0]], ALTEN.wheels.inertia, rtol=1e-9)
    ball = model.body("ball").id
    pairs = model.geom_bodyid[data.contact.geom]
    assert (pairs == ball).any(axis=1).all()  # no roller touches another part
    rollers = ALTEN.wheel_count * ALTEN.wheels.rollers.rows * ALTEN.wheels.rollers.per_row
    touching = [k for k in range(model.ngeom) if model.geom_conaffinity[k] and model.geom_bodyid[k]]
    assert len(touching) == rollers + 1  # and the ball's own
    off = [data.geom_xpos[k] - data.body("ball").xpos for k in touching if model.geom_bodyid[k] != ball]
    nearest = ALTEN.ball.radius + ALTEN.wheels.rollers.radius
    assert np.linalg.norm(off, axis=1).min() == pytest.approx(nearest, abs=2e-5)


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


def test_every_number_that_urdf_states_is_recognized(tmp_path):
    path = tmp_path / "robot.urdf"

    @settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(robot=robots())
    def check(robot):
        path.write_text(robot_urdf(robot))
        read = read_model(path, like=ALTEN)
        few = {"ball.radius", "body.inertia.xx", "wheels.rollers.radius", "friction.viscous"}
        assert few <= set(read.stated)
        together = {
            "friction.coulomb": np.add(robot.friction.coulomb, robot.friction.stribeck),
            "drive.motor_inertia": robot.drive.motor_inertia + robot.drive.gear_inertia,
            "drive.gear_inertia": 0.0,
        }
        for name in read.stated:
            wanted = together[name] if name in together else value_of(robot, BY_NAME[name])
            found = value_of(read.robot, BY_NAME[name])
            # MuJoCo's sums over a hundred parts
            np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-9, err_msg=name)

    check()


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
        ("<mujoco/>", "It has no bodies that could be the ball"),
        ('<mujoco><include file="b.xml"/></mujoco>', "is not a model that MuJoCo reads"),
        (foreign(inertial=""), "The mass of the body 'base' comes from a mesh"),
        (foreign().replace('size="0.12"', 'size="0.1"'), "a radius of 49.71 mm .* but 69.71 mm lie"),
        (foreign().replace('axis="1 0 0"', 'axis="0 1 0"'), "It has 0 wheels on the ball, .* w0, w1, w2"),
        (foreign().replace('mass="4"', 'mass="4e9"'), "body.mass is 4e\\+09 kg"),
    ],
)  # fmt: skip
def test_a_bad_model_ends_in_a_sentence(tmp_path, text, sentence):
    path = tmp_path / "theirs.xml"
    path.write_text(text)
    with pytest.raises(InputError, match=sentence) as caught:
        read_model(path, like=ALTEN)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_robot_goes_to_urdf_and_back_by_commands(tmp_path, capsys):
    model, robot = tmp_path / "a.urdf", tmp_path / "b.toml"
    assert main(["twin", "export", "cmu", "--out", str(model)]) == 0
    assert main(["new", "second", "--from", str(model), "--like", "cmu", "--out", str(robot)]) == 0
    read, cmu = Robot.load(str(robot)), Robot.load("cmu")
    np.testing.assert_allclose(
        read.body.inertia_about_ball_center(), cmu.body.inertia_about_ball_center(), atol=1e-9
    )
    assert read.drive.gear_ratio == cmu.drive.gear_ratio
    assert "Assumed, mostly as in cmu: " in capsys.readouterr().out
    for words, place in (
        (("check", str(model)), f"ballbot new NAME --from {model}"),
        (("new", str(model)), f"ballbot twin export ROBOT --out {model}"),
        (("twin", "export", "cmu", "--scenario", "ideal", "--out", str(model)), "leave out --scenario"),
    ):
        assert main([*words]) == 2
        assert place in capsys.readouterr().err
