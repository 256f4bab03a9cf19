"""The parameters of an axis that are estimated: of a friction law, forces over position, a load and a drift.

A parameter is common to all records or separate for each. A separate one has a label for each record, "offset[2]" for
that of the second; a common one has its name. A drift of the offset belongs to its record.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.fitting.parameter import Parameter, RelativeSpace
from ballbot.identification.axis.laws import MOST_HARMONICS, AxisLaw, Values, parameter_named
from ballbot.identification.axis.load import LOADS, Load
from ballbot.identification.axis.model import Axis

TURN = 2.0 * math.pi


def harmonic(number: int) -> tuple[str, str]:
    """Return the names of the two parameters of a harmonic."""
    return f"sin_{number}", f"cos_{number}"


def base_name(label: str) -> str:
    """Return the parameter that a label is of: "offset" of "offset[2]"."""
    return label.partition("[")[0]


@dataclass(frozen=True, kw_only=True)
class AxisModel:
    """What is estimated from one or more records."""

    law: AxisLaw
    terms: tuple[str, ...] = ()  #: of the force over position: "spring", "sin_1", "cos_1", ...
    load: Load | None = None  #: on which dry friction depends
    drifts: int = 0  #: straight pieces of each record's drifting offset
    period: float = TURN  #: of the first harmonic [m]
    separate: tuple[str, ...] = ()  #: parameters of which each record has its own
    records: int = 1
    interpolated: bool = False  #: whether the force changes evenly from row to row; it is held otherwise
    #: travel [m] over which dry friction turns over in the inverse model, as that of bristles; zero for a step
    bending: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters of one record."""
        load = ("load",) if self.load else ()
        return (*self.law.names, *self.terms, *load, *(f"drift_{i + 1}" for i in range(self.drifts)))

    @property
    def labels(self) -> tuple[str, ...]:
        """What is estimated from all records."""
        found: list[str] = []
        for name in self.names:
            if self.records > 1 and (name in self.separate or name.startswith("drift_")):
                found += [f"{name}[{i + 1}]" for i in range(self.records)]
            else:
                found.append(name)
        return tuple(found)

    def with_law(self, law: AxisLaw) -> AxisModel:
        """Return the same with another friction law."""
        return replace(self, law=law)

    def label(self, name: str, record: int) -> str:
        """Return the label of a record's parameter."""
        own = f"{name}[{record + 1}]"
        return own if own in self.labels else name

    def values_for(self, values: Values, record: int) -> dict[str, float]:
        """Return one record's parameters by name."""
        return {name: values[self.label(name, record)] for name in self.names}

    def values_elsewhere(self, values: Values) -> dict[str, float]:
        """Return the parameters for a record that is none of these: separate ones on average, without drift."""
        return {
            name: float(np.mean([values[self.label(name, i)] for i in range(self.records)]))
            for name in self.names
            if not name.startswith("drift_")
        }

    def values_from_others(self, values: Values) -> dict[str, float]:
        """Return parameters by label, each record's separate ones on average over the other records.

        They are what a record's parameters would be had it not been fitted.
        """
        found = dict(values)
        for name in self.names:
            labels = [self.label(name, i) for i in range(self.records)]
            if labels[0] != name and not name.startswith("drift_"):
                total = sum(values[label] for label in labels)
                found |= {label: (total - values[label]) / (self.records - 1) for label in labels}
        return found

    def axis(self, values: Values, record: int | None) -> Axis:
        """Return the axis of one of the records, or of another one."""
        own = self.values_elsewhere(values) if record is None else self.values_for(values, record)
        return Axis(law=self.law, values=own, period=self.period, load=self.load)

    def parameter(self, label: str) -> Parameter:
        """Return what a label is."""
        name = base_name(label)
        kind = parameter_named(name)
        if name == "load" and self.load:
            # a recorded load may have any unit
            unit, words = ("N", "per unit of") if self.load == "recorded" else (kind.unit, "as a share of")
            kind = replace(kind, meaning=f"Coulomb, {words} {LOADS[self.load]}", unit=unit)
        return replace(kind, symbol=kind.symbol + label[len(name) :])

    def space(self, start: Values) -> RelativeSpace:
        """Return the parameters, scaled by their values at `start`."""
        return RelativeSpace(
            parameters=tuple(
                replace(self.parameter(label), default=float(start[label])) for label in self.labels
            )
        )

    def vector(self, values: Values) -> NDArray[np.float64]:
        """Return parameters by label as (p,)."""
        return np.array([values[label] for label in self.labels])

    def by_label(self, vector: NDArray[np.float64]) -> dict[str, float]:
        """Return parameters (p,) by label."""
        return dict(zip(self.labels, vector.tolist(), strict=True))


def terms_of(*, spring: bool, harmonics: Sequence[int]) -> tuple[str, ...]:
    """Return the names of the forces over position.

    Raises
    ------
    InputError
        If a harmonic is not a whole number from 1 to `MOST_HARMONICS`.
    """
    for number in harmonics:
        if not 1 <= number <= MOST_HARMONICS:
            raise InputError(
                f"--harmonics names {number}; a harmonic is a whole number from 1 to {MOST_HARMONICS}."
            )
    names = [name for number in dict.fromkeys(harmonics) for name in harmonic(number)]
    return (*(("spring",) if spring else ()), *names)


def position_columns(
    terms: Sequence[str], position: NDArray[np.float64], period: float
) -> Mapping[str, NDArray[np.float64]]:
    """Return the force over position of each term for a coefficient of one, (N,)."""
    columns = {}
    for name in terms:
        if name == "spring":
            columns[name] = position
        else:
            kind, _, number = name.partition("_")
            wave = TURN * int(number) / period
            columns[name] = (np.sin if kind == "sin" else np.cos)(wave * position)
    return columns
