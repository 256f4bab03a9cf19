"""The inverse model of one axis: a regression of the force on the recorded motion.

The model gives the force as a linear sum, by least squares (IDIM-LS):

    F = M a + F_v v + F_c sgn(v) + offset                                    ("coulomb")
    F = M a + (F_v+ v + F_c+) [v > 0] + (F_v- v - F_c-) [v < 0]              ("asymmetric")

and, if requested, bristles in place of sgn(v) (`bent_bristles`), forces over position, a drift of the offset and
several records. Speed and acceleration are those of `motion`. The force that a known load requires is subtracted.

Friction dissipates energy, so a friction coefficient that would be negative is fixed at zero, and the others are fitted
again. Standard deviations are given twice: as published, s sqrt(diag (X^T X)^-1), which assumes independent rows, and
clustered by blocks of one second, which does not (see `ballbot.fitting.uncertainty`).

At rest the friction balances the force, whatever it is, and at either end of a part between gaps the filters have no
rows beyond, which makes errors there several times the others. The published fits include these rows; `moving` excludes
them, and lets a held force act half a sample after its row however fast rows come.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.fitting.least_squares import fit_linear
from ballbot.identification.axis.laws import AXIS_LAWS
from ballbot.identification.axis.load import Load, force_with_load_friction, load_at, recorded_load
from ballbot.identification.axis.model import drift_shapes
from ballbot.identification.axis.motion import (
    LEAST_SEGMENT,
    Decimation,
    Motion,
    bent_bristles,
    default_bandwidth,
    load_force,
    smoothed_motion,
)
from ballbot.identification.axis.record import AxisRecord, Span
from ballbot.identification.axis.structure import AxisModel, base_name, position_columns

#: residuals within a block may depend on each other [s]
BLOCK = 1.0
#: beyond this condition number, of columns of length one, the record does not distinguish the parameters
LARGEST_CONDITION = 1e4

Form = Literal["coulomb", "asymmetric"]

#: coefficients that cannot be below zero; a mass below zero is a finding of its own
_FRICTION = ("viscous", "coulomb", "viscous_plus", "coulomb_plus", "viscous_minus", "coulomb_minus", "load")
_OVER_POSITION = ("sin_", "cos_", "spring")
#: an axis slower than this share of its usual speed is at rest
REST = 0.02
#: of records sampled more slowly than this [s], half a sample matters, by which a held force acts later than its row
SLOW_SAMPLING = 2e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class InverseFit:
    """A fit of the inverse model; p parameters."""

    names: tuple[str, ...]  #: (p,)
    values: NDArray[np.float64]  #: (p,) SI units
    standard_deviations: NDArray[np.float64]  #: (p,) as published: rows assumed independent
    clustered_errors: NDArray[np.float64]  #: (p,) rows of one second taken together
    relative_force_error: float  #: |F - F_hat| / |F|
    condition: float  #: of the regression's columns, each of length one
    blocks: int  #: of time

    def value(self, name: str) -> float:
        """Return the parameter of that name."""
        return float(self.values[self.names.index(name)])

    @property
    def by_name(self) -> dict[str, float]:
        """The parameters by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

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


def inverse_fit(
    records: AxisRecord | Sequence[AxisRecord],
    *,
    form: Form = "coulomb",
    bandwidth: float | None = None,
    model: AxisModel | None = None,
    moving: bool = False,
) -> InverseFit:
    """Fit the inverse model, no coefficient of friction below zero; one that is held there has NaN for its deviations.

    Parameters and errors are those of `free_inverse_fit`.
    """
    held: tuple[str, ...] = ()
    while True:
        fit = free_inverse_fit(records, form=form, bandwidth=bandwidth, model=model, moving=moving, held=held)
        negative = [
            name
            for name, value in zip(fit.names, fit.values, strict=True)
            if base_name(name) in _FRICTION and value < 0.0
        ]
        if not negative:
            return fit
        held = (*held, *negative)


def free_inverse_fit(
    records: AxisRecord | Sequence[AxisRecord],
    *,
    form: Form = "coulomb",
    bandwidth: float | None = None,
    model: AxisModel | None = None,
    moving: bool = False,
    held: tuple[str, ...] = (),
) -> InverseFit:
    """Fit the inverse model by least squares, whatever the coefficients' signs.

    Parameters
    ----------
    records : AxisRecord or sequence of AxisRecord
    form : {"coulomb", "asymmetric"}
        The law, if there is no `model`.
    bandwidth : float, optional
        Of the motion [Hz]; the filter passes five times as much, the regression keeps twice.
    model : AxisModel, optional
        What to estimate; of its law only the linear part.
    moving : bool
        Whether rows at rest, and next to the ends of parts between gaps, are left out; see above.
    held : tuple of str
        Labels of coefficients that are zero.

    Raises
    ------
    InputError
        If the bandwidth does not suit the sampling, or the records cannot give the parameters.
    """
    several = (records,) if isinstance(records, AxisRecord) else tuple(records)
    wanted = model or AxisModel(law=AXIS_LAWS[form])
    rows = regression_rows(several, wanted, bandwidth=bandwidth, moving=moving)
    columns = {name: column for name, column in rows.columns.items() if name not in held}
    names = tuple(columns)
    X, F = np.column_stack(list(columns.values())), rows.force
    condition = _condition(several[0], names, X)
    fit = fit_linear(X, F, rows.block)
    values, residual, errors = fit.values, fit.residuals, fit.errors
    deviations = np.std(residual, ddof=1) * np.sqrt(np.linalg.inv(X.T @ X).diagonal())
    at = {name: place for place, name in enumerate(names)}
    placed = [at.get(name) for name in rows.columns]
    return InverseFit(
        names=tuple(rows.columns),
        values=np.array([0.0 if place is None else values[place] for place in placed]),
        standard_deviations=np.array([np.nan if place is None else deviations[place] for place in placed]),
        clustered_errors=np.array([np.nan if place is None else errors[place] for place in placed]),
        relative_force_error=float(np.linalg.norm(residual) / np.linalg.norm(F)),
        condition=condition,
        blocks=len(np.unique(rows.block)),
    )


def at_rest(speed: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return in which rows (N,) an axis of such a speed is at rest."""
    return np.abs(speed) < REST * float(np.sqrt(np.mean(speed**2)))


@dataclass(frozen=True, kw_only=True, eq=False)
class RegressionRows:
    """Rows that the inverse model is fitted to, of all records one after another."""

    columns: dict[str, NDArray[np.float64]]  #: (n,) by label
    force: NDArray[np.float64]  #: (n,) [N], without the force that known loads require
    block: NDArray[np.int64]  #: (n,), of time
    #: (n,), by name the quantities that residuals are tested against: speed, position, time, ...
    seen: dict[str, NDArray[np.float64]]


def regression_rows(
    records: Sequence[AxisRecord], model: AxisModel, *, bandwidth: float | None = None, moving: bool = False
) -> RegressionRows:
    """Return the decimated rows of the inverse model; see `free_inverse_fit`.

    A load that contains forces over position takes them from fits to the same rows, without load friction and with it.
    """
    if model.load in (None, "recorded"):
        return _rows_with(records, model, {}, bandwidth, moving=moving)
    found: dict[str, float] = {}
    for one in (replace(model, load=None), model):
        rows = _rows_with(records, one, found, bandwidth, moving=moving)
        X = np.column_stack(list(rows.columns.values()))
        found = dict(zip(rows.columns, np.linalg.lstsq(X, rows.force, rcond=None)[0].tolist(), strict=True))
    return _rows_with(records, model, found, bandwidth, moving=moving)


def _rows_with(
    records: Sequence[AxisRecord],
    model: AxisModel,
    found: Mapping[str, float],
    bandwidth: float | None,
    *,
    moving: bool,
) -> RegressionRows:
    """Return the decimated rows with the load of forces with coefficients that were found."""
    parts = [
        _rows_of(record, model, number, found, bandwidth, moving=moving)
        for number, record in enumerate(records)
    ]
    blocks, begin = [], 0
    for part in parts:
        blocks.append(part.block + begin)
        begin += int(part.block.max()) + 1
    seen = set.intersection(*(set(part.seen) for part in parts))
    return RegressionRows(
        columns={
            label: np.concatenate([part.columns.get(label, np.zeros(len(part.force))) for part in parts])
            for label in dict.fromkeys(label for part in parts for label in part.columns)
        },
        force=np.concatenate([part.force for part in parts]),
        block=np.concatenate(blocks),
        seen={name: np.concatenate([part.seen[name] for part in parts]) for name in sorted(seen)},
    )


def _rows_of(
    record: AxisRecord,
    model: AxisModel,
    number: int,
    found: Mapping[str, float],
    bandwidth: float | None,
    *,
    moving: bool,
) -> RegressionRows:
    band = default_bandwidth(record) if bandwidth is None else bandwidth
    motion = smoothed_motion(record, bandwidth=band)
    force = record.force
    if not model.interpolated and (moving or record.sample_time > SLOW_SAMPLING):
        # the motion at a row is that of the force held before and after it
        force = 0.5 * (force + np.append(force[0], force[:-1]))
    force = force - load_force(record, motion)
    own = _columns(motion, model, record)
    if model.load:
        values = {name: found.get(model.label(name, number), 0.0) for name in model.names}
        own["load"] = _load_of(record, model.load, motion, own, values) * _dry(motion, model)
    columns = {model.label(name, number): column for name, column in own.items()}
    rows = Decimation(record, bandwidth=band)
    kept, factor = rows.kept, rows.factor
    seen = {
        "position": motion.position,
        "speed": motion.speed,
        "time": record.t,
        "record": np.full(len(record), float(number)),
    }
    for name in ("temperature", "load"):
        if getattr(record, name) is not None:
            seen[name] = getattr(record, name)
    rests = at_rest(motion.speed).astype(float)
    if not kept:
        raise InputError(f"{record.name} has no part of {LEAST_SEGMENT} rows on end; log without gaps.")

    def picked(values: NDArray[np.float64]) -> NDArray[np.float64]:
        places = [np.arange(first, last)[(last - first - 1) % factor :: factor] for first, last in kept]
        return values[np.concatenate(places)]

    chosen = np.ones(len(picked(rests)), dtype=bool)
    if moving:
        resting = rows.of(rests) > 0.5
        chosen = ~rows.disturbed if resting.mean() > 0.9 else ~(resting | rows.disturbed)
    block = (picked(record.t) // BLOCK if not record.even else _even_blocks(record, kept, factor)).astype(
        np.int64
    )
    _, block = np.unique(block[chosen], return_inverse=True)
    return RegressionRows(
        columns={name: rows.of(column)[chosen] for name, column in columns.items()},
        force=rows.of(force)[chosen],
        block=block,
        seen={name: picked(column)[chosen] for name, column in seen.items()},
    )


def _even_blocks(record: AxisRecord, kept: Sequence[Span], factor: int) -> NDArray[np.float64]:
    """Return the block of each decimated row of an even record, counted from the first row kept."""
    ((first, last),) = kept
    count = -(-(last - first) // factor)
    return np.asarray(np.arange(count) * factor * record.sample_time // BLOCK, dtype=np.float64)


def without_drift(
    records: Sequence[AxisRecord], model: AxisModel, *, bandwidth: float | None = None
) -> tuple[AxisRecord, ...]:
    """Return records without the drift of the offset, as the inverse model of `model` estimates it, in their forces."""
    fit = inverse_fit(records, model=model, bandwidth=bandwidth, moving=True)
    found = []
    for number, record in enumerate(records):
        own = model.values_for(fit.by_name, number)
        drift = drift_shapes(record, model.drifts) @ np.array(
            [own[f"drift_{i + 1}"] for i in range(model.drifts)]
        )
        added = (np.zeros(len(record)) if record.added is None else record.added) - drift
        # the loop's own force stays as it is
        found.append(replace(record, force=record.force - drift, added=added))
    return tuple(found)


def asymmetry_over_time(record: AxisRecord, *, parts: int = 4) -> NDArray[np.float64]:
    """Return (F_v- - F_v+)/2 of equal parts of the record, (parts, 2): value and clustered standard error.

    Empty, (0, 2), if a part is too short or moves one way only, as between the ends of a long stroke.
    """
    edges = np.linspace(0, len(record), parts + 1).astype(int)
    rows = []
    for first, last in pairwise(edges):
        try:
            part = AxisRecord(
                name=record.name,
                sample_time=record.sample_time,
                times=None if record.times is None else record.times[first:last],
                force=record.force[first:last],
                position=record.position[first:last],
                unit=record.unit,
                known_load=record.known_load,
            )
            fit = free_inverse_fit(part, form="asymmetric")
        except InputError:
            return np.empty((0, 2))
        error = np.hypot(
            *fit.clustered_errors[[fit.names.index("viscous_plus"), fit.names.index("viscous_minus")]]
        )
        rows.append((0.5 * (fit.value("viscous_minus") - fit.value("viscous_plus")), 0.5 * error))
    return np.array(rows)


def _load_of(
    record: AxisRecord,
    load: Load,
    motion: Motion,
    columns: Mapping[str, NDArray[np.float64]],
    values: Mapping[str, float],
) -> NDArray[np.float64]:
    """Return the load (N,) that dry friction depends on, of an axis with such values.

    The drive's force in it is that of the model: the noise of a recorded one would be in the column, too.
    """
    known = record.known_load
    field = known.weight * np.sin(motion.position - known.hanging)
    needed = known.inertia * motion.acceleration + field
    for name, column in columns.items():
        part = values[name] * column
        if name.startswith(_OVER_POSITION):
            field = field + part
        if name != "offset" and not name.startswith("drift_"):
            needed = needed + part
    recorded, way = recorded_load(load, record), np.sign(motion.speed)
    force = force_with_load_friction(load, values["load"], needed, field, recorded, way)
    return load_at(load, force, field, recorded)


def _dry(motion: Motion, model: AxisModel) -> NDArray[np.float64]:
    """Return the direction of dry friction (N,), from -1 to 1."""
    return bent_bristles(motion.position, model.bending) if model.bending else np.sign(motion.speed)


def _columns(motion: Motion, model: AxisModel, record: AxisRecord) -> dict[str, NDArray[np.float64]]:
    """Return the linear part of a model by parameter (N,), without the load's."""
    v, dry = motion.speed, _dry(motion, model)
    if model.law.symmetric:
        plain = {"mass": motion.acceleration, "viscous": v, "coulomb": dry, "offset": np.ones_like(v)}
    else:
        plain = {
            "mass": motion.acceleration,
            "viscous_plus": np.maximum(v, 0.0),
            "coulomb_plus": np.maximum(dry, 0.0),
            "viscous_minus": np.minimum(v, 0.0),
            "coulomb_minus": np.minimum(dry, 0.0),
        }
    columns = {name: column for name, column in plain.items() if name in model.law.names}
    columns |= position_columns(model.terms, motion.position, model.period)
    if model.drifts:
        shapes = drift_shapes(record, model.drifts)
        columns |= {f"drift_{i + 1}": shapes[:, i] for i in range(model.drifts)}
    return columns


def break_away_column(speed: NDArray[np.float64], stribeck_speed: float) -> NDArray[np.float64]:
    """Return the column (N,) of a break-away force above Coulomb friction: exp(-|v/v_s|) sgn(v)."""
    return np.sign(speed) * np.exp(-np.abs(speed) / stribeck_speed)


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
