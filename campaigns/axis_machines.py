"""Machines of one axis for campaigns: drawn at random, simulated apart from Ballbot, and recorded with faults.

The motion is an Euler step of the speed of 50 us, with the mean speed for the position, and Karnopp's rest (a force
below break-away at zero speed holds the axis), written here and sharing nothing with `ballbot.mechanics`. A position
controller moves each machine along a sum of sines, from point to point or at random; the record is that of a logger: a
coarse encoder, a noisy force, late, lost or jittered rows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

import numba
import numpy as np
import scipy
from numpy.typing import NDArray

from ballbot.identification.axis import AxisRecord

#: records last no longer [s]
LONGEST = 15.0
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
    stribeck: float = 0.0  #: break-away above Coulomb [N m]
    stribeck_speed: float = 0.1  #: [rad/s]
    offset: float = 0.0  #: [N m]
    gravity: tuple[float, float] = (0.0, 0.0)  #: of sin q and cos q [N m]
    cogging: tuple[int, float, float] = (0, 0.0, 0.0)  #: harmonic, of its sine and cosine [N m]
    spring: float = 0.0  #: [N m/rad]
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
    missing: float = 0.0  #: share of rows lost
    drift: float = 0.0  #: change of the offset over the record, as a share of Coulomb friction
    warming: float = 0.0  #: share by which friction falls over the record
    velocity_only: bool = False
    motion: Motion = "sines"


@numba.njit(cache=True)
def _simulate(
    numbers, gravity, cogging, gears, drive, reference, rates, gains, every, limit, drift, warming, start
):
    """Return position, speed, force and time of each controller step; `every` simulation steps are one."""
    inertia, b, c, s, v_s, offset, spring = numbers
    driven, stiffness, damping, play = drive
    inertia -= driven
    rows = len(reference)
    out = np.empty((rows, 3))
    q, w = start, 0.0
    behind, its_speed = start, 0.0
    for k in range(rows):
        share = k / rows
        u = gains[0] * (reference[k] - q) + gains[1] * (rates[k] - w)
        u = min(max(u, -limit), limit)
        out[k, 0], out[k, 1], out[k, 2] = q, w, u
        friction = 1.0 - warming * (share - 0.5)
        for _ in range(every):
            load = gravity[0] * math.sin(q) + gravity[1] * math.cos(q) + spring * q
            load += cogging[1] * math.sin(cogging[0] * q) + cogging[2] * math.cos(cogging[0] * q)
            acting = u - offset - drift * (share - 0.5)
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
            if w == 0.0 and abs(net) <= friction * (dry + s):
                continue
            way = math.copysign(1.0, w if w != 0.0 else net)
            level = dry + s * math.exp(-((w / v_s) ** 2))
            faster = w + STEP * (net - friction * (b * w + level * way)) / inertia
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
    numbers = np.array(
        [
            inertia,
            machine.viscous,
            machine.coulomb,
            machine.stribeck,
            machine.stribeck_speed,
            machine.offset,
            machine.spring,
        ]
    )
    out = _simulate(
        numbers,
        np.array(machine.gravity),
        np.array(machine.cogging, dtype=np.float64),
        machine.gears,
        _drive_numbers(machine),
        reference,
        rates,
        np.array([inertia * natural**2, 1.4 * inertia * natural]),
        every,
        1e9,
        logging.drift * machine.coulomb,
        logging.warming,
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
    if logging.missing:
        kept = random.random(len(rows)) > logging.missing
        lost = rows[len(rows) // 3]
        rows = rows[kept & ((rows < lost) | (rows > lost + 0.3 / (t[1] - t[0])))]
    position, speed, force = out[rows].T.copy()
    turn = 2.0 * np.pi if machine.kind != "cart" else 1.0
    if logging.counts:
        position = np.floor(position * logging.counts / turn) * turn / logging.counts
    times = t[rows]
    if logging.velocity_only:
        speed = speed + 0.01 * np.std(speed) * random.standard_normal(len(speed))
        position = np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(times)))
    force = force + logging.force_noise * random.standard_normal(len(force))
    even = np.ptp(np.diff(times)) < 1e-9
    return AxisRecord(
        name=name,
        sample_time=float(np.median(np.diff(times))),
        force=force,
        position=position,
        unit="m" if machine.kind == "cart" else "rad",
        times=None if even else times,
    )


def _pendulum(random: np.random.Generator) -> tuple[Machine, Logging]:
    """A servo that lifts a rod with a weight."""
    arm, mass = random.uniform(0.08, 0.2), random.uniform(0.2, 1.0)
    weight = 9.81 * mass * arm
    machine = Machine(
        kind="pendulum",
        inertia=random.uniform(1.1, 1.6) * mass * arm**2,
        viscous=weight * random.uniform(0.01, 0.06),
        coulomb=weight * random.uniform(0.03, 0.2),
        gravity=(weight * random.uniform(1.02, 1.1), 0.0),
    )
    logging = Logging(
        duration=random.uniform(10.0, 30.0),
        rate=200.0,
        amplitude=random.uniform(0.6, 1.5),
        fastest=1.0,
        counts=4096.0,
        force_noise=0.01 * weight,
    )
    return machine, logging


def _arm(random: np.random.Generator) -> tuple[Machine, Logging]:
    """A joint of an industrial arm, logged more slowly than it is controlled."""
    inertia = 10.0 ** random.uniform(-0.5, 1.0)
    dry = inertia * random.uniform(1.0, 4.0)
    machine = Machine(
        kind="arm",
        inertia=inertia,
        viscous=dry * random.uniform(0.3, 1.5),
        coulomb=dry,
        stribeck=dry * random.uniform(0.0, 0.15),
        stribeck_speed=0.05,
        offset=dry * random.uniform(-0.2, 0.2),
        gravity=(dry * random.uniform(0.5, 4.0), dry * random.uniform(-1.0, 1.0)),
    )
    logging = Logging(
        duration=random.uniform(20.0, 60.0),
        rate=random.choice([50.0, 100.0, 200.0]),
        held=False,
        amplitude=random.uniform(0.5, 1.2),
        slowest=0.05,
        fastest=0.5,
        counts=200_000.0,
        force_noise=0.03 * dry,
    )
    return machine, logging


def _motor(random: np.random.Generator) -> tuple[Machine, Logging]:
    """A quadruped's geared motor: cogging, a coarse encoder, a noisy current."""
    inertia = 10.0 ** random.uniform(-2.3, -1.3)
    dry = inertia * random.uniform(5.0, 25.0)
    cogs = random.choice([12, 14, 20, 21])
    phase, size = random.uniform(0.0, 2.0 * np.pi), dry * random.uniform(0.1, 0.4)
    machine = Machine(
        kind="motor",
        inertia=inertia,
        viscous=dry * random.uniform(0.02, 0.15),
        coulomb=dry,
        stribeck=dry * random.uniform(0.0, 0.2),
        stribeck_speed=0.3,
        cogging=(int(cogs), size * np.sin(phase), size * np.cos(phase)),
    )
    logging = Logging(
        duration=random.uniform(8.0, 30.0),
        rate=random.choice([200.0, 500.0]),
        amplitude=random.uniform(1.0, 3.0),
        slowest=0.2,
        fastest=2.0,
        counts=16384.0,
        force_noise=0.1 * dry,
    )
    return machine, logging


def _cart(random: np.random.Generator) -> tuple[Machine, Logging]:
    """A cart on a rail that drags a cable."""
    mass = 10.0 ** random.uniform(0.0, 1.3)
    dry = mass * random.uniform(0.3, 1.5)
    machine = Machine(
        kind="cart",
        inertia=mass,
        viscous=dry * random.uniform(0.5, 3.0),
        coulomb=dry,
        offset=dry * random.uniform(-0.3, 0.3),
        spring=dry * random.uniform(0.0, 1.5),
    )
    logging = Logging(
        duration=random.uniform(15.0, 40.0),
        rate=random.choice([50.0, 100.0, 200.0]),
        amplitude=random.uniform(0.2, 0.5),
        slowest=0.1,
        fastest=1.0,
        counts=20_000.0,
        force_noise=0.05 * dry,
    )
    return machine, logging


def _servo(random: np.random.Generator) -> tuple[Machine, Logging]:
    """A pendulum whose gears rub more under load."""
    machine, logging = _pendulum(random)
    return replace(machine, kind="servo", gears=random.uniform(0.05, 0.2)), logging


MACHINES = MappingProxyType(
    {"pendulum": _pendulum, "arm": _arm, "motor": _motor, "cart": _cart, "servo": _servo}
)
#: by the name of a fault, the fields of `Logging` that it changes
FAULTS: Mapping[str, Mapping[str, float | bool]] = MappingProxyType(
    {
        "as it is": {},
        "jitter": {"jitter": 0.4},
        "lost rows": {"missing": 0.05},
        "drift": {"drift": 0.6},
        "warming": {"warming": 0.3},
        "short": {"duration": 8.0},
        "velocity only": {"velocity_only": True},
    }
)


def draw(kind: str, fault: str, seed: int) -> tuple[Machine, Logging]:
    """Return a random machine of a kind, and how it is logged with a fault."""
    machine, logging = MACHINES[kind](np.random.default_rng([seed, *kind.encode()]))
    logging = replace(logging, duration=min(logging.duration, LONGEST))
    return machine, replace(logging, **FAULTS[fault])
