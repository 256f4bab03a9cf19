"""Which columns are a gyro's, if the roles have none: by their names, or by the rates of roll and pitch.

A gyro that is not found is differentiated angles: ten times the noise. So it is looked for under any name, and columns
that look like one and are not used are named.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ballbot.log.mapping_inference.names import Reading
from ballbot.log.mapping_inference.open_names import NAMED_GYRO, correlation_with_rate, smooth_columns
from ballbot.log.mapping_inference.roles import PLAIN, Roles, axes_of
from ballbot.log.signals import Smooth, unwrapped

#: a yaw that jumps by so much of a turn, and stays within one, begins again there
JUMP = 0.9
#: share of the rows that have a value, at least
MEASURED = 0.9
#: kinds whose columns are no gyro's, if the name says so plainly
_OTHERS = ("time", "counter", "attitude", "accelerometer", "command", "wheel angle", "reference")


def with_gyro(roles: Roles, columns: Mapping[str, NDArray[np.float64]]) -> tuple[Roles, str]:
    """Return roles with the gyro's columns, and a note if columns look like a gyro's and are not used.

    Parameters
    ----------
    roles : Roles
    columns : mapping of str to (M,) array
        In the file's order.
    """
    if roles.gyro or len(roles.attitude) < 2:
        return roles, ""
    readings = roles.unused(columns)
    named = axes_of(readings, "gyro")
    if len(named) == 3:
        return replace(roles, gyro=tuple(named[axis] for axis in "xyz")), ""
    found = _by_rates(roles, columns, readings)
    if found:
        speeds = () if set(found) & set(roles.speeds) else roles.speeds
        return replace(roles, gyro=found, speeds=speeds), ""
    alike = [one.name for one in readings if one.kind == "gyro" and one.name not in roles.speeds]
    if not alike:
        return roles, ""
    plural = len(alike) > 1
    return roles, (
        f"{', '.join(alike)} {'look' if plural else 'looks'} like {'columns' if plural else 'a column'} of a gyro and "
        f"{'are' if plural else 'is'} not used: a gyro needs three axes, and the other names do not show them."
    )


def _by_rates(
    roles: Roles, columns: Mapping[str, NDArray[np.float64]], readings: Sequence[Reading]
) -> tuple[str, ...]:
    """Return three neighbours that follow the rates of roll, pitch and, if there is one, yaw; empty without."""
    open_to = {one.name for one in readings if one.kind not in _OTHERS or one.weight < PLAIN}
    names = list(columns)
    groups = [tuple(names[k : k + 3]) for k in range(len(names) - 2)]
    groups = [group for group in groups if open_to.issuperset(group) and _move(group, columns)]
    if not groups:
        return ()
    angles = roles.attitude
    columns = {**columns, **{name: _continued(columns[name]) for name in angles[2:]}}
    found = smooth_columns(roles, columns, (angles, *groups))
    if found is None or not set(angles[:2]) <= set(found[1]):
        return ()
    signals = found[1]
    followed = {
        group: _follows(group, [one for one in angles if one in signals], signals) for group in groups
    }
    best = max(groups, key=lambda group: followed[group])
    return best if followed[best] > NAMED_GYRO else ()


def _move(group: Sequence[str], columns: Mapping[str, NDArray[np.float64]]) -> bool:
    known = [(values := columns[name])[np.isfinite(values)] for name in group]
    return all(len(one) > MEASURED * len(columns[group[0]]) and float(np.ptp(one)) > 0.0 for one in known)


def _continued(yaw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a yaw (N,) in degrees or radians without the jumps of a turn."""
    known = yaw[np.isfinite(yaw)]
    jump, whole = float(np.abs(np.diff(known)).max(initial=0.0)), float(np.ptp(known))
    turns = [turn for turn in (360.0, 2.0 * np.pi) if JUMP * turn < jump and whole < 1.001 * turn]
    return unwrapped(yaw, period=turns[0]) if turns else yaw


def _follows(group: Sequence[str], angles: Sequence[str], signals: Mapping[str, Smooth]) -> float:
    """Return the least correlation with the rates of angles, of the order of columns in which it is largest.

    Without a yaw, the last column is about the vertical: two of the three would fit beside any other column.
    """
    R = np.abs([[correlation_with_rate(signals[one], signals[angle]) for angle in angles] for one in group])
    orders = permutations(range(len(angles)), len(angles))
    return float(max(min(R[place, axis] for axis, place in enumerate(order)) for order in orders))
