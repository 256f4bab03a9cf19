"""Which column of a foreign log is which quantity, by its name or by its values.

By names (`ballbot.log.mapping_inference.names`): a triple is as many columns of one kind and stem as the robot has
wheels, numbered from 1 or 0. Of several the plainest name is taken, a command before a measured current.

Without a header, or with names that say nothing, the values decide. Time rises by small uneven steps. Roll and pitch,
and the wheels' angles in their order, stand side by side, and are those neighbours whose accelerations agree best with
the ball's rolling (`ballbot.log.mapping_inference.placement`), whatever their units. A sensor's steps distinguish its
columns from those computed from them. The commands are those neighbours that explain the wheels' accelerations best.
How many times better the best explanation is than the next gives the confidence.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log.mapping_inference.evidence import TINY
from ballbot.log.mapping_inference.names import Kind, Reading, read_name
from ballbot.log.mapping_inference.placement import torque_free_gains
from ballbot.log.mapping_inference.units import step_of, time_scale
from ballbot.log.mapping_inference.wheel_response import WIDER, command_test, held_commands
from ballbot.log.signals import MOVING_SPEED, Smooth, even_rows, smooth
from ballbot.robot import Robot


@dataclass(frozen=True, kw_only=True)
class Roles:
    """The file's names of what the log is made of; empty or None if there is none."""

    time: str | None
    attitude: tuple[str, ...]  #: roll, pitch and, if there is one, yaw
    angles: tuple[str, ...]  #: a wheel each
    speeds: tuple[str, ...]
    commands: tuple[str, ...]
    body_commands: tuple[
        str, ...
    ]  #: Tx, Ty, Tz: commands about the body's axes, before they go to the wheels
    gyro: tuple[str, ...] = ()  #: about x, y and z
    confidence: float = 1.0  #: that these are the columns

    def reading(self, names: tuple[str, ...]) -> Reading | None:
        """Return what the name of the first of these columns says; None without columns."""
        return read_name(names[0]) if names else None


def roles_by_name(names: Iterable[str], *, wheel_count: int) -> Roles:
    """Return what the names say; see the module's text."""
    readings = [read_name(name) for name in names]
    angles = _numbered(readings, "wheel angle", wheel_count)
    speeds = _numbered(readings, "wheel speed", wheel_count)
    commands = _numbered(readings, "command", wheel_count)
    if not commands and len(_triples(readings, "wheel angle", wheel_count)) > 1:
        # m1, m2, m3 beside enc1, enc2, enc3
        commands = _triples(readings, "wheel angle", wheel_count)[1]
    times = [one for one in readings if one.kind == "time"]
    attitude, gyro = _axes(readings, "attitude"), _axes(readings, "gyro")
    return Roles(
        time=max(times, key=lambda one: one.weight).name if times else None,
        attitude=tuple(attitude[axis] for axis in "xyz" if axis in attitude)
        if {"x", "y"} <= set(attitude)
        else (),
        angles=angles,
        speeds=speeds,
        commands=commands,
        body_commands=tuple(one.name for one in readings if one.kind == "body command"),
        gyro=tuple(gyro[axis] for axis in "xyz") if len(gyro) == 3 else (),
    )


def _triples(readings: list[Reading], kind: Kind, count: int) -> list[tuple[str, ...]]:
    """Return the complete series of columns of a kind, the plainest first."""
    series: dict[str, dict[int, Reading]] = {}
    for one in readings:
        if one.kind == kind and one.index is not None:
            series.setdefault(one.stem, {}).setdefault(one.index, one)
    found = []
    for members in series.values():
        start = next((s for s in (1, 0) if all(s + k in members for k in range(count))), None)
        if start is not None and count + start not in members:
            chosen = [members[start + k] for k in range(count)]
            found.append((min(one.weight for one in chosen), tuple(one.name for one in chosen)))
    return [names for _, names in sorted(found, key=lambda one: -one[0])]


def _numbered(readings: list[Reading], kind: Kind, count: int) -> tuple[str, ...]:
    return next(iter(_triples(readings, kind, count)), ())


def _axes(readings: list[Reading], kind: Kind) -> dict[str, str]:
    """Return the columns of a kind by axis, of one family of names: that with the most axes, then the plainest."""
    families: dict[str, dict[str, Reading]] = {}
    for one in readings:
        if one.kind == kind and one.axis is not None:
            family = one.stem
            for word in ("roll", "pitch", "yaw", "heading", "theta", "phi", "psi"):
                family = family.replace(word, "")
            families.setdefault(family, {}).setdefault(one.axis, one)
    if not families:
        return {}
    best = max(families.values(), key=lambda f: (len(f) > 1, min(one.weight for one in f.values()), len(f)))
    # a heading by itself belongs to roll and pitch of another family
    others = {
        one.axis: one for family in families.values() for one in family.values() if one.axis not in best
    }
    return {axis: one.name for axis, one in ({**others, **best} if len(best) > 1 else best).items() if axis}


#: filter of the lean and the wheels [s]
LEAN_WIDTH = 0.08
#: the next best columns must leave this many times more, or at least this, to be certain
CLEAR_MARGIN, UNCLEAR_MARGIN = 1.5, 1.2
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
    scale = time_scale(columns[time], None)
    t = columns[time] * (scale.factor if scale else 1.0)
    columns = {**columns, time: t}
    rising = np.concatenate(([True], np.diff(t) > 0.0))
    finite = np.all([np.isfinite(values) for values in columns.values()], axis=0)
    kept = rising & finite
    # a column that increases by the same step throughout counts rows
    names = [name for name, values in columns.items() if name != time and np.ptp(np.diff(values[kept])) > 0.0]
    rows = even_rows(t[kept])
    smoothed = {name: smooth(rows, t[kept], columns[name][kept, None], width=LEAN_WIDTH) for name in names}
    steps = {name: step_of(columns[name][kept]) for name in names}
    # an IMU's columns usually have steps, which columns computed from them lack
    found = _lean_and_wheels(list(columns), smoothed, steps, robot) or _lean_and_wheels(
        list(columns), smoothed, steps, robot, smooth_lean=True
    )
    if found is None:
        return None
    lean, wheels, margin = found
    commands = _commands(columns, (time, *lean), kept, wheels)
    certain = 0.95 if margin > CLEAR_MARGIN else 0.85 if margin > UNCLEAR_MARGIN else 0.6
    return Roles(
        time=time,
        attitude=lean,
        angles=wheels,
        speeds=(),
        commands=commands,
        body_commands=(),
        # columns that no test recognised may be the commands
        confidence=certain if commands or len(columns) <= len(wheels) + 4 else 0.6,
    )


def _time(columns: Mapping[str, NDArray[np.float64]]) -> str | None:
    """Return the first column that rises as time does; one that counts rows only if there is no other."""
    found = []
    for name, values in columns.items():
        steps = np.diff(values)
        if np.mean(steps > 0.0) > 0.98 and time_scale(values, None) is not None:
            found.append(
                (bool(np.ptp(steps) == 0.0 and np.all(values == np.round(values))), len(found), name)
            )
    return min(found)[2] if found else None


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
) -> tuple[tuple[str, ...], tuple[str, ...], float] | None:
    """Return the names of roll and pitch (whose steps may be too fine to see) and of the wheels' angles.

    The number is how many times more the next best columns leave unexplained.
    """
    kappa, _ = torque_free_gains(robot)
    best, least, next_best = None, LARGEST_REST, 1.0
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
                next_best = least if best else 1.0
                best, least = (lean, wheels), rest
            else:
                next_best = min(next_best, rest)
    return None if best is None else (*best, next_best / max(least, 1e-12))


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
        size = float(np.median(np.abs(y)))
        # a column that stands still in most rows is no lean
        unexplained.append(min(float(np.median(np.abs(rest))) / size, 1.0) ** 2 if size > 0.0 else 1.0)
    return min(unexplained)


def _unexplained_fraction(angles: NDArray[np.float64], value: NDArray[np.float64]) -> float:
    X = np.column_stack([angles, np.ones(len(angles))])
    rest = value - X @ np.linalg.lstsq(X, value, rcond=None)[0]
    return float((rest.var(axis=0) / np.maximum(value.var(axis=0), TINY)).max())


def _commands(
    columns: Mapping[str, NDArray[np.float64]],
    taken: tuple[str, ...],
    kept: NDArray[np.bool_],
    wheels: tuple[str, ...],
) -> tuple[str, ...]:
    """Return the commands' names; `taken` are the time's, first, and the lean's."""
    t = columns[taken[0]][kept]
    rows = even_rows(t)
    moved = smooth(rows, t, np.column_stack([columns[name][kept] for name in wheels]), width=WIDER)
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
        found = command_test(rows, moved, held_commands(rows, t, logged), usable, width=WIDER)
        # signs as the wheels'; otherwise it is a sum of other columns that happens to correlate
        if found is not None and len(set(found.signs)) == 1 and found.explained * BETTER > most:
            best, most = tuple(group), found.explained
    return best
