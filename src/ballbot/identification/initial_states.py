"""The fit: parameters and each window's start state are estimated together, by Gauss-Newton.

A window predicted from a measured start carries that one sample's noise, grown by an unstable plant, through all its
residuals: on simulated logs with the noise of good sensors, standard errors were four times too large for what a log
holds, a quarter too small for what the estimates did, and the estimates were biased, as with errors in any regressor.
Here the start x_w of each window w is one more unknown, tied to the measured start by a residual that weighs as those
of the other samples do. Gauss-Newton's equations then couple the parameters p with the starts only window by window,

    [ H_w   B_w^T ] [dp  ]     [ g_w ]        H_w = J_w^T J_w,  B_w = S_w^T J_w,  A_w = S_w^T S_w
    [ B_w   A_w   ] [dx_w] = - [ a_w ]        J_w, S_w: residuals by p and by x_w

and eliminating dx_w = -A_w^-1 (a_w + B_w dp) leaves, for the parameters alone, the sums over windows of

    H_w - B_w^T A_w^-1 B_w   and   g_w - B_w^T A_w^-1 a_w.

A step is damped as Levenberg and Marquardt do, and tried once; more only if it does not lower the cost. Derivatives are
differences to one side and then to the other, with a long inner step: they only show the way. The cost itself and the
equations of the result are exact.
A start that has settled on one side of a wheel's sticking does not find the other: a few such windows were what kept
descents from one optimum (1 to 4 of 256, which cost up to 3e-4 of 2.2 and held the parameters with them). So windows
that a step makes worse, and all windows where the descent has become slow, settle from their measured starts and from
random ones as well, and keep the best.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.search import leaving
from ballbot.fitting.uncertainty import WindowEquations
from ballbot.identification.parameters import Coordinates
from ballbot.identification.prediction import DIFFERENCE, WINDOWS, Problem, Work
from ballbot.progress import Progress

#: inner step [s] of the simulations that show the way, and not how far it goes
DERIVATIVE_STEP = 5e-3
#: half the difference in a scaled parameter, for those that show the way; wheels that begin to stick bend wider ones
_NARROW = 2e-4
#: of the parameters' diagonal at first, and at least and at most; a step that gains nothing takes ten times as much
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-8, 1e3
_TRIALS = 4
#: shares of their own shift, and of what follows from the parameters' step, that starts take; each window's
#: whichever suits it, as a wheel that begins to stick makes some windows anything but straight
_SHARES = ((1.0, 1.0), (0.0, 1.0), (0.0, 0.0))
#: windows settle where so many steps one after another gain less than this, and again where they gain little; the
#: descent then ends
_PATIENCE, _SLOW = 2, 1e-4
#: little: b, c, s and v_s form a bent and nearly level valley, in which one short step does not mean its floor
_LITTLE = 4e-6
_SETTLES = 2
#: a window settles from so many starts with so many steps, one after the other; the best of them go on
_SETTLING = ((10, 1), (3, 2), (1, 3))
#: and where a step has made a window worse by more, in squares of a residual's deviation, it settles briefly there;
#: a step that makes more than this share of the windows worse is too long
_WORSE, _BRIEFLY, _MOST_WORSE = 1.0, ((6, 1), (1, 2)), 0.25
#: all but two of them random, with from so many times to so many the deviations that its residuals leave
_SPREADS = 1.0, 4.0
#: steps of each window's start by itself are tried with these shares of the full one
_LENGTHS = (1.0, 0.3)
#: half the central difference of a start, in standard deviations of its state's residuals
_START_DIFFERENCE = 0.5
_STATES = 10
#: moving a start along the floor moves the whole prediction: these columns of S need no simulation
_ON_FLOOR = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Linearized:
    """Equations about a point and starts, zero for parameters that are held, and how the best starts follow."""

    H: NDArray[np.float64]  #: (w, p, p)
    B: NDArray[np.float64]  #: (w, 10, p)
    A: NDArray[np.float64]  #: (w, 10, 10)
    g: NDArray[np.float64]  #: (w, p)
    a: NDArray[np.float64]  #: (w, 10)

    @cached_property
    def response(self) -> NDArray[np.float64]:
        """How the best starts follow the parameters (w, 10, p), d x_w / d p."""
        return np.negative(np.linalg.solve(self.A, self.B), dtype=np.float64)

    @cached_property
    def shift(self) -> NDArray[np.float64]:
        """How starts move where the parameters stay (w, 10), dx_w."""
        return np.negative(np.linalg.solve(self.A, self.a[..., None])[..., 0], dtype=np.float64)

    @cached_property
    def equations(self) -> WindowEquations:
        """The parameters' equations of each window, its start eliminated."""
        B = self.B.transpose(0, 2, 1)
        return WindowEquations(
            matrices=self.H + B @ self.response, scores=self.g + (B @ self.shift[..., None])[..., 0]
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Descended:
    """Result of a descent."""

    problem: Problem
    point: NDArray[np.float64]  #: (p,), scaled
    starts: NDArray[np.float64]  #: (w, 10), estimated, as sensors without noise would see them
    cost: float  #: there, the starts' residuals among the others

    def repeated(
        self, *, moved: NDArray[np.float64], free: NDArray[np.bool_], most_steps: int, run: Run = DEFAULT_RUN
    ) -> Descended:
        """Descend again from here; see `ballbot.fitting.intervals.Repeated`."""
        point, starts, history = descend(
            self.problem, self.point, self.starts, free=free, most_steps=most_steps, moved=moved, run=run
        )
        return Descended(problem=self.problem, point=point, starts=starts, cost=history[-1])


@dataclass(frozen=True, kw_only=True, eq=False)
class InitialStatesFit(Descended):
    """Result of a fit."""

    equations: WindowEquations  #: there
    history: tuple[float, ...]  #: the cost after each step

    @property
    def coordinates(self) -> Coordinates:
        """The parameters."""
        return self.problem.coordinates

    @property
    def residual_count(self) -> int:
        """How many residuals the cost counts."""
        return compared(self.problem) * int(self.problem.cost.counted.sum())


def fit_with_initial_states(
    problem: Problem,
    point: NDArray[np.float64],
    *,
    free: NDArray[np.bool_],
    most_steps: int,
    starts: NDArray[np.float64] | None = None,
    run: Run = DEFAULT_RUN,
) -> InitialStatesFit:
    """Descend from `point` (p,), scaled, in the parameters marked in `free` (p,) and all starts at once.

    The stage "gauss_newton" is reported after each step. `starts` (w, 10) are those to begin with; by default as
    measured.
    """
    begin = problem.windows.initial if starts is None else starts
    end, starts, history = descend(problem, point, begin, free=free, most_steps=most_steps, run=run)
    return InitialStatesFit(
        problem=problem,
        point=end,
        starts=starts,
        cost=history[-1],
        equations=linearize(problem, end, starts).equations,
        history=tuple(history),
    )


def costs(problem: Problem, points: NDArray[np.float64], starts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the costs (sets,) of scaled parameters (sets, p) with windows' starts (sets, w, 10)."""
    return problem.cost((_residuals(problem, points, starts) ** 2).sum(axis=(1, 2)))


def linearize(problem: Problem, point: NDArray[np.float64], starts: NDArray[np.float64]) -> Linearized:
    """Return each window's equations about scaled parameters (p,) and starts (w, 10)."""
    return _linearized(problem, _at(problem, point, starts), side=0)


def compared(problem: Problem) -> int:
    """Return how many residuals each state has, starts among them."""
    windows = problem.windows
    return len(windows) * (1 + windows.samples // windows.comparison_interval)


def descend(
    problem: Problem,
    point: NDArray[np.float64],
    starts: NDArray[np.float64],
    *,
    free: NDArray[np.bool_],
    most_steps: int,
    moved: NDArray[np.float64] | None = None,
    run: Run = DEFAULT_RUN,
) -> tuple[NDArray[np.float64], NDArray[np.float64], list[float]]:
    """Descend from a point (p,) and starts (w, 10); return where it ended, likewise, and the cost after each step.

    Parameters
    ----------
    free : ndarray (p,)
        Which parameters the descent moves.
    most_steps : int
    moved : ndarray (p,), optional
        By how much the first step moves those that are not free, whatever it costs.
    run : Run, optional
        The stage "gauss_newton" is reported after each step.
    """
    fixed = np.zeros(len(point)) if moved is None else moved
    at, damping, history = _at(problem, point, starts), _DAMPING, list[float]()
    short_steps = settles = 0
    for step in range(1, most_steps + 1):
        before, settling = at.cost, short_steps == _PATIENCE
        if settling:
            settled = _settled(
                problem, at, np.arange(len(at.starts)), _SETTLING, weights=at.weights, seed=settles
            )
            at = settled if settled.cost < at.cost else at
        else:
            about = _linearized(problem, at, side=1 if step % 2 else -1)
            at, damping = _best_trial(problem, at, about, free=free, fixed=fixed, damping=damping)
        history.append(at.cost)
        run.progress(Progress(stage="gauss_newton", done=step, total=most_steps, cost=at.cost))
        settles += settling
        little = _LITTLE if settles else _SLOW
        gains = settling or fixed.any() or before - at.cost > little
        short_steps, fixed = 0 if gains else short_steps + 1, np.zeros(len(point))
        if short_steps == _PATIENCE and settles == _SETTLES:
            break
    return at.point, at.starts, history


@dataclass(frozen=True, kw_only=True, eq=False)
class _At:
    """A point, starts, and what is predicted there."""

    point: NDArray[np.float64]  #: (p,), scaled
    starts: NDArray[np.float64]  #: (w, 10)
    residuals: NDArray[np.float64]  #: (w, 1 + k, 10)
    weights: NDArray[np.float64]  #: (1 + k, 10), of the residuals of every window
    cost: float


def _at(
    problem: Problem,
    point: NDArray[np.float64],
    starts: NDArray[np.float64],
    residuals: NDArray[np.float64] | None = None,
) -> _At:
    """Return what is predicted at a point (p,) with starts (w, 10)."""
    predicted = _residuals(problem, point[None], starts[None])[0] if residuals is None else residuals
    squares = (predicted**2).sum(axis=(0, 1))
    # a state that does not count still ties its start, or nothing would
    tied = replace(problem.cost, counted=np.ones(_STATES, dtype=bool))
    weights = np.tile(problem.cost.weights(squares, compared(problem)), (predicted.shape[1], 1))
    weights[0] = tied.weights(squares, compared(problem))
    return _At(
        point=point,
        starts=starts,
        residuals=predicted,
        weights=weights,
        cost=float(problem.cost(squares)),
    )


def _best_trial(
    problem: Problem,
    at: _At,
    about: Linearized,
    *,
    free: NDArray[np.bool_],
    fixed: NDArray[np.float64],
    damping: float,
) -> tuple[_At, float]:
    """Return where a step leads, with the damping of the next; where it was if no damping lowers the cost."""
    normal = about.equations.normal
    gradient = normal.scores.sum(axis=0) + normal.matrix @ fixed
    moved = np.flatnonzero(free & ~leaving(at.point, gradient) & (normal.matrix.diagonal() > 0.0))
    H = normal.matrix[np.ix_(moved, moved)]
    for trial in range(_TRIALS):
        step = fixed.copy()
        step[moved] = -np.linalg.solve(H + damping * np.diag(H.diagonal()), gradient[moved])
        point = np.clip(at.point + step, 0.0, 1.0)
        follow = about.response @ (point - at.point)
        offered = np.stack([at.starts + own * about.shift + share * follow for own, share in _SHARES])
        residuals = _residuals(problem, np.tile(point, (len(offered), 1)), offered)
        starts, residuals = _better(offered, residuals, at.weights)
        worse = _squares(residuals, at.weights) - _squares(at.residuals, at.weights) > _WORSE
        after = _at(problem, point, starts, residuals)
        if worse.mean() < _MOST_WORSE:
            after = _settled(problem, after, np.flatnonzero(worse), _BRIEFLY, weights=at.weights)
        if after.cost < (np.inf if fixed.any() else at.cost):
            return after, damping if trial else max(0.1 * damping, _LEAST_DAMPING)
        damping = min(10.0 * damping, _MOST_DAMPING)
    return at, damping


def _better(
    starts: NDArray[np.float64], residuals: NDArray[np.float64], weights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return each window's best of the starts (sets, w, 10) and residuals (sets, w, 1 + k, 10) that are offered."""
    best = _squares(residuals, weights).argmin(axis=0), np.arange(residuals.shape[1])
    return starts[best], residuals[best]


def _squares(residuals: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weighted sums (...) of squares of residuals (..., 1 + k, 10), infinite without a value."""
    return np.nan_to_num(((residuals * weights) ** 2).sum(axis=(-2, -1)), nan=np.inf)


def _settled(
    problem: Problem,
    at: _At,
    rows: NDArray[np.int64],
    plan: Plan,
    *,
    weights: NDArray[np.float64],
    seed: int = 0,
) -> _At:
    """Return the same point with the best start of each of these windows, after settling by a plan."""
    if not len(rows):
        return at
    values, work = problem.coordinates.physical(at.point), problem.work
    about = _Settling(values=values, weights=weights, step=_derivative_step(problem), plan=plan, seed=seed)
    parts = np.array_split(rows, -(-len(rows) // WINDOWS))
    found = problem.executor(_settled_piece, work, [(about, at.starts[part], part) for part in parts])
    starts, residuals = at.starts.copy(), at.residuals.copy()
    starts[rows], residuals[rows] = (np.concatenate(one) for one in zip(*found, strict=True))
    return _at(problem, at.point, starts, residuals)


def _linearized(problem: Problem, at: _At, *, side: int) -> Linearized:
    """Return the equations by differences to one side, 1 or -1, with a long inner step, or exact central ones, 0."""
    places = np.flatnonzero(problem.coordinates.free)
    m, size, towards = len(places), len(at.point), side or 1
    width = towards * (_NARROW if side else DIFFERENCE) * np.eye(size)[places]
    ahead, behind = at.point + width, np.clip(at.point - width, 0.0, 1.0)
    if side:
        outside = ((ahead < 0.0) | (ahead > 1.0)).any(axis=1, keepdims=True)
        ahead, behind = np.where(outside, behind, ahead), at.point[None]
    ahead = np.clip(ahead, 0.0, 1.0)
    moves = towards * _moves(at.weights)
    held, still = np.tile(at.point, (len(moves), 1)), np.zeros((m, _STATES))
    points = np.concatenate([ahead, held, behind] if side else [ahead, held, behind, held])
    shifts = [still, moves, still[:1]] if side else [still, moves, still, -moves]
    about = _About(
        values=problem.coordinates.physical(points),
        shifts=np.concatenate(shifts),
        distance=np.concatenate([(ahead - behind).sum(axis=1), (2 - abs(side)) * moves.sum(axis=1)]),
        weights=at.weights,
        step=_derivative_step(problem) if side else problem.predictor.step,
    )
    work = problem.work
    pieces = [(about, at.starts[rows], at.residuals[rows], rows) for rows in work.rows]
    parts = problem.executor(_products, work, pieces)
    H, B, A, g, a = (np.concatenate(one) for one in zip(*parts, strict=True))
    count = len(A)
    found = Linearized(
        H=np.zeros((count, size, size)),
        B=np.zeros((count, _STATES, size)),
        A=A,
        g=np.zeros((count, size)),
        a=a,
    )
    found.H[:, places[:, None], places], found.B[:, :, places], found.g[:, places] = H, B, g
    return found


def _moves(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the differences (8, 10) of starts off the floor, for weights (1 + k, 10) of residuals."""
    return np.diag(_START_DIFFERENCE / weights[0])[_ON_FLOOR:]


def _derivative_step(problem: Problem) -> float:
    return max(problem.predictor.step, DERIVATIVE_STEP)


@dataclass(frozen=True, kw_only=True, eq=False)
class _About:
    """Inputs of the equations of a piece: n points ahead, then n or one behind."""

    values: NDArray[np.float64]  #: (n + n or 1, p), SI units
    shifts: NDArray[np.float64]  #: (n + n or 1, 10), of the starts
    distance: NDArray[np.float64]  #: (n,), between the two of each, scaled
    weights: NDArray[np.float64]  #: (1 + k, 10)
    step: float  #: [s]


def _derivatives(
    work: Work, about: _About, starts: NDArray[np.float64], rows: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the weighted residuals' derivatives (rows, n, (1 + k) 10); zero if a prediction has no value."""
    n = len(about.distance)
    found = _predicted(work, about.values, starts + about.shifts[:, None], rows, step=about.step)
    with np.errstate(invalid="ignore"):
        slopes = (found[:n] - found[n:]) / about.distance[:, None, None, None] * about.weights
    slopes = np.nan_to_num(slopes, nan=0.0, posinf=0.0, neginf=0.0)
    return slopes.reshape(n, len(rows), -1).transpose(1, 0, 2)


def _with_floor(by_starts: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return S (rows, 10, (1 + k) 10) from the derivatives (rows, 8, ..) by what simulations are needed for."""
    on_floor = np.zeros((len(by_starts), _ON_FLOOR, *weights.shape))
    for state in range(_ON_FLOOR):
        on_floor[:, state, :, state] = weights[:, state]
    return np.concatenate([on_floor.reshape(len(by_starts), _ON_FLOOR, -1), by_starts], axis=1)


#: numbers of starts that settle together, and of their steps; see `_SETTLING`
Plan = tuple[tuple[int, int], ...]
Piece = tuple[_About, NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]


def _products(work: Work, piece: Piece) -> tuple[NDArray[np.float64], ...]:
    """Return a piece's H, B, A, g and a, of the m parameters that are free."""
    about, starts, residuals, rows = piece
    slopes = _derivatives(work, about, starts, rows)
    m = slopes.shape[1] - (_STATES - _ON_FLOOR)
    J, S = slopes[:, :m], _with_floor(slopes[:, m:], about.weights)
    r = (residuals * about.weights).reshape(len(rows), -1, 1)
    # so small that BLAS takes one thread, and the order of summation is always the same
    J_T, S_T = J.transpose(0, 2, 1), S.transpose(0, 2, 1)
    return J @ J_T, S @ J_T, S @ S_T, (J @ r)[..., 0], (S @ r)[..., 0]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Settling:
    """What starts settle with."""

    values: NDArray[np.float64]  #: (p,), SI units
    weights: NDArray[np.float64]  #: (1 + k, 10)
    step: float  #: of the derivatives [s]
    plan: Plan
    seed: int  #: of the random starts


def _settled_piece(
    work: Work, piece: tuple[_Settling, NDArray[np.float64], NDArray[np.int64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return each window's best start (rows, 10) and residuals (rows, 1 + k, 10), from its start (rows, 10)."""
    about, at, rows = piece
    S = _by_starts(work, about, at, rows, side=1)
    spread = np.linalg.inv(np.linalg.cholesky(S @ S.transpose(0, 2, 1))).transpose(0, 2, 1)
    count = about.plan[0][0] - 2
    drawn = np.random.default_rng(about.seed).standard_normal((count, len(rows), _STATES, 1))
    drawn *= np.linspace(*_SPREADS, count)[:, None, None, None]
    begin = np.stack([at, work.windows.initial[rows]])
    starts = np.concatenate([begin, at + (spread @ drawn)[..., 0]])
    residuals = _predicted(work, np.tile(about.values, (len(starts), 1)), starts, rows)
    for sets, steps in about.plan:
        order = np.argsort(_squares(residuals, about.weights), axis=0, kind="stable")[:sets]
        best = order, np.arange(len(rows))
        starts, residuals = _settled_from(work, about, starts[best], residuals[best], rows, steps)
    return _better(starts, residuals, about.weights)


def _by_starts(
    work: Work, about: _Settling, starts: NDArray[np.float64], rows: NDArray[np.int64], *, side: int
) -> NDArray[np.float64]:
    """Return S (rows, 10, (1 + k) 10), by differences to one side, 1 or -1."""
    moves = _moves(about.weights)
    to_one_side = _About(
        values=np.tile(about.values, (len(moves) + 1, 1)),
        shifts=side * np.concatenate([moves, np.zeros((1, _STATES))]),
        distance=side * moves.sum(axis=1),
        weights=about.weights,
        step=about.step,
    )
    return _with_floor(_derivatives(work, to_one_side, starts, rows), about.weights)


def _settled_from(
    work: Work,
    about: _Settling,
    starts: NDArray[np.float64],
    residuals: NDArray[np.float64],
    rows: NDArray[np.int64],
    steps: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return starts (sets, rows, 10) and residuals (sets, rows, 1 + k, 10) after damped steps of each by itself."""
    shape, diagonal = residuals.shape, np.arange(_STATES)
    starts, residuals = starts.reshape(-1, _STATES), residuals.reshape(-1, *shape[2:])
    rows, damping = np.tile(rows, shape[0]), np.full(len(starts), _DAMPING)
    for step in range(steps):
        S = _by_starts(work, about, starts, rows, side=1 if step % 2 else -1)
        A, a = S @ S.transpose(0, 2, 1), S @ (residuals * about.weights).reshape(len(rows), -1, 1)
        A[:, diagonal, diagonal] *= 1.0 + damping[:, None]
        shift = -np.linalg.solve(A, a)[..., 0]
        offered = np.stack([starts, *(starts + length * shift for length in _LENGTHS)])
        values = np.tile(about.values, (len(_LENGTHS), 1))
        later = np.concatenate([residuals[None], _predicted(work, values, offered[1:], rows)])
        before = starts
        starts, residuals = _better(offered, later, about.weights)
        moved = (starts != before).any(axis=1)
        damping = np.where(moved, 0.1 * damping, np.maximum(10.0 * damping, 0.1))
    return starts.reshape(*shape[:2], _STATES), residuals.reshape(shape)


def _predicted(
    work: Work,
    values: NDArray[np.float64],
    starts: NDArray[np.float64],
    rows: NDArray[np.int64],
    *,
    step: float | None = None,
) -> NDArray[np.float64]:
    """Return residuals (sets, rows, 1 + k, 10) in SI units, those of the starts (sets, rows, 10) first."""
    windows, every = work.windows.take(rows), work.windows.comparison_interval
    later = work.predictor.residuals(values, windows, every=every, starts=starts, step=step)
    return np.concatenate([(starts - windows.initial)[:, :, None], later], axis=2)


def _predicted_piece(
    work: Work, piece: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]
) -> NDArray[np.float64]:
    return _predicted(work, *piece)


def _residuals(
    problem: Problem, points: NDArray[np.float64], starts: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return residuals (sets, w, 1 + k, 10) of scaled parameters (sets, p) and starts (sets, w, 10)."""
    work, values = problem.work, problem.coordinates.physical(points)
    parts = problem.executor(_predicted_piece, work, [(values, starts[:, rows], rows) for rows in work.rows])
    return np.concatenate(parts, axis=1)
