"""A registered friction law as a table over the speed, which the compensation reads on the computer and on the robot.

The table has the friction of each wheel at `SPEEDS` speeds. Between them it is linear, beyond the last it is constant.
It reaches 1.5 times the speed that the supply allows. The speeds are dense where the law is curved. Friction in
proportion to the load is a coefficient beside the table. A law is refused if the table's error exceeds 2 % at any speed
and load.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.robot import Friction, Robot

#: speeds of a table; a power of two, for the binary search in compiled code
SPEEDS = 32
#: largest accepted error of a table, relative to the friction at that speed
LARGEST_ERROR = 0.02
#: relative to the robot's top speed: the smallest speed above zero of the grid, and the end of the table
_FIRST, _LAST = 1e-4, 1.5
_LOADS = np.linspace(0.0, 1.0, 5)  # of the torque limit


@dataclass(frozen=True, kw_only=True, eq=False)
class FrictionTable:
    """The dry friction of a robot's wheels under a registered law."""

    speeds: NDArray[np.float64]  #: (SPEEDS,) [rad/s], rising from zero
    sizes: NDArray[np.float64]  #: (n, SPEEDS) [N m] without load
    load: NDArray[np.float64]  #: (n,) what each N m of the motor's torque adds
    error: float  #: largest relative error, at speeds and loads between those of the table


def friction_table(robot: Robot) -> FrictionTable:
    """Return the table of a robot's registered friction law. InputError if the table's error is too large."""
    friction, drive = robot.friction, robot.drive
    top = drive.top_speed
    grid = np.concatenate([[0.0], np.geomspace(_FIRST * top, _LAST * top, 600)])
    exact = _sizes(friction, grid, 0.0)
    knots = _knots(grid, exact)
    heaviest = _LOADS[-1] * drive.torque_limit
    added = (_sizes(friction, grid, heaviest) - exact) / heaviest
    load = 0.5 * (added.min(axis=1) + added.max(axis=1))
    between = np.sort(np.concatenate([grid, 0.5 * (grid[1:] + grid[:-1])]))
    error = 0.0
    for torque in _LOADS * drive.torque_limit:
        wanted = _sizes(friction, between, torque)
        tabulated = (
            np.array([np.interp(between, grid[knots], row) for row in exact[:, knots]])
            + load[:, None] * torque
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            errors = np.abs(tabulated - wanted) / wanted
        error = max(error, float(np.nan_to_num(errors, posinf=np.inf).max()))
    if not error <= LARGEST_ERROR:
        raise InputError(
            f"The friction law {friction.law} cannot be compensated: a table of {SPEEDS} speeds from 0 to "
            f"{grid[-1]:.3g} rad/s, with friction in proportion to the load, has an error of {100.0 * error:.3g} % "
            f"of the friction; at most {100.0 * LARGEST_ERROR:g} %. Use a law without steps, or no compensation."
        )
    return FrictionTable(speeds=grid[knots], sizes=exact[:, knots], load=load, error=error)


def _sizes(friction: Friction, speeds: NDArray[np.float64], load: float) -> NDArray[np.float64]:
    """Return g (n, k) at speeds (k,)."""
    at = np.repeat(speeds[:, None], len(friction.coulomb), axis=1)
    return friction.dry_size(at, np.full(at.shape, load)).T


def _knots(grid: NDArray[np.float64], exact: NDArray[np.float64]) -> list[int]:
    """Return the indices in a grid of a table's speeds: each next speed is added where the error is largest."""
    knots = [0, len(grid) - 1]
    scale = np.maximum(exact, 1e-12 * max(exact.max(), 1e-300))
    while len(knots) < SPEEDS:
        tabulated = np.array([np.interp(grid, grid[knots], row) for row in exact[:, knots]])
        errors = (np.abs(tabulated - exact) / scale).max(axis=0)
        errors[knots] = -1.0
        knots = sorted([*knots, int(errors.argmax())])
    return knots
