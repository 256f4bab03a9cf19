"""Which column of a foreign log is which quantity, by its values.

Without a header, or with names that say nothing, the values decide. Time rises by small uneven steps. Roll and pitch,
and the wheels' angles in their order, stand side by side, and are those neighbours whose accelerations agree best with
the ball's rolling (`ballbot.log.mapping_inference.placement`), whatever their units. A sensor's steps distinguish its
columns from those computed from them. The commands are those neighbours that the motion explains best, and the heading
is the column behind roll and pitch, if wheels and lean explain its rate. How many times better the best explanation is
than the next gives the confidence.

Series of columns whose names say no more than that there is one for each wheel (m1, e1, w1) are settled in the same way
(`settled`): wheels follow from commands by integration, so that angles are the slowest of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.log.mapping_inference.evidence import TINY
from ballbot.log.mapping_inference.placement import torque_free_gains
from ballbot.log.mapping_inference.placements import every_way
from ballbot.log.mapping_inference.roles import Roles
from ballbot.log.mapping_inference.units import step_of, time_scale
from ballbot.log.mapping_inference.wheel_response import RIDGE
from ballbot.log.signals import INTERVAL, Smooth, even_rows, smooth
from ballbot.robot import Robot

#: filter of the lean and the wheels [s]
LEAN_WIDTH = 0.12
#: the next best columns must leave this many times more, or at least this, to be certain
CLEAR_MARGIN, UNCLEAR_MARGIN = 1.5, 1.2
#: an agreement must be better than an earlier one by this factor, since copies come later in a file
BETTER = 0.98
#: largest unexplained fraction of the lean's acceleration
LARGEST_REST = 0.6
#: a lean beyond so many times its usual size is a fall
FALLEN = 8.0
#: a lean was computed from the wheel angles if they explain this fraction of it; in six seconds of balancing they
#: explain up to 0.98 of a measured one
COMPUTED = 0.985


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
    columns = {name: values for name, values in columns.items() if np.isfinite(values).any()} | {time: t}
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
    every = list(columns)
    motion = _Motion.of(rows, [smoothed[name] for name in lean], [smoothed[name] for name in wheels])
    commands, command_margin = _commands(every, (time, *lean, *wheels), motion, smoothed, len(wheels))
    heading, clear = _heading(every, lean, (*wheels, *commands), motion, smoothed)
    margins = (margin, command_margin) if commands else (margin,)
    confidence = min(0.95 if one > CLEAR_MARGIN else 0.85 if one > UNCLEAR_MARGIN else 0.6 for one in margins)
    if not clear or (not commands and len(columns) > len(wheels) + 4):
        confidence = 0.6  # columns that no test recognised may be the heading or the commands
    return Roles(
        time=time,
        attitude=(*lean, *heading),
        angles=wheels,
        speeds=(),
        commands=commands,
        body_commands=(),
        confidence=confidence,
    )


def _time(columns: Mapping[str, NDArray[np.float64]]) -> str | None:
    """Return the first column that rises as time does; one that counts rows only if there is no other."""
    found = []
    for name, values in columns.items():
        steps = np.diff(values)
        if len(steps) and np.mean(steps > 0.0) > 0.98 and time_scale(values, None) is not None:
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
        moving = _moving(speeds)
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
    """Return the fraction of the lean's acceleration that the wheels do not explain, in their best order and signs."""
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
    # medians, since hands and pushes are not excluded yet
    size = float(np.median(np.abs(y)))
    if size == 0.0:  # a column that stands still in most rows is no lean
        return 1.0
    moved = accelerations[rows] - accelerations[rows].mean(axis=0)
    unexplained = 1.0
    for way in every_way(robot):
        x = moved @ way
        rest = y - x * (np.vdot(x, y) / max(float(np.vdot(x, x).real), TINY))
        unexplained = min(unexplained, (float(np.median(np.abs(rest))) / size) ** 2)
    return unexplained


def _unexplained_fraction(angles: NDArray[np.float64], value: NDArray[np.float64]) -> float:
    X = np.column_stack([angles, np.ones(len(angles))])
    rest = value - X @ np.linalg.lstsq(X, value, rcond=None)[0]
    return float((rest.var(axis=0) / np.maximum(value.var(axis=0), TINY)).max())


#: columns are the commands if the motion explains at least this share of each, on blocks that the fit does not use.
#: With this, the next three and `LEAN_WIDTH`, the columns of 55 of 75 logs without a header, among 800 variants of two
#: development halves of campaigns/mapping_corpus.py, are found with confidence, and none of them is wrong
LEAST_EXPLAINED = 0.3
#: share of a heading's rate that wheels and lean must explain on such blocks
LEAST_EXPLAINED_HEADING = 0.5
#: blocks [s], every other one is fitted
FITTED_BLOCK = 1.0
#: speed at which dry friction's sign is half turned over, over the speed's root mean square
SLOW = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class _Motion:
    """Smoothed wheels and lean, in the file's units, from which other columns are explained."""

    rows: NDArray[np.float64]  #: (N,) [s]
    terms: NDArray[np.float64]  #: (N, k)
    usable: NDArray[np.bool_]  #: (N,)

    @staticmethod
    def of(rows: NDArray[np.float64], lean: Sequence[Smooth], wheels: Sequence[Smooth]) -> _Motion:
        """Return the motion that the wheels' needs are made of: their accelerations and speeds, friction, the lean."""
        speed = np.hstack([one.rate for one in wheels])
        acceleration = np.hstack([one.acceleration for one in wheels])
        tilt = np.hstack(
            [np.empty((len(rows), 0)), *(part for one in lean for part in (one.value, one.rate))]
        )
        size = np.sqrt((speed**2).mean(axis=0)) + TINY
        total = np.sqrt((speed**2).sum(axis=1))
        return _Motion(
            rows=rows,
            terms=np.hstack([acceleration, speed, np.tanh(speed / (SLOW * size)), tilt]),
            usable=total > 0.1 * float(np.quantile(total, 0.99)),
        )

    def explained(self, values: NDArray[np.float64]) -> float:
        """Return the share of a column (N,) that is explained on every other block by a fit of the rest."""
        X = np.column_stack([self.terms, np.ones(len(self.rows))])
        X = X / (np.sqrt((X**2).mean(axis=0)) + TINY)
        odd = (np.floor((self.rows - self.rows[0]) / FITTED_BLOCK) % 2 > 0.5) & self.usable
        even = ~odd & self.usable
        if min(odd.sum(), even.sum()) < 2 * X.shape[1]:
            return 0.0
        left = whole = 0.0
        for fitted, judged in ((odd, even), (even, odd)):
            normal = X[fitted].T @ X[fitted] + RIDGE * fitted.sum() * np.eye(X.shape[1])
            found = np.linalg.solve(normal, X[fitted].T @ values[fitted])
            left += float(np.square(values[judged] - X[judged] @ found).sum())
            whole += float(np.square(values[judged] - values[judged].mean()).sum())
        return 1.0 - left / whole if whole > 0.0 else 0.0


def _commands(
    names: list[str], taken: tuple[str, ...], motion: _Motion, smoothed: Mapping[str, Smooth], count: int
) -> tuple[tuple[str, ...], float]:
    """Return the commands' names and how many times more the next best columns leave unexplained.

    Commands are `count` neighbours that the motion explains, since they follow from the torques that the wheels need.
    Neighbours that overlap the best are no alternative to it.
    """
    each = {
        name: motion.explained(smoothed[name].value[:, 0])
        for name in names
        if name not in taken and name in smoothed
    }
    groups = {
        group: min(each[name] for name in group)
        for group in _neighbours(names, smoothed, count)
        if all(name in each for name in group)
    }
    ranked = sorted(groups, key=lambda group: -groups[group])
    if not ranked or groups[ranked[0]] < LEAST_EXPLAINED:
        return (), 1.0
    best = ranked[0]
    other = next((groups[one] for one in ranked if not set(one) & set(best)), 0.0)
    return best, (1.0 - max(other, 0.0)) / max(1.0 - groups[best], 0.02)


def _heading(
    names: list[str],
    lean: tuple[str, ...],
    taken: tuple[str, ...],
    motion: _Motion,
    smoothed: Mapping[str, Smooth],
) -> tuple[tuple[str, ...], bool]:
    """Return the name of the heading, if there is one, and whether that is certain.

    A heading stands behind roll and pitch. If the column there belongs to no other quantity and may be one, but hardly
    turns, the log must not be taken for one without a heading. If the motion explains the column before them, that may
    be roll, and they pitch and heading.
    """
    before = names[names.index(lean[0]) - 1]
    if (
        before in smoothed
        and before not in taken
        and motion.explained(smoothed[before].value[:, 0]) > LEAST_EXPLAINED
    ):
        return (), False
    place = names.index(lean[1]) + 1
    if place >= len(names) or names[place] in taken:
        return (), True
    name = names[place]
    if name not in smoothed:
        return (), True
    return (
        ((name,), True)
        if motion.explained(smoothed[name].rate[:, 0]) > LEAST_EXPLAINED_HEADING
        else ((), False)
    )


#: a speed and the rate of its angle correlate so well if the name may be that of a speed, and otherwise: a duty follows
#: the speed, too
NAMED_SPEED, SPEED = 0.9, 0.995


def settled(named: Roles, columns: Mapping[str, NDArray[np.float64]], robot: Robot) -> Roles:
    """Return roles by name in which the values decide what the series with open names are.

    A wheel's angle follows from its command by two integrations, so that it is slower than commands and lean, and the
    wheels explain the lean. A series that is the rate of the angles is their speeds. Of the others the commands are
    those that the motion explains. If the slowest series is not clearly slower, the columns are in doubt.

    Parameters
    ----------
    named : Roles
    columns : mapping of str to (M,) array
    robot : Robot
        Gives azimuths and the effect of gravity.
    """
    series = named.open_series
    # one series alone, of which no name says that they are angles, is left to `roles_by_data`
    if named.time is None or not series or (len(series) == 1 and not named.angles):
        return named
    signals = _open_signals(named, columns)
    if signals is None:
        return named
    rows, smoothed = signals
    lean, every = named.attitude[:2], [*series]
    rated = {
        one: _rest_of(lean, one, smoothed, robot) for one in every if all(name in smoothed for name in one)
    }
    able = [one for one in rated if rated[one] < LARGEST_REST] if lean else list(rated)
    if not able:
        return replace(named, confidence=0.6, alternatives=("other columns are the wheel angles",))
    angles = min(able, key=lambda one: _frequency(one, smoothed))
    elsewhere = () if named.speeds in every else named.speeds
    speeds = next((one for one in every if _are_rates(named, one, angles, smoothed)), elsewhere)
    others = [one for one in every if one not in (angles, speeds) and one in rated]
    commands, clear = named.commands, True
    if not commands or commands in every:
        motion = _Motion.of(rows, [smoothed[name] for name in lean], [smoothed[name] for name in angles])
        explained = {one: min(motion.explained(smoothed[name].value[:, 0]) for name in one) for one in others}
        fitting = [one for one in others if explained[one] > LEAST_EXPLAINED]
        motors = [one for one in others if _is_motor(named, one)]
        commands = max(fitting or motors, key=lambda one: explained[one], default=())
        clear = commands in fitting and len(fitting) == 1 if commands else True
    compared = [one for one in (*others, commands, lean) if one and all(name in smoothed for name in one)]
    alternatives = [f"{', '.join(one)} are the wheel angles" for one in others]
    if speeds in every and not commands and _likeness(speeds, angles, smoothed) < SPEED:
        # a duty follows the speed
        clear, alternatives = False, [f"{', '.join(speeds)} are the commands", *alternatives]
    slowest = min((_frequency(one, smoothed) for one in compared), default=np.inf)
    clear = clear and slowest > CLEAR_MARGIN * _frequency(angles, smoothed)
    return replace(
        named,
        angles=angles,
        speeds=speeds if speeds not in (angles, commands) else (),
        commands=commands,
        confidence=1.0 if clear else 0.6,
        alternatives=() if clear else tuple(alternatives) or (f"{', '.join(angles)} are no wheel angles",),
    )


#: taken for speeds, columns must leave so many times less of the lean than taken for angles: true angles leave up to 2
#: times less (80 variants of the development halves), counts a row and counts a second 5 and 10
AS_SPEEDS = 3.0


def seem_speeds(named: Roles, columns: Mapping[str, NDArray[np.float64]], robot: Robot) -> bool:
    """Return whether the lean follows from columns called wheel angles as from speeds, or from increments in a row."""
    if len(named.attitude) < 2 or named.time is None:
        return False
    signals = _open_signals(replace(named, commands=(), open_series=(named.angles,)), columns)
    if signals is None or not {*named.angles, *named.attitude[:2]} <= set(signals[1]):
        return False
    smoothed = signals[1]
    integrals = {
        name: Smooth(
            value=INTERVAL * np.cumsum(smoothed[name].value, axis=0),
            rate=smoothed[name].value,
            acceleration=smoothed[name].rate,
        )
        for name in named.angles
    }
    lean = named.attitude[:2]
    as_speeds = _rest_of(lean, named.angles, {**smoothed, **integrals}, robot)
    return as_speeds < LARGEST_REST and AS_SPEEDS * as_speeds < _rest_of(lean, named.angles, smoothed, robot)


def _is_motor(named: Roles, series: tuple[str, ...]) -> bool:
    reading = named.reading(series)
    return reading is not None and reading.kind == "wheel angle"


def _open_signals(
    named: Roles, columns: Mapping[str, NDArray[np.float64]]
) -> tuple[NDArray[np.float64], dict[str, Smooth]] | None:
    """Return even rows, and on them the smooth lean, commands and open series that move; None without a time."""
    time = columns[named.time or ""]
    reading = named.reading((named.time or "",))
    scale = time_scale(time, reading.unit if reading else None)
    if scale is None:
        return None
    names = dict.fromkeys(
        [*named.attitude[:2], *named.commands, *(name for one in named.open_series for name in one)]
    )
    moving = [name for name in names if np.nanmax(columns[name]) > np.nanmin(columns[name])]
    kept = np.isfinite(time) & np.all([np.isfinite(columns[name]) for name in moving], axis=0)
    t = time[kept] * scale.factor
    rising = np.concatenate(([True], np.diff(np.maximum.accumulate(t)) > 0.0))
    if rising.sum() < FEWEST_ROWS:
        return None
    t = t[rising]
    rows = even_rows(t)
    return rows, {
        name: smooth(rows, t, columns[name][kept][rising, None], width=LEAN_WIDTH) for name in moving
    }


#: fewer rows show nothing
FEWEST_ROWS = 200


def _frequency(series: Sequence[str], smoothed: Mapping[str, Smooth]) -> float:
    """Return the root mean square of the rates over that of the values [1/s]."""
    rate = sum(float((smoothed[name].rate ** 2).mean()) for name in series)
    size = sum(float(smoothed[name].value.var()) for name in series)
    return float(np.sqrt(rate / max(size, TINY)))


def _rest_of(
    lean: tuple[str, ...], wheels: tuple[str, ...], smoothed: Mapping[str, Smooth], robot: Robot
) -> float:
    """Return the fraction of the lean's acceleration that columns taken for wheel angles leave; 1 without a lean."""
    if not all(name in smoothed for name in lean) or not lean:
        return 1.0
    speeds = np.column_stack([smoothed[name].rate[:, 0] for name in wheels])
    angles = np.column_stack([smoothed[name].value[:, 0] for name in wheels])
    accelerations = np.column_stack([smoothed[name].acceleration[:, 0] for name in wheels])
    return _rest(lean, smoothed, (angles, accelerations), _moving(speeds), robot, torque_free_gains(robot)[0])


def _moving(speeds: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the rows (N,) in which a wheel turns."""
    return np.abs(speeds).max(axis=1) > 0.1 * np.quantile(np.abs(speeds), 0.99)


def _are_rates(
    named: Roles, series: tuple[str, ...], angles: tuple[str, ...], smoothed: Mapping[str, Smooth]
) -> bool:
    """Return whether each column is the rate of an angle, in any unit."""
    reading = named.reading(series)
    if series == angles or reading is None or any(name not in smoothed for name in series):
        return False
    least = NAMED_SPEED if reading.kind == "wheel speed" else SPEED
    return _likeness(series, angles, smoothed) > least


def _likeness(series: tuple[str, ...], angles: tuple[str, ...], smoothed: Mapping[str, Smooth]) -> float:
    """Return the least correlation of a column with the rate of its angle, whatever its sign."""
    return min(
        abs(float(np.corrcoef(smoothed[one].value[:, 0], smoothed[other].rate[:, 0])[0, 1]))
        for one, other in zip(series, angles, strict=True)
    )
