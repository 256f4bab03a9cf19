"""The motion of one axis under its friction and forces that depend on position.

Forces that depend on position: G(q) = k q + sum_n (S_n sin(w n q) + C_n cos(w n q)), with w = 2 pi / period, and a
period of one turn unless another is given. n = 1 is gravity on an axis that turns; higher ones are cogging and gear
errors; k is a cable or a spring. A load of known mass adds its own inertia and weight (`KnownLoad`).

The motion is that of `ballbot.mechanics.friction_laws.interface.move`, the force held over a sample or interpolated, G
taken in the middle of each step. Two laws of one kind, one for each direction: within the one step in which the
direction changes, the law is that of its start; with steps of a sample or less the error is far below the resolution of
a record.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array, real_number
from ballbot.errors import InputError
from ballbot.identification.axis.laws import LEAST_COULOMB, AxisLaw, Values
from ballbot.identification.axis.load import (
    Load,
    LoadNumbers,
    force_with_load_friction,
    load_numbers,
    loaded,
    recorded_load,
)
from ballbot.identification.axis.motion import bent_bristles
from ballbot.identification.axis.record import GAP, NO_LOAD, AxisRecord, KnownLoad
from ballbot.mechanics.engine.arrays import fill
from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.mechanics.friction_laws.interface import move, settle
from ballbot.simulation.driveline import Driveline

#: so long that bristles are bent fully [s]
_LONG = 1e4


@inlined
def field_force(field, position):
    """Return G(q): `field` has a row (q_0, k, 0), then a row (w n, S_n, C_n) for each harmonic."""
    force = field[0, 1] * (position - field[0, 0])
    for i in range(1, len(field)):
        angle = field[i, 0] * position
        force += field[i, 1] * math.sin(angle) + field[i, 2] * math.cos(angle)
    return force


class _Numbers(NamedTuple):
    """An axis as compiled code reads it."""

    plus: NamedTuple  #: the friction law forwards
    minus: NamedTuple  #: the friction law backwards
    inertia: NamedTuple
    rest: NDArray[np.float64]  #: the laws' state at rest
    field: NDArray[np.float64]  #: see `field_force`
    load: LoadNumbers  #: on which friction depends


class _Windows(NamedTuple):
    """Windows of a record's rows: each begins at a row, in a state there, and runs over some rows."""

    firsts: NDArray[np.int64]  #: (windows,)
    counts: NDArray[np.int64]  #: (windows,) rows
    #: (windows, 3) position [m], speed [m/s], and how far bristles are bent, from -1 to 1
    starts: NDArray[np.float64]


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
    loads: NDArray[np.float64]  #: (n,) recorded, as in `_Drive`


@inlined
def _load_friction(axis, force, field, recorded):
    """Return the Coulomb friction [N] that the load adds."""
    load = axis.load
    return load.mu * abs(load.of_force * force + load.of_field * field + recorded)


@inlined
def _step(axis, state, position, speed, force, recorded, h) -> tuple[float, float]:
    """Return position and speed after h [s] under a force, less that of the position halfway, and a recorded load."""
    field = field_force(axis.field, position + 0.5 * h * speed)
    more = _load_friction(axis, force, field, recorded)
    force -= field
    if speed > 0.0 or (speed == 0.0 and force > 0.0):
        speed, travel = move(loaded(axis.plus, more), axis.inertia, force, state, speed, h)
    else:
        speed, travel = move(loaded(axis.minus, more), axis.inertia, force, state, speed, h)
    return position + travel, speed


@compiled
def follow_windows(axis, windows, drive, steps, positions):
    """Move in windows under a drive; `positions` takes, one window after another, the position at each row's end."""
    state = axis.rest.copy()
    place = 0
    for w in range(len(windows.firsts)):
        position, speed, bent = windows.starts[w, 0], windows.starts[w, 1], windows.starts[w, 2]
        fill(state, axis.rest)
        first = windows.firsts[w]
        field = field_force(axis.field, position)
        more = _load_friction(axis, drive.forces[first], field, drive.loads[first])
        if bent > 0.0:
            settle(loaded(axis.plus, more), state, abs(speed), abs(speed), _LONG)
        elif bent < 0.0:
            settle(loaded(axis.minus, more), state, -abs(speed), -abs(speed), _LONG)
        for i in range(len(state)):
            state[i] *= abs(bent)
        for k in range(first, first + windows.counts[w]):
            part = drive.durations[k] / steps
            for i in range(steps):
                force = drive.forces[k] + drive.rises[k] * (i + 0.5) / steps
                position, speed = _step(axis, state, position, speed, force, drive.loads[k], part)
            positions[place] = position
            place += 1


@compiled
def follow_loop(axis, loop, start, steps, positions, forces):
    """Move in closed loop from a position and speed (2,); `positions` and `forces` (n,) are those of each row."""
    state = axis.rest.copy()
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
#: steps of the simulation in one sample, at most
_MOST_STEPS = 50


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """A simulated motion of an axis."""

    positions: NDArray[np.float64]  #: (n,) [m]
    forces: NDArray[np.float64]  #: (n,) [N]


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """A mass with friction, a constant force against it and forces that depend on position."""

    law: AxisLaw
    values: Values
    period: float = 2.0 * math.pi  #: of the first harmonic [m]
    load: Load | None = None  #: on which dry friction depends

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
        begin, speed = real_number(position, "The position"), real_number(speed, "The speed")
        start = np.array([[begin, speed, np.sign(speed)]])
        count = len(acting)
        drive = _Drive(
            forces=acting - self.values.get("offset", 0.0),
            rises=np.zeros(count),
            durations=np.full(count, sample_time),
            loads=np.zeros(count),
        )
        whole = _Windows(firsts=np.zeros(1, dtype=np.int64), counts=np.array([count]), starts=start)
        return self._follow(whole, drive, sample_time, NO_LOAD)

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
        starts : ndarray (w, 3)
            Position, speed, and how far bristles are bent (see `bends`) at each first row.
        interpolated : bool
            Whether the force changes evenly from row to row; it is held by default.
        """
        acting = self.acting(record)
        rises = np.append(np.diff(acting), 0.0) if interpolated else np.zeros(len(acting))
        longest = float(record.durations.max()) if record.even else GAP * record.sample_time
        return self._follow(
            _Windows(firsts=firsts, counts=counts, starts=starts),
            _Drive(
                forces=acting,
                rises=rises,
                durations=record.durations,
                loads=recorded_load(self.load, record),
            ),
            longest,
            record.known_load,
        )

    def bends(self, position: NDArray[np.float64], speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far bristles are bent in a motion (N,), from -1 to 1; the speed's sign for a law without them."""
        if "stiffness" not in self.law.names:
            return np.sign(speed)
        return bent_bristles(position, max(self.values["coulomb"], LEAST_COULOMB) / self.values["stiffness"])

    def acting(self, record: AxisRecord) -> NDArray[np.float64]:
        """Return the force (N,) on the axis: the recorded force less the offset and its drift."""
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
        known = record.known_load
        steps = self._steps(record.sample_time, known)
        positions, forces = np.empty((2, len(record)))
        # a limit that is not finite is one that is never reached
        limit = loop.limit if math.isfinite(loop.limit) else np.finfo(float).max
        driven = _Loop(
            gains=(loop.position_gain, loop.velocity_gain, loop.force_per_input, limit),
            span=loop.span,
            h=record.sample_time,
            reference=record.reference,
            added=np.zeros(len(record)) if record.added is None else record.added,
            acting=self.acting(record) - record.force,
            loads=recorded_load(self.load, record),
        )
        start = np.array([float(record.position[0]), speed])
        follow_loop(self._numbers(record.sample_time / steps, known), driven, start, steps, positions, forces)
        return Trajectory(positions=positions, forces=forces)

    def position_force(self, positions: ArrayLike, known: KnownLoad = NO_LOAD) -> NDArray[np.float64]:
        """Return G(q) at positions (...), without the constant force."""
        q = np.asarray(positions, dtype=np.float64)
        first, *harmonics = self._field(known)
        return first[1] * (q - first[0]) + sum(
            (s * np.sin(w * q) + c * np.cos(w * q) for w, s, c in harmonics), np.zeros(q.shape)
        )

    def loading_force(
        self, record: AxisRecord, position: NDArray[np.float64], acceleration: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the force (N,) that a motion (N,) needs on a record's load without friction and offset."""
        known = record.known_load
        return self._mass(known) * acceleration + self.position_force(position, known)

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
        sign = np.sign(speed)
        if "stiffness" in self.law.names:
            sliding = friction - self.values["viscous"] * speed
            bends = self.bends(position, speed)
            friction += (sign * bends - 1.0) * sliding
            sign = np.abs(sign) * bends
        known = record.known_load
        needed = self.loading_force(record, position, acceleration) + friction
        if self.load:
            mu, recorded = self.values["load"], recorded_load(self.load, record)
            needed = force_with_load_friction(
                self.load, mu, needed, self.position_force(position, known), recorded, sign
            )
        return needed + record.force - self.acting(record)

    def _follow(
        self, windows: _Windows, drive: _Drive, longest: float, known: KnownLoad
    ) -> NDArray[np.float64]:
        """Return the positions of windows under a drive whose rows last at most `longest` [s]."""
        steps = self._steps(longest, known)
        positions = np.empty(int(windows.counts.sum()))
        follow_windows(self._numbers(longest / steps, known), windows, drive, steps, positions)
        return positions

    def _numbers(self, step: float, known: KnownLoad) -> _Numbers:
        """Return the axis as compiled code reads it, for time steps of `step` [s]."""
        plus, minus = self.law.laws(self.values)
        return _Numbers(
            plus=plus.numbers(),
            minus=minus.numbers(),
            inertia=Driveline(inertia=self._mass(known), friction=plus).numbers(),
            rest=plus.initial_state(step),
            field=self._field(known),
            load=load_numbers(self.load, self.values.get("load", 0.0)),
        )

    def _mass(self, known: KnownLoad) -> float:
        return self.values["mass"] + known.inertia

    def _field(self, known: KnownLoad) -> NDArray[np.float64]:
        """Return the rows of `field_force`; a known load's weight is the first harmonic of a turn."""
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
        if wanted > _MOST_STEPS and "stiffness" not in self.law.names:
            # a Stribeck speed that one step passes: the law is Coulomb's but for its break-away
            wanted *= max(law.viscous for law in self.law.laws(self.values)) / slope
        first, *harmonics = self._field(known)
        stiffness = abs(first[1]) + sum(w * math.hypot(s, c) for w, s, c in harmonics)
        turning = sample_time * math.sqrt(stiffness / mass) / _LARGEST_FIELD_STEP
        return min(max(1, math.ceil(wanted), math.ceil(turning)), _MOST_STEPS)


def drift_shapes(record: AxisRecord, count: int) -> NDArray[np.float64]:
    """Return the shapes (N, count) of a drifting offset: straight lines between count + 1 even times, mean zero."""
    place = record.t / record.t[-1] * count
    shapes = np.maximum(1.0 - np.abs(place[:, None] - np.arange(1, count + 1)), 0.0)
    return shapes - shapes.mean(axis=0)
