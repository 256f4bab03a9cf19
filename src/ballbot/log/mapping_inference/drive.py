"""What the commands of a foreign log are, once its wheels and its IMU are known.

The log is mapped with the commands as the file has them, and held against the torques that the motion needs. With
wheels that turn free, each wheel needs its own inertia's torque.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.checks.lean import motion_of, usable_rows
from ballbot.log.checks.torque_balance import (
    FALLING,
    SIGN,
    TURNING,
    Driving,
    driving_of,
    gravity_need,
    smoothed_wheel_speeds,
)
from ballbot.log.columns import torque_names, wheel_speed_names
from ballbot.log.log import Log
from ballbot.log.mapping import LogMapping, apply_mapping
from ballbot.log.mapping_inference.command_units import (
    GAIN_BIAS,
    Unit,
    contradicting_factor,
    unit_probabilities,
    units_of,
)
from ballbot.log.mapping_inference.commands import Assignment, Response, assign, response
from ballbot.log.mapping_inference.dead_band import (
    DeadBandEstimate,
    UndoneDeadBand,
    dead_band_estimate,
    undone_dead_band,
)
from ballbot.log.mapping_inference.evidence import TINY
from ballbot.log.mapping_inference.names import Reading
from ballbot.log.mapping_inference.stall import back_emf_damping, stall_resistance
from ballbot.log.pose import with_odometry
from ballbot.log.signals import MOVING_SPEED, even_rows, smooth
from ballbot.robot import Robot

#: filter of wheels that turn free [s]
FREE_WIDTH = 0.05


@dataclass(frozen=True, kw_only=True)
class DriveEvidence:
    """What the commands are."""

    assigned: Assignment | None  #: None if the motion cannot be compared with the commands
    response: Response | None
    units: dict[Unit, float]  #: probability of each kind and unit, the likeliest first
    standstill: dict[Unit, float]  #: torque [N m] at standstill of one in the file, by its kind and unit
    #: size (standard deviation) of the commands over what the back-EMF leaves of them if they are duties
    braked: float = math.nan
    #: part of a wheel's own torques that a dead band of the size of all wheels' adds beyond what dry friction takes, of
    #: the wheel where it is largest
    turning_against: float = math.nan
    dead_band: DeadBandEstimate | None = None  #: None if the log is too short
    resistance: float = math.nan  #: of `stall_resistance` [ohm]
    known_inertia: bool = True  #: whether what the wheels need is that of a whole robot
    #: how many times as large as the motion needs the commands of the likeliest unit are, if that contradicts it
    contradicting_factor: float | None = None

    @property
    def unit(self) -> Unit:
        """The likeliest kind and unit."""
        return next(iter(self.units))

    @property
    def duty_of_size(self) -> float:
        """The size of what drives, as a duty; nan if it is unknown."""
        return math.nan if self.dead_band is None else self.dead_band.size * self.unit.scale

    @property
    def undone_dead_band(self) -> UndoneDeadBand | None:
        """What is undone of a dead band that nobody states; None of commands that are no duties."""
        if self.unit.kind != "duty" or self.response is None:
            return None
        full_duty = 0.0 if self.dead_band is None else 1.0 / self.duty_of_size
        return undone_dead_band(self.turning_against, self.dead_band, full_duty=full_duty)

    @property
    def torque_ratio(self) -> tuple[float, float] | None:
        """Torques at standstill of the likeliest unit over those that the motion needs, and the error of its logarithm.

        Masses and heights count as the robot file has them. None if the log does not show it.
        """
        found = self.response
        if found is None or not self.known_inertia or not found.gain * found.gain_error > 0.0:
            return None
        error = math.hypot(RATIO_ERROR, found.gain_error)
        return found.gain * self.standstill[self.unit] * math.exp(-gain_bias(self.unit)), error


def gain_bias(unit: Unit) -> float:
    """Return by how much [log] friction that the terms lack makes a gain too large; see `RATIO_ERROR` for duties."""
    return GAIN_BIAS if unit.kind in ("torque", "current") else 0.0


#: error of the torques' ratio beyond its jackknife [log]: of 142 logs of duties of the development halves, whose
#: resistance is the assumed one, the median is 0.01 and the standard deviation beyond the jackknife 0.06. With the bias
#: of torques and currents the median would be -0.06: it is not taken from duties and voltages. A robot file's masses
#: are taken to be known to a tenth, which is added
RATIO_ERROR = math.hypot(0.06, 0.1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Compared:
    """Commands beside the torques that the motion needs, at the rows of `driving`."""

    driving: Driving  #: with the commands as its torques
    pulled: NDArray[np.float64]  #: (N, n) gravity's part of the need, by wheel [N m]
    senses: NDArray[np.float64]  #: (N, n) sense in which each wheel turns, filtered; zero while it does not
    signs: NDArray[np.float64]  #: (N, wheels, commands) sign of each command while each wheel turns, filtered


def drive_evidence(
    mapping: LogMapping,
    table: dict[str, NDArray[np.float64]],
    commands: NDArray[np.float64],
    robot: Robot,
    *,
    reading: Reading | None,
    expected: Sequence[tuple[int, int]],
    full_duties: Mapping[float, float] | None = None,
) -> DriveEvidence:
    """Return what the commands are.

    Parameters
    ----------
    mapping : LogMapping
        With the commands as torques, in the file's order.
    table : dict of str to (M,) array
        The file's columns.
    commands : ndarray (M, n)
    robot : Robot
    reading : Reading, optional
        The first command's name.
    expected : sequence of tuple of int
        As `assign` takes it.
    full_duties : mapping of float to float, optional
        As `unit_probabilities` takes it.
    """
    try:
        log = Log(apply_mapping(mapping, table))
        compared = _balancing(log, robot) if mapping.attitude is not None else _free(log, robot)
    except InputError:  # too short, or rows without a value
        compared = None
    assigned, found = None, None
    if compared is not None:
        assigned = assign(compared.driving, expected)
        if assigned.confidence > 0.5:
            found = response(compared.driving, assigned, compared.pulled)
    known_inertia = mapping.attitude is not None
    units = unit_probabilities(
        robot,
        found,
        commands,
        named_kind=reading.input_kind if reading else None,
        named_unit=reading.unit if reading else None,
        known_inertia=known_inertia,
        full_duties=full_duties,
    )
    unit, standstill = next(iter(units)), units_of(robot, full_duties)
    braked, turning_against, dead_band = math.nan, math.nan, None
    if compared is not None and assigned and found:
        braking = back_emf_damping(robot) if unit.kind in ("duty", "voltage") else 0.0
        size, driving = (_sizes(compared.driving, assigned, found.gain * one) for one in (0.0, braking))
        braked = float(np.linalg.norm(size) / max(float(np.linalg.norm(driving)), TINY))
        turning_against = _turning_against(compared, assigned, driving)
        dead_band = dead_band_estimate(compared.driving, assigned, compared.signs, driving)
    return DriveEvidence(
        assigned=assigned,
        response=found,
        units=units,
        standstill=standstill,
        braked=braked,
        turning_against=turning_against,
        dead_band=dead_band,
        resistance=stall_resistance(robot),
        known_inertia=known_inertia,
        contradicting_factor=contradicting_factor(unit, standstill[unit], found, known_inertia=known_inertia),
    )


def _sizes(driving: Driving, assigned: Assignment, braking: float) -> NDArray[np.float64]:
    """Return the standard deviation (n,) of each wheel's command, less what brakes it [in their unit, a rad/s]."""
    place = np.argsort(assigned.wheels)
    commands = (driving.torque * np.asarray(assigned.signs, dtype=np.float64))[:, place]
    return (commands - braking * driving.friction[:, :, 1]).std(axis=0)


def _turning_against(compared: Compared, assigned: Assignment, driving: NDArray[np.float64]) -> float:
    """Return the largest size, of all wheels, of sgn d_i - sgn w_i while wheel i turns, of command d_i and speed w_i.

    A dead band d_0 and dry friction c act as no dead band and dry friction c - d_0 but for d_0 times that, which is
    zero unless a wheel turns or creeps against its command, or coasts at a command of zero. A wheel that sticks counts
    as no difference. The dead band is one for all wheels, so that each size is over the part (n,) of its own command
    that is `driving`, relative to that of all wheels: a wheel that hardly drives would have a torque of mostly dead
    band.
    """
    place = np.argsort(assigned.wheels)
    signs = np.asarray(assigned.signs, dtype=np.float64)[place]
    wheels = np.arange(len(place))
    left = signs * compared.signs[:, wheels, place] - compared.senses
    usual = float(np.sqrt(np.square(driving).mean()))
    return float((left.std(axis=0) * usual / np.maximum(driving, TINY)).max())


def _senses_and_signs(commands: NDArray[np.float64], speeds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (M, n + n^2): the sense in which each wheel turns, and each command's sign while it does."""
    senses = np.sign(speeds)
    signs = np.abs(senses)[:, :, None] * np.sign(commands)[:, None, :]
    return np.hstack([senses, signs.reshape(len(signs), -1)])


def _compared(driving: Driving, pulled: NDArray[np.float64], filtered: NDArray[np.float64]) -> Compared:
    """Return a comparison from the filtered columns of `_senses_and_signs`."""
    n = driving.torque.shape[1]
    return Compared(
        driving=driving,
        pulled=pulled,
        senses=filtered[:, :n],
        signs=filtered[:, n:].reshape(-1, n, n),
    )


def _balancing(log: Log, robot: Robot) -> Compared | None:
    """Return what a log of balancing has to compare; None without enough balancing."""
    log = with_odometry(log, robot)
    rows = usable_rows(log, robot)
    if rows is None:
        return None
    motion = motion_of(log, rows)
    driving = driving_of(log, rows, motion, robot)
    if driving is None:
        return None
    u = np.column_stack([log[name] for name in torque_names(robot.wheel_count)])
    signs = _senses_and_signs(u, smoothed_wheel_speeds(log, robot))
    filtered = rows.filtered(log, signs, late=0.5 * log.sample_time).value
    return _compared(driving, gravity_need(motion, robot), filtered)


def _free(log: Log, robot: Robot) -> Compared | None:
    """Return the same of wheels that turn free."""
    n = robot.wheel_count
    speeds = np.column_stack([log[name] for name in wheel_speed_names(n)])
    u = np.column_stack([log[name] for name in torque_names(n)])
    rows, late = even_rows(log.t), 0.5 * log.sample_time
    moved = smooth(rows, log.t, speeds, width=FREE_WIDTH)
    turned = np.abs(moved.value).max(axis=1) > MOVING_SPEED
    if turned.sum() < 600:
        return None
    drive = robot.drive
    inertia = robot.wheels.inertia + drive.gear_ratio**2 * (drive.motor_inertia + drive.gear_inertia)
    sign = np.tanh(speeds / SIGN)
    parts = (sign, speeds, sign * np.exp(-np.abs(speeds) / FALLING), (np.abs(speeds) > TURNING).astype(float))
    features = smooth(rows, log.t, np.hstack(parts), width=FREE_WIDTH).value[turned]
    held = np.hstack([u, _senses_and_signs(u, speeds)])
    filtered = smooth(rows, log.t + late, held, width=FREE_WIDTH).value[turned]
    _, block = np.unique(np.floor(rows[turned] - rows[0]).astype(int), return_inverse=True)
    needed = inertia * moved.rate[turned]
    driving = Driving(
        torque=filtered[:, :n],
        needed=needed,
        friction=np.stack([features[:, k * n : (k + 1) * n] for k in range(3)], axis=-1),
        turning=np.clip(features[:, 3 * n :], 0.0, 1.0),
        block=block,
    )
    return _compared(driving, needed, filtered[:, n:])
