"""Robots whose numbers do not go together are found out, and the slip of units that explains it is named."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.robot import Robot
from ballbot.robot.components import BY_NAME
from ballbot.robot.parameters import value_of
from ballbot.robot.plausibility import robot_findings

ALTEN = Robot.load("alten")


@pytest.mark.parametrize("preset", Robot.presets())
def test_presets_have_no_errors(preset: str) -> None:
    found = robot_findings(Robot.load(preset))
    # rob311's published wheel inertia is too large for its mass, as its file says
    severities = [one.severity for one in found if one.severity != "note"]
    assert severities == (["warning"] if preset == "rob311" else [])


def test_friction_without_deviations_is_said_to_count_as_exact() -> None:
    robot = Robot.load("alten").replace(friction=Robot.load("rezero").friction)
    (found,) = robot_findings(robot)
    assert (found.code, found.severity) == ("robot-deviation", "note")
    assert found.text.startswith("No standard deviation of friction.coulomb is stated")
    assert "as exact" in found.text
    stated = {name: value_of(robot, BY_NAME[name]) for name in found.where.columns}
    assert robot_findings(robot.annotated(standard_deviations=stated)) == ()


DEGREE = math.radians(1.0)
WRONG: list[tuple[dict[str, float], str, str]] = [
    ({"body.mass": 0.017076}, "robot-body", "Did you mean body.mass 17.08 kg?"),
    ({"wheels.tilt": 0.785 * DEGREE}, "robot-wheels", "Did you mean wheels.tilt 0.785 rad (44.98 deg)?"),
    ({"drive.gear_ratio": 1e4}, "robot-drive", "drive.gear_ratio 1e+04 (usual: 1 to 200)"),
    ({"body.center_of_mass": 0.000393}, "robot-body", "Did you mean body.center_of_mass 0.393 m?"),
    ({"drive.torque_limit": 0.006}, "robot-balance", "Did you mean drive.torque_limit 6 N m?"),
    ({"drive.motor_inertia": 0.0242}, "robot-drive", "Did you mean drive.motor_inertia 2.42e-06 kg m^2?"),
    ({"wheels.inertia": 0.1}, "robot-wheels", "with all their mass at the rim"),
    ({"wheels.radius": 0.1, "wheels.tilt": 15 * DEGREE}, "robot-wheels", "cut into each other"),
    ({"sensors.sample_time": 1.2e-5}, "robot-sensors", "Did you mean sensors.sample_time 0.012 s?"),
    ({"friction.coulomb": 110.0}, "robot-friction", "Did you mean friction.coulomb [0.11, 0.11, 0.11] N m?"),
    ({"wheels.rollers.row_spacing": 0.4}, "robot-wheels", "Did you mean wheels.rollers.row_spacing 0.004 m?"),
    ({"ball.mass": 0.003, "ball.inertia": 0.003 * 0.0121 * 0.6}, "robot-ball", "density of 0.538 kg/m^3"),
]


@pytest.mark.parametrize(("changes", "code", "says"), WRONG)
def test_wrong_robots_get_an_error_that_names_the_cause(changes, code, says):
    errors = [one for one in robot_findings(ALTEN.replace(changes)) if one.severity == "error"]
    assert any(says in one.text for one in errors if one.code == code), errors


UNUSUAL: list[tuple[dict[str, float], str]] = [
    ({"sensors.gyro_noise": 0.11}, "was it meant in deg/s?"),
    ({"drive.torque_limit": 0.6}, "holds a lean of 1.12 deg"),
    # about the centre of mass, 2.637 less: 0.193, 4.37, 4.37
    ({"body.inertia.xx": 2.83, "body.inertia.yy": 7.007, "body.inertia.zz": 4.37}, "zz are in their order"),
    ({"friction.rolling": 0.7}, "friction.rolling 0.7 (usual: 0 to 0.05)"),
    ({"drive.backlash": 10 * DEGREE}, "10 deg at the wheel"),
]


@pytest.mark.parametrize(("changes", "says"), UNUSUAL)
def test_unusual_robots_get_a_warning(changes: dict[str, float], says: str) -> None:
    findings = robot_findings(ALTEN.replace(changes))
    assert any(says in one.text and one.severity == "warning" for one in findings)


def test_standard_deviation_as_large_as_its_value_gets_a_warning() -> None:
    open_mass = ALTEN.annotated(standard_deviations={"body.mass": 20.0, "friction.viscous": (1.0, 1.0, 1.0)})
    assert ["body.mass" in one.text for one in robot_findings(open_mass)] == [True]


@given(size=st.floats(0.4, 2.5), density=st.floats(0.6, 1.6))
def test_scaled_robot_passes_the_plausibility_checks(size: float, density: float) -> None:
    """Lengths by a factor, masses by its cube and the density's: such a robot can be built."""
    mass, inertia = density * size**3, density * size**5
    factors = {
        **dict.fromkeys(("ball.radius", "body.center_of_mass", "wheels.radius"), size),
        **dict.fromkeys(("wheels.rollers.radius", "wheels.rollers.row_spacing"), size),
        **dict.fromkeys(("ball.mass", "body.mass"), mass),
        **dict.fromkeys(("ball.inertia", "wheels.inertia"), inertia),
        **dict.fromkeys((f"body.inertia.{axis}" for axis in ("xx", "yy", "zz")), inertia),
        "drive.torque_limit": mass * size,  # to hold the same lean
    }
    robot = ALTEN.replace({name: factor * value_of(ALTEN, BY_NAME[name]) for name, factor in factors.items()})
    assert not [one for one in robot_findings(robot) if one.severity == "error"]
