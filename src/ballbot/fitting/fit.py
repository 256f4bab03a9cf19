"""The one fit: from an experiment to parameter values with their covariance, and what the data do not determine.

A search finds the basin, by short descents from a few starts. From there Gauss-Newton descends in the parameters and
the states of the blocks together. Each step tries one point within a trust region in Levenberg and Marquardt's form,
and compares the least costs over the states before and after. When the descent has converged, the states are searched
again in case they lie in a poorer minimum (`Experiment.renew`).

Some parameters act only through others: v_s and delta shape how s fades, and have no effect without s. If s is zero, a
fit still ends at some s of the size of chance, with v_s and delta that suit it, and their standard errors there are
meaningless (R. Davies, Hypothesis testing when a nuisance parameter is present only under the alternative, Biometrika
64 (1977) 247-254). So they count as identified only if the fit with s is better than the best one without by more than
chance explains, 2 N n_s (cost without - cost with) > lambda q, where N n_s counts the residuals, lambda corrects for
their dependence, and q is the chi-squared quantile of as many parameters as the fit with s has more.

A profile shows how far a parameter can move, all others refitted, before the fit is worse than chance explains. The
cost of n_s states over N residuals each is, up to a constant, minus the log-likelihood divided by N n_s. Residuals
within a block are not independent, so for one parameter twice the rise of the log-likelihood is a chi-squared variable
times lambda = (clustered variance) / [H^-1]_ii (L. Pace, A. Salvan and N. Sartori, Adjusting composite likelihood ratio
statistics, Statistica Sinica 21 (2011) 129-148). A limit lies where 2 N n_s (cost - least cost) = lambda t^2, t being
Student's quantile.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from threading import Lock
from typing import Generic

import numpy as np
from scipy import special
from scipy.optimize import lsq_linear

from ballbot.arrays import Bools, Floats, Ints
from ballbot.errors import InputError
from ballbot.fitting.between_logs import LogEstimates, log_estimates
from ballbot.fitting.experiment import BlockErrors, Experiment, IterateT, Residuals
from ballbot.fitting.intervals import CONFIDENCE, Interval, Uncertainty, between, truncated_reach
from ballbot.fitting.model_selection import blocks_of, gain_between
from ballbot.fitting.run import DEFAULT_RUN, Run, Threads
from ballbot.fitting.uncertainty import (
    Discrepancy,
    WindowEquations,
    covariance,
    deviations,
    discrepancy,
    leverage_corrected,
    without_influence,
)
from ballbot.progress import Progress

#: first half width of the trust region, in scaled parameters; its new size over the step after a gain below a quarter
#: of the predicted one, and after a gain above three quarters of it
_RADIUS, _NARROWER, _WIDER = 0.3, 0.3, 2.5
#: a descent ends early if this many gains as large as the last do not reach the target: gains shrink by two or more
_MORE_GAINS = 5.0
#: least curvature, as a share of the steepest direction's
_FLATTEST = 1e-12
#: after so many successive steps that gain less than `_SLOW` and predict no more, or are shorter than `_SHORT`, the
#: states are renewed; after the last renewal, `_LITTLE` takes the place of `_SLOW` and the descent ends
_PATIENCE, _SLOW, _LITTLE, _SHORT = 2, 1e-4, 5e-7, 1e-3
#: renewals at most; one that gains less than `_WORTH` is the last; least half width of the trust region after one. One
#: better initial state of a block can lead out of a flat valley
MOST_RENEWALS, _WORTH, _AGAIN = 8, 1e-6, 0.02


@dataclass(frozen=True, kw_only=True, eq=False)
class Descended(Generic[IterateT]):
    """Result of a descent, from which another one can continue."""

    experiment: Experiment[IterateT]
    end: IterateT
    history: tuple[float, ...]  #: the cost after each step

    @property
    def point(self) -> Floats:
        """The parameters (p,), scaled."""
        return self.end.point

    @property
    def cost(self) -> float:
        """The cost there."""
        return self.end.cost

    @cached_property
    def equations(self) -> WindowEquations:
        """The equations of the parameters, block by block."""
        return self.experiment.equations(self.end)

    @cached_property
    def errors(self) -> Floats:
        """Clustered standard errors (p,) of the free parameters, scaled; NaN without influence, or if all are lost."""
        normal, free = self.equations, self.experiment.coordinates.free
        varied = free & (normal.matrix.diagonal() > 0.0) & np.isfinite(normal.matrix).all()
        return deviations(covariance(normal, varied))


def descend(
    experiment: Experiment[IterateT],
    begin: Floats | IterateT,
    *,
    free: Bools,
    most_steps: int,
    most_renewals: int = MOST_RENEWALS,
    moved: Floats | None = None,
    target: float = np.inf,
    run: Run = DEFAULT_RUN,
) -> Descended[IterateT]:
    """Descend in the parameters and the states of the blocks together.

    It begins at a scaled point (p,), from which the states start as measured, or at the end of another descent, and
    varies the parameters `free` (p,). `moved` (p,) changes others in the first step, whatever it costs. The descent
    ends early if a few more gains as large as the last do not reach the cost `target`. The stage "gauss_newton" is
    reported.
    """
    at = experiment.begin(begin) if isinstance(begin, np.ndarray) else begin
    fixed = np.zeros(len(at.point)) if moved is None else moved
    radius, history = _RADIUS, list[float]()
    scale = 2.0 * experiment.residual_count
    short_steps = renewals = 0
    for number in range(1, most_steps + 1):
        about = experiment.linearize(at)
        normal = about.equations
        H, g = normal.matrix, normal.scores.sum(axis=0)
        step = _step(H, g, at.point, free=free, fixed=fixed, radius=radius)
        promised = -float(2.0 * g @ step + step @ H @ step) / scale
        after = experiment.advance(at, about, step)
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
            renewed = experiment.renew(at, seed=renewals)
            renewals = renewals + 1 if renewed.cost < at.cost - _WORTH else most_renewals
            at = min(renewed, at, key=lambda iterate: iterate.cost)
            radius, short_steps = max(radius, _AGAIN), 0
        history.append(at.cost)
        run.progress(Progress(stage="gauss_newton", done=number, total=most_steps, cost=at.cost))
        if short_steps == _PATIENCE or hopeless:
            break
    return Descended(experiment=experiment, end=at, history=tuple(history))


def _step(H: Floats, g: Floats, point: Floats, *, free: Bools, fixed: Floats, radius: float) -> Floats:
    """Return the step (p,): `fixed`, and the best step of the free parameters within bounds and trust region."""
    step, columns = fixed.copy(), np.flatnonzero(free & (H.diagonal() > 0.0))
    if len(columns):
        scale = 1.0 / np.sqrt(H.diagonal()[columns])
        values, vectors = np.linalg.eigh(H[np.ix_(columns, columns)] * np.outer(scale, scale))
        roots = np.sqrt(np.maximum(values, _FLATTEST * values[-1]))
        right = -(vectors.T @ (scale * (g + H @ fixed)[columns])) / roots
        inside = point[columns]
        lower, upper = np.maximum(-radius, -inside), np.minimum(radius, 1.0 - inside)
        # bvls needs lower < upper
        upper = np.maximum(upper, lower + 1e-15)
        solution = lsq_linear(roots[:, None] * vectors.T / scale, right, bounds=(lower, upper), method="bvls")
        step[columns] = solution.x
    return np.clip(point + step, 0.0, 1.0) - point


#: ends of descents that differ by more standard errors in some parameter are two optima; those of a search, which have
#: not converged, are in two basins
_ELSEWHERE, _ANOTHER_BASIN = 2.0, 3.0
_AT_BOUND = 1e-9


def elsewhere(best: Descended[IterateT], other: Descended[IterateT], *, errors: float = _ELSEWHERE) -> bool:
    """Return whether two ends differ by more than so many standard errors of the best one in some parameter."""
    return bool((np.abs(best.point - other.point) > errors * best.errors).any())


def at_bound(point: Floats) -> Bools:
    """Return which scaled parameters (p,) are at a bound."""
    return (point <= _AT_BOUND) | (point >= 1.0 - _AT_BOUND)


# --- search ---

#: steps from each start. With fewer from starts that look worse, one log in six (a figure of eight) lost the lower
#: optimum, which is reached late and may be the higher one on some of the blocks
_SEARCH_STEPS = 9


@dataclass(frozen=True, kw_only=True, eq=False)
class FitOptions:
    """Options of a fit; InputError if a count is too small."""

    most_steps: int = 30  #: of each descent by Gauss-Newton
    most_profiles: int = 2  #: wide intervals that are profiled, at most; each costs a dozen linearisations

    def __post_init__(self) -> None:
        for name, least in (("most_steps", 1), ("most_profiles", 0)):
            if getattr(self, name) < least:
                raise InputError(f"{name} is {getattr(self, name)!r}; it must be {least} or more.")


DEFAULT_OPTIONS = FitOptions()


def search(
    experiment: Experiment[IterateT], starts: Floats, *, most_steps: int, run: Run
) -> tuple[Floats, Floats | None]:
    """Find the basin in the parameters that are free, from scaled starts (p,) or (s, p); one start is the result.

    From several it descends side by side, and returns the best end and that in another basin; the stage is "search".
    """
    if starts.ndim == 1:
        return starts, None
    steps = min(_SEARCH_STEPS, most_steps)
    total, done, least = len(starts) * steps, 0, np.inf
    reporting = Lock()

    def report(step: Progress) -> None:
        nonlocal done, least
        with reporting:
            done, least = done + 1, min(least, step.cost)
            run.progress(Progress(stage="search", done=min(done, total), total=total, cost=least))

    def descent(experiment: Experiment[IterateT], begin: Floats) -> Descended[IterateT]:
        reported = replace(run, progress=report)
        return descend(experiment, begin, free=experiment.coordinates.free, most_steps=steps, run=reported)

    threads = Threads(count=run.executor.count)  # processes work on the pieces of each descent
    best, *ends = sorted(threads(descent, experiment, list(starts)), key=lambda end: end.cost)
    others = (end.point for end in ends if elsewhere(best, end, errors=_ANOTHER_BASIN))
    return best.point, next(others, None)


# --- the fit ---

#: largest rise of the cost when a parameter without influence returns to its nominal value
LARGEST_LOSS = 1e-3
#: a second optimum that costs more than the first by this, 30 in 2 ln(likelihood) of a log of 48 s, is no alternative
_NEAR = 1e-3
#: steps on all blocks after which two descents are compared; the search's have gone before
_COMPARED_STEPS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherOptimum:
    """Another optimum of the same fit."""

    values: Floats  #: (p,), SI units
    rise: float  #: of the cost over that of the estimate, before the states were renewed


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit(Generic[IterateT]):
    """A fitted experiment, and the parameters that its data determine."""

    finished: Descended[IterateT]
    no_influence: Bools  #: (p,), free parameters that the residuals do not depend on
    refused: Bools  #: (p,), other parameters that the data do not excite
    other: OtherOptimum | None  #: another optimum, if there is one near
    groups: Ints  #: (w,), of blocks that should agree, from 0
    most_profiles: int  #: see `FitOptions`
    run: Run  #: its seed is that of `discrepancy`
    moved: Floats | None = None  #: (p,), SI units, by the standard deviation of a held one (`released`)

    @property
    def values(self) -> Floats:
        """The parameters (p,), SI units."""
        return self.finished.experiment.coordinates.physical(self.finished.point)

    @property
    def unknown(self) -> Bools:
        """Which parameters (p,) get no value."""
        return self.no_influence | self.refused

    @property
    def at_bound(self) -> Bools:
        """Which other parameters (p,) are at a bound."""
        free = self.finished.experiment.coordinates.free
        return free & ~self.unknown & at_bound(self.finished.point)

    @property
    def estimated(self) -> Bools:
        """Which parameters (p,) have a standard error."""
        free = self.finished.experiment.coordinates.free
        return free & ~self.unknown & ~at_bound(self.finished.point)

    @cached_property
    def scaled_covariance(self) -> Floats:
        """Covariance (p, p) clustered by block, as a jackknife over blocks gives it; NaN without a standard error."""
        blocks = self.finished.equations
        kept = self.estimated & (blocks.matrix.diagonal() > 0.0)
        return covariance(leverage_corrected(blocks, kept), kept)

    @cached_property
    def discrepancy(self) -> Discrepancy:
        """Whether groups of blocks agree on the parameters."""
        return discrepancy(self.finished.equations, self.groups, self.estimated, seed=self.run.seed)

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """Errors and 95 % intervals, widened where groups of blocks disagree; the stage "intervals" is reported."""
        finished, widen = self.finished, self.discrepancy.factor
        coordinates, scaled = finished.experiment.coordinates, widen**2 * self.scaled_covariance
        half = self.quantile * deviations(scaled)
        ends = np.stack([finished.point - half, finished.point + half], axis=1)
        intervals = {
            coordinates.labels[index]: between(coordinates, index, *ends[index].tolist(), method="clustered")
            for index in np.flatnonzero(np.isfinite(half)).tolist()
        }
        widest = np.argsort(-half, kind="stable")
        chosen = widest[half[widest] > _WIDEST][: self.most_profiles].tolist()
        within = np.flatnonzero(self.estimated)
        for done, index in enumerate(chosen, start=1):
            inverse = np.linalg.pinv(finished.equations.matrix[np.ix_(within, within)], hermitian=True)
            rise = float(half[index] ** 2 / inverse.diagonal()[within == index][0])
            free = self.estimated | self.at_bound
            limits = profile(finished, index, free=free, error=float(half[index]), rise=rise)
            intervals[coordinates.labels[index]] = between(coordinates, index, *limits, method="profile")
            self.run.progress(Progress(stage="intervals", done=done, total=len(chosen)))
        return Uncertainty(
            coordinates=coordinates,
            point=finished.point,
            covariance=scaled,
            intervals=intervals | _intervals_at_bounds(self, widen),
        )

    @cached_property
    def by_log(self) -> LogEstimates:
        """The estimate from each log by itself."""
        normal, block_log = self.finished.equations, self.finished.experiment.block_log
        return log_estimates(self.uncertainty, normal, block_log, widen=self.discrepancy.factor)

    @property
    def covariance(self) -> Floats:
        """`scaled_covariance` in SI units (p, p), with what a held parameter may change."""
        slopes = self.finished.experiment.coordinates.slopes(self.finished.point)
        own = self.scaled_covariance * np.outer(slopes, slopes)
        more = np.zeros(own.shape) if self.moved is None else np.outer(self.moved, self.moved)
        return np.where(more != 0.0, np.nan_to_num(own) + more, own)

    @property
    def errors(self) -> Floats:
        """Standard errors (p,), SI units; NaN for a parameter without one."""
        return np.sqrt(self.covariance.diagonal())

    @property
    def quantile(self) -> float:
        """Student's t for 95 %, its degrees of freedom the blocks less the estimated parameters."""
        return _quantile(len(self.finished.equations.scores), int(self.estimated.sum()))


def fit(
    experiment: Experiment[IterateT],
    starts: Floats,
    *,
    also: Floats | None = None,
    earlier: Floats | None = None,
    options: FitOptions = DEFAULT_OPTIONS,
    search_blocks: Ints | None = None,
    refused: Bools | None = None,
    groups: Ints | None = None,
    run: Run = DEFAULT_RUN,
) -> Fit[IterateT]:
    """Search, fit by Gauss-Newton, hold the parameters without influence, and fit the others again.

    Parameters
    ----------
    experiment : Experiment
    starts : ndarray (p,) or (s, p)
        Scaled. With several, a search finds the basin; with one, Gauss-Newton starts there.
    also : ndarray (p,), optional
        A second point to descend from, perhaps to another optimum; by default the search's end in another basin.
    earlier : ndarray (p,), optional
        A scaled point from which Gauss-Newton starts if it predicts better than the end of the search.
    options : FitOptions, optional
    search_blocks : ndarray, optional
        The blocks that the search uses; all by default.
    refused : ndarray (p,), optional
        Parameters that the data do not excite: they are fitted, but get no value.
    groups : ndarray (w,), optional
        The group of each block, from 0; groups should agree on the parameters.
    run : Run, optional
    """
    part = experiment if search_blocks is None else experiment.part(search_blocks)
    most_steps = options.most_steps
    start, other_basin = search(part, starts, most_steps=most_steps, run=run)
    also = other_basin if also is None else also
    if earlier is not None:
        points = np.stack([start, earlier])
        start = points[experiment.costs(points).argmin()]
    coordinates = experiment.coordinates
    free = coordinates.free
    finished, other = _optima(experiment, start, also, most_steps=most_steps, run=run)
    dependent, through = unidentifiable(finished, most_steps=most_steps, run=run)
    no_influence = free & (dependent | without_influence(finished.equations))
    if no_influence.any():
        own = coordinates.scaled(coordinates.nominal)
        # nominal values without influence, if they predict as well: any friction above some size holds a wheel that
        # never turns, and no friction does not
        before = np.where(no_influence & ~dependent, own, finished.point)
        costs = experiment.costs(np.stack([finished.point, before]))
        again = before if costs[1] < costs[0] + LARGEST_LOSS else finished.point
        again = np.where(through, 0.0, np.where(dependent, own, again))
        begin = experiment.begin(again, finished.end)
        finished = descend(experiment, begin, free=free & ~no_influence, most_steps=most_steps, run=run)
    return Fit(
        finished=finished,
        no_influence=no_influence,
        refused=~no_influence & (False if refused is None else refused),
        other=other,
        groups=np.zeros(len(experiment.block_log), dtype=np.int64) if groups is None else groups,
        most_profiles=options.most_profiles,
        run=run,
    )


def _optima(
    experiment: Experiment[IterateT], start: Floats, also: Floats | None, *, most_steps: int, run: Run
) -> tuple[Descended[IterateT], OtherOptimum | None]:
    """Return the end of the descent from the better of two points (p,), before renewal, and the other optimum."""
    free = experiment.coordinates.free
    if also is None:
        return descend(experiment, start, free=free, most_steps=most_steps, run=run), None
    steps, ends, target = min(_COMPARED_STEPS, most_steps), list[Descended[IterateT]](), np.inf
    for point in (start, also):
        end = descend(experiment, point, free=free, most_steps=steps, most_renewals=0, target=target, run=run)
        ends, target = [*ends, end], end.cost + _NEAR
    low, high = sorted(ends, key=lambda end: end.cost)
    after = descend(experiment, low.end, free=free, most_steps=most_steps, run=run)
    rise, finished = high.cost - low.cost, replace(after, history=(*low.history, *after.history))
    if rise > _NEAR or not elsewhere(finished, high):
        return finished, None
    return finished, OtherOptimum(values=experiment.coordinates.physical(high.point), rise=rise)


#: confidence that an effect is not zero; a meaningless value is worse than none
_EFFECT_CONFIDENCE = 0.999
#: the fit without the effect is not made if the covariance alone puts it this many times past the limit
_CLEARLY_PRESENT = 4.0


def unidentifiable(
    fit: Descended[IterateT], *, most_steps: int, run: Run = DEFAULT_RUN
) -> tuple[Bools, Bools]:
    """Return which free parameters (p,) act only through others that are zero within chance, and these others (p,)."""
    coordinates, names = fit.experiment.coordinates, np.array(fit.experiment.coordinates.names)
    dependent, through = (np.zeros(len(names), dtype=bool) for _ in range(2))
    for dependence in fit.experiment.dependences:
        free = coordinates.free & (fit.equations.matrix.diagonal() > 0.0)
        mine, theirs = np.isin(names, dependence.dependent) & free, (names == dependence.through) & free
        if mine.any() and theirs.any() and not _has_effect(fit, theirs, mine, most_steps, run):
            dependent, through = dependent | mine, through | theirs
    return dependent, through


def _has_effect(
    fit: Descended[IterateT], through: Bools, dependent: Bools, most_steps: int, run: Run
) -> bool:
    """Return whether the fit with parameters `through` is better than without by more than chance explains."""
    amounts, normal, free = fit.point * through, fit.equations, fit.experiment.coordinates.free
    if not amounts.any():
        return False
    varies = through | (free & (normal.matrix.diagonal() > 0.0) & (fit.point > 0.0))
    spread = covariance(normal, varies)[np.ix_(through, through)]
    limit = float(special.chdtri(int(through.sum() + dependent.sum()), 1.0 - _EFFECT_CONFIDENCE))
    own = amounts[through]
    if own @ np.linalg.lstsq(spread, own, rcond=1e-13)[0] > _CLEARLY_PRESENT * limit:
        return True
    # lambda: the clustered covariance over that of independent residuals, on average over the parameters
    inverse = np.linalg.pinv(normal.matrix[np.ix_(varies, varies)], hermitian=True)
    independent = inverse[np.ix_(through[varies], through[varies])]
    dependence = float(np.trace(np.linalg.lstsq(independent, spread, rcond=1e-13)[0])) / len(spread)
    target = fit.cost + limit * dependence / (2.0 * fit.experiment.residual_count)
    without = descend(
        fit.experiment,
        fit.end,
        free=free & ~through & ~dependent,
        most_steps=most_steps,
        moved=-amounts,
        target=target,
        run=run,
    )
    return without.cost > target


# --- held-out blocks ---

#: number of folds, and steps of a fit without one of them, from the fit to all
_FOLDS, _HELD_OUT_STEPS = 3, 8


def held_out_squares(fitted: Fit[BlockErrors]) -> Floats:
    """Return the mean square error (w,) of each block by a fit that did not see it, nor its neighbours in time.

    The fit is repeated without each of `_FOLDS` parts of the blocks.
    """
    experiment, end, count = fitted.finished.experiment, fitted.finished.end, len(fitted.finished.end.states)
    assert isinstance(experiment, Residuals)
    squares = np.empty(count)
    for fold in range(_FOLDS):
        out = np.sort(np.concatenate(blocks_of(count)[fold::_FOLDS]))
        kept = np.setdiff1d(np.arange(count), out)
        (part, near), (rest, there) = (
            (experiment.part(rows), replace(end, states=end.states[rows])) for rows in (kept, out)
        )
        again = descend(
            part,
            part.begin(end.point, near),
            free=experiment.coordinates.free,
            most_steps=_HELD_OUT_STEPS,
            most_renewals=0,
        )
        errors = rest.begin(again.point, there).errors
        squares[out] = np.nan_to_num(np.bincount(rest.block, errors**2) / np.bincount(rest.block), nan=np.inf)
    return squares


def released(held: Fit[BlockErrors], wider: Residuals, name: str, *, deviation: float) -> Fit[BlockErrors]:
    """Return the fit of `wider`, in which a quantity of one number that `held` holds is free.

    If held-out blocks do not support it, or its standard error is not below the `deviation` that it has anyway [SI],
    return `held` with errors that include this deviation. The others move with it by -H^-1 H_name (S. F. Schmidt,
    Application of state-space methods to navigation problems, Advances in Control Systems 3 (1966) 293-340).
    """
    space, kept = wider.coordinates, held.estimated
    index, point = space.names.index(name), space.scaled(held.values)
    free, blocks = fit(wider, point), blocks_of(len(wider.block_log))
    squares, others = (held_out_squares(own)[:, None] for own in (free, held))
    if free.errors[index] < deviation and gain_between(squares, others, blocks).significant:
        return free
    H = wider.equations(wider.begin(point, held.finished.end)).matrix
    moved = (np.arange(len(point)) == index).astype(float)
    moved[kept] = np.linalg.solve(H[np.ix_(kept, kept)], -H[kept, index])
    moved *= space.slopes(point)
    return replace(held, moved=deviation * moved / moved[index])


# --- intervals ---


def _quantile(blocks: int, parameters: int) -> float:
    return float(special.stdtrit(max(blocks - parameters, 1), 0.5 + 0.5 * CONFIDENCE))


#: an interval is profiled if its half width is more than this share of the bounds' width, over which no model is linear
_WIDEST = 0.25
#: fits of the other parameters on each side at most, and steps of each fit
_MOST_FITS, _STEPS = 4, 3
#: a limit is accepted if the rise differs from lambda t^2 by this share of it: lambda is not known better
_AT_LIMIT = 0.2


def profile(
    fit: Descended[IterateT], index: int, *, free: Bools, error: float, rise: float
) -> tuple[float | None, float | None]:
    """Return the 95 % limits of one parameter, scaled; None on a side where the data set none before the bound.

    `free` (p,) are the parameters that the fit varied, `error` is the expected half width of the interval for the first
    step, scaled, and `rise` is lambda t^2 of the module's text.
    """
    others = free & (np.arange(len(free)) != index)
    # each fit starts from the farthest one below the limit: windows that have begun to stick do not recover
    nearest = [fit, fit]

    def fitted(target: float, side: int) -> float:
        """Return the square root of the rise with the parameter at `target`."""
        moved = np.zeros(len(free))
        moved[index] = target - nearest[side].point[index]
        at = descend(fit.experiment, nearest[side].end, free=others, most_steps=_STEPS, moved=moved)
        root = float(np.sqrt(max(2.0 * fit.experiment.residual_count * (at.cost - fit.cost), 0.0)))
        if root**2 < rise:
            nearest[side] = at
        return root

    origin = float(fit.point[index])
    lower, upper = (
        _limit(lambda target, side=side: fitted(target, side), origin, step=sign * error, rise=rise)
        for side, sign in ((0, -1.0), (1, 1.0))
    )
    return lower, upper


def _limit(root_of: Callable[[float], float], origin: float, *, step: float, rise: float) -> float | None:
    """Return where the square root of the rise, nearly linear in the distance, reaches that of `rise`."""
    wanted = np.sqrt(rise)
    # (position, root of the rise): the farthest one below the limit, and the nearest one above it
    inside, outside = (origin, 0.0), None
    target = origin + step
    for _ in range(_MOST_FITS):
        target = float(np.clip(target, 0.0, 1.0))
        root = root_of(target)
        if root**2 < rise:
            inside = (target, root)
            if target in (0.0, 1.0):
                return None
        else:
            outside = (target, root)
        if abs(root**2 / rise - 1.0) < _AT_LIMIT:
            return target
        if outside is not None:
            share = (wanted - inside[1]) / (outside[1] - inside[1])
            target = inside[0] + share * (outside[0] - inside[0])
        else:
            longer = 2.0 if inside[1] <= 0.5 * wanted else wanted / inside[1] * 1.05
            target = origin + longer * ((inside[0] - origin) or step)
    return target if outside else None


def _intervals_at_bounds(fit: Fit[IterateT], widen: float) -> dict[str, Interval]:
    """Return the intervals of parameters at a bound, about the solution of the equations without that bound."""
    intervals = {}
    coordinates, normal = fit.finished.experiment.coordinates, fit.finished.equations
    for i in np.flatnonzero(fit.at_bound & (normal.matrix.diagonal() > 0.0)).tolist():
        wanted = fit.estimated | (np.arange(len(fit.estimated)) == i)
        columns = np.flatnonzero(wanted)
        matrix, score = normal.matrix[np.ix_(columns, columns)], normal.scores[:, columns].sum(axis=0)
        step = -np.linalg.lstsq(matrix, score, rcond=1e-13)[0][columns == i][0]
        error = widen * float(np.sqrt(covariance(normal, wanted)[i, i]))
        half = _quantile(len(normal.scores), len(columns)) * error
        at = float(fit.finished.point[i])
        middle = float(at + step)
        reach = error * truncated_reach(abs(middle - at) / error if error > 0.0 else 0.0)
        down, up = (0.0, reach) if at <= 0.5 else (reach, 0.0)
        lower, upper = min(middle - half, at - down), max(middle + half, at + up)
        intervals[coordinates.labels[i]] = between(coordinates, i, lower, upper, method="at bound")
    return intervals
