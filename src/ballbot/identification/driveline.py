"""Stage one of the thesis (3.1 to 3.5): one driveline, the wheel free, five parameters.

    (j_w + j_r) w_dot = u - (b w + (c + s exp(-|w/v_s|^delta)) sgn(w))           cost (3.5): |w - w_measured|

The measured torque is the input, the inertia is the robot's. An evolution strategy finds the basin by that cost, as in
the thesis. The noise of the torque moves the simulated speed for longer than a passage of the low speeds lasts, and the
gearbox's play lets a motor start alone: the cost's minimum is off by several standard errors in s, v_s and delta. The
estimate therefore predicts a sample ahead (`ballbot.identification.driveline_estimate`).

Two readings of the supply's speed limit l:

*restarted*: where the supply limits the speed, the torque that acts is not the one recorded, so that the sweep is cut
there; each piece starts from the measured speed. *As printed* (3.2): the speed seen is clamped while the one
integrated runs on through the limit for as long as the torque pushes, and comes back late.

A motor driven by voltage brakes with its back-EMF (`ballbot.identification.windows`). The brake follows the predicted
speed, or an error of the speed would not die out: the torque is that at standstill, and b acts beside the brake b_e.

The checks find out whether the wheels of a sweep turned freely, without the ball on them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.fitting.intervals import Interval, profile_ends
from ballbot.fitting.parameter import Parameter, ParameterSpace
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.search import evolve
from ballbot.identification.driveline_estimate import (
    AT_BOUND,
    NEAR_BOUND,
    DrivelineEstimate,
    estimate_driveline,
)
from ballbot.identification.driveline_innovations import Track, angles_of, break_aways
from ballbot.identification.quantities import BY_NAME, OF_WHEELS
from ballbot.log import Log
from ballbot.log.columns import wheel_angle_names
from ballbot.mechanics.friction_laws.classical import Classical
from ballbot.progress import Progress, in_stage
from ballbot.robot import Robot
from ballbot.simulation.driveline import Driveline, SpeedClamp, simulate_drivelines
from ballbot.summary import Summary, estimated, plotted, summarized

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: a body that is held still leans about its mean by less, beside sensor noise; one that balances, by half a degree
#: and more (root mean square) [rad]
_STILL = np.radians(0.2)
_LEANS = ("theta", "phi")
_BALL = ("ball_omega_x", "ball_omega_y", "ball_omega_z")


def check_wheels_free(log: Log) -> None:
    """Refuse the log of a robot that balances, or that has the ball on its wheels.

    A log without lean and without the ball's angular velocity shows neither, and passes.

    Raises
    ------
    InputError
        If it is such a log.
    """
    for name in _LEANS:
        swing = _deviation(_known(log, name))
        if swing > _STILL:
            raise InputError(
                f"In this log the body sways by {np.degrees(swing):.2g} degrees (root mean "
                f"square of {name}), as when it balances. A sweep needs the body held still and "
                "the wheels off the ball; use `ballbot identify` for logs of a balancing robot."
            )
    for name in _BALL:
        if np.any(_known(log, name) != 0.0):
            raise InputError(
                f"In this log a ball turns ({name}). A sweep needs the wheels off the ball; "
                "use `ballbot identify-upside-down` for logs of the ball on the clamped robot."
            )


def _known(log: Log, name: str) -> NDArray[np.float64]:
    """Return a column's values without those that are missing; none if there is no such column."""
    values = log[name] if name in log else np.empty(0)
    return values[np.isfinite(values)]


def _deviation(values: NDArray[np.float64]) -> float:
    """Return the standard deviation that white noise, judged by the changes from row to row, does not explain."""
    if values.size < 2:
        return 0.0
    return float(np.sqrt(max(np.var(values) - 0.5 * np.mean(np.diff(values) ** 2), 0.0)))


#: the parameters of a driveline, and their symbols
QUANTITIES = tuple(BY_NAME[name] for name in OF_WHEELS)
NAMES = tuple(one.symbol for one in QUANTITIES)
#: from this share of the limit, the speed counts as limited
_LIMITED = 0.995
_SHORTEST_PIECE = 0.5  # [s]
#: samples of a turning wheel, below which there is nothing to fit
_LEAST_MOVING = 20
#: a standard error of this share of the bounds' width leaves a parameter unknown
_UNKNOWN = 0.5


#: the least and the greatest b, c, s, v_s and delta
Five = tuple[float, float, float, float, float]
LOWER, UPPER = (cast("Five", side) for side in zip(*(one.bounds for one in QUANTITIES), strict=True))


def driveline_parameters(*, lower: Five = LOWER, upper: Five = UPPER) -> ParameterSpace:
    """Return the five parameters with the bounds within which they are estimated.

    Raises
    ------
    InputError
        If a lower bound is not below the upper one, or not zero or more (for v_s and delta above zero).
    """
    for one, low, high in zip(QUANTITIES, lower, upper, strict=True):
        if not 0.0 <= low < high < np.inf or (low == 0.0 and one.scale == "ratio"):
            raise InputError(
                f"The bounds of {one.symbol} are [{low:g}, {high:g}]; the lower one must be "
                "below the upper one and zero or more (for v_s and delta above zero)."
            )
    return ParameterSpace(
        parameters=tuple(
            Parameter(
                name=one.name,
                symbol=one.symbol,
                unit=one.unit,
                scale=one.scale,
                bounds=limits,
                default=limits[0],
            )
            for one, limits in zip(QUANTITIES, zip(lower, upper, strict=True), strict=True)
        )
    )


#: within the bounds that suit most drivelines
DRIVELINE_PARAMETERS = driveline_parameters()


@summarized
@dataclass(frozen=True, kw_only=True, eq=False)
class DrivelineFit:
    """One driveline's friction."""

    wheel: int  #: from 1
    values: NDArray[np.float64]  #: (5,) b, c, s, v_s, delta
    standard_errors: NDArray[np.float64]  #: (5,); NaN at a bound
    correlation: NDArray[np.float64]  #: (5, 5)
    intervals: dict[str, Interval]  #: of 95 %, by symbol; none for a parameter without effect
    delay: float  #: of the torque [s]
    innovation: float  #: root mean square error of the speed predicted a sample ahead [rad/s]
    #: (5,) parameters that the sweep does not determine; their values are arbitrary
    unknown: NDArray[np.bool_]
    cost: float  #: (3.5) over the samples compared [rad/s]
    samples: int
    rmse: float  #: [rad/s]
    rmse_without: float  #: without friction, over the whole sweep, the speed clamped as printed [rad/s]
    predicted: NDArray[np.float64]  #: (N,) speed [rad/s]; NaN if it is limited
    without: NDArray[np.float64]  #: (N,) without friction, the speed clamped as printed

    @property
    def law(self) -> Classical:
        """The friction found."""
        return classical(self.values)

    def summary(self) -> Summary:
        """Return each parameter with its standard error, and the error of the speed with friction and without."""
        rows = []
        for one, value, error, unknown in zip(
            QUANTITIES, self.values, self.standard_errors, self.unknown, strict=True
        ):
            symbol = one.symbol
            number = estimated(value, error, one.unit, intervals=profile_ends(self.intervals, [symbol]))
            rows.append((symbol, "not determined by the sweep" if unknown else number))
        return Summary(
            title=f"Friction of the driveline of wheel {self.wheel}: value ± standard error, or 95 % interval",
            rows=(
                *rows,
                ("delay of the torque", f"{self.delay:.3g} s"),
                (
                    "error of the speed",
                    f"{self.rmse:.3g} rad/s RMS; without friction {self.rmse_without:.3g}",
                ),
                ("samples", str(self.samples)),
            ),
        )

    def plot(self) -> Figure:
        """Return a figure of the friction over speed with its 95 % band."""
        return plotted(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class PrintedFit:
    """The same driveline with the speed clamped as (3.2) prints it, over the whole sweep."""

    values: NDArray[np.float64]  #: (5,)
    rmse: float  #: [rad/s]
    predicted: NDArray[np.float64]  #: (N,) [rad/s]
    rmse_restarted: float  #: of the friction found from the pieces, under this clamp [rad/s]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """One wheel's sweep."""

    wheel: int  #: from 1
    t: NDArray[np.float64]  #: (N,) [s]
    torque: NDArray[np.float64]  #: (N,) [N m]
    speed: NDArray[np.float64]  #: (N,) [rad/s]
    limit: float  #: l [rad/s]
    inertia: float  #: [kg m^2]
    brake: float = 0.0  #: b_e of the motor's back-EMF [N m s/rad]; the torque is then that at standstill
    angle: NDArray[np.float64] | None = None  #: (N,) of the encoder at the wheel [rad]
    play: float = 0.0  #: of the gearbox at the wheel, from stop to stop [rad]
    rotor_inertia: float = 0.0  #: j_r, the part of the inertia before the play [kg m^2]

    def driveline(self, values: NDArray[np.float64], *, clamp: SpeedClamp | None = None) -> Driveline:
        """Return the driveline with friction b, c, s, v_s, delta (5,) beside the motor's brake."""
        law = classical(values + np.array([self.brake, 0.0, 0.0, 0.0, 0.0]))
        return Driveline(inertia=self.inertia, friction=law, speed_limit=clamp)

    def track(self) -> Track:
        """Return what one-step predictions need; without the rotor's inertia they know no play."""
        angle = angles_of(self.angle, self.speed, sample_time=self.sample_time)
        play = self.play if self.rotor_inertia > 0.0 else 0.0
        event, origin = break_aways(angle, sample_time=self.sample_time, play=play)
        return Track(
            torque=self.torque,
            angle=angle,
            speed=self.speed,
            pieces=tuple(self.pieces()),
            sample_time=self.sample_time,
            inertia=self.inertia,
            rotor_inertia=self.rotor_inertia or self.inertia,
            brake=self.brake,
            event=event,
            origin=origin,
        )

    @property
    def sample_time(self) -> float:
        """[s]"""
        return float(self.t[-1] - self.t[0]) / (len(self.t) - 1)

    def pieces(self) -> list[tuple[int, int]]:
        """Return first row and row after the last of the pieces in which the speed is not limited."""
        free = np.abs(self.speed) < _LIMITED * self.limit
        edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]])))
        shortest = _SHORTEST_PIECE / self.sample_time
        return [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= shortest]


def classical(values: NDArray[np.float64]) -> Classical:
    """Return the law of b, c, s, v_s, delta (5,)."""
    b, c, s, v_s, delta = (float(value) for value in values)
    return Classical(viscous=b, coulomb=c, stribeck=s, stribeck_speed=v_s, stribeck_exponent=delta)


def sweeps_of(robot: Robot, log: Log, *, limit: float | None = None, back_emf: float = 0.0) -> list[Sweep]:
    """Return each wheel's sweep; the default limit [rad/s] is the greatest speed in the log.

    `back_emf` is the braking constant of motors driven by voltage [N m s/rad], if the log's torques contain it.

    Raises
    ------
    InputError
        If the log lacks torques or wheel speeds or has them of fewer wheels than the robot, its wheels were not
        free of the ball, or the limit is not above zero.
    """
    check_wheels_free(log)
    torques, speeds = log.torques, log.wheel_speeds
    if torques.shape[1] != robot.wheel_count or speeds.shape[1] != robot.wheel_count:
        raise InputError(
            f"The log has torques of {torques.shape[1]} wheels and speeds of "
            f"{speeds.shape[1]} wheels; {robot.name} has {robot.wheel_count} wheels."
        )
    for i in range(robot.wheel_count):
        if np.ptp(torques[:, i]) == 0.0:
            raise InputError(
                f"u{i + 1} is {torques[0, i]:g} N m throughout; the "
                "torque of a sweep must vary slowly up and down."
            )
    if limit is not None and not limit > 0.0:
        raise InputError(f"The speed limit is {limit:g} rad/s; it must be above zero.")
    highest = float(np.abs(speeds).max()) if limit is None else limit
    if not highest > 0.0:
        raise InputError("The wheels never turn in this log; a sweep must go well beyond break-away.")
    angles = [_angle(log, name) for name in wheel_angle_names(robot.wheel_count)]
    return [
        Sweep(
            wheel=i + 1,
            t=log.t,
            torque=torques[:, i] + back_emf * speeds[:, i],
            speed=speeds[:, i],
            limit=highest,
            inertia=Driveline.of_wheel(robot, i).inertia,
            brake=back_emf,
            angle=angles[i],
            play=robot.drive.backlash,
            rotor_inertia=Driveline.of_wheel(robot, i).inertia - robot.wheels.inertia,
        )
        for i in range(robot.wheel_count)
    ]


def _angle(log: Log, name: str) -> NDArray[np.float64] | None:
    """Return a column of angles; None if the log lacks it or some angles are missing."""
    return log[name] if name in log and np.isfinite(log[name]).all() else None


def fit_driveline(
    sweep: Sweep,
    *,
    space: ParameterSpace = DRIVELINE_PARAMETERS,
    generations: int = 120,
    population: int = 20,
    run: Run = DEFAULT_RUN,
) -> DrivelineFit:
    """Find one driveline's five parameters from the pieces of its sweep.

    Raises
    ------
    InputError
        If the sweep has no piece to compare, or determines none of the five.
    """
    pieces = sweep.pieces()
    track = sweep.track()
    if not pieces or track.moving.sum() < _LEAST_MOVING:
        raise InputError(
            f"Wheel {sweep.wheel} is at rest or at its speed limit of "
            f"{sweep.limit:.3g} rad/s throughout, or the log is too short."
        )

    def errors(values: NDArray[np.float64]) -> NDArray[np.float64]:
        predicted = _predict_pieces(sweep, pieces, values)
        return np.concatenate(
            [p - sweep.speed[a:b] for p, (a, b) in zip(predicted, pieces, strict=True)], axis=1
        )

    best = _evolve(lambda values: np.linalg.norm(errors(values), axis=1), space, generations, population, run)
    found = estimate_driveline(track, best, space=space, play=sweep.play)
    known = np.sqrt(found.covariance.diagonal()) <= _UNKNOWN  # false without a standard error
    if not np.any(known & (np.minimum(found.point, 1.0 - found.point) > NEAR_BOUND)):
        raise InputError(
            f"The sweep of wheel {sweep.wheel} identifies none of {', '.join(NAMES)}: all end at a "
            "bound or have no effect. Sweep slowly and well beyond break-away, or widen the bounds."
        )
    return _result(sweep, pieces, errors(space.physical(found.point[None]))[0], found, space=space)


def _result(
    sweep: Sweep,
    pieces: Sequence[tuple[int, int]],
    residual: NDArray[np.float64],
    found: DrivelineEstimate,
    *,
    space: ParameterSpace,
) -> DrivelineFit:
    """Return the fit of an estimate whose simulation leaves the residual (m,) [rad/s]."""
    z, covariance = found.point, found.covariance
    values = space.physical(z)
    scaled_errors = np.sqrt(covariance.diagonal())
    at_bound = (z <= AT_BOUND) | (z >= 1.0 - AT_BOUND)
    # one without influence has no standard error though it is at no bound; v_s and delta shape nothing if s is zero
    unknown = np.where(np.isnan(scaled_errors), ~at_bound, scaled_errors > _UNKNOWN)
    unknown[3:] |= values[2] == 0.0
    predicted = np.full(len(sweep.t), np.nan)
    for piece, (first, end) in zip(_predict_pieces(sweep, pieces, values[None]), pieces, strict=True):
        predicted[first:end] = piece[0]
    without = _predict_clamped(sweep, np.array([[0.0, 0.0, 0.0, 1.0, 1.0]]))[0]
    return DrivelineFit(
        wheel=sweep.wheel,
        values=values,
        standard_errors=scaled_errors * space.slopes(z),
        unknown=unknown,
        correlation=covariance / np.outer(scaled_errors, scaled_errors),
        intervals={name: one for name, one in found.intervals.items() if not unknown[NAMES.index(name)]},
        delay=found.delay,
        innovation=found.rms,
        cost=float(np.linalg.norm(residual)),
        samples=len(residual),
        rmse=_rms(residual),
        rmse_without=_rms(without - sweep.speed),
        predicted=predicted,
        without=without,
    )


def fit_as_printed(
    sweep: Sweep,
    fit: DrivelineFit,
    *,
    space: ParameterSpace = DRIVELINE_PARAMETERS,
    generations: int = 60,
    population: int = 16,
    run: Run = DEFAULT_RUN,
) -> PrintedFit:
    """Find the five parameters with the clamp (3.2) as printed, over the whole sweep."""

    def costs(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.linalg.norm(_predict_clamped(sweep, values) - sweep.speed, axis=1)

    best = space.physical(_evolve(costs, space, generations, population, run))
    predicted, restarted = _predict_clamped(sweep, np.stack([best, fit.values]))
    return PrintedFit(
        values=best,
        rmse=_rms(predicted - sweep.speed),
        predicted=predicted,
        rmse_restarted=_rms(restarted - sweep.speed),
    )


def _evolve(
    costs: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    space: ParameterSpace,
    generations: int,
    population: int,
    run: Run,
) -> NDArray[np.float64]:
    """Return the best scaled parameters (5,) of an evolution strategy."""
    evolved = evolve(
        lambda drawn: np.log(costs(space.physical(space.from_search(drawn)))),
        size=len(space.parameters),
        generations=generations,
        population=population,
        run=run,
    )
    return space.from_search(evolved.best)


def _predict_pieces(
    sweep: Sweep, pieces: Sequence[tuple[int, int]], values: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Return each piece's speeds (sets, rows), from the measured speed at its start."""
    lines = [sweep.driveline(one) for one in values]
    predicted = []
    for first, end in pieces:
        start = float(sweep.speed[first])
        motion = simulate_drivelines(
            lines,
            sweep.torque[first : end - 1],
            sample_time=sweep.sample_time,
            step=2.5e-3,
            initial_speeds=start,
        )
        predicted.append(np.concatenate([np.full((len(lines), 1), start), motion.speeds], axis=1))
    return predicted


def _predict_clamped(sweep: Sweep, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return speeds (sets, N) over the whole sweep with the clamp (3.2)."""
    clamp = SpeedClamp(limit=sweep.limit)
    lines = [sweep.driveline(one, clamp=clamp) for one in values]
    motion = simulate_drivelines(
        lines,
        sweep.torque[:-1],
        sample_time=sweep.sample_time,
        step=5e-3,
        initial_speeds=float(sweep.speed[0]),
    )
    return np.concatenate([np.full((len(lines), 1), sweep.speed[0]), motion.speeds], axis=1)


def _rms(errors: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def fit_drivelines(
    sweeps: Sequence[Sweep], *, space: ParameterSpace, run: Run = DEFAULT_RUN
) -> tuple[list[DrivelineFit], list[PrintedFit]]:
    """Fit every wheel twice: to the pieces of its sweep, and with the clamp (3.2) as printed.

    The note of the progress is the error so far.
    """
    fits: list[DrivelineFit] = []
    printed: list[PrintedFit] = []

    def report(now: Progress) -> None:
        run.progress(replace(now, note=f"error {math.exp(now.cost):.4g}"))

    for i, sweep in enumerate(sweeps):
        of_wheel = replace(run, progress=in_stage(report, f"wheel {i + 1}"))
        fits.append(fit_driveline(sweep, space=space, run=of_wheel))
        printed.append(fit_as_printed(sweep, fits[-1], space=space, run=of_wheel))
    return fits, printed
