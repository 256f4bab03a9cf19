"""Why a run is not as predicted: likely causes, ranked by the evidence in its log.

A log's signature is a few numbers that faults of the robot change. The torques are compared with the motion, and the
ball's acceleration with the lean (`ballbot.log.checks`), each by a least-squares fit whose factors are one, or zero,
for the robot as identified:

    u_i = k_i n_i + s f(w_i) + o_i                     n the torque of the motion, f the identified friction
    v_dot + C w_dot = -gamma Lambda g - r v/|v| + e     independent of the driveline

The lag at which the first fits best is the delay from torque to motion. Noise, play and rollers change a signature
too, so a log's signature is compared with that of a simulated run of the same controller, not with ones and zeros.
Each difference is divided by its usual size on a robot without faults, and is evidence for one cause. The cause with
the strongest evidence is the likeliest. No cause is named without evidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, warning
from ballbot.log import Log
from ballbot.log.checks.lean import Motion, Rows, as_complex, as_plane, motion_of, usable_rows
from ballbot.log.checks.torque_balance import SIGN, Driving, driving_of, smoothed_wheel_speeds
from ballbot.log.columns import torque_names
from ballbot.mechanics.friction import wheel_friction
from ballbot.mechanics.model import contact_momentum
from ballbot.results import reported
from ballbot.robot import Robot

#: exponent of the weight of rows in which a wheel may have stood still within the filter's window
_TURNED_POWER = 4
#: samples by which the torques may act later than logged; a filter of the state makes them seem early
EARLIEST, LATEST = -10, 14
#: unexplained fraction of the torques above which the torque law determines nothing
_UNCLEAR = 0.2
#: width of a filter that keeps fast motion, from which a delay is determined [s]
_QUICK = 0.02
#: ball speed below which the direction of rolling friction is unknown [m/s]
_ROLLING = 0.01
#: blocks over which a lean's error is averaged [s]
_SLOW = 2.0


@dataclass(frozen=True, kw_only=True)
class Signature:
    """Numbers of one log; NaN if it does not determine one."""

    delay: float  #: from torque to motion, by quick motion [s]; that of a filtered state is negative
    frequency: float  #: mean frequency of the torques' changes, by their power [Hz]
    torque_gain: float  #: torque over the torque of the motion [-]
    torque_spread: float  #: the largest wheel's gain over the smallest's [-]
    friction: float  #: over the identified one [-]
    asymmetry: (
        float  #: constant torque common to all wheels, as from friction that differs by direction [N m]
    )
    rolling: float  #: deceleration of the ball not explained by the lean [m/s^2]
    force: float  #: constant torques along the floor beyond those of the motion, as from a slope [N m]
    gravity: float  #: ball acceleration over the acceleration caused by the lean [-]
    turn: float  #: of the lean against the ball's acceleration, about the vertical [rad]
    lean_offset: float  #: constant error of the lean [rad]
    lean_wander: float  #: its slow change, standard deviation [rad]
    gyro_noise: float  #: standard deviation of a sample [rad/s]
    gyro_bias: float  #: mean rate of a lean that stays [rad/s]
    slip: float  #: largest acceleration not explained by the lean, over the median one [-]
    unexplained: float  #: fraction of the torques not explained by the fit


#: numbers that depend on the robot's friction alone, not on its controller
OF_FRICTION = ("friction", "rolling")


def signature_of(log: Log, robot: Robot) -> Signature | None:
    """Return a log's signature; None if it has too little motion, or lacks states or torques.

    Parameters
    ----------
    log : Log
    robot : Robot
        As identified.
    """
    rows = usable_rows(log, robot)
    if rows is None or not set(torque_names(robot.wheel_count)) <= set(log.names):
        return None
    motion = motion_of(log, rows)
    driving = driving_of(log, rows, motion, robot)
    if driving is None:
        return None
    law = _torque_law(log, rows, driving, robot)
    lean = _lean_law(motion, robot)
    delay = _delay(log, replace(rows, width=_QUICK), robot)
    noise, bias = _gyro(log)
    return Signature(
        delay=delay, frequency=_frequency(log, robot), **law, **lean, gyro_noise=noise, gyro_bias=bias
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    """The torque law at one lag."""

    late: float  #: [s]
    left: float  #: unexplained fraction of the torques
    gains: NDArray[np.float64]  #: k (n,)
    friction: float  #: s
    constants: NDArray[np.float64]  #: o (n,) [N m]


def _torque_law(log: Log, rows: Rows, driving: Driving, robot: Robot) -> dict[str, float]:
    found = min(_fits(log, rows, driving, robot), key=lambda fit: fit.left)
    if found.left > _UNCLEAR:
        names = ("torque_gain", "torque_spread", "friction", "asymmetry", "force")
        return dict.fromkeys(names, np.nan) | {"unexplained": found.left}
    along = found.constants - found.constants.mean()
    return {
        "torque_gain": float(found.gains.mean()),
        "torque_spread": _spread(found.gains),
        "friction": found.friction,
        "asymmetry": float(found.constants.mean()),
        "force": float(np.linalg.norm(along)),
        "unexplained": found.left,
    }


def _delay(log: Log, rows: Rows, robot: Robot) -> float:
    """Return the lag at which the torque law fits quick motion best [s]; NaN if it is beyond those tried."""
    driving = driving_of(log, rows, motion_of(log, rows), robot)
    if driving is None:
        return np.nan
    fits = _fits(log, rows, driving, robot)
    best = min(range(len(fits)), key=lambda k: fits[k].left)
    if not 0 < best < len(fits) - 1:
        return np.nan
    # the vertex of the parabola through the three best
    before, here, after = (fits[k].left for k in (best - 1, best, best + 1))
    return fits[best].late + 0.5 * log.sample_time * (before - after) / (before - 2.0 * here + after)


def _fits(log: Log, rows: Rows, driving: Driving, robot: Robot) -> list[_Fit]:
    """Return the torque law's fits at all lags."""
    speeds = smoothed_wheel_speeds(log, robot)
    friction = rows.filtered(
        log, np.abs(wheel_friction(speeds, robot.friction)) * np.tanh(speeds / SIGN)
    ).value
    lags = [k * log.sample_time for k in range(EARLIEST, LATEST + 1)]
    return [_fitted(log, rows, driving, friction, late=late) for late in lags]


def _frequency(log: Log, robot: Robot) -> float:
    """Return the mean frequency of the torques' changes [Hz]: a delayed loop oscillates more slowly."""
    torques = np.column_stack([log[name] for name in torque_names(robot.wheel_count)])
    changes = np.diff(torques[np.isfinite(torques).all(axis=1)], axis=0)
    power = np.sum(np.abs(np.fft.rfft(changes, axis=0)) ** 2, axis=1)
    frequencies = np.fft.rfftfreq(len(changes), log.sample_time)
    return float(np.sum(frequencies * power) / max(float(power.sum()), 1e-30))


def _fitted(log: Log, rows: Rows, driving: Driving, friction: NDArray[np.float64], *, late: float) -> _Fit:
    """Fit all torques at once: a gain and a constant for each wheel, one factor of the friction (N, n)."""
    n = friction.shape[1]
    acting = late + 0.5 * log.sample_time
    torque = rows.filtered(log, np.column_stack([log[name] for name in torque_names(n)]), late=acting).value
    weight = driving.turning**_TURNED_POWER
    zero = np.zeros_like(friction)
    blocks = []
    for i in range(n):
        gain, constant = zero.copy(), zero.copy()
        gain[:, i], constant[:, i] = driving.needed[:, i], 1.0
        blocks.append(np.column_stack([gain, constant, friction[:, i]]) * weight[:, [i]])
    X, u = np.vstack(blocks), (torque * weight).T.ravel()
    fit = np.asarray(np.linalg.lstsq(X, u, rcond=None)[0], dtype=np.float64)
    left = float(np.sum((u - X @ fit) ** 2)) / max(float(np.sum(u**2)), 1e-30)
    return _Fit(late=late, left=left, gains=fit[:n], constants=fit[n : 2 * n], friction=float(fit[-1]))


def _lean_law(motion: Motion, robot: Robot) -> dict[str, float]:
    law = contact_momentum(robot)
    v, turning = motion.velocity, 1j * motion.turning
    theta, phi = motion.lean
    w = [one.value for one in motion.lean_rate]
    w_dot = [one.rate for one in motion.lean_rate]
    rate = as_complex(as_plane(w_dot[0] + 1j * w_dot[1]) @ law.lever[:, :2].T)
    rate += turning * as_complex(as_plane(w[0] + 1j * w[1]) @ law.lever[:, :2].T)
    pull = as_complex(as_plane(1j * theta - phi) @ law.pull.T)
    rolling = v.value / np.maximum(np.abs(v.value), _ROLLING)
    y = v.rate + turning * v.value + rate
    X = np.column_stack([-pull, -rolling, np.ones_like(pull)])
    gravity, friction, constant = np.linalg.lstsq(X, y, rcond=None)[0]
    error = y - X[:, :2] @ np.array([gravity, friction])
    size = float(np.sqrt(np.abs(np.linalg.det(law.pull))))
    slow = np.unique(np.floor(motion.t / _SLOW).astype(int), return_inverse=True)[1]
    counts = np.bincount(slow)
    means = (np.bincount(slow, weights=error.real) + 1j * np.bincount(slow, weights=error.imag)) / counts
    residual = np.abs(error - constant)
    return {
        "rolling": float(friction.real),
        "gravity": float(abs(gravity)),
        "turn": float(np.angle(gravity)),
        "lean_offset": float(abs(constant)) / size,
        "lean_wander": float(np.std(means)) / size,
        "slip": float(residual.max() / max(float(np.median(residual)), 1e-9)),
    }


def _gyro(log: Log) -> tuple[float, float]:
    """Return the noise of a gyro's sample and the mean of its lean rates [rad/s]; NaN without a gyro."""
    names = ("gyro_x", "gyro_y")
    if not set(names) <= set(log.names):
        return np.nan, np.nan
    rates = np.column_stack([log[name] for name in names])
    rates = rates[np.isfinite(rates).all(axis=1)]
    # second differences leave noise and take the motion away; theirs is sqrt(6) times as large
    change = np.diff(rates, n=2, axis=0)
    return float(np.sqrt(np.mean(change**2) / 6.0)), float(np.linalg.norm(rates.mean(axis=0)))


def _spread(values: NDArray[np.float64]) -> float:
    return float(values.max() / values.min()) if values.min() > 0.0 else np.nan


CauseName = Literal["delay", "grip", "friction", "sensor", "mapping", "body", "floor"]
Confidence = Literal["likely", "possible"]

#: strength of the evidence from which a cause is possible, and likely
POSSIBLE, LIKELY = 3.0, 6.0

#: each cause in words
CAUSE_MEANINGS: Mapping[CauseName, str] = MappingProxyType(
    {
        "delay": "torques act later, or through something soft",
        "grip": "wheels slip",
        "friction": "the friction has changed",
        "sensor": "a sensor has an error",
        "mapping": "torques or columns have another scale, sign or order, or the robot another mass",
        "body": "the body has another height or mass",
        "floor": "the floor is not level, or something pushes the robot",
    }
)

#: the cause that an accepted error of the log's checks names, by its code
_CAUSE_OF_CODE: Mapping[str, CauseName] = MappingProxyType(
    {
        **dict.fromkeys(
            ("ball-axes", "degrees", "heading-sign", "lean-axes", "lean-scale", "scale", "sign", "swapped"),
            "mapping",
        ),
        **dict.fromkeys(
            ("torque-order", "torque-scale", "torque-sign", "torque-unrelated", "wheels"), "mapping"
        ),
        **dict.fromkeys(("dead-motor", "torque-clipped"), "mapping"),
        **dict.fromkeys(("constant", "glitch", "held", "lean-offset", "reset", "spike", "stuck"), "sensor"),
        "torque-delay": "delay",
    }
)
#: errors of a log that describe the robot's motion and do not prevent a verdict
EXPLAINED_CODES = frozenset({*_CAUSE_OF_CODE, "fall", "hands", "saturation", "disturbance"})


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A likely cause with its evidence."""

    name: CauseName
    confidence: Confidence
    strength: (
        float  #: of the evidence, in usual differences on a robot without faults; infinite for a failed check
    )
    finding: Finding  #: one sentence with the number

    @reported
    def meaning(self) -> str:
        """The cause in words."""
        return CAUSE_MEANINGS[self.name]


@dataclass(frozen=True, kw_only=True)
class _Symptom:
    """A number of the signature that one cause changes."""

    number: str  #: of `Signature`
    cause: CauseName
    #: difference on a robot without faults; of a ratio, its logarithm. Chosen on the development set of
    #: `campaigns.controller_prediction`: no robot without faults comes near `POSSIBLE` usual sizes
    usual: float
    words: str  #: with {seen}, {expected}, {difference} or {share}
    ratio: bool = False
    unit: float = 1.0  #: that the words are in
    moves: Literal["up", "down", "either"] = "either"  #: the change that is evidence


SYMPTOMS = (
    _Symptom(
        number="delay",
        cause="delay",
        usual=0.0015,
        unit=1e-3,
        words="torques act on the motion {difference} ms or more later than predicted",
        moves="up",
    ),
    _Symptom(
        number="frequency",
        cause="delay",
        usual=0.03,
        ratio=True,
        moves="down",
        words="the torques change at {seen} Hz on average, as in a loop that is late, predicted {expected} Hz",
    ),
    _Symptom(
        number="slip",
        cause="grip",
        usual=0.4,
        ratio=True,
        moves="up",
        words="the largest acceleration not explained by the lean is {seen} times the median one, predicted {expected}",
    ),
    _Symptom(
        number="friction",
        cause="friction",
        usual=0.06,
        ratio=True,
        words="the friction torques are {share} times those predicted",
    ),
    _Symptom(
        number="asymmetry",
        cause="friction",
        usual=0.01,
        words="all wheels need {seen} N m more in one direction than in the other, predicted {expected}",
    ),
    _Symptom(
        number="rolling",
        cause="friction",
        usual=0.01,
        words="the ball is braked by {seen} m/s^2, predicted {expected}",
    ),
    _Symptom(
        number="gyro_noise",
        cause="sensor",
        usual=0.1,
        ratio=True,
        words="the gyro's noise is {seen} mrad/s, predicted {expected}",
        unit=1e-3,
        moves="up",
    ),
    _Symptom(
        number="gyro_bias",
        cause="sensor",
        usual=0.0006,
        words="the gyro measures {seen} mrad/s on average at a constant lean, predicted {expected}",
        unit=1e-3,
        moves="up",
    ),
    _Symptom(
        number="lean_wander",
        cause="sensor",
        usual=0.3,
        ratio=True,
        words="the lean's error wanders by {seen} mrad, predicted {expected}",
        unit=1e-3,
        moves="up",
    ),
    _Symptom(
        number="lean_offset",
        cause="sensor",
        usual=0.0008,
        words="the lean is off by {seen} mrad on average, predicted {expected}",
        unit=1e-3,
        moves="up",
    ),
    _Symptom(
        number="torque_spread",
        cause="mapping",
        usual=0.02,
        ratio=True,
        words="the torques of one wheel are {seen} times those of another for the same motion, predicted {expected}",
        moves="up",
    ),
    _Symptom(
        number="turn",
        cause="mapping",
        usual=0.02,
        words="the lean is turned by {seen} rad against the ball's acceleration, predicted {expected}",
    ),
    _Symptom(
        number="torque_gain",
        cause="mapping",
        usual=0.02,
        ratio=True,
        words="the torques are {share} times those of the motion",
    ),
    _Symptom(
        number="gravity",
        cause="body",
        usual=0.03,
        ratio=True,
        words="the ball accelerates {share} times as much for the same lean as predicted",
    ),
    _Symptom(
        number="force",
        cause="floor",
        usual=0.015,
        words="the wheels hold the robot with {seen} N m on average, predicted {expected}",
        moves="up",
    ),
)


def ranked_causes(
    seen: Signature | None, expected: Mapping[str, float], *, codes: Sequence[str] = ()
) -> tuple[Cause, ...]:
    """Return the causes with evidence in a log, the strongest first; empty without evidence.

    Parameters
    ----------
    seen : Signature or None
        Of the log; None if it has too little motion.
    expected : mapping of str to float
        Of the predicted run; a number that is missing or NaN is no evidence.
    codes : sequence of str
        Of errors that the log's checks found.
    """
    found = [
        _cause(_CAUSE_OF_CODE[code], np.inf, f"The checks of the log report `{code}`.")
        for code in dict.fromkeys(codes)
        if code in _CAUSE_OF_CODE
    ]
    if seen is not None:
        numbers = asdict(seen)
        found += [
            cause
            for symptom in SYMPTOMS
            if (cause := _evidence(symptom, numbers[symptom.number], expected.get(symptom.number, np.nan)))
        ]
    found.sort(key=lambda cause: -cause.strength)
    strongest = {cause.name: cause for cause in reversed(found)}
    return tuple(cause for cause in found if cause is strongest[cause.name])


def strength(symptom: _Symptom, seen: float, expected: float) -> float:
    """Return how far a number is from the predicted one, in usual differences; NaN if either is unknown."""
    if symptom.ratio:
        known = seen > 0.0 and expected > 0.0
        apart = float(np.log(seen / expected)) if known else np.nan
    else:
        apart = seen - expected
    return {"up": apart, "down": -apart, "either": abs(apart)}[symptom.moves] / symptom.usual


def _evidence(symptom: _Symptom, seen: float, expected: float) -> Cause | None:
    found = strength(symptom, seen, expected)
    if not found >= POSSIBLE:
        return None
    words = symptom.words.format(
        seen=f"{seen / symptom.unit:.3g}",
        expected=f"{expected / symptom.unit:.3g}",
        difference=f"{(seen - expected) / symptom.unit:.3g}",
        share=f"{seen / expected:.3g}" if expected else "",
    )
    return _cause(symptom.cause, found, f"{words[0].upper()}{words[1:]}.")


def _cause(name: CauseName, strength: float, text: str) -> Cause:
    return Cause(
        name=name,
        confidence="likely" if strength >= LIKELY else "possible",
        strength=strength,
        finding=warning("cause", text),
    )
