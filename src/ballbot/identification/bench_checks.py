"""Checks of bench logs: sweeps of free wheels, and the ball on the clamped robot.

    J dx/dt = A^T (g u - b w - c sgn w),   w = A x,   one gain g, b and c a wheel

with the ball's angular velocity x is integrated over pieces of 0.1 s and fitted. A free wheel is an axis whose gain is
the inertia in the file over that of the inverse model. Gains of 1 show that torques, axes and units are right; other
gains are reported with their usual causes.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import every
from ballbot.findings import Finding, error, warning
from ballbot.fitting.least_squares import fit_linear
from ballbot.identification.axis.model import AxisModel
from ballbot.identification.axis.motion import inverse_model, motion_of
from ballbot.identification.driveline import BALL_NAMES, LIMITED, Sweep
from ballbot.identification.upside_down import encoder_speeds
from ballbot.log import Log
from ballbot.log.columns import torque_names, wheel_speed_names
from ballbot.log.signals import longest_repeat
from ballbot.log.units import unit_of_ratio
from ballbot.robot import Robot
from ballbot.simulation.upside_down import ClampedBall

#: length of the pieces [s], and least number of them
_PIECE, _LEAST_PIECES = 0.1, 20
#: gains without a warning, and without an error: slip and play take up to a quarter of a torque, and inertias of rotors
#: are often known to a factor of two only
_USUAL, _POSSIBLE = (0.6, 1.6), (0.4, 2.5)
#: least share of the changes of speed that the equation explains
_EXPLAINED = 0.4
#: a gain is a unit's if it is away from its factor by less than this factor: slip and play take up to a quarter
_NEAR = 1.33
#: wheel speeds by the encoders over those by the ball
_LIKE_ENCODERS = (0.85, 1.18)
#: [s] and rows for which a frozen speed repeats
_FROZEN, _FROZEN_ROWS = 0.25, 20


def sweep_findings(robot: Robot, sweeps: Sequence[Sweep]) -> tuple[Finding, ...]:
    """Return findings on the sweeps of all wheels; InputError if one does not determine the inertia."""
    names = wheel_speed_names(len(sweeps))
    moving = [np.where(np.abs(sweep.speed) < LIMITED * sweep.limit, sweep.speed, 0.0) for sweep in sweeps]
    findings = [
        finding
        for sweep, speed, name in zip(sweeps, moving, names, strict=True)
        for finding in _frozen(sweep.t, speed[:, None], (name,))
    ]
    if findings:
        return tuple(findings)
    gains, explained = np.zeros(len(sweeps)), np.zeros(len(sweeps))
    for i in np.flatnonzero([np.any(sweep.speed) for sweep in sweeps]).tolist():
        inverse = inverse_model([motion_of(sweeps[i].record())], AxisModel(law="coulomb"))
        explained[i] = max(inverse.explained, 0.0)
        # without relation between torque and motion there is no gain
        if explained[i] >= _EXPLAINED:
            gains[i] = sweeps[i].inertia / inverse.values["mass"]
    return tuple(_of_torques(robot, gains.tolist(), float(np.mean(explained)), names))


def upside_down_findings(robot: Robot, log: Log) -> tuple[Finding, ...]:
    """Return findings on a log with ball_omega_x, _y, _z: on its torques, and on wheel speeds or angles."""
    findings, names = encoder_findings(robot, log), torque_names(robot.wheel_count)
    ball = ClampedBall.of_robot(robot)
    if findings or not all(name in log for name in names):
        return findings
    omega, torques = (np.column_stack([log[name] for name in group]) for group in (BALL_NAMES, names))
    h = log.sample_time
    length = max(2, round(_PIECE / h))
    rows = np.arange(0, len(omega) - length, length)[:, None] + np.arange(length + 1)
    rows = rows[np.isfinite(np.concatenate([omega[rows], torques[rows]], axis=2)).all(axis=(1, 2))]
    if len(rows) < _LEAST_PIECES or not (np.any(torques) and np.any(omega)):
        return findings
    x, u = omega[rows], torques[rows]
    w = x[:, :-1] @ ball.A.T
    change = ((x[:, -1] - x[:, 0]) @ ball.inertia).ravel()
    parts = (u[:, :-1].sum(axis=1), w.sum(axis=1), np.sign(w).sum(axis=1))
    X = np.concatenate([h * part[:, None, :] * ball.A.T for part in parts], axis=2).reshape(change.size, -1)
    fit = fit_linear(X, change, np.repeat(np.arange(len(x)), 3))
    explained = 1.0 - float(np.var(fit.residuals) / (np.var(change) or 1.0))
    return tuple(_of_torques(robot, fit.values[: len(names)].tolist(), explained, BALL_NAMES))


def _frozen(t: Floats, values: Floats, names: Sequence[str]) -> Iterator[Finding]:
    """Yield an error if values (N, k) repeat all together for long, other than at rest."""
    moving = np.any(values != 0.0, axis=1, keepdims=True)
    first, last = longest_repeat(np.where(moving, values, np.nan))
    if last - first + 1 >= _FROZEN_ROWS and t[last] - t[first] > _FROZEN:
        text = (
            f"{' and '.join(names)} repeat{'s' if len(names) == 1 else ''} one value for {t[last] - t[first]:.2g} s "
            f"from t = {t[first]:.4g} s on: the sensor or the log froze. Remove that interval."
        )
        yield error("stuck", text, *names, time=float(t[first]))


def encoder_findings(
    robot: Robot, log: Log, *, like: tuple[float, float] = _LIKE_ENCODERS
) -> tuple[Finding, ...]:
    """Return an error if the encoders, if there are any, contradict the ball's angular velocity.

    `like` is the range of wheel speeds by the encoders over those by the ball and the robot's radii.
    """
    omega, A = np.column_stack([log[name] for name in BALL_NAMES]), ClampedBall.of_robot(robot).A
    frozen, speeds = tuple(_frozen(log.t, omega, BALL_NAMES)), encoder_speeds(log, len(A))
    wheels = np.column_stack(speeds) if speeds else np.full((len(omega), len(A)), np.nan)
    rows = np.isfinite(np.hstack([wheels, omega])).all(axis=1)
    wheels, omega = wheels[rows], omega[rows]
    if len(omega) < 10 or not np.any(wheels) or not np.any(omega):
        return frozen
    expected = omega @ A.T
    slope = float((expected * wheels).sum() / (expected**2).sum())
    left = float(np.linalg.norm(wheels - slope * expected) / np.linalg.norm(wheels))
    if left < 0.5 and like[0] < slope < like[1]:
        return frozen
    if left < 0.5 and slope < 0.0:
        text = (
            "The wheels turn against the ball: ball_omega on all axes, or all wheels, have the opposite sign."
        )
    elif left < 0.5:
        wheels_in, ball_in = (unit_of_ratio(ratio, "rad/s", within=_NEAR) for ratio in (slope, 1.0 / slope))
        looks = f"wheel speeds look like {wheels_in}" if wheels_in else f"ball_omega looks like {ball_in}"
        cause = f"{looks}, not rad/s" if wheels_in or ball_in else "ball.radius or wheels.radius is wrong"
        text = f"The wheels turn {slope:.3g} times as fast as the ball's angular velocity implies: {cause}."
    else:
        # the ball's axes as the wheels show them: rows of a matrix from those logged
        axes = np.linalg.lstsq(omega, wheels @ np.linalg.pinv(A).T, rcond=None)[0].T
        shown = [f"({', '.join(f'{entry + 0.0:.1f}' for entry in row)})" for row in np.round(axes, 1)]
        text = (
            "The wheels do not turn as the ball's angular velocity implies. From the wheels, the ball's x, y and z are "
            f"{every(shown)} times the logged ball_omega_x, _y and _z: rows with a single 1 or -1 mean that axes are "
            "exchanged or negated; anything else means another order of the wheels, another frame, another log, or "
            "azimuths that differ from the robot file."
        )
    return (*frozen, error("ball-omega", text, *BALL_NAMES, *wheel_speed_names(len(A))))


def _of_torques(
    robot: Robot, gains: Sequence[float], explained: float, moved: Sequence[str]
) -> Iterator[Finding]:
    """Yield findings on gains (n,) of torques that explain a share of the changes of speed in columns `moved`."""
    names = torque_names(len(gains))
    if explained > _EXPLAINED and all(_POSSIBLE[0] < gain < _POSSIBLE[1] for gain in gains):
        for name, gain in zip(names, gains, strict=True):
            if not _USUAL[0] < gain < _USUAL[1]:
                text = (
                    f"The motion shows {gain:.2g} times {name}; check the scale of that torque, wheels.inertia, "
                    "drive.motor_inertia, drive.gear_ratio, and whether the wheel slips."
                )
                yield warning("torque-scale", text, name)
        return
    drive, common = robot.drive, float(np.median(gains))
    alike = explained > _EXPLAINED and all(common / _NEAR < gain < common * _NEAR for gain in gains)
    speeds = unit_of_ratio(common, "rad/s", within=_NEAR) if alike else None
    torques = unit_of_ratio(1.0 / common, "N m", within=_NEAR) if alike else None
    cause = (
        "It is -1 if a torque, or what it moves, has the opposite sign; 0 if it was not logged or its motor is dead; "
        f"{drive.gear_ratio:.3g} if one of the two is the motors', before the gear; "
        f"{drive.gear_ratio * drive.torque_constant:.2g} if the torques are currents in A. Several that are off at "
        "once: torques in another order, the ball's axes exchanged, columns of another log, a delay, or a robot that "
        "is not clamped."
    )
    if speeds or torques:
        cause = (
            f"The speeds look like {speeds}, not rad/s."
            if speeds
            else f"The torques look like {torques}, not N m."
        )
    text = (
        f"The motion shows {every([f'{round(gain, 6) + 0.0:.2g}' for gain in gains])} times {every(names)}, which "
        f"explain {100.0 * max(0.0, explained):.0f} % of the changes of speed; each should be 1. {cause}"
    )
    signs_alone = explained > _EXPLAINED and all(_POSSIBLE[0] < abs(gain) < _POSSIBLE[1] for gain in gains)
    yield error("torque-sign" if signs_alone else "torque-scale", text, *names, *moved)
