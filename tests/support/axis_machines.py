"""Machines of one axis for campaigns: drawn at random, simulated apart from Ballbot, and recorded with faults.

The motion is an Euler step of the speed of 50 us, with the mean speed for the position, and Karnopp's rest (a force
below break-away at zero speed holds the axis), written here and sharing nothing with `ballbot.mechanics`. A position
controller moves each machine along a sum of sines, from point to point or at random; the record is that of a logger: a
coarse encoder, a noisy force, rows slower than the controller's or jittered.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numba
import numpy as np
import scipy
from numpy.typing import NDArray

from ballbot.identification.axis import AxisRecord, record_of_rows

#: simulation step [s]
STEP = 5e-5
Motion = Literal["sines", "points", "random"]


@dataclass(frozen=True, kw_only=True)
class Drive:
    """What is between the motor, with friction and encoder, and the part of the inertia that it drives."""

    share: float  #: of the inertia, behind the drive
    natural: float  #: frequency of the two inertias on the drive's stiffness [Hz]
    play: float = 0.0  #: to either side [rad]
    damping: float = 0.05  #: ratio


@dataclass(frozen=True, kw_only=True)
class Machine:
    """One axis; SI units, those of an axis that turns in brackets."""

    kind: str
    inertia: float  #: [kg m^2]
    viscous: float  #: [N m s/rad]
    coulomb: float  #: [N m]
    offset: float = 0.0  #: [N m]
    gravity: tuple[float, float] = (0.0, 0.0)  #: of sin q and cos q [N m]
    gears: float = 0.0  #: Coulomb friction over the load of its gears, the mean of both sides' forces
    #: None if it is rigid; one that yields goes with no load and no force that depends on position
    drive: Drive | None = None


@dataclass(frozen=True, kw_only=True)
class Logging:
    """How a machine is moved and recorded."""

    duration: float  #: [s]
    rate: float  #: rows a second [1/s]
    held: bool = True  #: whether the controller runs at that rate and holds its force; at 1 kHz otherwise
    amplitude: float = 1.0  #: of the reference [rad]
    slowest: float = 0.1  #: its frequencies [Hz]
    fastest: float = 0.8
    counts: float = 0.0  #: of the encoder in a turn (a metre); none if zero
    force_noise: float = 0.0  #: standard deviation [N m]
    jitter: float = 0.0  #: of the rows' times, as a share of the interval
    motion: Motion = "sines"


@numba.njit(cache=True)
def _simulate(numbers, gravity, gears, drive, reference, rates, gains, every, start):
    """Return position, speed, force and time of each controller step; `every` simulation steps are one."""
    inertia, b, c, offset = numbers
    driven, stiffness, damping, play = drive
    inertia -= driven
    rows = len(reference)
    out = np.empty((rows, 3))
    q, w = start, 0.0
    behind, its_speed = start, 0.0
    for k in range(rows):
        u = gains[0] * (reference[k] - q) + gains[1] * (rates[k] - w)
        out[k, 0], out[k, 1], out[k, 2] = q, w, u
        for _ in range(every):
            load = gravity[0] * math.sin(q) + gravity[1] * math.cos(q)
            acting = u - offset
            if driven > 0.0:
                twist = q - behind
                load = 0.0
                if abs(twist) > play:
                    load = stiffness * (twist - math.copysign(play, twist)) + damping * (w - its_speed)
                    if load * twist < 0.0:  # it pushes, and does not pull
                        load = 0.0
                faster = its_speed + STEP * load / driven
                behind += 0.5 * STEP * (its_speed + faster)
                its_speed = faster
            net = acting - load
            dry = c + 0.5 * gears * abs(acting + load)
            if w == 0.0 and abs(net) <= dry:
                continue
            way = math.copysign(1.0, w if w != 0.0 else net)
            faster = w + STEP * (net - b * w - dry * way) / inertia
            if w != 0.0 and faster * w < 0.0:
                faster = 0.0
            q += 0.5 * STEP * (w + faster)
            w = faster
    return out


def _sines(
    t: NDArray[np.float64], logging: Logging, random: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a sum of six sines and its rate."""
    frequencies = np.geomspace(logging.slowest, logging.fastest, 6) * random.uniform(0.9, 1.1, 6)
    phases = random.uniform(0.0, 2.0 * np.pi, 6)
    sizes = logging.amplitude * random.uniform(0.5, 1.0, 6) / 3.0
    angles = 2.0 * np.pi * np.outer(t, frequencies) + phases
    return np.sin(angles) @ sizes, np.cos(angles) @ (sizes * 2.0 * np.pi * frequencies)


def _points(
    t: NDArray[np.float64], logging: Logging, random: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return moves of 0.5 to 1 s between random points, each a polynomial of fifth order, with rests, and the rate."""
    reference, rate = np.zeros((2, len(t)))
    now, begin = 0.0, 0.2
    while begin < t[-1]:
        target = random.uniform(-logging.amplitude, logging.amplitude)
        if abs(target - now) < 0.5 * logging.amplitude:
            continue
        lasts = random.uniform(0.5, 1.0)
        s = np.clip((t - begin) / lasts, 0.0, 1.0)
        reference += (target - now) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        rate += (target - now) * 30.0 * s**2 * (1.0 - s) ** 2 / lasts
        now, begin = target, begin + lasts + random.uniform(0.1, 0.4)
    return reference, rate


def _at_random(
    t: NDArray[np.float64], logging: Logging, random: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return noise below the fastest frequency, and its rate."""
    b, a = np.asarray(scipy.signal.butter(3, 2.0 * logging.fastest * (t[1] - t[0])))
    settling = round(2.0 / logging.fastest / (t[1] - t[0]))
    noise = scipy.signal.lfilter(b, a, random.standard_normal(len(t) + settling))[settling:]
    reference = 0.5 * logging.amplitude * noise / np.std(noise)
    return reference, np.gradient(reference, t[1] - t[0])


_MOTIONS = {"sines": _sines, "points": _points, "random": _at_random}


def record_of(machine: Machine, logging: Logging, seed: int, name: str = "machine") -> AxisRecord:
    """Return the record of a machine that follows a random motion."""
    random = np.random.default_rng(seed)
    control = logging.rate if logging.held else 1000.0
    every = max(1, round(1.0 / control / STEP))
    rows = round(logging.duration * control)
    t = np.arange(rows, dtype=np.float64) * (every * STEP)
    reference, rates = _MOTIONS[logging.motion](t, logging, random)
    inertia = machine.inertia
    # as fast as a loop of that rate can be with some margin
    natural = min(2.0 * np.pi * 6.0, 0.12 * control)
    numbers = np.array([inertia, machine.viscous, machine.coulomb, machine.offset])
    out = _simulate(
        numbers,
        np.array(machine.gravity),
        machine.gears,
        _drive_numbers(machine),
        reference,
        rates,
        np.array([inertia * natural**2, 1.4 * inertia * natural]),
        every,
        float(reference[0]),
    )
    return _logged(machine, logging, out, t, random, name)


def _drive_numbers(machine: Machine) -> NDArray[np.float64]:
    """Return the driven inertia, stiffness, damping and play of a machine's drive; zeros of a rigid one."""
    if machine.drive is None:
        return np.zeros(4)
    drive = machine.drive
    driven = drive.share * machine.inertia
    reduced = driven * (1.0 - drive.share)
    stiffness = reduced * (2.0 * np.pi * drive.natural) ** 2
    return np.array([driven, stiffness, 2.0 * drive.damping * math.sqrt(stiffness * reduced), drive.play])


def _logged(
    machine: Machine,
    logging: Logging,
    out: NDArray[np.float64],
    t: NDArray[np.float64],
    random: np.random.Generator,
    name: str,
) -> AxisRecord:
    """Return the record of a logger, from rows (position, speed, force) at times t."""
    steps = np.arange(round(logging.duration * logging.rate)) / logging.rate
    if logging.jitter:
        steps = steps + logging.jitter / logging.rate * random.uniform(-0.5, 0.5, len(steps))
    rows = np.clip(np.round(steps / (t[1] - t[0])).astype(int), 0, len(t) - 1)
    rows = np.unique(rows)
    position, _, force = out[rows].T.copy()
    turn = 2.0 * np.pi if machine.kind != "cart" else 1.0
    if logging.counts:
        position = np.floor(position * logging.counts / turn) * turn / logging.counts
    times = t[rows]
    force = force + logging.force_noise * random.standard_normal(len(force))
    unit = "m" if machine.kind == "cart" else "rad"
    return record_of_rows(name, times, force, position, unit=unit)
