"""The balancing experiment: the model predicts windows of logs, each from an initial state that is estimated too.

A prediction from a measured initial state carries the noise of that one sample, amplified by an unstable plant, through
all residuals of the window, which biases the parameters as errors in regressors do. So the initial state x_w of each
window w (its start) is an unknown. A residual with the weight of the other samples ties it to the measured state, and
it is eliminated (`ballbot.fitting.experiment`; the idea is that of multiple shooting: H. G. Bock, Recent advances in
parameter identification techniques for O.D.E., 1983). Derivatives in a descent are narrow finite differences.

Kinks. A prediction is smooth except where the sign of a wheel's or the ball's speed changes or a contact comes to rest.
There it is continuous, and its derivatives jump. About ten of a hundred windows have their best start on such a kink,
and steps that use the slopes of one side stop short of it. From slopes Z = [J S] on one side and Z' on the other, with
a shift between them,

    Z' - Z = u n^T,     the kink:  n^T (dp, dx) = kappa,     u kappa = u n^T shift - (r' - r - Z shift).

A start that is best on a kink stays there: n becomes a tie, one more residual of large weight, with which the equations
of p and x_w are exact.

Other minima. A few windows in a hundred have several minima over their start, which differ by when which contact rests.
After the descent, windows therefore start again from random initial states. If a prediction changes linearly from the
old to the new initial state, both are in one basin, and the new one is skipped.

What both gain, on logs of the twin, of the model and of drawn robots: without renewals an estimate moves by 2 standard
errors and more in two of three logs of the twin, and the cost rises by up to 3e-3. With damped steps in place of ties,
four ways, three of 8 logs end in another optimum, up to 2e-2 higher, depending on the damping.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from ballbot.arrays import Bools, Floats, Ints
from ballbot.fitting.experiment import Dependence, Linearized
from ballbot.fitting.run import Executor, Threads
from ballbot.fitting.uncertainty import WindowEquations
from ballbot.identification.prediction import Predictor
from ballbot.identification.quantities import Coordinates
from ballbot.identification.windows import Windows
from ballbot.log import STATE_NAMES

T = TypeVar("T")
_STATES = len(STATE_NAMES)
#: x and y of a start shift the whole prediction, so these columns of S need no simulation
_ON_FLOOR = 2
#: finite differences of scaled parameters, and of starts in standard deviations of their residuals: one-sided ones of a
#: descent, which agree with ten times wider ones to 1e-5, and half of the central ones for standard errors, which
#: average over single steps of sticking
_NARROW, _WIDE = (1e-6, 1e-4), (2e-3, 0.5)
#: value of a residual without a value
_LOST = 1e150
#: windows in a piece of work
_PIECE = 64


@dataclass(kw_only=True, eq=False)
class Starts:
    """Starts of n windows with their residuals and slopes; changed in place while they settle."""

    rows: Ints  #: (n,), the windows
    starts: Floats  #: (n, 10)
    residuals: Floats  #: (n, 1 + k, 10), from the starts
    slopes: Floats  #: (n, m + 10, 1 + k, 10), by m free parameters and the start
    slopes_at: Floats  #: (n, 10), the starts at which the slopes are computed
    slopes_from: Floats  #: (n, 1 + k, 10), the residuals there
    known: Bools  #: (n,), whether the slopes by parameters are computed yet
    ties: Floats  #: (n, m + 10, m + 10), of starts on kinks

    def put(self, rows: Ints, given: Starts, which: Bools) -> None:
        """Change the windows of these rows to some of those given."""
        for name in ("starts", "residuals", "slopes", "slopes_at", "slopes_from", "known", "ties"):
            getattr(self, name)[rows] = getattr(given, name)[which]

    @staticmethod
    def joined(pieces: Sequence[Starts]) -> Starts:
        """Return the starts of all pieces."""
        names = vars(pieces[0])
        return Starts(**{name: np.concatenate([vars(piece)[name] for piece in pieces]) for name in names})


@dataclass(frozen=True, kw_only=True, eq=False)
class WindowsIterate:
    """A point of a descent."""

    point: Floats  #: (p,), scaled
    windows: Starts  #: settled there
    weights: Floats  #: (1 + k, 10), of the residuals of every window
    cost: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Work:
    """Input that all pieces of work share."""

    predictor: Predictor  #: with one thread
    windows: Windows

    def residuals(self, values: Floats, starts: Floats, rows: Ints) -> Floats:
        """Return residuals (sets, rows, 1 + k, 10) in SI units, those of the starts (sets, rows, 10) first."""
        windows, every = self.windows.take(rows), self.windows.comparison_interval
        later = self.predictor.residuals(values, windows, every=every, starts=starts)
        return np.concatenate([(starts - windows.initial)[:, :, None], later], axis=2)


def _called(work: Work, piece: tuple[Callable[..., T], *tuple[object, ...]]) -> T:
    function, *arguments = piece
    return function(work, *arguments)


def _squares(work: Work, values: Floats, starts: Floats, rows: Ints) -> Floats:
    """Return each window's squares (sets, rows, 10)."""
    return (work.residuals(values, starts, rows) ** 2).sum(axis=2)


@dataclass(frozen=True, kw_only=True, eq=False)
class Balancing:
    """The experiment: windows, and parameters to fit.

    The cost is the mean over states of ln(error / error without friction), errors being root mean squares over windows
    and time. Its gradient is that of least squares in which the weight of each state is one over its residuals'
    variance. Below 1e-6 of the error without friction it is level.
    """

    predictor: Predictor
    windows: Windows
    coordinates: Coordinates
    #: which states (10,) count in the cost
    counted: Bools = field(default_factory=lambda: np.ones(_STATES, dtype=bool))
    #: sums of squares (10,) that the cost is relative to; by default those without friction
    reference: Floats | None = None
    executor: Executor = field(default_factory=Threads)  #: where the work is done

    #: v_s and delta have no effect without s
    dependences = (Dependence(through="stribeck", dependent=("stribeck_speed", "stribeck_exponent")),)

    @cached_property
    def _relative_to(self) -> tuple[Floats, Floats]:
        """The sums of squares (10,) that the cost is relative to, and its floor."""
        reference = self.reference
        if reference is None:
            before = np.clip(self.coordinates.nominal, self.coordinates.lower, self.coordinates.upper)
            none = self.predictor.layout.without_friction(before)[None]
            reference = np.zeros(_STATES)
            for chunk in self.predictor.in_chunks(none, self.windows, every=self.windows.comparison_interval):
                reference += (chunk**2).sum(axis=(1, 2))[0]
        return reference, 1e-12 * reference + np.finfo(float).tiny

    def _cost(self, square_sums: Floats) -> Floats:
        """Return the cost (sets,) of sums of squares (sets, 10), infinite if a prediction has no value."""
        reference, floor = self._relative_to
        ratios = (square_sums + floor) / (reference + floor)
        cost = 0.5 * np.log(ratios[..., self.counted]).mean(axis=-1)
        return np.where(np.isfinite(cost), cost, np.inf)

    @property
    def block_log(self) -> Ints:
        """Which log each window is of (w,)."""
        return np.array([span.log for span in self.windows.spans], dtype=np.int64)

    @property
    def compared(self) -> int:
        """How many residuals each state has, including those of the starts."""
        return len(self.windows) * (1 + self.windows.samples // self.windows.comparison_interval)

    @property
    def residual_count(self) -> int:
        """How many residuals the cost counts."""
        return self.compared * int(self.counted.sum())

    def part(self, blocks: Ints) -> Balancing:
        """Return the experiment of some of the windows."""
        return replace(self, windows=self.windows.take(blocks))

    def costs(self, points: Floats, starts: Floats | None = None) -> Floats:
        """Return the costs (sets,) of points (sets, p) with starts (sets, w, 10), by default the measured ones."""
        values = self.coordinates.physical(points)
        if starts is None:
            starts = np.broadcast_to(self.windows.initial, (len(values), *self.windows.initial.shape))
        squares = self._each(_squares, lambda k: (values, starts[:, k], k))
        return self._cost(np.concatenate(squares, axis=1).sum(axis=1))

    def begin(self, point: Floats, near: WindowsIterate | None = None) -> WindowsIterate:
        """Return the first iterate of a descent, its starts settled near the measured ones or those of `near`."""
        starts = self.windows.initial if near is None else near.windows.starts
        weights, _ = self._weighed(self._residuals(point, starts))
        return self._settled(point, weights, starts[None])

    def linearize(self, at: WindowsIterate) -> Linearized:
        """Return the equations about an iterate."""
        known, m = at.windows, int(self.coordinates.free.sum())
        if not known.known.all():
            about = _differences(self.coordinates, at.point, at.weights, _NARROW)
            rows = [lacking for k in self._rows if len(lacking := k[~known.known[k]])]
            derivatives = self._each(
                _differences_of,
                lambda k: (about, known.slopes_at[k], k, slice(m), known.slopes_from[k]),
                rows,
            )
            known.slopes[np.concatenate(rows), :m] = np.concatenate(derivatives)
            known.known[:] = True
        return self._linearized(known.slopes, known.residuals, at.weights, known.ties)

    def linearize_widely(
        self, point: Floats, starts: Floats, *, others: Sequence[tuple[Balancing, Balancing, float]] = ()
    ) -> Linearized:
        """Return the equations about a point (p,) and starts (w, 10), by wide central differences.

        Each of `others`, two experiments ahead and behind and the distance between them, is one more parameter.
        """
        residuals = self._residuals(point, starts)
        weights, _ = self._weighed(residuals)
        about = _differences(self.coordinates, point, weights, _WIDE, central=True)
        derivatives = self._each(_differences_of, lambda k: (about, starts[k], k, slice(None)))
        by_own = _with_floor(about, np.concatenate(derivatives))
        by_others = [
            np.nan_to_num((ahead._residuals(point, starts) - behind._residuals(point, starts)) / distance)
            for ahead, behind, distance in others
        ]
        slopes = [by_own[:, :-_STATES], *(slope[:, None] for slope in by_others), by_own[:, -_STATES:]]
        return self._linearized(np.concatenate(slopes, axis=1), residuals, weights, 0.0)

    def equations(self, at: WindowsIterate) -> WindowEquations:
        """Return each window's equations with the start eliminated, by wide central differences."""
        return self.linearize_widely(at.point, at.windows.starts).equations

    def advance(self, at: WindowsIterate, about: Linearized, step: Floats) -> WindowsIterate:
        """Return the iterate after a step (p,), with the starts settled there."""
        starts = at.windows.starts
        ahead = starts + about.response @ step
        return self._settled(at.point + step, at.weights, np.stack([starts, ahead, ahead + about.shift]))

    def renew(self, at: WindowsIterate, *, seed: int) -> WindowsIterate:
        """Return the same point with the best start of each window, also of those settled from random ones."""
        about = _differences(self.coordinates, at.point, at.weights, _NARROW, starts_alone=True)
        now, slopes = at.windows, at.windows.slopes[:, -_STATES:]
        renewed = self._each(_renewed, lambda k: (about, now.starts[k], now.residuals[k], slopes[k], seed, k))
        return self._settled(at.point, at.weights, np.concatenate(renewed)[None])

    def _each(
        self,
        function: Callable[..., T],
        arguments_of: Callable[[Ints], tuple[object, ...]],
        rows: list[Ints] | None = None,
    ) -> list[T]:
        """Return a function of `Work` and further arguments for each piece of windows, by its rows."""
        pieces = [(function, *arguments_of(k)) for k in (self._rows if rows is None else rows)]
        return self.executor(_called, self._work, pieces)

    @cached_property
    def _work(self) -> Work:
        return Work(predictor=replace(self.predictor, threads=1), windows=self.windows)

    @property
    def _rows(self) -> list[Ints]:
        """The rows of windows in each piece; fixed, as they decide the last bits of a start."""
        count = len(self.windows)
        return [np.arange(first, min(first + _PIECE, count)) for first in range(0, count, _PIECE)]

    def _residuals(self, point: Floats, starts: Floats) -> Floats:
        """Return the residuals (w, 1 + k, 10) at a point (p,) with starts (w, 10)."""
        values = self.coordinates.physical(point[None])
        return np.concatenate(self._each(Work.residuals, lambda k: (values, starts[None, k], k)), axis=1)[0]

    def _settled(self, point: Floats, weights: Floats, offered: Floats) -> WindowsIterate:
        """Return the iterate at a point (p,), settled from the best of the starts (n, w, 10)."""
        about = _differences(self.coordinates, point, weights, _NARROW)
        settled = Starts.joined(self._each(_settled, lambda k: (about, offered[:, k], k)))
        weights, cost = self._weighed(settled.residuals)
        return WindowsIterate(point=point, windows=settled, weights=weights, cost=cost)

    def _weighed(self, residuals: Floats) -> tuple[Floats, float]:
        """Return the weights (1 + k, 10) of residuals (w, 1 + k, 10), and their cost."""
        squares = (residuals**2).sum(axis=(0, 1))
        # the floor of the cost: for a state that nothing moves any weight will do
        by_state = np.sqrt(self.compared / (squares + self._relative_to[1]))
        weights = np.tile(np.where(self.counted, by_state, 0.0), (residuals.shape[1], 1))
        weights[0] = by_state  # otherwise nothing would determine the start of a state that does not count
        return weights, float(self._cost(squares))

    def _linearized(
        self, slopes: Floats, residuals: Floats, weights: Floats, ties: Floats | float
    ) -> Linearized:
        Z, r, free = _flat(slopes, weights), _flat(residuals, weights), self.coordinates.free
        count, m, others = len(slopes), slopes.shape[1] - _STATES, slopes.shape[1] - _STATES - int(free.sum())
        size, columns = len(free) + others, np.flatnonzero(np.append(free, np.ones(others, dtype=bool)))
        # so small that BLAS uses one thread, and the order of summation never changes
        G, z = Z @ Z.transpose(0, 2, 1) + ties, (Z @ r[..., None])[..., 0]
        H, B, g = np.zeros((count, size, size)), np.zeros((count, _STATES, size)), np.zeros((count, size))
        H[:, columns[:, None], columns] = G[:, :m, :m]
        B[:, :, columns], g[:, columns] = G[:, m:, :m], z[:, :m]
        return Linearized(H=H, B=B, A=G[:, m:, m:], g=g, a=z[:, m:])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Differences:
    """The points of finite differences: n ahead, then n behind, or one for all."""

    values: Floats  #: (n + n or 1, p), SI units
    shifts: Floats  #: (n + n or 1, 10), of the starts
    distance: Floats  #: (n,), from behind to ahead, scaled
    weights: Floats  #: (1 + k, 10)

    @property
    def parameters(self) -> int:
        """How many of the n points change a parameter, m; the others change a start."""
        return len(self.distance) - (_STATES - _ON_FLOOR)


def _differences(
    coordinates: Coordinates,
    point: Floats,
    weights: Floats,
    widths: tuple[float, float],
    *,
    central: bool = False,
    starts_alone: bool = False,
) -> _Differences:
    """Return the differences about a point (p,), by widths of parameters and starts, or of `starts_alone`."""
    free = coordinates.free
    columns = np.flatnonzero(np.zeros_like(free) if starts_alone else free)
    width = widths[0] * np.eye(len(point))[columns]
    ahead, behind = point + width, np.clip(point - width, 0.0, 1.0)
    if central:
        ahead = np.clip(ahead, 0.0, 1.0)
    else:
        ahead, behind = np.where((ahead > 1.0).any(axis=1, keepdims=True), behind, ahead), point[None]
    moves = np.diag(widths[1] / weights[0])[_ON_FLOOR:]
    held, still = np.tile(point, (len(moves), 1)), np.zeros((len(columns), _STATES))
    points = [ahead, held, behind, held] if central else [ahead, held, behind]
    shifts = [still, moves, still, -moves] if central else [still, moves, np.zeros((1, _STATES))]
    return _Differences(
        values=coordinates.physical(np.concatenate(points)),
        shifts=np.concatenate(shifts),
        distance=np.concatenate([(ahead - behind).sum(axis=1), (1 + central) * moves.sum(axis=1)]),
        weights=weights,
    )


def _lanes(
    work: Work, about: _Differences, starts: Floats, rows: Ints, residuals: Floats | None = None
) -> Starts:
    """Return starts (n, 10) of windows with their residuals (n, 1 + k, 10), and derivatives by the starts."""
    m, here = about.parameters, residuals
    if here is None:
        here = work.residuals(about.values[-1:], starts[None], rows)[0]
    values = np.zeros((len(rows), m, *here.shape[1:]))
    derivatives = _differences_of(work, about, starts, rows, slice(m, None), here)
    values = _with_floor(about, np.concatenate([values, derivatives], axis=1))
    return Starts(
        rows=rows,
        starts=starts.copy(),
        residuals=here,
        slopes=values,
        slopes_at=starts.copy(),
        slopes_from=here.copy(),
        known=np.zeros(len(rows), dtype=bool),
        ties=np.zeros((len(rows), m + _STATES, m + _STATES)),
    )


def _with_floor(about: _Differences, derivatives: Floats) -> Floats:
    """Return derivatives (w, n, 1 + k, 10) with those by the place on the floor, which moves all rows alike."""
    m, (count, _, *shape) = about.parameters, derivatives.shape
    of_floor = np.zeros((count, _ON_FLOOR, *shape))
    for state in range(_ON_FLOOR):
        of_floor[:, state, :, state] = 1.0
    return np.concatenate([derivatives[:, :m], of_floor, derivatives[:, m:]], axis=1)


def _differences_of(
    work: Work, about: _Differences, starts: Floats, rows: Ints, which: slice, behind: Floats | None = None
) -> Floats:
    """Return derivatives (rows, n, 1 + k, 10) by some points, with `behind` one-sided; zero without a value."""
    n = len(about.distance)
    ahead = work.residuals(about.values[:n][which], starts + about.shifts[:n][which][:, None], rows)
    if behind is None:
        behind = work.residuals(about.values[n:][which], starts + about.shifts[n:][which][:, None], rows)
    with np.errstate(invalid="ignore"):
        slopes = ((ahead - behind) / about.distance[which][:, None, None, None]).transpose(1, 0, 2, 3)
    return np.where(np.isfinite(slopes), slopes, 0.0)


def _complete(work: Work, about: _Differences, lanes: Starts, rows: Ints) -> None:
    """Compute the derivatives by parameters of lanes that lack them."""
    m, rows = about.parameters, rows[~lanes.known[rows]]
    if m and len(rows):
        at, before = lanes.slopes_at[rows], lanes.slopes_from[rows]
        lanes.slopes[rows, :m] = _differences_of(work, about, at, lanes.rows[rows], slice(m), before)
        lanes.known[rows] = True


def _flat(values: Floats, weights: Floats) -> Floats:
    """Return residuals or derivatives (..., 1 + k, 10), weighted and flattened to (..., (1 + k) 10)."""
    with np.errstate(invalid="ignore", over="ignore"):
        flat = (values * weights).reshape(*values.shape[:-2], -1)
    if flat.size and flat.max() < _LOST and flat.min() > -_LOST:  # the usual case, and cheaper
        return flat
    return np.where(np.abs(flat) < _LOST, flat, _LOST)


def _settled(work: Work, about: _Differences, offered: Floats, rows: Ints) -> Starts:
    """Return each window's start, settled from the best of those offered (n, rows, 10)."""
    starts, residuals, each = offered[0], None, np.arange(len(rows))
    if len(offered) > 1:
        predicted = work.residuals(np.tile(about.values[-1:], (len(offered), 1)), offered, rows)
        squares = (_flat(predicted, about.weights) ** 2).sum(axis=-1)
        chosen = squares.argmin(axis=0)
        starts, residuals = offered[chosen, each], predicted[chosen, each]
    lanes = _lanes(work, about, starts, rows, residuals)
    _settle(work, about, lanes)
    return lanes


#: a start has settled if a step promises less, in variances of a residual; steps at most
_SETTLED, _ROUNDS = 1e-3, 5
#: a step by one-sided slopes is accepted if it gains the first share of the predicted gain; with the second, it needs
#: no new slopes
_HOLDS, _STRAIGHT = 0.5, 0.9
#: weight of a tie, relative to that of the residuals along its normal
_TIE = 1e6


def _settle(work: Work, about: _Differences, lanes: Starts) -> None:
    """Move each lane to the least cost over its start."""
    # Each round tries the Gauss-Newton step of the start. If it gains less than predicted, there is a kink on the way:
    # the slopes at both ends locate it, and the start goes to the better of the step's end and the kink, with a tie in
    # the latter case.
    m, W, ties = about.parameters, about.weights, lanes.ties
    active = np.arange(len(lanes.rows))
    for _ in range(_ROUNDS):
        S, r = _flat(lanes.slopes[active, m:], W), _flat(lanes.residuals[active], W)
        A, a = S @ S.transpose(0, 2, 1), (S @ r[..., None])[..., 0]
        own, A = A, A + ties[active][:, m:, m:]
        shift: Floats = np.negative(np.linalg.solve(A, a[..., None])[..., 0], dtype=np.float64)
        promised = -(a * shift).sum(axis=1)
        unsettled = promised > _SETTLED
        if not unsettled.any():
            break
        active, shift, promised = active[unsettled], shift[unsettled], promised[unsettled]
        ahead = lanes.starts[active] + shift
        residuals = work.residuals(about.values[-1:], ahead[None], lanes.rows[active])[0]
        before = (r[unsettled] ** 2).sum(axis=1)
        straight = before - (_flat(residuals, W) ** 2).sum(axis=1) > _STRAIGHT * promised
        passed = active[straight]
        lanes.starts[passed], lanes.residuals[passed] = ahead[straight], residuals[straight]
        if straight.all():
            continue
        turned = np.flatnonzero(unsettled)[~straight]
        active, shift = active[~straight], shift[~straight]
        promised, before = promised[~straight], before[~straight]
        r, own, A, a = r[turned], own[turned], A[turned], a[turned]
        ahead = _lanes(work, about, lanes.starts[active] + shift, lanes.rows[active])
        _complete(work, about, lanes, active)
        _complete(work, about, ahead, np.arange(len(active)))
        Z, Z_ahead = _flat(lanes.slopes[active], W), _flat(ahead.slopes, W)
        r_ahead = _flat(ahead.residuals, W)
        normal, distance = _kink(Z, Z_ahead, r_ahead - r, shift)
        n = normal[:, m:]
        free = (n * np.linalg.solve(own, n[..., None])[..., 0]).sum(axis=1, keepdims=True)
        weight = _TIE / np.maximum(free, 1e-300)
        tied = (weight * n)[:, :, None] * n[:, None]
        onto = -np.linalg.solve(A + tied, (a - weight * distance[:, None] * n)[..., None])[..., 0]
        on_kink = lanes.starts[active] + onto
        residuals = work.residuals(about.values[-1:], on_kink[None], lanes.rows[active])[0]
        gain = before - (r_ahead**2).sum(axis=1)
        gain_on_kink = before - (_flat(residuals, W) ** 2).sum(axis=1)
        holds = (gain > _HOLDS * promised) | (gain > np.maximum(gain_on_kink, 0.0))
        passed, kept = active[holds], active[~holds]
        lanes.put(passed, ahead, holds)
        # earlier ties were at the right kinks only if the gain on this one is the expected one
        expected = -(2.0 * a * onto).sum(axis=1) - (onto * (own @ onto[..., None])[..., 0]).sum(axis=1)
        right = np.abs(gain_on_kink - expected) < 0.2 * np.abs(expected) + _SETTLED
        ties[active[~holds & ~right]] = 0.0
        ties[kept] += ((weight * normal)[:, :, None] * normal[:, None])[~holds]
        nearer = ~holds & (gain_on_kink > 0.0)
        lanes.starts[active[nearer]], lanes.residuals[active[nearer]] = on_kink[nearer], residuals[nearer]


def _kink(Z: Floats, ahead: Floats, change: Floats, shift: Floats) -> tuple[Floats, Floats]:
    """Return the kinks between two starts: normals (n, m + 10) of length 1 over the start, and distances (n,)."""
    # the jump Z' - Z is nearly of rank one, u n^T; its first singular vectors give u and n
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
    squared = np.maximum((u**2).sum(axis=1, keepdims=True), 1e-300)
    share = (unexplained * u).sum(axis=1, keepdims=True) / squared
    return normal, np.clip(along - share, 0.0, along)[:, 0]


#: random starts of each window, and their smallest and largest spread, in standard deviations of the start
_DRAWN, _SPREADS = 48, (0.5, 3.0)
#: of those in other basins so many settle: those with the least cost, which find a near basin, and those with the least
#: minimum as the slopes here predict it, which find a deep one. Of the gain of settling all on four logs, three of the
#: first kind reach 92, 1, 27 and 0 %, three of the second 52, 98, 0 and 100 %, and both kinds 89, 97, 20 and 100 %
_LEAST, _PROMISING = 3, 2
#: a start is in another basin if its cost after elimination differs by more, in variances of a residual; it is better
#: only by more than the second
_APART, _BETTER = 0.02, 0.01


def _renewed(
    work: Work,
    about: _Differences,
    starts: Floats,
    residuals: Floats,
    slopes: Floats,
    seed: int,
    rows: Ints,
) -> Floats:
    """Return the best starts (rows, 10) of the present ones and those settled from measured and random ones."""
    S, r = _flat(slopes, about.weights), _flat(residuals, about.weights)
    A = S @ S.transpose(0, 2, 1)
    spread = np.linalg.inv(np.linalg.cholesky(A)).transpose(0, 2, 1)
    drawn = np.random.default_rng([seed, int(rows[0])]).standard_normal((_DRAWN, *starts.shape, 1))
    drawn *= np.linspace(*_SPREADS, _DRAWN)[:, None, None, None]
    random = starts + (spread @ drawn)[..., 0]
    offered = np.concatenate([work.windows.initial[rows][None], random])
    predicted = work.residuals(np.tile(about.values[-1:], (len(offered), 1)), offered, rows)

    def eliminated(r: Floats) -> Floats:
        a = (S @ r[..., None])[..., 0]
        return (r**2).sum(axis=-1) - (a * np.linalg.solve(A, a[..., None])[..., 0]).sum(axis=-1)

    flat = _flat(predicted, about.weights)
    there = eliminated(flat)
    apart = np.abs(there - eliminated(r)) > _APART
    least = np.argsort(np.where(apart, (flat**2).sum(axis=-1), np.inf), axis=0, kind="stable")[:_LEAST]
    np.put_along_axis(there, least, np.inf, axis=0)
    promising = np.argsort(np.where(apart, there, np.inf), axis=0, kind="stable")[:_PROMISING]
    chosen = np.concatenate([least, promising])
    sets, windows = np.nonzero(np.take_along_axis(apart, chosen, axis=0))
    now, best = (r**2).sum(axis=1) - _BETTER, starts.copy()
    if len(windows):
        which = chosen[sets, windows]
        lanes = _lanes(work, about, offered[which, windows], rows[windows], predicted[which, windows])
        _settle(work, about, lanes)
        squares = (_flat(lanes.residuals, about.weights) ** 2).sum(axis=1)
        for window, square, start in zip(windows, squares, lanes.starts, strict=True):
            if square < now[window]:
                now[window], best[window] = square, start
    return best
