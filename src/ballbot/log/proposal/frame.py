"""From the tests' evidence to a mapping's wheel order, signs, and the turn of the IMU.

A log follows Theta_ddot = g e^(j phase) sum_i s_i w_i e^(j +-beta_i). Turned by -phase, the IMU's lean is the robot's.
A mirrored log has wheel 1 where it is and the others in reverse, which turns it by twice wheel 1's azimuth; signs that
are all reversed turn it by half a turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbot.log.proposal.heading import HeadingTest
from ballbot.log.proposal.lean_test import LeanTest, wheel_signs
from ballbot.robot import Robot

#: people mount IMUs at multiples of this [rad]
GRID = np.pi / 6.0
#: and a turn within this of one [rad] is taken for it
ROUNDED = np.deg2rad(6.0)


@dataclass(frozen=True, kw_only=True)
class Frame:
    """How the file's wheels and IMU sit on the robot."""

    order: tuple[int, ...]  #: for the robot's wheels in turn, the file's wheel (from 1)
    signs: tuple[int, ...]  #: of the file's wheels, in the file's order
    turn: float  #: of the IMU's x axis from the robot's [rad], rounded to `GRID` where it is near
    measured_turn: float  #: [rad], as the log has it
    signs_by_heading: bool  #: whether heading says which way round all wheels count, or it is assumed


def frame_of(robot: Robot, tested: LeanTest | None, heading: HeadingTest | None) -> Frame:
    """Return the frame that the tests speak for; the robot's own where there is no lean to test."""
    count = robot.wheel_count
    own = tuple(range(1, count + 1))
    if tested is None:
        return Frame(order=own, signs=(1,) * count, turn=0.0, measured_turn=0.0, signs_by_heading=False)
    best = tested.placements[0]
    order = (1, *range(count, 1, -1)) if best.mirrored else own
    phase = best.phase - (2.0 * robot.wheels.azimuths[0] if best.mirrored else 0.0)
    known = heading is not None and heading.believed
    # without heading, the smaller turn is the likelier
    backwards = heading.backwards if heading is not None and known else np.cos(phase) < 0.0
    signs = wheel_signs(count, best.flipped) * (-1.0 if backwards else 1.0)
    turn = -_within_half_a_turn(phase + (np.pi if backwards else 0.0))
    near = GRID * round(turn / GRID)
    return Frame(
        order=order,
        signs=tuple(int(sign) for sign in signs),
        turn=float(near if abs(turn - near) <= ROUNDED else turn),
        measured_turn=float(turn),
        signs_by_heading=known,
    )


def _within_half_a_turn(angle: float) -> float:
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)
