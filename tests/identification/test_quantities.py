"""What identification can free besides friction, each against a log made with a known value of it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot import Log, Model, Robot
from ballbot.errors import InputError
from ballbot.identification.excitation import heading_findings, share_shown
from ballbot.identification.prediction import Predictor, windows_for
from ballbot.identification.quantities import (
    BY_NAME,
    QUANTITIES,
    Bounds,
    Layout,
    names_in,
    scale_between,
    second_moments,
    with_rigid_body,
)
from ballbot.identification.windows import standstill_torques
from ballbot.log import STATE_NAMES
from ballbot.mechanics.geometry import rotation, wheel_load
from ballbot.robot.variations import draw_robots
from tests.support.control_examples import FRICTION, alten
from tests.support.identification_examples import TRUTH, balancing_log, late

#: rounding, grown by at most e^(5.2 * 0.25) over a window
ROUNDING = 1e-9
THETA, PHI, PSI = (STATE_NAMES.index(name) for name in ("theta", "phi", "psi"))


def residuals(log: Log, extra: dict[str, list[float]], *, back_emf: float = 0.0) -> np.ndarray:
    """Return the residuals of the log's windows under the true friction and these values."""
    layout = Layout(wheel_count=3, extra=names_in(list(extra)))
    values = np.concatenate([TRUTH, *(np.array(extra[name]) for name in layout.extra)])
    predictor = Predictor(robot=alten(), step=1e-3, layout=layout, back_emf=back_emf)
    windows = windows_for(predictor, values, [log], duration=0.25)
    return predictor.residuals(values[None], windows, every=1)[0]


def log_of(states: list[np.ndarray], torques: np.ndarray) -> Log:
    """Return a log at 200 Hz of states (10,) and torques (N, 3)."""
    return Log(
        {"t": 0.005 * np.arange(len(torques))}
        | dict(zip(STATE_NAMES, np.array(states).T, strict=True))
        | {f"u{i + 1}": torques[:, i] for i in range(3)}
    )


#: a lean in motion, and torques to and fro
LEANING = np.array([0, 0, 0.02, -0.01, 0, 0.1, 0, 0, 0, 0.2])
TO_AND_FRO = np.sin(np.arange(60)[:, None] * [0.2, 0.31, 0.17])


def played(robot: Robot, torques: np.ndarray, start: np.ndarray = LEANING) -> Log:
    """Return a log of the robot under torques that are held for a sample each."""
    plant, states = Model(robot), [start]
    for u in torques[:-1]:
        states.append(plant.advance(states[-1], u, 0.005))
    return log_of(states, torques)


def with_torques(log: Log, torques: np.ndarray) -> Log:
    return log.with_columns({f"u{i + 1}": torques[:, i] for i in range(3)})


def with_speeds(log: Log, speeds: np.ndarray) -> Log:
    return log.with_columns({f"wheel{i + 1}_dot": speeds[:, i] for i in range(3)})


def moving_log() -> Log:
    """Return a log of wheels that never stop, half a second of it, the torques going to and fro."""
    torques = 0.4 * np.sin(np.arange(104)[:, None] * [0.05, 0.08, 0.06] + [0.0, 1.0, 2.0])
    return played(alten(FRICTION), torques, np.array([0, 0, 0.02, -0.01, 0, 1.0, 0.7, 0, 0, 0.2]))


# --- the table ---


def test_every_quantity_can_be_given_bounds():
    given = {quantity.name: (0.4, 0.5) for quantity in QUANTITIES}
    coordinates = scale_between(alten(FRICTION), bounds=Bounds(given))
    assert set(coordinates.names) == {quantity.name for quantity in QUANTITIES}
    assert {one.bounds for one in coordinates.parameters} == {(0.4, 0.5)}
    with pytest.raises(InputError, match="'rolls' is not a quantity that can be identified"):
        Bounds({"rolls": (0.0, 1.0)})


def test_missing_parameter_scale_is_requested():
    robot = alten()
    without = robot.replace(wheels=replace(robot.wheels, inertia=0.0))
    with pytest.raises(InputError, match="wheel_inertia is zero in the robot's description"):
        scale_between(without, free=("wheel_inertia",))


# --- the rigid body ---

SIZES = st.floats(0.01, 10.0)


@given(
    second=st.tuples(SIZES, SIZES, SIZES),
    height=st.floats(0.05, 2.0),
    about=st.sampled_from(["ball_center", "center_of_mass"]),
)
def test_any_second_moments_are_a_body_s(second, height, about):
    robot = alten()
    J = robot.body.inertia_about_center_of_mass()
    if about == "center_of_mass":  # products of inertia in proportion must keep it a body as well
        body = replace(robot.body, inertia=(*np.diag(J), 0.05, -0.02, 0.01), inertia_about=about)
        robot = robot.replace(body=body)
    parts = {"second_moment": np.array(second), "center_of_mass": np.array([height])}
    found = with_rigid_body(robot, parts)  # a Robot refuses an inertia that no body has
    # J_xx = S_y + S_z and so on; 1e-9: m l^2 is up to 70 kg m^2 against 0.02
    about_center = np.diag(found.body.inertia_about_center_of_mass())
    np.testing.assert_allclose(about_center, sum(second) - np.array(second), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(second_moments(found), second, rtol=1e-6, atol=1e-3 * sum(second))


def test_the_rigid_body_found_is_the_one_that_predicts():
    heavy = alten(FRICTION)
    heavy = heavy.replace(
        body=replace(heavy.body, center_of_mass=0.42, inertia=(4.9, 4.8, 0.8, 0.0, 0.0, 0.0)),
        wheels=replace(heavy.wheels, inertia=1.4e-3),
    )
    log = played(heavy, 0.3 * TO_AND_FRO)
    found = {
        "center_of_mass": [0.42],
        "second_moment": list(second_moments(heavy)),
        "wheel_inertia": [1.4e-3],
    }
    assert np.abs(residuals(log, found)).max() < ROUNDING
    assert np.abs(residuals(log, {"delay": [0.0]})).max() > 1e-4


# --- motors ---


def test_gain_and_offset_undo_what_the_motors_did():
    log = balancing_log(duration=5.0)
    gain, offset = np.array([0.9, 1.1, 1.3]), np.array([0.02, -0.03, 0.01])
    commanded = with_torques(log, (log.torques - offset) / gain)
    assert np.abs(residuals(commanded, {"torque_gain": [*gain], "torque_offset": [*offset]})).max() < ROUNDING


def test_a_delay_of_whole_samples_takes_earlier_rows():
    log = balancing_log(duration=5.0)
    early = with_torques(log, np.roll(log.torques, -3, axis=0))  # logged three rows before it acts
    found = residuals(early, {"delay": [0.015]})
    # the last windows reach the rows that were rolled around
    assert np.abs(found[:-1]).max() < ROUNDING


def test_back_emf_brakes_the_predicted_wheels():
    brake = 0.05
    braked = alten(replace(FRICTION, viscous=tuple(b + brake for b in FRICTION.viscous)))
    log = balancing_log(friction=braked.friction, duration=5.0)
    speeds = Model(alten()).wheel_speed(log.states[:, :5], log.states[:, 5:])
    as_mapped = with_speeds(with_torques(log, log.torques - brake * speeds), speeds)  # as of duties
    undone = standstill_torques(as_mapped, alten(), brake)
    np.testing.assert_allclose(undone.torques, log.torques, atol=1e-12)
    assert np.abs(residuals(undone, {"delay": [0.0]}, back_emf=brake)).max() < ROUNDING


# --- sensors ---


def test_tilted_imu_is_corrected():
    # the robot stands turned by 0.8 rad: the tilt's axes turn with the body (to x, y and lean the model is indifferent)
    log, (a, b) = balancing_log(duration=5.0), (0.004, -0.006)
    tilt = rotation(a, b, 0.0)
    R = rotation(log["theta"], log["phi"], log["psi"]) @ tilt
    seen = {"theta": np.arctan2(-R[:, 1, 2], R[:, 2, 2]), "phi": np.arcsin(R[:, 0, 2])}
    found = residuals(log.with_columns(seen), {"lean_bias": [a, b]})
    blind = residuals(log.with_columns(seen), {"delay": [0.0]})
    # to first order in tilt and lean: 0.006 * 0.05 rad of 0.006, and what a window makes of it
    assert np.abs(found).max() < 0.05 * np.abs(blind).max()


def test_gyro_bias_is_corrected():
    log, (x, y, z) = balancing_log(duration=5.0), (0.02, -0.01, 0.03)
    c, s = np.cos(log["psi"]), np.sin(log["psi"])
    seen = {
        "theta_dot": log["theta_dot"] + c * x - s * y,
        "phi_dot": log["phi_dot"] + s * x + c * y,
        "psi_dot": log["psi_dot"] + z,
        "psi": log["psi"] + z * log.t,
    }
    found = residuals(log.with_columns(seen), {"gyro_bias": [x, y, z]})
    # the axes turn with the heading seen, which has run away by 0.15 rad at the end: 15 % of the bias
    early = found[:2]
    assert np.abs(early).max() < 0.002
    assert np.abs(residuals(log.with_columns(seen), {"delay": [0.0]})[:2]).max() > 0.02


@pytest.mark.parametrize(("imu", "velocity"), [(0.016, 0.0), (0.0, 0.006), (0.012, 0.0025), (-0.004, -0.002)])
def test_sensor_delay_is_corrected(imu, velocity):
    log = moving_log()
    seen = late(log, imu=imu, velocity=velocity)
    # from the second window on: before the first row nothing is known
    found = residuals(seen, {"imu_delay": [imu], "velocity_delay": [velocity]})[1:]
    blind = residuals(seen, {"delay": [0.0]})[1:]
    # x with y, and so on: what one of a pair feels of a delay may be little
    pairs = np.array([0, 0, 1, 1, 2, 3, 3, 4, 4, 5])
    left, all_of_it = (np.bincount(pairs, (one**2).mean(axis=(0, 1))) for one in (found, blind))
    # starts are set right to first order in the delay: of 16 ms in motions of 15 rad/s that leaves a tenth or two
    assert np.sqrt(left / all_of_it).max() < 0.25


# --- drive and floor ---


@pytest.mark.slow
def test_friction_that_grows_with_the_load_is_that_of_each_sample():
    mu, robot = np.array([0.3, 0.2, 0.1]), alten(FRICTION)
    torques, states = 0.5 * TO_AND_FRO, [LEANING]
    for u in torques[:-1]:
        grown = tuple(float(c) for c in np.array(FRICTION.coulomb) + mu * np.abs(u))
        states.append(
            Model(robot.replace(friction=replace(FRICTION, coulomb=grown))).advance(states[-1], u, 0.005)
        )
    log = log_of(states, torques)
    assert np.abs(residuals(log, {"load": [*mu]})).max() < ROUNDING
    assert np.abs(residuals(log, {"delay": [0.0]})).max() > 1e-4


@pytest.mark.slow
def test_a_ball_that_pivots_is_predicted_from_its_spin():
    plant, torques = Model(alten(FRICTION), pivoting=0.05), 0.4 + 0.3 * TO_AND_FRO
    states = [np.array([0, 0, 0.02, -0.01, 0.3, 0.1, 0, 0, 0, 0.2, 0.4])]
    for u in torques[:-1]:
        states.append(plant.advance(states[-1], u, 0.005))
    x = np.array(states)
    log = with_speeds(log_of([*x[:, :10]], torques), plant.wheel_speed(x[:, :5], x[:, 5:]))
    assert np.abs(residuals(log, {"pivoting": [0.05]})).max() < ROUNDING
    assert np.abs(residuals(log, {"delay": [0.0]})[:, :, PSI]).max() > 1e-3


def test_pivoting_that_is_found_is_the_robot_s_arm_and_stays_where_it_is_not_estimated():
    robot = alten(FRICTION).replace({"friction.pivoting": 0.004})
    layout, plain = (Layout(wheel_count=3, extra=extra) for extra in (("pivoting",), ()))
    values = layout.nominal(robot)
    assert layout.number("pivoting", values) == pytest.approx(0.004 * robot.weight)
    for torque, arm in ((0.2, 0.2 / robot.weight), (0.0, 1e-6)):
        assert layout.robot_of(robot, np.append(values[:-1], torque)).friction.pivoting == pytest.approx(arm)
    assert plain.robot_of(robot, plain.nominal(robot)).friction.pivoting == 0.004
    unsure = robot.annotated(standard_deviations={"friction.pivoting": 0.004})
    assert all(one.friction.pivoting > 0.0 for one in draw_robots(unsure, 20, seed=0))  # zero means unknown


def showing(log: Log, share: float) -> Log:
    """Return the log with the wheel speeds of a ball that turns along by the rest of the heading's rate."""
    q_dot = log.states[:, 5:] * [1.0, 1.0, 1.0, 1.0, share]
    return with_speeds(log, Model(alten()).wheel_speed(log.states[:, :5], q_dot))


@pytest.mark.slow
def test_heading_error_unseen_by_the_wheels_is_reported():
    share = share_shown(showing(moving_log(), 0.4), alten())
    # the axis that psi_dot turns about leans by less than 0.1 rad from the vertical
    assert share == pytest.approx(0.4, abs=0.01)
    (finding,) = heading_findings([share, None], excluded_states=(), estimated=())
    assert finding.text.startswith("The wheels show only 40 % of the turning of the heading")


def test_usual_friction_of_heavy_robots_grows_with_the_load_of_a_wheel_and_light_ones_keep_it():
    light, heavy = Robot.load("rob311"), Robot.load("cmu")
    load = wheel_load(heavy) * heavy.wheels.radius
    for name in ("viscous", "coulomb", "stribeck"):
        usual = BY_NAME[name].limits(light)[:, 1]
        np.testing.assert_allclose(usual, BY_NAME[name].bounds[1])
        # the usual friction is stated for 5 N m of load times radius
        np.testing.assert_allclose(BY_NAME[name].limits(heavy)[:, 1], usual[0] * load / 5.0)
