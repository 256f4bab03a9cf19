"""Friction of drivelines and ball-wheel contacts from a robot clamped upside down, the ball on its wheels (thesis 3.2).

The momentum of the ball and the drivelines changes by the motors' torques and the friction alone, whatever slips
between wheels and ball, since contact forces act on both:

    d/dt (J Omega + (j_w + j_r) A^T w) = A^T (u - tau(w))

w is what the encoders measure, or A Omega in a log without them. Integrated over pieces of 0.05 s this is linear in b,
c and s; v_s and delta are found on a grid, and a trust-region method within the bounds finishes (Coleman and Li, SIAM
J. Optimization 6 (1996) 418-445, by SciPy). While a wheel is slow, the sign of its speed is uncertain and its friction
no function of it: the directions in which it pushes are then left out. So are rows at the limit of speed or torque,
where the torque that acts is not the one logged.

A trajectory without slip, fitted to one that slips and plays, would end at any delta between its bounds, and take c
with it: on two seeds of one twin c_1 = 0.083 and 0.113 N m.

Standard errors are clustered by window and widened by `WIDENED`. Windows held out validate the friction: from the
camera's mean over the samples about a window's first row, the ball is simulated with it and without.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from scipy.stats import chi2

from ballbot.errors import InputError
from ballbot.findings import Finding, finding_results, note, warning
from ballbot.fitting.intervals import Interval, Uncertainty, assess, between, profile, profile_ends
from ballbot.fitting.least_squares import Stopping, minimize_squares
from ballbot.fitting.run import DEFAULT_RUN, Run, Threads
from ballbot.fitting.uncertainty import WindowEquations, covariance, discrepancy, without_influence
from ballbot.identification.agreement import StageEstimate, file_findings
from ballbot.identification.excitation import WINDOWS_PER_PARAMETER
from ballbot.identification.parameters import Bounds, BoundsLike, Coordinates, as_bounds, scale_between
from ballbot.identification.prediction import DIFFERENCE
from ballbot.identification.quantities import BY_NAME, FRICTION, OF_WHEELS
from ballbot.identification.result import ParameterTable, found_robot
from ballbot.identification.result_findings import (
    bound_findings,
    correlation_findings,
    influence_findings,
    interval_findings,
)
from ballbot.identification.stated_uncertainty import ends_without_error
from ballbot.identification.verdict import Verdict, verdict_of
from ballbot.identification.windows import LARGEST_JITTER, Span, common_sample_time, split
from ballbot.log import Log, LogsLike, as_logs
from ballbot.log.checks.values import spiked_rows
from ballbot.log.columns import torque_names, wheel_angle_names, wheel_speed_names
from ballbot.mechanics.friction import friction_terms, stribeck_decay
from ballbot.progress import Progress
from ballbot.results import to_results
from ballbot.robot import Friction, Robot, RobotLike, as_robot
from ballbot.robot.derived import wheel_speed_limit
from ballbot.simulation.upside_down import ClampedBall, friction_row, simulate_balls
from ballbot.summary import Summary, estimated, first_texts, listed, plotted, summarized

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BALL_NAMES = ("ball_omega_x", "ball_omega_y", "ball_omega_z")

#: samples on either side of a window's first that its start is the mean of
NEIGHBOURS = 4
#: samples on either side of a row that its momentum and torques are the mean of
SMOOTHED = 2
#: length of the pieces that the fit integrates over [s]
PIECE = 0.05
#: a wheel that turns more slowly is left out [rad/s]
SLOW = 0.1
#: share of the supply's speed limit from which on the torque that acts is not the one logged
AT_LIMIT = 0.95
#: values of v_s, and of delta, at which a fit starts
GRID = 7
#: Student's quantile for 95 % and the fewest windows that a fit takes
QUANTILE = 2.1
#: standard errors and intervals are so many times those clustered by window: then 95 % of the intervals of twins with
#: the seeds 101 to 110 have the true b, c and s. `python -m campaigns.evidence upside_down` looks at others.
WIDENED = 2.0


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

    def take(self, rows: NDArray[np.int64]) -> BallWindows:
        """Return the windows of those numbers."""
        return BallWindows(
            initial=self.initial[rows],
            torques=self.torques[rows],
            measured=self.measured[rows],
            spans=tuple(self.spans[row] for row in rows),
            sample_time=self.sample_time,
        )

    def errors(self, robot: Robot, friction: Friction, *, threads: int | None = None) -> NDArray[np.float64]:
        """Return the squared errors (w, 3) of the Omega that a friction predicts, means over each window."""
        predicted = simulate_balls(
            ClampedBall.of_robot(robot),
            friction=[friction_row(friction)],
            terms=None if friction.is_plain else friction_terms(friction),
            initial=self.initial,
            torques=self.torques,
            sample_time=self.sample_time,
            threads=threads,
        )[0]
        return ((predicted - self.measured) ** 2).mean(axis=1)


def cut_ball_windows(robot: Robot, logs: Sequence[Log], *, duration: float) -> BallWindows:
    """Cut logs into windows; those with a gap, a missing value or a row at a limit are left out.

    Parameters
    ----------
    robot : Robot
    logs : sequence of Log
        With u1 .. un and ball_omega_x, _y, _z, of one sample time.
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
    pieces = [_cut(robot, number, log, samples) for number, log in enumerate(logs)]
    spans = tuple(span for piece in pieces for span in piece[3])
    if not spans:
        raise InputError(
            f"No log has {duration:g} s without a gap, a missing value or a row at the limit of speed or torque; "
            "choose a shorter window."
        )
    return BallWindows(
        initial=np.concatenate([piece[0] for piece in pieces]),
        torques=np.concatenate([piece[1] for piece in pieces]),
        measured=np.concatenate([piece[2] for piece in pieces]),
        spans=spans,
        sample_time=sample_time,
    )


def _cut(
    robot: Robot, number: int, log: Log, samples: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], list[Span]]:
    torques, omegas, valid = _torques(log, robot.wheel_count), _omegas(log), valid_rows(robot, log)
    starts = [k for k in _tiles(log, samples) if valid[k - NEIGHBOURS : k + samples + 1].all()]
    rows = np.array(starts, dtype=np.int64)
    near = omegas[rows[:, None] + np.arange(-NEIGHBOURS, NEIGHBOURS + 1)]
    held = rows[:, None] + np.arange(samples)
    spans = [Span(log=number, start=float(log.t[k]), end=float(log.t[k + samples])) for k in starts]
    return near.mean(axis=1), torques[held], omegas[held + 1], spans


def _tiles(log: Log, samples: int) -> range:
    """Return the rows at which a log's windows start, end to end."""
    return range(NEIGHBOURS, len(log) - samples - NEIGHBOURS, samples)


def _torques(log: Log, count: int) -> NDArray[np.float64]:
    return np.column_stack([log[name] for name in torque_names(count)])


def _omegas(log: Log) -> NDArray[np.float64]:
    return np.column_stack([log[name] for name in BALL_NAMES])


def valid_rows(robot: Robot, log: Log) -> NDArray[np.bool_]:
    """Return which rows (N,) are whole and on time, without a spike, and not at the limit of speed or torque."""
    names = (*torque_names(robot.wheel_count), *BALL_NAMES)
    valid = np.asarray(np.isfinite(np.column_stack([log[name] for name in names])).all(axis=1))
    valid &= ~spiked_rows(log, names) & ~_at_limit(robot, log)
    valid[:-1] &= np.abs(np.diff(log.t) - log.sample_time) <= LARGEST_JITTER * log.sample_time
    return valid


def _at_limit(robot: Robot, log: Log) -> NDArray[np.bool_]:
    """Return at which rows (N,) a motor cannot give the torque that is logged."""
    drive, w = robot.drive, _wheel_speeds(log, ClampedBall.of_robot(robot).A)
    fastest = AT_LIMIT * wheel_speed_limit(
        supply_voltage=drive.supply_voltage, speed_constant=drive.speed_constant, gear_ratio=drive.gear_ratio
    )
    u = np.abs(_torques(log, robot.wheel_count))
    return np.asarray(((np.abs(w) > fastest) | (u > drive.torque_limit)).any(axis=1))


def encoder_speeds(log: Log, count: int) -> list[NDArray[np.float64]]:
    """Return the wheels' speeds as logged, or as the slopes of their angles over 50 ms; none if neither is there."""
    names = wheel_speed_names(count)
    if all(name in log for name in names):
        return [log[name] for name in names]
    angles = wheel_angle_names(count)
    half = max(1, round(0.025 / log.sample_time))
    if not all(name in log for name in angles) or len(log) <= 2 * half:
        return []
    slopes = []
    for name in angles:
        slope = np.full(len(log), np.nan)
        slope[half:-half] = (log[name][2 * half :] - log[name][: -2 * half]) / (
            log.t[2 * half :] - log.t[: -2 * half]
        )
        slopes.append(slope)
    return slopes


def _wheel_speeds(log: Log, A: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the wheels' speeds (N, n) by the encoders, or by the ball if there are none."""
    speeds = encoder_speeds(log, len(A))
    return np.column_stack(speeds) if speeds else _omegas(log) @ A.T


def _averaged(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return each row (N, k) as the mean over `SMOOTHED` neighbours on either side; NaN near the ends."""
    ends = np.full((SMOOTHED, values.shape[1]), np.nan)
    means = np.lib.stride_tricks.sliding_window_view(values, 2 * SMOOTHED + 1, axis=0).mean(axis=-1)
    return np.vstack([ends, means, ends])


@dataclass(frozen=True, kw_only=True, eq=False)
class BallPieces:
    """m pieces of logs, each of k samples, in which a wheel turns and no row is at a limit."""

    A: NDArray[np.float64]  #: (n, 3), wheel speeds from the ball's angular velocity
    #: (m, 3, 3), onto the directions in which only wheels push that turn throughout the piece
    projector: NDArray[np.float64]
    changes: NDArray[np.float64]  #: (m, 3), of the momentum less what the torques gave, so projected [N m s]
    speeds: NDArray[np.float64]  #: (m, k, n) [rad/s]
    tile: NDArray[np.int64]  #: (m,), the number of the window that each is in, from 0, over all logs
    tiles: tuple[tuple[int, float], ...]  #: log and start of each of those windows
    sample_time: float  #: [s]

    def take(self, rows: NDArray[np.bool_]) -> BallPieces:
        """Return those pieces."""
        return replace(
            self,
            projector=self.projector[rows],
            changes=self.changes[rows],
            speeds=self.speeds[rows],
            tile=self.tile[rows],
        )

    @property
    def equation_count(self) -> int:
        """How many independent equations the pieces give."""
        return round(float(np.trace(self.projector, axis1=1, axis2=2).sum()))

    def friction_impulses(self, v_s: float, delta: float) -> NDArray[np.float64]:
        """Return the momentum (3 m, 3 n) that b, c and s of each wheel take, each being one."""
        signs, x = np.sign(self.speeds), np.abs(self.speeds) / v_s
        parts = (self.speeds, signs, signs * stribeck_decay(x, delta))
        sums = [self.sample_time * part.sum(axis=1)[:, None, :] * self.A.T for part in parts]
        return (self.projector @ np.concatenate(sums, axis=2)).reshape(3 * len(self.changes), -1)


def cut_pieces(robot: Robot, logs: Sequence[Log], *, duration: float) -> BallPieces:
    """Cut logs into pieces of `PIECE` within windows of some duration [s] that lie end to end; see `BallPieces`."""
    ball, sample_time = ClampedBall.of_robot(robot), common_sample_time(logs, duration=duration)
    projectors, changes, speeds, tile = [], [], [], []
    tiles: list[tuple[int, float]] = []
    samples, length = round(duration / sample_time), max(2, round(min(PIECE, duration) / sample_time))
    # ball.inertia is J + (j_w + j_r) A^T A
    J = robot.ball.inertia * np.eye(3)
    of_wheels = (ball.inertia - J) @ np.linalg.pinv(ball.A.T @ ball.A)
    for number, log in enumerate(logs):
        w = _averaged(_wheel_speeds(log, ball.A))
        valid = valid_rows(robot, log) & np.isfinite(w).all(axis=1)
        momentum = _averaged(_omegas(log)) @ J + w @ ball.A @ of_wheels
        impulse = sample_time * _averaged(_torques(log, robot.wheel_count)) @ ball.A
        for start in _tiles(log, samples):
            tiles.append((number, float(log.t[start])))
            for k in range(start, start + samples - length + 1, length):
                piece = slice(k - SMOOTHED, k + length + SMOOTHED + 1)
                turning = (np.abs(w[piece]) > SLOW).all(axis=0)
                if not (turning.any() and valid[piece].all()):
                    continue
                still = ball.A[~turning]
                projectors.append(np.eye(3) - np.linalg.pinv(still) @ still)
                changes.append(momentum[k + length] - momentum[k] - impulse[k : k + length].sum(axis=0))
                speeds.append(0.5 * (w[k : k + length] + w[k + 1 : k + length + 1]))
                tile.append(len(tiles) - 1)
    projector = np.array(projectors).reshape(-1, 3, 3)
    return BallPieces(
        A=ball.A,
        projector=projector,
        changes=(projector @ np.array(changes).reshape(-1, 3, 1))[..., 0],
        speeds=np.array(speeds).reshape(-1, length, robot.wheel_count),
        tile=np.array(tile, dtype=np.int64),
        tiles=tuple(tiles),
        sample_time=sample_time,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class BallFit:
    """A friction and how it explains pieces of logs; a point (p,) holds every parameter, scaled by `coordinates`."""

    pieces: BallPieces
    coordinates: Coordinates
    point: NDArray[np.float64]

    def residuals(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the change of momentum (3 m,) that a point predicts less the measured one [N m s]."""
        return -self._impulses(self.coordinates.physical(point)) - self.pieces.changes.ravel()

    def _impulses(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        n = len(self.pieces.A)
        return self.pieces.friction_impulses(values[3 * n], values[3 * n + 1]) @ values[: 3 * n]

    def jacobian(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the residuals' derivatives (3 m, p)."""
        n, values, slopes = (
            len(self.pieces.A),
            self.coordinates.physical(point),
            self.coordinates.slopes(point),
        )
        J = np.zeros((self.pieces.changes.size, len(point)))
        J[:, : 3 * n] = -self.pieces.friction_impulses(values[3 * n], values[3 * n + 1]) * slopes[: 3 * n]
        for place in (3 * n, 3 * n + 1):
            ends = np.clip(point[place] + DIFFERENCE * np.array([-1.0, 1.0]), 0.0, 1.0)
            both = [self.residuals(_moved(point, place, end)) for end in ends]
            J[:, place] = (both[1] - both[0]) / (ends[1] - ends[0])
        return J * self.coordinates.free

    @property
    def cost(self) -> float:
        """The logarithm of the root mean square residual."""
        return float(np.log(self._deviation(self.residuals(self.point))))

    def _deviation(self, residuals: NDArray[np.float64]) -> float:
        return float(np.sqrt((residuals**2).sum() / self.residual_count))

    @property
    def residual_count(self) -> int:
        """How many independent residuals there are."""
        return self.pieces.equation_count

    @property
    def equations(self) -> WindowEquations:
        """The normal equations of each window that has pieces."""
        J, r = self.jacobian(self.point), self.residuals(self.point)
        J, r = J / self._deviation(r), r / self._deviation(r)
        _, window = np.unique(np.repeat(self.pieces.tile, 3), return_inverse=True)
        shape = (int(window.max()) + 1, J.shape[1])
        matrices, scores = np.zeros((*shape, J.shape[1])), np.zeros(shape)
        np.add.at(matrices, window, J[:, :, None] * J[:, None, :])
        np.add.at(scores, window, J * r[:, None])
        return WindowEquations(matrices=matrices, scores=scores)

    def repeated(
        self,
        *,
        moved: NDArray[np.float64],
        free: NDArray[np.bool_],
        most_steps: int,  # noqa: ARG002 (of fits that take long)
        run: Run = DEFAULT_RUN,  # noqa: ARG002
    ) -> BallFit:
        """Fit the `free` parameters (p,) again after moving the point by `moved` (p,)."""
        places, point = np.flatnonzero(free), np.clip(self.point + moved, 0.0, 1.0)
        if not len(places):
            return replace(self, point=point)

        def whole(part: NDArray[np.float64]) -> NDArray[np.float64]:
            every = point.copy()
            every[places] = part
            return every

        found = minimize_squares(
            lambda part: self.residuals(whole(part)),
            np.clip(point[places], 1e-4, 1.0 - 1e-4),  # the method starts inside the bounds
            jacobian_of=lambda part: self.jacobian(whole(part))[:, places],
            bounds=(0.0, 1.0),
            stopping=Stopping(most_evaluations=POLISH_STEPS),
        )
        return replace(
            self,
            point=whole(np.where(found.at_bound < 0, 0.0, np.where(found.at_bound > 0, 1.0, found.point))),
        )


def _moved(point: NDArray[np.float64], place: int, value: float) -> NDArray[np.float64]:
    moved = point.copy()
    moved[place] = value
    return moved


def fit_pieces(pieces: BallPieces, coordinates: Coordinates) -> BallFit:
    """Return the friction of least squares: from the best point of a grid over v_s and delta, with all that is free."""
    n, free = len(pieces.A), coordinates.free
    linear = free & (np.arange(len(free)) < 3 * n)
    starts = []
    for v_s, delta in product(
        *(np.linspace(0.0, 1.0, GRID) if free[k] else [0.0] for k in (3 * n, 3 * n + 1))
    ):
        point = coordinates.scaled(coordinates.nominal)
        point[3 * n : 3 * n + 2] = v_s, delta
        fit = BallFit(pieces=pieces, coordinates=coordinates, point=np.where(linear, 0.0, point))
        if linear.any():
            J = fit.jacobian(fit.point)[:, linear]
            point[linear] = lsq_linear(J, -fit.residuals(fit.point), bounds=(0.0, 1.0)).x
        starts.append(replace(fit, point=point))
    best = min(starts, key=lambda one: one.cost)
    return best.repeated(moved=np.zeros(len(free)), free=free, most_steps=POLISH_STEPS)


@summarized
@dataclass(frozen=True, kw_only=True, eq=False)
class UpsideDown:
    """Driveline and ball-wheel friction of a robot without its weight on the ball; p = 3 n + 2 parameters."""

    robot: Robot  #: with the friction found; rolling friction as it was, which has no part here
    verdict: Verdict  #: whether the friction is usable
    parameters: ParameterTable  #: {b: [..], c: [..], s: [..], v_s, delta}, SI units; NaN without influence
    standard_errors: (
        ParameterTable  #: alike, clustered by window and widened; NaN if not estimated or not limited
    )
    intervals: Mapping[str, Interval]  #: of 95 %, by label
    labels: tuple[str, ...]  #: (p,)
    correlation: NDArray[np.float64]  #: (p, p)
    #: root mean square error (3,) [rad/s] of Omega on the windows held out: with the friction "found", that of the
    #: "robot file" where it has any, and "none"
    held_out: Mapping[str, NDArray[np.float64]]
    fit_windows: tuple[Span, ...]
    held_out_windows: tuple[Span, ...]
    window: float  #: length of a window [s]
    findings: tuple[Finding, ...]  #: of the numbers

    def summary(self) -> Summary:
        """Return the verdict, each parameter with its standard error or interval, errors held out, and warnings."""
        units = {BY_NAME[name].symbol: BY_NAME[name].unit.removeprefix("1") for name in OF_WHEELS}
        errors = self.standard_errors
        rows = [
            (key, estimated(one, errors[key], units[key], intervals=self.ends(key)))
            for key, one in self.parameters.items()
        ]
        held_out = {key: listed(one, "rad/s") for key, one in self.held_out.items()}
        rows += [(f"error, {key}", f"{one}, held out") for key, one in held_out.items()]
        windows = f"{len(self.fit_windows)} fitted, {len(self.held_out_windows)} held out, {self.window:g} s"
        return Summary(
            title=f"Friction of the robot {self.robot.name} upside down: value ± standard error, or 95 % interval",
            rows=(*rows, ("windows", windows)),
            sentences=(self.verdict.sentence, *first_texts(self.findings)),
        )

    def ends(self, symbol: str) -> list[tuple[float, float] | None]:
        """Return the ends of a quantity's intervals that take the place of standard errors; None for others."""
        several = isinstance(self.parameters[symbol], list)
        labels = [f"{symbol}{i + 1}" for i in range(self.robot.wheel_count)] if several else [symbol]
        return profile_ends(self.intervals, labels)

    def plot(self) -> Figure:
        """Return a figure of each wheel's friction over its speed."""
        return plotted(self)

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        results = {
            "verdict": self.verdict,
            "parameters": self.parameters,
            "standard_errors": self.standard_errors,
            "intervals": self.intervals,
            "correlation": {"labels": list(self.labels), "matrix": self.correlation},
            "rmse": {"columns": list(BALL_NAMES), "held_out": self.held_out},
            "windows": {
                "length": self.window,
                "fit": [[span.log, span.start, span.end] for span in self.fit_windows],
                "held_out": [[span.log, span.start, span.end] for span in self.held_out_windows],
            },
            "findings": finding_results(self.findings),
        }
        return to_results(results)


#: a wheel turns in a window where its root mean square speed is above this [rad/s]
LEAST_SPEED = 0.1
#: evaluations of the trust-region method at most
POLISH_STEPS = 40
_AT_BOUND = 1e-6
#: the shape of the Stribeck part, which means nothing without one
_SHAPE = ("stribeck_speed", "stribeck_exponent")
#: share of rows at a limit that is worth a note
_MANY_AT_LIMIT = 0.01


def identify_upside_down(
    robot: RobotLike,
    logs: LogsLike,
    *,
    bounds: BoundsLike | None = None,
    window: float = 1.0,
    held_out: float = 0.25,
    run: Run = DEFAULT_RUN,
) -> UpsideDown:
    """Find b, c, s of each wheel, v_s and delta from the robot clamped upside down.

    Parameters
    ----------
    robot : Robot, preset or robot file
        Its own friction is not used but to be compared with.
    logs : Log or log file, or several in a list or a mapping
        With u1 .. un and ball_omega_x, _y, _z in the robot's frame, of one sample time. Wheel speeds or angles, if
        they are logged, are used.
    bounds : Bounds or bounds file, optional
        Within which the parameters are estimated; those of rolling friction are not used.
    window : float
        Length of the windows [s] that are held out and predicted, and by which errors are clustered.
    held_out : float
        Share of the windows kept from the fit.
    run : Run, optional
        Its seed chooses the windows held out. Of its executor, the number of threads counts; the result does not
        depend on it.

    Raises
    ------
    InputError
        If the logs cannot give the parameters, or an option makes no sense.
    """
    if not 0.0 < held_out < 1.0:
        raise InputError(f"held_out is {held_out!r}; it must be a fraction between 0 and 1, such as 0.25.")
    robot, named = as_robot(robot), as_logs(logs)
    coordinates = _coordinates(robot, as_bounds(bounds))
    windows = cut_ball_windows(robot, list(named.values()), duration=window)
    fit_rows, held_rows = split(len(windows), held_out=held_out, seed=run.seed)
    kept = windows.take(held_rows)
    pieces = cut_pieces(robot, list(named.values()), duration=window)
    others = {(span.log, span.start) for span in kept.spans}
    pieces = pieces.take(np.array([pieces.tiles[tile] not in others for tile in pieces.tile], dtype=bool))
    findings = [*_check(robot, windows, pieces, coordinates), *_limit_findings(robot, named)]
    run.progress(Progress(stage="fit", done=0, total=2))
    fit = fit_pieces(pieces, coordinates)
    if coordinates.free[_of(coordinates, "stribeck")].any():
        simpler = fit_pieces(pieces, _without_stribeck(robot, coordinates))
        if not _better(fit, simpler):
            text = "Break-away friction above c does not show in these logs; s is held at 0."
            findings, fit = [*findings, note("no-breakaway", text)], simpler
    run.progress(Progress(stage="intervals", done=1, total=2))
    found = _uncertain(robot, fit, run=run, log_count=len(named))
    frictions = {"found": found.robot.friction}
    if robot.friction != Friction.none(robot.wheel_count):
        frictions["robot file"] = robot.friction
    frictions["none"] = Friction.none(robot.wheel_count)
    threads = run.executor.count if isinstance(run.executor, Threads) else None
    errors = {name: kept.errors(robot, friction, threads=threads) for name, friction in frictions.items()}
    run.progress(Progress(stage="prediction", done=2, total=2))
    kept_columns = np.array([name != "rolling" for name in coordinates.names])
    return UpsideDown(
        robot=found.robot,
        verdict=_verdict(errors, kept.spans, fit, found.intervals),
        parameters=_by_symbol(coordinates, found.values),
        standard_errors=_by_symbol(coordinates, found.errors),
        intervals=found.intervals,
        labels=tuple(np.array(coordinates.labels)[kept_columns].tolist()),
        correlation=found.correlation[np.ix_(kept_columns, kept_columns)],
        held_out={name: np.sqrt(one.mean(axis=0)) for name, one in errors.items()},
        fit_windows=windows.take(fit_rows).spans,
        held_out_windows=kept.spans,
        window=windows.torques.shape[1] * windows.sample_time,
        findings=(*findings, *found.findings),
    )


def _coordinates(robot: Robot, bounds: Bounds) -> Coordinates:
    """Return the coordinates of friction's 3 n + 3 parameters; rolling friction is held as it is."""
    others = [name for name in bounds.limits if name not in FRICTION]
    if others:
        raise InputError(f"{others[0]} cannot be identified upside down; remove its bounds.")
    return scale_between(robot, free=OF_WHEELS, bounds=bounds.without("rolling"))


def _of(coordinates: Coordinates, name: str) -> NDArray[np.int64]:
    """Return the places of a quantity's parameters."""
    return np.flatnonzero(np.array(coordinates.names) == name)


def _without_stribeck(robot: Robot, coordinates: Coordinates) -> Coordinates:
    """Return the coordinates of friction without a Stribeck part, the bounds of b and c as they are."""
    limits = {one.name: one.bounds for one in coordinates.parameters}
    for name in _SHAPE:
        nominal = float(coordinates.nominal[_of(coordinates, name)[0]])
        limits[name] = (nominal, nominal)
    bounds = Bounds({**limits, "stribeck": (0.0, 0.0)})
    return scale_between(robot, free=OF_WHEELS, bounds=bounds.without("rolling"))


def _better(fit: BallFit, simpler: BallFit) -> bool:
    """Return whether a fit is better than a simpler one by more than chance, the windows' dependence allowed for."""
    normal, free = simpler.equations.normal, simpler.coordinates.free
    moved = free & (simpler.point > 0.0)
    more = int(fit.coordinates.free.sum() - free.sum())
    inflation = 1.0
    if moved.any():
        clustered = covariance(normal, moved).diagonal()[moved]
        independent = np.linalg.pinv(normal.matrix[np.ix_(moved, moved)], hermitian=True).diagonal()
        inflation = max(1.0, float(np.mean(clustered / independent)))
    return 2.0 * fit.residual_count * (simpler.cost - fit.cost) > inflation * float(chi2.isf(0.05, more))


def _check(robot: Robot, windows: BallWindows, pieces: BallPieces, coordinates: Coordinates) -> list[Finding]:
    """Refuse too few windows and a ball at rest; return a warning for each wheel that hardly turns."""
    if not np.any(windows.torques):
        raise InputError("The torques u are zero in every window; friction shows only while motors work.")
    speeds = windows.measured @ ClampedBall.of_robot(robot).A.T
    share = (np.sqrt((speeds**2).mean(axis=1)) > LEAST_SPEED).mean(axis=0)
    if share.max() < 0.1:
        raise InputError(
            "The ball stands still: its wheels turn faster than "
            f"{LEAST_SPEED:g} rad/s in hardly any window. Use larger torques."
        )
    fitted, free_count = len(np.unique(pieces.tile)), int(coordinates.free.sum())
    if fitted < WINDOWS_PER_PARAMETER * free_count:
        raise InputError(
            f"{fitted} windows in which wheels turn are too few to fit {free_count} parameters, which need "
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


def _limit_findings(robot: Robot, logs: Mapping[str, Log]) -> list[Finding]:
    share = float(np.concatenate([_at_limit(robot, log) for log in logs.values()]).mean())
    if share < _MANY_AT_LIMIT:
        return []
    text = (
        f"{100.0 * share:.2g} % of the rows are at the limit of speed or torque and are left out; smaller torques keep "
        "clear of it."
    )
    return [note("limits", text)]


def _verdict(
    errors: Mapping[str, NDArray[np.float64]],
    spans: Sequence[Span],
    fit: BallFit,
    intervals: Mapping[str, Interval],
) -> Verdict:
    """Return whether the friction is usable, from errors (w, 3) on windows held out, its intervals and bounds."""
    b_and_c = range(2 * len(fit.pieces.A))
    labels = [fit.coordinates.labels[place] for place in b_and_c]
    at_end = [
        label
        for label, place in zip(labels, b_and_c, strict=True)
        if fit.coordinates.free[place] and fit.point[place] >= 1.0 - _AT_BOUND
    ]
    verdict = verdict_of(errors["found"], errors["none"], spans, at_end=at_end)
    if verdict.usable or any(label in intervals and intervals[label].lower > 0.0 for label in labels):
        return verdict
    return replace(verdict, reasons=("no friction was found", *verdict.reasons))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Uncertain:
    """A friction and how certain it is."""

    robot: Robot
    values: NDArray[np.float64]  #: (p,) SI units; NaN without influence
    errors: NDArray[np.float64]  #: (p,) standard errors, SI units; NaN if there is none
    correlation: NDArray[np.float64]  #: (p, p)
    intervals: dict[str, Interval]
    findings: tuple[Finding, ...]


def _with_profiles(
    fit: BallFit, uncertainty: Uncertainty, *, estimates: NDArray[np.bool_], free: NDArray[np.bool_]
) -> dict[str, Interval]:
    """Return the intervals, by profiles where linear errors say little: the curve bends in s, v_s and delta."""
    bent = np.isin(fit.coordinates.names, ("stribeck", *_SHAPE)) & estimates
    return uncertainty.intervals | _profiles(
        fit, np.flatnonzero(bent), free=free, errors=uncertainty.scaled_errors
    )


def _errors_of(
    labels: Sequence[str], uncertainty: Uncertainty, intervals: Mapping[str, Interval]
) -> NDArray[np.float64]:
    """Return standard errors (p,): those of profiles by their width, else the larger of clustered and bootstrap."""
    profiled = [intervals.get(label) for label in labels]
    widths = np.array([np.nan if one is None else one.deviation for one in profiled])
    by_profile = np.array([one is not None and one.method == "profile" for one in profiled])
    largest = np.fmax(uncertainty.standard_errors, uncertainty.bootstrap_errors)
    return np.where(by_profile, widths, largest)


def _uncertain(robot: Robot, fit: BallFit, *, run: Run, log_count: int) -> _Uncertain:
    """Return the friction with its uncertainty."""
    coordinates = fit.coordinates
    free, point, values = coordinates.free, fit.point, coordinates.physical(fit.point)
    stands = free & ((point <= _AT_BOUND) | (point >= 1.0 - _AT_BOUND))
    no_influence = free & ~stands & without_influence(fit.equations.normal)
    # v_s and delta stay free in the errors of the others even at a bound, which is a choice and no knowledge
    shape = np.isin(coordinates.names, _SHAPE)
    at_bound = stands & ~shape
    estimates = free & ~at_bound & ~no_influence & (fit.equations.normal.matrix.diagonal() > 0.0)
    _, log = np.unique(
        [fit.pieces.tiles[tile][0] for tile in np.unique(fit.pieces.tile)], return_inverse=True
    )
    apart = discrepancy(fit.equations, log, estimates, seed=run.seed)
    uncertainty = assess(
        fit,
        estimated=estimates,
        at_bound=at_bound,
        most_profiles=0,
        widen=WIDENED * apart.factor,
        run=replace(run, progress=lambda _: None),
    )
    intervals = _with_profiles(fit, uncertainty, estimates=estimates, free=free & ~no_influence)
    errors = np.where(stands, np.nan, _errors_of(coordinates.labels, uncertainty, intervals))
    spread = uncertainty.correlation * np.outer(errors, errors)
    found = found_robot(
        robot,
        coordinates.layout,
        values,
        errors,
        covariance=spread,
        ends=ends_without_error(
            coordinates.labels,
            values,
            errors,
            bounds=np.stack([coordinates.lower, coordinates.upper], axis=1),
            intervals=intervals,
        ),
        log_count=log_count,
    )
    own = StageEstimate(
        source="the logs upside down", labels=coordinates.labels, values=values, covariance=spread
    )
    rolling = robot.sources.get("friction.rolling", "assumed")
    logs_differ = [
        warning("logs-differ", "The logs disagree on the friction by more than chance; errors are wider.")
    ]
    return _Uncertain(
        robot=found.annotated(sources={**found.sources, "friction.rolling": rolling}),
        values=np.where(no_influence, np.nan, values),
        errors=errors,
        correlation=uncertainty.correlation,
        intervals=intervals,
        findings=(
            *influence_findings(coordinates, values, no_influence),
            *bound_findings(coordinates, values, stands),
            *interval_findings(intervals),
            *correlation_findings(coordinates.labels, uncertainty.correlation),
            *(logs_differ if apart.significant else []),
            *file_findings(robot, own),
        ),
    )


def _profiles(
    fit: BallFit, places: NDArray[np.int64], *, free: NDArray[np.bool_], errors: NDArray[np.float64]
) -> dict[str, Interval]:
    """Return the profile intervals of the parameters at `places`; `errors` (p,) are their scaled standard errors."""
    found = {}
    independent = np.linalg.pinv(fit.equations.normal.matrix, hermitian=True).diagonal()
    for place in places.tolist():
        rise = (QUANTILE * errors[place]) ** 2 / independent[place]
        one = profile(fit, place, free=free, error=QUANTILE * float(errors[place]), rise=float(rise))
        label = fit.coordinates.labels[place]
        found[label] = between(fit.coordinates, place, one.lower, one.upper, method="profile")
    return found


def _by_symbol(coordinates: Coordinates, values: NDArray[np.float64]) -> dict[str, list[float] | float]:
    table = coordinates.layout.by_symbol(values)
    return {symbol: value for symbol, value in table.items() if symbol != BY_NAME["rolling"].symbol}
