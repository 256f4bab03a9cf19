"""Which column of a foreign log is which quantity, by its values.

Without a header, or with names that say nothing, the values decide. Time rises by small uneven steps. Roll and pitch,
and the wheels' angles in their order, stand side by side, and are those neighbours whose accelerations agree best with
the ball's rolling (`ballbot.log.mapping_inference.placement`), whatever their units. A sensor's steps distinguish its
columns from those computed from them. The commands are those neighbours that the motion explains best, and the heading
is the column behind roll and pitch, if wheels and lean explain its rate. How many times better the best explanation is
than the next gives the confidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ballbot.log.mapping_inference.evidence import CONFIDENT, TINY
from ballbot.log.mapping_inference.placement import torque_free_gains
from ballbot.log.mapping_inference.placements import every_way
from ballbot.log.mapping_inference.roles import Roles
from ballbot.log.mapping_inference.time_units import time_scale
from ballbot.log.mapping_inference.units import step_of
from ballbot.log.mapping_inference.wheel_response import RIDGE
from ballbot.log.row_order import increasing_rows
from ballbot.log.signals import Smooth, even_rows, smooth
from ballbot.robot import Robot

#: filter of the lean and the wheels [s]
LEAN_WIDTH = 0.12
#: the next best columns must leave this many times more, or at least this, to be certain
CLEAR_MARGIN, UNCLEAR_MARGIN = 1.5, 1.2
#: an agreement must be better than an earlier one by this factor, since copies come later in a file
BETTER = 0.98
#: largest unexplained fraction of the lean's acceleration
LARGEST_REST = 0.6
#: the same if the columns beside them all have a role. Of 102 logs without a header of the third development half of
#: campaigns/mapping_corpus.py, 62 are recognised with confidence by the fit of the lean alone, and 19 more by this;
#: none of them is wrong
LARGEST_REST_OF_ALL = 0.7
#: a lean beyond so many times its usual size is a fall
FALLEN = 8.0
#: a lean was computed from the wheel angles if they explain this fraction of it; in six seconds of balancing they
#: explain up to 0.98 of a measured one
COMPUTED = 0.985
#: a column is a heading, and no lean, if the wheels' speeds explain this part of its rate: of 700 leans of the
#: development halves at most 0.91, and of headings that turn at least 0.94
TURNING_WITH_WHEELS = 0.93


def roles_by_data(
    columns: Mapping[str, NDArray[np.float64]],
    robot: Robot,
    *,
    yaw: str | None = None,
    motors: tuple[str, ...] = (),
) -> Roles | None:
    """Return the roles by the columns' values, or None if no lean and wheels agree with a rolling ball.

    Parameters
    ----------
    columns : mapping of str to (M,) array
        In the file's order.
    robot : Robot
        Gives azimuths and the effect of gravity.
    yaw : str, optional
        The heading's column by its name, if that says it plainly.
    motors : tuple of str
        The commands' columns by their names, if these say it plainly.
    """
    time = _time(columns)
    if time is None:
        return None
    scale = time_scale(columns[time], None)
    t = columns[time] * (scale.factor if scale else 1.0)
    columns = {name: values for name, values in columns.items() if np.isfinite(values).any()} | {time: t}
    kept = np.all([np.isfinite(values) for values in columns.values()], axis=0)
    kept[kept] = increasing_rows(t[kept])
    # a column that increases by the same step throughout counts rows
    names = [name for name, values in columns.items() if name != time and np.ptp(np.diff(values[kept])) > 0.0]
    rows = even_rows(t[kept])
    smoothed = {name: smooth(rows, t[kept], columns[name][kept, None], width=LEAN_WIDTH) for name in names}
    steps = _shared_steps({name: columns[name][kept] for name in names})
    candidates = _candidates(list(columns), smoothed, steps, robot)
    file = _File(time=time, names=list(columns), rows=rows, smoothed=smoothed, yaw=yaw, motors=motors)
    # an IMU's columns usually have steps, which columns computed from them lack
    best = _best([one for one in candidates if one.stepped]) or _best(candidates)
    found = None if best is None else _roles(file, *best)
    if found is not None and found.confidence >= CONFIDENT:
        return found
    return _complete(file, candidates) or found


@dataclass(frozen=True, kw_only=True, eq=False)
class _File:
    """The columns that roles are looked for in."""

    time: str
    names: list[str]  #: in the file's order
    rows: NDArray[np.float64]  #: even [s]
    smoothed: Mapping[str, Smooth]
    yaw: str | None  #: the heading's column by its name
    motors: tuple[str, ...]  #: the commands' columns by their names


@dataclass(frozen=True, kw_only=True)
class _Candidate:
    """Columns that may be roll and pitch, and the wheels' angles."""

    lean: tuple[str, ...]
    wheels: tuple[str, ...]
    rest: float  #: fraction of the lean's acceleration that the wheels leave
    stepped: bool  #: whether roll and pitch have one step, as equal sensors do


@dataclass(frozen=True, kw_only=True)
class _Others:
    """What the other columns are if a candidate is right."""

    commands: tuple[str, ...]
    margin: float  #: how many times more the next best columns leave unexplained
    heading: tuple[str, ...]
    clear: bool  #: whether there is a heading, or none, for certain


def _others(file: _File, one: _Candidate) -> _Others:
    smoothed, taken = file.smoothed, (file.time, *one.lean, *one.wheels)
    motion = Motion.of(
        file.rows, [smoothed[name] for name in one.lean], [smoothed[name] for name in one.wheels]
    )
    commands, margin = _commands(file.names, taken, motion, smoothed, len(one.wheels))
    if file.motors and not {*file.motors} & {*taken}:
        commands, margin = file.motors, 2.0 * CLEAR_MARGIN
    heading, clear = _heading(file.names, one.lean, (*one.wheels, *commands), motion, smoothed)
    if file.yaw is not None and file.yaw not in (*taken, *commands):
        heading, clear = (file.yaw,), True
    return _Others(commands=commands, margin=margin, heading=heading, clear=clear)


def _roles(file: _File, best: _Candidate, margin: float) -> Roles:
    """Return the roles by the best candidate, which leaves so many times less than the next."""
    others = _others(file, best)
    margins = (margin, others.margin) if others.commands else (margin,)
    confidence = min(0.95 if one > CLEAR_MARGIN else 0.85 if one > UNCLEAR_MARGIN else 0.6 for one in margins)
    if not others.clear or (not others.commands and len(file.names) > len(best.wheels) + 4):
        confidence = 0.6  # columns that no test recognised may be the heading or the commands
    return _as_roles(file, best, others, confidence)


def _as_roles(file: _File, one: _Candidate, others: _Others, confidence: float) -> Roles:
    return Roles(
        time=file.time,
        attitude=(*one.lean, *others.heading),
        angles=one.wheels,
        speeds=(),
        commands=others.commands,
        body_commands=(),
        confidence=confidence,
    )


def _complete(file: _File, candidates: Sequence[_Candidate]) -> Roles | None:
    """Return the roles by the only candidate that gives the columns beside it a role, too; None without just one.

    Commands follow the wheels' accelerations, as the lean does, and two of them may fit better than roll and pitch. But
    if these two are taken for roll and pitch, no commands are left that the motion explains. A candidate that fits
    better must use columns that are commands by the one that is returned.
    """
    found = []
    for one in sorted(candidates, key=lambda one: one.rest):
        if one.rest > LARGEST_REST_OF_ALL:
            break
        others, place = _others(file, one), file.names.index(one.lean[0])
        used = (file.time, *one.wheels, *others.commands)
        beside = place == 0 or file.names[place - 1] in used
        if others.commands and others.margin > CLEAR_MARGIN and others.clear and beside:
            found.append((one, others))
    if not found or (len(found) > 1 and found[1][0].rest < CLEAR_MARGIN * found[0][0].rest):
        return None
    best, others = found[0]
    commands = {*others.commands}
    better = [one for one in candidates if one.rest < best.rest]
    if not all(commands & {*one.lean, *one.wheels} for one in better):
        return None
    return _as_roles(file, best, others, 0.95)


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


def _candidates(
    names: list[str], smoothed: Mapping[str, Smooth], steps: Mapping[str, float | None], robot: Robot
) -> list[_Candidate]:
    """Return the neighbours that may be roll and pitch, and wheels, in the file's order."""
    kappa, _ = torque_free_gains(robot)
    found = []
    for wheels in _neighbours(names, smoothed, robot.wheel_count):
        if not _alike(wheels, steps):
            continue
        speeds = np.column_stack([smoothed[name].rate[:, 0] for name in wheels])
        angles = np.column_stack([smoothed[name].value[:, 0] for name in wheels])
        accelerations = np.column_stack([smoothed[name].acceleration[:, 0] for name in wheels])
        moving = moving_rows(speeds)
        for lean in _neighbours(names, smoothed, 2):
            rates = np.column_stack([smoothed[name].rate[:, 0] for name in lean])
            if set(lean) & set(wheels) or unexplained_parts(speeds, rates).min() < 1.0 - TURNING_WITH_WHEELS:
                continue
            rest = lean_rest(lean, smoothed, (angles, accelerations), moving, robot, kappa)
            found.append(_Candidate(lean=lean, wheels=wheels, rest=rest, stepped=_alike(lean, steps)))
    return found


def _best(candidates: Sequence[_Candidate]) -> tuple[_Candidate, float] | None:
    """Return the candidate that leaves least, and how many times more the next best leaves; None if none fits."""
    best, least, next_best = None, LARGEST_REST, 1.0
    for one in candidates:
        if one.rest < least * (BETTER if best else 1.0):
            next_best = least if best else 1.0
            best, least = one, one.rest
        else:
            next_best = min(next_best, one.rest)
    return None if best is None else (best, next_best / max(least, 1e-12))


#: a step is that of a column whose changes are whole multiples of it to this part, in this share of the rows
WHOLE_STEP, WHOLE_ROWS = 0.05, 0.95


def _shared_steps(columns: Mapping[str, NDArray[np.float64]]) -> dict[str, float | None]:
    """Return the columns' steps; one that changes too fast to show its own has that of the column beside it."""
    steps = {name: step_of(values) for name, values in columns.items()}
    names = list(columns)
    for order in (names, names[::-1]):
        for before, name in pairwise(order):
            step, changes = steps[before], np.diff(columns[name])
            if step is None or steps[name] is not None or not changes.any():
                continue
            multiples = changes[changes != 0.0] / step
            whole = (np.abs(multiples - np.round(multiples)) < WHOLE_STEP) & (np.abs(multiples) > 0.5)
            steps[name] = step if whole.mean() > WHOLE_ROWS else None
    return steps


def _alike(names: tuple[str, ...], steps: Mapping[str, float | None]) -> bool:
    """Return whether columns have the same step, as equal sensors do; true if no column of the file has one."""
    if all(step is None for step in steps.values()):
        return True
    known = [steps[name] for name in names]
    first = known[0]
    return first is not None and all(step is not None and abs(step / first - 1.0) < 0.01 for step in known)


def lean_rest(
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
    if unexplained_parts(angles, value).max() < 1.0 - COMPUTED:
        return 1.0
    driven = np.column_stack([smoothed[name].acceleration[:, 0] for name in lean]) - kappa * value
    usual = np.median(np.abs(value - np.median(value, axis=0)), axis=0)
    upright = np.all(np.abs(value - np.median(value, axis=0)) < FALLEN * usual + 1e-12, axis=1)
    rows = moving & upright
    if not rows.any() or _slower_than_a_fall(value[rows], driven[rows] + kappa * value[rows], kappa):
        return 1.0
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


#: times that gravity's part of a lean's acceleration may be as large as the acceleration (medians): of windows of 6 to
#: 40 s of the development halves up to 21, and of a set point that changes by 0.5 rad/s 32 and more
SLOW_LEAN = 30.0


def _slower_than_a_fall(value: NDArray[np.float64], acceleration: NDArray[np.float64], kappa: float) -> bool:
    """Return whether one of two columns (N, 2) changes so slowly that a robot that leaned so would fall."""
    v, a = (np.median(np.abs(one - np.median(one, axis=0)), axis=0) for one in (value, acceleration))
    return bool((kappa * v > SLOW_LEAN * a).any())


def unexplained_parts(wheels: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the parts (k,) of the variances of columns (N, k) that a regression on the wheels' (N, n) leaves."""
    X = np.column_stack([wheels, np.ones(len(wheels))])
    rest = values - X @ np.linalg.lstsq(X, values, rcond=None)[0]
    return rest.var(axis=0) / np.maximum(values.var(axis=0), TINY)


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
class Motion:
    """Smoothed wheels and lean, in the file's units, from which other columns are explained."""

    rows: NDArray[np.float64]  #: (N,) [s]
    terms: NDArray[np.float64]  #: (N, k)
    usable: NDArray[np.bool_]  #: (N,)

    @staticmethod
    def of(rows: NDArray[np.float64], lean: Sequence[Smooth], wheels: Sequence[Smooth]) -> Motion:
        """Return the motion that the wheels' needs are made of: their accelerations and speeds, friction, the lean."""
        speed = np.hstack([one.rate for one in wheels])
        acceleration = np.hstack([one.acceleration for one in wheels])
        tilt = np.hstack(
            [np.empty((len(rows), 0)), *(part for one in lean for part in (one.value, one.rate))]
        )
        size = np.sqrt((speed**2).mean(axis=0)) + TINY
        total = np.sqrt((speed**2).sum(axis=1))
        return Motion(
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
    names: list[str], taken: tuple[str, ...], motion: Motion, smoothed: Mapping[str, Smooth], count: int
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
    motion: Motion,
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


def moving_rows(speeds: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the rows (N,) in which a wheel turns."""
    return np.abs(speeds).max(axis=1) > 0.1 * np.quantile(np.abs(speeds), 0.99)
