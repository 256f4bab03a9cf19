"""Whether logs of the bench are what they say: sweeps of free wheels, and the ball on the clamped robot.

    J dx/dt = A^T (g u - b w - c sgn w),   w = A x,   one gain g, b and c a wheel

with the ball's angular velocity x, or with A = 1 and the speeds of free wheels, is fitted to pieces of 0.1 s, each an
integral over time, so that nothing is differentiated. Torque and friction of a slow sweep are nearly the same: there
1 / g is found of each wheel, the inertia that its torque shows over the file's. Gains of one show that torques, axes
and units are right. If they are not, the torques are tried in other orders, and the ball's axes too. The finding names
every change that makes the gains right, because such a log does not distinguish them. Encoders, where they are logged,
show the ball's axes and unit by themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import every
from ballbot.findings import Finding, by_severity, error, warning
from ballbot.fitting.least_squares import fit_linear
from ballbot.identification.driveline import BALL_NAMES, LIMITED, Sweep
from ballbot.identification.upside_down import encoder_speeds
from ballbot.log import Log
from ballbot.log.columns import torque_names, wheel_speed_names
from ballbot.log.signals import longest_repeat
from ballbot.robot import Robot
from ballbot.simulation.upside_down import ClampedBall

#: length of the pieces [s], and the fewest of them for each number
_PIECE, _LEAST_PIECES = 0.1, 20
#: gains; rollers that slip and play take up to a quarter of a torque, and rotors are often known to a factor of
#: two only
_USUAL, _POSSIBLE = (0.6, 1.6), (0.4, 2.5)
#: share of the changes of speed that the equation must explain
_EXPLAINED = 0.4
#: an explanation of a wrong log must leave less than this share of the residual of the columns as they are
_BETTER = 0.6
#: and others that leave not much more are as likely
_AS_LIKELY = 1.3
#: wheel speeds by the encoders over those by the ball
_LIKE_ENCODERS = (0.85, 1.18)
#: [s] of one and the same speed, over this many rows
_FROZEN, _FROZEN_ROWS = 0.25, 20
_AXES = "xyz"


def sweep_findings(robot: Robot, sweeps: Sequence[Sweep]) -> tuple[Finding, ...]:
    """Return the faults of the sweeps of all wheels of a robot, errors first."""
    first, names = sweeps[0], wheel_speed_names(len(sweeps))
    speeds, torques = (np.column_stack([getattr(one, key) for one in sweeps]) for key in ("speed", "torque"))
    free = np.abs(speeds) < LIMITED * first.limit
    findings = []
    for name, speed, row in zip(names, speeds.T, free.T, strict=True):
        findings += _frozen(first.t, np.where(row, speed, 0.0)[:, None], (name,))
    rows = _pieces(speeds, torques, first.sample_time)
    counted = np.asarray(free[rows].all(axis=1))
    if not findings and counted.sum() >= _LEAST_PIECES * len(sweeps):
        fit_of = partial(_fit_wheels, counted, first.inertia, first.sample_time)
        findings += _of_torques(robot, fit_of, speeds[rows], torques[rows], names)
    return by_severity(findings)


def upside_down_findings(robot: Robot, log: Log) -> tuple[Finding, ...]:
    """Return the faults of a log of the ball on the clamped robot, errors first.

    It has ball_omega_x, _y, _z; with u1 .. un the torques are checked, with wheel1_dot .. the axes.
    """
    findings, names = list(encoder_findings(robot, log)), torque_names(robot.wheel_count)
    if not findings and all(name in log for name in names):
        omega, torques = (np.column_stack([log[name] for name in several]) for several in (BALL_NAMES, names))
        rows = _pieces(omega, torques, log.sample_time)
        if len(rows) >= _LEAST_PIECES:
            fit_of = partial(_fit_ball, ClampedBall.of_robot(robot), log.sample_time)
            findings += _of_torques(robot, fit_of, omega[rows], torques[rows], None)
    return by_severity(findings)


def _frozen(t: NDArray[np.float64], values: NDArray[np.float64], names: Sequence[str]) -> Iterator[Finding]:
    """Yield a stretch in which values (N, k) repeat themselves all at once, beside rest."""
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
    """Return an error if the encoders contradict the ball's angular velocity; none if the log has no encoders.

    Wheel speeds by the encoders may be `like` so many times those by the ball and the robot's radii.
    """
    omega, A = np.column_stack([log[name] for name in BALL_NAMES]), ClampedBall.of_robot(robot).A
    found, speeds = list(_frozen(log.t, omega, BALL_NAMES)), encoder_speeds(log, len(A))
    wheels = np.column_stack(speeds) if speeds else np.full((len(omega), len(A)), np.nan)
    rows = np.isfinite(np.hstack([wheels, omega])).all(axis=1)
    wheels, omega = wheels[rows], omega[rows]
    if len(omega) < 10 or not np.any(wheels) or not np.any(omega):
        return tuple(found)
    slope, left = _scaled_fit(omega @ A.T, wheels)
    if left < 0.5 and like[0] < slope < like[1]:
        return tuple(found)
    if left < 0.5 and slope < 0.0:
        text = (
            "The wheels turn against the ball: ball_omega on all axes, or all wheels, have the opposite sign."
        )
    elif left < 0.5:
        text = (
            f"The wheels turn {slope:.3g} times as fast as the ball's angular velocity implies: one of the two is in "
            "another unit (rpm are 9.5 rad/s, deg/s 57), or ball.radius or wheels.radius is wrong."
        )
    else:
        fits = [
            (*_scaled_fit(one.turned(omega) @ A.T, wheels[:, one.order]), one.words)
            for one in _mistakes(len(A), "wheel{}_dot is that of wheel {}", of_ball=True)
        ]
        good = sorted((left, words) for slope, left, words in fits if slope > 0.0)
        likely = [words for left, words in good if left < max(_AS_LIKELY * good[0][0], good[0][0] + 0.02)]
        cause = "another frame, another log, or wheel azimuths that differ from the robot file"
        cause = ", or ".join(likely[:3]) if good[0][0] < 0.5 else cause
        text = f"The wheels do not turn as the ball's angular velocity implies: {cause}."
    return (*found, error("ball-omega", text, *BALL_NAMES, *wheel_speed_names(len(A))))


def _scaled_fit(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float]:
    """Return the factor from x to y, and the share of y that it leaves."""
    slope = float((x * y).sum() / ((x**2).sum() or 1.0))
    return slope, float(np.linalg.norm(y - slope * x) / np.linalg.norm(y))


@dataclass(frozen=True, kw_only=True)
class _Fit:
    """The equation fitted to a log."""

    gains: NDArray[np.float64]  #: (n,)
    errors: NDArray[np.float64]  #: (n,) their standard errors
    left: float  #: share of the changes of speed

    @property
    def sizes(self) -> NDArray[np.bool_]:
        """Which gains (n,) are right but for their sign."""
        return (np.abs(self.gains) > _POSSIBLE[0]) & (np.abs(self.gains) < _POSSIBLE[1])

    @property
    def right(self) -> bool:
        """Whether every gain is that of a motor that gives the logged torque."""
        return bool((self.sizes & (self.gains > 0.0)).all())


def _pieces(x: NDArray[np.float64], u: NDArray[np.float64], h: float) -> NDArray[np.int64]:
    """Return the rows (k, m) of pieces without a missing value; none of a log that rests."""
    rows = max(2, round(_PIECE / h))
    within = np.arange(0, len(x) - rows, rows)[:, None] + np.arange(rows + 1)
    whole = np.isfinite(np.concatenate([x[within], u[within]], axis=2)).all(axis=(1, 2))
    return within[whole & bool(np.any(u) and np.any(x))]


def _fit_wheels(
    counted: NDArray[np.bool_], J: float, h: float, x: NDArray[np.float64], u: NDArray[np.float64]
) -> _Fit:
    """Fit each free wheel's torque by its motion; a torque that the motion does not explain has no gain."""
    found = []
    for own, w, torque in zip(counted.T, x.T, u.T, strict=True):
        w, y = w[:, own], h * torque[:-1, own].sum(axis=0)
        X = np.column_stack(
            [J * (w[-1] - w[0]), h * w[:-1].sum(axis=0), h * np.sign(w[:-1]).sum(axis=0), np.ones(len(y))]
        )
        fit = fit_linear(X, y, np.arange(len(y)))
        left, inertia = float(np.var(fit.residuals) / (np.var(y) or 1.0)), float(fit.values[0])
        known = left <= 1.0 - _EXPLAINED and inertia != 0.0
        found.append((1.0 / inertia, fit.errors[0] / inertia**2, left) if known else (0.0, 0.0, 1.0))
    gains, errors, lefts = np.array(found).T
    return _Fit(gains=gains, errors=errors, left=float(lefts.mean()))


def _fit_ball(ball: ClampedBall, h: float, x: NDArray[np.float64], u: NDArray[np.float64]) -> _Fit:
    """Fit the changes of the ball's momentum by the torques and the wheels' friction."""
    A, w = ball.A, x[:, :-1] @ ball.A.T
    y = ((x[:, -1] - x[:, 0]) @ ball.inertia).ravel()
    parts = (u[:, :-1].sum(axis=1), w.sum(axis=1), np.sign(w).sum(axis=1))
    X = np.concatenate([h * part[:, None, :] * A.T for part in parts], axis=2).reshape(y.size, -1)
    fit = fit_linear(X, y, np.repeat(np.arange(len(x)), 3))
    left = float(np.var(fit.residuals) / (np.var(y) or 1.0))
    return _Fit(gains=fit.values[: len(A)], errors=fit.errors[: len(A)], left=left)


def _of_torques(
    robot: Robot,
    fit_of: Callable[[NDArray[np.float64], NDArray[np.float64]], _Fit],
    x: NDArray[np.float64],
    u: NDArray[np.float64],
    moved: Sequence[str] | None,
) -> list[Finding]:
    """Return what is wrong with torques (k, m, n) or speeds x (k, m, d) in k pieces of m rows.

    `fit_of` fits the equation to both; `moved` are the columns of free wheels' speeds, None with a ball.
    """
    fit, n = fit_of(x, u), u.shape[2]
    explained, names = 1.0 - fit.left, (*torque_names(n), *(moved or BALL_NAMES))
    if fit.right and explained > _EXPLAINED:
        return [
            warning(
                "torque-scale",
                f"The motion shows {gain:.2g} times u{wheel}; check the scale of that torque, wheels.inertia, "
                "drive.motor_inertia, drive.gear_ratio, and whether the wheel slips.",
                f"u{wheel}",
            )
            for wheel, gain in enumerate(fit.gains, start=1)
            if not _USUAL[0] < gain < _USUAL[1]
        ]
    if fit.sizes.all() and explained > _EXPLAINED:
        return [_sign(fit, moved)]
    others = [
        (fitted, one)
        for one in _mistakes(n, "u{} were that of wheel {}", of_ball=not moved)
        for fitted in [fit_of(one.turned(x), u[..., one.order])]
        if fitted.right and fitted.left < _BETTER * fit.left
    ]
    if others:
        others.sort(key=lambda one: one[0].left)
        likely = [one for fitted, one in others if fitted.left < _AS_LIKELY * others[0][0].left]
        causes = ", or ".join(one.words for one in likely[:3])
        return [error(likely[0].code, f"The torques do not fit the motion; they would if {causes}.", *names)]
    # of a torque that was not logged, the motion shows nothing
    dead = np.abs(fit.gains) <= np.maximum(5.0 * fit.errors, 0.02)
    if dead.any() and fit.sizes[~dead].all() and not dead.all():
        wheels = [f"u{i + 1}" for i in np.flatnonzero(dead)]
        text = (
            f"Nothing responds to {' and '.join(wheels)} while the other motors work: that torque was not logged, its "
            "motor or encoder is dead, its wheel does not touch the ball, or the column is wrong."
        )
        return [error("dead-motor", text, *wheels)]
    shown = (
        f"The motion shows {every([f'{gain:.3g}' for gain in fit.gains])} times the torques; each should be 1"
    )
    if explained <= _EXPLAINED:
        text = (
            f"{shown}, and they explain only {100.0 * max(0.0, explained):.0f} % of the changes of speed: noise, "
            "columns of another log, a delay, or a robot that is not clamped."
        )
        return [error("torque-unrelated", text, *names)]
    text = (
        f"{shown}. They are 0.001 if the torques are in mN m, 0.01 in N cm, 9.5 if the speeds are in rpm, 57 in deg/s, "
        f"{robot.drive.gear_ratio:.3g} if one of the two is the motors', before the gear, and "
        f"{robot.drive.gear_ratio * robot.drive.torque_constant:.2g} if the torques are currents in A; or the robot's "
        "inertias are wrong (wheels.inertia, drive.motor_inertia, drive.gear_ratio)."
    )
    return [error("torque-scale", text, *names)]


def _sign(fit: _Fit, moved: Sequence[str] | None) -> Finding:
    """Return the error about motors that push the other way."""
    wheels = np.flatnonzero(fit.gains < 0.0).tolist()
    if len(wheels) == len(fit.gains):
        what = f"All torques, or {'all wheel speeds' if moved else 'ball_omega on all axes'}, have"
    else:
        pairs = [f"u{i + 1} or {moved[i]}" if moved else f"u{i + 1}" for i in wheels]
        what = f"{' and '.join(pairs)} {'has' if len(wheels) == 1 else 'have'}"
    text = f"{what} the opposite sign: the motion is the opposite one, as strong as it should be."
    return error("torque-sign", text, *(f"u{i + 1}" for i in wheels))


@dataclass(frozen=True, kw_only=True)
class _Mistake:
    """Columns that may have been exchanged or negated."""

    words: str
    code: str
    order: list[int]  #: wheel i takes column order[i]
    axes: tuple[int, ...] = (0, 1, 2)  #: the ball's axis i takes column axes[i]
    signs: tuple[float, ...] = (1.0, 1.0, 1.0)

    def turned(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the ball's angular velocity (..., 3) with its axes set right, or wheels' speeds."""
        return x if self.code == "torque-order" else x[..., list(self.axes)] * np.array(self.signs)


def _mistakes(count: int, words: str, *, of_ball: bool) -> Iterator[_Mistake]:
    """Yield other orders of wheels, called by `words` of column and wheel, and other axes of a ball.

    All three axes negated are left out: for the torques, that is the same as torques negated.
    """
    for order in permutations(range(count)):
        moved = [words.format(column + 1, wheel + 1) for wheel, column in enumerate(order) if wheel != column]
        if moved:
            yield _Mistake(words=" and ".join(moved), code="torque-order", order=list(order))
    for axes, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)) if of_ball else ():
        if axes == (0, 1, 2) and len(set(signs)) == 1:
            continue
        parts = [
            f"{'-' if sign < 0.0 else ''}ball_omega_{_AXES[column]} were ball_omega_{_AXES[axis]}"
            for axis, (column, sign) in enumerate(zip(axes, signs, strict=True))
            if column != axis or sign < 0.0
        ]
        yield _Mistake(
            words=" and ".join(parts), code="ball-omega", order=list(range(count)), axes=axes, signs=signs
        )
