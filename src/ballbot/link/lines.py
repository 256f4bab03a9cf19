"""A live robot on a terminal: its samples, its state and the frames refused, each in one line."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ballbot.firmware.records import SelfTestOutcome
from ballbot.link.live import RobotSample
from ballbot.link.messages import State
from ballbot.link.session import stop_reason
from ballbot.rounding import percent

_SELF_TESTS = {
    SelfTestOutcome.NOT_RUN: "not run",
    SelfTestOutcome.RUNNING: "running",
    SelfTestOutcome.PASSED: "passed",
    SelfTestOutcome.HOLD_UPRIGHT: "waits for the robot upright",
    SelfTestOutcome.TILT_FORWARD: "waits for a tilt forward",
    SelfTestOutcome.TILT_LEFT: "waits for a tilt to the left",
    SelfTestOutcome.TURN_LEFT: "waits for a turn to the left",
    SelfTestOutcome.IMU_PASSED: "the IMU's axes are right",
    SelfTestOutcome.IMU_AXES: "failed (the IMU's axes)",
    SelfTestOutcome.IMU_GYRO: "failed (the gyro)",
}


def sample_line(sample: RobotSample, *, torque_limit: float) -> str:
    """Return a sample in one line."""
    x, y, theta, phi, psi = sample.state[:5]
    away = math.hypot(*(sample.state[:2] - sample.reference[:2]))
    lean = math.acos(min(1.0, math.cos(theta) * math.cos(phi)))
    return (
        f"{sample.t:.1f} s, at ({x:+.3f}, {y:+.3f}) m, psi {math.degrees(psi):+.1f} degrees, "
        f"{1e3 * away:.0f} mm from the reference, lean {math.degrees(lean):.1f} degrees, "
        f"torque {percent(_share(sample, torque_limit))} of the limit"
    )


def bench_line(sample: RobotSample, *, torque_limit: float) -> str:
    """Return a sample of a held robot in one line."""
    speeds = " ".join(f"{speed:+.1f}" for speed in sample.wheel_speeds)
    torques = " ".join(f"{torque:+.2f}" for torque in sample.torques)
    return (
        f"{sample.t:.1f} s, torques {torques} N m ({percent(_share(sample, torque_limit))} of the limit), "
        f"wheel speeds {speeds} rad/s"
    )


def state_line(state: State, *, wheel_count: int) -> str:
    """Return a state in one line."""
    theta, phi, psi = np.degrees(state.attitude)
    gyro = " ".join(f"{rate:+.2f}" for rate in state.gyro)
    counts = " ".join(map(str, state.wheel_counts[:wheel_count].tolist()))
    speeds = " ".join(f"{speed:+.1f}" for speed in state.wheel_speeds[:wheel_count])
    stop = stop_reason(state)
    test = _SELF_TESTS.get(SelfTestOutcome(state.self_test), f"failed (wheel {state.self_test_wheel})")
    return (
        f"{'armed' if state.armed else 'disarmed'}, self-test {test}, "
        f"theta {theta:+.1f}, phi {phi:+.1f}, psi {psi:+.1f} degrees, gyro {gyro} rad/s, counts {counts}, "
        f"wheel speeds {speeds} rad/s" + (f", stopped: {stop}" if stop else "")
    )


def _share(sample: RobotSample, torque_limit: float) -> float:
    return float(np.abs(sample.torques).max()) / torque_limit


def counts_line(host: Sequence[int], robot: Sequence[int]) -> str | None:
    """Return a line on frames that either side refused, by the layers' counts; None if there are none."""
    if not (any(host) or any(robot)):
        return None
    return (
        f"Frames refused: {sum(host)} by this computer, {sum(robot)} by the robot; the cable, the baud rate or the "
        "radio loses bytes."
    )
