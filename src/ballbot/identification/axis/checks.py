"""Checks of the record of an axis before it is identified.

Over the complete record, the inverse model must estimate a mass above zero and explain the force.
"""

from collections.abc import Iterator

import numpy as np

from ballbot.findings import Finding, by_severity, error, note, warning
from ballbot.identification.axis.model import AxisModel
from ballbot.identification.axis.motion import (
    CLEAR,
    InverseModel,
    inverse_model,
    motion_of,
    with_gravity,
)
from ballbot.identification.axis.record import GAP, AxisRecord
from ballbot.log.clock import clock_findings
from ballbot.log.signals import longest_repeat

#: codes of errors, for `--accept`
ERROR_CODES = ("excitation", "force-sign", "force-unrelated", "scale", "spike", "stuck", "unit")
#: least share of the force that the motion explains, without an error and without a warning
_EXPLAINED, _WELL_EXPLAINED = 0.3, 0.8
#: a position that repeats for this long [s] and over this many rows does not do so by chance
_LONG, _ROWS = 0.2, 40
#: after it, the position jumps by so many of the largest other steps
_JUMP = 3.0


def record_findings(record: AxisRecord) -> tuple[Finding, ...]:
    """Return the findings on a record, errors first; InputError if it does not determine mass and friction."""
    findings = [*record.findings, *_of_rows(record), *_of_stuck(record)]
    # the identification itself refuses a constant force
    if np.ptp(record.force) > 0.0 and all(finding.severity != "error" for finding in findings):
        motion = motion_of(record)
        plain = AxisModel(law="coulomb", interpolated=not record.even)
        inverse = inverse_model([motion], with_gravity([motion], plain))
        # gravity on an axis that others carry is no function of its angle, and may hide the mass
        shown = inverse.values["mass"] > CLEAR * inverse.errors["mass"]
        findings += _of_motion(record, inverse if shown else inverse_model([motion], plain))
    return by_severity(findings)


def _of_rows(record: AxisRecord) -> Iterator[Finding]:
    """Find a long sample time, gaps, and single positions outside the range by twice its width."""
    h, position, unit = record.sample_time, record.position, record.unit
    yield from clock_findings(record.t, "--mapping", code="scale")
    gaps = len(record.parts) - 1
    if gaps:
        text = (
            f"{gaps} gap{'s' if gaps > 1 else ''} of more than {GAP:.0f} intervals of {1e3 * h:.3g} "
            "ms; the force there is unknown, and no prediction runs across."
        )
        yield note("gap", text, "t")
    low, high = np.quantile(position, [0.01, 0.99])
    away = np.abs(position[1:-1] - 0.5 * (position[:-2] + position[2:])) > 2.0 * (high - low)
    outside = np.maximum(low - position[1:-1], position[1:-1] - high) > 2.0 * (high - low)
    rows = np.flatnonzero(away & outside) + 1
    if rows.size and high > low:
        first, more = int(rows[0]), f", as in {rows.size - 1} more" if rows.size > 1 else ""
        text = (
            f"The position jumps to {position[first]:.4g} {unit} in row {first + 1} ({record.t[first]:.4g} s after the "
            f"first one) and back; it is from {low:.4g} to {high:.4g} {unit} otherwise{more}. Remove such rows (gaps "
            "are allowed), or leave their cells empty."
        )
        yield error("spike", text, "position")


def _of_stuck(record: AxisRecord) -> Iterator[Finding]:
    """Find a position that repeats its value while the axis moves, which shows in a jump after it."""
    position, t = record.position, record.t
    first, last = longest_repeat(position)
    if last == len(record) - 1 or last - first < _ROWS or t[last + 1] - t[first] < _LONG:
        return
    speeds = np.abs(np.diff(position)) / np.diff(t)
    if speeds[last] > _JUMP * np.delete(speeds, last).max():
        text = (
            f"The position is {position[first]:.4g} {record.unit} without change for {t[last + 1] - t[first]:.2g} s "
            f"(from row {first + 1}, {t[first]:.4g} s after the first one) while the axis moves: the log repeats its "
            "last value. Leave these cells empty."
        )
        yield error("stuck", text, "position")


def _of_motion(record: AxisRecord, inverse: InverseModel) -> Iterator[Finding]:
    """Find a force that does not move the axis."""
    mass, explained = inverse.values["mass"], 100.0 * max(inverse.explained, 0.0)
    # the power of a force that moves an axis against friction is positive
    driven = float(np.mean(record.force[1:] * np.diff(record.position))) > 0.0
    size, share_up = np.abs(record.force), float(np.mean(np.diff(record.position) > 0.0))
    one_sign = min(np.quantile(record.force, 0.99), -np.quantile(record.force, 0.01)) < 0.02 * size.max()
    if one_sign and 0.2 < share_up < 0.8 and np.quantile(size, 0.01) < 0.05 * size.max():
        text = (
            "The force falls to zero and never changes its sign, though the axis moves back and forth: it is the "
            "magnitude of a force or current. Record it with its sign."
        )
        yield error("force-sign", text, "force")
    elif inverse.explained < _EXPLAINED:
        text = (
            f"The motion of the axis explains only {explained:.0f} % of the force: the force is another column, the "
            "reference of the position, noise or from another run, or something else moves the axis."
        )
        yield error("force-unrelated", text, "force", "position")
    elif mass <= 0.0 and not driven:
        text = (
            f"The inverse model estimates a mass of {mass:.3g}, which must be above zero, and the force brakes the "
            "axis: the force, or the position, has the opposite sign."
        )
        yield error("force-sign", text, "force", "position")
    elif mass <= CLEAR * inverse.errors["mass"]:
        text = (
            f"The record does not show the mass: a plain regression of the force gives {inverse.text(record.unit)}, "
            f"and explains {explained:.0f} %. The axis hardly accelerates, the force is delayed, or it is the friction "
            "alone, without the inertia's part. Record all of the force that drives the axis, while it accelerates."
        )
        yield error("excitation", text, "force", "position")
    elif inverse.explained < _WELL_EXPLAINED:
        text = (
            f"The motion of the axis explains {explained:.0f} % of the force; something else moves it as well, or the "
            "force is a demand that the driver or the supply limits."
        )
        yield warning("force-unrelated", text, "force")
