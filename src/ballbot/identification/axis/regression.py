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
from ballbot.identification.axis.model import AxisModel, position_columns
from ballbot.identification.axis.motion import LEAST_SEGMENT, Decimation, default_bandwidth, smoothed_motion
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
    #: (p,) as published: rows assumed independent; NaN if fixed at zero
    standard_deviations: NDArray[np.float64]
    clustered_errors: NDArray[np.float64]  #: (p,) rows of one second taken together; NaN if fixed at zero
    relative_force_error: float  #: |F - F_hat| / |F|

    def value(self, name: str) -> float:
        """Return the parameter of that name."""
        return float(self.values[self.names.index(name)])

    @property
    def by_name(self) -> dict[str, float]:
        """The parameters by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))


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
    names, zero = tuple(rows.columns), set[str]()
    while True:
        free = [name for name in names if name not in zero]
        X = np.column_stack([rows.columns[name] for name in free])
        _check_condition(several[0], free, X)
        fit = fit_linear(X, rows.force, rows.block)
        negative = {
            name
            for name, value in zip(free, fit.values, strict=True)
            if name in _FRICTION and value < 0.0 and not signed
        }
        if not negative:
            break
        zero |= negative
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

    columns: dict[str, NDArray[np.float64]]  #: (n,) by name
    force: NDArray[np.float64]  #: (n,) [N], without that of known parameters
    block: NDArray[np.int64]  #: (n,), of time
    seen: dict[str, NDArray[np.float64]]  #: (n,) position, speed and time

    @property
    def design(self) -> NDArray[np.float64]:
        """The columns side by side (n, p)."""
        return np.column_stack(list(self.columns.values()))


def regression_rows(
    records: Sequence[AxisRecord], model: AxisModel, *, bandwidth: float | None = None, moving: bool = False
) -> RegressionRows:
    """Return the decimated rows of the inverse model; see `inverse_fit`.

    The load takes forces over position from fits to the same rows, without load friction and with it.
    """
    found: dict[str, float] = {}
    for one in (replace(model, load=False), model) if model.load else ():
        rows = _rows_with(records, one, found, bandwidth, moving=moving)
        found = dict(zip(rows.columns, np.linalg.lstsq(rows.design, rows.force)[0].tolist(), strict=True))
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
    parts = [_rows_of(record, model, found, bandwidth, moving=moving) for record in records]
    begins = np.cumsum([0, *(int(part.block.max()) + 1 for part in parts)])

    def joined(tables: Sequence[Mapping[str, NDArray[np.float64]]]) -> dict[str, NDArray[np.float64]]:
        return {name: np.concatenate([one[name] for one in tables]) for name in tables[0]}

    return RegressionRows(
        columns=joined([part.columns for part in parts]),
        force=np.concatenate([part.force for part in parts]),
        block=np.concatenate([part.block + begin for part, begin in zip(parts, begins[:-1], strict=True)]),
        seen=joined([part.seen for part in parts]),
    )


def _rows_of(
    record: AxisRecord,
    model: AxisModel,
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
        **position_columns(model.terms, motion.position),
    }
    G = sum((found.get(name, 0.0) * own[name] for name in model.terms), np.zeros(len(record)))
    own["load"] = 0.5 * np.abs(record.force - found.get("offset", 0.0) + G) * way
    force = force - sum((value * own[name] for name, value in model.held.items()), np.zeros(len(record)))
    seen = {"position": motion.position, "speed": motion.speed, "time": record.t}
    rows = Decimation(record, bandwidth=band)
    if not rows.kept:
        raise InputError(f"{record.name} has no part of {LEAST_SEGMENT} rows on end; log without gaps.")
    chosen = np.ones(len(rows.disturbed), dtype=bool)
    if moving:
        usual = float(np.sqrt(np.mean(motion.speed**2)))
        resting = rows.of((np.abs(motion.speed) < REST * usual).astype(float)) > 0.5
        chosen = ~rows.disturbed if resting.mean() > 0.9 else ~(resting | rows.disturbed)
    _, block = np.unique((rows.picked(record.t)[chosen] - record.t[0]) // BLOCK, return_inverse=True)
    return RegressionRows(
        columns={name: rows.of(own[name])[chosen] for name in model.names if name in own},
        force=rows.of(force)[chosen],
        block=block.astype(np.int64),
        seen={name: rows.picked(one)[chosen] for name, one in seen.items()},
    )
