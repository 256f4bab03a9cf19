"""The freed mechanism as a Drake MultibodyPlant: two floating bodies, revolute joints and geared rotors."""

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, RotationalInertia, SpatialInertia

from ballbot.arrays import Floats
from ballbot.robot import Robot
from tests.support.constraint_elimination import Freed
from tests.support.freed_mechanism import Link, Motion, body_link, wheel_link, wheel_places


def freed(robot: Robot, motion: Motion) -> Freed:
    """Return Drake's M and bias, its velocities put into the order of `freed_mechanism`."""
    plant = _plant(robot)
    context = plant.CreateDefaultContext()
    count, size = len(motion), 12 + robot.wheel_count
    order = _velocity_order(plant, robot)
    positions = _positions(plant, motion)
    velocities = np.zeros((count, size))
    velocities[:, order] = motion.velocities
    M, bias = np.zeros((count, size, size)), np.zeros((count, size))
    for k in range(count):
        plant.SetPositions(context, positions[k])
        plant.SetVelocities(context, velocities[k])
        M[k] = plant.CalcMassMatrix(context)
        bias[k] = plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context)
    return Freed(mass_matrix=M[:, order[:, None], order], bias=bias[:, order])


def _plant(robot: Robot) -> MultibodyPlant:
    plant = MultibodyPlant(time_step=0.0)
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -robot.gravity])
    ball = Link(mass=robot.ball.mass, center_of_mass=np.zeros(3), inertia=robot.ball.inertia * np.eye(3))
    plant.AddRigidBody("ball", _spatial_inertia(ball))
    body = plant.AddRigidBody("body", _spatial_inertia(body_link(robot)))
    for i, place in enumerate(wheel_places(robot)):
        wheel = plant.AddRigidBody(f"wheel {i}", _spatial_inertia(wheel_link(robot)))
        pose = RigidTransform(RotationMatrix(place.frame.as_matrix()), place.hub)
        hub = plant.AddFrame(FixedOffsetFrame(f"hub {i}", body.body_frame(), pose))
        joint = plant.AddJoint(RevoluteJoint(f"axle {i}", hub, wheel.body_frame(), [0.0, 0.0, 1.0]))
        motor = plant.AddJointActuator(f"motor {i}", joint)
        motor.set_default_gear_ratio(robot.drive.gear_ratio)
        motor.set_default_rotor_inertia(robot.drive.motor_inertia + robot.drive.gear_inertia)
    plant.Finalize()
    return plant


def _spatial_inertia(link: Link) -> SpatialInertia:
    J = link.inertia
    central = RotationalInertia(J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])
    return SpatialInertia.MakeFromCentralInertia(link.mass, link.center_of_mass, central)


def _velocity_order(plant: MultibodyPlant, robot: Robot) -> NDArray[np.intp]:
    """Return where each velocity of `freed_mechanism` lies in Drake's; a floating body's angular ones come first."""
    places: list[int] = []
    for name in ("ball", "body"):
        first = plant.GetBodyByName(name).floating_velocities_start_in_v()
        places += [first + 3, first + 4, first + 5, first, first + 1, first + 2]
    places += [plant.GetJointByName(f"axle {i}").velocity_start() for i in range(robot.wheel_count)]
    return np.array(places)


def _positions(plant: MultibodyPlant, motion: Motion) -> Floats:
    """Return Drake's coordinates (N, 14 + n); a floating body's are quaternion wxyz, then place."""
    positions = np.zeros((len(motion), plant.num_positions()))
    for name, rotation in (("ball", motion.ball), ("body", motion.body)):
        first = plant.GetBodyByName(name).floating_positions_start()
        positions[:, first : first + 4] = rotation.as_quat(scalar_first=True)
        positions[:, first + 4 : first + 7] = motion.ball_center
    for i, angles in enumerate(motion.wheel_angles.T):
        positions[:, plant.GetJointByName(f"axle {i}").position_start()] = angles
    return positions
