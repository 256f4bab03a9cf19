"""One axis under friction: its parameters, the friction laws that are tried, and its motion.

    (M + M_load) a = F - offset - G(q) - friction(v) - mu W sgn(v)
    G(q) = k q + sum_n S_n sin(w n q) + C_n cos(w n q)        w = 2 pi / period, one turn unless another is given

n = 1 is gravity on an axis that turns; higher ones are cogging and gear errors; k is a cable or a spring. A load of
known mass adds its own inertia and weight (`KnownLoad`). The nested laws of friction:

    viscous       b v
    coulomb       b v + c sgn(v)
    stribeck      b v + (c + s exp(-|v/v_s|)) sgn(v)
    asymmetric    b v + c sgn(v) with another b and c for each direction; then c+ - c- contains the offset

and with each of them dry friction may grow with a load W of the drive, as that of gears does:

    position       |G(q)|            with a known load's weight (A. C. Bittencourt and S. Gunnarsson, Static friction
                                     in a robot joint, J. Dyn. Syst. Meas. Control 134 (2012) 051013)
    drive          |F|               without the offset, as a robot's wheels have it (`ballbot.mechanics.friction`)
    transmitted    |F + G(q)| / 2    M. Duclusaud et al., Extended friction models for the physics simulation of servo
                                     actuators, arXiv 2410.08650 (2024), with mu twice theirs
    recorded       |W(t)|            a column of the record

A parameter is common to all records or separate for each. A separate one has a label for each record, "offset[2]" for
that of the second; a common one has its name. The motion is that of `ballbot.mechanics.friction_laws`, the force held
over a row or changing evenly to the next one, G taken in the middle of each step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, suggest
from ballbot.fitting.parameter import Parameter, RelativeSpace, Scale
from ballbot.identification.axis.record import GAP, AxisRecord, KnownLoad
from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.mechanics.friction_laws.classical import Classical, ClassicalNumbers
from ballbot.mechanics.friction_laws.interface import UNLIMITED, Inertia, move

Values = Mapping[str, float]
TURN = 2.0 * math.pi
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
    return _parameter(name, f"{symbol}_{number}", "N", f"{kind}({number} w q)", scale="signed")


def unit_for(parameter: Parameter, axis_unit: str) -> str:
    """Return a parameter's unit for an axis of positions in "m" or "rad"; empty for a number without one."""
    if axis_unit == "m" or parameter.unit == "1":
        return parameter.unit.removeprefix("1")
    turning = {"kg": "kg m^2", "N s/m": "N m s/rad", "N": "N m", "m/s": "rad/s", "N/m": "N m/rad"}
    return turning.get(parameter.unit, parameter.unit)


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


def axis_law_named(name: str) -> AxisLaw:
    """Return the law of that name; InputError if no law has it."""
    if name not in AXIS_LAWS:
        hint = suggest(name, AXIS_LAWS, otherwise="the laws are")
        raise InputError(f"There is no friction law {name!r} (--law); {hint}")
    return AXIS_LAWS[name]


Load = Literal["position", "drive", "transmitted", "recorded"]
#: by kind: the shares of F and of G in the load
_SHARES: Mapping[Load, tuple[float, float]] = MappingProxyType(
    {"position": (0.0, 1.0), "drive": (1.0, 0.0), "transmitted": (0.5, 0.5), "recorded": (0.0, 0.0)}
)
#: what each kind is, in words
LOADS: Mapping[Load, str] = MappingProxyType(
    {
        "position": "the force over position",
        "drive": "the drive's force",
        "transmitted": "the mean of the drive's force and the force over position",
        "recorded": "the recorded load",
    }
)
#: asks for friction that depends on no load
NO_LOAD_FRICTION = "none"


def load_named(name: str) -> Load:
    """Return the kind of load of that name; InputError if there is none."""
    for one in LOADS:
        if one == name:
            return one
    hint = suggest(name, (*LOADS, NO_LOAD_FRICTION), otherwise="the loads are")
    raise InputError(f"There is no load {name!r} that dry friction depends on (--load-friction); {hint}")


def recorded_load(load: Load | None, record: AxisRecord) -> NDArray[np.float64]:
    """Return the record's own load (N,), zeros of another kind; InputError if it is needed and not there."""
    if load != "recorded":
        return np.zeros(len(record))
    if record.load is None:
        raise InputError(
            f"{record.name} has no load, on which the friction depends; name its column with --load."
        )
    return record.load


def load_at(
    load: Load, force: NDArray[np.float64], over_position: NDArray[np.float64], recorded: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return W (N,) [N] of a force F without the offset, a force G(q) and a recorded load (N,)."""
    of_force, of_field = _SHARES[load]
    return np.abs(of_force * force + of_field * over_position + recorded)


def harmonic(number: int) -> tuple[str, str]:
    """Return the names of the two parameters of a harmonic."""
    return f"sin_{number}", f"cos_{number}"


def terms_of(*, spring: bool, harmonics: Sequence[int]) -> tuple[str, ...]:
    """Return the names of the forces over position; InputError if a harmonic is not one."""
    for number in harmonics:
        if not 1 <= number <= MOST_HARMONICS:
            raise InputError(
                f"--harmonics names {number}; a harmonic is a whole number from 1 to {MOST_HARMONICS}."
            )
    names = [name for number in dict.fromkeys(harmonics) for name in harmonic(number)]
    return (*(("spring",) if spring else ()), *names)


def base_name(label: str) -> str:
    """Return the parameter that a label is of: "offset" of "offset[2]"."""
    return label.partition("[")[0]


@dataclass(frozen=True, kw_only=True)
class AxisModel:
    """What is estimated from one or more records."""

    law: AxisLaw
    terms: tuple[str, ...] = ()  #: of the force over position: "spring", "sin_1", "cos_1", ...
    load: Load | None = None  #: on which dry friction depends
    period: float = TURN  #: of the first harmonic [m]
    separate: tuple[str, ...] = ()  #: parameters of which each record has its own
    records: int = 1
    interpolated: bool = False  #: whether the force changes evenly from row to row; it is held otherwise
    held: Mapping[str, float] = field(default_factory=dict)  #: parameters that are known, by name

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters of one record."""
        return (*self.law.names, *self.terms, *(("load",) if self.load else ()))

    @property
    def labels(self) -> tuple[str, ...]:
        """What is estimated from all records."""
        found: list[str] = []
        for name in self.names:
            if name in self.held:
                continue
            own = self.records > 1 and name in self.separate
            found += [f"{name}[{i + 1}]" for i in range(self.records)] if own else [name]
        return tuple(found)

    def with_law(self, name: str) -> AxisModel:
        """Return the same with another friction law."""
        return replace(self, law=AXIS_LAWS[name])

    def label(self, name: str, record: int) -> str:
        """Return the label of a record's parameter."""
        own = f"{name}[{record + 1}]"
        return own if own in self.labels else name

    def values_for(self, values: Values, record: int | None) -> dict[str, float]:
        """Return one record's parameters by name; for another record separate ones on average."""
        numbers = range(self.records) if record is None else (record,)
        return {
            name: self.held[name]
            if name in self.held
            else float(np.mean([values[self.label(name, i)] for i in numbers]))
            for name in self.names
        }

    def axis(self, values: Values, record: int | None) -> Axis:
        """Return the axis of one of the records, or of another one."""
        return Axis(law=self.law, values=self.values_for(values, record), period=self.period, load=self.load)

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

    def by_label(self, vector: NDArray[np.float64]) -> dict[str, float]:
        """Return parameters (p,) by label."""
        return dict(zip(self.labels, vector.tolist(), strict=True))


def position_columns(
    terms: Sequence[str], position: NDArray[np.float64], period: float
) -> dict[str, NDArray[np.float64]]:
    """Return the force over position of each term for a coefficient of one, (N,)."""
    columns = {}
    for name in terms:
        kind, _, number = name.partition("_")
        wave = TURN * int(number) / period if number else 0.0
        columns[name] = (
            position if name == "spring" else {"sin": np.sin, "cos": np.cos}[kind](wave * position)
        )
    return columns


class _Numbers(NamedTuple):
    """An axis as compiled code reads it."""

    plus: ClassicalNumbers  #: the friction forwards
    minus: ClassicalNumbers  #: the friction backwards
    inertia: Inertia
    field: NDArray[np.float64]  #: a row (0, k, 0), then a row (w n, S_n, C_n) for each harmonic
    load: tuple[float, float, float]  #: mu, and the shares of F and of G(q) in the load


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
    loads: NDArray[np.float64]  #: recorded, on which friction depends; zero if it does not


class _Loop(NamedTuple):
    """A control loop and what acts on it."""

    gains: tuple[float, float, float, float]  #: k_p, k_v, force per input and the input's limit
    span: int  #: samples over which the loop takes its speed
    h: float  #: sample time [s]
    reference: NDArray[np.float64]  #: (n,) [m]
    added: NDArray[np.float64]  #: (n,) forces [N] beside the loop's that the recorded force contains
    acting: NDArray[np.float64]  #: (n,) other forces [N]
    loads: NDArray[np.float64]  #: (n,) recorded


@inlined
def _loaded(law, more):
    return ClassicalNumbers(law.b, law.c + more, law.s, law.inv_vs, law.delta)


@inlined
def _step(axis, state, position, speed, force, recorded, h) -> tuple[float, float]:
    """Return position and speed after h [s] under a force, less that of the position halfway, and a recorded load."""
    halfway = position + 0.5 * h * speed
    over_position = axis.field[0, 1] * halfway
    for i in range(1, len(axis.field)):
        angle = axis.field[i, 0] * halfway
        over_position += axis.field[i, 1] * math.sin(angle) + axis.field[i, 2] * math.cos(angle)
    mu, of_force, of_field = axis.load
    more = mu * abs(of_force * force + of_field * over_position + recorded)
    force -= over_position
    if speed > 0.0 or (speed == 0.0 and force > 0.0):
        speed, travel = move(_loaded(axis.plus, more), axis.inertia, force, state, speed, h)
    else:
        speed, travel = move(_loaded(axis.minus, more), axis.inertia, force, state, speed, h)
    return position + travel, speed


@compiled
def follow_windows(axis, windows, drive, steps, positions):
    """Move in windows under a drive; `positions` takes, one window after another, the position at each row's end."""
    state = np.empty(0)
    place = 0
    for w in range(len(windows.firsts)):
        position, speed = windows.starts[w, 0], windows.starts[w, 1]
        for k in range(windows.firsts[w], windows.firsts[w] + windows.counts[w]):
            part = drive.durations[k] / steps
            for i in range(steps):
                force = drive.forces[k] + drive.rises[k] * (i + 0.5) / steps
                position, speed = _step(axis, state, position, speed, force, drive.loads[k], part)
            positions[place] = position
            place += 1


@compiled
def follow_loop(axis, loop, start, steps, positions, forces):
    """Move in closed loop from a position and speed (2,); `positions` and `forces` (n,) are those of each row."""
    state = np.empty(0)
    k_p, k_v, force_per_input, limit = loop.gains
    part = loop.h / steps
    position, speed = start[0], start[1]
    for k in range(len(loop.reference)):
        positions[k] = position
        before = (
            positions[k - loop.span] if k >= loop.span else start[0] + (k - loop.span) * loop.h * start[1]
        )
        velocity = (position - before) / (loop.span * loop.h)
        u = k_v * (k_p * (loop.reference[k] - position) - velocity)
        forces[k] = force_per_input * min(max(u, -limit), limit) + loop.added[k]
        held = forces[k] + loop.acting[k]
        for _ in range(steps):
            position, speed = _step(axis, state, position, speed, held, loop.loads[k], part)


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
    period: float = TURN  #: of the first harmonic [m]
    load: Load | None = None  #: on which dry friction depends

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
        drive = _Drive(acting, rises, record.durations, recorded_load(self.load, record))
        positions, known = np.empty(int(counts.sum())), record.known_load
        windows = _Windows(firsts, counts, starts)
        follow_windows(self._numbers(known), windows, drive, self._steps(longest, known), positions)
        return positions

    def closed_loop(
        self, record: AxisRecord, *, speed: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return positions and forces (N,) at the record's rows, from its first position and that speed [m/s].

        Raises
        ------
        InputError
            If the record has no loop or no reference.
        """
        loop = record.loop
        if loop is None or record.reference is None:
            raise InputError(
                f"{record.name} does not contain the control loop; give its gains and its reference."
            )
        positions, forces = np.empty((2, len(record)))
        # a limit that is not finite is one that is never reached
        limit = loop.limit if math.isfinite(loop.limit) else np.finfo(float).max
        driven = _Loop(
            gains=(loop.position_gain, loop.velocity_gain, loop.force_per_input, limit),
            span=loop.span,
            h=record.sample_time,
            reference=record.reference,
            added=np.zeros(len(record)) if record.added is None else record.added,
            acting=np.full(len(record), -self.values.get("offset", 0.0)),
            loads=recorded_load(self.load, record),
        )
        start = np.array([float(record.position[0]), float(speed)])
        steps = self._steps(record.sample_time, record.known_load)
        follow_loop(self._numbers(record.known_load), driven, start, steps, positions, forces)
        return positions, forces

    def position_force(self, position: NDArray[np.float64], known: KnownLoad) -> NDArray[np.float64]:
        """Return G(q) at positions (N,), with a known load's weight and without the constant force."""
        first, *harmonics = self._field(known)
        total = first[1] * position
        for w, s, c in harmonics:
            total = total + s * np.sin(w * position) + c * np.cos(w * position)
        return total

    def needed_force(
        self,
        record: AxisRecord,
        position: NDArray[np.float64],
        speed: NDArray[np.float64],
        acceleration: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return the force (N,) that a motion (N,) of the record's load needs."""
        known = record.known_load
        plus, minus = self.law.laws(self.values)
        over_position = self.position_force(position, known)
        friction = np.where(speed >= 0.0, plus.steady_friction(speed), minus.steady_friction(speed))
        needed = self._mass(known) * acceleration + over_position + friction
        if self.load:
            of_force, of_field = _SHARES[self.load]
            # F = needed + way |W| and W = without + of_force (F - needed), whose sign is that of `without`
            without = of_force * needed + of_field * over_position + recorded_load(self.load, record)
            way = np.sign(speed) * self.values["load"] * np.sign(without)
            needed = needed + way * without / (1.0 - of_force * way)
        return needed + self.values.get("offset", 0.0)

    def _numbers(self, known: KnownLoad) -> _Numbers:
        """Return the axis as compiled code reads it."""
        plus, minus = (ClassicalNumbers(*one.numbers()[:5]) for one in self.law.laws(self.values))
        return _Numbers(
            plus=plus,
            minus=minus,
            inertia=Inertia(inv_J=1.0 / self._mass(known), clamp=UNLIMITED, stall=UNLIMITED, inv_no_load=0.0),
            field=self._field(known),
            load=(self.values["load"], *_SHARES[self.load]) if self.load else (0.0, 0.0, 0.0),
        )

    def _mass(self, known: KnownLoad) -> float:
        return self.values["mass"] + known.inertia

    def _field(self, known: KnownLoad) -> NDArray[np.float64]:
        """Return the rows of `_Numbers.field`; a known load's weight is the first harmonic of a turn."""
        rows = [(0.0, self.values.get("spring", 0.0), 0.0)]
        for name in self.values:
            if name.startswith("sin_"):
                number = name.removeprefix("sin_")
                wave = TURN * int(number) / self.period
                rows.append((wave, self.values[name], self.values[f"cos_{number}"]))
        if known.weight:
            at = known.hanging
            rows.append((1.0, known.weight * math.cos(at), -known.weight * math.sin(at)))
        return np.array(rows)

    def _steps(self, row: float, known: KnownLoad) -> int:
        """Return the steps in a row that lasts `row` [s]."""
        laws, mass = self.law.laws(self.values), self._mass(known)
        slope = max(law.explicit_slope() for law in laws)
        wanted = row * slope / mass / _LARGEST_RATE_STEP
        if wanted > _MOST_STEPS:
            # a Stribeck speed that one step passes: the law is Coulomb's but for its break-away
            wanted *= max(law.viscous for law in laws) / slope
        first, *harmonics = self._field(known)
        stiffness = abs(first[1]) + sum(w * math.hypot(s, c) for w, s, c in harmonics)
        turning = row * math.sqrt(stiffness / mass) / _LARGEST_FIELD_STEP
        return min(max(1, math.ceil(wanted), math.ceil(turning)), _MOST_STEPS)
