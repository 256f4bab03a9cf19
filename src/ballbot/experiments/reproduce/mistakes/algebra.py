"""Printed equations that cannot be: (II.6), (II.15), (II.30) and (V.4)."""

from __future__ import annotations

import numpy as np

from ballbot.experiments.reproduce.bench import Bench
from ballbot.experiments.reproduce.item import Check, Mistake
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.model import Model
from ballbot.vision.seam import thesis_seam

#: the seam's a, in ball radii (Appendix V)
_SEAM_A = 0.65


def rotation_about_y(bench: Bench) -> Mistake:  # noqa: ARG001
    """(II.6) has -sin twice."""
    c = s = np.sqrt(0.5)  # at 45 degrees
    printed = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    mended = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return Mistake(
        number=1,
        where="(II.6)",
        thesis="R_y has -sin(theta) twice.",
        right="The upper one is +sin(theta); as printed it is no rotation, its determinant is cos(2 theta).",
        shown_by=(
            Check(
                claim="as printed it is no rotation",
                quantity="determinant at 45 degrees",
                value=float(np.linalg.det(printed)),
                highest=0.5,
            ),
            Check(
                claim="mended it is one",
                quantity="determinant, mended, less 1",
                value=abs(float(np.linalg.det(mended)) - 1.0),
                highest=1e-12,
            ),
        ),
    )


def velocity_over_ground(bench: Bench) -> Mistake:
    """(II.15) divides a velocity by r_w."""
    radius, wheel = bench.robot.ball.radius, bench.robot.wheels.radius
    right = transforms(bench.robot).T_vgb
    per_turn = float(np.abs(right).max())  # r_b: velocity for 1 rad/s
    printed = per_turn / wheel
    return Mistake(
        number=2,
        where="(II.15)",
        thesis="The velocity over ground from the ball's turning is divided by r_w.",
        right=f"A ball that turns by 1 rad/s rolls at r_b = {radius:g} m/s.",
        shown_by=(
            Check(
                claim="as printed the ball rolls too fast",
                quantity="velocity at 1 rad/s as printed, over r_b",
                value=printed / radius,
                lowest=1.01,
            ),
            Check(
                claim="mended it rolls at r_b",
                quantity="velocity at 1 rad/s, mended, less r_b",
                value=abs(per_turn - radius),
                unit="m/s",
                highest=1e-12,
            ),
        ),
    )


def derivative_of_angles(bench: Bench) -> Mistake:
    """(II.30) has the derivative of r_1 where that of Phi_12 belongs."""
    robot, matrices = bench.robot, transforms(bench.robot)
    mass = Model(robot, formulation="thesis").mass_matrix(np.zeros(5))
    force, torque = matrices.T_fgb @ matrices.T_tbw, matrices.T_trw
    nothing = np.zeros_like(torque)
    # d r_1 / dq has ones for x and y only, so that the body's torque enters there
    printed = np.linalg.solve(mass, np.vstack([force + torque[:2], nothing]))
    mended = np.linalg.solve(mass, np.vstack([force, torque]))
    return Mistake(
        number=3,
        where="(II.30)",
        thesis="Phi_12q is the derivative of r_1, which is (II.29) again.",
        right="It is the derivative of Phi_12; as printed the wheels' torque on the body pushes x and y and "
        "turns nothing, and the heading cannot be controlled.",
        shown_by=(
            Check(
                claim="as printed the wheels do not turn the heading",
                quantity="psi_dd for 1 N m at wheel 1, as printed",
                value=abs(float(printed[4, 0])),
                unit="rad/s^2",
                highest=1e-9,
            ),
            Check(
                claim="mended they do",
                quantity="psi_dd for 1 N m at wheel 1, mended, its size",
                value=abs(float(mended[4, 0])),
                unit="rad/s^2",
                lowest=1.0,
            ),
        ),
    )


def seam_curve(bench: Bench) -> Mistake:  # noqa: ARG001
    """(V.4) leaves the sphere."""
    a, b = _SEAM_A, 1.0 - _SEAM_A
    t = np.linspace(0.0, 2.0 * np.pi, 2000)
    x, y = a * np.cos(t) + b * np.cos(3.0 * t), a * np.sin(t) - b * np.cos(3.0 * t)
    printed = np.sqrt(x**2 + y**2 + a * b * np.sin(2.0 * t) ** 2)
    only_c = np.sqrt(x**2 + (a * np.sin(t) - b * np.sin(3.0 * t)) ** 2 + a * b * np.sin(2.0 * t) ** 2)
    mended = np.linalg.norm(thesis_seam(a).points, axis=1)
    return Mistake(
        number=10,
        where="(V.4)",
        thesis="The second component has cos 3t, and c = sqrt(ab).",
        right="The second component has sin 3t, and c = 2 sqrt(ab); the seam then lies on the ball.",
        shown_by=(
            Check(
                claim="as printed the seam leaves the ball",
                quantity="largest distance from its surface as printed, in radii",
                value=float(np.abs(printed - 1.0).max()),
                lowest=0.01,
            ),
            Check(
                claim="sin 3t alone does not mend it",
                quantity="the same with sin 3t and the printed c",
                value=float(np.abs(only_c - 1.0).max()),
                lowest=0.01,
            ),
            Check(
                claim="both together do",
                quantity="the same with both mended",
                value=float(np.abs(mended - 1.0).max()),
                highest=1e-12,
            ),
        ),
    )
