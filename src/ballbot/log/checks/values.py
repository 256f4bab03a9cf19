"""Checks of values: spikes, dead or saturated columns, unknown names, leans in degrees, falls, wraps, jumps, offsets.

A value is a spike if it differs from both neighbouring rows, to the same side, by more than five times the range of
nearly all others: a corrupted message, or a marker such as 9999 for a missing one. A motion takes several rows to get
there and back, and noise of that size would affect many rows.

Positions and angles must change from row to row by the integral of their rates. The mean lean of a balancing robot is
near zero, since a constant lean is a constant acceleration.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import nearest
from ballbot.findings import Finding, Place
from ballbot.log.checks.repetition import standstill
from ballbot.log.columns import (
    KNOWN_NAMES,
    POSITION_NAMES,
    STATE_NAMES,
    TRUE_PREFIX,
    numbered_names,
    unit_of,
    wheel_speed_names,
)
from ballbot.log.log import Log
from ballbot.robot import Robot
from ballbot.robot.derived import wheel_speed_limit
from ballbot.summary import counted

#: a spike differs by so many times the range of the others, without this fraction of them at either end
_FAR, _ENDS = 5.0, 0.005
#: accelerometers measure shocks, and references may jump
_NOT_EXAMINED = ("ref_", "acc_", TRUE_PREFIX)
#: references and true states, which no sensor measures
_NOT_MEASURED = ("ref_", TRUE_PREFIX)
#: what the reference is of
_REFERENCES = {"ref_x": " of x", "ref_y": " of y", "ref_psi": " of the heading"}
#: with fewer rows the usual range is unknown
_LEAST_ROWS = 50


def spikes(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which rows of a signal (N,) are spikes; the first and the last, and missing values, never are."""
    found = np.zeros(len(values), dtype=bool)
    rows = np.flatnonzero(np.isfinite(values))
    if rows.size < _LEAST_ROWS:
        return found
    known = values[rows]
    steps = np.diff(known)
    there, back = steps[:-1], -steps[1:]
    off = np.where(there * np.sign(back) > 0.0, np.minimum(np.abs(there), np.abs(back)), 0.0)
    excluded = math.ceil(_ENDS * known.size)
    ordered = np.sort(known)
    usual = ordered[-1 - excluded] - ordered[excluded]
    found[rows[1:-1]] = (usual > 0.0) & (off > _FAR * usual)
    return found


def spiked_rows(log: Log, names: Sequence[str]) -> NDArray[np.bool_]:
    """Return which rows of a log (N,) have a spike in one of these columns."""
    return np.any([spikes(log[name]) for name in names], axis=0)


def check_spikes(log: Log) -> list[Finding]:
    """Return a warning for each column with spikes."""
    findings = []
    for name in _examined(log):
        rows = np.flatnonzero(spikes(log[name]))
        if not rows.size:
            continue
        time = float(log.t[rows[0]])
        number = "one row" if rows.size == 1 else f"each of {rows.size} rows"
        sentence = (
            f"{name} jumps away and back at {number}, to {log[name][rows[0]]:.6g} at row "
            f"{rows[0] + 1} (t = {time:.6g} s), further than it moves otherwise: a corrupted "
            "message, or a marker of missing values, which a mapping file can name."
        )
        findings.append(
            Finding(severity="warning", code="spike", text=sentence, where=Place(columns=(name,), time=time))
        )
    return findings


def _examined(log: Log) -> list[str]:
    known = (name for name in log.names if name in KNOWN_NAMES and name != "t")
    return [name for name in known if not name.startswith(_NOT_EXAMINED)]


#: standard deviation of a state that moves [m, rad, m/s, rad/s]
LEAST_MOVING = 1e-3
#: a limit shows as at least this many equal extreme torques in a row
SATURATED_ROWS = 3


def check_names(log: Log) -> list[Finding]:
    """Return a note on columns that Ballbot does not know, with the name that was perhaps meant."""
    unknown = [name for name in log.names if name not in KNOWN_NAMES]
    if not unknown:
        return []
    listed = []
    for name in unknown:
        near = nearest(name, KNOWN_NAMES, likeness=0.8)
        listed.append(f"{name} (did you mean {near[0]}?)" if near else name)
    sentence = f"Columns that Ballbot does not know and does not use: {', '.join(listed)}."
    return [Finding(severity="note", code="unknown", text=sentence, where=Place(columns=tuple(unknown)))]


def check_constant(log: Log) -> list[Finding]:
    """Return a finding for each sensor or torque column that never changes, and a note for references.

    If no sensor and no torque changes, the whole log is at rest, and one finding names all columns.
    """
    sensors = [name for name in log.names if name != "t" and not name.startswith(_NOT_MEASURED)]
    if len(log) > 1 and len(sensors) > 1 and all(np.all(log[name] == log[name][0]) for name in sensors):
        sentence = (
            f"No measurement and no torque changes in {log.t[-1] - log.t[0]:.3g} s: the robot is at rest "
            "throughout, or was not recorded. Record it while it moves."
        )
        return [
            Finding(severity="warning", code="constant", text=sentence, where=Place(columns=tuple(sensors)))
        ]
    findings = []
    for name in log.names:
        values = log[name]
        if name == "t" or len(log) < 2 or not np.all(values == values[0]):
            continue
        if name.startswith("ref_"):
            sentence = (
                f"{name} is {values[0]:g} throughout: the reference{_REFERENCES.get(name, '')} is constant."
            )
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
    """Return a warning for each torque that stays at its limit.

    Parameters
    ----------
    log : Log
        Its columns u1, u2, .. are checked.
    torque_limit : float, optional
        The robot's limit [N m]; a torque above it gives a warning too.
    """
    findings = []
    for name in (n for n in log.names if n.startswith("u") and n[1:].isdigit()):
        size = np.nan_to_num(np.abs(log[name]))
        peak = float(size.max())
        longest = standstill(np.where(size == peak, 1.0, np.arange(len(size)) + 2.0))
        start, length = longest.start, longest.rows
        if peak > 0.0 and length >= SATURATED_ROWS and length < len(log):
            fraction = float(np.mean(size == peak))
            sentence = (
                f"{name} is at {peak:.4g} N m in {100 * fraction:.2g} % of the rows, first for long at row "
                f"{start + 1} (t = {log.t[start]:.6g} s): it is saturated there, and does not follow the control law."
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
    """Return a warning if a wheel reaches the speed at which the robot's drives have no torque left."""
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
                f"and motors, in {counted(beyond.size, 'row')} from row {beyond[0] + 1} (t = "
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


FALLEN_LEAN = 0.6  #: [rad], from which no ball-balancing robot of this kind recovers
RECOVERED_LEAN = 0.3  #: [rad] below which an excursion past `FALLEN_LEAN` counts as over


def check_lean(log: Log) -> list[Finding]:
    """Return an error for a lean in degrees, or a warning for a fall, by the number and size of the excursions."""
    if not {"theta", "phi"} <= set(log.names):
        return []
    lean = np.nan_to_num(
        np.hypot(log["theta"], log["phi"]), posinf=0.0
    )  # missing values have a finding of their own
    excursions = _excursions(lean)
    if not excursions:
        return []
    first, peak = excursions[0], float(lean.max())
    time = float(log.t[first])
    if len(excursions) >= 3 or peak > np.pi / 2:
        sentence = (
            f"The lean exceeds {FALLEN_LEAN:g} {len(excursions)} times and reaches "
            f"{peak:.3g}, which no balancing robot does in radians: theta and phi "
            f"are in degrees, or the log continues after a fall (t = {time:.6g} s)."
        )
        return [
            Finding(
                severity="error",
                code="degrees",
                text=sentence,
                where=Place(columns=("theta", "phi"), time=time),
            )
        ]
    sentence = (
        f"The robot falls or is caught: its lean exceeds {FALLEN_LEAN:g} rad at t "
        f"= {time:.6g} s (row {first + 1}); only the rows before show balancing."
    )
    return [
        Finding(
            severity="warning", code="fall", text=sentence, where=Place(columns=("theta", "phi"), time=time)
        )
    ]


def check_wrap(log: Log) -> list[Finding]:
    """Return a warning for each wheel's angle that jumps by a turn from one row to the next."""
    findings = []
    for name in _numbered(log, prefix="wheel"):
        jumps = np.abs(np.diff(log[name]))
        wraps = np.flatnonzero(np.abs(jumps - 2.0 * np.pi) < 0.5)
        if wraps.size:
            k = int(wraps[0]) + 1
            sentence = (
                f"{name} jumps by a full turn {counted(wraps.size, 'time')}, first at row {k + 1} (t "
                f"= {log.t[k]:.6g} s): it is wrapped. Unwrap it (numpy.unwrap) before use."
            )
            findings.append(
                Finding(
                    severity="warning",
                    code="wrap",
                    text=sentence,
                    where=Place(columns=(name,), time=float(log.t[k])),
                )
            )
    return findings


def _numbered(log: Log, *, prefix: str) -> tuple[str, ...]:
    return numbered_names(log.names, prefix=prefix) if f"{prefix}1" in log else ()


def _excursions(lean: NDArray[np.float64]) -> list[int]:
    """Return the rows where the lean passes `FALLEN_LEAN`, each counted once until it is below `RECOVERED_LEAN`."""
    starts: list[int] = []
    k = 0
    while k < len(lean):
        beyond = np.flatnonzero(lean[k:] > FALLEN_LEAN)
        if not beyond.size:
            break
        starts.append(k + int(beyond[0]))
        back = np.flatnonzero(lean[starts[-1] :] < RECOVERED_LEAN)
        if not back.size:
            break
        k = starts[-1] + int(back[0])
    return starts


#: smallest jump: change from one row to the next beyond the integral of the rates [m, m, rad, rad, rad]
LEAST_JUMP = {"x": 0.08, "y": 0.08, "theta": 0.08, "phi": 0.08, "psi": 0.2}
#: and so many times the usual change
FAR = 30.0
#: shortest time over which a balancing robot's lean is averaged [s]
AVERAGED_TIME = 8.0
#: the lean and the ball's acceleration are compared as means over [s]
BLOCK_TIME = 1.0
#: mean lean [rad] that gives a warning (slope, load off the axis), and one that is an error
TILTED, OFFSET = 0.025, 0.04
#: steps of a lean over its standard deviation that give a warning, and an error
COARSE, USELESS = 0.5, 1.2
_LEAN = ("theta", "phi")


def check_jumps(log: Log) -> list[Finding]:
    """Return an error for each position or angle that jumps where its rate does not, and stays there."""
    findings = []
    for name in POSITION_NAMES:
        if name not in log or f"{name}_dot" not in log or len(log) < 4:
            continue
        rows = np.flatnonzero(_jumped(log, name))
        if not rows.size:
            continue
        k = int(rows[0])
        time, unit = float(log.t[k + 1]), unit_of(name)
        times = "" if rows.size == 1 else f" ({rows.size} jumps in all)"
        sentence = (
            f"{name} jumps by {log[name][k + 1] - log[name][k]:.3g} {unit} from row {k + 1} "
            f"to row {k + 2} (t = {time:.6g} s), which its rate does not explain{times}: "
            "joined logs, a restart, or a sensor that was reset. Split the log there."
        )
        findings.append(
            Finding(severity="error", code="jump", text=sentence, where=Place(columns=(name,), time=time))
        )
    return findings


def check_lean_course(log: Log) -> list[Finding]:
    """Return findings on the mean lean of a balancing log, and on the lean's resolution."""
    if not {*_LEAN, "psi"} <= set(log.names):
        return []
    rows: NDArray[np.bool_] = np.all(
        np.isfinite(np.column_stack([log[name] for name in (*_LEAN, "psi")])), axis=1
    )
    fallen = np.flatnonzero(np.hypot(log["theta"], log["phi"]) > FALLEN_LEAN)
    if fallen.size:
        rows[fallen[0] :] = False
    if rows.sum() < 2 or np.ptp(log.t[rows]) < AVERAGED_TIME:
        return []
    return [*_offset(log, rows), *_coarse(log, rows)]


def _jumped(log: Log, name: str) -> NDArray[np.bool_]:
    """Return after which rows (N-1,) the column jumps."""
    values, rate, intervals = log[name], log[f"{name}_dot"], np.diff(log.t)
    change = np.diff(values) - 0.5 * (rate[1:] + rate[:-1]) * intervals
    change = np.abs(np.nan_to_num(change))
    spiked = spikes(values)
    usual = float(np.median(change))
    # across a gap, any change up to the largest rate is possible
    gap = np.where(intervals > 1.5 * log.sample_time, 2.0 * np.nanmax(np.abs(rate)) * intervals, 0.0)
    far = change > LEAST_JUMP[name] + FAR * usual + gap
    return far & ~spiked[1:] & ~spiked[:-1]


def _offset(log: Log, rows: NDArray[np.bool_]) -> list[Finding]:
    """Return the finding on a lean that is not zero at zero acceleration."""
    mean = _resting_lean(log, rows)
    if abs(mean) < TILTED:
        return []
    sentence = (
        f"theta and phi are ({np.degrees(mean.real):.2g}, {np.degrees(mean.imag):.2g}) degrees on average, "
        "and a balancing robot's are near zero: the IMU is mounted at an angle or has a bias, the centre "
        "of mass lies off the axis, or the floor slopes. Subtract the mean, or correct the cause."
    )
    severity = "error" if abs(mean) >= OFFSET else "warning"
    return [Finding(severity=severity, code="lean-offset", text=sentence, where=Place(columns=_LEAN))]


def _resting_lean(log: Log, rows: NDArray[np.bool_]) -> complex:
    """Return theta + j phi [rad] about the body's axes at zero acceleration.

    Averaged over a second, lean = offset + c a / g with the acceleration a of the ball, which is constant on a circle;
    c, above one, depends on the robot and is fitted.
    """
    count = max(2, int(np.ptp(log.t[rows]) / BLOCK_TIME))
    block = np.minimum((log.t[rows] - log.t[rows][0]) / BLOCK_TIME, count - 1).astype(np.intp)
    size = np.maximum(np.bincount(block, minlength=count), 1)
    turn = np.exp(-1j * log["psi"][rows])

    def means(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
        sums = [np.bincount(block, part, minlength=count) for part in (values.real, values.imag)]
        return (sums[0] + 1j * sums[1]) / size

    lean = means((log["theta"][rows] + 1j * log["phi"][rows]) * turn)
    if not {"x_dot", "y_dot"} <= set(log.names):
        return complex(lean.mean())
    velocity = np.nan_to_num(log["x_dot"][rows]) + 1j * np.nan_to_num(log["y_dot"][rows])
    # a positive phi leans towards x, a positive theta away from y
    pull = 1j * means(np.gradient(velocity, log.t[rows]) * turn)
    centred = pull - pull.mean()
    slope = float(np.vdot(centred, lean - lean.mean()).real) / max(
        float(np.vdot(centred, centred).real), 1e-12
    )
    return complex(lean.mean() - slope * pull.mean())


def _coarse(log: Log, rows: NDArray[np.bool_]) -> list[Finding]:
    findings = []
    for name in (*_LEAN, "theta_dot", "phi_dot"):
        values = log[name][rows] if name in log else np.zeros(0)
        levels = np.unique(values[np.isfinite(values)])
        if levels.size < 2:
            continue
        step = float(np.median(np.diff(levels)))
        size = step / float(values.std())
        # many distinct values are noise, even if they are far apart at the ends
        if size < COARSE or levels.size > 200:
            continue
        sentence = (
            f"{name} comes in steps of {step:.3g} {unit_of(name)}, and its "
            f"standard deviation is only {values.std():.3g}: it was rounded "
            "when written, or the sensor is coarse. Log it with more digits."
        )
        severity = "error" if size >= USELESS else "warning"
        findings.append(
            Finding(severity=severity, code="coarse", text=sentence, where=Place(columns=(name,)))
        )
    return findings
