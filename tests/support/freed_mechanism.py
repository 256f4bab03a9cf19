"""The robot taken apart: a free ball, a free body and its wheels on hinges, with nothing that rolls or meshes.

This is what a physics engine knows how to build. Its 12 + n velocities, all of free bodies in the world frame,
are in this order:

    nu = (ball's centre v_b, ball's rate Omega, velocity v_o of the body's point that belongs at the ball's
          centre, body's rate w, wheels' rates relative to the body)

A wheel's rate is positive where its rim pushes the ball along t_i. Nothing here is taken from `ballbot.mechanics`:
the geometry and the angles are written down again, with SciPy's rotations.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ballbot.arrays import Floats
from ballbot.robot import Robot

#: share of the body's mass that one wheel has, and its inertia across the axle over that about the axle; any
#: other shares must give the same accelerations, since the robot file only knows body and wheels together
WHEEL_MASS_SHARE = 0.02
WHEEL_CROSSWISE = 0.6

X, Y, Z = np.eye(3)


@dataclass(frozen=True, kw_only=True, eq=False)
class Link:
    """A rigid body in its own frame."""

    mass: float  #: [kg]
    center_of_mass: Floats  #: (3,) [m]
    inertia: Floats  #: (3, 3) [kg m^2] about the centre of mass


@dataclass(frozen=True, kw_only=True, eq=False)
class WheelPlace:
    """Where a wheel sits, in the body's frame, whose origin belongs at the ball's centre."""

    contact: Floats  #: n_i (3,), from the ball's centre to the contact
    rolling: Floats  #: t_i (3,), along which the wheel pushes the ball
    axle: Floats  #: t_i x n_i (3,), about which the wheel then turns
    hub: Floats  #: (r_b + r_w) n_i (3,) [m]
    frame: Rotation  #: of the wheel's link in the body's: its z axis is the axle


def wheel_places(robot: Robot) -> list[WheelPlace]:
    """Return each wheel's place (docs/mechanics.md)."""
    places = []
    for azimuth in robot.wheels.azimuths:
        turn = Rotation.from_euler("ZY", [azimuth, robot.wheels.tilt])
        contact, rolling = turn.apply(Z), turn.apply(Y)
        axle, hub = np.cross(rolling, contact), (robot.ball.radius + robot.wheels.radius) * contact
        frame = Rotation.from_matrix(np.column_stack([rolling, contact, axle]))
        places.append(WheelPlace(contact=contact, rolling=rolling, axle=axle, hub=hub, frame=frame))
    return places


def wheel_link(robot: Robot) -> Link:
    """Return one wheel, a body of revolution about its frame's z axis."""
    across = WHEEL_CROSSWISE * robot.wheels.inertia
    return Link(
        mass=WHEEL_MASS_SHARE * robot.body.mass,
        center_of_mass=np.zeros(3),
        inertia=np.diag([across, across, robot.wheels.inertia]),
    )


def body_link(robot: Robot) -> Link:
    """Return the body without its wheels: with them locked, mass and inertia J_0 are the robot's."""
    wheel, places = wheel_link(robot), wheel_places(robot)
    mass = robot.body.mass - len(places) * wheel.mass
    moment = robot.body.mass * robot.body.center_of_mass * Z - wheel.mass * sum(p.hub for p in places)
    inertia = robot.body.inertia_about_ball_center()
    for place in places:
        turned = place.frame.as_matrix() @ wheel.inertia @ place.frame.as_matrix().T
        inertia = inertia - turned - point_inertia(wheel.mass, place.hub)
    center = moment / mass
    return Link(mass=mass, center_of_mass=center, inertia=inertia - point_inertia(mass, center))


def point_inertia(mass: float, place: Floats) -> Floats:
    """Return the inertia (3, 3) of a point mass about the origin."""
    return mass * (place @ place * np.eye(3) - np.outer(place, place))


def reflected_inertia(robot: Robot) -> float:
    """Return j_r = n^2 (j_m + j_g) [kg m^2], which turns with a wheel's rate relative to the body."""
    drive = robot.drive
    return drive.gear_ratio**2 * (drive.motor_inertia + drive.gear_inertia)


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """N configurations of the freed mechanism and its velocities there."""

    ball_center: Floats  #: (N, 3) [m]; the body's origin is there as well
    ball: Rotation  #: N, ball to world
    body: Rotation  #: N, body to world
    wheel_angles: Floats  #: (N, n) [rad]
    velocities: Floats  #: nu (N, 12 + n)

    def __len__(self) -> int:
        return len(self.velocities)


def euler_axes(q: Floats) -> Floats:
    """Return the axes (N, 3, 3), as rows and in the world, that theta, phi and psi turn about: R = Rx Ry Rz."""
    after_theta = Rotation.from_euler("X", q[:, 2:3])
    after_phi = Rotation.from_euler("XY", q[:, 2:4])
    return np.stack([np.tile(X, (len(q), 1)), after_theta.apply(Y), after_phi.apply(Z)], axis=1)


def rolling_motion(robot: Robot, q: Floats, q_dot: Floats, seed: int) -> Motion:
    """Return the motion of a robot whose ball rolls and whose wheels follow it.

    Parameters
    ----------
    robot
    q : ndarray (N, 5)
        x, y, theta, phi, psi.
    q_dot : ndarray (N, 5) or (N, 6)
        Their rates, and the ball's spin about the vertical; a ball without one does not pivot.
    seed
        Of what must not matter: the ball's orientation and the wheels' angles.
    """
    rng = np.random.default_rng(seed)
    body, r_b = Rotation.from_euler("XYZ", q[:, 2:]), robot.ball.radius
    zero = np.zeros(len(q))
    v = np.stack([q_dot[:, 0], q_dot[:, 1], zero], axis=1)
    Omega = np.cross(Z, v) / r_b + q_dot[:, 5:].sum(axis=1, keepdims=True) * Z
    w = np.einsum("ki,kij->kj", q_dot[:, 2:5], euler_axes(q))
    rates = [
        np.einsum("ki,ki->k", np.cross(Omega - w, r_b * body.apply(place.contact)), body.apply(place.rolling))
        / robot.wheels.radius
        for place in wheel_places(robot)
    ]
    return Motion(
        ball_center=np.stack([q[:, 0], q[:, 1], zero + r_b], axis=1),
        ball=Rotation.random(len(q), random_state=rng),
        body=body,
        wheel_angles=rng.uniform(-np.pi, np.pi, (len(q), robot.wheel_count)),
        velocities=np.concatenate([v, Omega, v, w, np.stack(rates, axis=1)], axis=1),
    )
