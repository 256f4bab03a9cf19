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

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place, Severity, by_severity
from ballbot.identification.driveline import LIMITED, Sweep
from ballbot.identification.upside_down import BALL_NAMES, encoder_speeds
from ballbot.log import Log
from ballbot.log.columns import torque_names, wheel_speed_names
from ballbot.robot import Robot
from ballbot.robot.derived import wheel_speed_limit
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
#: a cause explains a gain up to this factor
_NEAR = 1.6
#: speed over that of the motor without load, and torque over the largest
_FASTEST, _STRONGEST = 1.4, 1.5
#: a torque below this share of the largest was not logged
_DEAD = 0.02
#: wheel speeds by the encoders over those by the ball
_LIKE_ENCODERS = (0.85, 1.18)
#: [s]; slower rows show no dry friction
_SLOWEST_SAMPLING = 0.1
#: [s] of one and the same speed, over this many rows
_FROZEN, _FROZEN_ROWS = 0.25, 20
_AXES = "xyz"


def _finding(code: str, text: str, *columns: str, severity: Severity = "error") -> Finding:
    return Finding(code=code, severity=severity, text=text, where=Place(columns=columns))


def sweep_findings(robot: Robot, sweeps: Sequence[Sweep]) -> tuple[Finding, ...]:
    """Return the faults of the sweeps of all wheels of a robot, errors first."""
    first, names = sweeps[0], wheel_speed_names(len(sweeps))
    speeds, torques = (np.column_stack([getattr(one, key) for one in sweeps]) for key in ("speed", "torque"))
    free = np.abs(speeds) < LIMITED * first.limit
    findings = []
    for name, speed, row in zip(names, speeds.T, free.T, strict=True):
        findings += _frozen(first.t, np.where(row, speed, 0.0)[:, None], (name,))
    rows = _pieces(speeds, torques, first.sample_time)
    counted = free[rows].all(axis=1)
    if not findings and counted.sum() >= _LEAST_PIECES * len(sweeps):
        bench = _Bench(
            A=np.eye(len(sweeps)),
            x=speeds[rows],
            u=torques[rows],
            sample_time=first.sample_time,
            fit=partial(_fit_wheels, counted, first.inertia),
            moved=names,
        )
        findings += _of_torques(robot, bench)
    return by_severity(findings)


def upside_down_findings(robot: Robot, log: Log) -> tuple[Finding, ...]:
    """Return the faults of a log of the ball on the clamped robot, errors first.

    Parameters
    ----------
    robot : Robot
    log : Log
        With ball_omega_x, _y, _z; with u1 .. un the torques are checked, with wheel1_dot .. the axes.
    """
    findings, names = list(encoder_findings(robot, log)), torque_names(robot.wheel_count)
    if not findings and all(name in log for name in names):
        ball, h = ClampedBall.of_robot(robot), log.sample_time
        omega, torques = (np.column_stack([log[name] for name in several]) for several in (BALL_NAMES, names))
        rows = _pieces(omega, torques, h)
        if len(rows) >= _LEAST_PIECES:
            bench = _Bench(
                A=ball.A,
                x=omega[rows],
                u=torques[rows],
                sample_time=h,
                fit=partial(_fit_ball, ball),
                moved=None,
            )
            findings += _of_torques(robot, bench)
    return by_severity(findings)


def encoder_findings(
    robot: Robot, log: Log, *, like: tuple[float, float] = _LIKE_ENCODERS
) -> tuple[Finding, ...]:
    """Return an error if the encoders contradict the ball's angular velocity; none if the log has no encoders.

    Parameters
    ----------
    robot : Robot
    log : Log
        With ball_omega_x, _y, _z, and wheel angles or speeds.
    like : pair of float
        What wheel speeds by the encoders may be over those by the ball and the robot's radii.
    """
    omega = np.column_stack([log[name] for name in BALL_NAMES])
    return (
        *_frozen(log.t, omega, BALL_NAMES),
        *_of_encoders(log, omega, ClampedBall.of_robot(robot).A, like),
    )


def _frozen(t: NDArray[np.float64], values: NDArray[np.float64], names: Sequence[str]) -> Iterator[Finding]:
    """Yield a stretch in which values (N, k) repeat themselves all at once, beside rest."""
    edges = np.concatenate([[0], np.flatnonzero(np.any(np.diff(values, axis=0), axis=1)) + 1, [len(values)]])
    rows = np.where(np.any(values[edges[:-1]] != 0.0, axis=1), np.diff(edges), 0)
    longest = int(np.argmax(rows))
    first, last = int(edges[longest]), int(edges[longest] + rows[longest] - 1)
    if rows[longest] >= _FROZEN_ROWS and t[last] - t[first] > _FROZEN:
        text = (
            f"{' and '.join(names)} repeat{'s' if len(names) == 1 else ''} one value for {t[last] - t[first]:.2g} s "
            f"from t = {t[first]:.4g} s on: the sensor or the log froze. Remove that interval."
        )
        where = Place(columns=tuple(names), time=float(t[first]))
        yield Finding(code="stuck", severity="error", text=text, where=where)


#: wheel speeds by the encoders over those by the ball, and what makes them so
_ENCODER_UNITS = (
    ("ball_omega is in deg/s, or the wheels' speeds are too small", np.pi / 180.0),
    ("ball_omega is in rpm", np.pi / 30.0),
    ("ball_omega is in turns a second, or the wheels' speeds are the motors'", 2.0 * np.pi),
    ("the wheels' speeds are in deg/s", 180.0 / np.pi),
    ("the wheels' speeds are in rpm", 30.0 / np.pi),
)


def _of_encoders(
    log: Log, omega: NDArray[np.float64], A: NDArray[np.float64], like: tuple[float, float]
) -> Iterator[Finding]:
    """Yield an error if the encoders contradict the ball's angular velocity."""
    speeds = encoder_speeds(log, len(A))
    if not speeds:
        return
    wheels = np.column_stack(speeds)
    rows = np.isfinite(np.hstack([wheels, omega])).all(axis=1)
    wheels, omega = wheels[rows], omega[rows]
    if len(omega) < 10 or not np.any(wheels) or not np.any(omega):
        return
    slope, left = _scaled_fit(omega @ A.T, wheels)
    if left < 0.5 and like[0] < slope < like[1]:
        return
    if left < 0.5 and slope < 0.0:
        text = (
            "The wheels turn against the ball: ball_omega on all axes, or all wheels, have the opposite sign."
        )
    elif left < 0.5:
        near = [words for words, factor in _ENCODER_UNITS if 0.75 < slope / factor < 1.33]
        cause = [*near, "one of the two is in another unit, or ball.radius or wheels.radius is wrong"][0]
        text = f"The wheels turn {slope:.3g} times as fast as the ball's angular velocity implies: {cause}."
    else:
        others = [(words, *_scaled_fit(moved @ A.T, wheels)) for words, moved in _turned_axes(omega)]
        others += [
            (words, *_scaled_fit(omega @ A.T, wheels[:, list(order)]))
            for words, order in _other_orders(len(A), "wheel{}_dot is that of wheel {}")
        ]
        good = sorted((left, words) for words, slope, left in others if slope > 0.0)
        least = good[0][0]
        likely = [words for left, words in good if left < max(_AS_LIKELY * least, least + 0.02)]
        cause = "another frame, another log, or wheel azimuths that differ from the robot file"
        cause = ", or ".join(likely[:3]) if least < 0.5 else cause
        text = f"The wheels do not turn as the ball's angular velocity implies: {cause}."
    yield _finding("ball-omega", text, *BALL_NAMES, *wheel_speed_names(len(A)))


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


#: from motion (k, m, d), torques (k, m, n) and the sample time to the fit
_Fitted = Callable[[NDArray[np.float64], NDArray[np.float64], float], _Fit]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Bench:
    """A log cut into k pieces of m rows."""

    A: NDArray[np.float64]  #: (n, d)
    x: NDArray[np.float64]  #: (k, m, d)
    u: NDArray[np.float64]  #: (k, m, n)
    sample_time: float
    fit: _Fitted
    moved: Sequence[str] | None  #: the columns of the speeds of free wheels; None with a ball


def _pieces(x: NDArray[np.float64], u: NDArray[np.float64], h: float) -> NDArray[np.int64]:
    """Return the rows (k, m) of pieces without a missing value; none of a log that rests."""
    rows = max(2, round(_PIECE / h))
    within = np.arange(0, len(x) - rows, rows)[:, None] + np.arange(rows + 1)
    whole = np.isfinite(np.concatenate([x[within], u[within]], axis=2)).all(axis=(1, 2))
    return within[whole & bool(np.any(u) and np.any(x))]


def _fit_wheels(
    counted: NDArray[np.bool_], J: float, x: NDArray[np.float64], u: NDArray[np.float64], h: float
) -> _Fit:
    """Fit each free wheel's torque by its motion; a torque that the motion does not explain has no gain."""
    found = []
    for own, w, torque in zip(counted.T, x.T, u.T, strict=True):
        w, y = w[:, own], h * torque[:-1, own].sum(axis=0)
        X = np.column_stack(
            [J * (w[-1] - w[0]), h * w[:-1].sum(axis=0), h * np.sign(w[:-1]).sum(axis=0), np.ones(len(y))]
        )
        values, _, rank, _ = np.linalg.lstsq(X, y, rcond=None)
        residual = y - X @ values
        left = float(np.var(residual) / (np.var(y) or 1.0))
        if rank < X.shape[1] or left > 1.0 - _EXPLAINED:
            found.append((0.0, 0.0, 1.0))
            continue
        error = float(np.sqrt(np.linalg.inv(X.T @ X)[0, 0] * np.mean(residual**2)))
        found.append((1.0 / values[0], error / values[0] ** 2, left))
    gains, errors, lefts = np.array(found).T
    return _Fit(gains=gains, errors=errors, left=float(lefts.mean()))


def _fit_ball(ball: ClampedBall, x: NDArray[np.float64], u: NDArray[np.float64], h: float) -> _Fit:
    """Fit the changes of the ball's momentum by the torques and the wheels' friction."""
    A, w = ball.A, x[:, :-1] @ ball.A.T
    y = ((x[:, -1] - x[:, 0]) @ ball.inertia).ravel()
    parts = (u[:, :-1].sum(axis=1), w.sum(axis=1), np.sign(w).sum(axis=1))
    X = np.concatenate([h * part[:, None, :] * A.T for part in parts], axis=2).reshape(y.size, -1)
    found = np.linalg.lstsq(X, y, rcond=None)[0]
    residual = y - X @ found
    variances = np.linalg.pinv(X.T @ X).diagonal() * np.mean(residual**2)
    return _Fit(
        gains=np.asarray(found[: len(A)], dtype=np.float64),
        errors=np.sqrt(np.maximum(variances[: len(A)], 0.0)),
        left=float(np.var(residual) / (np.var(y) or 1.0)),
    )


def _of_torques(robot: Robot, bench: _Bench) -> list[Finding]:
    """Return what is wrong with the torques or with the speeds."""
    fit, n = bench.fit(bench.x, bench.u, bench.sample_time), len(bench.A)
    explained, names = 1.0 - fit.left, (*torque_names(n), *(bench.moved or BALL_NAMES))
    if fit.right and explained > _EXPLAINED:
        return [
            _finding(
                "torque-scale",
                f"The motion shows {gain:.2g} times u{wheel}; check the scale of that torque, wheels.inertia, "
                "drive.motor_inertia, drive.gear_ratio, and whether the wheel slips.",
                f"u{wheel}",
                severity="warning",
            )
            for wheel, gain in enumerate(fit.gains, start=1)
            if not _USUAL[0] < gain < _USUAL[1]
        ]
    if fit.sizes.all() and explained > _EXPLAINED:
        return [_sign(fit, bench.moved)]
    others = [one for one in _alternatives(bench) if one[0].right and one[0].left < _BETTER * fit.left]
    if others:
        others.sort(key=lambda one: one[0].left)
        likely = [one for one in others if one[0].left < _AS_LIKELY * others[0][0].left]
        causes = ", or ".join(words for _, _, words in likely[:3])
        text = f"The torques do not fit the motion; they would if {causes}."
        return [_finding(likely[0][1], text, *names)]
    single = list(_single(fit, bench.u))
    if single:
        return single
    common = float(np.median(fit.gains))
    if explained > _EXPLAINED and common > 0.0 and np.ptp(np.log(np.abs(fit.gains))) < 1.0:
        causes = list(_causes(common, robot, bench)) or ["torques, speeds or t are in another unit"]
        text = (
            f"The motion shows {common:.3g} times the torques: {', or '.join(causes)}, or the robot's inertias are "
            "wrong (wheels.inertia, drive.motor_inertia, drive.gear_ratio)."
        )
        return [_finding("torque-scale", text, *names)]
    gains = ", ".join(f"{gain:.2g}" for gain in fit.gains)
    text = (
        f"The torques explain only {100.0 * max(0.0, explained):.0f} % of the changes of speed (gains {gains}; each "
        "should be 1): noise, columns of another log, a delay, or a robot that is not clamped."
    )
    return [_finding("torque-unrelated", text, *names)]


def _sign(fit: _Fit, moved: Sequence[str] | None) -> Finding:
    """Return the error about motors that push the other way."""
    wheels = np.flatnonzero(fit.gains < 0.0).tolist()
    if len(wheels) == len(fit.gains):
        what = f"All torques, or {'all wheel speeds' if moved else 'ball_omega on all axes'}, have"
    else:
        pairs = [f"u{i + 1} or {moved[i]}" if moved else f"u{i + 1}" for i in wheels]
        what = f"{' and '.join(pairs)} {'has' if len(wheels) == 1 else 'have'}"
    text = f"{what} the opposite sign: the motion is the opposite one, as strong as it should be."
    return _finding("torque-sign", text, *(f"u{i + 1}" for i in wheels))


def _single(fit: _Fit, u: NDArray[np.float64]) -> Iterator[Finding]:
    """Yield motors that do nothing, or something else, while the others do what they should."""
    sizes = np.sqrt(np.mean(u**2, axis=(0, 1)))
    for i, (gain, error) in enumerate(zip(fit.gains, fit.errors, strict=True)):
        name, code = f"u{i + 1}", "dead-motor"
        if sizes[i] < _DEAD * sizes.max():
            text = f"{name} is almost zero ({sizes[i]:.2g} N m): it was not logged, or its motor rests."
        elif fit.sizes[i] or not np.delete(fit.sizes, i).all():
            continue
        elif abs(gain) <= max(5.0 * error, 0.02):
            text = (
                f"Nothing responds to {name} ({gain:.2g} times what it should) while the other motors work: its "
                "motor or encoder is dead, its wheel does not touch the ball, or the column is wrong."
            )
        else:
            code = "torque-scale"
            text = (
                f"The motion shows {gain:.3g} times {name} while the other torques are right: that torque, or the "
                "speed of that wheel, has another unit."
            )
        yield _finding(code, text, name)


def _alternatives(bench: _Bench) -> Iterator[tuple[_Fit, str, str]]:
    """Yield the fits with other orders of torques and other axes of the ball, with the code and the words of each."""
    x, u, h = bench.x, bench.u, bench.sample_time
    for words, order in _other_orders(len(bench.A), "u{} were that of wheel {}"):
        yield bench.fit(x, u[..., list(order)], h), "torque-order", words
    for words, turned in () if bench.moved else _turned_axes(x):
        yield bench.fit(turned, u, h), "ball-omega", words


def _other_orders(count: int, words: str) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Yield orders other than the columns' own: wheel i takes column order[i]."""
    for order in permutations(range(count)):
        moved = [(column, wheel) for wheel, column in enumerate(order) if wheel != column]
        if moved:
            yield " and ".join(words.format(column + 1, wheel + 1) for column, wheel in moved), order


def _turned_axes(omega: NDArray[np.float64]) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield the ball's angular velocity (..., 3) with axes exchanged and negated, and that in words.

    All three negated are left out: for the torques, that is the same as torques negated.
    """
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        if order == (0, 1, 2) and len(set(signs)) == 1:
            continue
        parts = [
            f"{'-' if sign < 0.0 else ''}ball_omega_{_AXES[column]} were ball_omega_{_AXES[axis]}"
            for axis, (column, sign) in enumerate(zip(order, signs, strict=True))
            if column != axis or sign < 0.0
        ]
        yield " and ".join(parts), omega[..., list(order)] * np.array(signs)


def _causes(gain: float, robot: Robot, bench: _Bench) -> Iterator[str]:
    """Yield the slips of units that make such a gain and that leave torques, speeds and time of this robot."""
    drive, n = robot.drive, robot.drive.gear_ratio
    no_load = wheel_speed_limit(
        supply_voltage=drive.supply_voltage, speed_constant=drive.speed_constant, gear_ratio=n
    )
    fastest = float(np.abs(bench.x @ bench.A.T).max()) / no_load
    strongest, h = float(np.abs(bench.u).max()) / drive.torque_limit, bench.sample_time
    slips = (
        # what it is, by what it multiplies torque, speed and time
        ("the torques are in mN m", 1e3, 1.0, 1.0),
        ("the torques are in N cm", 1e2, 1.0, 1.0),
        ("the torques are the motors', before the gear", 1.0 / n, 1.0, 1.0),
        ("the torques are currents in A", 1.0 / (n * drive.torque_constant), 1.0, 1.0),
        ("the torques are in percent of the largest", 100.0 / drive.torque_limit, 1.0, 1.0),
        ("the speeds are in rpm", 1.0, 30.0 / math.pi, 1.0),
        ("the speeds are in deg/s", 1.0, 180.0 / math.pi, 1.0),
        ("the speeds are the motors', before the gear", 1.0, n, 1.0),
        ("the speeds are in turns a second", 1.0, 0.5 / math.pi, 1.0),
        ("t is in milliseconds", 1.0, 1.0, 1e3),
    )
    for words, torque, speed, time in slips:
        near = 1.0 / _NEAR < gain * torque * time / speed < _NEAR
        usual = strongest / torque < _STRONGEST and fastest / speed < _FASTEST
        if near and usual and 1e-5 < h / time < _SLOWEST_SAMPLING:
            yield words
