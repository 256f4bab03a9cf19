"""What every friction law is: values, a steady curve, and four compiled functions on one interface.

A law may carry internal states (a bristle's deflection, a dwell time); at constant speed it settles on its steady
curve. Laws that can stick read the torque that is applied: at rest their friction is what balances it, up to a
limit. What a law does while an inertia moves under it (sticking, breaking away, stiff bristles) it knows best
itself, so the step of a driven inertia belongs to the interface too.

In compiled code a law is a named tuple of its numbers, and its type chooses the functions (`register`). A law's
state is an array, empty where it has none, that these functions change in place.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.mechanics.compiled import by_types_of


class FrictionLaw(Protocol):
    """A friction law's values. Speeds may be [rad/s] or [m/s]; torques are then [N m] or [N], and so on."""

    def numbers(self) -> tuple[float, ...]:
        """Return the named tuple that compiled code reads."""
        ...

    def initial_state(self, step: float) -> NDArray[np.float64]:
        """Return the state (m,) after a long rest without load, for time steps of `step` [s]."""
        ...

    def steady_friction(self, speed: ArrayLike) -> NDArray[np.float64]:
        """Return the friction [N m] at speeds (...) that have been constant for long; 0 at rest."""
        ...

    def explicit_slope(self) -> float:
        """Return the steepest slope [N m s/rad] of friction against speed that the law's step takes explicitly."""
        ...


def friction_of(
    law, state, speed, applied
) -> float:  # pragma: no cover (compiled forms come from `register`)
    """Return the friction; where the law sticks, what balances the torque `applied`, within the law's limit."""
    raise NotImplementedError("compiled code only")


def settle(law, state, before, after, h) -> None:  # pragma: no cover
    """Advance a law's state by h [s] while the speed goes from `before` to `after`; exact where they are equal."""
    raise NotImplementedError("compiled code only")


def move(law, inertia, torque, state, speed, h) -> tuple[float, float]:  # pragma: no cover
    """Advance an inertia under the law by h [s] with the torque held; return its speed and the angle travelled."""
    raise NotImplementedError("compiled code only")


def visible_speed(law, speed) -> float:  # pragma: no cover
    """Return the speed at which the law lets the inertia turn: 0 where it counts a small one as rest."""
    raise NotImplementedError("compiled code only")


def register(
    numbers: type,
    *,
    friction: Callable,
    settling: Callable,
    moving: Callable,
    visible: Callable,
) -> None:
    """Make compiled functions those of the laws whose numbers are of that type.

    Parameters
    ----------
    numbers : type
        A named tuple.
    friction, settling, moving, visible : callable
        Inlined functions with the arguments of `friction_of`, `settle`, `move` and `visible_speed`.
    """

    @by_types_of(friction_of)
    def _friction_of(law, state, speed, applied):
        if law.instance_class is numbers:
            return lambda law, state, speed, applied: friction(law, state, speed, applied)
        return None

    @by_types_of(settle)
    def _settle(law, state, before, after, h):
        if law.instance_class is numbers:
            return lambda law, state, before, after, h: settling(law, state, before, after, h)
        return None

    @by_types_of(move)
    def _move(law, inertia, torque, state, speed, h):
        if law.instance_class is numbers:
            return lambda law, inertia, torque, state, speed, h: moving(law, inertia, torque, state, speed, h)
        return None

    @by_types_of(visible_speed)
    def _visible_speed(law, speed):
        if law.instance_class is numbers:
            return lambda law, speed: visible(law, speed)
        return None
