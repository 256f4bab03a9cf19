"""The inverse model: force as a linear sum of what the axis did, by least squares (IDIM-LS).

    F = M a + F_v v + F_c sgn(v) + offset                                    ("coulomb")
    F = M a + (F_v+ v + F_c+) [v > 0] + (F_v- v - F_c-) [v < 0]              ("asymmetric")

Friction takes energy: a coefficient of it that comes out below zero is held at zero, and the others are fitted anew.

Standard deviations are given twice: as published, s sqrt(diag (X^T X)^-1), which takes every row for independent,
and clustered by blocks of one second, which does not (see `ballbot.identification.axis.covariance`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.axis.covariance import clustered_covariance
from ballbot.identification.axis.filtering import (
    Motion,
    decimated,
    decimation_factor,
    default_bandwidth,
    first_row,
    smoothed_motion,
)
from ballbot.identification.axis.record import AxisRecord

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
        Where the bandwidth does not suit the sampling, or the record cannot give the parameters.
    """
    band = default_bandwidth(record) if bandwidth is None else bandwidth
    motion_columns = _columns(smoothed_motion(record, bandwidth=band), form)
    columns = {name: column for name, column in motion_columns.items() if name not in held}
    start, factor = first_row(record, bandwidth=band), decimation_factor(record, bandwidth=band)
    names = tuple(columns)
    X = np.column_stack([decimated(column[start:], factor) for column in columns.values()])
    F = decimated(record.force[start:], factor)
    condition = _condition(record, names, X)
    values = np.linalg.lstsq(X, F, rcond=None)[0]
    residual = F - X @ values
    block = (np.arange(len(F)) * factor * record.sample_time // BLOCK).astype(np.int64)
    deviations = np.std(residual, ddof=1) * np.sqrt(np.linalg.inv(X.T @ X).diagonal())
    errors = np.sqrt(clustered_covariance(X, residual, block).diagonal())
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
