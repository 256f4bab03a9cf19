"""The exact formulation against Newton's and Euler's laws, body by body, and what a robot without drive conserves.

No engine and no Lagrangian: accelerations that `Model` gives are put into the balances of linear and angular
momentum. The wheels' rim forces follow from each wheel's spin; five balances are then left, as many as there are
coordinates, so that they hold only for the right accelerations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from ballbot import Model, Robot
from ballbot.robot import Body
from tests.support.freed_mechanism import (
    Z,
    euler_axes,
    point_inertia,
    reflected_inertia,
    rolling_motion,
    wheel_places,
)
from tests.support.symbolic_oracle import random_robot, random_state

# Sums of some tens of float64 terms, divided by the largest of them: rounding
TOLERANCE = 1e-12

Vectors = NDArray[np.float64]  # (N, 3), world frame


@dataclass(frozen=True, kw_only=True, eq=False)
class Accelerated:
    """A robot at N states with the accelerations of its bodies; vectors (N, 3) in the world frame."""

    robot: Robot
    R: NDArray[np.float64]  #: (N, 3, 3) body to world
    v_dot: Vectors  #: of the ball's centre
    Omega: Vectors  #: of the ball
    Omega_dot: Vectors
    w: Vectors  #: of the body
    w_dot: Vectors
    rates: NDArray[np.float64]  #: (N, n) of the wheels, relative to the body
    rates_dot: NDArray[np.float64]
    torques: NDArray[np.float64]  #: (N, n) of the motors, less viscous friction
    normal_force: NDArray[np.float64]  #: (N,) of the floor, as `Model` says

    @property
    def directions(self) -> list[tuple[Vectors, Vectors, Vectors]]:
        """n_i, t_i and the axle of each wheel."""
        return [
            (self.R @ place.contact, self.R @ place.rolling, self.R @ place.axle)
            for place in wheel_places(self.robot)
        ]


def accelerated(robot: Robot, seed: int, count: int) -> Accelerated:
    """Return a robot at random states, moved by `Model`."""
    rng = np.random.default_rng(seed)
    states = [random_state(rng, robot.wheel_count) for _ in range(count)]
    q, q_dot, u = (np.array(part) for part in zip(*states, strict=True))
    model = Model(robot, "exact")
    q_ddot = model.acceleration(q, q_dot, u)
    motion = rolling_motion(robot, q, q_dot, seed)
    Omega, w = motion.velocities[:, 3:6], motion.velocities[:, 9:12]
    v_dot = np.stack([q_ddot[:, 0], q_ddot[:, 1], np.zeros(count)], axis=1)
    Omega_dot = np.cross(Z, v_dot) / robot.ball.radius
    w_dot = angular_acceleration(q, q_dot, q_ddot)
    R, rates = motion.body.as_matrix(), motion.velocities[:, 12:]
    # rate = (Omega - w) . (n x t) r_b / r_w, and n x t turns with w
    ratio = robot.ball.radius / robot.wheels.radius
    ball_axes = [R @ -place.axle for place in wheel_places(robot)]
    rates_dot = [dot(Omega_dot - w_dot, a) + dot(Omega - w, np.cross(w, a)) for a in ball_axes]
    return Accelerated(
        robot=robot,
        R=R,
        v_dot=v_dot,
        Omega=Omega,
        Omega_dot=Omega_dot,
        w=w,
        w_dot=w_dot,
        rates=rates,
        rates_dot=ratio * np.stack(rates_dot, axis=1),
        torques=u - np.array(robot.friction.viscous) * rates,
        normal_force=model.normal_force(q, q_dot, u),
    )


def angular_acceleration(q: NDArray, q_dot: NDArray, q_ddot: NDArray) -> Vectors:
    """Return w_dot of w = sum rate_i axis_i, each axis turned by the rates before it."""
    axes = euler_axes(q)
    theta, phi, psi = (q_dot[:, 2 + i, None] * axes[:, i] for i in range(3))
    turning = np.cross(theta, phi) + np.cross(theta + phi, psi)
    return np.einsum("ki,kij->kj", q_ddot[:, 2:], axes) + turning


def dot(a: Vectors, b: Vectors) -> NDArray[np.float64]:
    return np.einsum("ki,ki->k", a, b)


def imbalance(*terms: Vectors) -> float:
    """Return the largest sum of the terms of a balance, divided by the largest term of the same state."""
    size = np.max([np.abs(term).max(axis=1) for term in terms], axis=0)
    return float(np.max(np.abs(sum(terms)).max(axis=1) / size))


def rim_forces(s: Accelerated) -> list[Vectors]:
    """Return the force of each wheel on the ball, along t_i, by the balance of the wheel's spin.

    j_w (w . axle + rate)_dot + j_r rate_dot = torque - r_w force; the wheel is round, so no gyroscopic term.
    """
    j_w, r_w = s.robot.wheels.inertia, s.robot.wheels.radius
    forces = []
    for i, (_, t, axle) in enumerate(s.directions):
        spin_dot = dot(s.w_dot, axle) + s.rates_dot[:, i]  # axle is fixed in the body: w . (w x axle) = 0
        force = (s.torques[:, i] - j_w * spin_dot - reflected_inertia(s.robot) * s.rates_dot[:, i]) / r_w
        forces.append(force[:, None] * t)
    return forces


def body_momentum_rate(s: Accelerated) -> tuple[Vectors, Vectors]:
    """Return the rates of the linear momentum of body and wheels and of the angular one about the ball's centre.

    The angular momentum is taken about the point of the world where the centre is, so that m c x v_dot counts.
    """
    body = s.robot.body
    c = body.center_of_mass * s.R[:, :, 2]
    linear = body.mass * (s.v_dot + np.cross(s.w_dot, c) + np.cross(s.w, np.cross(s.w, c)))
    J = s.R @ body.inertia_about_center_of_mass() @ np.swapaxes(s.R, 1, 2)
    spin = np.einsum("kij,kj->ki", J, s.w_dot) + np.cross(s.w, np.einsum("kij,kj->ki", J, s.w))
    for i, (_, _, axle) in enumerate(s.directions):
        relative = s.rates_dot[:, i, None] * axle + s.rates[:, i, None] * np.cross(s.w, axle)
        spin = spin + s.robot.wheels.inertia * relative
    return linear, np.cross(c, linear) + spin


@cache
def robots() -> list[Robot]:
    rng = np.random.default_rng(11)
    return [Robot.load("alten"), *(random_robot(rng, n) for n in (3, 4) for _ in range(5))]


@pytest.mark.parametrize("robot", robots(), ids=lambda robot: f"{robot.wheel_count} wheels")
def test_body_s_angular_momentum_about_the_ball_s_centre(robot: Robot) -> None:
    """Gravity and the rims turn it; the pivot's force and the contacts' normal forces go through the centre."""
    s = accelerated(robot, seed=1, count=200)
    _, angular = body_momentum_rate(s)
    c = robot.body.center_of_mass * s.R[:, :, 2]
    gravity = np.cross(c, -robot.body.mass * robot.gravity * Z)
    rims = [
        np.cross(robot.ball.radius * n, -force)
        for (n, _, _), force in zip(s.directions, rim_forces(s), strict=True)
    ]
    assert imbalance(-angular, gravity, *rims) <= TOLERANCE


@pytest.mark.parametrize("robot", robots(), ids=lambda robot: f"{robot.wheel_count} wheels")
def test_whole_robot_s_angular_momentum_about_the_contact_with_the_floor(robot: Robot) -> None:
    """No force within the robot and no force of the floor has a horizontal moment there: only gravity has."""
    s = accelerated(robot, seed=2, count=200)
    linear, angular = body_momentum_rate(s)
    up = robot.ball.radius * Z
    ball = np.cross(up, robot.ball.mass * s.v_dot) + robot.ball.inertia * s.Omega_dot
    gravity = np.cross(robot.body.center_of_mass * s.R[:, :, 2], -robot.body.mass * robot.gravity * Z)
    balance = (-angular, -np.cross(up, linear), -ball, gravity)
    assert imbalance(*(term[:, :2] for term in balance)) <= TOLERANCE


@pytest.mark.parametrize("robot", robots(), ids=lambda robot: f"{robot.wheel_count} wheels")
def test_linear_momentum_and_the_ball_s_spin_agree_on_the_floor_s_force(robot: Robot) -> None:
    """The floor's force is what moves all masses, is what spins the ball against the rims, and is `normal_force`."""
    s = accelerated(robot, seed=3, count=200)
    linear, _ = body_momentum_rate(s)
    weight = (robot.ball.mass + robot.body.mass) * robot.gravity * Z
    floor = linear + robot.ball.mass * s.v_dot + weight
    moment = np.cross(-robot.ball.radius * Z, floor)
    rims = [
        np.cross(robot.ball.radius * n, force)
        for (n, _, _), force in zip(s.directions, rim_forces(s), strict=True)
    ]
    assert (
        imbalance(*(term[:, :2] for term in (moment, *rims, -robot.ball.inertia * s.Omega_dot))) <= TOLERANCE
    )
    assert_allclose(s.normal_force, floor[:, 2], rtol=0, atol=TOLERANCE * np.abs(floor).max())


# --- conserved momenta ----------------------------------------------------------------------------


def freewheeling(body: Body | None = None) -> Robot:
    """Return the robot whose wheels and rotors weigh nothing: without torque they do not touch the ball."""
    alten = Robot.load("alten")
    return alten.replace(
        body=body or alten.body,
        wheels=replace(alten.wheels, inertia=0.0),
        drive=replace(alten.drive, motor_inertia=0.0, gear_inertia=0.0),
    )


def conserved_momenta(robot: Robot, state: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return p_x, p_y and L_z of ball and body; the rolling ball counts m_b + j_b / r_b^2 to the floor's plane.

    The floor's horizontal force is the ball's spin's: F = -j_b / r_b^2 v_dot, which makes a heavier ball of it.
    """
    q, q_dot = state[None, :5], state[None, 5:]
    motion = rolling_motion(robot, q, q_dot, 0)
    v, w, R = motion.velocities[0, :3], motion.velocities[0, 9:12], motion.body.as_matrix()[0]
    rolling = (robot.ball.mass + robot.ball.inertia / robot.ball.radius**2) * v
    c = robot.body.center_of_mass * R[:, 2]
    body = robot.body.mass * (v + np.cross(w, c))
    place = motion.ball_center[0]
    spin = R @ robot.body.inertia_about_center_of_mass() @ R.T @ w
    L = np.cross(place, rolling) + np.cross(place + c, body) + spin
    return np.array([*(rolling + body)[:2], L[2]])


def lopsided() -> Body:
    """Return a body with products of inertia, about its centre of mass, made of unequal point masses."""
    masses, places = (
        [4.0, 3.0, 6.0, 5.0],
        np.array([[0.2, 0.1, 0.3], [-0.1, 0.3, -0.2], [0.1, -0.2, 0.2], [-0.3, 0, 0]]),
    )
    mean = np.average(places, axis=0, weights=masses)
    J = sum(point_inertia(m, p - mean) for m, p in zip(masses, places, strict=True))
    return Body(
        mass=sum(masses),
        center_of_mass=0.4,
        inertia=(J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]),
        inertia_about="center_of_mass",
    )


@pytest.mark.parametrize("body", [None, lopsided()], ids=["alten", "lopsided"])
def test_freewheeling_robot_conserves_its_horizontal_momenta(body: Body | None) -> None:
    """Without wheels to drive it, a robot is free in the plane: p_x, p_y and L_z stay through a fall."""
    robot = freewheeling(body)
    model = Model(robot, step=5e-4)
    state = np.array([0.3, -0.2, 0.1, -0.15, 0.4, 0.5, -0.3, 0.2, 0.4, 2.0])
    start = conserved_momenta(robot, state)
    while np.abs(state[2:4]).max() < 1.0:
        state = model.advance(state, np.zeros(3), 0.01)
    # RK4 at 0.5 ms over some 0.4 s of a fall; the momenta are of order ten
    assert_allclose(conserved_momenta(robot, state), start, atol=1e-8)
