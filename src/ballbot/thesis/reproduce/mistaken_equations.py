"""Printed equations and physics of the model that are wrong or incomplete: 1 to 8, 10, 16 to 18."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.geometry import axles, body_rates_matrix, rotation, transforms
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import Formulation
from ballbot.robot import Body, Robot
from ballbot.robot.derived import reflected_rotor_inertia
from ballbot.thesis.reproduce.bench import Bench
from ballbot.thesis.reproduce.item import Check, Mistake
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


#: upright, driving forward at 1 m/s and turning at 2 rad/s
_DRIVING = np.zeros(5), np.array([1.0, 0.0, 0.0, 0.0, 2.0])
#: step of the central difference [rad]: its square and the rounding over it are both near 1e-10
_STEP = 1e-5


def nonholonomic_rates(bench: Bench) -> Mistake:
    """(II.34) is given energies in which the wheels' rates are already put in."""
    model = Model(bench.robot, formulation="thesis")
    q, q_dot = _DRIVING
    extra = nonholonomic_force(bench.robot, q, q_dot)
    printed = model.acceleration(q, q_dot, np.zeros(bench.robot.wheel_count))
    mended = printed + np.linalg.solve(model.mass_matrix(q), extra)
    return Mistake(
        number=16,
        where="(II.34) with (II.27) and (II.28)",
        thesis="Lagrange's equation is applied to an energy in which the wheels' rates (II.16) are already put in.",
        right="The wheels' angles are no functions of q, so d'Alembert's principle has to come first. Lagrange's "
        "equation then has one force less; it does no work, and it is zero at rest, so that the linear model does "
        "not show it.",
        shown_by=(
            Check(
                claim="as printed a robot that drives and turns is pushed aside too little",
                quantity="y_dd upright at 1 m/s and 2 rad/s without torques, as printed over mended",
                value=float(printed[1] / mended[1]),
                highest=0.5,
            ),
            Check(
                claim="mended it is",
                quantity="y_dd, mended",
                value=float(mended[1]),
                unit="m/s^2",
                lowest=0.01,
            ),
            Check(
                claim="the force that is too much does no work",
                quantity="its power, its size",
                value=abs(float(extra @ q_dot)),
                unit="W",
                highest=1e-9,
            ),
            Check(
                claim="and is zero at rest",
                quantity="its largest component at a lean of 10 degrees",
                value=float(
                    np.abs(nonholonomic_force(bench.robot, np.radians([0, 0, 10, 0, 0]), np.zeros(5))).max()
                ),
                highest=1e-12,
            ),
        ),
    )


def locked_wheels_twice(bench: Bench) -> Mistake:
    """(II.27) adds what the pendulum's inertia already contains."""
    a = axles(bench.robot.wheels)
    # a wheel that is locked turns about its axle with a_i . w
    twice = bench.robot.wheels.inertia * np.diag(a.T @ a)
    about_x, _, about_z, *_ = bench.robot.body.inertia
    return Mistake(
        number=17,
        where="(II.27), Appendix III",
        thesis="(II.27) adds the wheels' whole spin to a body whose inertia was measured with the wheels on it.",
        right="Locked wheels turn about their axles with a_i . w, and the swing measured that: j_w (a_i . w)^2 / 2 of "
        "each wheel has to be subtracted. It is little.",
        shown_by=(
            Check(
                claim="about z it counts twice",
                quantity="j_w times the sum of a_iz^2",
                value=1e3 * float(twice[2]),
                unit="g m^2",
                lowest=1.49,
                highest=1.51,
            ),
            Check(
                claim="that is nearly a hundredth of the body's",
                quantity="the same over jrz",
                value=100.0 * float(twice[2]) / about_z,
                unit="%",
                lowest=0.5,
                highest=1.0,
            ),
            Check(
                claim="about x it is nothing beside the body's",
                quantity="j_w times the sum of a_ix^2, over jrx",
                value=100.0 * float(twice[0]) / about_x,
                unit="%",
                lowest=0.01,
                highest=0.02,
            ),
        ),
    )


def undefined_inverses(bench: Bench) -> Mistake:
    """T_obg and T_fgb are used and never defined."""
    found = transforms(bench.robot)
    # the ball turns about the vertical and does not move; the wheels turn it so
    unseen = found.T_vgb @ np.array([0.0, 0.0, 1.0])
    T_obg = np.linalg.pinv(found.T_vgb)
    forward = np.array([1.0, 0.0, 0.0])
    return Mistake(
        number=18,
        where="(II.19), (II.31)",
        thesis="T_obg and T_fgb are used and never defined; their counterparts (II.15) and (II.12) are.",
        right="Neither counterpart has an inverse: T_vgb is singular and T_tbg is 3 x 2. Their pseudo-inverses are "
        "meant, which take the ball's turning about the vertical for zero: an assumption that the thesis does not "
        "list.",
        shown_by=(
            Check(
                claim="T_vgb has no inverse",
                quantity="its rank, of 3",
                value=float(np.linalg.matrix_rank(found.T_vgb)),
                highest=2.0,
            ),
            Check(
                claim="T_tbg has none",
                quantity="its rank, of 3 rows",
                value=float(np.linalg.matrix_rank(found.T_tbg)),
                highest=2.0,
            ),
            Check(
                claim="a ball that turns about the vertical does not move over ground",
                quantity="velocity over ground at 1 rad/s about z",
                value=float(np.abs(unseen).max()),
                unit="m/s",
                highest=0.0,
            ),
            Check(
                claim="the pseudo-inverse gives back the velocity over ground",
                quantity="T_vgb T_obg v less v, v = 1 m/s forward",
                value=float(np.abs(found.T_vgb @ T_obg @ forward - forward).max()),
                unit="m/s",
                highest=1e-12,
            ),
        ),
    )


def nonholonomic_force(
    robot: Robot, q: NDArray[np.float64], q_dot: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return what (II.34) has too much on its left (5,) because the wheels' angles are no functions of q.

    With the wheels' rates W(q) q_dot against the body and their spins w this is (d/dt W - d(W q_dot)/dq)^T j_w w, which
    vanishes only if W dq is the differential of a function.

    Parameters
    ----------
    robot : Robot
    q, q_dot : ndarray (5,)
        [m, rad] and their rates.
    """
    along = [
        _wheel_rates(robot, q + step)[0] - _wheel_rates(robot, q - step)[0] for step in _STEP * np.eye(5)
    ]
    gradient = np.stack(along, axis=-1) / (2.0 * _STEP)  # (n, 5, 5): dW_ij / dq_k
    momenta = robot.wheels.inertia * _wheel_rates(robot, q)[1] @ q_dot
    curl = gradient @ q_dot - np.einsum("ijk,j->ik", gradient, q_dot)
    return curl.T @ momenta


def _wheel_rates(robot: Robot, q: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return W and S (n, 5): the wheels' rates against the body and their spins (II.16), both for each rate of q."""
    found, back = transforms(robot), rotation(*q[2:]).T
    ball = found.T_owb @ back @ np.linalg.pinv(found.T_vgb)[:, :2]
    body = found.T_owr @ back  # with (II.24) as printed
    # a wheel counts its spin against a_i, so that the body's share is added
    return np.hstack([ball, body + axles(robot.wheels) @ back]), np.hstack([ball, body])


#: a lean at which the robot still balances [rad]
_LEAN = np.radians(10.0)


def rates_of_angles(bench: Bench) -> Mistake:  # noqa: ARG001
    """(II.24) takes the Euler angles' rates for the angular velocity."""
    turned = body_rates_matrix(0.0, 0.0, 0.5 * np.pi) @ np.array([1.0, 0.0, 0.0])
    leaning = rotation(_LEAN, 0.0, 0.0) @ body_rates_matrix(_LEAN, 0.0, 0.0) @ np.array([0.0, 0.0, 1.0])
    off_body = float(np.linalg.norm(turned - [1.0, 0.0, 0.0]))
    off_world = float(np.linalg.norm(leaning - [0.0, 0.0, 1.0]))
    return Mistake(
        number=4,
        where="(II.24), with (II.25), (II.16) and (II.33)",
        thesis="The body's angular velocity is Phi_dot: in the body's frame for (II.25), in the world's for "
        "(II.16); and a torque in world axes is paired with the rates of angles.",
        right="In the body's frame it is B(Phi) Phi_dot, in the world's R B Phi_dot; Phi_dot is neither "
        "once the robot has turned or leans.",
        shown_by=(
            Check(
                claim="Phi_dot is not the body's rate in its own frame",
                quantity="how far off, of the rate, for theta_dot alone at psi = 90 degrees",
                value=off_body,
                lowest=0.1,
            ),
            Check(
                claim="nor is it in the world's frame",
                quantity="how far off, of the rate, for psi_dot alone at a lean of 10 degrees",
                value=off_world,
                lowest=0.1,
            ),
        ),
    )


def inertia_counted_twice(bench: Bench) -> Mistake:
    """The inertia about the ball's centre stands beside v_body."""
    body = bench.robot.body
    extra = body.mass * body.center_of_mass**2
    xx, yy, zz, *rest = body.inertia
    own = replace(body, inertia=(xx - extra, yy - extra, zz, *rest), inertia_about="center_of_mass")
    thesis, mended = (_pole(bench.robot, "thesis", body=one) for one in (body, own))
    exact = _pole(bench.robot, "exact", body=body)
    return Mistake(
        number=5,
        where="(II.22), (II.25), Appendix III",
        thesis="The inertia of 4.37 kg m^2 stands beside m_r v_body^2.",
        right="It was measured about the ball's centre, so that it has m_r l^2 already; about the centre of "
        f"mass it is {own.inertia[0]:.3f} kg m^2. Items 4 to 7 together make the printed model fall with "
        f"{thesis:.2f} rad/s where the robot falls with {exact:.2f}.",
        shown_by=(
            Check(
                claim="m_r l^2 counts twice",
                quantity="m_r l^2",
                value=extra,
                unit="kg m^2",
                lowest=2.636,
                highest=2.639,
            ),
            Check(
                claim="the printed model falls too slowly",
                quantity="exact unstable pole over the printed one",
                value=exact / thesis,
                lowest=1.4,
            ),
            Check(
                claim="with this alone mended it falls about as it should",
                quantity="the same, with this alone mended",
                value=exact / mended,
                lowest=0.95,
                highest=1.05,
            ),
        ),
    )


def no_counter_torque(bench: Bench) -> Mistake:
    """(II.11) and (II.32) leave out the motors' counter-torque."""
    matrices = transforms(bench.robot)
    # by action and reaction the torque on the body is minus that on the ball
    ratio = float(np.linalg.norm(matrices.T_trw) / np.linalg.norm(matrices.T_tbw))
    heading = [float(Model(bench.robot, formulation=one).linearize().B[9, 0]) for one in ("thesis", "exact")]
    return Mistake(
        number=6,
        where="(II.11), (II.32)",
        thesis="The torque on the body is that of the wheels' forces at their hubs.",
        right="The motors stand on the body and turn it back by as much as they turn the wheels; the torque "
        "on the body is minus the torque on the ball.",
        shown_by=(
            Check(
                claim="the body feels more than the ball",
                quantity="torque on the body over that on the ball, as printed",
                value=ratio,
                lowest=1.572,
                highest=1.574,
            ),
            Check(
                claim="the heading turns too fast",
                quantity="psi_dd for 1 N m as printed over the exact one",
                value=heading[0] / heading[1],
                lowest=1.5,
            ),
        ),
    )


def rotors_left_out(bench: Bench) -> Mistake:
    """Gear and motor inertia are listed and never enter."""
    drive = bench.robot.drive
    rotor = reflected_rotor_inertia(
        gear_ratio=drive.gear_ratio, motor_inertia=drive.motor_inertia, gear_inertia=drive.gear_inertia
    )
    return Mistake(
        number=7,
        where="(II.27), (II.28)",
        thesis="The inertia of motors and gears is listed among the parameters and is in no equation.",
        right="At the wheel it counts n^2 times: n^2 (j_m + j_g), more than the wheel itself.",
        shown_by=(
            Check(
                claim="it is twice the wheel's",
                quantity="n^2 (j_m + j_g) over j_w",
                value=rotor / bench.robot.wheels.inertia,
                lowest=1.9,
                highest=2.1,
            ),
        ),
    )


def friction_on_absolute_spin(bench: Bench) -> Mistake:
    """(3.8) and (3.9) put friction on the wheels' absolute spin."""
    exact, thesis = (Model(bench.robot, formulation=one) for one in ("exact", "thesis"))
    radius = bench.robot.ball.radius
    # body and ball lean over as one, theta_dot = 1 rad/s: the ball rolls along, no wheel turns in its bearings
    together = np.array([0.0, -radius, 1.0, 0.0, 0.0])
    on_ball = np.array([0.0, 0.0, 1.0, 0.0, 0.0])  # the body alone, the ball at rest
    speeds = [
        float(np.abs(model.wheel_speed(np.zeros(5), rates)).max())
        for model in (exact, thesis)
        for rates in (together, on_ball)
    ]
    return Mistake(
        number=8,
        where="(3.8), (3.9)",
        thesis="The drivelines' friction acts on the wheels' absolute spin.",
        right="Bearings, gear and motor feel the speed against the body, which the encoder sees.",
        shown_by=(
            Check(
                claim="as printed, friction acts where body and ball turn as one",
                quantity="the thesis's wheel speed there at 1 rad/s",
                value=speeds[2],
                unit="rad/s",
                lowest=0.5,
            ),
            Check(
                claim="where no motor turns",
                quantity="the encoder's there",
                value=speeds[0],
                unit="rad/s",
                highest=1e-12,
            ),
            Check(
                claim="where the ball rests, the printed speed is too large",
                quantity="the thesis's over the encoder's",
                value=speeds[3] / speeds[1],
                lowest=1.5,
            ),
        ),
    )


def _pole(robot: Robot, formulation: Formulation, *, body: Body) -> float:
    """Return the faster unstable pole [rad/s] of a robot with that body."""
    model = Model(robot.replace(body=body), formulation=formulation)
    return float(model.linearize().poles()[0].real)
