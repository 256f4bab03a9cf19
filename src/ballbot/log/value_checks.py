"""Checks of single columns: dead or stuck sensors, saturated torques, names that mean nothing."""

import difflib

import numpy as np

from ballbot.findings import Finding, Place
from ballbot.log.columns import KNOWN_NAMES, STATE_NAMES, TRUE_PREFIX, wheel_speed_names
from ballbot.log.log import Log
from ballbot.log.repetition_checks import standstill
from ballbot.robot import Robot
from ballbot.robot.derived import wheel_speed_limit

#: standard deviation of a state that moves [m, rad, m/s, rad/s]
LEAST_MOVING = 1e-3
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
    sentence = f"Columns that Ballbot does not know and does not use: {', '.join(words)}."
    return [Finding(severity="note", code="unknown", text=sentence, where=Place(columns=tuple(unknown)))]


def check_constant(log: Log) -> list[Finding]:
    """Return a finding for each sensor or torque column that never changes, and a note for references."""
    findings = []
    for name in log.names:
        values = log[name]
        if name == "t" or len(log) < 2 or not np.all(values == values[0]):
            continue
        if name.startswith("ref_"):
            sentence = f"{name} is {values[0]:g} throughout: the reference is constant."
            findings.append(
                Finding(severity="note", code="constant", text=sentence, where=Place(columns=(name,)))
            )
        elif not name.startswith(TRUE_PREFIX):
            findings.append(_dead_column(log, name))
    return findings


def _dead_column(log: Log, name: str) -> Finding:
    """Return the finding on a column that never changes: an error if it is a state whose rate, or angle, does."""
    other = name.removesuffix("_dot") if name.endswith("_dot") else f"{name}_dot"
    moving = name in STATE_NAMES and other in log and float(np.nanstd(log[other])) > LEAST_MOVING
    though = f" though {other} changes" if moving else ""
    return Finding(
        severity="error" if moving else "warning",
        code="constant",
        text=f"{name} is {log[name][0]:g} throughout{though}, as if its sensor or cable were dead.",
        where=Place(columns=(name,)),
    )


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
        longest = standstill(np.where(size == peak, 1.0, np.arange(len(size)) + 2.0))
        start, length = longest.start, longest.rows
        if peak > 0.0 and length >= SATURATED_ROWS and length < len(log):
            share = float(np.mean(size == peak))
            sentence = (
                f"{name} is at {peak:.4g} N m in {100 * share:.2g} % of the rows, first for long at row "
                f"{start + 1} (t = {log.t[start]:.6g} s): it is saturated there, and no control law holds."
            )
            if torque_limit is not None and peak < 0.9 * torque_limit:
                limit = f"The robot's limit is {torque_limit:.4g} N m"
                sentence += f" {limit}: the driver has a lower limit, or the recording clips."
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
                f"{name} reaches {peak:.4g} N m, above the robot's limit of {torque_limit:.4g} "
                "N m: the input may not be a torque, or the limit in the robot file is too low."
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
                f"{name} exceeds {limit:.4g} rad/s, the limit of the robot's supply "
                f"and motors, in {beyond.size} rows from row {beyond[0] + 1} (t = "
                f"{time:.6g} s): the commanded torque is not the torque that acted."
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
