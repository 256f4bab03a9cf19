"""Physics of the model that is not right: angular velocity, inertia, counter-torque, rotors and friction's speed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import Formulation
from ballbot.robot import Body, Robot
from ballbot.robot.derived import reflected_rotor_inertia
from ballbot.thesis.reproduce.bench import Bench
from ballbot.thesis.reproduce.item import Check, Mistake

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
