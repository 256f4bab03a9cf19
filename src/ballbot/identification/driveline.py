"""Stage one of the thesis (3.1 to 3.5): the drivelines with free wheels, each an axis of known inertia.

    (j_w + j_r) w_dot = u - offset - (b w + (c + s exp(-|w/v_s|^delta)) sgn(w))

Rows at the supply's speed limit are left out as gaps, because the recorded torque does not act there. A slow sweep
passes the low speeds in a few tenths of a second: delta is then held at 1, and the errors include those of others.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbot.arrays import Floats, Ints
from ballbot.errors import InputError
from ballbot.findings import Finding
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.uncertainty import correlation
from ballbot.identification.axis import AxisOptions, AxisRecord, identify_axis, record_of_rows
from ballbot.identification.axis.model import Axis
from ballbot.identification.axis.record import LEAST_ROWS
from ballbot.identification.quantities import BY_NAME, FRICTION, Layout
from ballbot.identification.stated_uncertainty import StageEstimate, with_uncertainty
from ballbot.log import Log
from ballbot.log.columns import wheel_angle_names
from ballbot.robot import Friction, Robot
from ballbot.simulation.driveline import Driveline

#: quantities that a sweep identifies of each wheel, and their symbols
QUANTITIES = tuple(BY_NAME[name] for name in FRICTION if name != "rolling")
NAMES = tuple(quantity.symbol for quantity in QUANTITIES)
BALL_NAMES = ("ball_omega_x", "ball_omega_y", "ball_omega_z")
#: largest root mean square lean of a body held still, without sensor noise [rad]; one that balances has half a degree
#: and more
_STILL = np.radians(0.2)
#: the speed counts as limited above this share of the limit
LIMITED = 0.995
_SHORTEST_PIECE = 0.5  # [s]
#: an angle that differs by more from the integral of the speed between two rows wraps, or was reset [rad]
_LARGEST_JUMP = 0.5


def check_wheels_free(log: Log) -> None:
    """Raise InputError if the robot balances, or has the ball on its wheels, as far as the log shows it."""
    known = {name: log[name][np.isfinite(log[name])] for name in ("theta", "phi", *BALL_NAMES) if name in log}
    for name, values in known.items():
        if name in BALL_NAMES and values.any():
            raise InputError(
                f"In this log a ball turns ({name}). A sweep needs the wheels off the ball; "
                "use `ballbot identify-upside-down` for logs of the ball on the clamped robot."
            )
        # without white noise, which the changes from row to row show
        noise = 0.5 * np.mean(np.diff(values) ** 2) if len(values) > 1 else np.inf
        if name not in BALL_NAMES and np.var(values) - noise > _STILL**2:
            sway = np.degrees(np.sqrt(np.var(values) - noise))
            raise InputError(
                f"In this log the body sways by {sway:.2g} degrees (root mean square of {name}), as when it balances. "
                "A sweep needs the body held still and the wheels off the ball; use `ballbot identify` for logs of a "
                "balancing robot."
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """One wheel's sweep."""

    wheel: int  #: from 1
    t: Floats  #: (N,) [s]
    torque: Floats  #: (N,) [N m]
    speed: Floats  #: (N,) [rad/s]
    limit: float  #: l [rad/s]
    inertia: float  #: j_w + j_r [kg m^2]
    angle: Floats | None = None  #: (N,) of the encoder at the wheel [rad]

    @property
    def sample_time(self) -> float:
        """[s]"""
        return float(self.t[-1] - self.t[0]) / (len(self.t) - 1)

    def pieces(self) -> Ints:
        """Return the first row and the row after the last (k, 2) of each piece without speed limit."""
        free = np.abs(self.speed) < LIMITED * self.limit
        edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]))).reshape(-1, 2)
        return edges[np.diff(edges, axis=1)[:, 0] >= _SHORTEST_PIECE / self.sample_time]

    def record(self) -> AxisRecord:
        """Return these pieces as a record of an axis; InputError if they are too short."""
        rows = np.concatenate([np.arange(a, b) for a, b in self.pieces()] or [np.empty(0, dtype=int)])
        if len(rows) < LEAST_ROWS:
            raise InputError(
                f"Wheel {self.wheel}: {len(rows)} rows are below the speed limit of {self.limit:.3g} rad/s in pieces "
                f"of {_SHORTEST_PIECE:g} s and more; at least {LEAST_ROWS} are needed. Log for longer, at lower speeds."
            )
        travels = 0.5 * np.diff(self.t) * (self.speed[1:] + self.speed[:-1])
        position = self.angle
        if position is None or np.abs(np.diff(position) - travels).max() > _LARGEST_JUMP:
            position = np.append(0.0, np.cumsum(travels))
        return record_of_rows(
            f"wheel {self.wheel}", self.t[rows], self.torque[rows], position[rows], unit="rad"
        )


def sweeps_of(robot: Robot, log: Log) -> list[Sweep]:
    """Return each wheel's sweep; the supply's limit is the greatest speed in the log.

    InputError if the log lacks torques or wheel speeds or has them of another number of wheels, or its wheels were not
    free of the ball, or never turned.

    >>> t = 0.005 * np.arange(1000)
    >>> columns = {f"u{i}": np.sin(t) for i in (1, 2, 3)} | {f"wheel{i}_dot": 5.0 * np.sin(t) for i in (1, 2, 3)}
    >>> sweep, *_ = sweeps_of(Robot.load("alten"), Log({"t": t, **columns}))
    >>> sweep.wheel, round(sweep.limit, 1)  # [rad/s]
    (1, 5.0)
    """
    check_wheels_free(log)
    torques, speeds = log.torques, log.wheel_speeds
    if torques.shape[1] != robot.wheel_count or speeds.shape[1] != robot.wheel_count:
        raise InputError(
            f"The log has torques of {torques.shape[1]} wheels and speeds of "
            f"{speeds.shape[1]} wheels; {robot.name} has {robot.wheel_count} wheels."
        )
    for i in np.flatnonzero(np.ptp(torques, axis=0) == 0.0):
        raise InputError(
            f"u{i + 1} is {torques[0, i]:g} N m throughout; the torque of a sweep must vary slowly up and down."
        )
    highest = float(np.abs(speeds).max())
    if not highest > 0.0:
        raise InputError("The wheels of this log never turn; it needs a sweep well beyond break-away.")
    return [
        Sweep(
            wheel=i + 1,
            t=log.t,
            torque=torques[:, i],
            speed=speeds[:, i],
            limit=highest,
            inertia=Driveline.of_wheel(robot, i).inertia,
            angle=log[name] if name in log and np.isfinite(log[name]).all() else None,
        )
        for i, name in enumerate(wheel_angle_names(robot.wheel_count))
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivelineFit:
    """One driveline's friction."""

    wheel: int  #: from 1
    values: Floats  #: (5,) b, c, s, v_s, delta
    standard_errors: Floats  #: (5,), NaN at a bound, and of v_s if s is zero
    intervals: Floats  #: (5, 2) ends of the 95 % intervals; friction is not below zero
    correlation: Floats  #: (5, 5), zero between those of which one has no standard error
    predicted: Floats  #: (N,) speed [rad/s], each piece from its first; NaN where it is limited
    without: Floats  #: (N,) without friction, the speed clamped as in (3.2)
    rmse: float  #: of `predicted` [rad/s]
    rmse_without: float  #: of `without` [rad/s]
    findings: tuple[Finding, ...] = ()

    @property
    def friction(self) -> Friction:
        """The identified friction of one wheel."""
        return friction_of(self.values)


def friction_of(values: Floats) -> Friction:
    """Return the friction of one wheel by b, c, s, v_s, delta (5,)."""
    names = (quantity.name for quantity in QUANTITIES)
    return Axis(values=dict(zip(names, values.tolist(), strict=True))).law


def fit_driveline(sweep: Sweep, *, run: Run = DEFAULT_RUN) -> DrivelineFit:
    """Identify one driveline's friction from the pieces of its sweep.

    InputError if the sweep does not determine it.

    >>> from ballbot.simulation.driveline import simulate_driveline
    >>> t = 0.005 * np.arange(4000)
    >>> torque = np.sin(2.0 * np.pi * t / 20.0)
    >>> line = Driveline(inertia=0.003, friction=friction_of(np.array([0.012, 0.05, 0.03, 0.7, 1.0])))
    >>> motion = simulate_driveline(line, torque[:-1], sample_time=0.005)
    >>> speed, angle = (np.append(0.0, column) for column in (motion.speeds, motion.angles))
    >>> sweep = Sweep(wheel=1, t=t, torque=torque, speed=speed, limit=27.7, inertia=0.003, angle=angle)
    >>> np.round(fit_driveline(sweep).values, 3)  # b [N m s/rad], c and s [N m], v_s [rad/s], delta
    array([0.012, 0.05 , 0.03 , 0.7  , 1.   ])
    """
    # the law of a robot file; a free wheel has no weight, and its ripple averages out over a sweep
    options = AxisOptions(law="stribeck", gravity=False, load_friction=False)
    result = identify_axis(sweep.record(), options=options, known={"mass": sweep.inertia}, run=run)
    best = result.best
    rows = [list(best.values).index(quantity.name) for quantity in QUANTITIES]
    tables = (best.values, best.standard_errors, best.half_widths)
    values, errors, halves = (np.array(list(table.values()))[rows] for table in tables)
    # a robot file has no constant torque
    axis = Axis(values={**best.values, "mass": sweep.inertia, "offset": 0.0})
    firsts, ends = sweep.pieces().T.copy()
    starts = np.column_stack([np.zeros(len(firsts)), sweep.speed[firsts]])
    states = axis.windows(sweep.torque, sweep.sample_time, firsts, ends - firsts - 1, starts)
    predicted = np.full(len(sweep.t), np.nan)
    predicted[firsts] = sweep.speed[firsts]
    predicted[np.concatenate([np.arange(a + 1, b) for a, b in sweep.pieces()])] = states[:, 1]
    # (3.2) clamps the output and not the state, which winds up
    gained = np.cumsum(sweep.torque[:-1]) * sweep.sample_time / sweep.inertia
    without = np.clip(sweep.speed[0] + np.append(0.0, gained), -sweep.limit, sweep.limit)
    return DrivelineFit(
        wheel=sweep.wheel,
        values=values,
        standard_errors=errors,
        intervals=np.column_stack([np.maximum(values - halves, 0.0), values + halves]),
        correlation=np.nan_to_num(correlation(best.fit.covariance)[np.ix_(rows, rows)]),
        predicted=predicted,
        without=without,
        rmse=float(np.sqrt(np.nanmean((predicted - sweep.speed) ** 2))),
        rmse_without=float(np.sqrt(np.mean((without - sweep.speed) ** 2))),
        findings=tuple(
            replace(finding, text=f"Wheel {sweep.wheel}: {finding.text}")
            for finding in result.findings
            if finding.code != "law"
        ),
    )


def robot_with_friction(robot: Robot, estimate: StageEstimate, *, source: str) -> Robot:
    """Return the robot with the friction of its drivelines, with standard deviations and correlations.

    `estimate` has b, c and s of each wheel, v_s and delta (3 n + 2). These last two are NaN if no wheel has s; a delta
    of 1 was held.
    """
    layout, own = Layout(wheel_count=robot.wheel_count), robot.friction
    empty = replace(Friction.none(robot.wheel_count), rolling=own.rolling)

    def robot_of(numbers: Floats) -> Robot:
        numbers = np.append(numbers, own.rolling)
        known = np.where(np.isfinite(numbers), numbers, layout.nominal(robot))
        return layout.robot_of(robot.replace(friction=empty), known)

    names = [f"friction.{quantity.name}" for quantity in QUANTITIES]
    moved = robot_of(estimate.values)
    sources = {**moved.sources, **dict.fromkeys(names, source)}
    if estimate.values[-1] == 1.0:
        sources[names[-1]] = f"assumed: {estimate.source} does not determine it"
    return with_uncertainty(
        moved.annotated(sources=sources), robot_of, estimate.values, estimate.covariance, names=names
    )


def sweep_estimate(fits: Sequence[DrivelineFit]) -> StageEstimate:
    """Return b, c and s of all wheels and the v_s and delta of a robot file, with their covariance.

    The latter are means over the wheels that determine v_s. Their standard deviations are those of a single wheel's
    value, from the errors of the mean and the scatter of the wheels, and at least from a single wheel's errors.
    """
    count = len(fits)
    faded = np.array([np.isfinite(fit.standard_errors[3]) for fit in fits])
    values, C = np.zeros(3 * count + 2), np.zeros((3 * count + 2, 3 * count + 2))
    for number, fit in enumerate(fits):
        # the wheel's b, c, s and its share in v_s and delta
        T = np.zeros((3 * count + 2, 5))
        T[[number, count + number, 2 * count + number], range(3)] = 1.0
        T[[-2, -1], [3, 4]] = faded[number] / max(faded.sum(), 1)
        errors = np.nan_to_num(fit.standard_errors)
        C += T @ (fit.correlation * np.outer(errors, errors)) @ T.T
        values += T @ fit.values
    rows = np.array([[fit.values[3:], fit.standard_errors[3:]] for fit in fits])[faded]
    values[-2:] = rows[:, 0].mean(axis=0) if len(rows) else np.nan
    if len(rows):
        scatter = np.var(rows[:, 0], axis=0, ddof=1) if len(rows) > 1 else 0.0
        C[[-2, -1], [-2, -1]] = np.maximum(C.diagonal()[-2:] + scatter, np.mean(rows[:, 1] ** 2, axis=0))
    return StageEstimate("the sweep", Layout(wheel_count=count).labels[:-1], values, C)
