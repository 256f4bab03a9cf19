"""Robots and states at random, to hold equations of motion against each other."""

from dataclasses import replace

import numpy as np

from ballbot.arrays import Floats
from ballbot.robot import Ball, Body, Friction, Robot, Wheels


def random_robot(rng: np.random.Generator, wheel_count: int) -> Robot:
    """Return a robot of that many wheels, its mechanical numbers drawn, with viscous friction alone."""
    alten = Robot.load("alten")
    spread = 2 * np.pi * np.arange(wheel_count) / wheel_count
    azimuths = rng.uniform(-np.pi, np.pi) + spread + rng.uniform(-0.3, 0.3, wheel_count)
    wheels = Wheels(
        radius=rng.uniform(0.03, 0.1),
        inertia=rng.uniform(2e-4, 3e-3),
        tilt=rng.uniform(0.4, 1.2),
        azimuths=tuple(float(beta) for beta in np.remainder(azimuths, 2 * np.pi)),
        rollers=alten.wheels.rollers,
    )
    friction = Friction(
        viscous=tuple(float(b) for b in rng.uniform(0.0, 0.05, wheel_count)),
        coulomb=(0.0,) * wheel_count,
        stribeck=(0.0,) * wheel_count,
        stribeck_speed=1.0,
        stribeck_exponent=1.0,
        rolling=0.0,
    )
    drive = replace(alten.drive, gear_ratio=rng.uniform(5, 60))
    return alten.replace(
        drive=drive,
        gravity=rng.uniform(1.6, 10),
        ball=random_ball(rng),
        body=random_body(rng),
        wheels=wheels,
        friction=friction,
    )


def random_ball(rng: np.random.Generator) -> Ball:
    """Return a ball between a solid and a thin shell."""
    radius, mass = rng.uniform(0.08, 0.2), rng.uniform(1, 8)
    return Ball(radius=radius, mass=mass, inertia=rng.uniform(0.4, 0.66) * mass * radius**2)


def random_body(rng: np.random.Generator) -> Body:
    """Return a body with a full inertia matrix, that of `random_cloud`, so that it can exist."""
    return cloud_body(random_cloud(rng), mass=rng.uniform(8, 25), center_of_mass=rng.uniform(0.2, 0.6))


def random_cloud(rng: np.random.Generator) -> Floats:
    """Return 40 points (40, 3) [m] about their mean, spread unevenly along the axes."""
    points = rng.normal(scale=[0.15, 0.2, 0.3], size=(40, 3))
    return points - points.mean(axis=0)


def cloud_body(points: Floats, *, mass: float, center_of_mass: float) -> Body:
    """Return the body whose mass is shared evenly by points (k, 3) about its centre of mass."""
    J = mass * np.mean([p @ p * np.eye(3) - np.outer(p, p) for p in points], axis=0)
    return Body(
        mass=mass,
        center_of_mass=center_of_mass,
        inertia=(J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]),
        inertia_about="center_of_mass",
    )


def random_state(rng: np.random.Generator, wheel_count: int) -> tuple[Floats, Floats, Floats]:
    """Return q (5,), q_dot (5,) and u (n,): lean to 1.2 rad, any heading, speeds to 3, torques to 6 N m."""
    q = rng.uniform([-3, -3, -1.2, -1.2, -np.pi], [3, 3, 1.2, 1.2, np.pi])
    q_dot = rng.uniform(-3, 3, 5)
    return q, q_dot, rng.uniform(-6, 6, wheel_count)
