"""Whether the wheels of a sweep turned freely: what a log shows where the ball was on them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log import Log

#: a body that is held still leans about its mean by less, beside sensor noise; one that balances, by half a degree
#: and more (root mean square) [rad]
_STILL = np.radians(0.2)
_LEANS = ("theta", "phi")
_BALL = ("ball_omega_x", "ball_omega_y", "ball_omega_z")


def check_wheels_free(log: Log) -> None:
    """Refuse the log of a robot that balances, or that has the ball on its wheels.

    A log without lean and without the ball's angular velocity tells neither, and passes.

    Raises
    ------
    InputError
        Where it is such a log.
    """
    for name in _LEANS:
        swing = _deviation(_known(log, name))
        if swing > _STILL:
            raise InputError(
                f"In this log the body sways by {np.degrees(swing):.2g} degrees (root mean "
                f"square of {name}), as when it balances. A sweep needs the body held still and "
                "the wheels off the ball; use `ballbot identify` for logs of a balancing robot."
            )
    for name in _BALL:
        if np.any(_known(log, name) != 0.0):
            raise InputError(
                f"In this log a ball turns ({name}). A sweep needs the wheels off the ball; "
                "use `ballbot identify-upside-down` for logs of the ball on the clamped robot."
            )


def _known(log: Log, name: str) -> NDArray[np.float64]:
    """Return a column's values without those that are missing; none where there is no such column."""
    values = log[name] if name in log else np.empty(0)
    return values[np.isfinite(values)]


def _deviation(values: NDArray[np.float64]) -> float:
    """Return the standard deviation that white noise, judged by the changes from row to row, does not explain."""
    if values.size < 2:
        return 0.0
    return float(np.sqrt(max(np.var(values) - 0.5 * np.mean(np.diff(values) ** 2), 0.0)))
