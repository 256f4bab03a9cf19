"""One axis as a model: its parameters, the friction laws tried, and its motion.

The nested friction laws of one axis.

    viscous       M, b, offset
    coulomb       and c                                    tau = b v + c sgn(v)
    stribeck      and s, v_s                               and s exp(-|v/v_s|) sgn(v)
    dahl          coulomb and sigma_0                      bristles that bend before they slide
    lugre         dahl and s, v_s, sigma_1                 (Canudas de Wit 1995)
    asymmetric    coulomb with b, c of either direction    of which offset and c+ - c- are one while it slides

The laws are those of `ballbot.mechanics.friction_laws`; Dahl's is LuGre's without s and sigma_1.

The compiled loops of `ballbot.identification.axis.model`: an axis under recorded forces, and in its loop.

Two laws of one kind, one for each direction. Within the one step in which the direction changes, the law is that of
its start; with steps of a sample or less this is far below what a record can show.

An axis with a friction law, moved by forces or by its loop.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array, real_number
from ballbot.errors import InputError
from ballbot.fitting.parameter import Parameter, RelativeSpace, Scale
from ballbot.identification.axis.record import AxisRecord
from ballbot.mechanics.engine.compiled import compiled
from ballbot.mechanics.friction_laws.classical import Classical
from ballbot.mechanics.friction_laws.interface import move
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
        )
    }
)


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


def space_about(law: AxisLaw, start: Values) -> RelativeSpace:
    """Return a law's parameters, scaled by their values at `start`."""
    return RelativeSpace(
        parameters=tuple(replace(PARAMETERS[name], default=float(start[name])) for name in law.names)
    )


def values_of(law: AxisLaw, parameters: NDArray[np.float64]) -> dict[str, float]:
    """Return a law's parameters (p,) by name."""
    return dict(zip(law.names, parameters.tolist(), strict=True))


@compiled
def follow_forces(plus, minus, inertia, state, position, speed, forces, h, steps, positions):
    """Move under forces (n,) held over samples; `positions` (n,) takes the position after each."""
    part = h / steps
    for k in range(len(forces)):
        force = forces[k]
        for _ in range(steps):
            if speed > 0.0 or (speed == 0.0 and force > 0.0):
                speed, travel = move(plus, inertia, force, state, speed, part)
            else:
                speed, travel = move(minus, inertia, force, state, speed, part)
            position += travel
        positions[k] = position


@compiled
def follow_loop(
    plus,
    minus,
    inertia,
    state,
    position,
    speed,
    offset,
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

    `added` (n,) are forces beside the loop's; `gains` (4,) are k_p, k_v, force per input and the input's limit.
    """
    part = h / steps
    started, start_speed = position, speed
    for k in range(len(reference)):
        positions[k] = position
        before = positions[k - span] if k >= span else started + (k - span) * h * start_speed
        velocity = (position - before) / (span * h)
        u = gains[1] * (gains[0] * (reference[k] - position) - velocity)
        forces[k] = gains[2] * min(max(u, -gains[3]), gains[3]) + added[k]
        force = forces[k] - offset
        for _ in range(steps):
            if speed > 0.0 or (speed == 0.0 and force > 0.0):
                speed, travel = move(plus, inertia, force, state, speed, part)
            else:
                speed, travel = move(minus, inertia, force, state, speed, part)
            position += travel


#: explicit steps are at most this part of the axis's fastest time constant
_LARGEST_RATE_STEP = 0.5
_MOST_STEPS = 1000  # a sample


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """What an axis does."""

    positions: NDArray[np.float64]  #: (n,) [m]
    forces: NDArray[np.float64]  #: (n,) [N]


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """A mass with friction and a constant force against it."""

    law: AxisLaw
    values: Values

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
        position, speed = real_number(position, "The position"), real_number(speed, "The speed")
        (plus, minus), steps = self.law.laws(self.values), self._steps(sample_time)
        positions = np.empty(len(acting))
        follow_forces(
            plus.numbers(),
            minus.numbers(),
            Driveline(inertia=self.values["mass"], friction=plus).numbers(),
            plus.initial_state(sample_time / steps),
            position,
            speed,
            acting - self._offset,
            sample_time,
            steps,
            positions,
        )
        return positions

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
        (plus, minus), steps = self.law.laws(self.values), self._steps(record.sample_time)
        positions, forces = np.empty((2, len(record)))
        # a limit that is not finite is one that is never reached
        limit = loop.limit if math.isfinite(loop.limit) else np.finfo(float).max
        follow_loop(
            plus.numbers(),
            minus.numbers(),
            Driveline(inertia=self.values["mass"], friction=plus).numbers(),
            plus.initial_state(record.sample_time / steps),
            float(record.position[0]),
            speed,
            self._offset,
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

    @property
    def _offset(self) -> float:
        return self.values.get("offset", 0.0)

    def _steps(self, sample_time: float) -> int:
        slope = max(law.explicit_slope() for law in self.law.laws(self.values))
        wanted = sample_time * slope / self.values["mass"] / _LARGEST_RATE_STEP
        return min(max(1, math.ceil(wanted)), _MOST_STEPS)
