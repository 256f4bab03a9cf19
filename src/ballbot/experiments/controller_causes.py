"""Why a robot does not do what was predicted: likely causes, ranked by what its log shows.

The log's signature (`ballbot.experiments.log_signature`) is compared with that of a predicted run of the same
controller. Each difference is divided by its usual size on a robot without faults, and is evidence for one cause: that
which moves it. The cause with the clearest evidence is the likeliest. What no difference shows is not guessed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from ballbot.experiments.log_signature import Signature

CauseName = Literal["delay", "grip", "friction", "sensor", "mapping", "body", "floor"]
Confidence = Literal["likely", "possible"]

#: evidence, in usual sizes, from which a cause is named as possible, and as likely
POSSIBLE, LIKELY = 3.0, 6.0

#: what each cause is, for those who read it
MEANING: Mapping[CauseName, str] = MappingProxyType(
    {
        "delay": "torques act later, or through something soft",
        "grip": "wheels slip",
        "friction": "the friction has changed",
        "sensor": "a sensor errs",
        "mapping": "torques or columns have another scale, sign or order, or the robot another mass",
        "body": "the body has another height or mass",
        "floor": "the floor is not level, or pushes the robot",
    }
)

#: codes of accepted errors of the log's checks that name a cause
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
#: errors of a log that are about what the robot did, and stop no verdict on it
EXPLAINED_CODES = frozenset({*_CAUSE_OF_CODE, "fall", "hands", "saturation", "disturbance"})


@dataclass(frozen=True, kw_only=True)
class Cause:
    """One cause with its evidence."""

    name: CauseName
    clearness: float  #: of the evidence, in its usual sizes on a robot without faults
    confidence: Confidence
    evidence: str  #: one sentence with the number


@dataclass(frozen=True, kw_only=True)
class _Symptom:
    """A number of the signature that one cause moves."""

    number: str  #: of `Signature`
    cause: CauseName
    #: difference on a robot without faults; of a ratio, its logarithm. Chosen on the development set of
    #: `benchmarks.controller_prediction`: no robot without faults comes near `POSSIBLE` usual sizes
    usual: float
    words: str  #: with {seen} and {expected}
    ratio: bool = False
    unit: float = 1.0  #: that the words are in
    moves: Literal["up", "down", "either"] = "either"  #: which change is evidence


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
        words="the largest acceleration that no lean explains is {seen} times the usual one, predicted {expected}",
    ),
    _Symptom(
        number="friction",
        cause="friction",
        usual=0.06,
        ratio=True,
        words="torques against the motion are {share} times those predicted",
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
        words="the gyro shows {seen} mrad/s on average where nothing turns, predicted {expected}",
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
        words="the torques are {share} times what the motion needs",
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
    """Return the causes that a log shows, the clearest first; none if it shows none.

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
        Cause(
            name=_CAUSE_OF_CODE[code],
            clearness=np.inf,
            confidence="likely",
            evidence=f"the log's checks found `{code}`",
        )
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
    found.sort(key=lambda cause: -cause.clearness)
    clearest = {cause.name: cause for cause in reversed(found)}
    return tuple(cause for cause in found if cause is clearest[cause.name])


def clearness(symptom: _Symptom, seen: float, expected: float) -> float:
    """Return how far a number is from the predicted one, in usual sizes; NaN if either is unknown."""
    if symptom.ratio:
        known = seen > 0.0 and expected > 0.0
        apart = float(np.log(seen / expected)) if known else np.nan
    else:
        apart = seen - expected
    return {"up": apart, "down": -apart, "either": abs(apart)}[symptom.moves] / symptom.usual


def _evidence(symptom: _Symptom, seen: float, expected: float) -> Cause | None:
    clear = clearness(symptom, seen, expected)
    if not clear >= POSSIBLE:
        return None
    words = symptom.words.format(
        seen=f"{seen / symptom.unit:.3g}",
        expected=f"{expected / symptom.unit:.3g}",
        difference=f"{(seen - expected) / symptom.unit:.3g}",
        share=f"{seen / expected:.3g}" if expected else "",
    )
    return Cause(
        name=symptom.cause,
        clearness=clear,
        confidence="likely" if clear >= LIKELY else "possible",
        evidence=words,
    )
