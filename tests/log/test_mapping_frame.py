"""The frame of the IMU, which turns with the robot, in mappings of foreign logs: signals made from their equations."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from ballbot.log.mapping_inference.evidence import CONFIDENT
from ballbot.log.mapping_inference.file_signals import GyroTest, Raw, gyro_of, signals_of
from ballbot.log.mapping_inference.frame import HeadingTest, frame_of, heading_test
from ballbot.log.mapping_inference.gyro_handedness import GYRO_ERRORS, handedness_by_gyro
from ballbot.log.mapping_inference.placement import _advantage, lean_test, torque_free_gains
from ballbot.log.mapping_inference.roles import roles_by_name
from ballbot.log.mapping_inference.units import Scale
from ballbot.log.signals import INTERVAL, Smooth
from ballbot.robot import Friction, Robot
from tests.support.foreign_log_examples import small_robot

ROWS = (INTERVAL * np.arange(4000)).astype(np.float64)
EVERY = np.ones(len(ROWS), dtype=np.bool_)


def slow_sines(random: np.random.Generator, size: float) -> list[np.ndarray]:
    """Return a sum of sines (N,) with its first and second derivative; frequencies from 2 to 6 rad/s."""
    value, rate, acceleration = (np.zeros(len(ROWS)) for _ in range(3))
    for w in random.uniform(2.0, 6.0, 3):
        phase = w * ROWS + random.uniform(0.0, 2.0 * np.pi)
        value, rate = value + size * np.sin(phase), rate + size * w * np.cos(phase)
        acceleration = acceleration - size * w**2 * np.sin(phase)
    return [value, rate, acceleration]


def rolling(
    robot: Robot, *, turn_rate: float, sigma: float = 1.0, imu_turn: float = 0.0, seed: int = 3
) -> tuple[Smooth, Smooth, Smooth]:
    """Return lean, wheels and heading that follow the law of the rolling ball exactly while the heading sways."""
    random = np.random.default_rng(seed)
    kappa, gamma = torque_free_gains(robot)
    x, y = slow_sines(random, 0.01), slow_sines(random, 0.01)
    theta, theta_dot, theta_ddot = (a + 1j * b for a, b in zip(x, y, strict=True))
    psi, psi_dot, psi_ddot = turn_rate * np.array([np.sin(ROWS), np.cos(ROWS), -np.sin(ROWS)])
    # as the world sees it, the law has no terms of the turning frame
    twist = np.exp(1j * psi)
    turned = theta_ddot + 2j * psi_dot * theta_dot + (1j * psi_ddot - psi_dot**2 - kappa) * theta
    world = turned * twist / gamma
    W = np.cumsum(world - world.mean()) * INTERVAL / twist
    W_dot = (world - world.mean()) / twist - 1j * psi_dot * W
    azimuths = np.asarray(robot.wheels.azimuths)
    # W is the sum of w_i e^{j beta}; a heading turns all wheels alike
    speeds, accelerations = (
        2.0 / len(azimuths) * np.real(one[:, None] * np.exp(-1j * azimuths)) - 2.0 * turning[:, None]
        for one, turning in ((W, psi_dot), (W_dot, psi_ddot))
    )
    wheels = Smooth(value=np.cumsum(speeds, axis=0) * INTERVAL, rate=speeds, acceleration=accelerations)
    seen = [one * np.exp(-1j * imu_turn) for one in (theta, theta_dot, theta_ddot)]
    if sigma < 0.0:
        seen = [one.conj() for one in seen]
    value, rate, acceleration = (np.column_stack([one.real, one.imag]) for one in seen)
    heading = Smooth(value=psi[:, None], rate=psi_dot[:, None], acceleration=psi_ddot[:, None])
    return Smooth(value=value, rate=rate, acceleration=acceleration), wheels, heading


@pytest.mark.parametrize("sigma", [1.0, -1.0])
@pytest.mark.parametrize("turn_rate", [0.0, 0.8])
def test_a_robot_that_turns_while_it_rolls_keeps_gain_and_phase(turn_rate, sigma):
    sigma = sigma if turn_rate else 1.0
    robot = small_robot()
    lean, wheels, heading = rolling(robot, turn_rate=turn_rate, sigma=sigma, imu_turn=0.4)
    found = lean_test(robot, lean, wheels, heading, EVERY)
    assert found is not None
    frame, best = frame_of(robot, found, heading_test(robot, wheels, heading, found)), found.placements[0]
    assert frame.order == (1, 2, 3)
    assert frame.axis_signs[1] == sigma
    # 2 %: signals with no noise, sampled every 5 ms, and the lag that is estimated
    assert best.gain == pytest.approx(1.0, abs=0.02)
    assert best.unexplained < 0.01
    # up to a third of a turn of the robot, with the wheels renamed
    assert abs(np.angle(np.exp(3j * (frame.measured_turn - 0.4)))) / 3.0 < np.radians(1.0)


@pytest.mark.parametrize("count", [1.0, -1.0])
@pytest.mark.parametrize("imu_turn", [0.4, 3.0])
def test_without_a_yaw_a_robot_that_turns_shows_in_which_direction_its_wheels_count(imu_turn, count):
    robot = small_robot()
    lean, wheels, heading = rolling(robot, turn_rate=0.8, imu_turn=imu_turn)
    # the wheels of `rolling` turn by twice the heading's rate; those of a ball that does not spin by this
    own = robot.wheels
    by_heading = robot.ball.radius / own.radius * math.sin(own.tilt)
    value, rate, acceleration = (
        count * (wheel - (by_heading - 2.0) * turn)
        for wheel, turn in zip(
            (wheels.value, wheels.rate, wheels.acceleration),
            (heading.value, heading.rate, heading.acceleration),
            strict=True,
        )
    )
    found = lean_test(robot, lean, Smooth(value=value, rate=rate, acceleration=acceleration), None, EVERY)
    assert found is not None
    frame = frame_of(robot, found, None)
    assert frame.signs == (int(count),) * 3
    assert frame.direction > CONFIDENT
    assert found.headings == pytest.approx(float(np.std(heading.value)), rel=0.05)
    # up to a third of a turn of the robot, with the wheels renamed
    assert abs(np.angle(np.exp(3j * (frame.measured_turn - imu_turn)))) / 3.0 < np.radians(1.0)


def test_four_wheels_without_a_heading_are_those_that_a_ball_can_turn():
    """Opposite wheels exchanged and negated explain the lean as well, but then the ball would have to slip."""
    own = small_robot()
    wheels = replace(own.wheels, azimuths=tuple(0.5 * np.pi * k for k in range(4)))
    robot = own.replace(wheels=wheels, friction=Friction.none(4))
    lean, turned, _ = rolling(robot, turn_rate=0.1)
    found = lean_test(robot, lean, turned, None, EVERY)
    assert found is not None
    best, other = found.placements[:2]
    assert (best.positions, best.signs) == ((1, 2, 3, 4), (1, 1, 1, 1))
    assert max(best.unexplained, other.unexplained) < 0.01
    assert found.confidence > CONFIDENT


def exact_gyro(
    random: np.random.Generator, *, lean: float = 0.02, heading: float = 0.5
) -> tuple[np.ndarray, np.ndarray]:
    """Return roll, pitch and yaw [rad] of these sizes, and a gyro's rates of the aerospace order [rad/s]."""
    roll, pitch = slow_sines(random, lean), slow_sines(random, lean)
    yaw, yaw_dot = heading * np.sin(ROWS), heading * np.cos(ROWS)
    gyro = np.column_stack(
        [
            roll[1] - yaw_dot * np.sin(pitch[0]),
            pitch[1] * np.cos(roll[0]) + yaw_dot * np.sin(roll[0]) * np.cos(pitch[0]),
            -pitch[1] * np.sin(roll[0]) + yaw_dot * np.cos(roll[0]) * np.cos(pitch[0]),
        ]
    )
    return np.column_stack([roll[0], pitch[0], yaw]), gyro


def raw_counts(per_degree: float, *, yaw: bool, offset: float = 0.0) -> GyroTest | None:
    """Return the test of a gyro that counts so often for a deg/s, its z with an offset [rad/s]."""
    random = np.random.default_rng(5)
    angles, gyro = exact_gyro(random)
    wheels = np.column_stack([np.sin(2.0 * ROWS + k) - 2.0 * angles[:, 2] for k in range(3)])
    angles = angles[:, : 3 if yaw else 2]
    angles[:, :2] += 5e-4 * random.standard_normal((len(ROWS), 2))
    columns = {"gx": gyro[:, 0], "gy": gyro[:, 1], "gz": gyro[:, 2] + offset}
    counted = {name: np.round(np.degrees(one) * per_degree) for name, one in columns.items()}
    names = ["t", "enc1", "enc2", "enc3", *columns]
    table = counted | {"t": ROWS} | {f"enc{k + 1}": one for k, one in enumerate(wheels.T)}
    time = Scale(unit="s", factor=1.0, reason="")
    raw = Raw.of(table, roles_by_name(names, wheel_count=3), time)
    assert raw.gyro_counts
    return gyro_of(raw, signals_of(raw, wheels, ROWS, angles, width=0.05), ROWS, angles)


@pytest.mark.parametrize("per_degree", [131.0, 1000.0 / 8.75, 32.8, 1000.0 / 35.0])
@pytest.mark.parametrize("yaw", [True, False])
def test_a_gyro_in_counts_of_a_common_scale_is_recognised(per_degree, yaw):
    found = raw_counts(per_degree, yaw=yaw)
    assert found is not None
    assert found.confidence > CONFIDENT
    assert 1.0 / found.scale == pytest.approx(per_degree)
    assert found.factor == pytest.approx(np.radians(1.0 / per_degree))


@pytest.mark.parametrize("per_degree", [122.0, 45.0, 100.0])
def test_a_gyro_in_counts_of_no_common_scale_is_not_taken(per_degree):
    found = raw_counts(per_degree, yaw=True)
    assert found is not None
    assert found.confidence < CONFIDENT


def test_a_gyro_in_counts_whose_offset_turns_the_heading_is_not_integrated():
    found = raw_counts(131.0, yaw=False, offset=np.radians(2.0))
    assert found is not None
    assert found.confidence < CONFIDENT


@given(pitch_sign=st.sampled_from([1, -1]), yaw_sign=st.sampled_from([1, -1]), seed=st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=10)
def test_a_gyro_shows_the_handedness_of_its_angles(pitch_sign, yaw_sign, seed):
    random = np.random.default_rng(seed)
    angles, gyro = exact_gyro(random)
    gyro = gyro * [1, pitch_sign, yaw_sign]
    angles = angles * [1, pitch_sign, yaw_sign]
    angles[:, :2] += 5e-4 * random.standard_normal((len(ROWS), 2))
    wheels = np.column_stack([np.sin(2.0 * ROWS + k) for k in range(3)])
    raw = Raw(t=ROWS, angles=wheels, attitude=angles, commands=None, gyro=gyro, gyro_unit=None)
    found = gyro_of(raw, signals_of(raw, wheels, ROWS, angles, width=0.05), ROWS, angles)
    assert found is not None
    assert found.handedness == pytest.approx(pitch_sign * yaw_sign, abs=0.1)
    assert found.handedness_error < 0.03
    assert found.lag == 0.0


@pytest.mark.parametrize("later", [0, 3])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_angles_are_later_than_a_gyro_only_if_they_are(later, seed):
    """Motors respond to the noise of the angles 20 ms later, as large as the motion itself."""
    random = np.random.default_rng(seed)
    angles, gyro = exact_gyro(random, lean=0.004)
    noise = 2e-3 * random.standard_normal((len(ROWS), 2))
    swung = lfilter([0.03], [1.0, -1.93, 0.95], np.roll(noise, 4, axis=0), axis=0)
    angles[:, :2] += swung
    gyro[:, :2] += np.gradient(swung, INTERVAL, axis=0)
    angles = np.roll(angles, later, axis=0)
    angles[:, :2] += noise
    wheels = np.column_stack([np.sin(2.0 * ROWS + k) for k in range(3)])
    raw = Raw(t=ROWS, angles=wheels, attitude=angles, commands=None, gyro=gyro, gyro_unit=None)
    found = gyro_of(raw, signals_of(raw, wheels, ROWS, angles, width=0.05), ROWS, angles)
    assert found is not None
    # half a row: by noise alone the estimate is off by a tenth of that
    assert found.lag == pytest.approx(later * INTERVAL, abs=0.5 * INTERVAL)


@pytest.mark.parametrize(
    "case", ["noise of the angles", "noise of the gyro", "angles drawn to the accelerometer"]
)
def test_the_error_of_the_handedness_is_what_short_logs_are_off(case):
    """Logs of 6 s, with noise of which the rates of the angles would show nothing."""
    short, off = ROWS <= 6.0, []
    t = ROWS[short]
    for seed in range(30):
        random = np.random.default_rng(seed)
        angles, gyro = (one[short] for one in exact_gyro(random, lean=0.006, heading=0.2))
        noise = random.standard_normal((len(t), 2))
        if case == "noise of the angles":
            angles[:, :2] += 2e-3 * noise
        elif case == "noise of the gyro":
            gyro[:, :2] += 0.01 * noise
        else:  # accelerations that last half a second, of which a filter of a second keeps a part
            lasting = lfilter([0.14], [1.0, -0.99], 0.05 * noise, axis=0)
            angles[:, :2] += lfilter([0.005], [1.0, -0.995], lasting, axis=0)
        turning = np.gradient(angles[:, 2], t)
        sigma, error = handedness_by_gyro(t, angles, gyro[:, :2], turning, np.ones(len(t), dtype=bool))
        off.append((sigma - 1.0) / error)
    # 30 estimates know their root mean square to an eighth
    assert np.sqrt(np.mean(np.square(off))) < GYRO_ERRORS * 1.25, off


def test_a_direction_of_all_wheels_that_is_stated_with_confidence_is_the_headings():
    """Below that confidence the smaller turn of the IMU is taken, and asked for."""
    robot = small_robot()
    lean, wheels, _ = rolling(robot, turn_rate=0.0)
    found = lean_test(robot, lean, wheels, None, EVERY)
    assert found is not None
    for confidence, follows in ((CONFIDENT, True), (CONFIDENT - 0.01, False)):
        against, along = (
            frame_of(robot, found, HeadingTest(correlation=sign, gain=sign, confidence=confidence)).signs
            for sign in (-0.7, 0.7)
        )
        assert (against == tuple(-sign for sign in along)) == follows
        assert against == (1, 1, 1)


@pytest.mark.parametrize("blocks", [3, 5, 20])
def test_explanations_that_are_equally_good_differ_as_chance_does_however_few_blocks_there_are(blocks):
    random, count = np.random.default_rng(7), 2000
    weights = np.ones(round(blocks / INTERVAL))
    found = [_advantage(*(10.0 + random.standard_normal((2, blocks))), weights) for _ in range(count)]
    # three standard errors of a share of 2000
    for deviate, share in ((1.0, 0.317), (1.645, 0.100)):
        error = 3.0 * math.sqrt(share * (1.0 - share) / count)
        assert np.mean(np.abs(found) > deviate) == pytest.approx(share, abs=error)


@pytest.mark.parametrize(("share", "pushed"), [(0.02, False), (0.5, True)])
def test_a_second_is_a_push_only_if_the_wheels_do_not_explain_it(share, pushed):
    """What quick motion leaves may be five times the usual, and is still little beside the motion."""
    lean, wheels, heading = rolling(small_robot(), turn_rate=0.8)
    random, size = np.random.default_rng(6), np.sqrt(np.square(lean.acceleration).mean())
    noise = 0.02 * size * random.standard_normal(lean.acceleration.shape)
    second = slice(2000, 2200)
    whole = np.sqrt(np.square(lean.acceleration[second]).mean())
    noise[second] = math.sqrt(share) * whole * random.standard_normal(noise[second].shape)
    found = lean_test(
        small_robot(), replace(lean, acceleration=lean.acceleration + noise), wheels, heading, EVERY
    )
    assert found is not None
    assert found.pushed[2050:2150].all() == pushed
    assert found.pushed.any() == pushed
