"""Checks of single columns: dead or stuck sensors, saturated torques, names that mean nothing."""

import difflib

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place
from ballbot.log.columns import KNOWN_NAMES, TRUE_PREFIX, wheel_speed_names
from ballbot.log.log import Log
from ballbot.robot import Robot
from ballbot.robot.derived import wheel_speed_limit

#: columns of sensors with noise; an encoder that stands still may be right
NOISY_PREFIXES = ("theta", "phi", "psi", "gyro_", "acc_", "ball_omega_")
#: a column that changes at this share of the rows is a live one, whose standing still is a fault
LIVE_SHARE = 0.9
#: shortest standstill of a live column that is told [s]
STUCK_TIME = 0.1
STUCK_ROWS = 10
#: a limit shows as at least this many equal extreme torques in a row
SATURATED_ROWS = 3


def check_names(log: Log) -> list[Finding]:
    """Return a note on columns that have no meaning here, with the name that was perhaps meant."""
    unknown = [name for name in log.names if name not in KNOWN_NAMES]
    if not unknown:
        return []
    words = []
    for name in unknown:
        near = difflib.get_close_matches(name, KNOWN_NAMES, n=1, cutoff=0.8)
        words.append(f"{name} (did you mean {near[0]}?)" if near else name)
    sentence = f"Columns that Ballbot gives no meaning and leaves alone: {', '.join(words)}."
    return [Finding(severity="note", code="unknown", text=sentence, where=Place(columns=tuple(unknown)))]


def check_constant(log: Log) -> list[Finding]:
    """Return a warning for each sensor or torque column that never changes, and a note for references."""
    findings = []
    for name in log.names:
        values = log[name]
        if name == "t" or len(log) < 2 or not np.all(values == values[0]):
            continue
        if name.startswith("ref_"):
            sentence = f"{name} is {values[0]:g} throughout: the reference holds still."
            findings.append(
                Finding(severity="note", code="constant", text=sentence, where=Place(columns=(name,)))
            )
        elif not name.startswith(TRUE_PREFIX):
            sentence = f"{name} is {values[0]:g} throughout, as if its sensor or cable were dead."
            findings.append(
                Finding(severity="warning", code="constant", text=sentence, where=Place(columns=(name,)))
            )
    return findings


def check_stuck(log: Log) -> list[Finding]:
    """Return a warning for each noisy column that for a while repeats one value to the last bit.

    Columns that do not change at nearly every other row (a slow sensor's) are left out.
    """
    findings = []
    if len(log) < 2 * STUCK_ROWS:
        return []
    shortest = max(STUCK_ROWS, round(STUCK_TIME / log.sample_time))
    for name in (n for n in log.names if n.startswith(NOISY_PREFIXES)):
        start, length, others_change = _longest_run(log[name])
        if length < shortest or others_change < LIVE_SHARE:
            continue
        time = float(log.t[start])
        sentence = (
            f"{name} repeats {log[name][start]:.6g} for {length} rows from row {start + 1} "
            f"(t = {time:.6g} s), though it changes at nearly all others: "
            "the sensor froze, messages were lost, or all was at rest."
        )
        findings.append(
            Finding(severity="warning", code="stuck", text=sentence, where=Place(columns=(name,), time=time))
        )
    return findings


def check_saturation(log: Log, *, torque_limit: float | None = None) -> list[Finding]:
    """Return a warning for each torque that stands at its limit.

    Parameters
    ----------
    log : Log
        Its columns u1, u2, .. are looked at.
    torque_limit : float, optional
        The robot's own limit [N m]; a torque above it is told too.
    """
    findings = []
    for name in (n for n in log.names if n.startswith("u") and n[1:].isdigit()):
        size = np.nan_to_num(np.abs(log[name]))
        peak = float(size.max())
        start, length, _ = _longest_run(np.where(size == peak, 1.0, np.arange(len(size)) + 2.0))
        if peak > 0.0 and length >= SATURATED_ROWS and length < len(log):
            share = float(np.mean(size == peak))
            sentence = (
                f"{name} stands at {peak:.4g} N m in {100 * share:.2g} % of the rows, first for long at row "
                f"{start + 1} (t = {log.t[start]:.6g} s): it is saturated there, and a controller's law does "
                f"not hold."
            )
            findings.append(
                Finding(
                    severity="warning",
                    code="saturation",
                    text=sentence,
                    where=Place(columns=(name,), time=float(log.t[start])),
                )
            )
        # 1 %: rounding in the file
        if torque_limit is not None and peak > 1.01 * torque_limit:
            sentence = (
                f"{name} reaches {peak:.4g} N m, where the robot's limit is {torque_limit:.4g} N m: "
                f"the input is perhaps not a torque, or the robot file's limit is too low."
            )
            findings.append(
                Finding(severity="warning", code="torque-limit", text=sentence, where=Place(columns=(name,)))
            )
    return findings


def check_speed_limit(log: Log, robot: Robot) -> list[Finding]:
    """Return a warning where a wheel reaches the speed at which the robot's drives have no torque left."""
    drive = robot.drive
    limit = wheel_speed_limit(
        supply_voltage=drive.supply_voltage, speed_constant=drive.speed_constant, gear_ratio=drive.gear_ratio
    )
    findings = []
    for name in (n for n in wheel_speed_names(robot.wheel_count) if n in log):
        beyond = np.flatnonzero(np.abs(log[name]) > limit)
        if beyond.size:
            time = float(log.t[beyond[0]])
            sentence = (
                f"{name} passes {limit:.4g} rad/s, the limit of the robot's supply and motors, "
                f"in {beyond.size} rows from row {beyond[0] + 1} (t = {time:.6g} s): "
                "the torque commanded is not what was there."
            )
            findings.append(
                Finding(
                    severity="warning",
                    code="speed-limit",
                    text=sentence,
                    where=Place(columns=(name,), time=time),
                )
            )
    return findings


def _longest_run(values: NDArray[np.float64]) -> tuple[int, int, float]:
    """Return start and length of the longest run of equal values, and the share of changes outside it."""
    changed = np.flatnonzero(values[1:] != values[:-1]) + 1
    starts = np.concatenate(([0], changed))
    lengths = np.diff(np.concatenate((starts, [len(values)])))
    k = int(np.argmax(lengths))
    outside = len(values) - int(lengths[k])
    return int(starts[k]), int(lengths[k]), len(changed) / outside if outside else 0.0
