"""A self-test of half a second before balancing: does each encoder turn as its motor is pushed?

One wheel after the other is pushed forward and back, the others are let be. A motor or an encoder with the wrong
sign, or cables in the wrong order, would make the balance's feedback a push away from upright; here they move a
wheel by a degree or two. The robot is held meanwhile, or stands upright by itself for so long.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.columns import wheel_angle_names
from ballbot.robot import Robot
from ballbot.robot.derived import encoder_step

#: of the whole test [s]
DURATION = 0.5
#: share of a wheel's turn at the test in which it is pushed forward, and then back
_PUSH = 0.2
#: a wheel that turns by fewer encoder counts than this has not moved
_LEAST_COUNTS = 20


class SelfTest:
    """A controller that pushes one wheel after the other, for `ballbot.simulate` and robots alike; run for `DURATION`.

    Parameters
    ----------
    robot : Robot
    torque : float
        Of each push [N m]: it must move its wheel, and with it the ball and the other wheels.

    Raises
    ------
    InputError
        Where the torque is not within the drive's limit, or not above the break-away torque that the robot's file has.
    """

    sample_time: float

    def __init__(self, robot: Robot, *, torque: float = 1.0) -> None:
        stuck = float(np.add(robot.friction.coulomb, robot.friction.stribeck).max())
        if not stuck < torque <= robot.drive.torque_limit:
            raise InputError(
                f"The self-test's torque is {torque:g} N m; it must be above the largest break-away torque, "
                f"{stuck:g} N m, and at most the torque limit of the drive, {robot.drive.torque_limit:g} N m."
            )
        self.robot = robot
        self.torque = torque
        self.sample_time = robot.sensors.sample_time

    def reset(self) -> None:
        """Forget the past; there is none."""

    def update(
        self,
        t: float,
        state: NDArray[np.float64],  # noqa: ARG002
        reference: NDArray[np.float64],  # noqa: ARG002
    ) -> NDArray[np.float64]:
        """Return the torques (n,) at time t [s] since the test's start [N m]."""
        n = self.robot.wheel_count
        torques = np.zeros(n)
        turn, within = divmod(t * n / DURATION + 1e-9, 1.0)
        if turn < n and within < 2.0 * _PUSH:
            torques[int(turn)] = self.torque if within < _PUSH else -self.torque
        return torques


@dataclass(frozen=True, kw_only=True)
class SelfTestResult:
    """What a self-test found."""

    turned: tuple[tuple[float, ...], ...]  #: by the wheel pushed, by how much each encoder turned [rad]
    findings: tuple[str, ...]  #: a sentence for each wheel that is wrong

    @property
    def passed(self) -> bool:
        """Whether the robot may balance."""
        return not self.findings


def judge_self_test(robot: Robot, log: Log) -> SelfTestResult:
    """Return what a log of `SelfTest` tells, from the encoders alone.

    Parameters
    ----------
    robot : Robot
    log : Log
        Of at least `DURATION`, from the test's start on.

    Raises
    ------
    InputError
        Where the log is shorter.
    """
    n = robot.wheel_count
    if len(log) * log.sample_time < DURATION - 0.5 * log.sample_time:
        raise InputError(
            f"The self-test's log lasts {len(log) * log.sample_time:g} s; it must last {DURATION:g} s."
        )
    angles = np.column_stack([log[name] for name in wheel_angle_names(n)])
    least = _LEAST_COUNTS * encoder_step(
        encoder_counts=robot.sensors.encoder_counts, gear_ratio=robot.drive.gear_ratio
    )
    turned, findings = [], []
    for wheel in range(n):
        first, last = (round((wheel + share) * DURATION / n / log.sample_time) for share in (0.0, _PUSH))
        turns = angles[last] - angles[first]
        turned.append(tuple(turns.tolist()))
        if sentence := _finding(wheel, turns, least):
            findings.append(sentence)
    return SelfTestResult(turned=tuple(turned), findings=tuple(findings))


def _finding(wheel: int, turns: NDArray[np.float64], least: float) -> str | None:
    most = int(np.argmax(np.abs(turns)))
    if abs(turns[most]) < least:
        return (
            f"Motor {wheel + 1} was driven and no encoder turned: the motor has no power, or its wheel is "
            "stuck."
        )
    if most != wheel:
        return (
            f"Motor {wheel + 1} was driven and encoder {most + 1} turned the most: cables are in the wrong "
            "order."
        )
    if turns[wheel] < 0.0:
        return (
            f"Motor {wheel + 1} was driven forward and its encoder turned backward: one of the two has the "
            "wrong sign."
        )
    return None
