"""Courses of the states that no robot takes: jumps of a spliced log, a lean off zero on average, or in coarse steps.

Position and angle must go on from row to row as their rates say; a robot that balances leans as often to one side as to
the other, since a lean kept is an acceleration kept.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place
from ballbot.log.angle_checks import LOST_LEAN
from ballbot.log.columns import POSITION_NAMES, unit_of
from ballbot.log.log import Log
from ballbot.log.spikes import spikes

#: smallest change from one row to the next, beyond what the rates make, that is a jump [m, m, rad, rad, rad]
LEAST_JUMP = {"x": 0.08, "y": 0.08, "theta": 0.08, "phi": 0.08, "psi": 0.2}
#: and so many times what is usual
FAR = 30.0
#: time over which a balancing robot's lean is averaged at least [s]
AVERAGED_TIME = 8.0
#: the lean and the ball's acceleration are compared as means over [s]
BLOCK_TIME = 1.0
#: mean lean [rad] that is worth a warning (slope, load off the axis), and that is wrong
TILTED, OFFSET = 0.025, 0.04
#: steps of a lean over its standard deviation that are coarse, and whose noise is as large as the signal
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
    """Return what is wrong with a balancing log's lean on average, and with its steps."""
    if not {*_LEAN, "psi"} <= set(log.names):
        return []
    rows: NDArray[np.bool_] = np.all(
        np.isfinite(np.column_stack([log[name] for name in (*_LEAN, "psi")])), axis=1
    )
    lost = np.flatnonzero(np.hypot(log["theta"], log["phi"]) > LOST_LEAN)
    if lost.size:
        rows[lost[0] :] = False
    if rows.sum() < 2 or np.ptp(log.t[rows]) < AVERAGED_TIME:
        return []
    return [*_offset(log, rows), *_coarse(log, rows)]


def _jumped(log: Log, name: str) -> NDArray[np.bool_]:
    """Return after which rows (N-1,) the column goes on elsewhere."""
    values, rate, intervals = log[name], log[f"{name}_dot"], np.diff(log.t)
    change = np.diff(values) - 0.5 * (rate[1:] + rate[:-1]) * intervals
    if name == "psi":  # a wrapped heading is another finding
        change -= 2.0 * np.pi * np.round(change / (2.0 * np.pi))
    change = np.abs(np.nan_to_num(change))
    spiked = spikes(values, heading=name == "psi")
    usual = float(np.median(change))
    # over a gap anything up to the largest rate may have happened
    gap = np.where(intervals > 1.5 * log.sample_time, 2.0 * np.nanmax(np.abs(rate)) * intervals, 0.0)
    far = change > LEAST_JUMP[name] + FAR * usual + gap
    return far & ~spiked[1:] & ~spiked[:-1]


def _offset(log: Log, rows: NDArray[np.bool_]) -> list[Finding]:
    """Return the finding that a lean asks for which is not zero where the ball does not accelerate."""
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

    Over a second, lean = offset + c a / g with the acceleration a of the ball, which a robot in a circle keeps up; c,
    above one, is the robot's, and is fitted.
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
        # many distinct values are noise, however far apart at the ends
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
