"""Integral action: a place or heading that stays wrong is worked against until it is right.

    I' = e - I/T        e the error of x, y and psi, world frame; I within its limits, never growing while a
                        wheel's torque is at its limit, at rest while e is within the dead band
    u += K_I S(psi) I

A floor that tilts, an AHRS whose lean is off and what compensation leaves of the friction all end in such an error.
The leak 1/T forgets what no longer holds; with it an error e under a constant push is not zero, but I = T e holds.
The dead band keeps a robot that sticks within it from hunting: an integral that grows until a wheel breaks away
ends in a limit cycle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import real_array
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined


@dataclass(frozen=True, kw_only=True, eq=False)
class IntegralAction:
    """How the error's integral is fed back.

    Raises
    ------
    InputError
        Where the gain is not finite or a number is not one it can be.
    """

    gain: NDArray[np.float64]  #: K_I (n, 3) for the integrals of x, y, psi [N m/(m s), N m/(rad s)]
    limit: float = 0.3  #: of the integral of x, and of y [m s]
    yaw_limit: float = 0.5  #: of the integral of psi [rad s]
    memory: float = 60.0  #: T [s]
    dead_band: float = 0.0  #: error of x and y, and of psi, below which theirs rests [m, rad]

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "gain", real_array(self.gain, ("wheels", 3), "The gain"))
        except InputError:
            raise InputError(
                "The gain of the integral action must be three finite numbers for each wheel."
            ) from None
        for name in ("limit", "yaw_limit", "memory"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{name} of the integral action is {value:g}; it must be positive.")
        if not 0.0 <= self.dead_band < math.inf:
            raise InputError(
                f"dead_band of the integral action is {self.dead_band:g}; it must be zero or more."
            )


#: numbers that `pack_integral` returns for all wheels together, and for each
INTEGRAL_SIZE, INTEGRAL_PER_WHEEL = 5, 3
#: numbers that it remembers: the integrals of x, y and psi
INTEGRAL_MEMORY = 3


def pack_integral(
    integral: IntegralAction | None, wheel_count: int, sample_time: float
) -> tuple[list[float], NDArray[np.float64]]:
    """Return what the wheels share (5,) and the gain (n, 3); all zero where there is none."""
    if integral is None:
        return [0.0] * INTEGRAL_SIZE, np.zeros((wheel_count, INTEGRAL_PER_WHEEL))
    shared = [
        sample_time,
        math.exp(-sample_time / integral.memory),
        integral.limit,
        integral.yaw_limit,
        integral.dead_band,
    ]
    return shared, integral.gain


@inlined
def integrate(row, place, memory, first, e_x, e_y, e_psi, beyond):
    """Step the integrals by a sample's error, world frame; where a wheel is `beyond` its limit they may only shrink."""
    h, kept, limit, yaw_limit, dead_band = (
        row[place],
        row[place + 1],
        row[place + 2],
        row[place + 3],
        row[place + 4],
    )
    if e_x * e_x + e_y * e_y > dead_band * dead_band:
        memory[first] = _stepped(memory[first], kept, h * e_x, limit, beyond)
        memory[first + 1] = _stepped(memory[first + 1], kept, h * e_y, limit, beyond)
    if abs(e_psi) > dead_band:
        memory[first + 2] = _stepped(memory[first + 2], kept, h * e_psi, yaw_limit, beyond)


@inlined
def _stepped(value, kept, change, limit, beyond):
    after = max(-limit, min(limit, kept * value + change))
    return value if beyond and abs(after) > abs(value) else after
