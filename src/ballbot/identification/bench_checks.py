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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
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

#: length of the pieces [s]
_PIECE = 0.1
_LEAST_PIECES = 20
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
    first, n = sweeps[0], len(sweeps)
    speeds = np.column_stack([one.speed for one in sweeps])
    free = np.abs(speeds) < LIMITED * first.limit
    findings = [*_of_sampling(first.sample_time), *_of_limit(sweeps)]
    for name, speed, row in zip(wheel_speed_names(n), speeds.T, free.T, strict=True):
        findings += _frozen(first.t, np.where(row, speed, 0.0)[:, None], (name,))
    equation = _equation(
        A=np.eye(n),
        J=first.inertia * np.eye(n),
        x=speeds,
        u=np.column_stack([one.torque for one in sweeps]),
        valid=free,
        sample_time=first.sample_time,
        free_wheels=True,
    )
    if equation is not None and all(one.severity != "error" for one in findings):
        findings += _of_torques(robot, equation, wheel_speed_names(n))
    return by_severity(findings)


def upside_down_findings(robot: Robot, log: Log) -> tuple[Finding, ...]:
    """Return the faults of a log of the ball on the clamped robot, errors first.

    Parameters
    ----------
    robot : Robot
    log : Log
        With ball_omega_x, _y, _z; with u1 .. un the torques are checked, with wheel1_dot .. the axes.
    """
    of_encoders, names = encoder_findings(robot, log), torque_names(robot.wheel_count)
    findings = [*_of_sampling(log.sample_time), *of_encoders]
    if not of_encoders and all(name in log for name in names):
        ball, omega = ClampedBall.of_robot(robot), np.column_stack([log[name] for name in BALL_NAMES])
        equation = _equation(
            A=ball.A,
            J=ball.inertia,
            x=omega,
            u=np.column_stack([log[name] for name in names]),
            valid=np.ones_like(omega, dtype=bool),
            sample_time=log.sample_time,
            free_wheels=False,
        )
        findings += _of_torques(robot, equation, BALL_NAMES) if equation is not None else []
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
    return (*_frozen(log.t, omega, BALL_NAMES), *_of_encoders(log, omega, ClampedBall.of_robot(robot), like))


def _of_sampling(h: float) -> Iterator[Finding]:
    if h > _SLOWEST_SAMPLING:
        unit = f"t appears to be in milliseconds ({0.001 * h:.3g} s)" if h >= 1.0 else "log at 100 Hz or more"
        yield _finding("scale", f"Rows come every {h:.3g} s, too slowly for this experiment; {unit}.", "t")


def _of_limit(sweeps: Sequence[Sweep]) -> Iterator[Finding]:
    """Yield a limit that no wheel comes near, so that where the supply limits the speed would count as free."""
    fastest, limit = max(float(np.abs(one.speed).max()) for one in sweeps), sweeps[0].limit
    if limit > _FASTEST * fastest:
        text = (
            f"The speed limit is {limit:.4g} rad/s and the wheels reach {fastest:.4g} rad/s. If the limit was given in "
            f"rpm, it is {limit * math.pi / 30.0:.4g} rad/s."
        )
        yield _finding("speed-limit", text, severity="warning")


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


def _of_encoders(
    log: Log, omega: NDArray[np.float64], ball: ClampedBall, like: tuple[float, float]
) -> Iterator[Finding]:
    """Yield an error if the encoders contradict the ball's angular velocity."""
    speeds = encoder_speeds(log, len(ball.A))
    if not speeds:
        return
    wheels = np.column_stack(speeds)
    rows = np.isfinite(np.hstack([wheels, omega])).all(axis=1)
    wheels, omega = wheels[rows], omega[rows]
    if len(omega) < 10 or not np.any(wheels) or not np.any(omega):
        return
    slope, left = _scaled_fit(omega @ ball.A.T, wheels)
    if left < 0.5 and like[0] < slope < like[1]:
        return
    if left < 0.5 and slope < 0.0:
        text = (
            "The wheels turn against the ball: ball_omega on all axes, or all wheels, have the opposite sign."
        )
    elif left < 0.5:
        text = f"The wheels turn {slope:.3g} times as fast as the ball's angular velocity implies: {_unit_of(slope)}."
    else:
        others = [(words, *_scaled_fit(moved @ ball.A.T, wheels)) for words, moved in _turned_axes(omega)]
        others += [
            (words, *_scaled_fit(omega @ ball.A.T, wheels[:, list(order)]))
            for words, order in _other_orders(len(ball.A), "wheel{}_dot is that of wheel {}")
        ]
        good = sorted((left, words) for words, slope, left in others if slope > 0.0)
        least = good[0][0]
        likely = [words for left, words in good if left < max(_AS_LIKELY * least, least + 0.02)]
        cause = (
            f"{', or '.join(likely[:3])}."
            if least < 0.5
            else "another frame, another log, or wheel azimuths that differ from the robot file."
        )
        text = f"The wheels do not turn as the ball's angular velocity implies: {cause}"
    yield _finding("ball-omega", text, *BALL_NAMES, *wheel_speed_names(len(ball.A)))


def _scaled_fit(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float]:
    """Return the factor from x to y, and the share of y that it leaves."""
    slope = float((x * y).sum() / ((x**2).sum() or 1.0))
    return slope, float(np.linalg.norm(y - slope * x) / np.linalg.norm(y))


def _unit_of(slope: float) -> str:
    units = (
        ("ball_omega is in deg/s, or the wheels' speeds are too small", np.pi / 180.0),
        ("ball_omega is in rpm", np.pi / 30.0),
        ("ball_omega is in turns a second, or the wheels' speeds are the motors'", 2.0 * np.pi),
        ("the wheels' speeds are in deg/s", 180.0 / np.pi),
        ("the wheels' speeds are in rpm", 30.0 / np.pi),
    )
    near = [words for words, factor in units if 0.75 < slope / factor < 1.33]
    return near[0] if near else "one of the two is in another unit, or ball.radius or wheels.radius is wrong"


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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Equation:
    """A log cut into k pieces of m rows."""

    A: NDArray[np.float64]  #: (n, d)
    J: NDArray[np.float64]  #: (d, d)
    x: NDArray[np.float64]  #: (k, m, d)
    u: NDArray[np.float64]  #: (k, m, n)
    valid: NDArray[np.bool_]  #: (k, d), which changes of speed count
    free_wheels: bool  #: whether x are the speeds of wheels that turn alone
    sample_time: float

    def fit(self, *, x: NDArray[np.float64] | None = None, u: NDArray[np.float64] | None = None) -> _Fit:
        """Fit the equation, with other axes (k, m, d) or torques (k, m, n) where they are given."""
        x, u, h, n = self.x if x is None else x, self.u if u is None else u, self.sample_time, len(self.A)
        w = x[:, :-1] @ self.A.T
        torque, drag = h * u[:, :-1].sum(axis=1), [h * w.sum(axis=1), h * np.sign(w).sum(axis=1)]
        y = (x[:, -1] - x[:, 0]) @ self.J
        if self.free_wheels:
            columns = zip(torque.T, y.T, *(one.T for one in drag), self.valid.T, strict=True)
            gains, errors, left = np.array([_inertia(*one) for one in columns]).T
            return _Fit(gains=gains, errors=errors, left=float(left.mean()))
        X = np.concatenate([part[:, None, :] * self.A.T for part in (torque, *drag)], axis=2).reshape(
            y.size, -1
        )
        found = np.linalg.lstsq(X, y.ravel(), rcond=None)[0]
        residual = y.ravel() - X @ found
        variances = np.linalg.pinv(X.T @ X).diagonal() * np.mean(residual**2)
        return _Fit(
            gains=np.asarray(found[:n], dtype=np.float64),
            errors=np.sqrt(np.maximum(variances[:n], 0.0)),
            left=float(np.var(residual) / (np.var(y) or 1.0)),
        )


def _inertia(
    torque: NDArray[np.float64],
    change: NDArray[np.float64],
    travel: NDArray[np.float64],
    sign: NDArray[np.float64],
    valid: NDArray[np.bool_],
) -> tuple[float, float, float]:
    """Return the gain of a free wheel's torque, its standard error, and the share of the torque that is unexplained.

    The arguments (k,) are integrals over pieces. A torque that the motion does not explain has no gain.
    """
    X, y = np.column_stack([change, travel, sign, np.ones(len(sign))])[valid], torque[valid]
    found, _, rank, _ = np.linalg.lstsq(X, y, rcond=None)
    residual = y - X @ found
    left = float(np.var(residual) / (np.var(y) or 1.0))
    if rank < X.shape[1] or left > 1.0 - _EXPLAINED:
        return 0.0, 0.0, 1.0
    error = float(np.sqrt(np.linalg.inv(X.T @ X)[0, 0] * np.mean(residual**2)))
    return 1.0 / found[0], error / found[0] ** 2, left


def _equation(
    *,
    A: NDArray[np.float64],
    J: NDArray[np.float64],
    x: NDArray[np.float64],
    u: NDArray[np.float64],
    valid: NDArray[np.bool_],
    sample_time: float,
    free_wheels: bool,
) -> _Equation | None:
    """Return the equation of rows (N, .); None if there is too little of them, which the identification reports."""
    rows = max(2, round(_PIECE / sample_time))
    within = np.arange(0, len(x) - rows, rows)[:, None] + np.arange(rows + 1)
    whole = np.isfinite(np.concatenate([x[within], u[within]], axis=2)).all(axis=(1, 2))
    within = within[whole]
    counted = np.asarray(valid[within].all(axis=1))
    if counted.sum() < _LEAST_PIECES * x.shape[1] or not np.any(u) or not np.any(x):
        return None
    return _Equation(
        A=A, J=J, x=x[within], u=u[within], valid=counted, free_wheels=free_wheels, sample_time=sample_time
    )


def _of_torques(robot: Robot, equation: _Equation, moved: Sequence[str]) -> list[Finding]:
    """Return what is wrong with the torques or with the speeds `moved`."""
    fit, n = equation.fit(), len(equation.A)
    explained, names = 1.0 - fit.left, (*torque_names(n), *moved)
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
        return [_sign(fit, moved, free=equation.free_wheels)]
    others = [one for one in _alternatives(equation) if one[0].right and one[0].left < _BETTER * fit.left]
    if others:
        others.sort(key=lambda one: one[0].left)
        likely = [one for one in others if one[0].left < _AS_LIKELY * others[0][0].left]
        causes = ", or ".join(words for _, _, words in likely[:3])
        text = f"The torques do not fit the motion; they would if {causes}."
        return [_finding(likely[0][1], text, *names)]
    single = list(_single(fit, equation))
    if single:
        return single
    common = float(np.median(fit.gains))
    if explained > _EXPLAINED and common > 0.0 and np.ptp(np.log(np.abs(fit.gains))) < 1.0:
        causes = list(_causes(common, robot, equation)) or ["torques, speeds or t are in another unit"]
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


def _sign(fit: _Fit, moved: Sequence[str], *, free: bool) -> Finding:
    """Return the error about motors that push the other way."""
    wheels = np.flatnonzero(fit.gains < 0.0).tolist()
    if len(wheels) == len(fit.gains):
        what = f"All torques, or {'all wheel speeds' if free else 'ball_omega on all axes'}, have"
    else:
        pairs = [f"u{i + 1} or {moved[i]}" if free else f"u{i + 1}" for i in wheels]
        what = f"{' and '.join(pairs)} {'has' if len(wheels) == 1 else 'have'}"
    text = f"{what} the opposite sign: the motion is the opposite one, as strong as it should be."
    return _finding("torque-sign", text, *(f"u{i + 1}" for i in wheels))


def _single(fit: _Fit, equation: _Equation) -> Iterator[Finding]:
    """Yield motors that do nothing, or something else, while the others do what they should."""
    sizes = np.sqrt(np.mean(equation.u**2, axis=(0, 1)))
    for i, (gain, error) in enumerate(zip(fit.gains, fit.errors, strict=True)):
        if sizes[i] < _DEAD * sizes.max():
            text = (
                f"u{i + 1} is almost zero ({sizes[i]:.2g} N m) compared with the others: it was not logged, or its "
                "motor rests."
            )
            yield _finding("dead-motor", text, f"u{i + 1}")
        elif not np.delete(fit.sizes, i).all():
            continue
        elif abs(gain) <= max(5.0 * error, 0.02):
            text = (
                f"Nothing responds to u{i + 1} ({gain:.2g} times what it should) while the other motors work: its "
                "motor or encoder is dead, its wheel does not touch the ball, or the column is wrong."
            )
            yield _finding("dead-motor", text, f"u{i + 1}")
        elif not fit.sizes[i]:
            text = (
                f"The motion shows {gain:.3g} times u{i + 1} while the other torques are right: that torque, or the "
                "speed of that wheel, has another unit."
            )
            yield _finding("torque-scale", text, f"u{i + 1}")


def _alternatives(equation: _Equation) -> Iterator[tuple[_Fit, str, str]]:
    """Yield the fits with other orders of torques and other axes of the ball, with the code and the words of each."""
    for words, order in _other_orders(len(equation.A), "u{} were that of wheel {}"):
        yield equation.fit(u=equation.u[..., list(order)]), "torque-order", words
    if not equation.free_wheels:
        for words, turned in _turned_axes(equation.x):
            yield equation.fit(x=turned), "ball-omega", words


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


def _causes(gain: float, robot: Robot, equation: _Equation) -> Iterator[str]:
    """Yield the slips of units that make such a gain and that leave torques, speeds and time of this robot."""
    drive, n = robot.drive, robot.drive.gear_ratio
    no_load = wheel_speed_limit(
        supply_voltage=drive.supply_voltage, speed_constant=drive.speed_constant, gear_ratio=n
    )
    fastest = float(np.abs(equation.x @ equation.A.T).max()) / no_load
    strongest, h = float(np.abs(equation.u).max()) / drive.torque_limit, equation.sample_time
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
