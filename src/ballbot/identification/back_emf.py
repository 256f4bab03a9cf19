"""Motors driven by voltage: their back-EMF brakes with the wheel's speed, and where that belongs.

A motor on a duty d gives u = n k_t (d V - k_e n w) / R = u_0 - b_e w, with the torque at standstill
u_0 = n k_t V d / R and b_e = n^2 k_t k_e / R. A log of duties becomes torques u with the speed w that was measured.
What was commanded is u_0, though, and in a prediction the brake must follow the predicted speed: a model that turns too
fast would else not be braked for it. So identification predicts with u_0 = u + b_e w and with the viscous friction
b + b_e, and gives b.

Where b_e is not known, a duty scaled to a torque may stand for u_0 and the viscous friction found is b + b_e.
"""

from __future__ import annotations

import math
from pathlib import Path

from ballbot.errors import InputError
from ballbot.identification.wheel_speeds import measured_wheel_speeds
from ballbot.log import Log
from ballbot.log.columns import torque_names
from ballbot.log.drive_input import DutyInput
from ballbot.log.mapping_file import read_mapping
from ballbot.robot import Robot


def standstill_torques(log: Log, robot: Robot, back_emf: float) -> Log:
    """Return the log with u_0 in place of u.

    Parameters
    ----------
    back_emf : float
        b_e [N m s/rad], the same for every motor.

    Raises
    ------
    InputError
        Where b_e is no number from zero up.
    """
    if not (math.isfinite(back_emf) and back_emf >= 0.0):
        raise InputError(f"back_emf is {back_emf!r}; it must be n^2 k_t k_e / R in N m s/rad, zero or more.")
    speeds = measured_wheel_speeds(log, robot)
    names = torque_names(robot.wheel_count)
    return log.with_columns({name: log[name] + back_emf * speeds[:, i] for i, name in enumerate(names)})


def back_emf_of(mapping: str | Path | None) -> float:
    """Return b_e [N m s/rad] of the motors that a mapping file describes; zero where the log has torques or currents.

    Raises
    ------
    InputError
        Where the file cannot be read or is no mapping.
    """
    motors = read_mapping(mapping).motors if mapping else None
    if motors is None or not isinstance(motors.drive, DutyInput):
        return 0.0
    drive = motors.drive
    return drive.gear_ratio**2 * drive.torque_constant * drive.back_emf_constant / drive.resistance
