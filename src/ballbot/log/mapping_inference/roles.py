"""The role and the unit of each column of a foreign log, by its name or by its values.

Names are compared in lower case without separators, so that `psi_1`, `Psi1` and `PSI[1]` are equal. A series is columns
whose names differ only in a number 1 to 3 (or 0 to 2).

Without a header, or with meaningless names, the values decide. Time increases by small uneven steps. Roll and pitch,
and the wheels' angles in their order, are neighbouring columns: those whose accelerations agree best with the ball's
rolling (`ballbot.log.mapping_inference.placement`), in any units. A sensor's steps
distinguish its columns from those computed from them. The commands are those neighbours that explain the wheels'
accelerations best.

Units follow from the encoder's step, from sizes, and from the gain of the kinematics.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log.mapping_inference.placement import (
    COMMAND_WIDTH,
    command_test,
    held_commands,
    torque_free_gains,
)
from ballbot.log.signals import MOVING_SPEED, Smooth, even_rows, smooth
from ballbot.robot import Robot

#: relative tolerance of a step that is taken for an encoder's
STEP_AGREEMENT = 0.02
#: if a tenth of the rows exceed this lean, the angle is not in radians
LEAN_IN_RADIANS = 0.35
#: largest numbers that drivers and libraries call full duty
FULL_DUTIES = (1.0, 100.0, 127.0, 255.0, 1000.0, 1023.0, 4095.0, 32639.0, 32767.0, 65535.0)


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Conversion of a column to Ballbot's unit, with the reason."""

    unit: str
    factor: float  #: converts the file's number to radians (or full duty to 1), unit and scale in one
    scale: float = 1.0  #: part of the factor besides the unit
    reason: str


def step_of(values: NDArray[np.float64]) -> float | None:
    """Return the smallest step of which all steps of a column are multiples; None if there is no such step."""
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    steps = steps[steps > 1e-9]
    if len(steps) < 20:
        return None
    step = float(np.quantile(steps, 0.001, method="lower"))
    multiples = steps[steps < 20.5 * step] / step
    whole = np.abs(multiples - np.round(multiples)) < 0.05
    return step if len(multiples) >= 20 and whole.mean() > 0.95 else None


def wheel_scale(angles: NDArray[np.float64], robot: Robot) -> Scale:
    """Return the unit of wheel angles (N, n) in the file, by the encoder's step if it is visible."""
    turn = float(robot.sensors.encoder_counts * robot.drive.gear_ratio)
    steps = [step_of(column) for column in angles.T]
    known = [step for step in steps if step is not None]
    step = float(np.median(known)) if known else None
    if step is not None and abs(step - 1.0) < 1e-6:
        reason = f"whole numbers; the robot's encoder has {turn:g} counts a turn of the wheel"
        return Scale(unit="counts", factor=2.0 * math.pi / turn, reason=reason)
    gear = robot.drive.gear_ratio
    candidates = (
        Scale(unit="rad", factor=1.0, reason="one encoder count in radians"),
        Scale(unit="deg", factor=math.pi / 180.0, reason="one encoder count in degrees"),
        Scale(unit="turn", factor=2.0 * math.pi, reason="one encoder count in turns"),
        Scale(
            unit="rad", factor=1.0 / gear, scale=1.0 / gear, reason="one encoder count, the motor's radians"
        ),
        Scale(
            unit="deg",
            factor=math.pi / 180.0 / gear,
            scale=1.0 / gear,
            reason="one encoder count, the motor's degrees",
        ),
    )
    if step is not None:
        for scale in candidates:
            ratio = step * scale.factor / (2.0 * math.pi / turn)
            if abs(ratio - 1.0) < STEP_AGREEMENT:
                return Scale(
                    unit=scale.unit,
                    factor=scale.factor,
                    scale=scale.scale,
                    reason=f"steps of {step:.5g} are {scale.reason}",
                )
    return Scale(unit="rad", factor=1.0, reason="assumed: no encoder step was recognised")


def lean_scale(lean: NDArray[np.float64]) -> Scale:
    """Return the unit of roll and pitch (N, 2) by their size."""
    size = float(np.nanquantile(np.abs(lean), 0.9))
    if size > LEAN_IN_RADIANS:
        return Scale(
            unit="deg",
            factor=math.pi / 180.0,
            reason=f"a tenth of the angles exceeds {size:.2g}, too much for radians",
        )
    return Scale(unit="rad", factor=1.0, reason=f"nine tenths of the angles are within {size:.2g}")


def duty_scale(commands: NDArray[np.float64]) -> Scale:
    """Return the scale that makes the full duty 1, by the largest command (N, n)."""
    largest = float(np.nanmax(np.abs(commands)))
    # 1 % for rounding and filters
    full = next((duty for duty in FULL_DUTIES if largest <= 1.01 * duty), largest)
    return Scale(
        unit="duty",
        factor=1.0 / full,
        scale=1.0 / full,
        reason=f"the largest command is {largest:.4g}, so {full:g} is assumed to be full duty",
    )


TIMES = (
    "tnow",
    "t",
    "time",
    "timestamp",
    "ts",
    "tsec",
    "times",
    "seconds",
    "elapsed",
    "elapsedtime",
    "utime",
)
#: pairs or threes of names for roll, pitch and yaw
ATTITUDES = (
    ("roll", "pitch", "yaw"),
    ("thetax", "thetay", "thetaz"),
    ("thetaroll", "thetapitch", "thetayaw"),
    ("imuroll", "imupitch", "imuyaw"),
    ("imux", "imuy", "imuz"),
    ("leanx", "leany", "leanz"),
    ("rpy0", "rpy1", "rpy2"),
    ("rpy1", "rpy2", "rpy3"),
    ("theta1", "theta2", "theta3"),
    ("thetarollrad", "thetapitchrad", "thetayawrad"),
    ("rx", "ry", "rz"),
    ("anglex", "angley", "anglez"),
)
#: stems of wheel angles, of wheel speeds and of motor commands, the likeliest first
ANGLES = (
    "psi",
    "enc",
    "encpos",
    "encoder",
    "encticks",
    "ticks",
    "wheel",
    "wheelangle",
    "pos",
    "q",
    "m",
    "motor",
    "motorpos",
)
SPEEDS = (
    "dpsi",
    "psidot",
    "psid",
    "wheelspeed",
    "wheeldot",
    "dwheel",
    "encdot",
    "denc",
    "vel",
    "w",
    "omega",
    "speed",
    "dq",
)
COMMANDS = (
    "u",
    "motorduty",
    "duty",
    "pwm",
    "motorpwm",
    "motor",
    "t",
    "tau",
    "torque",
    "cmd",
    "motorcmd",
    "command",
    "m",
    "i",
    "current",
)
BODY_COMMANDS = ("tx", "ty", "tz")


@dataclass(frozen=True, kw_only=True)
class Roles:
    """The names of the file's columns by their role; empty or None if there are none."""

    time: str | None
    attitude: tuple[str, ...]  #: roll, pitch and, if there is one, yaw
    angles: tuple[str, ...]  #: a wheel each
    speeds: tuple[str, ...]
    commands: tuple[str, ...]
    body_commands: tuple[
        str, ...
    ]  #: Tx, Ty, Tz: commands about the body's axes, before they go to the wheels


def roles_by_name(names: Iterable[str], *, wheel_count: int) -> Roles:
    """Return the roles by the columns' names."""
    plain = {_plain(name): name for name in reversed(list(names))}
    threes = _numbered(plain, wheel_count)
    angles = _first(threes, ANGLES)
    commands = _first({stem: found for stem, found in threes.items() if found != angles}, COMMANDS)
    return Roles(
        time=next((plain[name] for name in TIMES if name in plain), None),
        attitude=_attitude(plain),
        angles=angles,
        speeds=_first(threes, SPEEDS),
        commands=commands,
        body_commands=tuple(plain[name] for name in BODY_COMMANDS if name in plain),
    )


def _plain(name: str) -> str:
    """Return a name without separators, units in brackets, or case."""
    bare = re.sub(r"[\(\[](?!\d)[^\)\]]*[\)\]]", "", name.lower())
    return re.sub(r"[^a-z0-9]", "", bare)


def _numbered(plain: dict[str, str], count: int) -> dict[str, tuple[str, ...]]:
    """Return the names numbered from 1 (or 0), by their common part."""
    found: dict[str, tuple[str, ...]] = {}
    for name in plain:
        for digit in re.finditer(r"[01]", name):
            before, after, start = name[: digit.start()], name[digit.end() :], int(digit.group())
            series = [f"{before}{start + k}{after}" for k in range(count)]
            if all(member in plain for member in series):
                found.setdefault(before + after, tuple(plain[member] for member in series))
    return found


def _first(threes: dict[str, tuple[str, ...]], stems: tuple[str, ...]) -> tuple[str, ...]:
    return next((threes[stem] for stem in stems if stem in threes), ())


def _attitude(plain: dict[str, str]) -> tuple[str, ...]:
    for roll, pitch, yaw in ATTITUDES:
        if roll in plain and pitch in plain:
            return tuple(plain[name] for name in (roll, pitch, yaw) if name in plain)
    return ()


#: intervals between rows that a log may have [s]
INTERVALS = (2e-4, 0.2)
#: an agreement must be better than an earlier one by this factor, since copies come later in a file
BETTER = 0.98
#: largest unexplained fraction of the lean's acceleration
LARGEST_REST = 0.6
#: a lean beyond so many times its usual size is a fall
FALLEN = 8.0
#: a lean was computed from the wheel angles if their sum explains this fraction of it
COMPUTED = 0.9


def roles_by_data(columns: Mapping[str, NDArray[np.float64]], robot: Robot) -> Roles | None:
    """Return the roles by the columns' values, or None if no lean and wheels agree with a rolling ball.

    Parameters
    ----------
    columns : mapping of str to (M,) array
        In the file's order.
    robot : Robot
        Gives azimuths and the effect of gravity.
    """
    time = _time(columns)
    if time is None:
        return None
    t = columns[time]
    rising = np.concatenate(([True], np.diff(t) > 0.0))
    finite = np.all([np.isfinite(values) for values in columns.values()], axis=0)
    kept = rising & finite
    # a column that increases by the same step throughout counts rows
    names = [name for name, values in columns.items() if name != time and np.ptp(np.diff(values[kept])) > 0.0]
    rows = even_rows(t[kept])
    smoothed = {name: smooth(rows, t[kept], columns[name][kept, None]) for name in names}
    steps = {name: step_of(columns[name][kept]) for name in names}
    # an IMU's columns usually have steps, which columns computed from them lack
    found = _lean_and_wheels(list(columns), smoothed, steps, robot) or _lean_and_wheels(
        list(columns), smoothed, steps, robot, smooth_lean=True
    )
    if found is None:
        return None
    lean, wheels = found
    return Roles(
        time=time,
        attitude=lean,
        angles=wheels,
        speeds=(),
        commands=_commands(columns, (time, *lean), kept, wheels),
        body_commands=(),
    )


def _time(columns: Mapping[str, NDArray[np.float64]]) -> str | None:
    for name, values in columns.items():
        steps = np.diff(values)
        usual = float(np.median(steps))
        if INTERVALS[0] < usual < INTERVALS[1] and np.mean(steps > 0.0) > 0.98:
            return name
    return None


def _neighbours(names: list[str], present: Mapping[str, Smooth], count: int) -> list[tuple[str, ...]]:
    groups = [tuple(names[k : k + count]) for k in range(len(names) - count + 1)]
    return [group for group in groups if all(name in present for name in group)]


def _lean_and_wheels(
    names: list[str],
    smoothed: Mapping[str, Smooth],
    steps: Mapping[str, float | None],
    robot: Robot,
    *,
    smooth_lean: bool = False,
) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """Return the names of roll and pitch (whose steps may be too fine to see) and of the wheels' angles."""
    kappa, _ = torque_free_gains(robot)
    best, least = None, LARGEST_REST
    for wheels in _neighbours(names, smoothed, robot.wheel_count):
        if not _alike(wheels, steps):
            continue
        speeds = np.column_stack([smoothed[name].rate[:, 0] for name in wheels])
        angles = np.column_stack([smoothed[name].value[:, 0] for name in wheels])
        accelerations = np.column_stack([smoothed[name].acceleration[:, 0] for name in wheels])
        moving = np.abs(speeds).max(axis=1) > 0.1 * np.quantile(np.abs(speeds), 0.99)
        for lean in _neighbours(names, smoothed, 2):
            if set(lean) & set(wheels) or not (smooth_lean or _alike(lean, steps)):
                continue
            rest = _rest(lean, smoothed, (angles, accelerations), moving, robot, kappa)
            if rest < least * (BETTER if best else 1.0):
                best, least = (lean, wheels), rest
    return best


def _alike(names: tuple[str, ...], steps: Mapping[str, float | None]) -> bool:
    """Return whether columns have the same step, as equal sensors do; true if no column of the file has one."""
    if all(step is None for step in steps.values()):
        return True
    known = [steps[name] for name in names]
    first = known[0]
    return first is not None and all(step is not None and abs(step / first - 1.0) < 0.01 for step in known)


def _rest(
    lean: tuple[str, ...],
    smoothed: Mapping[str, Smooth],
    wheels: tuple[NDArray[np.float64], NDArray[np.float64]],
    moving: NDArray[np.bool_],
    robot: Robot,
    kappa: float,
) -> float:
    """Return the fraction of the lean's acceleration that the wheels do not explain, in the better handedness."""
    angles, accelerations = wheels
    value = np.column_stack([smoothed[name].value[:, 0] for name in lean])
    if _unexplained_fraction(angles, value) < 1.0 - COMPUTED:
        return 1.0
    driven = np.column_stack([smoothed[name].acceleration[:, 0] for name in lean]) - kappa * value
    usual = np.median(np.abs(value - np.median(value, axis=0)), axis=0)
    upright = np.all(np.abs(value - np.median(value, axis=0)) < FALLEN * usual + 1e-12, axis=1)
    rows = moving & upright
    y = (driven[:, 0] + 1j * driven[:, 1])[rows]
    y = y - np.median(y.real) - 1j * np.median(y.imag)
    beta = np.asarray(robot.wheels.azimuths)
    unexplained = []
    for azimuths in (beta, -beta):
        X = np.column_stack([accelerations @ np.exp(1j * azimuths), np.ones(len(accelerations))])[rows]
        rest = y - X @ np.linalg.lstsq(X, y, rcond=None)[0]
        # medians, since hands and pushes are not excluded yet
        unexplained.append(float(np.median(np.abs(rest)) / max(float(np.median(np.abs(y))), 1e-300)) ** 2)
    return min(unexplained)


def _unexplained_fraction(angles: NDArray[np.float64], value: NDArray[np.float64]) -> float:
    X = np.column_stack([angles, np.ones(len(angles))])
    rest = value - X @ np.linalg.lstsq(X, value, rcond=None)[0]
    return float((rest.var(axis=0) / np.maximum(value.var(axis=0), 1e-300)).max())


def _commands(
    columns: Mapping[str, NDArray[np.float64]],
    taken: tuple[str, ...],
    kept: NDArray[np.bool_],
    wheels: tuple[str, ...],
) -> tuple[str, ...]:
    """Return the commands' names; `taken` are the time's, first, and the lean's."""
    t = columns[taken[0]][kept]
    rows = even_rows(t)
    moved = smooth(rows, t, np.column_stack([columns[name][kept] for name in wheels]), width=COMMAND_WIDTH)
    speed = np.sqrt((moved.rate**2).sum(axis=1))
    usable = speed > min(MOVING_SPEED, 0.1 * float(np.quantile(speed, 0.99)))
    names = list(columns)
    best, most = (), 0.0
    for k in range(len(names) - len(wheels) + 1):
        group = names[k : k + len(wheels)]
        if set(group) & {*taken, *wheels}:
            continue
        logged = np.column_stack([columns[name][kept] for name in group])
        if not np.all(np.ptp(logged, axis=0) > 0.0):
            continue
        found = command_test(rows, moved, held_commands(rows, t, logged), usable)
        # signs as the wheels'; otherwise it is a sum of other columns that happens to correlate
        if found is not None and len(set(found.signs)) == 1 and found.explained * BETTER > most:
            best, most = tuple(group), found.explained
    return best
