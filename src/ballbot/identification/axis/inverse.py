"""The inverse model of one axis: derivatives of its position, a regression, and what it says of the record.

Velocity and acceleration come from position alone, without delay: a Butterworth filter run forwards and backwards,
central differences twice, and every column of a regression through the same decimation: A. Janot, M. Gautier and
M. Brunot, Data set and reference models of EMPS, Nonlinear System Identification Benchmarks, Eindhoven 2019, and
M. Gautier, Dynamic identification of robots with power model, ICRA 1997. Filter lengths at the ends and the first row
kept are MATLAB's (`filtfilt`, `decimate`), on which the last digits of the published numbers depend.

The model gives the force as a linear sum of what the axis did, by least squares (IDIM-LS):

    F = M a + F_v v + F_c sgn(v) + offset                                    ("coulomb")
    F = M a + (F_v+ v + F_c+) [v > 0] + (F_v- v - F_c-) [v < 0]              ("asymmetric")

A friction coefficient that comes out below zero is held at zero, and the others are fitted again, for friction takes
energy. Standard deviations are given twice: as published, s sqrt(diag (X^T X)^-1), which takes every row for
independent, and clustered by blocks of one second, which does not (see `ballbot.fitting.uncertainty`).

The checks of a record: over all of it the model must find a mass and a dry friction above zero. Where the loop is
known, the record itself says what force it asked for,

    force = f k_v (k_p a_1 (reference - position) - a_2 velocity)        a_1 = a_2 = 1

so that both factors show a wrong scale, a_2 alone a wrong time base, and the residual a wrong column or gain.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from ballbot.errors import InputError
from ballbot.findings import Finding, Place, Severity, by_severity
from ballbot.fitting.least_squares import fit_linear
from ballbot.identification.axis.record import AxisRecord, PositionVelocityLoop

_BUTTERWORTH_ORDER = 4
_DECIMATION_ORDER, _DECIMATION_RIPPLE = 8, 0.05  # ripple in dB
#: the filter passes so many times the motion's bandwidth, decimation keeps twice it
_FILTER_RATIO, _DECIMATION_RATIO = 5.0, 2.0
#: an axis of that mass that moves faster than this is rare [Hz]
LARGEST_BANDWIDTH = 20.0
_START_ROWS = 15


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What the axis did, without noise above the filter's frequency."""

    position: NDArray[np.float64]  #: (N,) [m]
    speed: NDArray[np.float64]  #: (N,) [m/s]
    acceleration: NDArray[np.float64]  #: (N,) [m/s^2]


def default_bandwidth(record: AxisRecord) -> float:
    """Return the bandwidth [Hz] of the motion that is assumed: 20 Hz, or less where the sampling is slow."""
    return min(LARGEST_BANDWIDTH, 0.04 / record.sample_time)


def smoothed_motion(record: AxisRecord, *, bandwidth: float) -> Motion:
    """Return position, speed and acceleration, filtered at five times the bandwidth [Hz].

    Raises
    ------
    InputError
        If that is beyond half the sampling rate.
    """
    rate = 1.0 / record.sample_time
    cutoff = _FILTER_RATIO * bandwidth
    if not 0.0 < cutoff < 0.5 * rate:
        raise InputError(
            f"A bandwidth of {bandwidth:g} Hz needs a filter at {cutoff:g} Hz, and {record.name} is "
            f"sampled at {rate:.4g} Hz; choose a bandwidth above zero and below {0.1 * rate:.3g} Hz."
        )
    b, a = np.asarray(signal.butter(_BUTTERWORTH_ORDER, cutoff / (0.5 * rate)), dtype=float)
    position = signal.filtfilt(b, a, record.position, padlen=3 * _BUTTERWORTH_ORDER)
    speed = np.gradient(position, record.sample_time)
    return Motion(position=position, speed=speed, acceleration=np.gradient(speed, record.sample_time))


def speed_at_start(record: AxisRecord) -> float:
    """Return the speed [m/s] at the record's first row, where a filter has no past to look at.

    It is the slope there of a cubic through the first 15 rows, by least squares.
    """
    rows = slice(0, _START_ROWS)
    return float(np.polynomial.Polynomial.fit(record.t[rows], record.position[rows], 3).deriv()(0.0))


def first_row(record: AxisRecord, *, bandwidth: float) -> int:
    """Return the first row that the filter's start does not spoil: five periods of it."""
    return round(5.0 / (_FILTER_RATIO * bandwidth * record.sample_time)) - 1


def decimation_factor(record: AxisRecord, *, bandwidth: float) -> int:
    """Return how many rows become one, so that twice the bandwidth stays."""
    return max(1, round(0.8 * 0.5 / record.sample_time / (_DECIMATION_RATIO * bandwidth)))


def decimated(values: NDArray[np.float64], factor: int) -> NDArray[np.float64]:
    """Return every `factor`-th of values (N,), the last among them, after a Chebyshev filter without delay."""
    if factor == 1:
        return values
    b, a = np.asarray(signal.cheby1(_DECIMATION_ORDER, _DECIMATION_RIPPLE, 0.8 / factor), dtype=float)
    smooth = signal.filtfilt(b, a, values, padlen=3 * _DECIMATION_ORDER)
    return smooth[(len(values) - 1) % factor :: factor]


#: residuals within a block may depend on each other [s]
BLOCK = 1.0
#: beyond this condition number, of columns of length one, the record does not tell the parameters apart
LARGEST_CONDITION = 1e4

Form = Literal["coulomb", "asymmetric"]

#: coefficients that may be below zero: a mass so is a finding of its own
_SIGNED = ("mass", "offset")


@dataclass(frozen=True, kw_only=True, eq=False)
class InverseFit:
    """What the inverse model gives; p parameters."""

    names: tuple[str, ...]  #: (p,)
    values: NDArray[np.float64]  #: (p,) SI units
    standard_deviations: NDArray[np.float64]  #: (p,) as published: rows taken for independent
    clustered_errors: NDArray[np.float64]  #: (p,) rows of one second taken together
    relative_force_error: float  #: |F - F_hat| / |F|
    condition: float  #: of the regression's columns, each of length one

    def value(self, name: str) -> float:
        """Return the parameter of that name."""
        return float(self.values[self.names.index(name)])

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "parameters": dict(zip(self.names, self.values.tolist(), strict=True)),
            "standard_deviations": dict(zip(self.names, self.standard_deviations.tolist(), strict=True)),
            "relative_standard_deviations": dict(
                zip(self.names, _relative(self.standard_deviations, self.values).tolist(), strict=True)
            ),
            "clustered_standard_errors": dict(zip(self.names, self.clustered_errors.tolist(), strict=True)),
            "relative_force_error": self.relative_force_error,
            "condition": self.condition,
        }


def _relative(deviations: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return deviations over values; NaN for a value of zero."""
    return np.divide(deviations, np.abs(values), out=np.full(len(values), np.nan), where=values != 0.0)


def inverse_fit(record: AxisRecord, *, form: Form = "coulomb", bandwidth: float | None = None) -> InverseFit:
    """Fit the inverse model, no coefficient of friction below zero; one that is held there has NaN for its deviations.

    Parameters and errors are those of `free_inverse_fit`.
    """
    fit = free_inverse_fit(record, form=form, bandwidth=bandwidth)
    held: tuple[str, ...] = ()
    while True:
        negative = [
            name
            for name, value in zip(fit.names, fit.values, strict=True)
            if name not in _SIGNED and value < 0.0
        ]
        if not negative:
            return fit
        held = (*held, *negative)
        fit = free_inverse_fit(record, form=form, bandwidth=bandwidth, held=held)


def free_inverse_fit(
    record: AxisRecord,
    *,
    form: Form = "coulomb",
    bandwidth: float | None = None,
    held: tuple[str, ...] = (),
) -> InverseFit:
    """Fit the inverse model by least squares, whatever the coefficients' signs.

    Parameters
    ----------
    record : AxisRecord
    form : {"coulomb", "asymmetric"}
    bandwidth : float, optional
        Of the motion [Hz]; the filter passes five times as much, the regression keeps twice.
    held : tuple of str
        Names of coefficients that are zero.

    Raises
    ------
    InputError
        If the bandwidth does not suit the sampling, or the record cannot give the parameters.
    """
    band = default_bandwidth(record) if bandwidth is None else bandwidth
    motion_columns = _columns(smoothed_motion(record, bandwidth=band), form)
    columns = {name: column for name, column in motion_columns.items() if name not in held}
    start, factor = first_row(record, bandwidth=band), decimation_factor(record, bandwidth=band)
    names = tuple(columns)
    X = np.column_stack([decimated(column[start:], factor) for column in columns.values()])
    F = decimated(record.force[start:], factor)
    condition = _condition(record, names, X)
    fit = fit_linear(X, F, (np.arange(len(F)) * factor * record.sample_time // BLOCK).astype(np.int64))
    values, residual, errors = fit.values, fit.residuals, fit.errors
    deviations = np.std(residual, ddof=1) * np.sqrt(np.linalg.inv(X.T @ X).diagonal())
    at = {name: place for place, name in enumerate(names)}
    placed = [at.get(name) for name in motion_columns]
    return InverseFit(
        names=tuple(motion_columns),
        values=np.array([0.0 if place is None else values[place] for place in placed]),
        standard_deviations=np.array([np.nan if place is None else deviations[place] for place in placed]),
        clustered_errors=np.array([np.nan if place is None else errors[place] for place in placed]),
        relative_force_error=float(np.linalg.norm(residual) / np.linalg.norm(F)),
        condition=condition,
    )


def asymmetry_over_time(record: AxisRecord, *, parts: int = 4) -> NDArray[np.float64]:
    """Return (F_v- - F_v+)/2 of equal parts of the record, (parts, 2): value and clustered standard error.

    Empty, (0, 2), where a part moves one way only, as between the ends of a long stroke, and so cannot tell.
    """
    edges = np.linspace(0, len(record), parts + 1).astype(int)
    rows = []
    for first, last in pairwise(edges):
        part = AxisRecord(
            name=record.name,
            sample_time=record.sample_time,
            force=record.force[first:last],
            position=record.position[first:last],
            unit=record.unit,
        )
        try:
            fit = free_inverse_fit(part, form="asymmetric")
        except InputError:
            return np.empty((0, 2))
        error = np.hypot(
            *fit.clustered_errors[[fit.names.index("viscous_plus"), fit.names.index("viscous_minus")]]
        )
        rows.append((0.5 * (fit.value("viscous_minus") - fit.value("viscous_plus")), 0.5 * error))
    return np.array(rows)


def _columns(motion: Motion, form: Form) -> dict[str, NDArray[np.float64]]:
    v, sign = motion.speed, np.sign(motion.speed)
    if form == "coulomb":
        return {"mass": motion.acceleration, "viscous": v, "coulomb": sign, "offset": np.ones_like(v)}
    plus, minus = 0.5 * (1.0 + sign), 0.5 * (1.0 - sign)
    return {
        "mass": motion.acceleration,
        "viscous_plus": v * plus,
        "coulomb_plus": sign * plus,
        "viscous_minus": v * minus,
        "coulomb_minus": sign * minus,
    }


def _condition(record: AxisRecord, names: tuple[str, ...], X: NDArray[np.float64]) -> float:
    lengths = np.linalg.norm(X, axis=0)
    if not lengths.all():
        raise InputError(
            f"{record.name} does not show {names[int(np.argmin(lengths))]}: "
            "the axis must move in both directions, at several speeds."
        )
    condition = float(np.linalg.cond(X / lengths))
    if condition > LARGEST_CONDITION:
        raise InputError(
            f"{record.name} does not distinguish {', '.join(names)} (condition number {condition:.2g}): "
            "the axis must move in both directions, at several speeds, and accelerate and brake."
        )
    return condition


#: share of the force that the motion must explain
_EXPLAINED, _WELL_EXPLAINED = 0.3, 0.8
#: the loop's law may be off by this factor, and leave this share of the force
_LOOP_FACTOR, _LOOP_LEAVES = 1.3, 0.4
#: sizes of reference over position
_TRACKING = 3.0
#: [s]; faster and slower samplings of an axis are rather another unit of time
_SAMPLING = (2e-6, 0.2)
#: [m]; axes that travel further are rare, and their positions more likely in millimetres
_LONGEST_TRAVEL = 50.0
_FACTORS = {1e-3: "1/1000", 1e3: "1000", 1e6: "1,000,000", 1e-6: "1/1,000,000"}


def record_findings(record: AxisRecord, *, bandwidth: float | None = None) -> tuple[Finding, ...]:
    """Return what is wrong with a record, errors first.

    Parameters
    ----------
    record : AxisRecord
    bandwidth : float, optional
        Of the motion [Hz]; see `ballbot.identification.axis.inverse`.

    Raises
    ------
    InputError
        If the bandwidth does not suit the sampling, or the record cannot give mass and friction.
    """
    findings = [*_of_time(record), *_of_travel(record), *_of_reference(record)]
    follows = all(one.code != "axis-reference" for one in findings)
    moved = np.ptp(record.force) > 0.0
    if record.loop is not None and record.reference is not None and follows and moved:
        findings += _of_loop(record, record.loop, record.reference)
    # a constant force is refused by the identification itself
    if moved and all(one.severity != "error" for one in findings):
        band = default_bandwidth(record) if bandwidth is None else bandwidth
        findings += _of_motion(record, free_inverse_fit(record, form="coulomb", bandwidth=band))
    return by_severity(findings)


def _of_time(record: AxisRecord) -> Iterator[Finding]:
    h = record.sample_time
    if h > _SAMPLING[1]:
        text = (
            f"Rows come every {h:.3g} s, too slowly for an axis; "
            f"t appears to be in milliseconds ({0.001 * h:.3g} s)."
        )
        yield _finding("scale", "error", text, "t")
    elif h < _SAMPLING[0]:
        text = f"Rows come every {h:.3g} s, faster than axes are logged; check the unit of t."
        yield _finding("scale", "error", text, "t")


def _of_travel(record: AxisRecord) -> Iterator[Finding]:
    travel = float(np.ptp(record.position))
    if record.unit == "m" and travel > _LONGEST_TRAVEL:
        text = (
            f"The axis travels {travel:.4g} m; its position appears to be in "
            f"millimetres ({0.001 * travel:.4g} m), which makes mass and viscous "
            "friction a thousand times too small. For angles give --unit rad."
        )
        yield _finding("axis-unit", "warning", text, "position")


def _of_reference(record: AxisRecord) -> Iterator[Finding]:
    if record.reference is None:
        return
    wanted, position = record.reference, record.position
    if np.ptp(wanted) == 0.0:
        text = (
            f"The reference is {wanted[0]:g} {record.unit} throughout "
            "while the axis moves; check which column it is."
        )
        yield _finding("axis-reference", "error", text, "reference")
        return
    ratio = float(np.std(wanted) / np.std(position))
    correlation = float(np.corrcoef(wanted, position)[0, 1])
    if correlation < -0.5:
        text = (
            "The reference and the position move in opposite directions "
            f"(correlation {correlation:.2f}); negate one of them."
        )
        yield _finding("axis-reference", "error", text, "reference", "position")
    elif not 1.0 / _TRACKING < ratio < _TRACKING:
        text = (
            f"The reference moves {_times(ratio)} as far as the position: "
            "they have different units, or the reference is another column."
        )
        yield _finding("axis-reference", "error", text, "reference", "position")
    elif correlation < 0.5:
        text = (
            "The position does not follow the reference (correlation "
            f"{correlation:.2f}): one of them is another column or from another run."
        )
        yield _finding("axis-reference", "error", text, "reference", "position")


@dataclass(frozen=True, kw_only=True)
class _LoopLaw:
    """The loop's law fitted to a record: factors of its two parts, and the share of the force that is left."""

    position: float  #: a_1
    velocity: float  #: a_2
    left: float


def _fitted_law(
    record: AxisRecord, loop: PositionVelocityLoop, wanted: NDArray[np.float64]
) -> _LoopLaw | None:
    span = loop.span
    velocity = (record.position[span:] - record.position[:-span]) / (span * record.sample_time)
    asked = loop.position_gain * (wanted - record.position)[span:]
    force = record.loop_force[span:]
    scale = loop.force_per_input * loop.velocity_gain
    # rows at the limit follow no linear law; the limit is met at the largest force, whatever the units
    free = np.abs(force) < 0.98 * np.abs(force).max()
    X = scale * np.column_stack([asked, -velocity])[free]
    if len(X) < 100 or np.linalg.matrix_rank(X) < 2:
        return None
    (a1, a2), *_ = np.linalg.lstsq(X, force[free], rcond=None)
    left = force[free] - X @ np.array([a1, a2])
    return _LoopLaw(
        position=float(a1),
        velocity=float(a2),
        left=float(np.linalg.norm(left) / np.linalg.norm(force[free])),
    )


def _of_loop(
    record: AxisRecord, loop: PositionVelocityLoop, wanted: NDArray[np.float64]
) -> Iterator[Finding]:
    law = _fitted_law(record, loop, wanted)
    if law is None:
        return
    a1, a2 = law.position, law.velocity
    if law.left > _LOOP_LEAVES:
        text = (
            f"The control law, with its best gains, leaves {100.0 * law.left:.0f} % of the recorded "
            "force unexplained: force, reference or position is another column, or the axis has "
            "another control law. Without --reference and the gains the record is used in open loop."
        )
        yield _finding("axis-loop", "error", text, "force", "reference")
    elif a1 < 0.0 and a2 < 0.0:
        text = (
            "The recorded force has the opposite sign of the control law; negate the force or --force-scale."
        )
        yield _finding("force-sign", "error", text, "force")
    elif a1 < 0.0 or a2 < 0.0:
        text = (
            "The position part and the velocity part of the control law have "
            "opposite signs in this record; check the signs of the gains."
        )
        yield _finding("axis-loop", "error", text, "force")
    elif not 1.0 / _LOOP_FACTOR < a1 < _LOOP_FACTOR and 1.0 / _LOOP_FACTOR < a1 / a2 < _LOOP_FACTOR:
        text = (
            f"The recorded force is {_times(a1)} the force of the control law: --force-scale, "
            "--velocity-gain or the unit of the position is wrong by that factor."
        )
        yield _finding("axis-loop", "error", text, "force")
    elif not 1.0 / _LOOP_FACTOR < a2 / a1 < _LOOP_FACTOR:
        text = (
            f"Relative to the position part, the velocity part of the control law is {_times(a2 / a1)} "
            "what the gains give: the time base or --position-gain is wrong by that factor."
        )
        yield _finding("axis-loop", "error", text, "t", "force")


def _of_motion(record: AxisRecord, fit: InverseFit) -> Iterator[Finding]:
    mass, dry, viscous = (fit.value(name) for name in ("mass", "coulomb", "viscous"))
    unit = record.force_unit
    explained = 1.0 - fit.relative_force_error**2
    if explained < _EXPLAINED:
        text = (
            f"The motion of the axis explains only {100.0 * max(explained, 0.0):.0f} % of the force: "
            "the force is another column, noise or from another run, or something else moves the axis."
        )
        yield _finding("force-unrelated", "error", text, "force", "position")
    elif mass <= 0.0:
        both = dry < 0.0 or viscous < 0.0
        cause = (
            "the force, or the position, has the opposite sign."
            if both
            else "the force is delayed against the position, its "
            "column is wrong, or the axis hardly accelerates."
        )
        text = (
            f"The inverse model estimates a mass of {mass:.3g} and a dry "
            f"friction of {dry:.3g} {unit}; both must be above zero: {cause}"
        )
        yield _finding("force-sign", "error", text, "force", "position")
    elif dry < 0.0 and abs(dry) > 3.0 * fit.clustered_errors[fit.names.index("coulomb")]:
        text = (
            f"The inverse model estimates a dry friction of {dry:.3g} {unit}, below zero: a "
            "force is missing (--added-force), or force and position are not simultaneous."
        )
        yield _finding("force-unrelated", "warning", text, "force")
    elif explained < _WELL_EXPLAINED:
        text = (
            f"The motion of the axis explains {100.0 * explained:.0f} "
            "% of the force; something else moves it as well."
        )
        yield _finding("force-unrelated", "warning", text, "force")
    if mass > 0.0 and viscous < 0.0:
        text = (
            f"The inverse model estimates a viscous friction of {viscous:.3g}, below zero; it "
            "is fixed at zero. The speeds of the record do not separate it from dry friction."
        )
        yield _finding("force-friction", "warning", text, "force")


def _times(ratio: float) -> str:
    """Return "1000 times", or the factor in words."""
    nearest = min(_FACTORS, key=lambda one: abs(np.log(abs(ratio) / one)))
    if abs(np.log(abs(ratio) / nearest)) < np.log(1.5):
        return f"{_FACTORS[nearest]} times"
    return f"{ratio:.3g} times"


def _finding(code: str, severity: Severity, text: str, *columns: str) -> Finding:
    return Finding(code=code, severity=severity, text=text, where=Place(columns=columns))
