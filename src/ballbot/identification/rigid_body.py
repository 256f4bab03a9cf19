"""A robot's rigid body as parameters that keep it physical whatever their values, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbot.robot import Body, Drive, Friction, Robot
from ballbot.robot.derived import reflected_rotor_inertia

#: quantities of which the rigid body is made; what changes one of them makes another robot
RIGID = ("center_of_mass", "second_moment", "ball_inertia", "wheel_inertia", "rotor_inertia")


#: the least second moment as a share of their sum, so that their ratios mean something
_THINNEST = 1e-3


def second_moments(robot: Robot) -> Sequence[float]:
    """Return S_x, S_y, S_z [kg m^2], the integrals of x^2, y^2 and z^2 dm about the body's centre of mass.

    From J = (trace S) I - S, so that S = (trace J) / 2 I - J. A body that is flat counts as a little thick.
    """
    S = np.diag(_second_moment_matrix(robot))
    return np.maximum(S, _THINNEST * S.sum()).tolist()


def rotor_inertia(robot: Robot) -> Sequence[float]:
    """Return the inertia [kg m^2] of rotor and gear as felt at the wheel."""
    drive = robot.drive
    return (
        reflected_rotor_inertia(
            gear_ratio=drive.gear_ratio, motor_inertia=drive.motor_inertia, gear_inertia=drive.gear_inertia
        ),
    )


def with_rigid_body(robot: Robot, found: Mapping[str, NDArray[np.float64]]) -> Robot:
    """Return the robot with these quantities of `RIGID` in place of its own.

    Products of inertia keep their size in proportion: S_xy is scaled by sqrt(S_x S_y) new over old, which leaves a
    positive definite S positive definite. Of rotor and gear, both are scaled by one factor; where both are zero,
    the rotor has it all.
    """
    ball, wheels = robot.ball, robot.wheels
    if "ball_inertia" in found:
        ball = replace(ball, inertia=float(found["ball_inertia"][0]))
    if "wheel_inertia" in found:
        wheels = replace(wheels, inertia=float(found["wheel_inertia"][0]))
    return robot.replace(ball=ball, body=_body(robot, found), wheels=wheels, drive=_drive(robot, found))


def with_friction(robot: Robot, values: NDArray[np.float64]) -> Robot:
    """Return the robot with the friction [b_1 .., c_1 .., s_1 .., v_s, delta, C_rr] (3 n + 3,)."""
    n = robot.wheel_count
    b, c, s = (tuple(values[k * n : (k + 1) * n].tolist()) for k in range(3))
    v_s, delta, C_rr = values[3 * n : 3 * n + 3].tolist()
    return robot.replace(
        friction=Friction(
            viscous=b, coulomb=c, stribeck=s, stribeck_speed=v_s, stribeck_exponent=delta, rolling=C_rr
        )
    )


def _body(robot: Robot, found: Mapping[str, NDArray[np.float64]]) -> Body:
    if not {"center_of_mass", "second_moment"} & found.keys():
        return robot.body
    S = _second_moment_matrix(robot)
    if "second_moment" in found:
        ratio = np.sqrt(found["second_moment"] / np.array(second_moments(robot)))
        S = S * np.outer(ratio, ratio)
        np.fill_diagonal(S, found["second_moment"])
    J = np.trace(S) * np.eye(3) - S
    height = float(found["center_of_mass"][0]) if "center_of_mass" in found else robot.body.center_of_mass
    if robot.body.inertia_about == "ball_center":
        J = J + robot.body.mass * height**2 * np.diag([1.0, 1.0, 0.0])
    six = (J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])
    xx, yy, zz, xy, xz, yz = (float(element) for element in six)
    return replace(robot.body, center_of_mass=height, inertia=(xx, yy, zz, xy, xz, yz))


def _drive(robot: Robot, found: Mapping[str, NDArray[np.float64]]) -> Drive:
    if "rotor_inertia" not in found:
        return robot.drive
    drive, wanted = robot.drive, float(found["rotor_inertia"][0])
    before = rotor_inertia(robot)[0]
    if before == 0.0:
        return replace(drive, motor_inertia=wanted / drive.gear_ratio**2)
    factor = wanted / before
    return replace(
        drive, motor_inertia=factor * drive.motor_inertia, gear_inertia=factor * drive.gear_inertia
    )


def _second_moment_matrix(robot: Robot) -> NDArray[np.float64]:
    J = robot.body.inertia_about_center_of_mass()
    return 0.5 * np.trace(J) * np.eye(3) - J
