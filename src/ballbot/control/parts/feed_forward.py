"""Feed-forward: the lean and the torques that a shaped motion needs, from the exact model.

Linearised about upright and without friction, with p = (x, y), l = (theta, phi, psi) and torques u,

    p'' = A_p l + B_p u        l'' = A_l l + B_l u

the point s = p + C l with B_p + C B_l = 0 feels no torque: s'' = (A_p + C A_l) l = G (theta, phi). (It is a flat
output: all else follows from it and its derivatives.) A motion s(t) of it therefore asks for

    (theta, phi) = G^-1 s''       p = s - C (theta, phi)       u = B^+ (r' - A r)

with B^+ the inverse of least norm. Where the robot rests, p = s. Quantities are those of the heading frame; that a
robot which moves and turns at once needs a little more is left to the feedback, and so is a body's small coupling
of yaw with lean.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import real_array
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.model import Model
from ballbot.robot import Friction, Robot

#: largest torque on the flat output, relative to that on the place, that counts as none
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class FeedForward:
    """What a motion of the flat output asks for, linear in its derivatives, heading frame.

    Raises
    ------
    InputError
        If an array has another shape or a value that is not finite.
    """

    lean: NDArray[np.float64]  #: G^-1 (2, 2): theta, phi for s'' [rad s^2/m]
    offset: NDArray[np.float64]  #: C G^-1 (2, 2): how far s is ahead of the place, for s'' [s^2]
    by_second: NDArray[np.float64]  #: (n, 2) torque for s'' [N m s^2/m]
    by_fourth: NDArray[np.float64]  #: (n, 2) torque for s'''' [N m s^4/m]
    by_turning: NDArray[np.float64]  #: (n,) torque for psi'' [N m s^2/rad]

    def __post_init__(self) -> None:
        n = np.size(self.by_turning)
        shapes = {
            "lean": (2, 2),
            "offset": (2, 2),
            "by_second": (n, 2),
            "by_fourth": (n, 2),
            "by_turning": (n,),
        }
        for name, shape in shapes.items():
            checked = real_array(getattr(self, name), shape, f"{name} of a feed-forward")
            object.__setattr__(self, name, checked)

    @staticmethod
    def of(robot: Robot) -> FeedForward:
        """Return what the robot's exact model without friction asks for.

        Raises
        ------
        InputError
            Where the robot has no flat output, because its wheels do not reach all three axes.
        """
        linear = Model(robot.replace(friction=Friction.none(robot.wheel_count))).linearize()
        A, B = np.asarray(linear.A), np.asarray(linear.B)
        C = -B[5:7] @ np.linalg.pinv(B[7:])
        if np.abs(B[5:7] + C @ B[7:]).max() > _ROUNDING * np.abs(B[5:7]).max():
            raise InputError(
                f"The robot {robot.name!r} cannot have feed-forward: its wheels cannot turn it in every "
                "direction."
            )
        G = (A[5:7] + C @ A[7:])[:, 2:4]
        lean = np.asarray(np.linalg.inv(G), dtype=np.float64)
        offset = C[:, :2] @ lean
        motions = np.zeros((3, 10, 2)), np.zeros((3, 10, 2))  # r and r' for s'', s'''' and psi''
        (r_2, r_4, _), (d_2, d_4, d_psi) = motions
        r_2[:2], r_2[2:4] = -offset, lean
        d_2[5:7] = np.eye(2)
        d_4[5:7], d_4[7:9] = -offset, lean
        d_psi[9, 0] = 1.0
        back = np.linalg.pinv(B)
        return FeedForward(
            lean=lean,
            offset=offset,
            by_second=back @ (d_2 - A @ r_2),
            by_fourth=back @ (d_4 - A @ r_4),
            by_turning=(back @ d_psi)[:, 0],
        )


class Flat(NamedTuple):
    """What the wheels share of a feed-forward, in compiled code."""

    lean: tuple[float, float, float, float]
    offset: tuple[float, float, float, float]


#: numbers that `pack_feed_forward` returns for all wheels together, and for each
FLAT_SIZE, FLAT_PER_WHEEL = 8, 5


def pack_feed_forward(
    feed_forward: FeedForward | None, wheel_count: int
) -> tuple[list[float], NDArray[np.float64]]:
    """Return what the wheels share (8,) and the torques (n, 5) for s'', s'''' and psi''; zero where there is none."""
    if feed_forward is None:
        return [0.0] * FLAT_SIZE, np.zeros((wheel_count, FLAT_PER_WHEEL))
    shared = [*feed_forward.lean.ravel().tolist(), *feed_forward.offset.ravel().tolist()]
    return shared, np.column_stack([feed_forward.by_second, feed_forward.by_fourth, feed_forward.by_turning])


@inlined
def load_flat(row, place):
    """Return the `Flat` at that place of a row."""
    return Flat(
        (row[place], row[place + 1], row[place + 2], row[place + 3]),
        (row[place + 4], row[place + 5], row[place + 6], row[place + 7]),
    )


@inlined
def times(M, v):
    """Return a 2 x 2 matrix, its rows one after the other, times a vector."""
    return M[0] * v[0] + M[1] * v[1], M[2] * v[0] + M[3] * v[1]


@inlined
def motion_torque(row, place, second, fourth, turning):
    """Return a wheel's feed-forward torque for s'', s'''' (heading frame) and psi'', its numbers at that place."""
    return (
        row[place] * second[0]
        + row[place + 1] * second[1]
        + row[place + 2] * fourth[0]
        + row[place + 3] * fourth[1]
        + row[place + 4] * turning
    )
