"""Wrong records of one axis, stopped with their cause.

Over a whole record the inverse model must estimate a mass and a dry friction above zero, and explain the force.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place, Severity, by_severity
from ballbot.identification.axis.identify import AxisOptions, select_forces
from ballbot.identification.axis.model import AXIS_LAWS, AxisModel
from ballbot.identification.axis.reading import DEGREES, TURN
from ballbot.identification.axis.record import GAP, AxisRecord
from ballbot.identification.axis.regression import RegressionRows, inverse_fit, regression_rows

#: codes of the errors that are found here, which `--accept` takes
ERROR_CODES = ("force-sign", "force-unrelated", "scale", "speed-limit", "spike", "stuck")
#: share of the force that the motion must explain
_EXPLAINED, _WELL_EXPLAINED = 0.3, 0.8
#: [s]; slower samplings of an axis are rather another unit of time
_SLOWEST_SAMPLING = 0.2
#: [m]; axes that travel further are rare, and their positions more likely in millimetres
_LONGEST_TRAVEL = 50.0
#: [rad]; axes that turn so far may have their angles in degrees if they cover the travel so many times a second
_DEGREES, _OFTEN = (60.0, 720.0), 0.25
#: the speed counts as at its limit from this share of the largest (the 99 % quantile), if more than so many rows are;
#: there the unexplained force varies by this share of the whole force, and by so many times its usual variation
_AT_LIMIT, _LIMIT_ROWS, _FREE_FORCE, _FREE_TIMES = 0.98, 0.1, 0.1, 3.0
#: fewer rows show no usual variation
_LEAST_ROWS = 50
#: a position that is repeated for this time [s] and over this many rows does not repeat by chance
_LONG, _ROWS = 0.2, 40
#: after it, it jumps by so many of the largest other steps
_JUMP = 3.0
#: a force that leads the position by at most this time [s], has this correlation with it and its size to this share
_LEAD, _FOLLOWS, _SAME = 0.2, 0.995, 0.05
#: a force of one sign is below this share of its largest value for the other one
_OTHER_SIGN = 0.02
#: the right signs leave less than this share of what the motion leaves of the force's square, if that is so much
_EXPLAINS, _UNEXPLAINED = 0.25, 0.05


def column_finding(code: str, severity: Severity, text: str, *columns: str) -> Finding:
    """Return a finding about columns of a record."""
    return Finding(code=code, severity=severity, text=text, where=Place(columns=columns))


def record_findings(record: AxisRecord, *, bandwidth: float | None = None) -> tuple[Finding, ...]:
    """Return what is wrong with a record, errors first.

    Parameters
    ----------
    record : AxisRecord
    bandwidth : float, optional
        Of the motion [Hz]; see `ballbot.identification.axis.regression`.

    Raises
    ------
    InputError
        If the bandwidth does not suit the sampling, or the record cannot give mass and friction.
    """
    findings = [
        *_of_time(record),
        *_of_spikes(record),
        *_of_travel(record),
        *_of_gaps(record),
        *_of_wraps(record),
        *_of_stuck(record),
        *_of_a_position(record),
    ]
    # a constant force is refused by the identification itself
    if np.ptp(record.force) > 0.0 and all(one.severity != "error" for one in findings):
        coulomb = AxisModel(law=AXIS_LAWS["coulomb"], interpolated=not record.even)
        # with the forces over position that the record supports
        model, _ = select_forces((record,), coulomb, AxisOptions(bandwidth=bandwidth))
        rows = regression_rows((record,), model, bandwidth=bandwidth, moving=True)
        causes = [*_of_speed(record, model, bandwidth), *_of_magnitude(rows)]
        findings += causes or _of_motion(record, model, bandwidth)
    return by_severity(findings)


def _of_time(record: AxisRecord) -> Iterator[Finding]:
    h = record.sample_time
    if h > _SLOWEST_SAMPLING:
        units = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
        fitting = next((one for one in units.items() if one[1] * h <= _SLOWEST_SAMPLING), None)
        cause = "check the unit of t and --time-scale"
        if fitting is not None:
            cause = f"t appears to be in {fitting[0]} ({fitting[1] * h:.3g} s): --time-scale {fitting[1]:g}"
        text = f"Rows come every {h:.3g} s, too slowly for an axis; {cause}."
        yield column_finding("scale", "error", text, "t")


def _of_spikes(record: AxisRecord) -> Iterator[Finding]:
    """Find values of the position that leave its range by more than twice its width for a single row."""
    position = record.position
    low, high = np.quantile(position, [0.01, 0.99])
    away = np.abs(position[1:-1] - 0.5 * (position[:-2] + position[2:])) > 2.0 * (high - low)
    outside = np.maximum(low - position[1:-1], position[1:-1] - high) > 2.0 * (high - low)
    rows = np.flatnonzero(away & outside) + 1
    if rows.size and high > low:
        first = int(rows[0])
        more = f", as in {rows.size - 1} more" if rows.size > 1 else ""
        text = (
            f"The position jumps to {position[first]:.4g} {record.unit} in row {first + 1} ({record.t[first]:.4g} s "
            f"after the first one) and back; it is from {low:.4g} to {high:.4g} {record.unit} otherwise{more}. Remove "
            "such rows (gaps are allowed), or leave their cells empty."
        )
        yield column_finding("spike", "error", text, "position")


def _of_travel(record: AxisRecord) -> Iterator[Finding]:
    travel = float(np.ptp(record.position))
    if record.unit == "m" and travel > _LONGEST_TRAVEL:
        text = (
            f"The axis travels {travel:.4g} m; its position appears to be in "
            f"millimetres ({0.001 * travel:.4g} m), which makes mass and viscous "
            "friction a thousand times too small: --position-scale 0.001. For angles give --unit rad."
        )
        yield column_finding("axis-unit", "warning", text, "position")
    often = float(np.mean(np.abs(np.diff(record.position)))) / record.sample_time > _OFTEN * travel
    if record.unit == "rad" and _DEGREES[0] < travel < _DEGREES[1] and often:
        text = (
            f"The axis travels {travel:.4g} rad, to and fro. If its position is in degrees "
            f"({np.radians(travel):.4g} rad), inertia and viscous friction are {np.degrees(1.0):.0f} times too small: "
            f"--position-scale {np.radians(1.0):.6g}."
        )
        yield column_finding("axis-unit", "warning", text, "position")


def _of_gaps(record: AxisRecord) -> Iterator[Finding]:
    gaps = len(record.segments) - 1
    if gaps:
        text = (
            f"{gaps} gap{'s' if gaps > 1 else ''} of more than {GAP:.0f} intervals of {1e3 * record.sample_time:.3g} "
            "ms; the force there is unknown, and no prediction runs across."
        )
        yield column_finding("gap", "note", text, "t")


def _of_wraps(record: AxisRecord) -> Iterator[Finding]:
    if not record.wrap:
        return
    size = {TURN: "one turn", DEGREES: "360"}.get(record.wrap, f"{record.wrap:.6g} {record.unit}")
    yield column_finding("wrap", "note", f"The position jumps by {size}; it is unwrapped.", "position")
    options = [] if record.unit == "rad" else ["--unit rad"]
    options += [f"--position-scale {np.radians(1.0):.6g}"] if record.wrap == DEGREES else []
    if options and record.wrap in (TURN, DEGREES):
        text = f"A position that jumps by {record.wrap:.4g} is an angle: {' '.join(options)}."
        yield column_finding("axis-unit", "warning", text, "position")


def _of_stuck(record: AxisRecord) -> Iterator[Finding]:
    """Find a position that repeats its value while the axis moves: it jumps after it, which one at rest does not."""
    position, t = record.position, record.t
    edges = np.flatnonzero(np.append(True, np.append(np.diff(position) != 0.0, True)))
    place = int(np.argmax(np.diff(edges)))
    first, last = int(edges[place]), int(edges[place + 1])
    if last == len(record) or last - first < _ROWS or t[last] - t[first] < _LONG:
        return
    speeds = np.abs(np.diff(position)) / np.diff(t)
    if speeds[last - 1] > _JUMP * np.delete(speeds, last - 1).max():
        text = (
            f"The position is {position[first]:.4g} {record.unit} without change for {t[last] - t[first]:.2g} s (from "
            f"row {first + 1}, {t[first]:.4g} s after the first one) while the axis moves: the log repeats its last "
            "value. Leave these cells empty."
        )
        yield column_finding("stuck", "error", text, "position")


def _of_a_position(record: AxisRecord) -> Iterator[Finding]:
    """Find a force that is the position some rows later, in metres or radians, degrees, centimetres or millimetres."""
    force, position = record.force, record.position
    if np.std(force) == 0.0 or np.std(position) == 0.0:
        return
    for rows in range(min(int(_LEAD / record.sample_time), len(record) // 4) + 1):
        ahead, behind = force[: len(force) - rows], position[rows:]
        ratio = float(np.std(ahead) / max(np.std(behind), 1e-300))
        near = any(abs(ratio / unit - 1.0) < _SAME for unit in (1.0, float(np.degrees(1.0)), 100.0, 1000.0))
        if near and np.std(ahead) > 0.0 and float(np.corrcoef(ahead, behind)[0, 1]) > _FOLLOWS:
            text = (
                "The force is the position some rows later: it appears to be the reference of the position, and not a "
                "force. Name the column of the force, current or voltage with --force."
            )
            yield column_finding("force-unrelated", "error", text, "force")
            return


def _of_speed(record: AxisRecord, model: AxisModel, bandwidth: float | None) -> Iterator[Finding]:
    """Find a speed that stays at its limit while a force pushes on that the motion does not explain."""
    rows = regression_rows((record,), model, bandwidth=bandwidth)
    X, F, speed = rows.design, rows.force, rows.columns["viscous"]
    at_limit = np.abs(speed) >= _AT_LIMIT * float(np.quantile(np.abs(speed), 0.99))
    share = float(at_limit.mean())
    if share <= _LIMIT_ROWS or (~at_limit).sum() < 2 * _LEAST_ROWS:
        return
    values, *_ = np.linalg.lstsq(X[~at_limit], F[~at_limit], rcond=None)
    left = F - X @ values
    excess = (np.sign(speed) * left)[at_limit]
    varies, usual = float(np.std(excess)), float(np.std(left[~at_limit]))
    if (
        varies > max(_FREE_FORCE * float(np.sqrt(np.mean(F**2))), _FREE_TIMES * usual)
        and np.mean(excess) > varies
    ):
        fastest = float(np.median(np.abs(rows.seen["speed"][at_limit])))  # decimation takes up to 1 % off
        low, high = np.quantile((np.sign(speed) * F)[at_limit], [0.05, 0.95])
        text = (
            f"The speed stays at its maximum, {fastest:.3g} {record.unit}/s, in {100.0 * share:.0f} % of the rows "
            f"while the force changes from {low:.3g} to {high:.3g} {record.force_unit}: the supply or the driver "
            "limits the speed, and the recorded force does not act there. Remove these rows (gaps are allowed), or "
            "record with less force. For a robot's drivelines use `ballbot identify-driveline`, which leaves such "
            "rows out."
        )
        yield column_finding("speed-limit", "error", text, "force", "position")


def _of_magnitude(rows: RegressionRows) -> Iterator[Finding]:
    """Find a force that is a magnitude without its sign."""
    F, size = rows.force, np.abs(rows.force)
    if min(np.quantile(F, 0.99), -np.quantile(F, 0.01)) >= _OTHER_SIGN * size.max():
        return
    Q, _ = np.linalg.qr(rows.design)

    def left(force: NDArray[np.float64]) -> float:
        return float(np.sum((force - Q @ (Q.T @ force)) ** 2) / max(np.sum(force**2), np.finfo(float).tiny))

    found = []
    for start in (rows.seen["speed"], rows.columns["mass"]):
        sign = np.sign(start)
        # each sign is that of the model's own force; this settles within a few rounds
        for _ in range(20):
            sign = np.sign(Q @ (Q.T @ (sign * size)))
        found.append(left(sign * size))
    if left(F) >= _UNEXPLAINED and min(found) < _EXPLAINS * left(F):
        text = (
            "The force never changes its sign, and the motion explains it far better with changing signs: it is the "
            "magnitude of a force or current. Record it with its sign."
        )
        yield column_finding("force-sign", "error", text, "force")


def _of_motion(record: AxisRecord, model: AxisModel, bandwidth: float | None) -> Iterator[Finding]:
    fit = inverse_fit(record, model, bandwidth=bandwidth, moving=True, signed=True)
    mass, dry, viscous = (fit.value(name) for name in ("mass", "coulomb", "viscous"))
    explained = 1.0 - fit.relative_force_error**2
    if explained < _EXPLAINED:
        text = (
            f"The motion of the axis explains only {100.0 * max(explained, 0.0):.0f} % of the force: "
            "the force is another column, noise or from another run, or something else moves the axis."
        )
        yield column_finding("force-unrelated", "error", text, "force", "position")
    elif mass <= 0.0:
        cause = (
            "the force, or the position, has the opposite sign"
            if dry < 0.0 or viscous < 0.0
            else "the force is delayed against the position, its column is wrong, or the axis hardly accelerates"
        )
        text = (
            f"The inverse model estimates a mass of {mass:.3g} and a dry friction of {dry:.3g} {record.force_unit}; "
            f"both must be above zero: {cause}."
        )
        yield column_finding("force-sign", "error", text, "force", "position")
    elif dry < 0.0 and abs(dry) > 3.0 * fit.clustered_errors[fit.names.index("coulomb")]:
        text = (
            f"The inverse model estimates a dry friction of {dry:.3g} {record.force_unit}, below zero: a "
            "force is missing (--added-force), or force and position are not simultaneous."
        )
        yield column_finding("force-unrelated", "warning", text, "force")
    elif explained < _WELL_EXPLAINED:
        text = (
            f"The motion of the axis explains {100.0 * explained:.0f} % of the force; something else moves it as well, "
            "or the force is a demand that the driver or the supply limits (--limit)."
        )
        yield column_finding("force-unrelated", "warning", text, "force")
    if mass > 0.0 and viscous < 0.0:
        text = (
            f"The inverse model estimates a viscous friction of {viscous:.3g}, below zero; it is fixed at zero. The "
            "speeds of the record do not separate it from dry friction, or the force acts later than its row."
        )
        yield column_finding("force-friction", "warning", text, "force")
