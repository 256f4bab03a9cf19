"""What the sources have in common: printed numbers beside ours, and linear models.

A linear model about upright is of any mixture of the thesis's approximations, or in a source's own state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.model import LinearModel
from ballbot.robot import Robot
from campaigns.reproduce import markdown_table
from tests.support.lagrangian import Corrections


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A number that a source prints, with what our equations give for it."""

    name: str
    printed: str  #: digit by digit as in the source, so that its precision is known
    reproduced: float  #: with the source's own convention or mistake
    right: float  #: by the exact equations

    @property
    def rounding(self) -> float:
        """Half a unit of the last printed digit."""
        return 0.5 * 10.0 ** -len(self.printed.partition(".")[2])

    @property
    def difference(self) -> float:
        """What is reproduced less what is printed, relative to the latter."""
        return self.reproduced / float(self.printed) - 1.0

    @property
    def comes_out(self) -> bool:
        """Whether the reproduced number rounds to the printed one."""
        return abs(self.reproduced - float(self.printed)) <= self.rounding * (1.0 + 1e-9)


def entry_table(entries: Sequence[Entry]) -> str:
    """Return a Markdown table of printed, reproduced and right numbers."""
    rows = [
        [
            entry.name,
            entry.printed,
            f"{entry.reproduced:.5g}",
            "to its last digit" if entry.comes_out else f"off by {100.0 * entry.difference:+.2f} %",
            f"{entry.right:.5g}",
        ]
        for entry in entries
    ]
    return markdown_table(["", "printed", "reproduced", "comes out", "right"], rows)


@dataclass(frozen=True, kw_only=True, eq=False)
class SourceModel:
    """x_dot = A x + B u in the state and order that a source has; such as `ballbot.lqr` takes."""

    A: NDArray[np.float64]  #: (m, m)
    B: NDArray[np.float64]  #: (m, n)


def mixture_model(robot: Robot, corrections: Corrections) -> LinearModel:
    """Return the linear model about upright of the equations with these corrections, without friction.

    As `Model.linearize`, which has the two named formulations; M and the torques' generalised force at rest come
    from the symbolic Lagrangian, and gravity tips with m_r g l whatever is corrected.
    """
    from tests.support.lagrangian import equations  # SymPy is an extra; the tables do not need it

    derived, upright = equations(robot, corrections), np.zeros(5)
    M = derived.dynamics(upright, upright, np.zeros(robot.wheel_count))[0]
    Q = np.stack([derived.dynamics(upright, upright, u)[2] for u in np.eye(robot.wheel_count)], axis=1)
    tipping = robot.body.mass * robot.gravity * robot.body.center_of_mass
    A, B = np.zeros((10, 10)), np.zeros((10, robot.wheel_count))
    A[:5, 5:] = np.eye(5)
    A[5:, :5] = np.linalg.solve(M, np.diag([0.0, 0.0, tipping, tipping, 0.0]))
    B[5:] = np.linalg.solve(M, Q)
    return LinearModel(A=A, B=B)


def in_state(model: LinearModel, T: NDArray[np.float64]) -> SourceModel:
    """Return the model in the state z = T x, T (m, 10).

    If z has fewer states than x they must be ones that the others do not act on.
    """
    back = np.linalg.pinv(T)
    return SourceModel(A=T @ model.A @ back, B=T @ model.B)


def unstable_poles(model: LinearModel) -> tuple[float, float]:
    """Return the poles [rad/s] with which the robot falls about its two horizontal axes, the faster first."""
    first, second = np.real(model.poles())[:2]
    return float(first), float(second)
