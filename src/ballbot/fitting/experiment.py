"""An experiment: parameters, and residuals in blocks that depend on each other, in units of their noise.

A block is a stretch of time, as a window of a log. It may have unknown states x_w of its own, such as where it begins.
Gauss-Newton's equations couple the parameters p with these only block by block,

    [ H_w   B_w^T ] [dp  ]     [ g_w ]        H_w = J_w^T J_w,  B_w = S_w^T J_w,  A_w = S_w^T S_w
    [ B_w   A_w   ] [dx_w] = - [ a_w ]        J_w, S_w: residuals by p and by x_w

and eliminating dx_w = -A_w^-1 (a_w + B_w dp) leaves, for the parameters alone, the sums over blocks of

    H_w - B_w^T A_w^-1 B_w   and   g_w - B_w^T A_w^-1 a_w.

`ballbot.fitting.fit` takes any experiment; `ballbot.identification.balancing` is one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.parameter import ParameterSpace
from ballbot.fitting.uncertainty import WindowEquations


class Iterate(Protocol):
    """A point of a descent, and what its experiment knows there."""

    @property
    def point(self) -> NDArray[np.float64]:
        """The parameters (p,), scaled."""
        ...

    @property
    def cost(self) -> float:
        """The cost there: half the mean logarithm of the squared residuals, up to a constant."""
        ...


At = TypeVar("At", bound=Iterate)


@dataclass(frozen=True, kw_only=True, eq=False)
class Linearized:
    """Equations of w blocks about a point, zero for parameters that are held, and how the best states follow."""

    H: NDArray[np.float64]  #: (w, p, p)
    B: NDArray[np.float64]  #: (w, n, p)
    A: NDArray[np.float64]  #: (w, n, n)
    g: NDArray[np.float64]  #: (w, p)
    a: NDArray[np.float64]  #: (w, n)

    @cached_property
    def response(self) -> NDArray[np.float64]:
        """How the best states follow the parameters (w, n, p), d x_w / d p."""
        return np.negative(np.linalg.solve(self.A, self.B), dtype=np.float64)

    @cached_property
    def shift(self) -> NDArray[np.float64]:
        """How states move where the parameters stay (w, n), dx_w."""
        return np.negative(np.linalg.solve(self.A, self.a[..., None])[..., 0], dtype=np.float64)

    @cached_property
    def equations(self) -> WindowEquations:
        """The parameters' equations of each block, its states eliminated."""
        B = self.B.transpose(0, 2, 1)
        return WindowEquations(
            matrices=self.H + B @ self.response, scores=self.g + (B @ self.shift[..., None])[..., 0]
        )


@dataclass(frozen=True, kw_only=True)
class Dependence:
    """Quantities that act through another's numbers only, and have no effect where these are zero."""

    through: str
    dependent: tuple[str, ...]


class Experiment(Protocol[At]):
    """What `ballbot.fitting.fit` fits. Points (p,) hold every parameter, held ones too, scaled."""

    @property
    def coordinates(self) -> ParameterSpace:
        """Its parameters, with their bounds."""
        ...

    @property
    def block_log(self) -> NDArray[np.int64]:
        """Which log each block is of (w,)."""
        ...

    @property
    def residual_count(self) -> int:
        """How many residuals the cost counts."""
        ...

    @property
    def dependences(self) -> Sequence[Dependence]:
        """Which parameters act through others."""
        ...

    def part(self, blocks: NDArray[np.int64]) -> Experiment[At]:
        """Return the experiment of some of the blocks."""
        ...

    def costs(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the costs (sets,) at points (sets, p), blocks' states as measured."""
        ...

    def begin(self, point: NDArray[np.float64], near: At | None = None) -> At:
        """Return where a descent begins: a point, and the best states near the measured ones or those of `near`."""
        ...

    def linearize(self, at: At) -> Linearized:
        """Return the equations about an iterate."""
        ...

    def advance(self, at: At, about: Linearized, step: NDArray[np.float64]) -> At:
        """Return the iterate a step (p,) on, its states settled anew."""
        ...

    def renew(self, at: At, *, seed: int) -> At:
        """Return the same point with states that may lie in better minima; `at` itself if there are no states."""
        ...

    def equations(self, at: At) -> WindowEquations:
        """Return each block's equations by differences as wide as standard errors need, states eliminated."""
        ...
