"""References: where the robot is asked to be.

A reference is a function f(t) -> (10,) in the order of `ballbot.log.columns.STATE_NAMES`. Only x, y and psi
are ever other than zero: with the rest zero, A r = 0 holds for the linearised robot, and the controller u =
K S(psi) (r - x) may rest there (design.md section 8). A reference that moves therefore asks for a place and
never for a speed.
"""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError

#: where the robot is asked to be (10,) at a time [s]; its arrays are to be read only
Reference = Callable[[float], NDArray[np.float64]]

#: a corner that rounding puts this little [s] after the sample it belongs to is taken at that sample
_ROUNDING = 1e-9


def hold(*, x: float = 0.0, y: float = 0.0, psi: float = 0.0) -> Reference:
    """Stand at one pose: x, y [m], psi [rad]."""
    pose = _pose(x, y, psi)
    pose.setflags(write=False)  # the same array every time

    def reference(t: float) -> NDArray[np.float64]:  # noqa: ARG001
        return pose

    return reference


def square(*, side: float = 0.5, period: float = 32.0) -> Reference:
    """Go around a square by steps: (0, 0), (side, 0), (side, side), (0, side), and so on.

    Parameters
    ----------
    side : float
        [m]
    period : float
        Of the whole square [s]; a quarter of it at each corner, the first quarter at the origin.

    Raises
    ------
    InputError
        Where the period is not positive.
    """
    _check_positive("period", period)
    corners = ((0.0, 0.0), (side, 0.0), (side, side), (0.0, side))

    def reference(t: float) -> NDArray[np.float64]:
        x, y = corners[int((t + _ROUNDING) // (period / 4.0)) % 4]
        return _pose(x, y, 0.0)

    return reference


def change_pose(
    *, x: float = 1.0, y: float = -1.0, psi: float = np.pi, at: float = 3.0, ramp: float = 4.0
) -> Reference:
    """Go from the origin to a pose along a ramp: the thesis's change to [1 -1 pi], spread over time.

    Parameters
    ----------
    x, y, psi : float
        Where to [m, m, rad].
    at : float
        When the change begins [s].
    ramp : float
        How long it takes [s]; zero makes it a step.

    Raises
    ------
    InputError
        Where the ramp is negative.
    """
    if not ramp >= 0.0:
        raise InputError(f"The reference's ramp is {ramp:g} s; it must be zero (a step) or positive.")

    def reference(t: float) -> NDArray[np.float64]:
        share = float(np.clip((t - at) / ramp, 0.0, 1.0)) if ramp else float(t >= at)
        return _pose(share * x, share * y, share * psi)

    return reference


def circle(*, radius: float = 0.5, period: float = 30.0) -> Reference:
    """Go around a circle through the origin, to the left, at constant heading.

    Parameters
    ----------
    radius : float
        [m]; the centre is (0, radius).
    period : float
        Of one turn [s].

    Raises
    ------
    InputError
        Where the period is not positive.
    """
    _check_positive("period", period)

    def reference(t: float) -> NDArray[np.float64]:
        angle = 2.0 * np.pi * t / period
        return _pose(radius * np.sin(angle), radius * (1.0 - np.cos(angle)), 0.0)

    return reference


def figure_eight(*, length: float = 1.0, width: float = 0.5, period: float = 40.0) -> Reference:
    """Go along a lying eight that crosses itself in the origin (Gerono's lemniscate), at constant heading.

    Parameters
    ----------
    length, width : float
        From end to end along x and along y [m].
    period : float
        Of one whole eight [s].

    Raises
    ------
    InputError
        Where the period is not positive.
    """
    _check_positive("period", period)

    def reference(t: float) -> NDArray[np.float64]:
        angle = 2.0 * np.pi * t / period
        return _pose(0.5 * length * np.sin(angle), 0.5 * width * np.sin(2.0 * angle), 0.0)

    return reference


#: the references that the command line knows by name, each with its own defaults
REFERENCES = MappingProxyType(
    {
        "hold": hold,
        "square": square,
        "change_pose": change_pose,
        "circle": circle,
        "figure_eight": figure_eight,
    }
)


def named(name: str) -> Reference:
    """Return the reference of that name with its defaults; dashes count as underscores.

    Raises
    ------
    InputError
        Where there is none; the sentence lists the names.
    """
    try:
        return REFERENCES[name.replace("-", "_")]()
    except KeyError:
        raise InputError(f"There is no reference {name!r}; the names are {', '.join(REFERENCES)}.") from None


def _pose(x: float, y: float, psi: float) -> NDArray[np.float64]:
    pose = np.zeros(10)
    pose[0], pose[1], pose[4] = x, y, psi
    return pose


def _check_positive(what: str, value: float) -> None:
    if not value > 0.0:
        raise InputError(f"The reference's {what} is {value:g}; it must be positive.")
