"""Whether a log of the ball on the clamped robot is one: torques, the ball's angular velocity and wheels together.

    J dOmega/dt = A^T (g u - b w - c sgn w),   w = A Omega,   one gain g, b and c a wheel

fitted to pieces of 0.1 s, each an integral over time. Gains of one show that torques, axes and units are right. If they
are not, the torques are tried in other orders and with other signs, and so are the axes of Omega. The finding names
every change that makes the gains right, because such a log does not distinguish them. Encoders, where they are logged,
show the ball's axes and unit by themselves.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place, by_severity
from ballbot.identification.upside_down import BALL_NAMES, encoder_speeds
from ballbot.log import Log
from ballbot.log.columns import torque_names, wheel_speed_names
from ballbot.robot import Robot
from ballbot.simulation.upside_down import ClampedBall

_PIECE = 0.1  # [s]
_LEAST_PIECES = 50
#: gains; rollers that slip and play take up to a quarter of a torque
_USUAL, _POSSIBLE = (0.6, 1.6), (0.4, 2.5)
#: share of the ball's changes of speed that the equation must explain
_EXPLAINED = 0.4
#: an explanation of a wrong log must leave less than this share of the residual of the columns as they are
_BETTER = 0.6
#: and others that leave not much more are as likely
_AS_LIKELY = 1.3
#: wheel speeds by the encoders over those by the ball
_LIKE_ENCODERS = (0.85, 1.18)
_SLOWEST_SAMPLING = 0.1  # [s]
_AXES = "xyz"
_FROZEN = 0.5  # [s], of one and the same angular velocity


def upside_down_findings(robot: Robot, log: Log) -> tuple[Finding, ...]:
    """Return the faults of a log of the ball on the clamped robot, errors first.

    Parameters
    ----------
    robot : Robot
    log : Log
        With ball_omega_x, _y, _z; with u1 .. un the torques are checked, with wheel1_dot .. the axes.
    """
    findings = list(_of_sampling(log))
    omega = np.column_stack([log[name] for name in BALL_NAMES])
    ball = ClampedBall.of_robot(robot)
    of_encoders = encoder_findings(robot, log)
    findings += of_encoders
    if not of_encoders and all(name in log for name in torque_names(robot.wheel_count)):
        findings += _of_torques(log, omega, ball)
    return by_severity(findings)


def _of_sampling(log: Log) -> Iterator[Finding]:
    h = log.sample_time
    if h > _SLOWEST_SAMPLING:
        unit = f"; t appears to be in milliseconds ({0.001 * h:.3g} s)" if h >= 1.0 else ""
        text = f"Rows come every {h:.3g} s, too slowly for a ball on its wheels{unit}."
        yield Finding(code="scale", severity="error", text=text, where=Place(columns=("t",)))


def _frozen(log: Log) -> Iterator[Finding]:
    """Yield a stretch in which the ball's angular velocity repeats itself on all axes, while it turns."""
    omega = np.column_stack([log[name] for name in BALL_NAMES])
    changes = np.flatnonzero((np.diff(omega, axis=0) != 0.0).any(axis=1)) + 1
    edges = np.concatenate([[0], changes, [len(omega)]])
    turning = np.any(omega[edges[:-1]] != 0.0, axis=1)
    lengths = np.where(turning, np.diff(edges), 0)
    longest = int(np.argmax(lengths))
    lasts = float(lengths[longest]) * log.sample_time
    if lasts > _FROZEN and lengths[longest] > 20:
        start = float(log.t[edges[longest]])
        text = (
            f"ball_omega repeats one value for {lasts:.2g} s from t = {start:.4g} s "
            "on: the camera lost the ball, or the log froze. Remove that interval."
        )
        where = Place(columns=BALL_NAMES, time=start)
        yield Finding(code="stuck", severity="error", text=text, where=where)


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
    return (*_frozen(log), *_of_encoders(log, omega, ClampedBall.of_robot(robot), like))


def _of_encoders(
    log: Log, omega: NDArray[np.float64], ball: ClampedBall, like: tuple[float, float]
) -> Iterator[Finding]:
    """Yield an error if the encoders contradict the ball's angular velocity."""
    names = wheel_speed_names(len(ball.A))
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
    columns = (*BALL_NAMES, *names)
    if left < 0.5 and slope < 0.0:
        text = (
            "The wheels turn against the ball: ball_omega on all axes, or all wheels, have the opposite sign."
        )
        yield Finding(code="ball-omega", severity="error", text=text, where=Place(columns=columns))
        return
    if left < 0.5:
        text = (
            f"The wheels turn {slope:.3g} times as fast as the "
            f"ball's angular velocity implies: {_unit_of(slope)}."
        )
        yield Finding(code="ball-omega", severity="error", text=text, where=Place(columns=columns))
        return
    others = [(words, *_scaled_fit(moved @ ball.A.T, wheels)) for words, moved in _turned_axes(omega)]
    others += [
        (words, *_scaled_fit(omega @ ball.A.T, wheels[:, list(order)]))
        for words, order in _other_orders(len(ball.A), "wheel{}_dot is that of wheel {}")
    ]
    good = [(left, words) for words, slope, left in others if slope > 0.0]
    least, _ = min(good)
    likely = [words for left, words in sorted(good) if left < max(_AS_LIKELY * least, least + 0.02)]
    cause = (
        f"{', or '.join(likely[:3])}."
        if least < 0.5
        else "another frame, another log, or wheel azimuths that differ from the robot file."
    )
    text = f"The wheels do not turn as the ball's angular velocity implies: {cause}"
    yield Finding(code="ball-omega", severity="error", text=text, where=Place(columns=columns))


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
    left: float  #: share of the ball's changes of speed

    @property
    def right(self) -> bool:
        """Whether every gain is that of a motor that gives the logged torque."""
        return bool(((self.gains > _POSSIBLE[0]) & (self.gains < _POSSIBLE[1])).all())

    @property
    def turned(self) -> bool:
        """Whether every gain is right but for its sign, and some are below zero."""
        sizes = np.abs(self.gains)
        return bool(((sizes > _POSSIBLE[0]) & (sizes < _POSSIBLE[1])).all() and (self.gains < 0.0).any())


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pieces:
    """A log cut into pieces: the changes of the ball's speed, and the integrals of the torques."""

    ball: ClampedBall
    omega: NDArray[np.float64]  #: (k, m, 3)
    torques: NDArray[np.float64]  #: (k, m, n)
    sample_time: float

    def fit(
        self, *, omega: NDArray[np.float64] | None = None, torques: NDArray[np.float64] | None = None
    ) -> _Fit:
        """Fit the equation, with other axes (k, m, 3) or torques (k, m, n) where they are given."""
        omega = self.omega if omega is None else omega
        torques = self.torques if torques is None else torques
        A, h = self.ball.A, self.sample_time
        speeds = omega[:, :-1] @ A.T
        y = (omega[:, -1] - omega[:, 0]) @ self.ball.inertia
        parts = (h * torques[:, :-1].sum(axis=1), -h * speeds.sum(axis=1), -h * np.sign(speeds).sum(axis=1))
        X = np.concatenate([part[:, None, :] * A.T for part in parts], axis=2).reshape(y.size, -1)
        found = np.linalg.lstsq(X, y.ravel(), rcond=None)[0]
        left = y.ravel() - X @ found
        return _Fit(
            gains=np.asarray(found[: len(A)], dtype=np.float64), left=float(np.var(left) / (np.var(y) or 1.0))
        )


def _pieces(log: Log, omega: NDArray[np.float64], ball: ClampedBall) -> _Pieces | None:
    torques = np.column_stack([log[name] for name in torque_names(len(ball.A))])
    rows = max(2, round(_PIECE / log.sample_time))
    starts = np.arange(0, len(omega) - rows, rows)
    within = starts[:, None] + np.arange(rows + 1)
    whole = np.isfinite(np.concatenate([omega[within], torques[within]], axis=2)).all(axis=(1, 2))
    if whole.sum() < _LEAST_PIECES or not np.any(torques) or not np.any(omega):
        return None  # the identification itself reports it
    within = within[whole]
    return _Pieces(ball=ball, omega=omega[within], torques=torques[within], sample_time=log.sample_time)


def _of_torques(log: Log, omega: NDArray[np.float64], ball: ClampedBall) -> list[Finding]:
    pieces = _pieces(log, omega, ball)
    if pieces is None:
        return []
    fit = pieces.fit()
    explained = 1.0 - fit.left
    if fit.right and explained > _EXPLAINED:
        return list(_gain_warnings(fit))
    names = torque_names(len(ball.A))
    if fit.turned and explained > _EXPLAINED:
        return [_sign(fit)]
    others = [(other, code, words) for other, code, words in _alternatives(pieces) if other.right]
    better = sorted((one for one in others if one[0].left < _BETTER * fit.left), key=lambda one: one[0].left)
    if better:
        likely = [one for one in better if one[0].left < _AS_LIKELY * better[0][0].left]
        causes = ", or ".join(words for _, _, words in likely[:3])
        text = f"The torques do not move the ball as they should; they would if {causes}."
        return [_error(likely[0][1], text, *names, *BALL_NAMES)]
    dead = list(_dead(fit, pieces))
    if dead:
        return dead
    common = float(np.median(fit.gains))
    if explained > _EXPLAINED and common > 0.0 and np.ptp(np.log(np.abs(fit.gains))) < 1.0:
        text = (
            f"The ball responds {common:.3g} times as strongly to the torques as "
            f"it should: {_scale_of(common)}, or the robot's inertias are wrong."
        )
        return [_error("torque-scale", text, *names, *BALL_NAMES)]
    text = (
        f"The torques explain only {100.0 * max(0.0, explained):.0f} % of the change of the "
        f"ball's speed (gains {', '.join(f'{gain:.2g}' for gain in fit.gains)}; each should "
        "be 1): noise, columns of another log, a delay, or a robot that is not clamped."
    )
    return [_error("torque-unrelated", text, *names, *BALL_NAMES)]


def _sign(fit: _Fit) -> Finding:
    """Return the error about motors that push the other way."""
    negated = [f"u{wheel}" for wheel, gain in enumerate(fit.gains, start=1) if gain < 0.0]
    if len(negated) == len(fit.gains):
        what = "All torques, or ball_omega on all axes, have the opposite sign"
    else:
        what = f"{' and '.join(negated)} {'has' if len(negated) == 1 else 'have'} the opposite sign"
    text = f"{what}: the ball is pushed in the opposite direction, as strongly as it should be."
    return _error("torque-sign", text, *negated)


def _gain_warnings(fit: _Fit) -> Iterator[Finding]:
    for wheel, gain in enumerate(fit.gains, start=1):
        if not _USUAL[0] < gain < _USUAL[1]:
            text = (
                f"The ball responds {gain:.2g} times as strongly to u{wheel} as it should; check "
                "the scale of that torque, the robot's inertias, and whether the wheel slips."
            )
            where = Place(columns=(f"u{wheel}",))
            yield Finding(code="torque-scale", severity="warning", text=text, where=where)


def _dead(fit: _Fit, pieces: _Pieces) -> Iterator[Finding]:
    """Yield motors that do nothing while the others do what they should."""
    right = (fit.gains > _POSSIBLE[0]) & (fit.gains < _POSSIBLE[1])
    sizes = np.sqrt(np.mean(pieces.torques**2, axis=(0, 1)))
    for wheel, (gain, size) in enumerate(zip(fit.gains, sizes, strict=True), start=1):
        others = np.delete(right, wheel - 1)
        if size < 0.02 * sizes.max():
            text = (
                f"u{wheel} is almost zero ({size:.2g} N m) compared with "
                "the others: it was not logged, or its motor rests."
            )
            yield _error("dead-motor", text, f"u{wheel}")
        elif others.all() and abs(gain) < 0.25:
            text = (
                f"The ball does not respond to u{wheel} ({gain:.2g} times what it "
                "should) while it responds to the other motors: that motor is "
                "dead, its wheel does not touch the ball, or the column is wrong."
            )
            yield _error("dead-motor", text, f"u{wheel}")


def _alternatives(pieces: _Pieces) -> Iterator[tuple[_Fit, str, str]]:
    """Yield the fits with other orders of torques and other axes of the ball, with the code and the words of each."""
    u, omega, n = pieces.torques, pieces.omega, len(pieces.ball.A)
    for words, order in _other_orders(n, "u{} were that of wheel {}"):
        yield pieces.fit(torques=u[..., list(order)]), "torque-order", words
    for words, moved in _turned_axes(omega):
        yield pieces.fit(omega=moved), "ball-omega", words


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


def _scale_of(gain: float) -> str:
    slips = (
        ("the torques are in mN m, or t in milliseconds", 1e-3),
        ("the torques are in N cm", 1e-2),
        ("ball_omega is in deg/s", 180.0 / np.pi),
        ("ball_omega is in rpm", 30.0 / np.pi),
        ("ball_omega is in turns a second", 1.0 / (2.0 * np.pi)),
    )
    near = [words for words, factor in slips if 1.0 / 1.6 < gain / factor < 1.6]
    return (
        near[0]
        if near
        else "torques, ball_omega or t are in another unit, or the torques are the motors' own"
    )


def _error(code: str, text: str, *columns: str) -> Finding:
    return Finding(code=code, severity="error", text=text, where=Place(columns=columns))
