"""Wrong records of one axis, stopped with their cause.

Over a whole record the inverse model must estimate a mass and a dry friction above zero, and explain the force. If the
loop is known, the force must be the loop's: with factors of its two parts,

    force = f k_v (k_p a_1 (reference - position) - a_2 velocity)        a_1 = a_2 = 1

both factors show a wrong scale, that of the velocity alone a wrong time base, and the residual a wrong column or gain.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place, Severity, by_severity
from ballbot.fitting.least_squares import fit_linear
from ballbot.identification.axis.identify import AxisOptions, select_forces
from ballbot.identification.axis.model import AXIS_LAWS, AxisModel
from ballbot.identification.axis.motion import Decimation, default_bandwidth, smoothed_motion
from ballbot.identification.axis.reading import DEGREES, TURN
from ballbot.identification.axis.record import GAP, NO_LOAD, AxisRecord
from ballbot.identification.axis.regression import BLOCK, RegressionRows, inverse_fit, regression_rows

#: codes of the errors that are found here, which `--accept` takes
ERROR_CODES = (
    "axis-loop",
    "axis-reference",
    "force-sign",
    "force-unrelated",
    "scale",
    "speed-limit",
    "spike",
    "stuck",
)
#: share of the force that the motion must explain
_EXPLAINED, _WELL_EXPLAINED = 0.3, 0.8
#: largest error of the loop's law: as a factor, and as the residual's share of the force; and small ones, as a share,
#: in standard errors and as a share of the force, of which a coarse encoder leaves a tenth
_LOOP_FACTOR, _LOOP_RESIDUAL = 1.3, 0.4
_LOOP_TOLERANCE, _LOOP_APART, _LOOP_LEFT = 0.03, 3.0, 0.2
#: sizes of reference over position
_TRACKING = 3.0
#: [s]; faster and slower samplings of an axis are rather another unit of time
_SAMPLING = (2e-6, 0.2)
#: [m]; axes that travel further are rare, and their positions more likely in millimetres
_LONGEST_TRAVEL = 50.0
#: [rad]; axes that turn so far may have their angles in degrees if they cover the travel so many times a second
_DEGREES, _OFTEN = (60.0, 720.0), 0.25
#: the speed counts as at its limit from this share of the largest (the 99 % quantile), if more than so many rows are;
#: there the unexplained force varies by this share of the whole force, and by so many times its usual variation
_AT_LIMIT, _LIMIT_ROWS, _FREE_FORCE, _FREE_TIMES = 0.98, 0.1, 0.1, 3.0
#: fewer rows show no usual variation, and no law of a loop
_LEAST_ROWS = 50
#: a constant force on a pendulum that swings freely is no more than this share of its load's weight
_UNBALANCED = 0.05
#: a value that is repeated for this time [s] and over this many rows does not repeat by chance
_LONG, _ROWS = 0.2, 40
#: after it, the position jumps by so many of the largest other steps
_JUMP = 3.0
#: a force that a noisy sensor or a loop gives changes in this share of the rows; while it is repeated, the acceleration
#: varies by this share of its usual variation
_CHANGING, _LIVELY = 0.9, 0.5
#: a force that leads the position by at most this time [s], has this correlation with it and its size to this share
_LEAD, _FOLLOWS, _SAME = 0.2, 0.995, 0.05
#: a force of one sign is below this share of its largest value for the other one
_OTHER_SIGN = 0.02
#: the right signs leave less than this share of what the motion leaves of the force's square, if that is so much
_EXPLAINS, _UNEXPLAINED = 0.25, 0.05
_FACTORS = {1e-3: "1/1000", 1e3: "1000", 1e6: "1,000,000", 1e-6: "1/1,000,000"}


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
        *_of_reference(record),
        *_of_gaps(record),
        *_of_wraps(record),
        *_of_limit(record),
        *_of_stuck(record),
        *_of_a_position(record),
    ]
    moved = np.ptp(record.force) > 0.0 or record.known_load.weight > 0.0
    if moved and all(one.code != "axis-reference" for one in findings):
        findings += _of_loop(record)
    # a constant force is refused by the identification itself
    if moved and all(one.severity != "error" for one in findings):
        coulomb = AxisModel(law=AXIS_LAWS["coulomb"], interpolated=not record.even)
        # with the forces over position that the record supports
        model, _ = select_forces((record,), coulomb, AxisOptions(bandwidth=bandwidth))
        rows = regression_rows((record,), model, bandwidth=bandwidth, moving=True)
        causes = [*_of_speed(record, model, bandwidth), *_of_magnitude(record, rows)]
        findings += causes or [
            *_of_motion(record, model, bandwidth),
            *_of_hanging(record, coulomb, bandwidth),
            *_of_added(record, coulomb, bandwidth),
        ]
    return by_severity(findings)


def _of_time(record: AxisRecord) -> Iterator[Finding]:
    h = record.sample_time
    if h > _SAMPLING[1]:
        units = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
        fitting = next((one for one in units.items() if one[1] * h <= _SAMPLING[1]), None)
        cause = "check the unit of t and --time-scale"
        if fitting is not None:
            cause = f"t appears to be in {fitting[0]} ({fitting[1] * h:.3g} s): --time-scale {fitting[1]:g}"
        text = f"Rows come every {h:.3g} s, too slowly for an axis; {cause}."
        yield column_finding("scale", "error", text, "t")
    elif h < _SAMPLING[0]:
        text = f"Rows come every {h:.3g} s, faster than axes are logged; check the unit of t."
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


def _of_reference(record: AxisRecord) -> Iterator[Finding]:
    if record.reference is None:
        return
    wanted, position = record.reference, record.position
    if np.ptp(wanted) == 0.0:
        text = (
            f"The reference is {wanted[0]:g} {record.unit} throughout "
            "while the axis moves; check which column it is."
        )
        yield column_finding("axis-reference", "error", text, "reference")
        return
    ratio = float(np.std(wanted) / np.std(position))
    correlation = float(np.corrcoef(wanted, position)[0, 1])
    if correlation < -0.5:
        text = (
            "The reference and the position move in opposite directions "
            f"(correlation {correlation:.2f}); negate one of them."
        )
    elif not 1.0 / _TRACKING < ratio < _TRACKING:
        text = (
            f"The reference moves {_times(ratio)} as far as the position: "
            "they have different units, or the reference is another column."
        )
    elif correlation < 0.5:
        text = (
            "The position does not follow the reference (correlation "
            f"{correlation:.2f}): one of them is another column or from another run."
        )
    else:
        return
    yield column_finding("axis-reference", "error", text, "reference", "position")


def _of_gaps(record: AxisRecord) -> Iterator[Finding]:
    gaps = len(record.segments) - 1
    if gaps:
        text = (
            f"{gaps} gap{'s' if gaps > 1 else ''} of more than {GAP:.0f} intervals of {1e3 * record.sample_time:.3g} "
            "ms; the force there is unknown, and no prediction runs across."
        )
        yield column_finding("gap", "note", text, "t")


def _of_wraps(record: AxisRecord) -> Iterator[Finding]:
    wraps = record.wraps
    if not wraps.count:
        return
    size = {TURN: "one turn", DEGREES: "360"}.get(wraps.period, f"{wraps.period:.6g} {record.unit}")
    text = (
        f"The position jumps by {size} in {wraps.count} row{'s' if wraps.count > 1 else ''}; it is unwrapped."
    )
    yield column_finding("wrap", "note", text, "position")
    if wraps.period not in (TURN, DEGREES):
        return
    options = [] if record.unit == "rad" else ["--unit rad"]
    options += [f"--position-scale {np.radians(1.0):.6g}"] if wraps.period == DEGREES else []
    if options:
        kind = "an angle in degrees" if wraps.period == DEGREES else "an angle"
        text = f"A position that jumps by {wraps.period:.4g} is {kind}: {' '.join(options)}."
        yield column_finding("axis-unit", "warning", text, "position")


def _of_limit(record: AxisRecord) -> Iterator[Finding]:
    if record.beyond_limit > 0.0:
        text = (
            f"The recorded force exceeds --limit in {100.0 * record.beyond_limit:.2g} % of the rows; it is taken as a "
            "demand, of which no more than the limit acts."
        )
        yield column_finding("force-limit", "note", text, "force")


def _of_stuck(record: AxisRecord) -> Iterator[Finding]:
    """Find a position or a force that repeats its value while the axis moves."""
    for name, stuck in (("position", _stuck_position), ("force", _stuck_force)):
        values = getattr(record, name)
        edges = np.flatnonzero(np.append(True, np.append(np.diff(values) != 0.0, True)))
        place = int(np.argmax(np.diff(edges)))
        first, last = int(edges[place]), int(edges[place + 1])
        duration = float(record.t[min(last, len(record) - 1)] - record.t[first])
        if last - first < _ROWS or duration < _LONG or last == len(record) or not stuck(record, first, last):
            continue
        unit = record.unit if name == "position" else record.force_unit
        text = (
            f"The {name} is {values[first]:.4g} {unit} without change for {duration:.2g} s (from row {first + 1}, "
            f"{record.t[first]:.4g} s after the first one) while the axis moves: the log repeats its last value. "
            "Leave these cells empty."
        )
        yield column_finding("stuck", "error", text, name)


def _stuck_position(record: AxisRecord, first: int, last: int) -> bool:  # noqa: ARG001 (as the force's)
    """Return whether the position jumps after it: an axis that was at rest begins to move slowly."""
    speeds = np.abs(np.diff(record.position)) / np.diff(record.t)
    return bool(speeds[last - 1] > _JUMP * np.delete(speeds, last - 1).max())


def _stuck_force(record: AxisRecord, first: int, last: int) -> bool:
    """Return whether the axis accelerates to and fro meanwhile, under a force that otherwise always changes.

    A motor that is off, at its limit, or driven in steps repeats its force, too.
    """
    force = record.force
    changes = np.delete(np.diff(force), np.s_[first : last - 1])
    if np.mean(changes != 0.0) < _CHANGING or not 0.0 < abs(force[first]) < 0.98 * np.abs(force).max():
        return False
    acceleration = smoothed_motion(record, bandwidth=default_bandwidth(record)).acceleration
    return bool(np.std(acceleration[first:last]) > _LIVELY * np.std(acceleration))


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


def _of_loop(record: AxisRecord) -> Iterator[Finding]:
    """Find a force that is not that of the loop given with it."""
    loop = record.loop
    if loop is None or record.reference is None:
        return
    span, rows = loop.span, Decimation(record, bandwidth=default_bandwidth(record))
    velocity = (record.position[span:] - record.position[:-span]) / (span * record.sample_time)
    velocity = np.concatenate([np.full(span, velocity[0]), velocity])
    scale = loop.force_per_input * loop.velocity_gain
    asked = loop.position_gain * (record.reference - record.position)
    size = np.abs(record.loop_force)
    # rows at the limit, which is met at the largest force, follow no linear law
    free = (rows.of((size >= 0.98 * size.max()).astype(float)) <= 0.01) & ~rows.disturbed
    X = scale * np.column_stack([rows.of(asked), rows.of(-velocity)])[free]
    force = rows.of(record.loop_force)[free]
    if len(X) < _LEAST_ROWS or np.linalg.matrix_rank(X) < 2:
        return
    fit = fit_linear(X, force, (rows.of(record.t)[free] // BLOCK).astype(np.int64))
    a1, a2 = fit.values.tolist()
    left = float(np.linalg.norm(fit.residuals) / np.linalg.norm(force))
    severity: Severity = "error"
    if left > _LOOP_RESIDUAL:
        text = (
            f"The control law, with its best gains, leaves {100.0 * left:.0f} % of the recorded force unexplained: "
            "force, reference or position is another column, or the axis has another control law. Without --reference "
            "and the gains the record is used in open loop."
        )
    elif a1 < 0.0 and a2 < 0.0:
        text = (
            "The recorded force has the opposite sign of the control law; negate the force or --force-scale."
        )
        yield column_finding("force-sign", "error", text, "force")
        return
    elif a1 < 0.0 or a2 < 0.0:
        text = (
            "The position part and the velocity part of the control law have "
            "opposite signs in this record; check the signs of the gains."
        )
    elif not 1.0 / _LOOP_FACTOR < a1 < _LOOP_FACTOR and 1.0 / _LOOP_FACTOR < a1 / a2 < _LOOP_FACTOR:
        text = (
            f"The recorded force is {_times(a1)} the force of the control law: --force-scale, "
            "--velocity-gain or the unit of the position is wrong by that factor."
        )
    elif not 1.0 / _LOOP_FACTOR < a2 / a1 < _LOOP_FACTOR:
        text = (
            f"Relative to the position part, the velocity part of the control law is {_times(a2 / a1)} "
            "what the gains give: the time base or --position-gain is wrong by that factor."
        )
    elif left > _LOOP_LEFT or np.any(
        np.abs(fit.values - 1.0) > np.maximum(_LOOP_APART * fit.errors, _LOOP_TOLERANCE)
    ):
        severity = "warning"
        text = (
            f"The recorded force is not quite that of the control law: its position part is {a1:.3g} times and its "
            f"velocity part {a2:.3g} times what the gains give, and {100.0 * left:.2g} % of the force is neither. "
            "Check the gains and --force-scale. The result does not depend on them."
        )
    else:
        return
    yield column_finding("axis-loop", severity, text, "force", "reference")


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
    if varies > max(_FREE_FORCE * _rms(F), _FREE_TIMES * usual) and np.mean(excess) > varies:
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


def _of_magnitude(record: AxisRecord, rows: RegressionRows) -> Iterator[Finding]:
    """Find a force that is a magnitude without its sign."""
    F, known = rows.force, record.known_load
    size = np.abs(F)
    if (
        known.weight
        or known.inertia
        or min(np.quantile(F, 0.99), -np.quantile(F, 0.01)) >= _OTHER_SIGN * size.max()
    ):
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
        loaded = ", or the known load is wrong (--load-mass, --load-arm)" if record.known_load.inertia else ""
        cause = (
            "the force, or the position, has the opposite sign"
            if dry < 0.0 or viscous < 0.0
            else "the force is delayed against the position, its column is wrong, or the axis hardly accelerates"
        )
        text = (
            f"The inverse model estimates a mass of {mass:.3g} and a dry friction of {dry:.3g} {record.force_unit}; "
            f"both must be above zero: {cause}{loaded}."
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


def _of_hanging(record: AxisRecord, model: AxisModel, bandwidth: float | None) -> Iterator[Finding]:
    """Find a pendulum that swings freely about another angle than the one at which its load is said to hang."""
    weight, hanging = record.known_load.weight, record.known_load.hanging
    if not weight or np.ptp(record.force) > 0.0:
        return
    offset = inverse_fit(record, model, bandwidth=bandwidth, moving=True, signed=True).value("offset")
    if abs(offset) > _UNBALANCED * weight:
        about = hanging - float(np.arcsin(np.clip(offset / weight, -1.0, 1.0)))
        text = (
            f"The pendulum swings about an angle of about {about:.2g} rad, and its load is said to hang straight down "
            f"at {hanging:.2g}: give that angle, --hanging. Mass and friction are wrong otherwise."
        )
        yield column_finding("axis-load", "warning", text, "position")


def _of_added(record: AxisRecord, model: AxisModel, bandwidth: float | None) -> Iterator[Finding]:
    """Find an added force of the wrong sign or scale, by the motion that it makes."""
    if record.added is None or np.ptp(record.added) == 0.0:
        return
    rows = regression_rows((record,), model, bandwidth=bandwidth)
    alone = replace(record, force=record.added, known_load=NO_LOAD)
    added = regression_rows((alone,), model, bandwidth=bandwidth).force
    fit = fit_linear(np.column_stack([rows.design, added]), rows.force - added, rows.block)
    ratio, error = -float(fit.values[-1]), float(fit.errors[-1])
    if ratio + 3.0 * error < 0.0:
        text = (
            f"The added force acts the other way: the motion shows {ratio:.2g} times it. "
            "Negate it: --added-force-scale -1."
        )
        yield column_finding("force-sign", "error", text, "added_force")
    elif abs(ratio - 1.0) > max(5.0 * error, 0.5):
        text = (
            f"The motion shows {_times(ratio)} the added force; check its unit, or give --added-force-scale."
        )
        yield column_finding("scale", "warning", text, "added_force")


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _times(ratio: float) -> str:
    """Return "1000 times", or the factor in words."""
    nearest = min(_FACTORS, key=lambda one: abs(np.log(abs(ratio) / one)))
    if abs(np.log(abs(ratio) / nearest)) < np.log(1.5):
        return f"{_FACTORS[nearest]} times"
    return f"{ratio:.3g} times"
