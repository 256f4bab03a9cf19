"""One axis with friction: its parameters, friction laws and motion.

    M a = F - offset - G(q) - b v - (c + s exp(-|v/v_s|^delta) + mu W) sgn(v)    G(q) = S sin q + C cos q

G is gravity on an axis that turns. A difference of Coulomb friction between the directions is part of the offset. Dry
friction may grow with the load W = |F + G(q)| / 2 of the gears: M. Duclusaud et al., Extended friction models for the
physics simulation of servo actuators, arXiv 2410.08650 (2024), with mu twice theirs.

The motion is that of `ballbot.mechanics.driveline`, with the force held over a row or changing linearly to the
next, and G evaluated in the middle of each step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from ballbot.arrays import Floats, Ints
from ballbot.fitting.parameter import FitParameter, Limits, Scale
from ballbot.identification.quantities import BY_NAME
from ballbot.mechanics.driveline import UNLIMITED, Inertia, move
from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.mechanics.friction import Wheel, steady_friction
from ballbot.mechanics.parameters import wheels_of
from ballbot.robot import Friction

Values = Mapping[str, float]

#: bounds of the parameters, over the sizes that the largest force, speed and acceleration of a record imply
_REACH = 100.0
#: a driver, a bus and a filter take less [s]: no position loop of an axis would be stable with more
LONGEST_DELAY = 0.1
_LEAST: Mapping[Scale, float] = {"amount": 0.0, "ratio": 1.0 / _REACH, "signed": -_REACH}
#: of those without such a size
_BOUNDS: Mapping[str, Limits] = {
    "load": (0.0, 1.0),
    "delay": (-LONGEST_DELAY, LONGEST_DELAY),
    "stribeck_exponent": BY_NAME["stribeck_exponent"].bounds,
}
_ROWS: tuple[tuple[str, str, str, str, Scale], ...] = (
    ("mass", "M", "kg", "mass or inertia", "ratio"),
    ("viscous", "b", "N s/m", "viscous", "amount"),
    ("coulomb", "c", "N", "Coulomb", "amount"),
    ("offset", "offset", "N", "constant force", "signed"),
    ("stribeck", "s", "N", "break-away above Coulomb", "amount"),
    ("stribeck_speed", "v_s", "m/s", "Stribeck speed", "ratio"),
    ("stribeck_exponent", "delta", "1", "how sharply s fades", "ratio"),
    ("gravity_sine", "S", "N", "gravity, of sin q", "signed"),
    ("gravity_cosine", "C", "N", "gravity, of cos q", "signed"),
    ("load", "mu", "1", "Coulomb, as a share of the load", "amount"),
    ("delay", "delay", "s", "of the force behind its rows", "signed"),
)
#: by name; units are those of a sliding axis (see `unit_for`), and bounds those for a largest force, speed and
#: acceleration of 1
PARAMETERS: Mapping[str, FitParameter] = {
    name: FitParameter(
        name=name,
        symbol=symbol,
        unit=unit,
        scale=scale,
        bounds=_BOUNDS.get(name, (_LEAST[scale], _REACH)),
        default=1.0 if scale == "ratio" else 0.0,
        meaning=meaning,
    )
    for name, symbol, unit, meaning, scale in _ROWS
}


def unit_for(parameter: FitParameter, axis_unit: str) -> str:
    """Return a parameter's unit for positions in "m" or "rad"; empty for one without a unit."""
    turning = {"kg": "kg m^2", "N s/m": "N m s/rad", "N": "N m", "m/s": "rad/s", "1": "", "s": "s"}
    return parameter.unit.removeprefix("1") if axis_unit == "m" else turning[parameter.unit]


_COULOMB = ("mass", "viscous", "coulomb", "offset")
#: friction laws: the parameters of each, and the simpler law with which it is compared
LAWS: Mapping[str, tuple[tuple[str, ...], str]] = {
    "viscous": (("mass", "viscous", "offset"), ""),
    "coulomb": (_COULOMB, "viscous"),
    "stribeck": ((*_COULOMB, "stribeck", "stribeck_speed", "stribeck_exponent"), "coulomb"),
}
#: optional forces, and their parameters
FORCES: Mapping[str, tuple[str, ...]] = {
    "gravity": ("gravity_sine", "gravity_cosine"),
    "load": ("load",),
    "delay": ("delay",),
}


@dataclass(frozen=True, kw_only=True)
class AxisModel:
    """A law and forces, and which parameters are estimated."""

    law: str  #: one of `LAWS`
    forces: tuple[str, ...] = ()  #: those of `FORCES`
    interpolated: bool = False  #: whether the force changes linearly between rows; otherwise it is held
    known: Values = field(default_factory=dict)  #: values of parameters that are not estimated, by name
    held: tuple[str, ...] = ("stribeck_exponent",)  #: others that keep their defaults
    judge: Literal["position", "force"] = (
        "position"  #: of the fit: positions over windows, or the balance of forces
    )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the estimated parameters."""
        every = (*LAWS[self.law][0], *(name for force in self.forces for name in FORCES[force]))
        return tuple(name for name in every if name not in self.known)

    def error_unit(self, axis_unit: str) -> tuple[float, str]:
        """Return the unit in which errors of the fit are shown, and its factor."""
        return (1.0, "N" if axis_unit == "m" else "N m") if self.judge == "force" else (1e3, f"m{axis_unit}")

    def axis(self, values: Values) -> Axis:
        """Return the axis with these parameters and the known ones."""
        return Axis(values={**self.known, **values}, interpolated=self.interpolated)


class _AxisNumbers(NamedTuple):
    """The parameters of an axis as compiled code reads them."""

    wheel: Wheel  #: its friction, without load
    inertia: Inertia
    sine: float  #: S
    cosine: float  #: C
    mu: float


@inlined
def _step(axis, position, speed, force, h) -> tuple[float, float]:
    """Return position and speed after h [s] under a force, with gravity at half the step."""
    halfway = position + 0.5 * h * speed
    gravity = axis.sine * math.sin(halfway) + axis.cosine * math.cos(halfway)
    own = axis.wheel
    dry = own.c + 0.5 * axis.mu * abs(force + gravity)
    force -= gravity
    wheel = Wheel(own.axle, own.b, dry, own.s, own.terms, own.inv_vs, own.delta)
    speed, travel = move(wheel, axis.inertia, force, speed, h)
    return position + travel, speed


@compiled
def follow_windows(axis, firsts, counts, starts, forces, rises, h, steps, states):
    """Simulate windows, and write position and speed at each row's end to `states`, window after window.

    A window starts at row `firsts` in the state `starts` and has `counts` rows. The force in a row starts at `forces`
    (N,) [N] and rises linearly by `rises` (N,) [N] over h [s].
    """
    row = 0
    for w in range(len(firsts)):
        position, speed = starts[w, 0], starts[w, 1]
        for k in range(firsts[w], firsts[w] + counts[w]):
            for i in range(steps):
                force = forces[k] + rises[k] * (i + 0.5) / steps
                position, speed = _step(axis, position, speed, force, h / steps)
            states[row, 0], states[row, 1] = position, speed
            row += 1


#: longest explicit step, as a share of the fastest time constant
_LARGEST_RATE_STEP = 0.5
#: and as an angle of the oscillation under gravity [rad]: an error of 1e-3 of its phase
_LARGEST_GRAVITY_STEP = 0.15
#: steps in one row, at most
_MOST_STEPS = 50


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """A mass with friction, a constant force against it and gravity."""

    values: Values  #: by name; others have no effect
    interpolated: bool = False  #: whether the force changes linearly between rows

    @cached_property
    def _all(self) -> dict[str, float]:
        """The values of all parameters."""
        return {**{name: kind.default for name, kind in PARAMETERS.items()}, **self.values}

    @property
    def law(self) -> Friction:
        """The friction without load, as that of one wheel."""
        amounts = {name: (self._all[name],) for name in ("viscous", "coulomb", "stribeck")}
        shape = {name: self._all[name] for name in ("stribeck_speed", "stribeck_exponent")}
        return replace(Friction.none(1), **amounts, **shape)

    def windows(self, force: Floats, h: float, firsts: Ints, counts: Ints, starts: Floats) -> Floats:
        """Return position and speed (sum of counts, 2) at the ends of the rows, window after window.

        The force (N,) [N] is of rows that last h [s]. Each window has its first row (w,), its number of rows (w,), and
        its initial position and speed (w, 2).
        """
        values = self._all
        acting = force - values["offset"]
        rises = np.append(np.diff(acting), 0.0) if self.interpolated else np.zeros(len(acting))
        states = np.empty((int(counts.sum()), 2))
        (wheel,) = wheels_of(self.law)
        assert isinstance(wheel, Wheel)
        numbers = _AxisNumbers(
            wheel=wheel,
            inertia=Inertia(inv_J=1.0 / values["mass"], stall=UNLIMITED, inv_no_load=0.0),
            sine=values["gravity_sine"],
            cosine=values["gravity_cosine"],
            mu=values["load"],
        )
        follow_windows(numbers, firsts, counts, starts, acting, rises, h, self._steps(h), states)
        return states

    def friction(self, speed: Floats) -> Floats:
        """Return the friction without load [N] at speeds (N,)."""
        return steady_friction(speed, self.law)

    def other_forces(self, force: Floats, position: Floats, speed: Floats, acceleration: Floats) -> Floats:
        """Return the part of a force (N,) that is not `friction`: inertia, offset, G(q) and load."""
        values = self._all
        G = values["gravity_sine"] * np.sin(position) + values["gravity_cosine"] * np.cos(position)
        loaded = 0.5 * values["load"] * np.abs(force - values["offset"] + G) * np.sign(speed)
        return values["mass"] * acceleration + values["offset"] + G + loaded

    def _steps(self, row: float) -> int:
        """Return the number of steps in a row of `row` [s]."""
        values, mass = self._all, self._all["mass"]
        viscous, fading = values["viscous"], values["stribeck"] / values["stribeck_speed"]
        wanted = row * (viscous + fading) / mass / _LARGEST_RATE_STEP
        if wanted > _MOST_STEPS:
            # one step passes the Stribeck speed; the law is then Coulomb friction except at break-away
            wanted = row * viscous / mass / _LARGEST_RATE_STEP
        gravity = math.hypot(values["gravity_sine"], values["gravity_cosine"])
        turning = row * math.sqrt(gravity / mass) / _LARGEST_GRAVITY_STEP
        return min(max(1, math.ceil(wanted), math.ceil(turning)), _MOST_STEPS)
