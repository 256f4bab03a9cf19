"""The columns of a foreign file that have a role, and their smooth signals on even rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.mapping_inference.roles import Roles
from ballbot.log.mapping_inference.units import GyroTest, Scale, gyro_test
from ballbot.log.mapping_inference.wheel_response import held_commands
from ballbot.log.signals import INTERVAL, Smooth, balancing_rows, even_rows, new_messages, smooth


@dataclass(frozen=True, kw_only=True, eq=False)
class Signals:
    """The log on even rows: what was tested."""

    rows: NDArray[np.float64]  #: (N,) [s]
    wheels: Smooth  #: (N, n)
    lean: Smooth | None  #: (N, 2)
    heading: Smooth | None  #: (N, 1)
    commands: NDArray[np.float64] | None  #: (N, n), held
    usable: NDArray[np.bool_]  #: (N,), moving and not fallen


@dataclass(frozen=True, kw_only=True, eq=False)
class Raw:
    """The columns that have a role, as the file has them; the time in seconds."""

    t: NDArray[np.float64]
    angles: NDArray[np.float64]
    attitude: NDArray[np.float64] | None
    commands: NDArray[np.float64] | None
    gyro: NDArray[np.float64] | None
    gyro_unit: str | None  #: by its name

    @staticmethod
    def of(columns: dict[str, NDArray[np.float64]], roles: Roles, time: Scale) -> Raw:
        """Return the columns of a file."""

        def stacked(names: tuple[str, ...]) -> NDArray[np.float64] | None:
            return np.column_stack([_filled(columns[name]) for name in names]) if names else None

        angles, said = stacked(roles.angles), roles.reading(roles.gyro)
        if angles is None:
            raise InputError("No wheel angles were found.")
        return Raw(
            t=columns[roles.time or ""] * time.factor,
            angles=angles,
            attitude=stacked(roles.attitude),
            commands=stacked(roles.commands),
            gyro=stacked(roles.gyro),
            gyro_unit=said.unit if said else None,
        )


def _filled(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a column with missing values interpolated."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.where(known, values, 0.0)
    places = np.arange(len(values))
    return np.interp(places, places[known], values[known])


def signals_of(
    raw: Raw,
    angles: NDArray[np.float64],
    sampled: NDArray[np.float64],
    attitude: NDArray[np.float64] | None,
    *,
    width: float,
    gyro: GyroTest | None = None,
) -> Signals:
    rows, kept = even_rows(raw.t), new_messages(sampled)
    wheels = smooth(rows, sampled[kept], angles[kept], width=width)
    commands = held_commands(rows, raw.t, raw.commands) if raw.commands is not None else None
    tilt, heading = None, None
    if attitude is not None:
        tilt = smooth(rows, sampled[kept], attitude[kept, :2], width=width)
        if attitude.shape[1] > 2:
            heading = smooth(rows, sampled[kept], np.unwrap(attitude[kept, 2:], axis=0), width=width)
        if gyro is not None and raw.gyro is not None:
            # brought to the angles' time
            turned = raw.gyro[:, list(gyro.order[:2])] * gyro.factor * np.asarray(gyro.signs[:2])
            rates = smooth(rows, sampled[kept] + gyro.lag, turned[kept], width=width)
            tilt = Smooth(value=tilt.value, rate=rates.value, acceleration=rates.rate)
            if heading is None:
                about = raw.gyro[kept, gyro.order[2]][:, None] * gyro.factor * gyro.signs[2]
                turning = smooth(rows, sampled[kept] + gyro.lag, about, width=width)
                angle = INTERVAL * np.cumsum(turning.value, axis=0)
                heading = Smooth(value=angle, rate=turning.value, acceleration=turning.rate)
    return Signals(
        rows=rows,
        wheels=wheels,
        lean=tilt,
        heading=heading,
        commands=commands,
        usable=balancing_rows(tilt.value if tilt else None, wheels.rate, commands),
    )


def gyro_of(
    raw: Raw, signals: Signals, sampled: NDArray[np.float64], attitude: NDArray[np.float64] | None
) -> GyroTest | None:
    if raw.gyro is None or signals.lean is None or attitude is None:
        return None
    kept = new_messages(sampled)
    with_yaw = attitude.shape[1] > 2
    angles = np.column_stack([attitude[:, :2], np.unwrap(attitude[:, 2]) if with_yaw else 0.0 * raw.t])
    seen = smooth(signals.rows, sampled[kept], angles[kept])
    gyro = smooth(signals.rows, sampled[kept], raw.gyro[kept])
    if signals.usable.sum() < 200:
        return None
    return gyro_test(gyro, seen, signals.usable, raw.gyro_unit, with_yaw=with_yaw)
