"""Whether a record's force is that of the control loop given with it.

The force of a position loop around a velocity loop follows from the recorded position and reference,

    force = f k_v (k_p a_1 (reference - position) - a_2 velocity)        a_1 = a_2 = 1

All of it is filtered and decimated as in the inverse model, so that noise of the position does not bias a_2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbot.fitting.least_squares import fit_linear
from ballbot.identification.axis.motion import Decimation, default_bandwidth
from ballbot.identification.axis.output_error import BLOCK
from ballbot.identification.axis.record import AxisRecord

#: rows at the limit, which is met at the largest force, follow no linear law
_AT_LIMIT = 0.98
#: and so many others are needed
_LEAST_ROWS = 50
#: another loop has a factor that is so many standard errors, and this share, from one, or leaves this share of the
#: force unexplained, of which a coarse encoder leaves a tenth
_APART, _TOLERANCE, _UNEXPLAINED = 3.0, 0.03, 0.2


@dataclass(frozen=True, kw_only=True)
class LoopLaw:
    """The loop's law fitted to a record: factors of its two parts, and the residual's share of the force."""

    position: float  #: a_1
    velocity: float  #: a_2
    errors: tuple[float, float]  #: standard errors of both
    residual: float

    @property
    def differs(self) -> bool:
        """Whether the record is of another loop."""
        apart = (
            abs(factor - 1.0) > max(_APART * error, _TOLERANCE)
            for factor, error in zip((self.position, self.velocity), self.errors, strict=True)
        )
        return any(apart) or self.residual > _UNEXPLAINED


def fitted_loop_law(record: AxisRecord) -> LoopLaw | None:
    """Return the law of a record's loop, None if it has no loop or too few rows determine it."""
    loop = record.loop
    if loop is None or record.reference is None:
        return None
    span, rows = loop.span, Decimation(record, bandwidth=default_bandwidth(record))
    if not rows.kept:
        return None
    velocity = (record.position[span:] - record.position[:-span]) / (span * record.sample_time)
    velocity = np.concatenate([np.full(span, velocity[0]), velocity])
    scale = loop.force_per_input * loop.velocity_gain
    asked = loop.position_gain * (record.reference - record.position)
    size = np.abs(record.loop_force)
    limited = rows.of((size >= _AT_LIMIT * size.max()).astype(float)) > 0.01
    free = ~limited & ~rows.disturbed
    X = scale * np.column_stack([rows.of(asked), rows.of(-velocity)])[free]
    force = rows.of(record.loop_force)[free]
    if len(X) < _LEAST_ROWS or np.linalg.matrix_rank(X) < 2:
        return None
    fit = fit_linear(X, force, (rows.of(record.t)[free] // BLOCK).astype(np.int64))
    return LoopLaw(
        position=float(fit.values[0]),
        velocity=float(fit.values[1]),
        errors=(float(fit.errors[0]), float(fit.errors[1])),
        residual=float(np.linalg.norm(fit.residuals) / np.linalg.norm(force)),
    )
