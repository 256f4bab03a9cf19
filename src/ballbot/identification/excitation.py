"""Whether logs move enough for a quantity to show in them: asked before anything is estimated.

A log without motion or torque is refused as a whole. Short of that, what a log cannot give is refused by name: such
parameters take part in the fit, since a wheel that friction holds throughout has friction, but get no number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.coordinates import Coordinates
from ballbot.identification.quantities import BY_NAME
from ballbot.identification.windows import Windows
from ballbot.log import STATE_NAMES
from ballbot.mechanics.model import Model
from ballbot.robot import Robot

#: a wheel turns in a window where its root mean square speed there is above this [rad/s]; encoder and gyro
#: noise of a robot at rest stay below
LEAST_SPEED = 0.1
#: the share of the windows in which a wheel must turn
LEAST_SHARE = 0.1
#: windows to fit, for each parameter sought; fewer make no standard error clustered by window
WINDOWS_PER_PARAMETER = 2
#: b and c are one number where a wheel's speed varies by less than this share of it
LEAST_VARIATION = 0.1
#: what a motor's torque and its changes from row to row must reach, root mean square [N m]
LEAST_TORQUE = 5e-3
#: what must move for the rigid body to show: root mean square over the windows, and the states that do
_MOTIONS = (
    (("rolling",), ("x_dot", "y_dot"), 0.01, "m/s", "the ball hardly rolls"),
    (("center_of_mass",), ("theta", "phi"), 3e-3, "rad", "the robot hardly leans"),
    (("second_moment",), ("theta_dot", "phi_dot"), 0.02, "rad/s", "the lean hardly changes"),
    (("pivoting",), ("psi_dot",), 0.05, "rad/s", "the heading hardly turns"),
    (("imu_delay",), ("theta_dot", "phi_dot"), 5e-3, "rad/s", "the lean hardly changes"),
    (("velocity_delay",), ("x_dot", "y_dot"), 0.01, "m/s", "the ball hardly rolls"),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Excitation:
    """What logs can give."""

    refused: NDArray[np.bool_]  #: (p,), parameters sought that they cannot
    remarks: tuple[str, ...]  #: a sentence for each reason


def check_count(windows: Windows, *, fitted: int, parameters: int) -> None:
    """Refuse too few windows.

    Raises
    ------
    InputError
        Where the windows to fit are fewer than `WINDOWS_PER_PARAMETER` times the parameters.
    """
    least = WINDOWS_PER_PARAMETER * parameters
    if fitted < least:
        length = windows.samples * windows.sample_time
        raise InputError(
            f"The logs have {len(windows)} windows of {length:g} s without gaps or "
            f"missing values, of which {fitted} are used to fit {parameters} parameters; "
            f"this needs at least {least}. Log the robot balancing for longer."
        )


def check_torques(windows: Windows) -> None:
    """Refuse torques that are the same in every row, which balance nothing.

    Raises
    ------
    InputError
        Where no motor's torque ever changes.
    """
    torques = windows.torques.reshape(-1, windows.torques.shape[-1])
    if np.any(torques) and np.all(np.ptp(torques, axis=0) == 0.0):
        values = ", ".join(f"{u:g}" for u in torques[0])
        raise InputError(
            f"The torques u are {values} N m in every row of the windows, which no "
            "balancing robot's are: the columns are not the torques of its motors."
        )


def check_excitation(windows: Windows, robot: Robot, coordinates: Coordinates) -> Excitation:
    """Refuse logs without motion, and of those with it what they cannot give.

    Raises
    ------
    InputError
        Where no wheel turns in enough windows, no torque is ever applied, or nothing that is sought can be given.
    """
    if not np.any(windows.torques):
        raise InputError(
            "The torques u are zero in every window of the logs; friction shows only while motors work."
        )
    speeds = Model(robot).wheel_speed(windows.measured[..., :5], windows.measured[..., 5:])
    turning = np.sqrt((speeds**2).mean(axis=1)) > LEAST_SPEED
    if np.all(turning.mean(axis=0) < LEAST_SHARE):
        raise InputError(
            f"The robot stands still: a wheel turns faster than {LEAST_SPEED:g} "
            f"rad/s in only {turning.any(axis=1).sum()} of {len(windows)} "
            "windows. Log it while it moves, such as around a square."
        )
    found = [*_still_wheels(turning), *_steady_wheels(speeds), *_motors(windows), *_motions(windows)]
    refused, remarks = np.zeros(len(coordinates.labels), dtype=bool), []
    for names, wheel, reason in found:
        rows = _rows(coordinates, names, wheel) & coordinates.free & ~refused
        if rows.any():
            labels = [label for label, row in zip(coordinates.labels, rows, strict=True) if row]
            remarks.append(f"{reason}: {', '.join(labels)} cannot be estimated.")
            refused |= rows
    if np.all(refused[coordinates.free]):
        raise InputError(f"These logs do not determine the parameters to be estimated: {' '.join(remarks)}")
    return Excitation(refused=refused, remarks=tuple(remarks))


_Reason = tuple[tuple[str, ...], int | None, str]  # quantities, of which wheel, and why


def _still_wheels(turning: NDArray[np.bool_]) -> list[_Reason]:
    names = ("viscous", "coulomb", "stribeck", "load", "torque_gain", "torque_offset")
    return [
        (
            names,
            int(i),
            f"Wheel {i + 1} turns in only {turning[:, i].sum()} of "
            f"{len(turning)} windows; drive in another direction too",
        )
        for i in np.flatnonzero(turning.mean(axis=0) < LEAST_SHARE)
    ]


def _steady_wheels(speeds: NDArray[np.float64]) -> list[_Reason]:
    size = np.abs(speeds).reshape(-1, speeds.shape[-1])
    steady = size.std(axis=0) < LEAST_VARIATION * size.mean(axis=0)
    return [
        (
            ("viscous",),
            int(i),
            f"Wheel {i + 1} turns at one speed, {size[:, i].mean():.2g} rad/s; drive at other speeds too",
        )
        for i in np.flatnonzero(steady)
    ]


def _motors(windows: Windows) -> list[_Reason]:
    size = np.sqrt((windows.torques**2).mean(axis=(0, 1)))
    weak: list[_Reason] = [
        (
            ("torque_gain", "load"),
            int(i),
            f"Motor {i + 1} gives only {size[i]:.2g} N m; make it work harder",
        )
        for i in np.flatnonzero(size < LEAST_TORQUE)
    ]
    change = float(np.sqrt((np.diff(windows.torques, axis=1) ** 2).mean()))
    if change < LEAST_TORQUE:
        weak.append(
            (
                ("delay",),
                None,
                f"The torques change by only {change:.2g} N m per row; a step of the reference would help",
            )
        )
    return weak


def _motions(windows: Windows) -> list[_Reason]:
    found: list[_Reason] = []
    for names, states, least, unit, words in _MOTIONS:
        columns = [STATE_NAMES.index(state) for state in states]
        size = float(np.sqrt((windows.measured[..., columns] ** 2).mean()))
        if size < least:
            reason = (
                f"For {' and '.join(names)}, {words} ({size:.2g} "
                f"{unit} root mean square; {least:g} are needed)"
            )
            found.append((names, None, reason))
    return found


def _rows(coordinates: Coordinates, names: tuple[str, ...], wheel: int | None) -> NDArray[np.bool_]:
    """Return which parameters (p,) are of these quantities, and of that wheel where one is given."""
    mine = np.array([name in names for name in coordinates.names])
    if wheel is None:
        return mine
    ends = np.array([label.endswith(str(wheel + 1)) for label in coordinates.labels])
    return mine & ends & np.array([BY_NAME[name].each == "wheels" for name in coordinates.names])
