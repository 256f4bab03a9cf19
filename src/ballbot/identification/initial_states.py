"""The last stage of a fit: each window's start state is estimated too, and no longer taken as it was measured.

A window predicted from a measured start carries that one sample's noise, grown by an unstable plant, through all its
residuals: on simulated logs with the noise of good sensors, standard errors were four times too large for what a log
holds, a quarter too small for what the estimates did, and the estimates were biased, as with errors in any regressor.
Here the start x_w of each window w is one more unknown, tied to the measured start by a residual that weighs as those
of the other samples do. Gauss-Newton's equations then couple the parameters p with the starts only window by window,

    [ H_w   B_w^T ] [dp  ]     [ g_w ]        H_w = J_w^T J_w,  B_w = S_w^T J_w,  A_w = S_w^T S_w
    [ B_w   A_w   ] [dx_w] = - [ a_w ]        J_w, S_w: residuals by p and by x_w

and eliminating dx_w = -A_w^-1 (a_w + B_w dp) leaves, for the parameters alone, the sums over windows of

    H_w - B_w^T A_w^-1 B_w   and   g_w - B_w^T A_w^-1 a_w.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.search import LEAST_GAIN, leaving
from ballbot.fitting.uncertainty import WindowEquations
from ballbot.identification.parameters import Coordinates
from ballbot.identification.prediction import DIFFERENCE, Problem, Work
from ballbot.progress import Progress, ProgressCallback, steps_left

#: damping and length of the steps tried at once: short ones, as a wheel that begins to stick bends the cost sharply;
#: long ones, for the bent and nearly level valley of b, c, s and v_s; the last only settles the starts
_TRIALS = (
    *((1e-6, length) for length in (1.0, 0.1)),
    *((1e-3, length) for length in (0.1, 0.3, 1.0)),
    *((damping, length) for damping in (1e-2, 1e-1) for length in (1.0, 3.0)),
    (1.0, 1.0),
    (1e9, 1.0),
)
#: what the last so many steps did, so many times again: along the valley's floor small steps add up
_AGAIN = ((1, 3.0), (3, 3.0), (8, 1.0), (8, 3.0))
#: shares of their own shift, and of what follows from the parameters' step, that starts take; each window's
#: whichever suits it, as a wheel that begins to stick makes some windows anything but straight
_SHARES = ((1.0, 1.0), (0.0, 1.0), (0.0, 0.0))
#: widths of differences, one step after another: a step that the kinks of one width lead astray is free with the next
_WIDER = (1.0, 3.0, 9.0)
#: a start that has settled on one side of a wheel's sticking does not find the other: so the descent begins again, with
#: the parameters found and the starts as measured
ROUNDS = 2
#: the descent ends where so many steps one after another gain little: windows that settle hold the others up
_PATIENCE = 6
#: steps that a descent usually takes for each window, as windows settle one after another
_USUAL_STEPS = 0.3
#: half the central difference of a start, in standard deviations of its state's residuals
_START_DIFFERENCE = 0.5
_STATES = 10
#: moving a start along the floor moves the whole prediction: these columns of S need no simulation
_ON_FLOOR = 2
#: what a step costs, in simulations of every window: steps tried, and differences of the starts
TRIALS, WORK_OF_STARTS = len(_SHARES) * (len(_TRIALS) + len(_AGAIN)), 2 * (_STATES - _ON_FLOOR)


@dataclass(frozen=True, kw_only=True, eq=False)
class Linearized:
    """Equations about a point, and how the best starts follow the parameters there."""

    equations: WindowEquations
    weight: NDArray[np.float64]  #: (10,), of each state's residuals
    tie: NDArray[np.float64]  #: (10,), of each start's
    shift: NDArray[np.float64]  #: (w, 10), dx_w where the parameters stay
    response: NDArray[np.float64]  #: (w, 10, p), d x_w / d p


@dataclass(frozen=True, kw_only=True, eq=False)
class Descended:
    """Result of a descent."""

    problem: Problem
    point: NDArray[np.float64]  #: (p,), scaled
    starts: NDArray[np.float64]  #: (w, 10), estimated, as sensors without noise would see them
    cost: float  #: there, the starts' residuals among the others
    steps: int  #: of the descent that led here, which another one from here may be expected to take

    def repeated(
        self, *, moved: NDArray[np.float64], free: NDArray[np.bool_], most_steps: int, run: Run = DEFAULT_RUN
    ) -> Descended:
        """Descend again from here; see `ballbot.fitting.intervals.Repeated`."""
        point, starts, history = descend(
            self.problem,
            self.point,
            self.starts,
            free=free,
            most_steps=most_steps,
            moved=moved,
            usual=self.steps,
            run=run,
        )
        return Descended(
            problem=self.problem, point=point, starts=starts, cost=history[-1], steps=len(history)
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class InitialStatesFit(Descended):
    """Result of the last stage."""

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


def usual_steps(windows: int) -> float:
    """Return how many steps a descent usually takes."""
    return _USUAL_STEPS * windows


def fit_with_initial_states(
    problem: Problem,
    point: NDArray[np.float64],
    *,
    free: NDArray[np.bool_],
    most_steps: int,
    following: Callable[[InitialStatesFit], Mapping[str, float]] | None = None,
    run: Run = DEFAULT_RUN,
) -> InitialStatesFit:
    """Descend from `point` (p,), scaled, in the parameters marked in `free` (p,) and all starts at once.

    The run's checkpoint answers for each step; the stage "initial_states" is reported after each, with the steps to be
    expected. Once there is a fit, they are also those `following` it, by stage.
    """
    history: list[float] = []

    def fitted(end: NDArray[np.float64], starts: NDArray[np.float64], steps: int) -> InitialStatesFit:
        return InitialStatesFit(
            problem=problem,
            point=end,
            starts=starts,
            equations=linearize(problem, end, starts).equations,
            cost=least,
            steps=steps,
            history=tuple(history),
        )

    best, least = None, np.inf
    usual, after = usual_steps(len(problem.windows)), {"initial_states": 0.0}
    for later in reversed(range(ROUNDS)):
        done = len(history)
        ended, starts, costs_after = descend(
            problem,
            point if best is None else best.point,
            problem.windows.initial,
            free=free,
            most_steps=most_steps - done,
            usual=usual,
            run=replace(run, progress=partial(_report_round, run.progress, done, later, most_steps, after)),
        )
        history += costs_after
        if not costs_after or costs_after[-1] >= least:
            break
        least = costs_after[-1]
        best = fitted(ended, starts, len(costs_after))
        usual = len(costs_after)
        if later and following:
            after = following(best)
    return replace(best or fitted(point, problem.windows.initial, 0), history=tuple(history))


def _report_round(
    callback: ProgressCallback,
    done: int,
    later: int,
    most_steps: int,
    after: Mapping[str, float],
    progress: Progress,
) -> None:
    """Report a step of a round, before which so many were `done`: rounds `later` take as many steps as this one."""
    own, steps = progress.expected["initial_states"], done + progress.done
    left = min(own + later * (progress.done + own), most_steps - steps)
    expected = {**after, "initial_states": left + after["initial_states"]}
    callback(replace(progress, done=steps, expected=expected))


def costs(problem: Problem, points: NDArray[np.float64], starts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the costs (sets,) of scaled parameters (sets, p) with windows' starts (sets, w, 10)."""
    return problem.cost(_square_sums(problem, points, starts))


def linearize(
    problem: Problem, point: NDArray[np.float64], starts: NDArray[np.float64], *, wider: float = 1.0
) -> Linearized:
    """Return each window's equations about scaled parameters (p,) and starts (w, 10).

    `wider` multiplies the differences in the parameters that the derivatives are taken over.
    """
    moved = np.flatnonzero(problem.coordinates.free)
    step = wider * DIFFERENCE * np.eye(len(point))[moved]
    forward, backward = np.clip(point + step, 0.0, 1.0), np.clip(point - step, 0.0, 1.0)
    squares = _square_sums(problem, point[None], starts[None])[0]
    # a state that does not count still ties its start, or nothing would
    tie = replace(problem.cost, counted=np.ones(_STATES, dtype=bool)).weights(squares, compared(problem))
    about = _About(
        values=problem.coordinates.physical(np.concatenate([point[None], forward, backward])),
        distance=(forward - backward)[np.arange(len(moved)), moved],
        starts=starts,
        weight=problem.cost.weights(squares, compared(problem)),
        tie=tie,
    )
    work = Work(predictor=problem.predictor, windows=problem.windows)
    parts = problem.executor(_reduced, work, [(about, rows) for rows in work.rows])
    matrices, scores, shift, response = (np.concatenate(one) for one in zip(*parts, strict=True))
    count, size = len(problem.windows), len(point)
    equations = WindowEquations(matrices=np.zeros((count, size, size)), scores=np.zeros((count, size)))
    equations.matrices[:, moved[:, None], moved] = matrices
    equations.scores[:, moved] = scores
    responses = np.zeros((count, _STATES, size))
    responses[:, :, moved] = response
    return Linearized(equations=equations, weight=about.weight, tie=tie, shift=shift, response=responses)


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
    usual: float | None = None,
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
    usual : float, optional
        Steps that the descent may be expected to take; by default `usual_steps`.
    run : Run, optional
        Its checkpoint answers for each step; the stage "initial_states" is reported after each, with the steps still
        to be expected.
    """
    fixed = np.zeros(len(point)) if moved is None else moved
    least = np.inf if fixed.any() else float(costs(problem, point[None], starts[None])[0])
    history, short_steps, trail = [], 0, [point]
    usual = usual_steps(len(problem.windows)) if usual is None else usual
    for step in range(1, most_steps + 1):
        trial, its_starts, cost = run.memoize(
            "starts",
            point,
            partial(
                _best_trial,
                problem,
                point,
                starts,
                trail=trail,
                free=free,
                fixed=fixed,
                wider=_WIDER[step % len(_WIDER)],
            ),
        )
        gain = least - float(cost)
        if gain > 0.0:
            trail.append(point)
            point, starts, least = trial, its_starts, float(cost)
        fixed = np.zeros(len(point))
        history.append(least)
        short_steps = 0 if gain > LEAST_GAIN else short_steps + 1
        left = _expected_steps(step, short_steps, usual=usual, most_steps=most_steps)
        run.progress(
            Progress(
                stage="initial_states",
                done=step,
                total=most_steps,
                cost=least,
                expected={"initial_states": left},
            )
        )
        if short_steps == _PATIENCE:
            break
    return point, starts, history


def _expected_steps(step: int, short_steps: int, *, usual: float, most_steps: int) -> float:
    """Return how many more steps a descent may be expected to take: the fewer, the more short ones it has taken."""
    left = steps_left(step, usual=usual, most=most_steps) * (1.0 - short_steps / _PATIENCE)
    return min(max(left, _PATIENCE - short_steps), most_steps - step)


def _best_trial(
    problem: Problem,
    point: NDArray[np.float64],
    starts: NDArray[np.float64],
    *,
    trail: Sequence[NDArray[np.float64]],
    free: NDArray[np.bool_],
    fixed: NDArray[np.float64],
    wider: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the best of a step's trial points (p,), its starts (w, 10) and its cost ()."""
    about = linearize(problem, point, starts, wider=wider)
    again = [length * (point - trail[-min(back, len(trail))]) for back, length in _AGAIN]
    points = np.concatenate([_candidates(about, point, free, fixed), point + fixed + again * free])
    points = points.clip(0.0, 1.0)
    tried, moved_starts = _settled(problem, about, point, starts, points)
    best = int(tried.argmin())
    return points[best], moved_starts[best], tried[best]


def _candidates(
    about: Linearized, point: NDArray[np.float64], free: NDArray[np.bool_], fixed: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the points (trials, p) that the trial steps lead to."""
    normal = about.equations.normal
    gradient = normal.scores.sum(axis=0) + normal.matrix @ fixed
    moved = np.flatnonzero(free & ~leaving(point, gradient) & (normal.matrix.diagonal() > 0.0))
    H = normal.matrix[np.ix_(moved, moved)]
    steps = np.tile(fixed, (len(_TRIALS), 1))
    for step, (damping, length) in zip(steps, _TRIALS, strict=True):
        step[moved] = -length * np.linalg.solve(H + damping * np.diag(H.diagonal()), gradient[moved])
    return point + steps


def _settled(
    problem: Problem,
    about: Linearized,
    point: NDArray[np.float64],
    starts: NDArray[np.float64],
    points: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the costs (trials,) of points (trials, p) with the starts (trials, w, 10) that suit each of them."""
    follow = np.stack([about.response @ (one - point) for one in points])
    offered = np.stack([starts + own * about.shift + share * follow for own, share in _SHARES])
    shares, trials, count, _ = offered.shape
    squares = _squares_of_windows(problem, np.tile(points, (shares, 1)), offered.reshape(-1, count, _STATES))
    squares = squares.reshape(shares, trials, count, 2, _STATES)
    weighted = squares[..., 0, :] @ about.tie**2 + squares[..., 1, :] @ about.weight**2
    taken = np.nan_to_num(weighted, nan=np.inf).argmin(axis=0)[None, :, :, None]
    best = np.take_along_axis(squares.sum(axis=-2), taken, axis=0)[0]
    return problem.cost(best.sum(axis=1)), np.take_along_axis(offered, taken, axis=0)[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class _About:
    """Inputs of the equations of a piece."""

    values: NDArray[np.float64]  #: (1 + 2 m, p): the point, m of them forward of it, m backward; SI units
    distance: NDArray[np.float64]  #: (m,), from backward to forward, scaled
    starts: NDArray[np.float64]  #: (w, 10)
    weight: NDArray[np.float64]  #: (10,), of each state's residuals
    tie: NDArray[np.float64]  #: (10,), of each start's residuals


def _reduced(
    work: Work, piece: tuple[_About, NDArray[np.int64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return a piece's matrices (rows, m, m), scores (rows, m), shift (rows, 10) and response (rows, 10, m)."""
    about, rows = piece
    sets, count = len(about.values), len(rows)
    weights = np.concatenate([about.tie[None], np.tile(about.weight, (_times(work), 1))])
    starts = about.starts[rows]
    by_parameters = _residuals(work, about.values, np.tile(starts, (sets, 1, 1)), rows) * weights
    m = len(about.distance)
    J = (by_parameters[1 : 1 + m] - by_parameters[1 + m :]) / about.distance[:, None, None, None]
    J, r = J.reshape(m, count, -1), by_parameters[0].reshape(count, -1)
    S = (_by_starts(work, about, rows) * weights).reshape(_STATES, count, -1)

    # einsum and not BLAS, whose order of summation depends on its threads
    A = np.einsum("iwk,jwk->wij", S, S, optimize=False)
    B = np.einsum("iwk,jwk->wij", S, J, optimize=False)
    a = np.einsum("iwk,wk->wi", S, r, optimize=False)
    H = np.einsum("iwk,jwk->wij", J, J, optimize=False)
    g = np.einsum("iwk,wk->wi", J, r, optimize=False)
    response, shift = -np.linalg.solve(A, B), -np.linalg.solve(A, a[..., None])[..., 0]
    matrices = H + np.einsum("wki,wkj->wij", B, response, optimize=False)
    return matrices, g + np.einsum("wki,wk->wi", B, shift, optimize=False), shift, response


def _by_starts(work: Work, about: _About, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the residuals' derivatives (10, rows, 1 + k, 10) by the starts' states, without weights."""
    starts = about.starts[rows]
    half = _START_DIFFERENCE / about.tie[_ON_FLOOR:]
    steps = np.zeros((_STATES - _ON_FLOOR, 1, _STATES))
    steps[np.arange(_STATES - _ON_FLOOR), 0, np.arange(_ON_FLOOR, _STATES)] = half
    both = np.concatenate([starts + steps, starts - steps])
    residuals = _residuals(work, np.tile(about.values[0], (len(both), 1)), both, rows)
    forward, backward = np.split(residuals, 2)
    result = np.zeros((_STATES, *residuals.shape[1:]))
    result[np.arange(_ON_FLOOR), :, :, np.arange(_ON_FLOOR)] = 1.0
    result[_ON_FLOOR:] = (forward - backward) / (2.0 * half[:, None, None, None])
    return result


def _times(work: Work) -> int:
    return work.windows.samples // work.windows.comparison_interval


def _residuals(
    work: Work, values: NDArray[np.float64], starts: NDArray[np.float64], rows: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return residuals (sets, rows, 1 + k, 10) in SI units, those of the starts (sets, rows, 10) first."""
    windows = work.windows.take(rows)
    alone = replace(work.predictor, threads=1)
    later = alone.residuals(values, windows, every=windows.comparison_interval, starts=starts)
    return np.concatenate([(starts - windows.initial)[:, :, None], later], axis=2)


def _squares(
    work: Work, piece: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]
) -> NDArray[np.float64]:
    """Return squares (sets, rows, 2, 10) of each window's start, and of the rest summed."""
    squares = _residuals(work, *piece) ** 2
    return np.stack([squares[:, :, 0], squares[:, :, 1:].sum(axis=2)], axis=2)


def _squares_of_windows(
    problem: Problem, points: NDArray[np.float64], starts: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return squares (sets, w, 2, 10), of starts and of the rest."""
    work = Work(predictor=problem.predictor, windows=problem.windows)
    values = problem.coordinates.physical(points)
    parts = problem.executor(_squares, work, [(values, starts[:, rows], rows) for rows in work.rows])
    return np.concatenate(parts, axis=1)


def _square_sums(
    problem: Problem, points: NDArray[np.float64], starts: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return sums of squares (sets, 10) over windows, starts and times of comparison."""
    return _squares_of_windows(problem, points, starts).sum(axis=(1, 2))
