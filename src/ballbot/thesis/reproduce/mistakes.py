"""The thesis's misprints and mistakes, each with a number that would differ if the thesis were right."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ballbot.arrays import Floats
from ballbot.control.source import Law
from ballbot.log import Log
from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import Formulation
from ballbot.robot import Body, Robot
from ballbot.robot.derived import thin_shell_inertia
from ballbot.robot.wheel_directions import axles
from ballbot.simulation.run import simulate
from ballbot.thesis.reproduce.bench import CHANGE, Bench
from ballbot.thesis.reproduce.item import Mistake, check
from ballbot.validation.models import thesis_error
from ballbot.validation.statistics import Correlations
from ballbot.vision.seam import thesis_seam

#: of the ball's rubber, by Appendix I [kg/m^3]
RUBBER = 1000.0
#: the thesis's sweep: amplitude [N m], period [s]; the limit [rad/s]; the step that it is simulated with here [s]
_AMPLITUDE, _PERIOD, _LIMIT, _STEP = 1.0, 62.83, 27.7, 0.01
#: of velocity over ground and rate of lean that kinematics joins: residuals (6, 9) and (7, 8); and (7, 9), which the
#: thesis names beside (6, 9)
VELOCITY_PAIRS = (("x_dot", "phi_dot"), ("y_dot", "theta_dot"), ("y_dot", "phi_dot"))


def rotation_about_y(bench: Bench) -> Mistake:  # noqa: ARG001
    """Mistake 1."""
    c = s = np.sqrt(0.5)  # at 45 degrees
    printed, mended = (
        float(np.linalg.det(np.array([[c, 0.0, upper], [0.0, 1.0, 0.0], [-s, 0.0, c]]))) for upper in (-s, s)
    )
    return Mistake(
        where="(II.6)",
        thesis="R_y has -sin(theta) twice.",
        right="The upper one is +sin(theta); as printed it is no rotation, its determinant is cos(2 theta).",
        shown_by=(
            check("as printed it is no rotation", "determinant at 45 degrees", printed, highest=0.5),
            check("mended it is one", "determinant, mended, less 1", abs(mended - 1.0), highest=1e-12),
        ),
    )


def velocity_over_ground(bench: Bench) -> Mistake:
    """Mistake 2."""
    radius = bench.robot.ball.radius
    mended = float(np.abs(transforms(bench.robot).T_vgb).max())  # of a ball that turns by 1 rad/s
    printed = mended / bench.robot.wheels.radius / radius
    return Mistake(
        where="(II.15)",
        thesis="The velocity over ground from the ball's turning is divided by r_w.",
        right=f"A ball that turns by 1 rad/s rolls at r_b = {radius:g} m/s.",
        shown_by=(
            check("as printed the ball rolls too fast", "velocity at 1 rad/s over r_b", printed, lowest=1.01),
        ),
    )


def derivative_of_angles(bench: Bench) -> Mistake:
    """Mistake 3."""
    matrices = transforms(bench.robot)
    mass = Model(bench.robot, formulation="thesis").mass_matrix(np.zeros(5))
    force, torque = matrices.T_fgb @ matrices.T_tbw, matrices.T_trw
    # d r_1 / dq has ones for x and y only, so that the body's torque enters there
    printed, mended = (
        abs(float(np.linalg.solve(mass, np.vstack(rows))[4, 0]))
        for rows in ([force + torque[:2], np.zeros_like(torque)], [force, torque])
    )
    quantity = "psi_dd for 1 N m at wheel 1"
    return Mistake(
        where="(II.30)",
        thesis="Phi_12q is the derivative of r_1, which is (II.29) again.",
        right="It is the derivative of Phi_12; as printed the wheels' torque on the body pushes x and y and turns "
        "nothing, and the heading cannot be controlled.",
        shown_by=(
            check(
                "as printed the wheels do not turn the heading", quantity, printed, "rad/s^2", highest=1e-9
            ),
            check("mended they do", f"{quantity}, its size", mended, "rad/s^2", lowest=1.0),
        ),
    )


def rates_of_angles(bench: Bench) -> Mistake:  # noqa: ARG001
    """Mistake 4."""
    lean, x, z = np.radians(10.0), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    turned = body_rates_matrix(0.0, 0.0, 0.5 * np.pi) @ x
    leaning = rotation(lean, 0.0, 0.0) @ body_rates_matrix(lean, 0.0, 0.0) @ z
    off_body, off_world = float(np.linalg.norm(turned - x)), float(np.linalg.norm(leaning - z))
    return Mistake(
        where="(II.24), with (II.25), (II.16) and (II.33)",
        thesis="The body's angular velocity is Phi_dot: in the body's frame for (II.25), in the world's for (II.16); "
        "and a torque in world axes is paired with the rates of angles.",
        right="In the body's frame it is B(Phi) Phi_dot, in the world's R B Phi_dot; Phi_dot is neither once the robot "
        "has turned or leans.",
        shown_by=(
            check("it is not the body's frame's", "share off, theta_dot, psi = 90 deg", off_body, lowest=0.1),
            check("nor the world's", "share off, psi_dot, at a lean of 10 deg", off_world, lowest=0.1),
        ),
    )


def inertia_counted_twice(bench: Bench) -> Mistake:
    """Mistake 5."""
    body = bench.robot.body
    extra = body.mass * body.center_of_mass**2
    xx, yy, *rest = body.inertia
    about_center = replace(body, inertia=(xx - extra, yy - extra, *rest), inertia_about="center_of_mass")

    def pole(formulation: Formulation, of: Body) -> float:
        """Return the faster unstable pole [rad/s]."""
        return float(Model(bench.robot.replace(body=of), formulation=formulation).linearize().poles()[0].real)

    exact, thesis, mended = pole("exact", body), pole("thesis", body), pole("thesis", about_center)
    return Mistake(
        where="(II.22), (II.25), Appendix III",
        thesis="The inertia of 4.37 kg m^2 stands beside m_r v_body^2.",
        right="It was measured about the ball's centre, so that it has m_r l^2 already; about the centre of mass it is "
        f"{about_center.inertia[0]:.3f} kg m^2. Items 4 to 7 together make the printed model fall with {thesis:.2f} "
        f"rad/s where the robot falls with {exact:.2f}.",
        shown_by=(
            check("m_r l^2 counts twice", "m_r l^2", extra, "kg m^2", lowest=2.636, highest=2.639),
            check("it falls too slowly", "exact unstable pole over the printed", exact / thesis, lowest=1.4),
            check("by this alone", "the same, this mended", exact / mended, lowest=0.95, highest=1.05),
        ),
    )


def no_counter_torque(bench: Bench) -> Mistake:
    """Mistake 6."""
    matrices = transforms(bench.robot)
    # by action and reaction the torque on the body is minus that on the ball
    ratio = float(np.linalg.norm(matrices.T_trw) / np.linalg.norm(matrices.T_tbw))
    heading = [
        float(Model(bench.robot, formulation=kind).linearize().B[9, 0]) for kind in ("thesis", "exact")
    ]
    return Mistake(
        where="(II.11), (II.32)",
        thesis="The torque on the body is that of the wheels' forces at their hubs.",
        right="The motors stand on the body and turn it back by as much as they turn the wheels; the torque on the "
        "body is minus the torque on the ball.",
        shown_by=(
            check("the body feels more than the ball", "torque on it over the ball's", ratio, lowest=1.5),
            check("it turns too fast", "psi_dd printed over exact", heading[0] / heading[1], lowest=1.5),
        ),
    )


def rotors_left_out(bench: Bench) -> Mistake:
    """Mistake 7."""
    ratio = bench.robot.drive.reflected_inertia / bench.robot.wheels.inertia
    return Mistake(
        where="(II.27), (II.28)",
        thesis="The inertia of motors and gears is listed among the parameters and is in no equation.",
        right="At the wheel it counts n^2 times: n^2 (j_m + j_g), more than the wheel itself.",
        shown_by=(check("it is twice the wheel's", "n^2 (j_m + j_g) over j_w", ratio, lowest=1.9),),
    )


def friction_on_absolute_spin(bench: Bench) -> Mistake:
    """Mistake 8."""
    # body and ball lean over as one, theta_dot = 1 rad/s: the ball rolls along, no wheel turns in its bearings
    together = np.array([0.0, -bench.robot.ball.radius, 1.0, 0.0, 0.0])
    exact, thesis = (
        float(np.abs(Model(bench.robot, formulation=kind).wheel_speed(np.zeros(5), together)).max())
        for kind in ("exact", "thesis")
    )
    quantity = "wheel speed where body and ball turn as one by 1 rad/s"
    return Mistake(
        where="(3.8), (3.9)",
        thesis="The drivelines' friction acts on the wheels' absolute spin.",
        right="Bearings, gear and motor feel the speed against the body, which the encoder sees.",
        shown_by=(
            check("as printed, friction acts", quantity, thesis, "rad/s", lowest=0.5),
            check("where no motor turns", "the encoder's there", exact, "rad/s", highest=1e-12),
        ),
    )


def speed_clamp_printed(bench: Bench) -> Mistake:
    """Mistake 9."""
    t = np.arange(0.0, _PERIOD, _STEP)
    torque = _AMPLITUDE * np.sin(2.0 * np.pi * t / _PERIOD)
    state = np.cumsum(torque) * _STEP / bench.robot.wheels.inertia
    # torque brakes from half the period on; a wheel of 1 g m^2 would leave the limit within milliseconds
    late = float(t[state >= _LIMIT][-1]) - 0.5 * _PERIOD
    speeds = np.linspace(-100.0, 100.0, 11)
    printed = float(np.ptp(np.maximum(np.minimum(speeds, -_LIMIT), _LIMIT)))
    wound = float(state.max())
    return Mistake(
        where="(3.2)",
        thesis="x_1_dot = max(min(x_2, l), -l) with l = -27.7 rad/s.",
        right="With l = -27.7 it is +27.7 whatever x_2 is. With l = 27.7 it limits the output and not the state, which "
        "winds up and leaves the limit late; the state itself must stop.",
        shown_by=(
            check("as printed all speeds are one", "its range from -100 to 100 rad/s", printed, highest=0.0),
            check("with l = 27.7 the state winds up", "largest x_2 in the sweep", wound, "rad/s", lowest=1e3),
            check("and leaves the limit late", "after the torque has turned", late, "s", lowest=1.0),
        ),
    )


def seam_curve(bench: Bench) -> Mistake:  # noqa: ARG001
    """Mistake 10."""
    a = 0.65  # of Appendix V, in ball radii
    b, t = 1.0 - a, np.linspace(0.0, 2.0 * np.pi, 2000)
    x, printed, sine = (
        a * np.cos(t) + b * np.cos(3.0 * t),
        *(a * np.sin(t) - b * second for second in (np.cos(3.0 * t), np.sin(3.0 * t))),
    )
    off, half_mended = (
        float(np.abs(np.sqrt(x**2 + y**2 + a * b * np.sin(2.0 * t) ** 2) - 1.0).max())
        for y in (printed, sine)
    )
    mended = float(np.abs(np.linalg.norm(thesis_seam(a).points, axis=1) - 1.0).max())
    return Mistake(
        where="(V.4)",
        thesis="The second component has cos 3t, and c = sqrt(ab).",
        right="The second component has sin 3t, and c = 2 sqrt(ab); the seam then lies on the ball.",
        shown_by=(
            check("as printed the seam leaves the ball", "largest distance, in radii", off, lowest=0.01),
            check("sin 3t alone does not mend it", "the same with sin 3t", half_mended, lowest=0.01),
            check("both together do", "the same with both mended", mended, highest=1e-12),
        ),
    )


def ball_inertia(bench: Bench) -> Mistake:
    """Mistake 11."""
    ball = bench.robot.ball
    inner = math.cbrt(ball.radius**3 - 3.0 * ball.mass / (4.0 * math.pi * RUBBER))
    wall, ratio = ball.radius - inner, inner / ball.radius
    thin = thin_shell_inertia(mass=ball.mass, radius=ball.radius)
    thick = 0.4 * ball.mass * ball.radius**2 * (1.0 - ratio**5) / (1.0 - ratio**3)
    return Mistake(
        where="Appendix III, jb",
        thesis="The ball's inertia is 0.0242 kg m^2, calculated.",
        right=f"That is a thin shell's; with the wall of {100.0 * wall:.1f} cm that Appendix I computes it is "
        f"{thick:.4f}.",
        shown_by=(
            check("it is a thin shell's", "2/3 m r^2", thin, "kg m^2", lowest=0.02415, highest=0.02425),
            check("the wall makes a difference", "thin shell over thick", thin / thick, lowest=1.2),
        ),
    )


def rounded_constants(bench: Bench) -> Mistake:
    """Mistake 12."""
    beyond = 100.0 * (_LIMIT / bench.robot.drive.top_speed - 1.0)
    smaller = 63.5 - 1e3 * bench.robot.wheels.radius
    return Mistake(
        where="Appendix I and III",
        thesis="31.7 rad/s/V times 24 V is 761.5 rad/s, hence 27.59 rad/s at the wheel; r_w is 63 mm.",
        right="31.7 is rounded from 303 rpm/V, from which 761.5 follows; the sweep shows 27.7 rad/s; the data sheet's "
        "wheel is 127 mm across, r_w = 63.5 mm.",
        shown_by=(
            check("31.7 times 24 is not 761.5", "761.5 less it", 761.5 - 31.7 * 24.0, "rad/s", lowest=0.5),
            check(
                "the sweep went beyond the limit", "the sweep's 27.7, by how much", beyond, "%", lowest=0.2
            ),
            check("r_w is less than half of 127 mm", "63.5 mm less r_w", smaller, "mm", lowest=0.4),
        ),
    )


def residual_pairs(bench: Bench) -> Mistake:
    """Mistake 13."""
    correlations = [run.correlations for run in bench.validations]
    clear = max(clear_correlation(run) for run in correlations)
    first, second, named = velocity_pairs(correlations)
    return Mistake(
        where="section 4.2",
        thesis="Residual 7 goes with residual 9, and residual 6 with residual 9 negatively.",
        right="Leaning about y moves the ball along x, leaning about x along y the other way: the pairs are (6, 9) and "
        "(7, 8), with opposite signs.",
        shown_by=(
            check(
                "7 does not go with 9",
                "correlation, its size",
                [abs(value) for value in named],
                highest=clear,
            ),
            check("6 goes with 9, and not oppositely", "their correlation", first, lowest=clear),
            check("7 goes with 8, oppositely", "their correlation", second, highest=-clear),
        ),
    )


def velocity_pairs(runs: list[Correlations]) -> list[list[float]]:
    """Return the correlations of each of `VELOCITY_PAIRS`, run by run."""
    return [[run.between(f"e_{a}", f"e_{b}")[0] for run in runs] for a, b in VELOCITY_PAIRS]


def clear_correlation(correlations: Correlations) -> float:
    """Return from what size on a residual's correlation with another is clear: four of its standard errors."""
    cell = correlations.labels.index("e_y_dot"), correlations.labels.index("e_phi_dot")
    return 4.0 / float(np.sqrt(correlations.counts[cell]))


def fixed_frame(bench: Bench) -> Law:
    """Return u = K (r - x) with the gain of psi = 0 and no turn into the heading's frame, as the thesis has it."""
    return lambda _, state, reference: bench.design.gain @ (reference - state)


def gain_at_other_headings(bench: Bench) -> Mistake:
    """Mistake 14."""
    run = simulate(Model(bench.robot), fixed_frame(bench), CHANGE, duration=20.0, initial_state=np.zeros(10))
    fell = float(run.t[-1]) if run.ended else float("nan")
    turned = float(np.degrees(largest_lean(bench.frictionless("exact", CHANGE))))
    return Mistake(
        where="sections 5.1 and 5.2",
        thesis="The reference goes to psi = pi under u = K (r - x) with one gain.",
        right="The wheels turn with the body, so that the error must be turned into the heading's frame first, "
        "u = K S(psi) (r - x); the thesis has no word on it. Without, the robot falls on the thesis's own reference.",
        shown_by=(
            check("the change ends in a fall", "when, the change at t = 3 s", fell, "s", highest=20.0),
            check("with S(psi) it does not", "largest lean of the same run", turned, "deg", highest=10.0),
        ),
    )


def largest_lean(log: Log) -> float:
    """Return the largest of theta and phi [rad]."""
    return float(np.abs(log.states[:, 2:4]).max())


def error_over_count(bench: Bench) -> Mistake:
    """Mistake 15."""
    h = bench.robot.sensors.sample_time
    # a model that is off by a sine of 1 mm, over 4 s as over 48 s
    short, long = (
        1e-3 * np.sin(2.0 * np.pi * 0.5 * h * np.arange(round(seconds / h)))[:, None]
        for seconds in (4.0, 48.0)
    )
    ratio = float(thesis_error(short)[0] / thesis_error(long)[0])
    return Mistake(
        where="(4.1), Tables 4.1 and 4.2",
        thesis="e = |x - x_hat| / n.",
        right="The norm of n differences grows with sqrt(n), so that e shrinks with the length of the log; the root "
        "mean square error e sqrt(n) does not. The tables cannot be compared with other logs', nor with each other.",
        shown_by=(
            check(
                "e depends on the length", "of the same sine, 4 s over 48 s", ratio, lowest=3.46, highest=3.47
            ),
        ),
    )


def nonholonomic_rates(bench: Bench) -> Mistake:
    """Mistake 16."""
    model = Model(bench.robot, formulation="thesis")
    # upright, driving forward at 1 m/s and turning at 2 rad/s
    q, q_dot = np.zeros(5), np.array([1.0, 0.0, 0.0, 0.0, 2.0])
    extra = nonholonomic_force(bench.robot, q, q_dot)
    printed = model.acceleration(q, q_dot, np.zeros(bench.robot.wheel_count))
    mended = printed + np.linalg.solve(model.mass_matrix(q), extra)
    ratio, power = float(printed[1] / mended[1]), abs(float(extra @ q_dot))
    return Mistake(
        where="(II.34) with (II.27) and (II.28)",
        thesis="Lagrange's equation is applied to an energy in which the wheels' rates (II.16) are already put in.",
        right="The wheels' angles are no functions of q, so d'Alembert's principle has to come first. Lagrange's "
        "equation then has one force less; it does no work, and it is zero at rest, so that the linear model does "
        "not show it.",
        shown_by=(
            check(
                "it turns too little", "y_dd at 1 m/s and 2 rad/s, printed over mended", ratio, highest=0.5
            ),
            check("the force that is too much does no work", "its power, its size", power, "W", highest=1e-9),
        ),
    )


def nonholonomic_force(robot: Robot, q: Floats, q_dot: Floats) -> Floats:
    """Return what (II.34) has too much on its left (5,) because the wheels' angles are no functions of q.

    With the wheels' rates W(q) q_dot against the body and their spins w this is (d/dt W - d(W q_dot)/dq)^T j_w w, which
    vanishes only if W dq is the differential of a function.

    Parameters
    ----------
    robot : Robot
    q, q_dot : ndarray (5,)
        [m, rad] and their rates.
    """
    step = 1e-5  # of a central difference [rad]: its square and the rounding over it are both near 1e-10
    along = [_wheel_rates(robot, q + dq)[0] - _wheel_rates(robot, q - dq)[0] for dq in step * np.eye(5)]
    gradient = np.stack(along, axis=-1) / (2.0 * step)  # (n, 5, 5): dW_ij / dq_k
    momenta = robot.wheels.inertia * _wheel_rates(robot, q)[1] @ q_dot
    curl = gradient @ q_dot - np.einsum("ijk,j->ik", gradient, q_dot)
    return curl.T @ momenta


def _wheel_rates(robot: Robot, q: Floats) -> tuple[Floats, Floats]:
    """Return W and S (n, 5): the wheels' rates against the body and their spins (II.16), both for each rate of q."""
    matrices, back = transforms(robot), rotation(*q[2:]).T
    ball = matrices.T_owb @ back @ np.linalg.pinv(matrices.T_vgb)[:, :2]
    body = matrices.T_owr @ back  # with (II.24) as printed
    # a wheel counts its spin against a_i, so that the body's share is added
    return np.hstack([ball, body + axles(robot.wheels.azimuths, robot.wheels.tilt) @ back]), np.hstack(
        [ball, body]
    )


def locked_wheels_twice(bench: Bench) -> Mistake:
    """Mistake 17."""
    # a wheel that is locked turns about its axle with a_i . w
    wheels = bench.robot.wheels
    twice = wheels.inertia * float(np.sum(axles(wheels.azimuths, wheels.tilt)[:, 2] ** 2))
    share = 100.0 * twice / bench.robot.body.inertia[2]
    return Mistake(
        where="(II.27), Appendix III",
        thesis="(II.27) adds the wheels' whole spin to a body whose inertia was measured with the wheels on it.",
        right="Locked wheels turn about their axles with a_i . w, and the swing measured that: j_w (a_i . w)^2 / 2 of "
        "each wheel has to be subtracted. It is little.",
        shown_by=(
            check(
                "about z it counts twice", "j_w sum of a_iz^2 over jrz", share, "%", lowest=0.5, highest=1.0
            ),
        ),
    )


def undefined_inverses(bench: Bench) -> Mistake:
    """Mistake 18."""
    matrices = transforms(bench.robot)
    ranks = [float(np.linalg.matrix_rank(matrix)) for matrix in (matrices.T_vgb, matrices.T_tbg)]
    return Mistake(
        where="(II.19), (II.31)",
        thesis="T_obg and T_fgb are used and never defined; their counterparts (II.15) and (II.12) are.",
        right="Neither counterpart has an inverse: T_vgb is singular and T_tbg is 3 x 2. Their pseudo-inverses are "
        "meant, which take the ball's turning about the vertical for zero: an assumption that the thesis does not "
        "list.",
        shown_by=(
            check("T_vgb has no inverse", "its rank, of 3", ranks[0], highest=2.0),
            check("T_tbg has none", "its rank, of 3 rows", ranks[1], highest=2.0),
        ),
    )


def reference_and_stability(bench: Bench) -> Mistake:
    """Mistake 19."""
    linear, gain, reference = Model(bench.robot).linearize(), bench.design.gain, np.zeros(10)
    reference[3] = np.radians(2.0)  # a lean, which is no equilibrium
    # where x_dot = A x + B K (r - x) is zero
    rest = np.linalg.solve(linear.A - linear.B @ gain, -linear.B @ gain @ reference)
    run = simulate(
        Model(bench.robot), fixed_frame(bench), lambda _: reference, duration=60.0, initial_state=np.zeros(10)
    )
    last = run.states[-1] if not run.ended else np.full(10, np.nan)
    rates, input_size = (float(np.abs(values).max()) for values in (last[5:], linear.A @ reference))
    ratio = float(last[0] / rest[0])
    return Mistake(
        where="section 5.1, (5.3)",
        thesis="A r = 0 is needed for (5.3) to be stable.",
        right="A r is a constant input to (5.3): it moves the point of rest, e = (A - B K)^-1 A r, and nothing else. "
        "The eigenvalues of A - B K hold no r.",
        shown_by=(
            check(
                "the reference has A r other than 0", "its largest entry, phi = 2 deg", input_size, lowest=0.1
            ),
            check("the nonlinear model comes to rest", "largest rate after 60 s", rates, highest=1e-4),
            check("where (5.3) says", "x at rest over that of (5.3)", ratio, lowest=0.99, highest=1.01),
        ),
    )


#: in the order of the list, which numbers them from 1
MISTAKES: tuple[Callable[[Bench], Mistake], ...] = (
    rotation_about_y,
    velocity_over_ground,
    derivative_of_angles,
    rates_of_angles,
    inertia_counted_twice,
    no_counter_torque,
    rotors_left_out,
    friction_on_absolute_spin,
    speed_clamp_printed,
    seam_curve,
    ball_inertia,
    rounded_constants,
    residual_pairs,
    gain_at_other_headings,
    error_over_count,
    nonholonomic_rates,
    locked_wheels_twice,
    undefined_inverses,
    reference_and_stability,
)
