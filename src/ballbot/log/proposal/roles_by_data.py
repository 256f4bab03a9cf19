"""Which column is what, by its numbers: for files without a header, or with names that say nothing.

Time rises by small uneven steps. Roll and pitch, and the wheels' angles in their order, stand side by side, and are
those neighbours whose accelerations agree best with the ball's rolling (`ballbot.log.proposal.lean_test`), whatever
their units. A sensor's steps tell its columns from what was computed of them. The commands are those neighbours that
explain the wheels' accelerations best.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ballbot.log.proposal.commands import WIDTH, command_test, held
from ballbot.log.proposal.episodes import MOVING_SPEED
from ballbot.log.proposal.lean_test import torque_free_gains
from ballbot.log.proposal.roles import Roles
from ballbot.log.proposal.scales import step_of
from ballbot.log.proposal.signals import Smooth, even_rows, smooth
from ballbot.robot import Robot

#: intervals between rows that a log may have [s]
INTERVALS = (2e-4, 0.2)
#: an agreement must be this much better than an earlier one to be preferred: copies stand later in a file
BETTER = 0.98
#: and leave no more than this share of the lean's acceleration
LARGEST_REST = 0.6
#: a lean this many times its usual size away is a fall
FALLEN = 8.0
#: a lean that is this much a sum of wheel angles was computed from them
COMPUTED = 0.9


def roles_by_data(columns: Mapping[str, NDArray[np.float64]], robot: Robot) -> Roles | None:
    """Return what the columns are, or None where no lean and wheels agree with a rolling ball.

    Parameters
    ----------
    columns : mapping of str to (M,) array
        In the file's order.
    robot : Robot
        Gives azimuths and the pull of gravity.
    """
    time = _time(columns)
    if time is None:
        return None
    t = columns[time]
    rising = np.concatenate(([True], np.diff(t) > 0.0))
    finite = np.all([np.isfinite(values) for values in columns.values()], axis=0)
    kept = rising & finite
    # a column that rises by the same step throughout counts rows
    names = [name for name, values in columns.items() if name != time and np.ptp(np.diff(values[kept])) > 0.0]
    rows = even_rows(t[kept])
    smoothed = {name: smooth(rows, t[kept], columns[name][kept, None]) for name in names}
    steps = {name: step_of(columns[name][kept]) for name in names}
    # an IMU's columns have steps as a rule, and then what was computed of them is not taken for them
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
    """Return whether columns have one step, as like sensors do; where no column at all has one, all are alike."""
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
    """Return the share of the lean's acceleration that the wheels' leave, in the better handedness."""
    angles, accelerations = wheels
    value = np.column_stack([smoothed[name].value[:, 0] for name in lean])
    if _share_left(angles, value) < 1.0 - COMPUTED:
        return 1.0
    driven = np.column_stack([smoothed[name].acceleration[:, 0] for name in lean]) - kappa * value
    usual = np.median(np.abs(value - np.median(value, axis=0)), axis=0)
    upright = np.all(np.abs(value - np.median(value, axis=0)) < FALLEN * usual + 1e-12, axis=1)
    rows = moving & upright
    y = (driven[:, 0] + 1j * driven[:, 1])[rows]
    y = y - np.median(y.real) - 1j * np.median(y.imag)
    beta = np.asarray(robot.wheels.azimuths)
    shares = []
    for azimuths in (beta, -beta):
        X = np.column_stack([accelerations @ np.exp(1j * azimuths), np.ones(len(accelerations))])[rows]
        rest = y - X @ np.linalg.lstsq(X, y, rcond=None)[0]
        # medians: hands and pushes are not told apart yet
        shares.append(float(np.median(np.abs(rest)) / max(float(np.median(np.abs(y))), 1e-300)) ** 2)
    return min(shares)


def _share_left(angles: NDArray[np.float64], value: NDArray[np.float64]) -> float:
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
    moved = smooth(rows, t, np.column_stack([columns[name][kept] for name in wheels]), width=WIDTH)
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
        found = command_test(rows, moved, held(rows, t, logged), usable)
        # of the wheels' own pattern, or else it is a sum of other columns that happens to follow
        if found is not None and len(set(found.signs)) == 1 and found.explained * BETTER > most:
            best, most = tuple(group), found.explained
    return best
