"""Derived quantities against published numbers and against sums over small pieces."""

import math

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.robot import Robot
from ballbot.robot.derived import (
    derived_quantities,
    encoder_step,
    inertia_from_swing,
    reflected_rotor_inertia,
    shell_wall,
    solid_sphere_inertia,
    thick_shell_inertia,
    thin_shell_inertia,
    wheel_speed_limit,
)


def test_shell_wall_is_that_of_appendix_i() -> None:
    # printed: 3 kg, 22 cm across, 1 g/cm^3 give 2.5 cm
    assert shell_wall(mass=3.0, radius=0.11, density=1000.0) == pytest.approx(0.025, abs=0.0005)


def test_ball_inertia_is_that_of_appendix_iii_and_of_the_wall() -> None:
    assert thin_shell_inertia(mass=3.0, radius=0.11) == pytest.approx(0.0242, rel=1e-12)
    wall = shell_wall(mass=3.0, radius=0.11, density=1000.0)
    assert thick_shell_inertia(mass=3.0, radius=0.11, wall=wall) == pytest.approx(0.0195, abs=5e-5)


@pytest.mark.parametrize("wall", [0.11, 0.025, 1e-3, 1e-9])
def test_thick_shell_is_a_sum_of_thin_ones(wall: float) -> None:
    # Gauss-Legendre with 5 points integrates r^2 and r^4 exactly, to rounding
    nodes, weights = np.polynomial.legendre.leggauss(5)
    r = 0.11 - wall + 0.5 * wall * (nodes + 1.0)
    summed = 3.0 * np.sum(weights * r**2 * (2.0 / 3.0) * r**2) / np.sum(weights * r**2)
    assert thick_shell_inertia(mass=3.0, radius=0.11, wall=wall) == pytest.approx(summed, rel=1e-13)


def test_a_shell_without_cavity_is_a_solid_sphere() -> None:
    density = 3.0 / (4.0 / 3.0 * math.pi * 0.11**3)
    # the cavity's radius is the cube root of a difference that cancels: 1e-16 of r^3 leaves 1e-5 of r
    assert shell_wall(mass=3.0, radius=0.11, density=density * (1 + 1e-15)) == pytest.approx(0.11, rel=1e-4)
    solid = solid_sphere_inertia(mass=3.0, radius=0.11)
    assert thick_shell_inertia(mass=3.0, radius=0.11, wall=0.11) == pytest.approx(solid, rel=1e-15)


def test_impossible_shells_are_refused() -> None:
    with pytest.raises(
        InputError, match=r"has a mass of at most 0\.00558 kg, not 3 kg; check the unit of the density"
    ):
        shell_wall(mass=3.0, radius=0.11, density=1.0)
    with pytest.raises(InputError, match="does not fit"):
        thick_shell_inertia(mass=3.0, radius=0.11, wall=0.12)


def test_swing_of_a_rod_gives_its_inertia() -> None:
    # a uniform rod of length L about its end: m L^2 / 3, swinging at sqrt(3 g / (2 L))
    omega = math.sqrt(3.0 * 9.81 / (2.0 * 0.8))
    found = inertia_from_swing(mass=2.0, gravity=9.81, distance=0.4, angular_frequency=omega)
    assert found == pytest.approx(2.0 * 0.8**2 / 3.0, rel=1e-14)


def test_wheel_speed_limit_is_that_of_appendix_i() -> None:
    drive = Robot.load("alten").drive
    limit = wheel_speed_limit(
        supply_voltage=drive.supply_voltage,
        speed_constant=drive.speed_constant,
        gear_ratio=drive.gear_ratio,
    )
    assert limit * drive.gear_ratio == pytest.approx(761.5, abs=0.05)
    assert limit == pytest.approx(27.59, abs=0.005)


def test_reflected_inertia_is_twice_the_wheels() -> None:
    # n^2 (j_m + j_g), about twice j_w
    reflected = reflected_rotor_inertia(gear_ratio=27.6, motor_inertia=2.42e-6, gear_inertia=1.6e-7)
    assert reflected == pytest.approx(1.97e-3, abs=0.005e-3)
    # Kugle prints its rotor's share: (13/3)^2 (1.21e-4 + 1.2e-6), of .00319464 with a wheel of .0009
    kugle = reflected_rotor_inertia(gear_ratio=13.0 / 3.0, motor_inertia=1.21e-4, gear_inertia=1.2e-6)
    assert 0.0009 + kugle == pytest.approx(0.00319464, abs=5e-9)


def test_an_encoder_turn_is_a_wheel_turn_over_the_gear() -> None:
    assert 2000 * 27.6 * encoder_step(encoder_counts=2000, gear_ratio=27.6) == pytest.approx(2.0 * math.pi)


def test_derived_quantities_of_alten() -> None:
    found = {one.name: one.value for one in derived_quantities(Robot.load("alten"))}
    assert found["total_mass"] == pytest.approx(20.076)
    assert found["body_inertia_central_xx"] == pytest.approx(4.37 - 2.637, abs=5e-4)
    # the swing that Appendix III measured: its inertia must come out of it again
    swing = found["swing_frequency"]
    back = inertia_from_swing(mass=17.076, gravity=9.81, distance=0.393, angular_frequency=swing)
    assert back == pytest.approx(4.37, rel=1e-12)
    assert found["break_away_torque"] == 0.0
    assert found["rolling_resistance"] == 0.0
