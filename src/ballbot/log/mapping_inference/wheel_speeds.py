"""Wheel speeds in a foreign file that has no wheel angles: which columns they are, and their integrals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.formats.inference import ForeignTable
from ballbot.log.imu_angles import integral_of
from ballbot.log.mapping_inference.file_signals import filled
from ballbot.log.mapping_inference.open_names import seem_angles, seem_speeds
from ballbot.log.mapping_inference.roles import Roles, upright
from ballbot.log.mapping_inference.time_units import time_scale
from ballbot.robot import Robot

#: how plainly a name must say that a column is a wheel's speed: w1 may be its angle
_PLAINLY = 0.7
#: stems of speeds in rad/s
_OMEGA = ("w", "omega")


def of_speeds(table: ForeignTable, named: Roles, robot: Robot) -> Roles | None:
    """Return the roles of a table that has wheel speeds and no angles; None if neither names nor values say so."""
    reading = named.reading(named.speeds)
    if reading is None or named.time is None or named.angles:
        return None
    found = replace(named, angles=named.speeds, speeds=(), of_speeds=True)
    plain = reading.weight >= _PLAINLY
    return found if plain or seem_speeds(found, upright(table.columns, found), robot) else None


def integrals_of(table: ForeignTable, named: Roles) -> dict[str, NDArray[np.float64]]:
    """Return the integrals of wheel speeds over the file's time, by the speeds' names; none without a known unit."""
    time = table.columns[named.time or ""]
    reading = named.reading((named.time or "",))
    scale = time_scale(time, reading.unit if reading else None)
    if scale is None:
        return {}
    t = np.maximum.accumulate(filled(time) * scale.factor)
    return {name: integral_of(t, filled(table.columns[name])) for name in named.angles}


def check_named_wheels(path: str | Path, table: ForeignTable, roles: Roles, robot: Robot) -> None:
    """Raise InputError if the lean follows from columns called wheel angles as from speeds, or the other way round."""
    names, columns = ", ".join(roles.angles), upright(table.columns, roles)
    if roles.of_speeds and seem_angles(roles, columns, robot):
        raise InputError(
            f"{path}: {names} are called wheel speeds, but the lean follows from them as from angles. Name them as "
            "angles with --columns, wheel1_angle and so on."
        )
    if not roles.of_speeds and not show_angles(table, roles) and seem_speeds(roles, columns, robot):
        raise InputError(
            f"{path}: {names} are called wheel angles, but the lean follows from them as from speeds, or from "
            "increments of a row. Log the angles, or replace these columns by their running sums."
        )


#: that columns are angles, rows show in which no wheel turns, or such a correlation of changes with logged speeds
_RESTING_ROWS, _FOLLOWED = 10, 0.8


def show_angles(table: ForeignTable, roles: Roles) -> bool:
    """Return whether columns are angles by their values: they are not zero at rest, or change as the logged speeds."""
    angles = np.column_stack([table.columns[name] for name in roles.angles])
    changes = np.diff(angles, axis=0)
    moving = np.flatnonzero(np.any(changes != 0.0, axis=1))
    edges = np.concatenate(([-1], moving, [len(changes)]))
    longest = int(np.argmax(np.diff(edges)))
    if np.diff(edges)[longest] > _RESTING_ROWS and np.any(angles[edges[longest] + 1] != 0.0):
        return True
    if len(roles.speeds) != len(roles.angles):
        return False
    speeds = np.column_stack([table.columns[name][1:] for name in roles.speeds])
    known = np.isfinite(changes).all(axis=1) & np.isfinite(speeds).all(axis=1)
    pairs = [
        (a, b) for a, b in zip(changes[known].T, speeds[known].T, strict=True) if np.ptp(a) and np.ptp(b)
    ]
    return bool(pairs) and min(abs(float(np.corrcoef(a, b)[0, 1])) for a, b in pairs) > _FOLLOWED


def check_has_angles(path: str | Path, named: Roles) -> None:
    """Raise InputError if names say that wheels have speeds and no angles, with the entry."""
    reading = named.reading(named.speeds)
    if reading is None:
        return
    unknown = "rad/s" if reading.stem in _OMEGA else "rpm"
    unit = {"turn/s": "rpm", None: unknown}.get(reading.unit, reading.unit)
    columns = ", ".join(f'"{name}"' for name in named.speeds)
    entry = f'speed = {{ from = [{columns}], unit = "{unit}" }}'
    if reading.unit == "rps":
        entry = (
            f'speed = {{ from = [{columns}], unit = "rad/s" }} if rps are radians a second, or with unit = "rpm", '
            "scale = 60.0 if they are revolutions"
        )
    elif reading.unit == "turn/s":
        entry = entry.replace(" }", ", scale = 60.0 }")
    raise InputError(
        f"{path}: cannot determine the wheels: there are speeds ({', '.join(named.speeds)}), but no angles, and "
        f"the lean does not confirm them. Log the angles, too, or write a mapping file; in [wheels], {entry}."
    )
