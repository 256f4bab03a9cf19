"""The linear-quadratic regulator, continuous and sampled.

State x (m,) and input u (n,) with x_dot = A x + B u; the gain of u = -K x that minimises

    continuous   integral of  x' Q x + u' R u                                             (5.1), (5.2)
    sampled      sum over samples of the same, with A and B held over each sample:
                 x[k+1] = F x[k] + G u[k],  [F G; 0 I] = exp([A B; 0 0] T)

The sampled sum takes Q and R as they are. (The other convention, which integrates the continuous cost over
each sample, gives gains that differ from these in the fourth digit for our robots at 5 ms.)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm, solve_continuous_are, solve_discrete_are

from ballbot.arrays import instead_of_sample_time, positive_number, real_array
from ballbot.errors import InputError
from ballbot.log.columns import STATE_NAMES, torque_names
from ballbot.mechanics.model import Model, ModelLike, as_model
from ballbot.robot import Friction, Robot
from ballbot.summary import Summarized, Summary, pole_words

#: negative eigenvalues of a weight down to this fraction of the largest count as rounding
_ROUNDING = 1e-12
#: ratio of the smallest singular value of [A - s I, B] to the largest above which the pole s is controllable
_REACHED = 1e-9
#: largest growth g of an error in one sample, by the fastest unstable pole, for which a sampled loop can have a margin:
#: the sensitivity's peak is at least g, and the gain of least torque tolerates factors from g/(g + 1) to g/(g - 1)
_LARGEST_GROWTH = 10.0


@runtime_checkable
class StateSpace(Protocol):
    """Anything with A (m, m) and B (m, n): `LinearModel`, python-control's StateSpace."""

    @property
    def A(self) -> NDArray[np.float64]: ...

    @property
    def B(self) -> NDArray[np.float64]: ...


@runtime_checkable
class Linearizable(Protocol):
    """Anything that gives such matrices: `ballbot.Model`."""

    def linearize(self) -> StateSpace: ...


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LqrDesign(Summarized):
    """An optimal gain, with the closed loop's poles and its cost."""

    gain: NDArray[np.float64]  #: K (n, m) of u = -K x
    #: (m,) of the closed loop [rad/s], the slowest first; sampled ones as log(z)/T
    poles: NDArray[np.complex128]
    cost: NDArray[np.float64]  #: P (m, m): x' P x is the cost to go from x
    sample_time: float | None  #: [s]; None for a continuous gain
    #: K_I (n, 3) for the integrals of x, y and psi, if there is integral action
    integral_gain: NDArray[np.float64] | None = None

    def summary(self) -> Summary:
        """Return the gain of each state and of the integrals, and the closed loop's poles."""
        names = ("integral of x", "integral of y", "integral of psi")
        integral = () if self.integral_gain is None else matrix_rows(self.integral_gain.T, names)
        return Summary(
            title=f"LQR gain, {sampling_words(self.sample_time)}",
            rows=(*gain_rows(self.gain), *integral, ("poles", f"{pole_words(self.poles)} rad/s")),
        )


def sampling_words(sample_time: float | None) -> str:
    """Return how a gain acts: "sampled every 0.005 s", or "continuous" without a sample time."""
    return "continuous" if sample_time is None else f"sampled every {sample_time:.4g} s"


def gain_rows(gain: NDArray[np.float64]) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Return a row for each state with its gain for every input; a robot's states are named as in a log."""
    inputs, count = torque_names(len(gain)), gain.shape[1]
    states = (
        STATE_NAMES if count == len(STATE_NAMES) else tuple(f"x{number}" for number in range(1, count + 1))
    )
    return (("gain", inputs), *matrix_rows(gain.T, states))


def matrix_rows(matrix: NDArray[np.float64], names: Sequence[str]) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Return a named row of cells for each row of a matrix, four decimals each."""
    # adding zero turns -0.0 into 0.0
    cells = [tuple(f"{value:.4f}" for value in row) for row in np.round(matrix, 4) + 0.0]
    return tuple(zip((f"  {name}" for name in names), cells, strict=True))


def lqr(
    model: Linearizable | StateSpace | ModelLike,
    Q: ArrayLike,
    R: ArrayLike,
    sample_time: float | None = None,
) -> LqrDesign:
    """Return the gain that minimises the quadratic cost (thesis 5.1).

    Parameters
    ----------
    model : Model, robot, preset, robot file or state space
        A model or a robot is linearised about upright at psi = 0, with its states in the usual order.
    Q : array_like (m,) or (m, m)
        Weight of the states, or its diagonal; positive semidefinite.
    R : float or array_like (n,) or (n, n)
        Weight of the inputs, its diagonal, or one number for every input; positive definite.
    sample_time : float, optional
        Time over which each input is held [s]; without it the control is continuous.

    Returns
    -------
    LqrDesign

    Raises
    ------
    InputError
        If a weight is not symmetric, not definite or of a wrong shape, an unstable pole is not controllable, no gain is
        both stabilising and optimal because a marginally stable state has no weight, or the sample time is so long that
        no loop has a stability margin.

    Examples
    --------
    >>> design = lqr("alten", [20, 20, 500, 500, 5, 30, 30, 20, 20, 2], 30.0, sample_time=0.005)
    >>> design.gain.shape
    (3, 10)
    >>> bool(design.poles.real.max() < 0.0)
    True
    """
    if isinstance(model, np.ndarray | Sequence) and not isinstance(model, str):
        raise InputError(
            "The first argument of lqr is a matrix; it must be a model, a robot or a state space: "
            "lqr(StateSpace(A, B), Q, R), where python-control has lqr(A, B, Q, R)."
        )
    if isinstance(model, StateSpace):
        space = model
    else:
        space = (model if isinstance(model, Linearizable) else as_model(model)).linearize()
    A, B = np.asarray(space.A, float), np.asarray(space.B, float)
    m, n = B.shape
    Q, R = _weight("Q", Q, m), _weight("R", R, n)
    _check_definite(Q, R)
    _check_stabilisable(A, B)
    if sample_time is None:
        P = _riccati(lambda: solve_continuous_are(A, B, Q, R))
        K = np.linalg.solve(R, B.T @ P)
        poles = np.linalg.eigvals(A - B @ K)
    else:
        F, G = held(A, B, sample_time)
        _check_growth(A, sample_time)
        P = _riccati(lambda: solve_discrete_are(F, G, Q, R))
        K = np.linalg.solve(R + G.T @ P @ G, G.T @ P @ F)
        poles = np.log(np.linalg.eigvals(F - G @ K).astype(complex)) / sample_time
    if not poles.real.max() < 0.0:
        raise InputError(_NO_SOLUTION)
    poles = poles.astype(complex)[np.argsort(-poles.real, kind="stable")]
    return LqrDesign(gain=np.asarray(K, dtype=np.float64), poles=poles, cost=P, sample_time=sample_time)


def held(
    A: NDArray[np.float64], B: NDArray[np.float64], sample_time: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return F (m, m) and G (m, n) of x[k+1] = F x[k] + G u[k], u held over each sample [s]; exact.

    InputError if the sample time is not positive, or so long that the result overflows.
    """
    positive_number(sample_time, "The sample time")
    m, n = B.shape
    with np.errstate(over="ignore", invalid="ignore"):
        both = np.asarray(expm(np.block([[A, B], [np.zeros((n, m + n))]]) * sample_time), dtype=np.float64)
    if not np.isfinite(both).all():
        raise InputError(
            f"The sample time is {sample_time:g} s; it is so long that the state overflows within one sample."
        )
    return both[:m, :m], both[:m, m:]


def frictionless_model(robot: Robot) -> Model:
    """Return the robot's exact model without friction, on which gains are designed."""
    return Model(robot.replace(friction=Friction.none(robot.wheel_count)))


def _check_growth(A: NDArray[np.float64], sample_time: float) -> None:
    fastest = float(np.linalg.eigvals(A).real.max()) * sample_time
    if fastest > math.log(_LARGEST_GROWTH):
        raise InputError(
            f"The sample time is {sample_time:g} s, in which an error grows by a factor of {math.exp(fastest):.2g}: no "
            f"loop sampled so rarely has a stability margin; {instead_of_sample_time(sample_time)}"
        )


_NO_SOLUTION = (
    "No gain is both optimal and stabilising for these weights, because a state that does not "
    "settle by itself has no weight. Give x, y and psi positive weights in Q."
)


def _riccati(solve: Callable[[], NDArray[np.float64]]) -> NDArray[np.float64]:
    try:
        P = solve()
    except ValueError:  # LinAlgError, or a reordering that is too ill-conditioned
        raise InputError(_NO_SOLUTION) from None
    return 0.5 * (P + P.T)


def _weight(name: str, value: ArrayLike, size: int) -> NDArray[np.float64]:
    """Return a weight as a symmetric matrix."""
    matrix = real_array(value, ("...",), name)
    if name == "R" and matrix.shape == ():  # all motors have one unit, the states do not
        matrix = np.full(size, float(matrix))
    if matrix.shape == (size,):
        matrix = np.diag(matrix)
    if matrix.shape != (size, size):
        given = f"has the shape {matrix.shape}" if matrix.shape else f"is one number, {float(matrix):g}"
        raise InputError(
            f"{name} {given}; it must be {size} numbers (its diagonal) or a {size} x {size} matrix."
        )
    if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0):
        raise InputError(f"{name} is not symmetric; a weight matrix must be symmetric.")
    return 0.5 * (matrix + matrix.T)


def _check_definite(Q: NDArray[np.float64], R: NDArray[np.float64]) -> None:
    lowest_R, highest_R = np.linalg.eigvalsh(R)[[0, -1]]
    if not lowest_R > _ROUNDING * highest_R:
        raise InputError(
            f"R is not positive definite (an eigenvalue is {lowest_R:.3g}); every input needs a positive weight."
        )
    lowest, highest = np.linalg.eigvalsh(Q)[[0, -1]]
    if lowest < -_ROUNDING * abs(highest):
        raise InputError(
            f"Q is not positive semidefinite (an eigenvalue is {lowest:.3g}); no eigenvalue may be negative."
        )


def _check_stabilisable(A: NDArray[np.float64], B: NDArray[np.float64]) -> None:
    """Raise InputError if an unstable pole s is not controllable: [A - s I, B] loses rank (Hautus)."""
    for pole in np.linalg.eigvals(A):
        if pole.real < -_REACHED * np.abs(A).max():
            continue
        singular = np.linalg.svd(np.hstack([A - pole * np.eye(len(A)), B]), compute_uv=False)
        if singular[-1] < _REACHED * singular[0]:
            raise InputError(
                f"The robot cannot be stabilised: the wheels cannot influence its pole at {pole.real:.3g} rad/s."
            )
