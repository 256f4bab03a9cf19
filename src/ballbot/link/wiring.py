"""The wiring check: do the IMU's axes and the encoders agree with the robot's, before any motor is driven?

A person holds the robot on its ball, a foot against the ball, and turns it from upright about one axis after the other
(`ballbot.link.operators.MOVEMENTS`). Three measurements of each turn r (3,) [rad] are compared:

    attitude    r from R_0^T R_1, which gravity and the heading give
    gyro        r from the integral of the angular velocity, which motion gives
    encoders    the wheels turn by -A r, because the ball stands still

The attitude must turn about the axis of the movement with its sign, the gyro must agree with the attitude, and each
encoder must turn as its place on the robot does. The firmware's self-test then drives one motor after the other and
compares each with its encoder. Both together fix all signs and orders: a motor and an encoder that are exchanged
together pass the self-test, and the robot falls.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.findings import Finding, by_severity
from ballbot.link.messages import State
from ballbot.link.operators import MOVEMENTS, Movement, Operator
from ballbot.link.session import Session
from ballbot.mechanics.geometry import rotation

#: for which the robot must be still before and after a movement [s]
STILL_TIME = 0.5
#: angular velocity that counts as still, by hand [rad/s]
_STILL = 0.08
#: smallest turn that counts as a movement, and largest lean that counts as upright [rad]
LEAST_TURN, _UPRIGHT = math.radians(6.0), math.radians(5.0)
#: longest wait for the person [s]
PATIENCE = 60.0
#: share of a turn that must be about the expected axis: 0.8 is 37 degrees off, half the way to the next axis is 45
_ABOUT_AXIS = 0.8
#: a wrong scale is another unit or number of counts; a hand, a ball that rolls a little and a gyro's bias make less
_SCALE = (0.75, 1.33)
#: share of the encoders' turns that a still ball must explain
_EXPLAINED = 0.9
#: turn of a wheel by radian of the body below which an encoder is dead
_LEAST_WHEEL_TURN = 0.05
_AXES = ("x", "y", "z")


@dataclass(frozen=True, kw_only=True, eq=False)
class Turn:
    """What the sensors measured of one movement from upright."""

    movement: Movement
    attitude: NDArray[np.float64]  #: (3,) rotation vector, body frame [rad]
    gyro: NDArray[np.float64]  #: (3,) the same from the integral of the gyro [rad]
    wheels: NDArray[np.float64]  #: (n,) of the encoders [rad]


@dataclass(frozen=True, kw_only=True, eq=False)
class WiringCheck:
    """The result of a wiring check."""

    lean: tuple[float, float]  #: theta and phi of the robot held upright [rad]
    turns: tuple[Turn, ...]
    wheel_scales: tuple[float, ...]  #: each encoder's turn over that of its place; NaN if it is another's
    findings: tuple[Finding, ...]  #: errors first

    @property
    def passed(self) -> bool:
        """Whether nothing is wrong."""
        return not any(one.severity == "error" for one in self.findings)


def measure_turns(
    session: Session,
    operator: Operator,
    *,
    wheel_count: int,
    encoder_step: float,
    watch: Callable[[State], None],
) -> tuple[tuple[float, float], tuple[Turn, ...]]:
    """Ask for each movement, and return theta and phi of the robot held upright and what the sensors measured.

    Parameters
    ----------
    session : Session
        Of a disarmed robot.
    operator : Operator
    wheel_count : int
    encoder_step : float
        Turn of a wheel in one count [rad].
    watch : callable
        Takes every state.

    Raises
    ------
    InputError
        If the robot is not moved within a minute, a sensor gives nothing, or the link is lost.
    """
    lean, turns = (math.nan, math.nan), []
    for movement in MOVEMENTS:
        operator.hold_upright()
        # a robot that is still tilted from the last movement is not upright again
        upright = np.array(lean) if turns else None
        before = _until_still(session, watch, None, wheel_count, "upright and still", upright=upright)
        if not turns:
            lean = (float(before.attitude[0]), float(before.attitude[1]))
        operator.move(movement)
        after = _until_still(session, watch, before, wheel_count, movement.words)
        turn = rotation(*before.attitude).T @ rotation(*after.attitude)
        turns.append(
            Turn(
                movement=movement,
                attitude=Rotation.from_matrix(turn).as_rotvec(),
                gyro=after.gyro_integral,
                wheels=encoder_step * (after.counts - before.counts).astype(np.float64),
            )
        )
    return lean, tuple(turns)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rest:
    """A robot at rest."""

    attitude: NDArray[np.float64]  #: (3,) mean theta, phi, psi [rad]
    counts: NDArray[np.int64]  #: (n,)
    gyro_integral: NDArray[np.float64]  #: (3,) rotation vector since the last rest [rad]


def _until_still(
    session: Session,
    watch: Callable[[State], None],
    before: _Rest | None,
    wheel_count: int,
    words: str,
    *,
    upright: NDArray[np.float64] | None = None,
) -> _Rest:
    """Return the next rest: after a turn from another one, at given theta and phi (2,), or anywhere."""
    turned, attitudes, counts = Rotation.identity(), [], np.zeros(0)
    began = last = None
    moved = before is None
    for state in _states(session):
        watch(state)
        t = 1e-6 * (state.time % 2**32)
        began = t if began is None else began
        if (t - began) % (1e-6 * 2**32) > PATIENCE:
            raise InputError(f"The robot was not {words} within {PATIENCE:.0f} s; start the check again.")
        if not (state.imu_valid and state.encoders_valid):
            sensor = "encoders" if state.imu_valid else "IMU"
            raise InputError(f"The {sensor} of the robot give nothing; check the cable and the driver.")
        gyro = state.gyro.astype(np.float64)
        passed = 0.0 if last is None else (t - last) % (1e-6 * 2**32)
        last = t
        turned = turned * Rotation.from_rotvec(passed * gyro)
        counts = state.wheel_counts[:wheel_count].astype(np.int64)
        away = 0.0
        if before is not None:
            between = rotation(*before.attitude).T @ rotation(*state.attitude.astype(np.float64))
            away = max(float(np.linalg.norm(Rotation.from_matrix(between).as_rotvec())), turned.magnitude())
        moved = moved or away > LEAST_TURN
        still = float(np.linalg.norm(gyro)) < _STILL
        if upright is not None:
            still = still and bool((np.abs(state.attitude[:2] - upright) < _UPRIGHT).all())
        attitudes = [*attitudes, state.attitude.astype(np.float64)] if moved and still else []
        if attitudes and passed and len(attitudes) * passed >= STILL_TIME:
            return _Rest(attitude=np.mean(attitudes, axis=0), counts=counts, gyro_integral=turned.as_rotvec())
    raise AssertionError


def _states(session: Session) -> Iterator[State]:
    """Yield the robot's states as they come."""
    while True:
        yield from (one for one in session.poll(0.1) if isinstance(one, State))


def check_turns(
    lean: tuple[float, float], turns: Sequence[Turn], ball_from_wheels: NDArray[np.float64]
) -> WiringCheck:
    """Compare the sensors of each movement with the movement and with one another.

    Parameters
    ----------
    lean : tuple of two floats
        theta and phi of the robot held upright [rad].
    turns : sequence of Turn
        One about each axis.
    ball_from_wheels : ndarray (3, n)
        T_obw of the robot.
    """
    findings = [*_lean_findings(lean), *(one for turn in turns for one in _imu_findings(turn))]
    trusted = not findings
    wheels_from_ball = np.asarray(np.linalg.pinv(ball_from_wheels), dtype=np.float64)
    scales, of_wheels = _wheel_findings(turns, wheels_from_ball) if trusted else ((), ())
    return WiringCheck(
        lean=lean, turns=tuple(turns), wheel_scales=scales, findings=by_severity([*findings, *of_wheels])
    )


def _lean_findings(lean: tuple[float, float]) -> Iterator[Finding]:
    for name, value in zip(("theta", "phi"), lean, strict=True):
        if abs(value) > _UPRIGHT:
            yield _error(
                "imu",
                f"Held upright, the robot has {name} = {math.degrees(value):.0f} degrees: the IMU is mounted at an "
                "angle, or its frame does not have z up. Correct the mounting in ballbot_read_imu.",
            )


def _imu_findings(turn: Turn) -> Iterator[Finding]:
    """Yield what is wrong with the attitude and the gyro in one movement."""
    done = f"When the robot was {turn.movement.words}"
    expected = np.zeros(3)
    expected[turn.movement.axis] = turn.movement.sign
    size = float(np.linalg.norm(turn.attitude))
    if size < 0.5 * LEAST_TURN:
        yield _error(
            "imu", f"{done}, the attitude did not change and the gyro did: the attitude is not updated."
        )
        return
    along = float(turn.attitude @ expected) / size
    if along < _ABOUT_AXIS:
        yield _error(
            "imu",
            f"{done}, the attitude turned {_words_of(turn.attitude)} instead of {_words_of(expected)}. Turn the "
            "IMU's frame in ballbot_read_imu, or repeat the check if the robot was moved otherwise.",
        )
        return
    gyro = float(np.linalg.norm(turn.gyro))
    agreement = float(turn.gyro @ turn.attitude) / (gyro * size) if gyro > 0.0 else 0.0
    if gyro < 0.5 * LEAST_TURN:
        yield _error("imu", f"{done}, the attitude changed and the gyro showed no turn.")
    elif agreement < _ABOUT_AXIS:
        yield _error(
            "imu",
            f"{done}, the gyro turned {_words_of(turn.gyro)} and the attitude {_words_of(turn.attitude)}: they "
            "have different axes or signs.",
        )
    elif not _SCALE[0] < gyro / size < _SCALE[1]:
        yield _error(
            "imu",
            f"{done}, the gyro turned by {math.degrees(gyro):.0f} degrees and the attitude by "
            f"{math.degrees(size):.0f}: the gyro has another unit (degrees/s?) or range.",
        )


def _words_of(turn: NDArray[np.float64]) -> str:
    """Return a turn in words, by the axis that it is mostly about."""
    axis = int(np.argmax(np.abs(turn)))
    ways = (("to the right", "to the left"), ("forward", "backward"), ("to the left", "to the right"))
    way = ways[axis][0 if turn[axis] > 0 else 1]
    return f"{way} about {_AXES[axis]}"


def _wheel_findings(
    turns: Sequence[Turn], wheels_from_ball: NDArray[np.float64]
) -> tuple[tuple[float, ...], list[Finding]]:
    """Return each encoder's scale, and what is wrong with the encoders."""
    # a row for each movement, by radian, so that a large turn counts no more than a small one
    turned = np.array([turn.attitude / np.linalg.norm(turn.attitude) for turn in turns])
    measured = np.array([turn.wheels / np.linalg.norm(turn.attitude) for turn in turns])
    expected = -turned @ wheels_from_ball.T
    sizes = np.linalg.norm(expected, axis=0)
    products = measured.T @ expected / sizes**2  # encoder by place: its turn over that of the place
    correlations = products * sizes / np.maximum(np.linalg.norm(measured, axis=0), 1e-9)[:, None]
    scales, findings = [], []
    for encoder in range(measured.shape[1]):
        finding = _encoder_finding(encoder, correlations[encoder], products[encoder], measured[:, encoder])
        findings += [finding] if finding else []
        scales.append(math.nan if finding else float(products[encoder, encoder]))
    return tuple(scales), findings


def _encoder_finding(
    encoder: int,
    correlations: NDArray[np.float64],
    products: NDArray[np.float64],
    turned: NDArray[np.float64],
) -> Finding | None:
    """Return what is wrong with one encoder."""
    name = f"Encoder {encoder + 1}"
    place = int(np.argmax(np.abs(correlations)))
    if float(np.abs(turned).max()) < _LEAST_WHEEL_TURN:
        return _error(
            "encoders", f"{name} did not count when the robot was turned; check its cable and supply."
        )
    if abs(correlations[place]) < math.sqrt(_EXPLAINED):
        return _error(
            "encoders",
            f"{name} did not turn as any wheel must: the ball rolled, or the wheel slipped. Hold the ball with a "
            "foot and repeat the check.",
        )
    if place != encoder:
        return _error(
            "encoders",
            f"{name} turned as wheel {place + 1} must: exchange the cables, of motor and encoder alike, or correct "
            "the azimuths in the robot file.",
        )
    if correlations[place] < 0.0:
        return _error(
            "encoders",
            f"{name} counts backward: reverse it in ballbot_read_encoders. If the self-test then fails, reverse the "
            "motor as well.",
        )
    if not _SCALE[0] < products[place] < _SCALE[1]:
        return _error(
            "encoders",
            f"{name} turned {products[place]:.2g} times as far as wheel {place + 1} must: correct encoder_counts or "
            "gear_ratio in the robot file, or count all four edges.",
        )
    return None


def _error(code: str, text: str) -> Finding:
    return Finding(code=code, severity="error", text=text)
