"""A mapping proposed for a foreign log, with the evidence for it.

The direction in which the wheels count follows from the heading, which turns all wheels alike:

    sum_i w_i = n (r_b / r_w) sin(alpha) (spin of the ball - psi_dot)

in the body frame. A ball spins less than the body that turns on it, or in the opposite direction, so that the sum has
the opposite sign to psi_dot. Nothing else distinguishes wheels that all count backwards from an IMU turned by half a
turn.

The wheels' order and the turn of the IMU follow from the test of their placement. A log satisfies
Theta_ddot = g e^(j phase) sum_i s_i w_i e^(j +-beta_i). Turned by -phase, the IMU's lean is the robot's. In a mirrored
log, wheel 1 keeps its place and the others are in reverse order, which turns it by twice wheel 1's azimuth; reversing
all signs turns it by half a turn.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.formats import read_foreign_table
from ballbot.log.formats.text import ForeignTable
from ballbot.log.mapping import without_resets
from ballbot.log.mapping_inference.placement import (
    COMMAND_WIDTH,
    CommandTest,
    LeanTest,
    command_test,
    held_commands,
    lean_test,
    wheel_signs,
)
from ballbot.log.mapping_inference.roles import (
    Roles,
    Scale,
    duty_scale,
    lean_scale,
    roles_by_data,
    roles_by_name,
    wheel_scale,
)
from ballbot.log.signals import (
    INTERVAL,
    Smooth,
    balancing_rows,
    even_rows,
    new_messages,
    repaired_noise,
    row_spans,
    sampling_times,
    smooth,
    speed_noise,
)
from ballbot.robot import Robot
from ballbot.robot.derived import wheel_speed_limit

#: a correlation over n independent seconds is significant above so many of its standard deviations, 1 / sqrt(n)
LEAST_CORRELATION = 2.5


@dataclass(frozen=True, kw_only=True)
class HeadingTest:
    """Correlation of the sum of the wheels' speeds with the heading's rate."""

    correlation: float  #: negative if the wheels count as the robot's do
    gain: float  #: sum of the speeds over psi_dot, over that of a ball that does not pivot
    significant: bool  #: whether the log turns enough for a conclusion

    @property
    def backwards(self) -> bool:
        """Whether all wheels count backwards."""
        return self.significant and self.correlation > 0.0


def heading_test(robot: Robot, wheels: Smooth, heading: Smooth, tested: LeanTest) -> HeadingTest:
    """Compare the sum of the wheels' speeds with the heading's rate.

    Parameters
    ----------
    robot : Robot
    wheels : Smooth (N, n)
    heading : Smooth (N, 1)
    tested : LeanTest
        Gives the reversed wheel and the rows of balancing.
    """
    rows = tested.balancing
    total = (wheels.rate @ wheel_signs(robot.wheel_count, tested.placements[0].flipped))[rows]
    rate = heading.rate[rows, 0]
    total, rate = total - total.mean(), rate - rate.mean()
    size = float(np.sqrt((total @ total) * (rate @ rate)))
    correlation = float(total @ rate) / size if size > 0.0 else 0.0
    wheel = robot.wheels
    without_pivoting = robot.wheel_count * robot.ball.radius / wheel.radius * np.sin(wheel.tilt)
    seconds = float(rows.sum()) * INTERVAL
    return HeadingTest(
        correlation=correlation,
        gain=float(total @ rate / max(float(rate @ rate), 1e-300) / without_pivoting),
        significant=bool(abs(correlation) > LEAST_CORRELATION / np.sqrt(max(seconds, 1.0))),
    )


#: IMUs are usually mounted at multiples of this angle [rad]
GRID = np.pi / 6.0
#: a turn is rounded to a multiple within this [rad]
ROUNDED = np.deg2rad(6.0)


@dataclass(frozen=True, kw_only=True)
class Frame:
    """Order, signs and turn of the file's wheels and IMU relative to the robot's."""

    order: tuple[int, ...]  #: for the robot's wheels in turn, the file's wheel (from 1)
    signs: tuple[int, ...]  #: of the file's wheels, in the file's order
    turn: float  #: of the IMU's x axis from the robot's [rad], rounded to `GRID` if it is near
    measured_turn: float  #: [rad], before rounding
    signs_by_heading: bool  #: whether the direction in which all wheels count is measured, or assumed


def frame_of(robot: Robot, tested: LeanTest | None, heading: HeadingTest | None) -> Frame:
    """Return the frame of the tests' results; the robot's own if there is no lean to test."""
    count = robot.wheel_count
    own = tuple(range(1, count + 1))
    if tested is None:
        return Frame(order=own, signs=(1,) * count, turn=0.0, measured_turn=0.0, signs_by_heading=False)
    best = tested.placements[0]
    order = (1, *range(count, 1, -1)) if best.mirrored else own
    phase = best.phase - (2.0 * robot.wheels.azimuths[0] if best.mirrored else 0.0)
    known = heading is not None and heading.significant
    # without heading, the smaller turn is more likely
    backwards = heading.backwards if heading is not None and known else np.cos(phase) < 0.0
    signs = wheel_signs(count, best.flipped) * (-1.0 if backwards else 1.0)
    turn = -_within_half_a_turn(phase + (np.pi if backwards else 0.0))
    near = GRID * round(turn / GRID)
    return Frame(
        order=order,
        signs=tuple(int(sign) for sign in signs),
        turn=float(near if abs(turn - near) <= ROUNDED else turn),
        measured_turn=float(turn),
        signs_by_heading=known,
    )


def _within_half_a_turn(angle: float) -> float:
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


#: the repair is proposed if it leaves less than this fraction of the speed's noise
WORTH_REPAIRING = 0.7
#: an encoder was reset if its wheel seems faster than so many times the drive's limit
IMPOSSIBLE_SPEED = 3.0


@dataclass(frozen=True, kw_only=True)
class TimingRepair:
    """Noise of the wheel speeds with the rows' times and with those estimated from the encoders."""

    before: float | None  #: speed noise with the rows' own times [rad/s]; None if the wheels are too slow
    after: float | None  #: the same with the encoders' times, each wheel with those of the others
    worth_it: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """The inferred mapping of a foreign log with its evidence; `ballbot.log.mapping_inference.report` writes it."""

    table: ForeignTable
    roles: Roles
    by_data: bool  #: whether the columns were recognised by their values, not their names
    rows: tuple[int, int] | None  #: first and last row to take, from 1; None for all
    wheel: Scale
    largest_speed: float | None  #: [rad/s], if an encoder was reset; else None
    lean: Scale | None
    duty: Scale | None
    timing: TimingRepair
    lean_test: LeanTest | None
    heading: HeadingTest | None
    commands: CommandTest | None
    frame: Frame
    keep: tuple[tuple[float, float], ...] | None  #: intervals of balancing [s]; None keeps all
    sample_time: float  #: of even rows [s]
    signals: Signals


@dataclass(frozen=True, kw_only=True, eq=False)
class Signals:
    """The log on even rows, as tested."""

    rows: NDArray[np.float64]  #: (N,) [s]
    wheels: Smooth  #: (N, n)
    lean: Smooth | None  #: (N, 2)
    heading: Smooth | None  #: (N, 1)
    commands: NDArray[np.float64] | None  #: (N, n), held
    usable: NDArray[np.bool_]  #: (N,), moving and not fallen


def propose(path: str | Path, robot: Robot) -> Proposal:
    """Read a foreign log and propose how it becomes one of Ballbot's.

    Parameters
    ----------
    path : str or Path
        A table of text, with or without a header, or Parquet.
    robot : Robot
        Gives geometry, encoders and drives.

    Raises
    ------
    InputError
        If the file is no table, or neither names nor values show the time and the wheels' angles.
    """
    table = read_foreign_table(path)
    roles, by_data = _roles(path, table, robot)
    first, last = _longest_rise(table.columns[_time_of(roles)])
    whole = (first, last) == (0, len(table.columns[_time_of(roles)]))
    columns = {name: values[first:last] for name, values in table.columns.items()}
    raw = _Raw.of(columns, roles)
    wheel = wheel_scale(raw.angles, robot)
    limit = IMPOSSIBLE_SPEED * _speed_limit(robot)
    angles = raw.angles * wheel.factor
    carried = np.column_stack([without_resets(raw.t, column, limit) for column in angles.T])
    reset = not np.allclose(carried, angles, atol=1e-6)
    timing, sampled = _timing(raw.t, carried)
    lean = lean_scale(raw.attitude[:, :2]) if raw.attitude is not None else None
    signals = _signals(raw, carried, sampled, lean)
    tested = _test_lean(robot, signals)
    heading = _test_heading(signals, tested, robot)
    frame = frame_of(robot, tested, heading)
    usable = tested.balancing if tested else signals.usable
    return Proposal(
        table=table,
        roles=roles,
        by_data=by_data,
        rows=None if whole else (first + 1, last),
        wheel=wheel,
        largest_speed=limit if reset else None,
        lean=lean,
        duty=duty_scale(raw.commands) if raw.commands is not None else None,
        timing=timing,
        lean_test=tested,
        heading=heading,
        # all wheels with the same direction of counting
        commands=_test_commands(signals, carried * np.asarray(frame.signs), sampled, usable),
        frame=frame,
        keep=_keep(signals, tested),
        sample_time=_sample_time(raw.t),
        signals=signals,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Raw:
    """The columns that have a role, as the file has them."""

    t: NDArray[np.float64]
    angles: NDArray[np.float64]
    attitude: NDArray[np.float64] | None
    commands: NDArray[np.float64] | None

    @staticmethod
    def of(columns: dict[str, NDArray[np.float64]], roles: Roles) -> _Raw:
        t = columns[_time_of(roles)]

        def stacked(names: tuple[str, ...]) -> NDArray[np.float64] | None:
            return np.column_stack([_filled(columns[name]) for name in names]) if names else None

        angles = stacked(roles.angles)
        if angles is None:
            raise InputError("No wheel angles were found.")
        return _Raw(t=t, angles=angles, attitude=stacked(roles.attitude), commands=stacked(roles.commands))


def _roles(path: str | Path, table: ForeignTable, robot: Robot) -> tuple[Roles, bool]:
    named = roles_by_name(table.columns, wheel_count=robot.wheel_count)
    if table.named and named.time is not None and named.angles:
        return named, False
    found = roles_by_data(table.columns, robot)
    if found is None:
        raise InputError(
            f"{path}: neither names nor numbers show which columns are the time, the lean and the "
            f"wheel angles; write a mapping file (the columns are {', '.join(table.columns)})."
        )
    return found, True


def _time_of(roles: Roles) -> str:
    if roles.time is None:
        raise InputError("No column of time was found.")
    return roles.time


def _longest_rise(t: NDArray[np.float64]) -> tuple[int, int]:
    """Return first row and end of the longest interval of increasing time."""
    breaks = np.flatnonzero(~(np.diff(t) > 0.0)) + 1
    edges = np.concatenate(([0], breaks, [len(t)]))
    longest = int(np.argmax(np.diff(edges)))
    return int(edges[longest]), int(edges[longest + 1])


def _filled(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a column with missing values interpolated."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.where(known, values, 0.0)
    places = np.arange(len(values))
    return np.interp(places, places[known], values[known])


def _speed_limit(robot: Robot) -> float:
    drive = robot.drive
    return wheel_speed_limit(
        supply_voltage=drive.supply_voltage, speed_constant=drive.speed_constant, gear_ratio=drive.gear_ratio
    )


def _timing(t: NDArray[np.float64], angles: NDArray[np.float64]) -> tuple[TimingRepair, NDArray[np.float64]]:
    before = speed_noise(t, angles)
    after = repaired_noise(t, angles) if before is not None else None
    worth_it = before is not None and after is not None and after < WORTH_REPAIRING * before
    repair = TimingRepair(before=before, after=after, worth_it=worth_it)
    return repair, sampling_times(t, angles) if worth_it else t


def _signals(
    raw: _Raw, angles: NDArray[np.float64], sampled: NDArray[np.float64], lean: Scale | None
) -> Signals:
    rows, kept = even_rows(raw.t), new_messages(sampled)
    wheels = smooth(rows, sampled[kept], angles[kept])
    commands = held_commands(rows, raw.t, raw.commands) if raw.commands is not None else None
    tilt, heading = None, None
    if raw.attitude is not None and lean is not None:
        attitude = raw.attitude * lean.factor
        tilt = smooth(rows, sampled[kept], attitude[kept, :2])
        if attitude.shape[1] > 2:
            heading = smooth(rows, sampled[kept], np.unwrap(attitude[kept, 2:], axis=0))
    return Signals(
        rows=rows,
        wheels=wheels,
        lean=tilt,
        heading=heading,
        commands=commands,
        usable=balancing_rows(tilt.value if tilt else None, wheels.rate, commands),
    )


def _test_lean(robot: Robot, signals: Signals) -> LeanTest | None:
    if signals.lean is None:
        return None
    return lean_test(robot, signals.lean, signals.wheels, signals.heading, signals.usable)


def _test_heading(signals: Signals, tested: LeanTest | None, robot: Robot) -> HeadingTest | None:
    if signals.heading is None or tested is None:
        return None
    return heading_test(robot, signals.wheels, signals.heading, tested)


def _test_commands(
    signals: Signals,
    angles: NDArray[np.float64],
    sampled: NDArray[np.float64],
    usable: NDArray[np.bool_],
) -> CommandTest | None:
    if signals.commands is None:
        return None
    kept = new_messages(sampled)
    quick = smooth(signals.rows, sampled[kept], angles[kept], width=COMMAND_WIDTH)
    return command_test(signals.rows, quick, signals.commands, usable)


def _keep(signals: Signals, tested: LeanTest | None) -> tuple[tuple[float, float], ...] | None:
    if tested is None:
        return None
    kept = row_spans(signals.rows, signals.usable & ~tested.pushed)
    return kept or None


def _sample_time(t: NDArray[np.float64]) -> float:
    """Return an even interval near the rows' own: 5 ms or a multiple, or 1 ms for faster rows."""
    usual = float(np.median(np.diff(t)))
    return max(0.005 * int(usual / 0.005 + 0.1), 0.001)
