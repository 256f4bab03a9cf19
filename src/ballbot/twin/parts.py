"""How a robot's mass splits into the rigid parts of the twin: body, wheel hubs, rollers.

The robot file gives the body with its locked wheels as one (m_r, l, J_0) and a wheel only by its radius and
its inertia about the axle j_w. The twin's parts are chosen so that, with all joints locked, mass, centre of
mass and J_0 are again the robot's, and each wheel has j_w about its axle. Two values that the file does not give are
set here: a wheel has the mass of a uniform disc of its radius and inertia, and its rollers have two fifths of j_w. A
wheel that touches in a single point has one roller there, almost without mass, and j_w in its hub.

Some published bodies are too light for such wheels, or have an inertia without them (`rob311`). Their wheels have a
half, a quarter ... of the disc's mass, with the same j_w, until the rest is a physical body.
"""

from dataclasses import dataclass, replace

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.robot import Robot, Rollers
from ballbot.robot.wheel_directions import axles, contact_directions, rolling_directions

_ROLLER_FRACTION = 0.4  # of the wheel's inertia; rubber rollers on an aluminium hub
_POINT_FRACTION = 1e-3  # sideways its spin then weighs some 0.1 g
_MOST_HALVINGS = 6  # of the disc's mass


@dataclass(frozen=True, kw_only=True)
class WheelParts:
    """One wheel: a hub and its rollers, all rollers alike."""

    hub_mass: float  #: [kg]
    hub_inertia: tuple[float, float, float]  #: about its centre; x, y across, z along the axle [kg m^2]
    roller_mass: float  #: of one roller [kg]
    roller_inertia: tuple[float, float, float]  #: about its centre; y along its own axis [kg m^2]
    roller_half_length: float  #: half axis of the ellipsoid along the roller's axis [m]
    roller_centers: Floats  #: (rows * per_row, 3) wheel frame [m]
    roller_angles: Floats  #: (rows * per_row,) azimuth about the axle [rad]
    center_distance: float  #: from the ball's centre to the wheel's [m]

    def inertia(self) -> Floats:
        """Return the inertia (3, 3) [kg m^2] of the whole locked wheel about its centre, wheel frame."""
        total = np.diag(self.hub_inertia)
        for center, angle in zip(self.roller_centers, self.roller_angles, strict=True):
            c, s = np.cos(angle), np.sin(angle)
            turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            total = total + turn @ np.diag(self.roller_inertia) @ turn.T
            total = total + self.roller_mass * point_inertia(center)
        return total

    def first_moment(self) -> Floats:
        """Return mass times centre of mass (3,) [kg m], wheel frame; zero but for a single roller."""
        return self.roller_mass * self.roller_centers.sum(axis=0)

    @property
    def mass(self) -> float:
        """Mass of the whole wheel [kg]."""
        return self.hub_mass + len(self.roller_angles) * self.roller_mass


@dataclass(frozen=True, kw_only=True)
class BodyParts:
    """The body without its wheels."""

    mass: float  #: [kg]
    center_of_mass: Floats  #: (3,) from the ball's centre, body frame [m]
    inertia: Floats  #: (3, 3) about its centre of mass, body frame [kg m^2]


def wheel_frames(robot: Robot) -> Floats:
    """Return R_body_wheel (n, 3, 3): columns are the wheel frames' axes in the body frame.

    x points from the wheel to the contact (-n_i), y along the rolling direction t_i, z along the hinge. The
    hinge axis is -a_i: if a wheel turns by +1 about it, the ball turns about +a_i, as gears do.
    """
    azimuths, tilt = robot.wheels.azimuths, robot.wheels.tilt
    n = contact_directions(azimuths, tilt)
    return np.stack((-n, rolling_directions(azimuths), -axles(azimuths, tilt)), axis=-1)


def split_robot(robot: Robot, rollers: Rollers, *, point: bool) -> tuple[WheelParts, BodyParts]:
    """Split the body into one wheel (`point` as for `wheel_parts`), all being alike, and the body without wheels.

    InputError if the rest is not physical, however light the wheels.
    """
    refusals = []
    for halvings in range(_MOST_HALVINGS + 1):
        wheel = wheel_parts(robot, rollers, point=point, mass_fraction=0.5**halvings)
        try:
            return wheel, body_parts(robot, wheel)
        except InputError as error:
            refusals.append(error)
    raise refusals[0]


def wheel_parts(robot: Robot, rollers: Rollers, *, point: bool, mass_fraction: float = 1.0) -> WheelParts:
    """Split a wheel of a fraction of a disc's mass into hub and rollers.

    With `point` it has a single roller, a sphere, at its contact with the ball.

    The rollers are ellipsoids of half length sqrt(r_w r_roller): their middle then curves like the wheel's
    rim. A row lies `offset` off the wheel's middle plane, so it meets the ball below its own highest point,
    and the wheel's centre moves in by as much. The second row is turned by half a pitch.
    """
    if point:
        rollers = replace(rollers, rows=1, per_row=1)
    radius, inertia = robot.wheels.radius, robot.wheels.inertia
    ring = radius - rollers.radius
    half_length = float(np.sqrt(radius * rollers.radius))
    count = rollers.rows * rollers.per_row
    across = (rollers.radius**2 + half_length**2) / 5  # inertia over mass, ellipsoid
    along = 2 * rollers.radius**2 / 5
    in_rollers = mass_fraction * (_POINT_FRACTION if point else _ROLLER_FRACTION)
    roller_mass = in_rollers * inertia / (count * (ring**2 + across))
    hub_mass = mass_fraction * 2 * inertia / radius**2 - count * roller_mass
    hub_axial = (1 - in_rollers) * inertia

    offset = (rollers.rows - 1) * rollers.row_spacing / 2
    pitch = 2 * np.pi / rollers.per_row
    turns = [np.arange(rollers.per_row, dtype=np.float64) + row / 2 for row in range(rollers.rows)]
    angles: Floats = pitch * np.concatenate(turns)
    heights = np.repeat(np.linspace(-offset, offset, rollers.rows), rollers.per_row)
    return WheelParts(
        hub_mass=hub_mass,
        hub_inertia=(hub_axial / 2, hub_axial / 2, hub_axial),
        roller_mass=roller_mass,
        roller_inertia=(roller_mass * across, roller_mass * along, roller_mass * across),
        roller_half_length=rollers.radius if point else half_length,
        roller_centers=np.column_stack((ring * np.cos(angles), ring * np.sin(angles), heights)),
        roller_angles=angles,
        center_distance=float(np.sqrt((robot.ball.radius + rollers.radius) ** 2 - offset**2)) + ring,
    )


def check_rollers(rollers: Rollers, robot: Robot) -> None:
    """Raise InputError if such rollers cannot be on the robot's wheels or do not touch the ball."""
    if rollers.rows not in (1, 2):
        raise InputError(f"The twin's wheels must have one or two rows of rollers, not {rollers.rows}.")
    widest = 2.0 * (robot.ball.radius + rollers.radius)
    if (rollers.rows - 1) * rollers.row_spacing >= widest:
        raise InputError(
            f"Rows of rollers {rollers.row_spacing:g} m apart do not "
            f"touch the ball; row_spacing must be below {widest:.3g} m."
        )
    if rollers.radius >= robot.wheels.radius:
        raise InputError(
            f"The radius of the rollers is {rollers.radius} m; it must be below the wheel's {robot.wheels.radius} m."
        )


def body_parts(robot: Robot, wheel: WheelParts) -> BodyParts:
    """Return the robot's body without the wheels; InputError if the rest is not physical: the wheels are too heavy."""
    frames = wheel_frames(robot)
    centers = -wheel.center_distance * frames[:, :, 0]
    mass = robot.body.mass - robot.wheel_count * wheel.mass
    if mass <= 0:
        raise InputError(
            f"The wheels of {robot.name!r} would have a mass of {robot.wheel_count * wheel.mass:.2f} kg by "
            f"their inertia and radius, more than the whole body's {robot.body.mass} kg; check wheels.inertia."
        )
    first_moment = robot.body.mass * np.array([0.0, 0.0, robot.body.center_of_mass])
    moments = frames @ wheel.first_moment()
    center_of_mass = (first_moment - wheel.mass * centers.sum(axis=0) - moments.sum(axis=0)) / mass
    inertia = robot.body.inertia_about_ball_center()
    for frame, center, moment in zip(frames, centers, moments, strict=True):
        inertia = inertia - frame @ wheel.inertia() @ frame.T - wheel.mass * point_inertia(center)
        inertia = inertia - 2 * np.dot(center, moment) * np.eye(3)
        inertia = inertia + np.outer(center, moment) + np.outer(moment, center)
    inertia = inertia - mass * point_inertia(center_of_mass)
    low, middle, high = np.linalg.eigvalsh(inertia)
    if low <= 0 or low + middle < high:
        raise InputError(
            f"The body of {robot.name!r} without its wheels would have the principal inertias {low:.4g}, "
            f"{middle:.4g}, {high:.4g} kg m^2, which no body has; check body.inertia and wheels.inertia."
        )
    return BodyParts(mass=mass, center_of_mass=center_of_mass, inertia=inertia)


def point_inertia(position: Floats) -> Floats:
    """Return the inertia (3, 3) about the origin of 1 kg at a position (3,)."""
    return np.dot(position, position) * np.eye(3) - np.outer(position, position)
