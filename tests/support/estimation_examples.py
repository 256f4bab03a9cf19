"""Robots whose motion and sensors the filter's tests make for themselves, without the filter's own equations.

The body sways as prescribed; the ball's speed follows from the momentum about the floor's contact, in the world's frame
(the filter has it in the heading's); the wheels see A (R^T Omega - w).
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ballbot.arrays import Floats
from ballbot.estimation.interface import Reading
from ballbot.estimation.kalman import KalmanFilter
from ballbot.estimation.kalman_model import (
    BIAS,
    COVARIANCE,
    LOWER_TRIANGLE,
    PSI,
    STATES,
    FilterNoise,
    G,
    S,
    X,
)
from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms
from ballbot.robot import Robot

ALTEN = Robot.load("alten")
H = 0.005


@dataclass(frozen=True)
class Run:
    """True states (N, 10), true gyro bias (3,) and the sensors' readings."""

    truth: Floats
    bias: Floats
    readings: list[Reading]


def light_wheels() -> Robot:
    """The robot with wheels and rotors that weigh nothing, whose momentum has a formula on one line."""
    return ALTEN.replace({"wheels.inertia": 1e-12, "drive.motor_inertia": 1e-16, "drive.gear_inertia": 1e-16})


def swaying(
    *,
    samples: int,
    seed: int,
    noise: FilterNoise,
    turning: float = 0.2,
    pivot: Floats | None = None,
) -> Run:
    """A robot that sways and turns with noise of the sizes given; `pivot` (samples,) is the ball's spin [rad/s]."""
    random = np.random.default_rng(seed)
    fine = 10  # steps of the truth in a sample
    t = np.linspace(0.0, samples * H, samples * fine + 1)
    truth = _motion(t, random, noise, turning)
    rate = np.einsum("nij,nj->ni", body_rates_matrix(*truth[:, 2:5].T), truth[:, 7:])
    spin = np.zeros(len(t)) if pivot is None else np.repeat(np.append(pivot, 0.0), fine)[: len(t)]
    ball = np.column_stack((-truth[:, 6], truth[:, 5], ALTEN.ball.radius * spin)) / ALTEN.ball.radius
    relative = np.einsum("nji,nj->ni", rotation(*truth[:, 2:5].T), ball) - rate
    wheels = relative @ transforms(ALTEN).T_owb.T
    angles = np.vstack((np.zeros(3), np.cumsum(0.5 * (wheels[1:] + wheels[:-1]), axis=0) * H / fine))[::fine]
    truth, rate = truth[::fine], rate[::fine]
    # errors by rollers, play and slip of the distance by the wheels and of the ball's turning
    rolled = noise.rolling / ALTEN.ball.radius * random.standard_normal((samples + 1, 2))
    slip = np.column_stack((rolled, noise.pivoting * random.standard_normal(samples + 1))) * np.sqrt(H)
    slip[0] = 0.0
    slipped = np.einsum("nji,nj->ni", rotation(*truth[:, 2:5].T), slip) @ transforms(ALTEN).T_owb.T
    return _sensed(truth, rate, angles + np.cumsum(slipped, axis=0), random, noise)


def _motion(t: Floats, random: np.random.Generator, noise: FilterNoise, turning: float) -> Floats:
    """States (N, 10): lean and heading as prescribed, speed by gravity's integral, place by the speed's."""
    robot, step = ALTEN, t[1]
    periods, phases = random.uniform(1.5, 4.0, 2), random.uniform(0, 2 * np.pi, 2)
    lean = 0.02 * np.sin(2 * np.pi * t[:, None] / periods + phases)
    lean_dot = 0.02 * 2 * np.pi / periods * np.cos(2 * np.pi * t[:, None] / periods + phases)
    # momentum about the contact in the world's frame, by the planar two-body formula (wheels weigh nothing)
    body, ball = robot.body, robot.ball
    mass = ball.mass + ball.inertia / ball.radius**2 + body.mass
    lever, inertia = body.mass * body.center_of_mass, body.inertia_matrix()[0, 0]
    whole = mass + lever / ball.radius
    tilt = np.column_stack((lean[:, 1], -lean[:, 0]))
    tilt_dot = np.column_stack((lean_dot[:, 1], -lean_dot[:, 0]))
    pushes = noise.push * np.sqrt(step) * random.standard_normal((len(t), 2))
    pull = robot.gravity * lever / ball.radius / whole
    momentum = np.cumsum(pull * tilt * step + pushes, axis=0) - pull * tilt[0] * step - pushes[0]
    start = (inertia / ball.radius + lever) / whole * tilt_dot[0]
    velocity = momentum + start - (inertia / ball.radius + lever) / whole * tilt_dot
    truth = np.zeros((len(t), 10))
    truth[:, 2:4], truth[:, 7:9] = lean, lean_dot
    truth[:, 4], truth[:, 9] = turning * t, turning
    truth[:, 5:7] = velocity + noise.start_speed * random.standard_normal(2)
    truth[1:, :2] = np.cumsum(0.5 * (truth[1:, 5:7] + truth[:-1, 5:7]), axis=0) * step
    truth[:, :2] += noise.start_position * random.standard_normal(2)
    return truth


def _sensed(
    truth: Floats,
    rate: Floats,
    angles: Floats,
    random: np.random.Generator,
    noise: FilterNoise,
) -> Run:
    count = len(truth)
    bias = np.array([noise.gyro_bias, noise.gyro_bias, noise.heading_bias]) * random.standard_normal(3)
    gyro = rate + bias + noise.gyro * random.standard_normal((count, 3))
    attitude = truth[:, 2:5] + noise.attitude * random.standard_normal((count, 3))
    memory = np.exp(-H / noise.lean_error_time)
    slow = np.empty((count, 2))
    slow[0] = noise.lean_error * random.standard_normal(2)
    for k in range(1, count):
        fresh = noise.lean_error * np.sqrt(1 - memory**2) * random.standard_normal(2)
        slow[k] = memory * slow[k - 1] + fresh
    sine, cosine = np.sin(truth[:, 4]), np.cos(truth[:, 4])  # the error turns with the body
    attitude[:, 0] += sine * slow[:, 0] + cosine * slow[:, 1]
    attitude[:, 1] -= cosine * slow[:, 0] - sine * slow[:, 1]
    walk = noise.heading_walk * np.sqrt(H) * random.standard_normal(count)
    drift = (noise.heading_drift * random.standard_normal() + bias[2]) * H * np.arange(count)
    attitude = turned(attitude, noise.start_heading * random.standard_normal() + drift + np.cumsum(walk))
    readings = [
        Reading(wheel_angles=a, wheel_speeds=np.zeros(3), gyro=g, attitude=e)
        for a, g, e in zip(angles, gyro, attitude, strict=True)
    ]
    return Run(truth, bias, readings)


def turned(attitude: Floats, angle: Floats) -> Floats:
    """theta, phi, psi (N, 3) as an AHRS has them whose frame has turned away by -angle (N,), by scipy's rotations."""
    away = Rotation.from_euler("Z", angle[:, None]) * Rotation.from_euler("XYZ", attitude)
    found = away.as_euler("XYZ")
    turns = np.round((attitude[:, 2] + angle - found[:, 2]) / (2 * np.pi))
    return np.column_stack((found[:, :2], found[:, 2] + 2 * np.pi * turns))


def all_covariances(kalman: KalmanFilter) -> Floats:
    """Return the covariance (14, 14) of a filter's states."""
    P = np.zeros((STATES, STATES))
    P[LOWER_TRIANGLE] = kalman._column[COVARIANCE : COVARIANCE + len(LOWER_TRIANGLE[0])]
    return P + np.tril(P, -1).T


def covariance_of(kalman: KalmanFilter) -> Floats:
    """Return the covariance (7, 7) of x, y, theta, phi, psi and the ball's velocity, as `update` returns them.

    theta, phi and psi to first order in the lean.
    """
    s3, c3 = math.sin(kalman._x[PSI]), math.cos(kalman._x[PSI])
    turn = np.array([[c3, -s3], [s3, c3]])
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    swap = -quarter  # theta, phi = swap Rz g
    rows = np.zeros((7, STATES))
    rows[0, X], rows[1, X + 1], rows[4, PSI] = 1.0, 1.0, 1.0
    rows[2:4, G : G + 2] = swap @ turn
    rows[2:4, PSI] = swap @ turn @ quarter @ kalman._x[G : G + 2]
    rows[5:, S : S + 2] = turn
    lever, rate = kalman._model.lever, kalman._memory["gyro"][0] - kalman._x[BIAS : BIAS + 3]
    rows[5:, PSI] = turn @ quarter @ (kalman._x[S : S + 2] - lever @ rate)
    rows[5:, BIAS : BIAS + 3] = turn @ lever
    covariance = rows @ all_covariances(kalman) @ rows.T
    by_gyro = rows[5:, BIAS : BIAS + 3]  # a sample's noise moves v as a bias of that sample would
    covariance[5:, 5:] += kalman._model.gyro_variance * by_gyro @ by_gyro.T
    return covariance
