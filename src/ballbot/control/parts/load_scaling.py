"""Load scaling: dry friction is compensated as far as the load on each wheel makes it.

Where a share k of a driveline's dry friction follows the force N_i between wheel and ball, c and s of wheel i are

    (1 - k + k N_i/N_0i) (c, s)        sum_i N_i n_i = m_r R^T (s'' + g e_z) + sum_i (v_i/r_w) t_i

with N_0i the load upright at rest, s'' the acceleration asked for, and v_i the last torque without what friction takes.
Three wheels' loads follow from this; of four the one of least squares (see `ballbot.simulation.model_plant`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbot.control.parts.past import EFFECTIVE, past
from ballbot.control.parts.torque_balance import MAX_WHEELS
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.vector import dot, rotate_back
from ballbot.mechanics.geometry import contact_directions, rolling_directions

if TYPE_CHECKING:
    from ballbot.control.controller import Controller

#: the largest N_i/N_0i that is believed
HIGHEST_LOAD = 3.0


@dataclass(frozen=True, kw_only=True)
class LoadScaling:
    """How much of the dry friction follows the load.

    Raises
    ------
    InputError
        Where the share is not from 0 to 1.
    """

    share: float  #: k

    def __post_init__(self) -> None:
        if not (math.isfinite(self.share) and 0.0 <= self.share <= 1.0):
            raise InputError(f"share of the load scaling is {self.share:g}; it must be from 0 to 1.")


#: numbers that `pack_load` returns for all wheels together, and for each
LOAD_SIZE, LOAD_PER_WHEEL = 2, 3 + MAX_WHEELS


def pack_load(controller: Controller) -> tuple[list[float], NDArray[np.float64]]:
    """Return share and gravity, and each wheel's load over N_0i by a unit of acceleration and of torque (n, 7)."""
    robot, scaling = controller.robot, controller.parts.load_scaling
    own = np.zeros((robot.wheel_count, LOAD_PER_WHEEL))
    if scaling is None:
        return [0.0] * LOAD_SIZE, own
    pressing = np.linalg.pinv(contact_directions(robot.wheels).T)
    upright = pressing @ np.array([0.0, 0.0, robot.body.mass * robot.gravity])
    own[:, :3] = robot.body.mass * pressing
    own[:, 3 : 3 + robot.wheel_count] = pressing @ rolling_directions(robot.wheels).T / robot.wheels.radius
    return [scaling.share, robot.gravity], own / upright[:, None]


@inlined
def specific_force(row, place, a, wanted):
    """Return s'' + g e_z in the body frame (3,) [m/s^2]."""
    return rotate_back(a.R, (wanted[0].second, wanted[1].second, row[place + 1]))


@inlined
def dry_share(row, place, own, memory, first, force, n):
    """Return by what a wheel's c and s are multiplied; its numbers are at `own`, the past at `first`."""
    load = dot((row[own], row[own + 1], row[own + 2]), force)
    for j in range(n):
        load += row[own + 3 + j] * memory[past(first, 0, EFFECTIVE, j)]
    return 1.0 + row[place] * (max(0.0, min(HIGHEST_LOAD, load)) - 1.0)
