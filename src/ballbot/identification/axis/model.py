"""One axis as a model: its parameters, the friction laws tried, forces that depend on position, and its motion.

The nested friction laws of one axis:

    viscous       M, b, offset
    coulomb       and c                                    tau = b v + c sgn(v)
    stribeck      and s, v_s                               and s exp(-|v/v_s|) sgn(v)
    dahl          coulomb and sigma_0                      bristles that bend before they slide
    lugre         dahl and s, v_s, sigma_1                 (Canudas de Wit 1995)
    asymmetric    coulomb with b, c of either direction    of which offset and c+ - c- are one while it slides

The laws are those of `ballbot.mechanics.friction_laws`; Dahl's is LuGre's without s and sigma_1.

Forces that depend on position: G(q) = k q + sum_n (S_n sin(w n q) + C_n cos(w n q)), with w = 2 pi / period, and a
period of one turn unless another is given. n = 1 is gravity on an axis that turns; higher ones are cogging and what a
gear repeats; k is a cable or a spring. A load of known mass adds its own inertia and weight (`KnownLoad`).

The motion is that of `ballbot.mechanics.friction_laws.interface.move`, the force held over a sample or interpolated, G
taken in the middle of each step. Two laws of one kind, one for each direction: within the one step in which the
direction changes, the law is that of its start; with steps of a sample or less this is far below what a record can
show.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array, real_number
from ballbot.errors import InputError
from ballbot.fitting.parameter import Parameter, Scale
from ballbot.identification.axis.record import GAP, NO_LOAD, AxisRecord, KnownLoad
from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.mechanics.friction_laws.classical import Classical
from ballbot.mechanics.friction_laws.interface import move, settle
from ballbot.mechanics.friction_laws.lugre import LuGre
from ballbot.simulation.driveline import Driveline

Values = Mapping[str, float]
Law = Classical | LuGre

#: bristles need some Coulomb friction to slide at
_LEAST_COULOMB = 1e-9


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
            _parameter("stiffness", "sigma_0", "N/m", "bristles' stiffness", scale="ratio"),
            _parameter("micro_damping", "sigma_1", "N s/m", "bristles' damping", scale="ratio"),
            _parameter("viscous_plus", "b+", "N s/m", "viscous, forwards"),
            _parameter("viscous_minus", "b-", "N s/m", "viscous, backwards"),
            _parameter("coulomb_plus", "c+", "N", "Coulomb, forwards"),
            _parameter("coulomb_minus", "c-", "N", "Coulomb, backwards"),
            _parameter("spring", "k", "N/m", "spring or cable", scale="signed"),
        )
    }
)


#: the highest harmonic of a force over position
MOST_HARMONICS = 500


def parameter_named(name: str) -> Parameter:
    """Return the parameter of that name, a harmonic's or a drift's too: "sin_1", "cos_1", "drift_1"."""
    if name in PARAMETERS:
        return PARAMETERS[name]
    kind, _, number = name.partition("_")
    if kind == "drift":
        return _parameter(name, f"drift {number}", "N", "change of the constant force", scale="signed")
    symbol = {"sin": "S", "cos": "C"}[kind]
    return _parameter(name, f"{symbol}_{number}", "N", f"{kind}({number} w q)", scale="signed")


def unit_for(parameter: Parameter, axis_unit: str) -> str:
    """Return a parameter's unit for an axis of positions in "m" or "rad"."""
    if axis_unit == "m":
        return parameter.unit
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

    def laws(self, values: Values) -> tuple[Law, Law]:
        """Return the friction forwards and backwards."""
        if not self.symmetric:
            sides = (("viscous_plus", "coulomb_plus"), ("viscous_minus", "coulomb_minus"))
            plus, minus = (Classical(viscous=values[b], coulomb=values[c]) for b, c in sides)
            return plus, minus
        law = self._bristles(values) if "stiffness" in self.names else self._classical(values)
        return law, law

    @staticmethod
    def _classical(values: Values) -> Classical:
        return Classical(
            viscous=values["viscous"],
            coulomb=values.get("coulomb", 0.0),
            stribeck=values.get("stribeck", 0.0),
            stribeck_speed=values.get("stribeck_speed", 1.0),
            stribeck_exponent=1.0,
        )

    @staticmethod
    def _bristles(values: Values) -> LuGre:
        return LuGre(
            viscous=values["viscous"],
            coulomb=max(values["coulomb"], _LEAST_COULOMB),
            stribeck=values.get("stribeck", 0.0),
            stribeck_speed=values.get("stribeck_speed", 1.0),
            stribeck_exponent=1.0,
            stiffness=values["stiffness"],
            micro_damping=values.get("micro_damping", 0.0),
            may_drive=True,  # a search passes such values; its end is checked
        )


_COULOMB = ("mass", "viscous", "coulomb", "offset")

AXIS_LAWS: Mapping[str, AxisLaw] = MappingProxyType(
    {
        law.name: law
        for law in (
            AxisLaw(name="viscous", below=None, names=("mass", "viscous", "offset")),
            AxisLaw(name="coulomb", below="viscous", names=_COULOMB),
            AxisLaw(name="stribeck", below="coulomb", names=(*_COULOMB, "stribeck", "stribeck_speed")),
            AxisLaw(name="dahl", below="coulomb", names=(*_COULOMB, "stiffness")),
            AxisLaw(
                name="lugre",
                below="dahl",
                names=(*_COULOMB, "stiffness", "stribeck", "stribeck_speed", "micro_damping"),
            ),
            AxisLaw(
                name="asymmetric",
                below="coulomb",
                names=("mass", "viscous_plus", "coulomb_plus", "viscous_minus", "coulomb_minus"),
            ),
        )
    }
)


def axis_law_named(name: str) -> AxisLaw:
    """Return the law of that name; InputError if there is none."""
    if name not in AXIS_LAWS:
        raise InputError(f"There is no friction law {name!r}; the laws are {', '.join(AXIS_LAWS)}.")
    return AXIS_LAWS[name]


@inlined
def field_force(field, position):
    """Return G(q): `field` has a row (q_0, k, 0), then a row (w n, S_n, C_n) for each harmonic."""
    force = field[0, 1] * (position - field[0, 0])
    for i in range(1, len(field)):
        angle = field[i, 0] * position
        force += field[i, 1] * math.sin(angle) + field[i, 2] * math.cos(angle)
    return force


@compiled
def follow_windows(
    plus, minus, inertia, rest, field, firsts, counts, starts, forces, rises, durations, steps, positions
):
    """Move in windows under forces (N,), each row's acting for its duration (N,) [s] and rising by `rises` (N,).

    A window begins at row `firsts` with its `starts` (windows, 2), position and speed, and runs over `counts` rows;
    `positions` takes, one window after another, the position at each row's end.
    """
    state = rest.copy()
    place = 0
    for w in range(len(firsts)):
        position, speed = starts[w, 0], starts[w, 1]
        state[:] = rest
        # bristles of an axis that moves are bent already
        if speed > 0.0:
            settle(plus, state, speed, speed, 10.0)
        elif speed < 0.0:
            settle(minus, state, speed, speed, 10.0)
        for k in range(firsts[w], firsts[w] + counts[w]):
            part = durations[k] / steps
            for i in range(steps):
                force = forces[k] + rises[k] * (i + 0.5) / steps
                force -= field_force(field, position + 0.5 * part * speed)
                if speed > 0.0 or (speed == 0.0 and force > 0.0):
                    speed, travel = move(plus, inertia, force, state, speed, part)
                else:
                    speed, travel = move(minus, inertia, force, state, speed, part)
                position += travel
            positions[place] = position
            place += 1


@compiled
def follow_loop(
    plus,
    minus,
    inertia,
    state,
    field,
    start,
    acting,
    reference,
    added,
    gains,
    span,
    h,
    steps,
    positions,
    forces,
):
    """Move in closed loop along a reference (n,); `positions` and `forces` (n,) are those of each row.

    `added` (n,) are forces beside the loop's that `forces` contain, `acting` (n,) others; `gains` (4,) are k_p, k_v,
    force per input and the input's limit; `start` (2,) is the first position and speed.
    """
    part = h / steps
    position, speed = start[0], start[1]
    for k in range(len(reference)):
        positions[k] = position
        before = positions[k - span] if k >= span else start[0] + (k - span) * h * start[1]
        velocity = (position - before) / (span * h)
        u = gains[1] * (gains[0] * (reference[k] - position) - velocity)
        forces[k] = gains[2] * min(max(u, -gains[3]), gains[3]) + added[k]
        held = forces[k] + acting[k]
        for _ in range(steps):
            force = held - field_force(field, position + 0.5 * part * speed)
            if speed > 0.0 or (speed == 0.0 and force > 0.0):
                speed, travel = move(plus, inertia, force, state, speed, part)
            else:
                speed, travel = move(minus, inertia, force, state, speed, part)
            position += travel


#: explicit steps are at most this part of the axis's fastest time constant
_LARGEST_RATE_STEP = 0.5
#: and at most this part of the time constant of a force over position [rad]: an error of 1e-3 of its phase
_LARGEST_FIELD_STEP = 0.15
#: a sample; a search that tries a Stribeck speed near zero would ask for thousands, and such a law is Coulomb's
_MOST_STEPS = 50


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """What an axis does."""

    positions: NDArray[np.float64]  #: (n,) [m]
    forces: NDArray[np.float64]  #: (n,) [N]


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """A mass with friction, a constant force against it and forces that depend on position."""

    law: AxisLaw
    values: Values
    period: float = 2.0 * math.pi  #: of the first harmonic [m]

    def open_loop(
        self, forces: ArrayLike, *, position: float, speed: float, sample_time: float
    ) -> NDArray[np.float64]:
        """Return the positions (n,) after each of the forces (n,) held over a sample.

        Raises
        ------
        InputError
            If the forces are not a row of finite numbers, another number is not finite, or the sample time is not
            above zero.
        """
        acting = real_array(forces, ("n",), "The row of forces")
        sample_time = positive_number(sample_time, "The sample time")
        start = np.array([[real_number(position, "The position"), real_number(speed, "The speed")]])
        acting = acting - self.values.get("offset", 0.0)
        firsts, counts = np.zeros(1, dtype=np.int64), np.array([len(acting)])
        durations = np.full(len(acting), sample_time)
        return self._follow(
            firsts, counts, start, (acting, np.zeros(len(acting)), durations), sample_time, NO_LOAD
        )

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
        acting = self.acting(record)
        rises = np.append(np.diff(acting), 0.0) if interpolated else np.zeros(len(acting))
        longest = float(record.durations.max()) if record.even else GAP * record.sample_time
        return self._follow(
            firsts, counts, starts, (acting, rises, record.durations), longest, record.known_load
        )

    def acting(self, record: AxisRecord) -> NDArray[np.float64]:
        """Return the force (N,) on the axis: what is recorded, less the offset and its drift."""
        acting = record.force - self.values.get("offset", 0.0)
        drifts = [value for name, value in self.values.items() if name.startswith("drift_")]
        if not drifts:
            return acting
        return acting - drift_shapes(record, len(drifts)) @ np.array(drifts)

    def closed_loop(self, record: AxisRecord, *, speed: float) -> Trajectory:
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
        speed = real_number(speed, "The speed")
        (plus, minus), steps = self.law.laws(self.values), self._steps(record.sample_time, record.known_load)
        positions, forces = np.empty((2, len(record)))
        # a limit that is not finite is one that is never reached
        limit = loop.limit if math.isfinite(loop.limit) else np.finfo(float).max
        follow_loop(
            plus.numbers(),
            minus.numbers(),
            Driveline(inertia=self._mass(record.known_load), friction=plus).numbers(),
            plus.initial_state(record.sample_time / steps),
            self._field(record.known_load),
            np.array([float(record.position[0]), speed]),
            self.acting(record) - record.force,
            record.reference,
            np.zeros(len(record)) if record.added is None else record.added,
            np.array([loop.position_gain, loop.velocity_gain, loop.force_per_input, limit]),
            loop.span,
            record.sample_time,
            steps,
            positions,
            forces,
        )
        return Trajectory(positions=positions, forces=forces)

    def position_force(self, positions: ArrayLike, known: KnownLoad = NO_LOAD) -> NDArray[np.float64]:
        """Return G(q) at positions (...), the constant force not among it."""
        q = np.asarray(positions, dtype=np.float64)
        first, *harmonics = self._field(known)
        return first[1] * (q - first[0]) + sum(
            (s * np.sin(w * q) + c * np.cos(w * q) for w, s, c in harmonics), np.zeros(q.shape)
        )

    def needed_force(
        self,
        record: AxisRecord,
        position: NDArray[np.float64],
        speed: NDArray[np.float64],
        acceleration: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return the force (N,) that a motion (N,) needs on a record's load, drift and all."""
        plus, minus = self.law.laws(self.values)
        friction = np.where(speed >= 0.0, plus.steady_friction(speed), minus.steady_friction(speed))
        known = record.known_load
        offset = record.force - self.acting(record)
        return self._mass(known) * acceleration + friction + offset + self.position_force(position, known)

    def _follow(
        self,
        firsts: NDArray[np.int64],
        counts: NDArray[np.int64],
        starts: NDArray[np.float64],
        forces: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
        longest: float,
        known: KnownLoad,
    ) -> NDArray[np.float64]:
        """Return the positions of windows under forces, their rises and their durations of at most `longest` [s]."""
        (plus, minus), steps = self.law.laws(self.values), self._steps(longest, known)
        positions = np.empty(int(counts.sum()))
        follow_windows(
            plus.numbers(),
            minus.numbers(),
            Driveline(inertia=self._mass(known), friction=plus).numbers(),
            plus.initial_state(longest / steps),
            self._field(known),
            firsts,
            counts,
            starts,
            *forces,
            steps,
            positions,
        )
        return positions

    def _mass(self, known: KnownLoad) -> float:
        return self.values["mass"] + known.inertia

    def _field(self, known: KnownLoad) -> NDArray[np.float64]:
        """Return what `field_force` reads; a known load's weight is the first harmonic of a turn."""
        rows = [(0.0, self.values.get("spring", 0.0), 0.0)]
        for name in self.values:
            if name.startswith("sin_"):
                number = name.removeprefix("sin_")
                wave = 2.0 * math.pi * int(number) / self.period
                rows.append((wave, self.values[name], self.values[f"cos_{number}"]))
        if known.weight:
            at = known.hanging
            rows.append((1.0, known.weight * math.cos(at), -known.weight * math.sin(at)))
        return np.array(rows)

    def _steps(self, sample_time: float, known: KnownLoad) -> int:
        slope = max(law.explicit_slope() for law in self.law.laws(self.values))
        mass = self._mass(known)
        wanted = sample_time * slope / mass / _LARGEST_RATE_STEP
        first, *harmonics = self._field(known)
        stiffness = abs(first[1]) + sum(w * math.hypot(s, c) for w, s, c in harmonics)
        turning = sample_time * math.sqrt(stiffness / mass) / _LARGEST_FIELD_STEP
        return min(max(1, math.ceil(wanted), math.ceil(turning)), _MOST_STEPS)


def drift_shapes(record: AxisRecord, count: int) -> NDArray[np.float64]:
    """Return the shapes (N, count) of a drifting offset: straight lines between count + 1 even times, mean zero."""
    place = record.t / record.t[-1] * count
    shapes = np.maximum(1.0 - np.abs(place[:, None] - np.arange(1, count + 1)), 0.0)
    return shapes - shapes.mean(axis=0)
