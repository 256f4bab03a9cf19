"""The torque that is lost on the way: what the motors gave, less what the robot's motion shows.

By the linearised exact model without friction, x' = A x + B u in the heading frame, the rates' change over a sample
needed the torques B^+ (x' - A x), B^+ the inverse of least norm. What the motors gave beyond them went into
friction, a slope, a push. `ballbot.control.parts.disturbance_observer` gives it back as it is;
`ballbot.control.parts.driveline_adaptation` asks how much of it is the friction that is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import real_array
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.model import Model
from ballbot.robot import Friction, Robot


@dataclass(frozen=True, kw_only=True, eq=False)
class TorqueBalance:
    """The torques that a motion needs, heading frame.

    Raises
    ------
    InputError
        If an array has another shape or a value that is not finite.
    """

    by_acceleration: NDArray[np.float64]  #: (n, 5) for the rates' change [N m per m/s^2, per rad/s^2]
    by_lean: NDArray[np.float64]  #: (n, 2) for theta, phi [N m/rad]
    by_force: NDArray[
        np.float64
    ]  #: (n, 2) lost to a force on the ball against x, y, such as rolling friction [m]

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(np.asarray(self.by_lean, dtype=object)))
        for name, shape in {"by_acceleration": (n, 5), "by_lean": (n, 2), "by_force": (n, 2)}.items():
            checked = real_array(getattr(self, name), shape, f"{name} of a torque balance")
            object.__setattr__(self, name, checked)

    @staticmethod
    def of(robot: Robot) -> TorqueBalance:
        """Return that of a robot's exact model without friction, linearised about upright."""
        model = Model(robot.replace(friction=Friction.none(robot.wheel_count)))
        linear = model.linearize()
        back = np.asarray(np.linalg.pinv(np.asarray(linear.B)), dtype=np.float64)
        mobility = np.linalg.inv(np.asarray(model.mass_matrix(np.zeros(5))))
        return TorqueBalance(
            by_acceleration=back[:, 5:],
            by_lean=-(back @ np.asarray(linear.A))[:, 2:4],
            by_force=back[:, 5:] @ mobility[:, :2],
        )


#: numbers for each wheel
BALANCE_PER_WHEEL = 9
#: wheels that a memory has room for
MAX_WHEELS = 4
#: numbers remembered: the rates (5) and whether there are any
BALANCE_MEMORY = 6


def pack_balance(balance: TorqueBalance | None, wheel_count: int) -> NDArray[np.float64]:
    """Return each wheel's numbers (n, 9); zero where there is none."""
    if balance is None:
        return np.zeros((wheel_count, BALANCE_PER_WHEEL))
    return np.column_stack([balance.by_acceleration, balance.by_lean, balance.by_force])


@inlined
def accelerations(a, memory, first, state, rate):
    """Return the rates' change since the last sample (5,), heading frame; `rate` is samples a second."""
    c, s = a.cos_psi, a.sin_psi
    x, y = rate * (state[5] - memory[first]), rate * (state[6] - memory[first + 1])
    t, p = rate * (state[7] - memory[first + 2]), rate * (state[8] - memory[first + 3])
    return c * x + s * y, c * y - s * x, c * t + s * p, c * p - s * t, rate * (state[9] - memory[first + 4])


@inlined
def torque_needed(row, place, changes, lean):
    """Return a wheel's torque for those accelerations (5,) at that lean (2,), its numbers at that place."""
    return (
        row[place] * changes[0]
        + row[place + 1] * changes[1]
        + row[place + 2] * changes[2]
        + row[place + 3] * changes[3]
        + row[place + 4] * changes[4]
        + row[place + 5] * lean[0]
        + row[place + 6] * lean[1]
    )


@inlined
def lost_to_force(row, place, force):
    """Return a wheel's torque that a force on the ball (2,) takes, heading frame, its numbers at that place."""
    return row[place + 7] * force[0] + row[place + 8] * force[1]


@inlined
def remember_rates(memory, first, state):
    """Keep the rates for the next sample."""
    for i in range(5):
        memory[first + i] = state[5 + i]
    memory[first + 5] = 1.0
