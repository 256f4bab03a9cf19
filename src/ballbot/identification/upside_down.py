"""Friction of a robot clamped upside down, the ball on its wheels (thesis 3.2).

Logs of a ball on clamped wheels, cut into windows that lie end to end.

The plant is stable, so that windows may be long. A window starts from the camera's mean over the samples about its
first row, whose noise is then a third of a single sample's.

The result of the upside-down stage.

Friction of drivelines and ball-wheel contacts from a robot upside down, the ball on its wheels (thesis 3.2).

The cost is the thesis's (3.5), the norm of modelled less measured speed, over windows. An evolution strategy finds
the basin; a trust-region method within the bounds finishes (T. F. Coleman and Y. Li, SIAM J. Optimization 6 (1996)
418-445, by SciPy); held-out windows validate it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.findings import Finding, finding_results, warning
from ballbot.fitting.least_squares import Stopping, minimize_squares
from ballbot.fitting.run import DEFAULT_RUN, Run, Threads
from ballbot.fitting.search import evolve
from ballbot.fitting.uncertainty import NormalEquations, correlation, covariance, without_influence
from ballbot.identification.agreement import StageEstimate, file_findings
from ballbot.identification.excitation import WINDOWS_PER_PARAMETER
from ballbot.identification.parameters import Bounds, BoundsLike, Coordinates, as_bounds, scale_between
from ballbot.identification.prediction import DIFFERENCE
from ballbot.identification.quantities import BY_NAME, FRICTION, OF_WHEELS
from ballbot.identification.result import ParameterTable, found_robot, without_nan
from ballbot.identification.result_findings import (
    bound_findings,
    correlation_findings,
    error_findings,
    influence_findings,
)
from ballbot.identification.stated_uncertainty import ends_without_error
from ballbot.identification.windows import COMPARISONS, LARGEST_JITTER, Span, common_sample_time, split
from ballbot.log import Log, LogsLike, as_logs
from ballbot.log.checks.values import spiked_rows
from ballbot.log.columns import torque_names
from ballbot.mechanics.friction import FrictionTerms, friction_terms
from ballbot.progress import Progress, ProgressReporter, Stage
from ballbot.robot import Friction, Robot, RobotLike, as_robot
from ballbot.simulation.upside_down import ClampedBall, simulate_balls
from ballbot.summary import Summary, estimated, first_texts, listed, plotted, summarized

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BALL_NAMES = ("ball_omega_x", "ball_omega_y", "ball_omega_z")

#: samples on either side of a window's first that its start is the mean of
NEIGHBOURS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class BallWindows:
    """w windows of m samples each."""

    initial: NDArray[np.float64]  #: (w, 3), Omega at the starts [rad/s]
    torques: NDArray[np.float64]  #: (w, m, n) [N m]
    measured: NDArray[np.float64]  #: (w, m, 3), Omega after each sample [rad/s]
    spans: tuple[Span, ...]  #: (w,)
    sample_time: float  #: [s]

    def __len__(self) -> int:
        return len(self.initial)

    @property
    def every(self) -> int:
        """Samples from one comparison of a fit to the next."""
        return max(1, self.torques.shape[1] // COMPARISONS)

    def take(self, rows: NDArray[np.int64]) -> BallWindows:
        """Return the windows of those numbers."""
        return BallWindows(
            initial=self.initial[rows],
            torques=self.torques[rows],
            measured=self.measured[rows],
            spans=tuple(self.spans[row] for row in rows),
            sample_time=self.sample_time,
        )


def cut_ball_windows(logs: Sequence[Log], *, wheel_count: int, duration: float) -> BallWindows:
    """Cut logs into windows; those with a gap or a missing value are left out.

    Parameters
    ----------
    logs : sequence of Log
        With u1 .. un and ball_omega_x, _y, _z, of one sample time.
    wheel_count : int
    duration : float
        Of a window [s].

    Raises
    ------
    InputError
        If there is no log, a column is missing, the sample times differ, or the window is no length or longer
        than every log.
    """
    sample_time = common_sample_time(logs, duration=duration)
    samples = round(duration / sample_time)
    pieces = [_cut(number, log, wheel_count, samples) for number, log in enumerate(logs)]
    spans = tuple(span for piece in pieces for span in piece[3])
    if not spans:
        raise InputError(
            f"No log has {duration:g} s without a gap or a missing value; choose a shorter window."
        )
    return BallWindows(
        initial=np.concatenate([piece[0] for piece in pieces]),
        torques=np.concatenate([piece[1] for piece in pieces]),
        measured=np.concatenate([piece[2] for piece in pieces]),
        spans=spans,
        sample_time=sample_time,
    )


def _cut(
    number: int, log: Log, wheel_count: int, samples: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], list[Span]]:
    torques = np.column_stack([log[name] for name in torque_names(wheel_count)])
    omegas = np.column_stack([log[name] for name in BALL_NAMES])
    whole = np.asarray(np.isfinite(np.hstack([torques, omegas])).all(axis=1))
    whole &= ~spiked_rows(log, (*torque_names(wheel_count), *BALL_NAMES))
    even = np.asarray(np.abs(np.diff(log.t) - log.sample_time) <= LARGEST_JITTER * log.sample_time)
    starts = [
        k
        for k in range(NEIGHBOURS, len(log.t) - samples - NEIGHBOURS, samples)
        if whole[k - NEIGHBOURS : k + samples + 1].all() and even[k - NEIGHBOURS : k + samples].all()
    ]
    rows = np.array(starts, dtype=np.int64)
    near = omegas[rows[:, None] + np.arange(-NEIGHBOURS, NEIGHBOURS + 1)]
    held = rows[:, None] + np.arange(samples)
    spans = [Span(log=number, start=float(log.t[k]), end=float(log.t[k + samples])) for k in starts]
    return near.mean(axis=1), torques[held], omegas[held + 1], spans


@summarized
@dataclass(frozen=True, kw_only=True, eq=False)
class UpsideDown:
    """Driveline and ball-wheel friction of a robot without its weight on the ball; p = 3 n + 2 parameters."""

    robot: Robot  #: with the friction found; rolling friction as it was, which has no part here
    parameters: ParameterTable  #: {b: [..], c: [..], s: [..], v_s, delta}, SI units; NaN without influence
    standard_errors: ParameterTable  #: alike, clustered by window; NaN if not estimated
    labels: tuple[str, ...]  #: (p,)
    correlation: NDArray[np.float64]  #: (p, p)
    #: root mean square error (3,) [rad/s] of Omega on the windows held out: with the friction "found", that of the
    #: "robot file" where it has any, and "none"
    held_out: Mapping[str, NDArray[np.float64]]
    fit: Mapping[str, NDArray[np.float64]]  #: alike, on the windows fitted
    fit_windows: tuple[Span, ...]
    held_out_windows: tuple[Span, ...]
    evolution_cost: tuple[float, ...]  #: after each generation [rad/s]
    window: float  #: length of a window [s]
    findings: tuple[Finding, ...]  #: of the numbers

    def summary(self) -> Summary:
        """Return each parameter with its standard error, the errors on windows held out, and warnings."""
        units = {BY_NAME[name].symbol: BY_NAME[name].unit.removeprefix("1") for name in OF_WHEELS}
        errors = self.standard_errors
        rows = [(key, estimated(one, errors[key], units[key])) for key, one in self.parameters.items()]
        held_out = {key: listed(one, "rad/s") for key, one in self.held_out.items()}
        rows += [(f"error, {key}", f"{one}, held out") for key, one in held_out.items()]
        windows = f"{len(self.fit_windows)} fitted, {len(self.held_out_windows)} held out, {self.window:g} s"
        return Summary(
            title=f"Friction of the robot {self.robot.name} upside down: value ± standard error",
            rows=(*rows, ("windows", windows)),
            sentences=first_texts(self.findings),
        )

    def plot(self) -> Figure:
        """Return a figure of each wheel's friction over its speed."""
        return plotted(self)

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds; NaN becomes None, JSON's null."""
        return {
            "parameters": without_nan(self.parameters),
            "standard_errors": without_nan(self.standard_errors),
            "correlation": {"labels": list(self.labels), "matrix": without_nan(self.correlation.tolist())},
            "rmse": {
                "columns": list(BALL_NAMES),
                "held_out": {name: error.tolist() for name, error in self.held_out.items()},
                "fit": {name: error.tolist() for name, error in self.fit.items()},
            },
            "cost": {"evolution": list(self.evolution_cost)},
            "windows": {
                "length": self.window,
                "fit": [[span.log, span.start, span.end] for span in self.fit_windows],
                "held_out": [[span.log, span.start, span.end] for span in self.held_out_windows],
            },
            "findings": finding_results(self.findings),
        }


#: longest inner step [s] of the evolution, and of the rest
EVOLUTION_STEP = 5e-3
STEP = 1e-3
#: a wheel turns in a window where its root mean square speed is above this [rad/s]
LEAST_SPEED = 0.1
#: evaluations of the trust-region method at most; each is followed by a Jacobian
POLISH_STEPS = 40
_AT_BOUND = 1e-6


def identify_upside_down(
    robot: RobotLike,
    logs: LogsLike,
    *,
    bounds: BoundsLike | None = None,
    window: float = 1.0,
    held_out: float = 0.25,
    generations: int = 120,
    population: int = 20,
    evolution_windows: int = 20,
    run: Run = DEFAULT_RUN,
) -> UpsideDown:
    """Find b, c, s of each wheel, v_s and delta from the robot clamped upside down.

    Parameters
    ----------
    robot : Robot, preset or robot file
        Its own friction is not used but to be compared with.
    logs : Log or log file, or several in a list or a mapping
        With u1 .. un and ball_omega_x, _y, _z in the robot's frame, of one sample time.
    bounds : Bounds or bounds file, optional
        Within which the parameters are estimated; those of rolling friction are not used.
    window : float
        Length of the windows predicted [s].
    held_out : float
        Share of the windows kept from the fit.
    generations, population : int
        Most generations of the evolution, and sets of parameters in each.
    evolution_windows : int
        How many of the windows to fit the evolution looks at; what follows takes all.
    run : Run, optional
        Its checkpoint answers for each generation and for the least squares. The cost of its progress is in rad/s here.
        Of its executor, the number of threads counts; the result does not depend on it.

    Raises
    ------
    InputError
        If the logs cannot give the parameters, or an option makes no sense.
    """
    if not 0.0 < held_out < 1.0:
        raise InputError(f"held_out is {held_out!r}; it must be a fraction between 0 and 1, such as 0.25.")
    robot, named = as_robot(robot), as_logs(logs)
    coordinates = _coordinates(robot, as_bounds(bounds))
    windows = cut_ball_windows(list(named.values()), wheel_count=robot.wheel_count, duration=window)
    fit_rows, held_rows = split(len(windows), held_out=held_out, seed=run.seed)
    problem = BallProblem(
        ball=ClampedBall.of_robot(robot),
        windows=windows.take(fit_rows),
        coordinates=coordinates,
        threads=run.executor.count if isinstance(run.executor, Threads) else None,
    )
    findings = _check(problem)
    stages = [
        Stage(name="evolution", steps=generations, work=1.0),
        Stage(name="gauss_newton", steps=1, work=1.0),
    ]
    run = replace(run, progress=ProgressReporter(run.progress, stages))
    drawn = np.sort(np.random.default_rng(run.seed).permutation(len(fit_rows))[:evolution_windows])
    coarse = replace(problem, windows=problem.windows.take(drawn), step=EVOLUTION_STEP)
    evolved = evolve(
        lambda points: coarse.costs(coordinates.from_search(points)),
        size=len(coordinates.labels),
        generations=generations,
        population=population,
        run=run,
    )
    start = coordinates.from_search(evolved.best)
    point = run.memoize("gauss_newton", start, lambda: [_least_squares(problem, start)])[0]
    run.progress(Progress(stage="gauss_newton", done=1, total=1, cost=float(problem.costs(point[None])[0])))
    candidates = {"found": coordinates.physical(point)}
    if robot.friction != Friction.none(robot.wheel_count):
        candidates["robot file"] = coordinates.nominal
    candidates["none"] = coordinates.layout.without_friction(coordinates.nominal)
    return _result(
        robot,
        problem,
        point,
        held_out=_errors(replace(problem, windows=windows.take(held_rows)), candidates, robot.friction),
        fit=_errors(problem, candidates, robot.friction),
        held_out_windows=windows.take(held_rows),
        evolution_cost=evolved.history,
        findings=findings,
        log_count=len(named),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class BallProblem:
    """Windows to fit and how; a point (p,) holds every parameter, scaled by `coordinates`."""

    ball: ClampedBall
    windows: BallWindows
    coordinates: Coordinates
    threads: int | None
    step: float = STEP  #: longest inner step [s]

    def residuals(
        self, friction: NDArray[np.float64], *, every: int, terms: FrictionTerms | None = None
    ) -> NDArray[np.float64]:
        """Return predicted less measured Omega (sets, w, k, 3) [rad/s] of frictions (sets, 3 n + 3) in SI units.

        `terms` by direction and load are those of every set.
        """
        windows = self.windows
        predicted = simulate_balls(
            self.ball,
            friction=np.delete(friction, self.rolling, axis=1),
            terms=terms,
            initial=windows.initial,
            torques=windows.torques,
            sample_time=windows.sample_time,
            step=self.step,
            every=every,
            threads=self.threads,
        )
        return predicted - windows.measured[:, every - 1 :: every]

    @property
    def rolling(self) -> slice:
        """Place of C_rr, which a ball on clamped wheels does not have."""
        columns = self.coordinates.layout.columns("rolling")
        assert columns is not None
        return columns

    def of_points(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the residuals (sets, w, 3 k) of scaled parameters (sets, p) at the times of comparison."""
        residuals = self.residuals(self.coordinates.physical(points), every=self.windows.every)
        return residuals.reshape(*residuals.shape[:2], -1)

    def costs(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the root mean square residual (sets,) [rad/s]: (3.5) over the root of its length."""
        return np.sqrt((self.of_points(points) ** 2).mean(axis=(1, 2)))

    def jacobian(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return dr/dz (w, 3 k, p) by central differences, all in one batch."""
        size = len(point)
        forward = np.clip(point + DIFFERENCE * np.eye(size), 0.0, 1.0)
        backward = np.clip(point - DIFFERENCE * np.eye(size), 0.0, 1.0)
        both = self.of_points(np.concatenate([forward, backward]))
        return np.moveaxis(both[:size] - both[size:], 0, -1) / (forward - backward).diagonal()


def _coordinates(robot: Robot, bounds: Bounds) -> Coordinates:
    """Return the coordinates of friction's 3 n + 3 parameters; rolling friction is held as it is."""
    others = [name for name in bounds.limits if name not in FRICTION]
    if others:
        raise InputError(f"{others[0]} cannot be identified upside down; remove its bounds.")
    return scale_between(robot, free=OF_WHEELS, bounds=bounds.without("rolling"))


def _check(problem: BallProblem) -> list[Finding]:
    """Refuse too few windows and a ball at rest; return a warning for each wheel that hardly turns."""
    windows, free_count = problem.windows, int(problem.coordinates.free.sum())
    if not np.any(windows.torques):
        raise InputError("The torques u are zero in every window; friction shows only while motors work.")
    speeds = windows.measured @ problem.ball.A.T
    share = (np.sqrt((speeds**2).mean(axis=1)) > LEAST_SPEED).mean(axis=0)
    if share.max() < 0.1:
        raise InputError(
            "The ball stands still: its wheels turn faster than "
            f"{LEAST_SPEED:g} rad/s in hardly any window. Use larger torques."
        )
    if len(windows) < WINDOWS_PER_PARAMETER * free_count:
        raise InputError(
            f"{len(windows)} windows are too few to fit {free_count} parameters, which need "
            f"{WINDOWS_PER_PARAMETER * free_count}. Log for longer, or choose a shorter window."
        )
    return [
        warning(
            "excitation",
            f"Wheel {i + 1} turns in only {100 * share[i]:.0f} % "
            "of the windows; turn the ball about other axes too.",
        )
        for i in np.flatnonzero(share < 0.1)
    ]


def _least_squares(problem: BallProblem, start: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the point (p,) where the least squares end, within bounds; held parameters stay."""
    free = np.flatnonzero(problem.coordinates.free)

    def whole(moved: NDArray[np.float64]) -> NDArray[np.float64]:
        point = start.copy()
        point[free] = moved
        return point

    def derivatives(moved: NDArray[np.float64]) -> NDArray[np.float64]:
        return problem.jacobian(whole(moved)).reshape(-1, len(start))[:, free]

    found = minimize_squares(
        lambda moved: problem.of_points(whole(moved)[None]).ravel(),
        np.clip(start[free], 1e-4, 1.0 - 1e-4),  # the method starts inside the bounds
        jacobian_of=derivatives,
        bounds=(0.0, 1.0),
        stopping=Stopping(most_evaluations=POLISH_STEPS, least_gain=1e-6, least_step=1e-4),
    )
    return whole(np.where(found.at_bound < 0, 0.0, np.where(found.at_bound > 0, 1.0, found.point)))


def _errors(
    problem: BallProblem, frictions: dict[str, NDArray[np.float64]], nominal: Friction
) -> dict[str, NDArray[np.float64]]:
    """Return the RMSE (3,) of each friction; the robot file's has the terms by direction and load of `nominal`."""
    terms = None if nominal.is_plain else friction_terms(nominal)
    errors = {}
    for name, friction in frictions.items():
        own = terms if name == "robot file" else None
        errors[name] = np.sqrt(
            (problem.residuals(friction[None], every=1, terms=own) ** 2).mean(axis=(1, 2))
        )[0]
    return errors


def _normal_equations(problem: BallProblem, point: NDArray[np.float64]) -> NormalEquations:
    J, r = problem.jacobian(point), problem.of_points(point[None])[0]
    weight = 1.0 / r.std()
    J, r = np.nan_to_num(J) * weight, r * weight
    matrix = np.einsum("wki,wkj->ij", J, J, optimize=False)
    return NormalEquations(matrix=matrix, scores=np.einsum("wki,wk->wi", J, r, optimize=False))


def _result(
    robot: Robot,
    problem: BallProblem,
    point: NDArray[np.float64],
    *,
    held_out: dict[str, NDArray[np.float64]],
    fit: dict[str, NDArray[np.float64]],
    held_out_windows: BallWindows,
    evolution_cost: tuple[float, ...],
    findings: list[Finding],
    log_count: int,
) -> UpsideDown:
    coordinates, equations = problem.coordinates, _normal_equations(problem, point)
    free, values = coordinates.free, coordinates.physical(point)
    stands = free & ((point <= _AT_BOUND) | (point >= 1.0 - _AT_BOUND))
    no_influence = free & ~stands & without_influence(equations)
    scaled = covariance(equations, free & ~stands & ~no_influence)
    errors, correlations = np.sqrt(scaled.diagonal()), correlation(scaled)
    physical_errors = errors * coordinates.slopes(point)
    physical_covariance = correlations * np.outer(physical_errors, physical_errors)
    found = found_robot(
        robot,
        coordinates.layout,
        values,
        physical_errors,
        covariance=physical_covariance,
        ends=ends_without_error(
            coordinates.labels,
            values,
            physical_errors,
            bounds=np.stack([coordinates.lower, coordinates.upper], axis=1),
            intervals={},
        ),
        log_count=log_count,
    )
    own = StageEstimate(
        source="the logs upside down",
        labels=coordinates.labels,
        values=values,
        covariance=physical_covariance,
    )
    rolling = robot.sources.get("friction.rolling", "assumed")
    windows = problem.windows
    return UpsideDown(
        robot=found.annotated(sources={**found.sources, "friction.rolling": rolling}),
        parameters=_by_symbol(coordinates, np.where(no_influence, np.nan, values)),
        standard_errors=_by_symbol(coordinates, physical_errors),
        labels=tuple(np.delete(coordinates.labels, problem.rolling).tolist()),
        correlation=np.delete(np.delete(correlations, problem.rolling, axis=0), problem.rolling, axis=1),
        held_out=held_out,
        fit=fit,
        fit_windows=windows.spans,
        held_out_windows=held_out_windows.spans,
        evolution_cost=evolution_cost,
        window=windows.torques.shape[1] * windows.sample_time,
        findings=(
            *findings,
            *influence_findings(coordinates, values, no_influence),
            *bound_findings(coordinates, values, stands),
            *error_findings(coordinates, errors),
            *correlation_findings(coordinates.labels, correlations),
            *file_findings(robot, own),
        ),
    )


def _by_symbol(coordinates: Coordinates, values: NDArray[np.float64]) -> dict[str, list[float] | float]:
    table = coordinates.layout.by_symbol(values)
    return {symbol: value for symbol, value in table.items() if symbol != BY_NAME["rolling"].symbol}
