"""How gains track a square of steps on a model: the error that is left, and how far the robot leans for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.references import square
from ballbot.mechanics.model import Model
from ballbot.simulation.batch import simulate_batch

#: the path: once around, from corner to corner by steps of half a metre
SIDE, PERIOD, ROUNDS = 0.5, 32.0, 2
#: the last seconds at a corner, over which what is left of the step's error is taken
SETTLED = 2.0


@dataclass(frozen=True, kw_only=True)
class Track:
    """How one controller did."""

    settled_error: float  #: root mean square distance from the corner over its last two seconds [m]
    rms_error: float  #: root mean square distance from the corner over the whole run [m]
    peak_lean: float  #: largest of |theta| and |phi| [rad]
    fell: bool


def track(model: Model, controllers: Sequence[Controller]) -> list[Track]:
    """Run each controller twice around the square on the model and say how it did.

    Parameters
    ----------
    model : Model
        With the friction that the runs are to have.
    controllers : sequence of Controller
        Of one sample time.
    """
    reference = square(side=SIDE, period=PERIOD)
    batch = simulate_batch(model, controllers, reference, duration=ROUNDS * PERIOD)
    wanted = np.stack([reference(t - controllers[0].sample_time) for t in batch.t])
    distance = np.linalg.norm(batch.states[..., :2] - wanted[:, :2], axis=-1)
    late = np.mod(batch.t, PERIOD / 4.0) > PERIOD / 4.0 - SETTLED
    return [
        Track(
            settled_error=_rms(off[late]),
            rms_error=_rms(off),
            peak_lean=float(np.abs(states[:, 2:4]).max()),
            fell=not survived,
        )
        for off, states, survived in zip(distance, batch.states, batch.survived, strict=True)
    ]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
