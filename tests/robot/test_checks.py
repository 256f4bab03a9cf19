"""Nonsense is refused in one sentence that names the correct value; published robots are not refused."""

import dataclasses
import math
import re

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.robot import Ball, Body, Friction, Robot, Wheels

ALTEN = Robot.load("alten")


def refusal(**parts: object) -> str:
    """Return the one sentence that refuses the robot with other parts."""
    with pytest.raises(InputError) as caught:
        dataclasses.replace(ALTEN, **parts)  # type: ignore[arg-type]
    (sentence,) = str(caught.value).splitlines()
    return sentence


def ball(**changes: float) -> Ball:
    return dataclasses.replace(ALTEN.ball, **changes)


def body(**changes: object) -> Body:
    return dataclasses.replace(ALTEN.body, **changes)  # type: ignore[arg-type]


def wheels(*degrees: float, tilt: float = 45.0) -> Wheels:
    azimuths = tuple(math.radians(one) for one in degrees)
    return dataclasses.replace(ALTEN.wheels, azimuths=azimuths, tilt=math.radians(tilt))


@pytest.mark.parametrize("wrong", [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize("name", ["radius", "mass", "inertia"])
def test_ball_numbers_are_positive_and_finite(name: str, wrong: float) -> None:
    reason = "cannot be negative|must be above zero|must be finite"
    assert re.search(rf"ball\.{name} is .*; it ({reason})", refusal(ball=ball(**{name: wrong})))


def test_non_numeric_values_are_refused() -> None:
    assert re.search("ball.mass is '3'; it must be a number", refusal(ball=ball(mass="3")))  # type: ignore[arg-type]
    assert re.search("ball.mass is True; it must be a number", refusal(ball=ball(mass=True)))
    sensors = dataclasses.replace(ALTEN.sensors, encoder_counts=2000.0)  # type: ignore[arg-type]
    assert re.search("encoder_counts is 2000.0; it must be a whole number", refusal(sensors=sensors))


def test_a_ball_lies_between_solid_and_thin_shell() -> None:
    for fits in (0.0242, 0.0195, 0.4 * 3.0 * 0.11**2):  # thin shell, Appendix I's wall, solid
        assert ALTEN.replace(ball=ball(inertia=fits)).ball.inertia == fits
    assert re.search(r"between 0\.0145 \(solid\) and 0\.0242 kg", refusal(ball=ball(inertia=0.03)))
    assert re.search("solid", refusal(ball=ball(inertia=0.01)))


def test_the_triangle_inequality_is_that_of_the_principal_moments() -> None:
    # rotating a body that can exist leaves it one, though its diagonal alone could look wrong
    turn, _ = np.linalg.qr(np.array([[1.0, 0.3, 0.2], [-0.4, 1.0, 0.5], [0.1, -0.2, 1.0]]))
    for moments, fits in (((1.0, 2.0, 2.9), True), ((1.0, 2.0, 3.1), False)):
        j = turn @ np.diag(moments) @ turn.T
        six = (j[0, 0], j[1, 1], j[2, 2], j[0, 1], j[0, 2], j[1, 2])
        made = body(inertia=six, inertia_about="center_of_mass")
        if fits:
            assert ALTEN.replace(body=made).body == made
        else:
            assert re.search("larger than the sum", refusal(body=made))


def test_inertia_about_the_wrong_point_is_refused_with_the_cause() -> None:
    central = (1.7326, 1.7326, 0.193, 0.0, 0.0, 0.0)
    assert re.search("less m l\\^2 = 2.64 .* about the centre of mass", refusal(body=body(inertia=central)))
    made = body(inertia=central, inertia_about="center_of_mass")
    assert ALTEN.replace(body=made).body == made


@pytest.mark.parametrize(
    ("sentence", "parts"),
    [
        (r"ball\.radius is 11 m, .* did you mean 11 cm \(0\.11 m\)\?", {"ball": ball(radius=11.0)}),
        (r"wheels\.azimuths\[1\] is 120 rad, .* 120 deg", {"wheels": wheels(0.0, math.degrees(120.0), 4.0)}),
        (r"tilt is 45 rad; .* mean 45 deg\?", {"wheels": wheels(0, 120, 240, tilt=math.degrees(45))}),
        (r"wheels\.tilt is 1\.6.* between 0 and 90 deg", {"wheels": wheels(0, 120, 240, tilt=92.0)}),
    ],
)
def test_other_units_are_recognised(sentence: str, parts: dict[str, object]) -> None:
    assert re.search(sentence, refusal(**parts))


def test_motor_constants_reveal_a_wrong_unit() -> None:
    drive = dataclasses.replace(ALTEN.drive, speed_constant=303.0)
    assert re.search(r"is 9\.54; .* near 1; did you mean 303 rpm/V\?", refusal(drive=drive))


@pytest.mark.parametrize("azimuths", [(0.0, 0.0, 120.0), (0.0, 120.0, 360.0), (90.0, 180.0, 180.5)])
def test_two_wheels_at_the_same_azimuth_are_refused(azimuths: tuple[float, ...]) -> None:
    assert re.search("three independent torques", refusal(wheels=wheels(*azimuths)))


def test_wheels_must_be_able_to_turn_the_ball_every_way() -> None:
    assert re.search("three independent torques", refusal(wheels=wheels(0.0, 120.0, 240.0, tilt=0.2)))
    assert re.search("three independent torques", refusal(wheels=wheels(0.0, 120.0, 240.0, tilt=89.8)))


@pytest.mark.parametrize("count", [2, 5])
def test_three_or_four_wheels(count: int) -> None:
    made = wheels(*np.arange(count) * 360.0 / count)
    assert re.search("three or four", refusal(wheels=made, friction=Friction.none(count)))


def test_four_wheels_need_four_frictions() -> None:
    four = wheels(45.0, 135.0, 225.0, 315.0)
    assert re.search("viscous has 3 numbers, but wheels.azimuths lists 4 wheels", refusal(wheels=four))
    assert ALTEN.replace(wheels=four, friction=Friction.none(4)).wheel_count == 4


@pytest.mark.parametrize(
    ("sentence", "changes"),
    [
        (r"friction\.coulomb\[1\] is -0\.1 N m; it cannot be negative", {"coulomb": (0.1, -0.1, 0.1)}),
        (r"friction\.stribeck_speed is 0 rad/s; it must be above zero", {"stribeck_speed": 0.0}),
        (r"friction\.stribeck_exponent is -1; it cannot be negative", {"stribeck_exponent": -1.0}),
        (r"friction\.rolling is 7", {"rolling": 7.0}),
        (r"friction\.viscous is array.* must be a tuple", {"viscous": np.zeros(3)}),
        (r"friction\.viscous\[2\] is None; it must be a number", {"viscous": (0.0, 0.0, None)}),
    ],
)
def test_friction_is_checked(sentence: str, changes: dict[str, object]) -> None:
    assert re.search(sentence, refusal(friction=dataclasses.replace(ALTEN.friction, **changes)))  # type: ignore[arg-type]


def test_sources_are_checked() -> None:
    misspelt, unknown = (
        refusal(sources={"ball.radios": "measured"}),
        refusal(sources={"ball.radius": "measuerd"}),
    )
    assert re.search("sources names 'ball.radios', .* did you mean 'ball.radius'", misspelt)
    assert re.search("ball.radius has the unknown source .* did you mean 'measured'", unknown)
    assert re.search(r"name is '\\n'", refusal(name="\n"))
