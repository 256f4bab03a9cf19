"""The freed mechanism in MuJoCo: two free bodies, hinges and armatures; no geometry, so no contact."""

import mujoco
import numpy as np

from ballbot.robot import Robot
from tests.support.constraint_elimination import Freed
from tests.support.freed_mechanism import Link, Motion, body_link, reflected_inertia, wheel_link, wheel_places


def freed(robot: Robot, motion: Motion) -> Freed:
    """Return MuJoCo's M and bias, from its coordinates into those of `freed_mechanism`.

    A free joint's velocities are the origin's in the world and the angular one in the body's own frame.
    """
    model, count, n = _model(robot), len(motion), robot.wheel_count
    data = mujoco.MjData(model)
    to_engine = np.tile(np.eye(12 + n), (count, 1, 1))
    to_engine[:, 3:6, 3:6] = motion.ball.inv().as_matrix()
    to_engine[:, 9:12, 9:12] = motion.body.inv().as_matrix()
    ball, body = (rotation.as_quat(scalar_first=True) for rotation in (motion.ball, motion.body))
    positions = np.hstack([motion.ball_center, ball, motion.ball_center, body, motion.wheel_angles])
    velocities = np.einsum("kij,kj->ki", to_engine, motion.velocities)
    M, bias = np.zeros((count, 12 + n, 12 + n)), np.zeros((count, 12 + n))
    for k in range(count):
        data.qpos[:], data.qvel[:] = positions[k], velocities[k]
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, M[k])
        bias[k] = data.qfrc_bias
    transposed = np.swapaxes(to_engine, 1, 2)
    return Freed(mass_matrix=transposed @ M @ to_engine, bias=np.einsum("kij,kj->ki", transposed, bias))


def _model(robot: Robot) -> mujoco.MjModel:
    """Return the mechanism; its joints in the order ball, body, wheels."""
    spec = mujoco.MjSpec()
    spec.option.gravity = [0.0, 0.0, -robot.gravity]
    own = Link(mass=robot.ball.mass, center_of_mass=np.zeros(3), inertia=robot.ball.inertia * np.eye(3))
    ball, body = (spec.worldbody.add_body(name=name) for name in ("ball", "body"))
    for free, link in ((ball, own), (body, body_link(robot))):
        free.add_freejoint()
        _set_inertia(free, link)
    for i, place in enumerate(wheel_places(robot)):
        wheel = body.add_body(name=f"wheel {i}", pos=place.hub, quat=place.frame.as_quat(scalar_first=True))
        armature = reflected_inertia(robot)
        wheel.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0], armature=armature)
        _set_inertia(wheel, wheel_link(robot))
    return spec.compile()


def _set_inertia(body: mujoco.MjsBody, link: Link) -> None:
    J = link.inertia
    body.mass, body.ipos = link.mass, link.center_of_mass
    body.fullinertia = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]
    body.explicitinertial = True
