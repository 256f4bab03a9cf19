"""One axis under friction: its parameters, the friction laws that are tried, and its motion.

    M a = F - offset - G(q) - friction(v) - mu W sgn(v)
    G(q) = k q + sum_n S_n sin(n q) + C_n cos(n q)

n = 1 is gravity on an axis that turns; higher ones are cogging and gear errors; k is a cable or a spring. The nested
laws of friction:

    viscous       b v
    coulomb       b v + c sgn(v)
    stribeck      b v + (c + s exp(-|v/v_s|)) sgn(v)
    asymmetric    b v + c sgn(v) with another b and c for each direction; then c+ - c- contains the offset

and with each of them dry friction may grow with the load W = |F + G(q)| / 2 that gears transmit: M. Duclusaud et al.,
Extended friction models for the physics simulation of servo actuators, arXiv 2410.08650 (2024), with mu twice theirs.

The motion is that of `ballbot.mechanics.friction_laws`, the force held over a row or changing evenly to the next one, G
taken in the middle of each step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, suggest
from ballbot.fitting.parameter import Parameter, RelativeSpace, Scale
from ballbot.identification.axis.record import GAP, AxisRecord
from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.mechanics.friction_laws.classical import UNLIMITED, Classical, ClassicalNumbers, Inertia, move

Values = Mapping[str, float]
#: the highest harmonic of a force over position
MOST_HARMONICS = 500


def _parameter(name: str, symbol: str, unit: str, meaning: str, *, scale: Scale = "amount") -> Parameter:
    bounds = (-math.inf, math.inf) if scale == "signed" else (0.0, math.inf)
    default = 1.0 if scale == "ratio" else 0.0
    return Parameter(
        name=name, symbol=symbol, unit=unit, scale=scale, bounds=bounds, default=default, meaning=meaning
    )


#: by name; units are those of an axis that moves along a line, see `unit_for`
PARAMETERS: Mapping[str, Parameter] = MappingProxyType(
    {
        one.name: one
        for one in (
            _parameter("mass", "M", "kg", "mass or inertia", scale="ratio"),
            _parameter("viscous", "b", "N s/m", "viscous"),
            _parameter("coulomb", "c", "N", "Coulomb"),
            _parameter("offset", "offset", "N", "constant force", scale="signed"),
            _parameter("stribeck", "s", "N", "break-away above Coulomb"),
            _parameter("stribeck_speed", "v_s", "m/s", "Stribeck speed", scale="ratio"),
            _parameter("viscous_plus", "b+", "N s/m", "viscous, forwards"),
            _parameter("viscous_minus", "b-", "N s/m", "viscous, backwards"),
            _parameter("coulomb_plus", "c+", "N", "Coulomb, forwards"),
            _parameter("coulomb_minus", "c-", "N", "Coulomb, backwards"),
            _parameter("spring", "k", "N/m", "spring or cable", scale="signed"),
            _parameter("load", "mu", "1", "Coulomb, as a share of the load"),
        )
    }
)


def parameter_named(name: str) -> Parameter:
    """Return the parameter of that name, a harmonic's too: "sin_1", "cos_1"."""
    if name in PARAMETERS:
        return PARAMETERS[name]
    kind, _, number = name.partition("_")
    symbol = {"sin": "S", "cos": "C"}[kind]
    return _parameter(name, f"{symbol}_{number}", "N", f"{kind}({number} q)", scale="signed")


def unit_for(parameter: Parameter, axis_unit: str) -> str:
    """Return a parameter's unit for an axis of positions in "m" or "rad"; empty for a number without one."""
    if axis_unit == "m" or parameter.unit == "1":
        return parameter.unit.removeprefix("1")
    turning = {"kg": "kg m^2", "N s/m": "N m s/rad", "N": "N m", "m/s": "rad/s", "N/m": "N m/rad"}
    return turning[parameter.unit]


@dataclass(frozen=True, kw_only=True)
class AxisLaw:
    """One law of the ladder."""

    name: str
    below: str | None  #: the law within it
    names: tuple[str, ...]  #: its parameters

    @property
    def symmetric(self) -> bool:
        """Whether both directions have one friction."""
        return "viscous" in self.names

    def laws(self, values: Values) -> tuple[Classical, Classical]:
        """Return the friction forwards and backwards."""

        def side(b: str, c: str) -> Classical:
            return Classical(
                viscous=values[b],
                coulomb=values.get(c, 0.0),
                stribeck=values.get("stribeck", 0.0),
                stribeck_speed=values.get("stribeck_speed", 1.0),
                stribeck_exponent=1.0,
            )

        if not self.symmetric:
            return side("viscous_plus", "coulomb_plus"), side("viscous_minus", "coulomb_minus")
        both = side("viscous", "coulomb")
        return both, both


_COULOMB = ("mass", "viscous", "coulomb", "offset")

AXIS_LAWS: Mapping[str, AxisLaw] = MappingProxyType(
    {
        law.name: law
        for law in (
            AxisLaw(name="viscous", below=None, names=("mass", "viscous", "offset")),
            AxisLaw(name="coulomb", below="viscous", names=_COULOMB),
            AxisLaw(name="stribeck", below="coulomb", names=(*_COULOMB, "stribeck", "stribeck_speed")),
            AxisLaw(
                name="asymmetric",
                below="coulomb",
                names=("mass", "viscous_plus", "coulomb_plus", "viscous_minus", "coulomb_minus"),
            ),
        )
    }
)


def check_law(name: str) -> None:
    """Raise InputError if no law has that name."""
    if name not in AXIS_LAWS:
        hint = suggest(name, AXIS_LAWS, otherwise="the laws are")
        raise InputError(f"There is no friction law {name!r} (--law); {hint}")


def harmonic(number: int) -> tuple[str, str]:
    """Return the names of the two parameters of a harmonic; InputError if there is none of that number."""
    if not 1 <= number <= MOST_HARMONICS:
        raise InputError(
            f"--harmonics names {number}; a harmonic is a whole number from 1 to {MOST_HARMONICS}."
        )
    return f"sin_{number}", f"cos_{number}"


@dataclass(frozen=True, kw_only=True)
class AxisModel:
    """What is estimated."""

    law: AxisLaw
    terms: tuple[str, ...] = ()  #: of the force over position: "spring", "sin_1", "cos_1", ...
    load: bool = False  #: whether dry friction grows with the load
    interpolated: bool = False  #: whether the force changes evenly from row to row; it is held otherwise
    held: Values = field(default_factory=dict)  #: parameters that are known, by name

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that are estimated."""
        every = (*self.law.names, *self.terms, *(("load",) if self.load else ()))
        return tuple(name for name in every if name not in self.held)

    def with_law(self, name: str) -> AxisModel:
        """Return the same with another friction law."""
        return replace(self, law=AXIS_LAWS[name])

    def axis(self, values: Values) -> Axis:
        """Return the axis with these parameters and the known ones."""
        return Axis(law=self.law, values={**self.held, **values})

    def space(self, start: Values) -> RelativeSpace:
        """Return the parameters, scaled by their values at `start`."""
        return RelativeSpace(
            parameters=tuple(
                replace(parameter_named(name), default=float(start[name])) for name in self.names
            )
        )

    def by_name(self, vector: NDArray[np.float64]) -> dict[str, float]:
        """Return parameters (p,) by name."""
        return dict(zip(self.names, vector.tolist(), strict=True))


def position_columns(terms: Sequence[str], position: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Return the force over position of each term for a coefficient of one, (N,)."""
    columns = {}
    for name in terms:
        kind, _, number = name.partition("_")
        columns[name] = (
            position if name == "spring" else {"sin": np.sin, "cos": np.cos}[kind](int(number) * position)
        )
    return columns


class _Numbers(NamedTuple):
    """An axis as compiled code reads it."""

    plus: ClassicalNumbers  #: the friction forwards
    minus: ClassicalNumbers  #: the friction backwards
    inertia: Inertia
    field: NDArray[np.float64]  #: a row (0, k, 0), then a row (n, S_n, C_n) for each harmonic
    mu: float


class _Windows(NamedTuple):
    """Windows of a record's rows: each begins at a row, in a state there, and runs over some rows."""

    firsts: NDArray[np.int64]  #: (w,)
    counts: NDArray[np.int64]  #: (w,) rows
    starts: NDArray[np.float64]  #: (w, 2) position [m] and speed [m/s]


class _Drive(NamedTuple):
    """The force of each row (N,), which begins at `forces` [N] and rises evenly by `rises` [N] over `durations` [s]."""

    forces: NDArray[np.float64]
    rises: NDArray[np.float64]
    durations: NDArray[np.float64]


@inlined
def _loaded(law, more):
    return ClassicalNumbers(law.b, law.c + more, law.s, law.inv_vs, law.delta, law.terms)


@inlined
def _step(axis, position, speed, force, h) -> tuple[float, float]:
    """Return position and speed after h [s] under a force, less that of the position halfway."""
    halfway = position + 0.5 * h * speed
    over_position = axis.field[0, 1] * halfway
    for i in range(1, len(axis.field)):
        angle = axis.field[i, 0] * halfway
        over_position += axis.field[i, 1] * math.sin(angle) + axis.field[i, 2] * math.cos(angle)
    more = 0.5 * axis.mu * abs(force + over_position)
    force -= over_position
    if speed > 0.0 or (speed == 0.0 and force > 0.0):
        speed, travel = move(_loaded(axis.plus, more), axis.inertia, force, speed, h)
    else:
        speed, travel = move(_loaded(axis.minus, more), axis.inertia, force, speed, h)
    return position + travel, speed


@compiled
def follow_windows(axis, windows, drive, steps, positions):
    """Move in windows under a drive; `positions` takes, one window after another, the position at each row's end."""
    place = 0
    for w in range(len(windows.firsts)):
        position, speed = windows.starts[w, 0], windows.starts[w, 1]
        for k in range(windows.firsts[w], windows.firsts[w] + windows.counts[w]):
            part = drive.durations[k] / steps
            for i in range(steps):
                force = drive.forces[k] + drive.rises[k] * (i + 0.5) / steps
                position, speed = _step(axis, position, speed, force, part)
            positions[place] = position
            place += 1


#: explicit steps are at most this part of the axis's fastest time constant
_LARGEST_RATE_STEP = 0.5
#: and at most this part of the time constant of a force over position [rad]: an error of 1e-3 of its phase
_LARGEST_FIELD_STEP = 0.15
#: steps of the simulation in one row, at most
_MOST_STEPS = 50


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """A mass with friction, a constant force against it and forces that depend on position."""

    law: AxisLaw
    values: Values

    def windows(
        self,
        record: AxisRecord,
        firsts: NDArray[np.int64],
        counts: NDArray[np.int64],
        starts: NDArray[np.float64],
        *,
        interpolated: bool = False,
    ) -> NDArray[np.float64]:
        """Return the positions at the ends of the rows of windows of a record, one window after another.

        Parameters
        ----------
        record : AxisRecord
        firsts, counts : ndarray (w,)
            The first row of each window, and how many rows it runs over.
        starts : ndarray (w, 2)
            Position and speed at each first row.
        interpolated : bool
            Whether the force changes evenly from row to row; it is held by default.
        """
        acting = record.force - self.values.get("offset", 0.0)
        rises = np.append(np.diff(acting), 0.0) if interpolated else np.zeros(len(acting))
        longest = float(record.durations.max()) if record.even else GAP * record.sample_time
        positions = np.empty(int(counts.sum()))
        follow_windows(
            self._numbers(),
            _Windows(firsts, counts, starts),
            _Drive(acting, rises, record.durations),
            self._steps(longest),
            positions,
        )
        return positions

    def other_forces(
        self,
        force: NDArray[np.float64],
        position: NDArray[np.float64],
        speed: NDArray[np.float64],
        acceleration: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return the part of a force (N,) that is not the law's friction: of the mass, the offset, G(q) and a load."""
        first, *harmonics = self._field()
        G = first[1] * position
        for n, s, c in harmonics:
            G = G + s * np.sin(n * position) + c * np.cos(n * position)
        offset = self.values.get("offset", 0.0)
        loaded = 0.5 * self.values.get("load", 0.0) * np.abs(force - offset + G) * np.sign(speed)
        return self.values["mass"] * acceleration + offset + G + loaded

    def _numbers(self) -> _Numbers:
        """Return the axis as compiled code reads it."""
        plus, minus = (one.numbers() for one in self.law.laws(self.values))
        return _Numbers(
            plus=plus,
            minus=minus,
            inertia=Inertia(
                inv_J=1.0 / self.values["mass"], clamp=UNLIMITED, stall=UNLIMITED, inv_no_load=0.0
            ),
            field=self._field(),
            mu=self.values.get("load", 0.0),
        )

    def _field(self) -> NDArray[np.float64]:
        """Return the rows of `_Numbers.field`."""
        rows = [(0.0, self.values.get("spring", 0.0), 0.0)]
        for name in self.values:
            if name.startswith("sin_"):
                number = name.removeprefix("sin_")
                rows.append((float(number), self.values[name], self.values[f"cos_{number}"]))
        return np.array(rows)

    def _steps(self, row: float) -> int:
        """Return the steps in a row that lasts `row` [s]."""
        laws, mass = self.law.laws(self.values), self.values["mass"]
        slope = max(law.explicit_slope() for law in laws)
        wanted = row * slope / mass / _LARGEST_RATE_STEP
        if wanted > _MOST_STEPS:
            # a Stribeck speed that one step passes: the law is Coulomb's but for its break-away
            wanted *= max(law.viscous for law in laws) / slope
        first, *harmonics = self._field()
        stiffness = abs(first[1]) + sum(n * math.hypot(s, c) for n, s, c in harmonics)
        turning = row * math.sqrt(stiffness / mass) / _LARGEST_FIELD_STEP
        return min(max(1, math.ceil(wanted), math.ceil(turning)), _MOST_STEPS)
