"""An experiment: parameters, and residuals in blocks, in units of their noise.

A block is an interval of time, such as a window of a log. Its residuals depend on each other, and it may have unknown
states x_w of its own, such as its initial state. The Gauss-Newton equations couple the parameters p with the states of
each block separately,

    [ H_w   B_w^T ] [dp  ]     [ g_w ]        H_w = J_w^T J_w,  B_w = S_w^T J_w,  A_w = S_w^T S_w
    [ B_w   A_w   ] [dx_w] = - [ a_w ]        J_w, S_w: residuals by p and by x_w

and eliminating dx_w = -A_w^-1 (a_w + B_w dp) leaves, for the parameters alone, the sums over blocks of

    H_w - B_w^T A_w^-1 B_w   and   g_w - B_w^T A_w^-1 a_w.

This Schur complement is exact: the step of p is that of all unknowns together, at the cost of the parameters alone (as
in bundle adjustment: B. Triggs et al., Bundle adjustment, a modern synthesis, Vision Algorithms 2000, section 6.1).

`ballbot.fitting.fit` takes any experiment. `Residuals` makes one of a function that gives the errors.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol, TypeVar

import numpy as np

from ballbot.arrays import Floats, Ints
from ballbot.fitting.parameter import FitParameter, ParameterSpace
from ballbot.fitting.uncertainty import WindowEquations


class Iterate(Protocol):
    """A point of a descent, with what its experiment has computed there."""

    @property
    def point(self) -> Floats:
        """The parameters (p,), scaled."""
        ...

    @property
    def cost(self) -> float:
        """The cost: half the mean logarithm of the squared residuals, up to a constant."""
        ...


IterateT = TypeVar("IterateT", bound=Iterate)


@dataclass(frozen=True, kw_only=True, eq=False)
class Linearized:
    """Gauss-Newton equations of w blocks about a point; zero for parameters that are held."""

    H: Floats  #: (w, p, p)
    B: Floats  #: (w, n, p)
    A: Floats  #: (w, n, n)
    g: Floats  #: (w, p)
    a: Floats  #: (w, n)

    @cached_property
    def response(self) -> Floats:
        """Derivatives of the best states by the parameters (w, n, p)."""
        return np.negative(np.linalg.solve(self.A, self.B), dtype=np.float64)

    @cached_property
    def shift(self) -> Floats:
        """Step of the states at constant parameters (w, n)."""
        return np.negative(np.linalg.solve(self.A, self.a[..., None])[..., 0], dtype=np.float64)

    @cached_property
    def equations(self) -> WindowEquations:
        """The equations of the parameters, block by block, with the states eliminated."""
        B = self.B.transpose(0, 2, 1)
        return WindowEquations(self.H + B @ self.response, self.g + (B @ self.shift[..., None])[..., 0])


@dataclass(frozen=True, kw_only=True)
class Dependence:
    """Quantities that act only through another one, and have no effect where it is zero."""

    through: str
    dependent: tuple[str, ...]


class Experiment(Protocol[IterateT]):
    """What `ballbot.fitting.fit` fits. A point (p,) has all parameters, scaled, also those that are held."""

    @property
    def coordinates(self) -> ParameterSpace:
        """Its parameters, with their bounds."""
        ...

    @property
    def block_log(self) -> Ints:
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

    def part(self, blocks: Ints) -> Experiment[IterateT]:
        """Return the experiment of some of the blocks."""
        ...

    def costs(self, points: Floats) -> Floats:
        """Return the costs (sets,) at points (sets, p), blocks' states as measured."""
        ...

    def begin(self, point: Floats, near: IterateT | None = None) -> IterateT:
        """Return the first iterate of a descent, its states settled near the measured ones or those of `near`."""
        ...

    def linearize(self, at: IterateT) -> Linearized:
        """Return the equations about an iterate."""
        ...

    def advance(self, at: IterateT, about: Linearized, step: Floats) -> IterateT:
        """Return the iterate after a step (p,), with the states settled there."""
        ...

    def renew(self, at: IterateT, *, seed: int) -> IterateT:
        """Return the same point with states in better minima where there are any."""
        ...

    def equations(self, at: IterateT) -> WindowEquations:
        """Return each block's equations for standard errors, with the states eliminated."""
        ...


#: half the central difference, as a share of the value, at least of this share of the parameter's range: wide enough to
#: average over single events of sticking
_DIFFERENCE, _OF_RANGE = 5e-4, 1e-3
#: a mean square error below this counts as zero
_NO_ERROR = 1e-60
#: number of steps that settle the states at new parameters; a step that fails is tried again at this share of its
#: length
_SETTLING_STEPS, _SHORTER = 3, 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockErrors:
    """The parameters and states of an iterate, and the errors there."""

    point: Floats  #: (p,), scaled
    states: Floats  #: (w, n), deviations from their expected values, in standard deviations
    errors: Floats  #: (m,)
    squares: Floats  #: (w,), sum of each block, including its states' deviations
    cost: float  #: half the logarithm of the mean square, including the states'


#: from parameters (p,) in SI units, states (w, n) and the numbers of these blocks (w,) to the blocks' rows (m, ...)
RowsOfBlocks = Callable[[Floats, Floats, Ints], Floats]


@dataclass(frozen=True, kw_only=True, eq=False)
class Residuals:
    """An experiment defined by a function that returns its errors, all of the same weight.

    Their noise is their root mean square. Derivatives are finite differences unless they are given. A block may have n
    states, each with an expected value: a deviation by one standard deviation counts as an error of `state_weight`.
    """

    coordinates: ParameterSpace  #: the parameters, with their bounds
    errors_of: RowsOfBlocks  #: errors (m,)
    block: Ints  #: (m,) the block of each error, from 0, rising
    block_log: Ints  #: (w,) the log of each block
    derivatives_of: RowsOfBlocks | None = None  #: of the errors by the parameters (m, p)
    numbers: Ints | None = None  #: (w,) of the blocks in the experiment that this is a part of
    #: of finite differences by a block's states (n,), in their standard deviations
    state_steps: Floats = field(default_factory=lambda: np.zeros(0))
    state_weight: Floats | float = 0.0  #: of each block (w,)
    dependences: tuple[Dependence, ...] = ()  #: which parameters act through others

    @property
    def residual_count(self) -> int:
        """How many errors the cost counts."""
        return len(self.block)

    def part(self, blocks: Ints) -> Residuals:
        """Return the experiment of some of the blocks, rising."""
        kept = np.isin(self.block, blocks)
        return replace(
            self,
            block=np.searchsorted(blocks, self.block[kept]),
            block_log=self.block_log[blocks],
            numbers=self._numbers[blocks],
            state_weight=np.broadcast_to(self.state_weight, len(self.block_log))[blocks],
        )

    def costs(self, points: Floats) -> Floats:
        """Return the costs (sets,) at points (sets, p), with the states at their expected values."""
        return np.array([self._at(point, self._expected).cost for point in points])

    def begin(self, point: Floats, near: BlockErrors | None = None) -> BlockErrors:
        """Return the first iterate of a descent, with the best states."""
        return self._settled(self._at(point, self._expected if near is None else near.states))

    def advance(self, at: BlockErrors, about: Linearized, step: Floats) -> BlockErrors:
        """Return the iterate after a step (p,), with the states settled there."""
        return self._settled(self._at(at.point + step, at.states + about.shift + about.response @ step))

    def renew(self, at: BlockErrors, *, seed: int) -> BlockErrors:  # noqa: ARG002 (states have one minimum)
        """Return the same point."""
        return at

    def linearize(self, at: BlockErrors) -> Linearized:
        """Return the equations about an iterate."""
        values, slopes = self.coordinates.physical(at.point), self.coordinates.slopes(at.point)
        return self._linearized(at, slopes * self._derivatives(values, at.states))

    def equations(self, at: BlockErrors) -> WindowEquations:
        """Return each block's equations, with the states eliminated."""
        return self.linearize(at).equations

    @property
    def _numbers(self) -> Ints:
        return np.arange(len(self.block_log)) if self.numbers is None else self.numbers

    # a simulation that diverges has infinite errors, and the step that led there is rejected
    @np.errstate(over="ignore", invalid="ignore")
    def _errors(self, values: Floats, states: Floats) -> Floats:
        return self.errors_of(values, states, self._numbers)

    def _derivatives(self, values: Floats, states: Floats) -> Floats:
        """Return the derivatives of the errors by the parameters (m, p), zero for those that are held."""
        if self.derivatives_of is not None:
            return self.derivatives_of(values, states, self._numbers)
        space, J = self.coordinates, np.zeros((len(self.block), len(values)))
        halves = _DIFFERENCE * np.maximum(np.abs(values), _OF_RANGE * (space.upper - space.lower))
        for column in np.flatnonzero(space.free).tolist():
            ahead, behind = values.copy(), values.copy()
            ahead[column] = min(values[column] + halves[column], space.upper[column])
            behind[column] = max(values[column] - halves[column], space.lower[column])
            change = self._errors(ahead, states) - self._errors(behind, states)
            J[:, column] = change / (ahead[column] - behind[column])
        return J

    @property
    def _expected(self) -> Floats:
        return np.zeros((len(self.block_log), len(self.state_steps)))

    @property
    def _weight(self) -> Floats:
        """The squared error (w,) that one standard deviation of a state counts as."""
        return np.broadcast_to(np.square(self.state_weight), len(self.block_log))

    def _at(self, point: Floats, states: Floats) -> BlockErrors:
        return self._with(point, states, self._errors(self.coordinates.physical(point), states))

    @np.errstate(over="ignore", invalid="ignore")  # as in `_errors`
    def _with(self, point: Floats, states: Floats, errors: Floats) -> BlockErrors:
        deviations = self._weight * np.sum(states**2, axis=1)
        squares = np.bincount(self.block, errors**2, len(states)) + deviations
        mean = float(squares.sum()) / len(errors)
        cost = 0.5 * np.log(max(mean, _NO_ERROR)) if np.isfinite(mean) else np.inf
        return BlockErrors(point=point, states=states, errors=errors, squares=squares, cost=float(cost))

    def _settled(self, at: BlockErrors) -> BlockErrors:
        """Return the iterate with the best states of each block, by steps that shorten where one fails."""
        share = np.ones((len(at.states), 1))
        for _ in range(_SETTLING_STEPS if at.states.size and np.isfinite(at.cost) else 0):
            shift = self._linearized(at, np.zeros((len(at.errors), 0))).shift
            after = self._at(at.point, at.states + share * shift)
            better = after.squares < at.squares
            states = np.where(better[:, None], after.states, at.states)
            at = self._with(at.point, states, np.where(better[self.block], after.errors, at.errors))
            share = np.where(better[:, None], 1.0, _SHORTER * share)
        return at

    def _linearized(self, at: BlockErrors, J: Floats) -> Linearized:
        """Return the equations with derivatives J (m, p) by the scaled parameters."""
        values, weight = self.coordinates.physical(at.point), np.exp(-2.0 * at.cost)
        S, begins = np.zeros((len(at.errors), 0)), np.flatnonzero(np.diff(self.block, prepend=-1))
        for step in np.diag(self.state_steps):
            change = (self._errors(values, at.states + step) - at.errors) / step.sum()
            S = np.column_stack([S, change])

        def sums(left: Floats, right: Floats) -> Floats:
            return weight * np.add.reduceat(left[:, :, None] * right[:, None, :], begins, axis=0)

        errors, prior = at.errors[:, None], weight * self._weight[:, None]
        return Linearized(
            H=sums(J, J),
            B=sums(S, J),
            A=sums(S, S) + prior[..., None] * np.eye(S.shape[1]),
            g=sums(J, errors)[..., 0],
            a=sums(S, errors)[..., 0] + prior * at.states,
        )


def residuals_without_states(
    residuals_of: Callable[[Floats], Floats],
    *,
    parameters: Sequence[FitParameter],
    block: Ints,
    block_log: Ints | None = None,
    derivatives_of: Callable[[Floats], Floats] | None = None,
    dependences: tuple[Dependence, ...] = (),
) -> Residuals:
    """Return the plain least-squares experiment of a function from parameters (p,), SI units, to m residuals.

    The residuals may have any shape; `block` (m,) is in the order of `numpy.ravel`. All blocks belong to one log unless
    `block_log` (w,) is given, and derivatives (m, p) are finite differences unless `derivatives_of` is given.
    """

    def of_blocks(function: Callable[[Floats], Floats]) -> RowsOfBlocks:
        return lambda values, _, blocks: function(values)[np.isin(block, blocks)]

    return Residuals(
        coordinates=ParameterSpace(parameters=tuple(parameters)),
        errors_of=of_blocks(lambda values: residuals_of(values).ravel()),
        derivatives_of=derivatives_of and of_blocks(derivatives_of),
        block=block,
        block_log=np.zeros(int(block[-1]) + 1, dtype=np.int64) if block_log is None else block_log,
        dependences=dependences,
    )
