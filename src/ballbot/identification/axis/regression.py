"""The inverse model of one axis: a regression of the force on the recorded motion, by least squares (IDIM-LS).

    F = M a + b v + c sgn(v) + offset + G(q) + mu W sgn(v)

or with b and c of each direction. Speed and acceleration are those of `motion`. It starts the output error, selects
forces over position and load, and is the form in which identifications are published. Friction dissipates energy, so a
friction coefficient that would be negative is fixed at zero, and the others are fitted again.

Standard deviations are given twice: as published, s sqrt(diag (X^T X)^-1), which assumes independent rows, and
clustered by blocks of one second, which does not (see `ballbot.fitting.uncertainty`).

At rest the friction balances the force, whatever it is, and at either end of a part between gaps the filters have no
rows beyond, which makes errors there several times the others. The published fits include these rows; `moving` excludes
them, and lets a held force act half a row later.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.fitting.least_squares import fit_linear
from ballbot.identification.axis.model import AxisModel, base_name, load_at, position_columns, recorded_load
from ballbot.identification.axis.motion import (
    LEAST_SEGMENT,
    Decimation,
    default_bandwidth,
    load_force,
    smoothed_motion,
)
from ballbot.identification.axis.record import AxisRecord

#: residuals within a block may depend on each other [s]
BLOCK = 1.0
#: beyond this condition number, of columns of length one, the record does not distinguish the parameters: their errors
#: are 1e4 times those of the force, which no record has to 1e-4
LARGEST_CONDITION = 1e4
#: coefficients that cannot be below zero; a mass below zero is a finding of its own
_FRICTION = ("viscous", "coulomb", "viscous_plus", "coulomb_plus", "viscous_minus", "coulomb_minus", "load")
#: an axis slower than this share of its usual speed is at rest
REST = 0.02
#: of records sampled more slowly than this [s], half a row matters, by which a held force acts later than its row
_SLOW_SAMPLING = 2e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class InverseFit:
    """A fit of the inverse model; p parameters."""

    names: tuple[str, ...]  #: (p,)
    values: NDArray[np.float64]  #: (p,) SI units
    standard_deviations: NDArray[
        np.float64
    ]  #: (p,) as published: rows assumed independent; NaN if fixed at zero
    clustered_errors: NDArray[np.float64]  #: (p,) rows of one second taken together; NaN if fixed at zero
    relative_force_error: float  #: |F - F_hat| / |F|

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
            "parameters": self.by_name,
            "standard_deviations": dict(zip(self.names, self.standard_deviations.tolist(), strict=True)),
            "clustered_standard_errors": dict(zip(self.names, self.clustered_errors.tolist(), strict=True)),
            "relative_force_error": self.relative_force_error,
        }


def inverse_fit(
    records: AxisRecord | Sequence[AxisRecord],
    model: AxisModel,
    *,
    bandwidth: float | None = None,
    moving: bool = False,
    signed: bool = False,
) -> InverseFit:
    """Fit the inverse model by least squares.

    Parameters
    ----------
    records : AxisRecord or sequence of AxisRecord
    model : AxisModel
        What to estimate; of its law only the linear part.
    bandwidth : float, optional
        Of the motion [Hz]; the filter passes five times as much, the regression keeps twice.
    moving : bool
        Whether rows at rest, and next to the ends of parts between gaps, are left out; see above.
    signed : bool
        Whether coefficients of friction may be below zero.

    Raises
    ------
    InputError
        If the bandwidth does not suit the sampling, or the records cannot give the parameters.
    """
    several = (records,) if isinstance(records, AxisRecord) else tuple(records)
    rows = regression_rows(several, model, bandwidth=bandwidth, moving=moving)
    names, held = tuple(rows.columns), set[str]()
    while True:
        free = [name for name in names if name not in held]
        X = np.column_stack([rows.columns[name] for name in free])
        _check_condition(several[0], free, X)
        fit = fit_linear(X, rows.force, rows.block)
        negative = {
            name
            for name, value in zip(free, fit.values, strict=True)
            if base_name(name) in _FRICTION and value < 0.0 and not signed
        }
        if not negative:
            break
        held |= negative
    deviations = np.std(fit.residuals, ddof=1) * np.sqrt(np.linalg.inv(X.T @ X).diagonal())
    place = [free.index(name) if name in free else -1 for name in names]
    return InverseFit(
        names=names,
        values=np.append(fit.values, 0.0)[place],
        standard_deviations=np.append(deviations, np.nan)[place],
        clustered_errors=np.append(fit.errors, np.nan)[place],
        relative_force_error=float(np.linalg.norm(fit.residuals) / np.linalg.norm(rows.force)),
    )


def _check_condition(record: AxisRecord, names: Sequence[str], X: NDArray[np.float64]) -> None:
    """Refuse columns (n, p) that the record does not distinguish."""
    lengths = np.linalg.norm(X, axis=0)
    if len(X) > X.shape[1] and lengths.all():
        scaled = X / lengths
        condition = float(np.linalg.cond(scaled))
        if condition <= LARGEST_CONDITION:
            return
        mixed = np.abs(np.linalg.svd(scaled, full_matrices=False)[2][-1])
        which = [name for name, share in zip(names, mixed, strict=True) if share > 0.3 * mixed.max()]
    else:
        which = [name for name, length in zip(names, lengths, strict=True) if length == 0.0] or list(names)
    raise InputError(
        f"{record.name} cannot show {' and '.join(which)} apart: the motion is too short, too even or of one direction "
        "only. Record speeding up, slowing down and both directions at several speeds."
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class RegressionRows:
    """Rows that the inverse model is fitted to, of all records one after another."""

    columns: dict[str, NDArray[np.float64]]  #: (n,) by label
    force: NDArray[np.float64]  #: (n,) [N], without the force of known loads and held parameters
    block: NDArray[np.int64]  #: (n,), of time
    #: (n,), by name the quantities that residuals are tested against: speed, position, time, ...
    seen: dict[str, NDArray[np.float64]]

    @property
    def design(self) -> NDArray[np.float64]:
        """The columns side by side (n, p)."""
        return np.column_stack(list(self.columns.values()))


def regression_rows(
    records: Sequence[AxisRecord], model: AxisModel, *, bandwidth: float | None = None, moving: bool = False
) -> RegressionRows:
    """Return the decimated rows of the inverse model; see `inverse_fit`.

    A load that contains forces over position takes them from fits to the same rows, without load friction and with it.
    """
    found: dict[str, float] = {}
    for one in (replace(model, load=None), model) if model.load not in (None, "recorded") else ():
        rows = _rows_with(records, one, found, bandwidth, moving=moving)
        solved = np.linalg.lstsq(rows.design, rows.force, rcond=None)[0]
        found = dict(zip(rows.columns, solved.tolist(), strict=True))
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
    parts, begin = list[RegressionRows](), 0
    for number, record in enumerate(records):
        part = _rows_of(record, model, number, found, bandwidth, moving=moving)
        parts.append(replace(part, block=part.block + begin))
        begin = int(parts[-1].block.max()) + 1
    seen = set.intersection(*(set(part.seen) for part in parts))
    return RegressionRows(
        columns={
            label: np.concatenate([part.columns.get(label, np.zeros(len(part.force))) for part in parts])
            for label in model.labels
            if any(label in part.columns for part in parts)
        },
        force=np.concatenate([part.force for part in parts]),
        block=np.concatenate([part.block for part in parts]),
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
    if not model.interpolated and (moving or record.sample_time > _SLOW_SAMPLING):
        # the motion at a row is that of the force held before and after it
        force = 0.5 * (force + np.append(force[0], force[:-1]))
    force = force - load_force(record, motion)
    way = np.sign(motion.speed)
    forwards, backwards = way > 0.0, way < 0.0
    own = {
        "mass": motion.acceleration,
        "viscous": motion.speed,
        "coulomb": way,
        "offset": np.ones(len(record)),
        "viscous_plus": motion.speed * forwards,
        "coulomb_plus": 1.0 * forwards,
        "viscous_minus": motion.speed * backwards,
        "coulomb_minus": -1.0 * backwards,
        **position_columns(model.terms, motion.position, model.period),
    }
    if model.load:
        values = {name: found.get(model.label(name, number), 0.0) for name in model.names}
        known = record.known_load
        over_position = known.weight * np.sin(motion.position - known.hanging)
        over_position = over_position + sum(values[name] * own[name] for name in model.terms)
        acting, recorded = record.force - values.get("offset", 0.0), recorded_load(model.load, record)
        own["load"] = load_at(model.load, acting, over_position, recorded) * way
    for name, value in model.held.items():
        force = force - value * own.get(name, np.zeros(len(record)))
    kept = {model.label(name, number): own[name] for name in model.names if name in own}
    columns = {label: column for label, column in kept.items() if base_name(label) not in model.held}
    seen = {
        "position": motion.position,
        "speed": motion.speed,
        "time": record.t,
        "temperature": record.temperature,
        "load": record.load,
    }
    rows = Decimation(record, bandwidth=band)
    if not rows.kept:
        raise InputError(f"{record.name} has no part of {LEAST_SEGMENT} rows on end; log without gaps.")
    chosen = np.ones(len(rows.disturbed), dtype=bool)
    if moving:
        resting = rows.of((np.abs(motion.speed) < REST * _rms(motion.speed)).astype(float)) > 0.5
        chosen = ~rows.disturbed if resting.mean() > 0.9 else ~(resting | rows.disturbed)
    _, block = np.unique((rows.picked(record.t)[chosen] - record.t[0]) // BLOCK, return_inverse=True)
    return RegressionRows(
        columns={label: rows.of(column)[chosen] for label, column in columns.items()},
        force=rows.of(force)[chosen],
        block=block.astype(np.int64),
        seen={name: rows.picked(one)[chosen] for name, one in seen.items() if one is not None},
    )


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))
