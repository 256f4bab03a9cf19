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

Each step tries one point of the parameters, within a trust region in Levenberg and Marquardt's form, and compares the
least costs over the starts here and there. Its derivatives are those of the steps themselves, by narrow differences.

Kinks. A prediction is smooth but where the sign of a wheel's or the ball's speed changes or a contact comes to rest:
there it is continuous, and its derivatives jump. Of a hundred windows some ten have their best start on such a kink,
where no derivative is zero: steps that know one side alone stop short of it, and the parameters' gradient then has an
error of the size of that window's. From slopes Z = [J S] on one side and Z' on the other, with a shift between them,

    Z' - Z = u n^T,     the kink:  n^T (dp, dx) = kappa,     u kappa = u n^T shift - (r' - r - Z shift).

A start that is best on a kink stays there: n is a tie, a further residual of great weight, and what follows from it
for p and x_w is exact. Predictions of a step's gain then hold to four digits, window by window.

Other minima. A few windows in a hundred have several minima over their start, by which contact rests and when (1e-5 to
5e-4 of the cost each). Where the descent has ended, windows are therefore begun again from random starts: those whose
prediction is straight between its start and the new one, which tells that they lie in one basin, are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.uncertainty import WindowEquations
from ballbot.identification.parameters import Coordinates
from ballbot.identification.prediction import DIFFERENCE, Problem, Work
from ballbot.progress import Progress

#: differences of scaled parameters, and of starts in deviations of their state's residuals: those of the descent, which
#: agree with ones ten times wider to 1e-5, and half the central ones of the result's equations, which average over
#: single sticking steps
_NARROW, _WIDE = (1e-6, 1e-4), (DIFFERENCE, 0.5)
#: half the width of the trust region at first, in scaled parameters; a step that gains less than a quarter of what was
#: expected leaves this share of the step, one that gains more than three quarters gives room for so many of it
_RADIUS, _NARROWER, _WIDER = 0.3, 0.3, 2.5
#: a descent ends early where so many gains as the last would not reach what it is for: its gains shrink by two or more
_MORE_GAINS = 5.0
#: curvature in the flattest direction, of the steepest one's
_FLATTEST = 1e-12
#: where so many steps one after another gain less than the first, and promise no more or are shorter than the last,
#: windows are begun again; then the descent ends by the second
_PATIENCE, _SLOW, _LITTLE, _SHORT = 2, 1e-4, 5e-7, 1e-3
#: until that gains less of the cost, but not more often: a level valley is left by one better start of a window
MOST_RENEWALS, _WORTH = 8, 1e-6
#: a start has settled where a step promises less, in squares of a residual's deviation; steps at most
_SETTLED, _ROUNDS = 1e-3, 5
#: a step along one side's slopes holds if it gains this share of what they promise, and needs no new slopes with that
_HOLDS, _STRAIGHT = 0.5, 0.9
#: weight of a tie, over that of the residuals along its normal
_TIE = 1e6
#: random starts of each window, from so many times to so many the deviations that its residuals leave, and how many of
#: those that lie in other basins settle
_DRAWN, _SPREADS, _RENEWED = 48, (0.5, 3.0), 3
#: starts in other basins that go along with each window, which may become the better ones; and half the width of the
#: trust region at least after windows were begun again
_OTHERS, _AGAIN = 2, 0.02
#: they lie there if their cost, starts eliminated, differs by more, in squares; above the most they cannot be better
_APART, _FAR, _BETTER = 0.02, 60.0, 0.01
_STATES = 10
#: moving a start along the floor moves the whole prediction: these columns of S need no simulation
_ON_FLOOR = 2
#: stands for a residual without a value
_LOST = 1e150


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
    """Result of a descent, from which others go on."""

    problem: Problem
    end: Iterate
    history: tuple[float, ...]  #: the cost after each step

    @property
    def point(self) -> NDArray[np.float64]:
        """The parameters (p,), scaled."""
        return self.end.point

    @property
    def cost(self) -> float:
        """The cost there, the starts' residuals among the others."""
        return self.end.cost

    def repeated(
        self,
        *,
        moved: NDArray[np.float64],
        free: NDArray[np.bool_],
        most_steps: int,
        target: float = np.inf,
        run: Run = DEFAULT_RUN,
    ) -> Descended:
        """Descend again from here; see `ballbot.fitting.intervals.Repeated`."""
        return descend(
            self.problem, self.end, free=free, most_steps=most_steps, moved=moved, target=target, run=run
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class InitialStatesFit(Descended):
    """Result of a fit."""

    equations: WindowEquations  #: there

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
    begin: NDArray[np.float64] | Iterate,
    *,
    free: NDArray[np.bool_],
    most_steps: int,
    most_renewals: int = MOST_RENEWALS,
    target: float = np.inf,
    run: Run = DEFAULT_RUN,
) -> InitialStatesFit:
    """Descend in the parameters marked in `free` (p,) and all starts at once, and linearise there; see `descend`."""
    found = descend(
        problem,
        begin,
        free=free,
        most_steps=most_steps,
        most_renewals=most_renewals,
        target=target,
        run=run,
    )
    equations = linearize(problem, found.end.point, found.end.starts).equations
    return InitialStatesFit(problem=problem, end=found.end, history=found.history, equations=equations)


def costs(problem: Problem, points: NDArray[np.float64], starts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the costs (sets,) of scaled parameters (sets, p) with windows' starts (sets, w, 10)."""
    values = problem.coordinates.physical(points)
    parts = problem.executor(
        _predicted_piece, problem.work, [(values, starts[:, rows], rows) for rows in problem.work.rows]
    )
    return problem.cost((np.concatenate(parts, axis=1) ** 2).sum(axis=(1, 2)))


def linearize(problem: Problem, point: NDArray[np.float64], starts: NDArray[np.float64]) -> Linearized:
    """Return each window's equations about scaled parameters (p,) and starts (w, 10), by wide central differences."""
    at = _at(problem, point, starts)
    about = _differences(problem, point, at.weights, _WIDE, central=True)
    found = problem.executor(_slopes_piece, problem.work, [(about, starts[k], k) for k in problem.work.rows])
    return replace(at, slopes=np.concatenate(found)).equations(problem)


def compared(problem: Problem) -> int:
    """Return how many residuals each state has, starts among them."""
    windows = problem.windows
    return len(windows) * (1 + windows.samples // windows.comparison_interval)


def first_iterate(
    problem: Problem, point: NDArray[np.float64], starts: NDArray[np.float64] | None = None
) -> Iterate:
    """Return where a descent begins: a scaled point (p,) and the best starts near those given (w, 10), or measured."""
    return _settled(
        problem, _at(problem, point, problem.windows.initial if starts is None else starts), point
    )


def descend(
    problem: Problem,
    begin: NDArray[np.float64] | Iterate,
    *,
    free: NDArray[np.bool_],
    most_steps: int,
    most_renewals: int = MOST_RENEWALS,
    moved: NDArray[np.float64] | None = None,
    target: float = np.inf,
    run: Run = DEFAULT_RUN,
) -> Descended:
    """Descend in the parameters and all starts at once.

    Parameters
    ----------
    begin : ndarray (p,) or Iterate
        A scaled point, the starts being as measured; or where another descent ended.
    free : ndarray (p,)
        Which parameters the descent moves.
    most_steps : int
    most_renewals : int
        How often windows are begun again.
    moved : ndarray (p,), optional
        By how much the first step moves those that are not free, whatever it costs.
    target : float
        The descent ends early where a few more gains as the last would leave it above this cost.
    run : Run, optional
        The stage "gauss_newton" is reported after each step.
    """
    at = begin if isinstance(begin, Iterate) else first_iterate(problem, begin)
    fixed = np.zeros(len(at.point)) if moved is None else moved
    radius, history = _RADIUS, list[float]()
    scale = 2.0 * compared(problem) * int(problem.cost.counted.sum())
    short_steps = renewals = 0
    for number in range(1, most_steps + 1):
        about = at.equations(problem)
        normal = about.equations.normal
        H, g = normal.matrix, normal.scores.sum(axis=0)
        step = _step(H, g, at.point, free=free, fixed=fixed, radius=radius)
        promised = -float(2.0 * g @ step + step @ H @ step) / scale
        ahead = at.starts + about.response @ step
        after = _settled(problem, at, at.point + step, np.stack([ahead, ahead + about.shift]))
        gain = at.cost - after.cost
        if gain > 0.0 or fixed.any():
            at = after
        length = float(np.abs(step - fixed).max())
        if gain < 0.25 * promised:
            radius = _NARROWER * length
        elif gain > 0.75 * promised:
            radius = min(max(radius, _WIDER * length), 1.0)
        little = _LITTLE if renewals == most_renewals else _SLOW
        short = gain < little and (promised < little or radius < _SHORT) and not fixed.any()
        hopeless = not fixed.any() and gain > 0.0 and at.cost - _MORE_GAINS * gain > target
        short_steps, fixed = short_steps + 1 if short else 0, np.zeros(len(at.point))
        if short_steps == _PATIENCE and not hopeless and renewals < most_renewals and number < most_steps:
            renewed = _renewed(problem, at, seed=renewals)
            renewals = renewals + 1 if renewed.cost < at.cost - _WORTH else most_renewals
            at, radius, short_steps = min(renewed, at, key=lambda one: one.cost), max(radius, _AGAIN), 0
        history.append(at.cost)
        run.progress(Progress(stage="gauss_newton", done=number, total=most_steps, cost=at.cost))
        if short_steps == _PATIENCE or hopeless:
            break
    return Descended(problem=problem, end=at, history=tuple(history))


@dataclass(frozen=True, kw_only=True, eq=False)
class Iterate:
    """A point of a descent: parameters and starts, what is predicted there, and its slopes by both."""

    point: NDArray[np.float64]  #: (p,), scaled
    starts: NDArray[np.float64]  #: (w, 10)
    residuals: NDArray[np.float64]  #: (w, 1 + k, 10)
    weights: NDArray[np.float64]  #: (1 + k, 10), of the residuals of every window
    cost: float
    slopes: NDArray[np.float64]  #: (w, m + 10, 1 + k, 10)
    ties: NDArray[np.float64] | float = 0.0  #: (w, m + 10, m + 10), see the module's text
    others: NDArray[np.float64]  #: (n, w, 10), starts in other basins, to be tried at the next point

    def equations(self, problem: Problem) -> Linearized:
        """Return the equations there."""
        places = np.flatnonzero(problem.coordinates.free)
        size, count = len(self.point), len(self.starts)
        Z, r = _flat(self.slopes, self.weights), _flat(self.residuals, self.weights)
        # so small that BLAS takes one thread, and the order of summation is always the same
        G, z = Z @ Z.transpose(0, 2, 1) + self.ties, (Z @ r[..., None])[..., 0]
        m = len(places)
        found = Linearized(
            H=np.zeros((count, size, size)),
            B=np.zeros((count, _STATES, size)),
            A=G[:, m:, m:],
            g=np.zeros((count, size)),
            a=z[:, m:],
        )
        found.H[:, places[:, None], places], found.B[:, :, places] = G[:, :m, :m], G[:, m:, :m]
        found.g[:, places] = z[:, :m]
        return found


def _at(problem: Problem, point: NDArray[np.float64], starts: NDArray[np.float64]) -> Iterate:
    """Return what is predicted at a point (p,) with starts (w, 10), without slopes."""
    values = problem.coordinates.physical(point[None])
    pieces = [(values, starts[None, rows], rows) for rows in problem.work.rows]
    parts = problem.executor(_predicted_piece, problem.work, pieces)
    none = np.zeros((0, *starts.shape))
    return _weighed(problem, point, starts, np.concatenate(parts, axis=1)[0], others=none)


def _weighed(
    problem: Problem,
    point: NDArray[np.float64],
    starts: NDArray[np.float64],
    residuals: NDArray[np.float64],
    slopes: NDArray[np.float64] | None = None,
    ties: NDArray[np.float64] | float = 0.0,
    *,
    others: NDArray[np.float64],
) -> Iterate:
    squares = (residuals**2).sum(axis=(0, 1))
    # a state that does not count still ties its start, or nothing would
    tied = replace(problem.cost, counted=np.ones(_STATES, dtype=bool))
    weights = np.tile(problem.cost.weights(squares, compared(problem)), (residuals.shape[1], 1))
    weights[0] = tied.weights(squares, compared(problem))
    return Iterate(
        point=point,
        starts=starts,
        residuals=residuals,
        weights=weights,
        cost=float(problem.cost(squares)),
        slopes=np.zeros(0) if slopes is None else slopes,
        ties=ties,
        others=others,
    )


def _step(
    H: NDArray[np.float64],
    g: NDArray[np.float64],
    point: NDArray[np.float64],
    *,
    free: NDArray[np.bool_],
    fixed: NDArray[np.float64],
    radius: float,
) -> NDArray[np.float64]:
    """Return the best step (p,) of free parameters beside that of those fixed, within the bounds and the region."""
    step, places = fixed.copy(), np.flatnonzero(free & (H.diagonal() > 0.0))
    if len(places):
        scale = 1.0 / np.sqrt(H.diagonal()[places])
        values, vectors = np.linalg.eigh(H[np.ix_(places, places)] * np.outer(scale, scale))
        roots = np.sqrt(np.maximum(values, _FLATTEST * values[-1]))
        right = -(vectors.T @ (scale * (g + H @ fixed)[places])) / roots
        inside = point[places]
        lower, upper = np.maximum(-radius, -inside), np.minimum(radius, 1.0 - inside)
        # in place of a side that is no interval
        upper = np.maximum(upper, lower + 1e-15)
        found = lsq_linear(roots[:, None] * vectors.T / scale, right, bounds=(lower, upper), method="bvls")
        step[places] = found.x
    return np.clip(point + step, 0.0, 1.0) - point


def _settled(
    problem: Problem, near: Iterate, point: NDArray[np.float64], offered: NDArray[np.float64] | None = None
) -> Iterate:
    """Return what is predicted at a point (p,) from the best starts near those there were or offered (n, w, 10)."""
    about = _differences(problem, point, near.weights, _NARROW)
    starts = near.starts[None] if offered is None else np.concatenate([near.starts[None], offered])
    pieces = [(about, starts[:, rows], near.others[:, rows], rows) for rows in problem.work.rows]
    found = problem.executor(_settled_piece, problem.work, pieces)
    others = np.concatenate([one[-1] for one in found], axis=1)
    settled = (np.concatenate(one) for one in zip(*(one[:-1] for one in found), strict=True))
    return _weighed(problem, point, *settled, others=others)


def _renewed(problem: Problem, at: Iterate, *, seed: int) -> Iterate:
    """Return the same point with the best start of each window, after settling from random ones as well."""
    about = _differences(problem, at.point, at.weights, _NARROW, starts_alone=True)
    slopes = at.slopes[:, -_STATES:]
    pieces = [
        (
            about,
            _Lanes(rows=rows, starts=at.starts[rows], residuals=at.residuals[rows], slopes=slopes[rows]),
            at.others[:, rows],
            seed,
        )
        for rows in problem.work.rows
    ]
    found = np.concatenate(problem.executor(_renewed_piece, problem.work, pieces), axis=1)
    return _settled(problem, replace(at, starts=found[0], others=found[1:]), at.point)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Differences:
    """What slopes are differences of: n points ahead, then n or one behind."""

    values: NDArray[np.float64]  #: (n + n or 1, p), SI units
    shifts: NDArray[np.float64]  #: (n + n or 1, 10), of the starts
    distance: NDArray[np.float64]  #: (n,), between the two of each, scaled
    weights: NDArray[np.float64]  #: (1 + k, 10)

    @property
    def parameters(self) -> int:
        """How many of the n points move a parameter, m."""
        return len(self.distance) - (_STATES - _ON_FLOOR)


def _differences(
    problem: Problem,
    point: NDArray[np.float64],
    weights: NDArray[np.float64],
    widths: tuple[float, float],
    *,
    central: bool = False,
    starts_alone: bool = False,
) -> _Differences:
    """Return differences about a point (p,) by these widths of parameters, unless of starts alone, and starts."""
    free = problem.coordinates.free
    places = np.flatnonzero(np.zeros_like(free) if starts_alone else free)
    width = widths[0] * np.eye(len(point))[places]
    ahead, behind = point + width, np.clip(point - width, 0.0, 1.0)
    if central:
        ahead = np.clip(ahead, 0.0, 1.0)
    else:
        ahead, behind = np.where((ahead > 1.0).any(axis=1, keepdims=True), behind, ahead), point[None]
    moves = np.diag(widths[1] / weights[0])[_ON_FLOOR:]
    held, still = np.tile(point, (len(moves), 1)), np.zeros((len(places), _STATES))
    points = [ahead, held, behind, held] if central else [ahead, held, behind]
    shifts = [still, moves, still, -moves] if central else [still, moves, np.zeros((1, _STATES))]
    return _Differences(
        values=problem.coordinates.physical(np.concatenate(points)),
        shifts=np.concatenate(shifts),
        distance=np.concatenate([(ahead - behind).sum(axis=1), (1 + central) * moves.sum(axis=1)]),
        weights=weights,
    )


@dataclass(kw_only=True, eq=False)
class _Lanes:
    """Starts that settle side by side, each of a window; changed in place."""

    rows: NDArray[np.int64]  #: (n,), the windows
    starts: NDArray[np.float64]  #: (n, 10)
    #: (n, 1 + k, 10), from the starts; where differences are central, from the last ones behind
    residuals: NDArray[np.float64]
    slopes: NDArray[np.float64]  #: (n, m + 10, 1 + k, 10)


def _lanes(work: Work, about: _Differences, starts: NDArray[np.float64], rows: NDArray[np.int64]) -> _Lanes:
    """Return starts (n, 10) of windows with their slopes, zero where a prediction has no value."""
    n, m = len(about.distance), about.parameters
    found = _predicted(work, about.values, starts + about.shifts[:, None], rows)
    slopes = np.zeros((len(rows), m + _STATES, *found.shape[2:]))
    with np.errstate(invalid="ignore"):
        differences = ((found[:n] - found[n:]) / about.distance[:, None, None, None]).transpose(1, 0, 2, 3)
    differences = np.where(np.isfinite(differences), differences, 0.0)
    slopes[:, :m], slopes[:, m + _ON_FLOOR :] = differences[:, :m], differences[:, m:]
    for state in range(_ON_FLOOR):
        slopes[:, m + state, :, state] = 1.0
    return _Lanes(rows=rows, starts=starts.copy(), residuals=found[-1], slopes=slopes)


def _slopes_piece(
    work: Work, piece: tuple[_Differences, NDArray[np.float64], NDArray[np.int64]]
) -> NDArray[np.float64]:
    return _lanes(work, *piece).slopes


def _settled_piece(
    work: Work,
    piece: tuple[_Differences, NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]],
) -> tuple[NDArray[np.float64], ...]:
    """Return each window's best start near the best of those offered, its residuals, slopes and ties, and others."""
    about, own, others, rows = piece
    offered, others, each = np.concatenate([own, others]), others.copy(), np.arange(len(rows))
    starts = offered[0]
    if len(offered) > 1:
        values = np.tile(about.values[-1:], (len(offered), 1))
        squares = (_flat(_predicted(work, values, offered, rows), about.weights) ** 2).sum(axis=-1)
        chosen = squares.argmin(axis=0)
        starts = offered[chosen, each]
        left = np.flatnonzero(chosen >= len(own))
        others[chosen[left] - len(own), left] = own[0, left]
    lanes = _lanes(work, about, starts, rows)
    ties = _settle(work, about, lanes)
    return lanes.starts, lanes.residuals, lanes.slopes, ties, others


def _at_starts(
    work: Work, about: _Differences, starts: NDArray[np.float64], rows: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the residuals (n, 1 + k, 10) from starts (n, 10) at the point that differences are about."""
    return _predicted(work, about.values[-1:], starts[None], rows)[0]


def _settle(work: Work, about: _Differences, lanes: _Lanes) -> NDArray[np.float64]:
    """Bring each lane to the least cost over its start; return its ties (n, m + 10, m + 10)."""
    m, W = about.parameters, about.weights
    ties = np.zeros((len(lanes.rows), m + _STATES, m + _STATES))
    active = np.arange(len(lanes.rows))
    for _ in range(_ROUNDS):
        Z, r = _flat(lanes.slopes[active], W), _flat(lanes.residuals[active], W)
        S = Z[:, m:]
        A, a = S @ S.transpose(0, 2, 1), (S @ r[..., None])[..., 0]
        own, A = A, A + ties[active][:, m:, m:]
        shift: NDArray[np.float64] = np.negative(np.linalg.solve(A, a[..., None])[..., 0], dtype=np.float64)
        promised = -(a * shift).sum(axis=1)
        unsettled = promised > _SETTLED
        if not unsettled.any():
            break
        active, shift, promised = active[unsettled], shift[unsettled], promised[unsettled]
        ahead = lanes.starts[active] + shift
        residuals = _at_starts(work, about, ahead, lanes.rows[active])
        before = (r[unsettled] ** 2).sum(axis=1)
        straight = before - (_flat(residuals, W) ** 2).sum(axis=1) > _STRAIGHT * promised
        passed = active[straight]
        lanes.starts[passed], lanes.residuals[passed] = ahead[straight], residuals[straight]
        if straight.all():
            continue
        turned = np.flatnonzero(unsettled)[~straight]
        active, shift, promised, before = (
            active[~straight],
            shift[~straight],
            promised[~straight],
            before[~straight],
        )
        Z, r, own, A, a = Z[turned], r[turned], own[turned], A[turned], a[turned]
        ahead = _lanes(work, about, lanes.starts[active] + shift, lanes.rows[active])
        Z_ahead, r_ahead = _flat(ahead.slopes, W), _flat(ahead.residuals, W)
        normal, distance = _kink(Z, Z_ahead, r_ahead - r, shift)
        n = normal[:, m:]
        free = (n * np.linalg.solve(own, n[..., None])[..., 0]).sum(axis=1, keepdims=True)
        weight = _TIE / np.maximum(free, 1e-300)
        tied = (weight * n)[:, :, None] * n[:, None]
        onto = -np.linalg.solve(A + tied, (a - weight * distance[:, None] * n)[..., None])[..., 0]
        on_kink = lanes.starts[active] + onto
        residuals = _at_starts(work, about, on_kink, lanes.rows[active])
        gain = before - (r_ahead**2).sum(axis=1)
        gain_on_kink = before - (_flat(residuals, W) ** 2).sum(axis=1)
        holds = (gain > _HOLDS * promised) | (gain > np.maximum(gain_on_kink, 0.0))
        passed, kept = active[holds], active[~holds]
        lanes.starts[passed], lanes.residuals[passed] = ahead.starts[holds], ahead.residuals[holds]
        lanes.slopes[passed], ties[passed] = ahead.slopes[holds], 0.0
        # the ties before this one were of the right kinks only if it led to what was expected
        expected = -(2.0 * a * onto).sum(axis=1) - (onto * (own @ onto[..., None])[..., 0]).sum(axis=1)
        right = np.abs(gain_on_kink - expected) < 0.2 * np.abs(expected) + _SETTLED
        ties[active[~holds & ~right]] = 0.0
        ties[kept] += ((weight * normal)[:, :, None] * normal[:, None])[~holds]
        nearer = ~holds & (gain_on_kink > 0.0)
        lanes.starts[active[nearer]], lanes.residuals[active[nearer]] = on_kink[nearer], residuals[nearer]
    return ties


def _kink(
    Z: NDArray[np.float64],
    ahead: NDArray[np.float64],
    change: NDArray[np.float64],
    shift: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where slopes jump between starts: the normals (n, m + 10), 1 long by the start, and the distances (n,).

    Parameters
    ----------
    Z, ahead : ndarray (n, m + 10, K)
        Weighted slopes at the starts and after the shifts (n, 10).
    change : ndarray (n, K)
        Of the weighted residuals.
    """
    m = Z.shape[1] - _STATES
    lengths = np.maximum(np.sqrt((Z**2).sum(axis=2)), 1e-9)
    jump = (ahead - Z) / lengths[:, :, None]
    vectors = np.linalg.eigh(jump @ jump.transpose(0, 2, 1))[1][..., -1]
    u, normal = (vectors[:, None] @ jump)[:, 0], vectors * lengths
    size = np.maximum(np.linalg.norm(normal[:, m:], axis=1), 1e-300)[:, None]
    along = (normal[:, m:] * shift).sum(axis=1, keepdims=True)
    size = np.where(along < 0.0, -size, size)
    normal, u, along = normal / size, u * size, along / size
    unexplained = change - (shift[:, None] @ Z[:, m:])[:, 0]
    share = (unexplained * u).sum(axis=1, keepdims=True) / np.maximum(
        (u**2).sum(axis=1, keepdims=True), 1e-300
    )
    return normal, np.clip(along - share, 0.0, along)[:, 0]


def _renewed_piece(
    work: Work, piece: tuple[_Differences, _Lanes, NDArray[np.float64], int]
) -> NDArray[np.float64]:
    """Return the best starts (1 + n, rows, 10), of the own one and those that settle from measured and random ones."""
    about, own, others, seed = piece
    S, r = _flat(own.slopes, about.weights), _flat(own.residuals, about.weights)
    A = S @ S.transpose(0, 2, 1)
    spread = np.linalg.inv(np.linalg.cholesky(A)).transpose(0, 2, 1)
    drawn = np.random.default_rng([seed, int(own.rows[0])]).standard_normal((_DRAWN, *own.starts.shape, 1))
    drawn *= np.linspace(*_SPREADS, _DRAWN)[:, None, None, None]
    random = own.starts + (spread @ drawn)[..., 0]
    offered = np.concatenate([work.windows.initial[own.rows][None], others, random])
    values = np.tile(about.values[-1:], (len(offered), 1))
    residuals = _flat(_predicted(work, values, offered, own.rows), about.weights)

    def eliminated(r: NDArray[np.float64]) -> NDArray[np.float64]:
        a = (S @ r[..., None])[..., 0]
        return (r**2).sum(axis=-1) - (a * np.linalg.solve(A, a[..., None])[..., 0]).sum(axis=-1)

    there, here = eliminated(residuals), eliminated(r)
    apart = np.where((np.abs(there - here) > _APART) & (there < here + _FAR), there, np.inf)
    chosen = np.argsort(apart, axis=0, kind="stable")[:_RENEWED]
    sets, places = np.nonzero(np.isfinite(np.take_along_axis(apart, chosen, axis=0)))
    best = [
        [(float(squares) - _BETTER, start)]
        for squares, start in zip((r**2).sum(axis=1), own.starts, strict=True)
    ]
    if len(places):
        lanes = _lanes(work, about, offered[chosen[sets, places], places], own.rows[places])
        _settle(work, about, lanes)
        squares = (_flat(lanes.residuals, about.weights) ** 2).sum(axis=1)
        for place, one, start in zip(places, squares, lanes.starts, strict=True):
            if all(abs(one - known) > _APART for known, _ in best[place]):
                best[place].append((float(one), start))
    kept = [sorted(ones, key=lambda one: one[0])[: 1 + _OTHERS] for ones in best]
    filled = [[start for _, start in ones] + [ones[0][1]] * (1 + _OTHERS - len(ones)) for ones in kept]
    return np.array(filled).transpose(1, 0, 2)


def _flat(values: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return weighted residuals or slopes (..., (1 + k) 10) of those in SI units (..., 1 + k, 10)."""
    with np.errstate(invalid="ignore", over="ignore"):
        flat = (values * weights).reshape(*values.shape[:-2], -1)
    if flat.size and flat.max() < _LOST and flat.min() > -_LOST:  # as nearly always, and cheaper
        return flat
    return np.where(np.abs(flat) < _LOST, flat, _LOST)


def _predicted(
    work: Work, values: NDArray[np.float64], starts: NDArray[np.float64], rows: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return residuals (sets, rows, 1 + k, 10) in SI units, those of the starts (sets, rows, 10) first."""
    windows, every = work.windows.take(rows), work.windows.comparison_interval
    later = work.predictor.residuals(values, windows, every=every, starts=starts)
    return np.concatenate([(starts - windows.initial)[:, :, None], later], axis=2)


def _predicted_piece(
    work: Work, piece: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]
) -> NDArray[np.float64]:
    return _predicted(work, *piece)
