"""The spring that puts a driveline's resonance where the user says.

The rotor (reflected inertia j_r) hangs by a spring of stiffness k on its wheel, behind which the robot stands
on its ball. With m the mobility of that wheel, the angular acceleration that a unit torque on it gives
the robot without rotors,

    (2 pi f)^2 = k (1/j_r + m)        d = 2 zeta k / (2 pi f)

m = W M^-1 W^T has an eigenvalue for each way of moving (forward, sideways, turning). They are small beside 1/j_r
and close together, so that one spring serves all within a part in a hundred on the BBR.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ballbot.mechanics.model import Model
from ballbot.robot.derived import reflected_rotor_inertia
from ballbot.robot.robot import Robot
from ballbot.twin.faults import Compliance


@dataclass(frozen=True, kw_only=True)
class Spring:
    """A torsional spring with its damper."""

    stiffness: float  #: [N m/rad]
    damping: float  #: [N m s/rad]


def driveline_spring(robot: Robot, compliance: Compliance) -> Spring:
    """Return the spring of each driveline with which the robot has that resonance."""
    rate = 2 * math.pi * compliance.frequency
    stiffness = rate**2 / (1 / rotor_inertia(robot) + _mobility(robot))
    return Spring(stiffness=stiffness, damping=2 * compliance.damping_ratio * stiffness / rate)


def rotor_inertia(robot: Robot) -> float:
    """Return j_r [kg m^2], rotor and gear as seen at the wheel."""
    drive = robot.drive
    return reflected_rotor_inertia(
        gear_ratio=drive.gear_ratio, motor_inertia=drive.motor_inertia, gear_inertia=drive.gear_inertia
    )


def _mobility(robot: Robot) -> float:
    """Return the smallest m above zero [1/(kg m^2)]: the slowest way of moving."""
    tiny = 1e-12 * robot.drive.motor_inertia
    without_rotors = robot.replace(drive=replace(robot.drive, motor_inertia=tiny, gear_inertia=0.0))
    model, upright = Model(without_rotors), np.zeros(5)
    W = np.array([model.wheel_speed(upright, rate) for rate in np.eye(5)]).T
    mobilities = np.linalg.eigvalsh(W @ np.linalg.solve(model.mass_matrix(upright), W.T))
    # four wheels can also work against each other without moving anything
    return float(mobilities[mobilities > 1e-9 * mobilities.max()].min())
