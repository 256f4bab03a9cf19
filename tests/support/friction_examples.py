"""Friction laws and small rigs that the tests of friction share."""

import numpy as np

from ballbot.mechanics.engine.compiled import compiled
from ballbot.mechanics.friction_laws import Armstrong, Classical, Dahl, LuGre, Smoothed
from ballbot.mechanics.friction_laws.interface import UNLIMITED, Inertia, friction_of, move

#: Table I of Canudas de Wit et al. 1995; its friction can drive (Barabanov and Ortega 2000), hence the last word
PAPER_LUGRE = LuGre(
    viscous=0.4,
    coulomb=1.0,
    stribeck=0.5,
    stribeck_speed=0.001,
    stiffness=1e5,
    micro_damping=1e5**0.5,
    may_drive=True,
)

DRIVELINE = {"viscous": 0.014, "coulomb": 0.11}
STRIBECK = {"stribeck": 0.05, "stribeck_speed": 0.6}

#: one of each, of a driveline's size; units N m and rad
LAWS = {
    "classical": Classical(**DRIVELINE, **STRIBECK, stribeck_exponent=1.1),
    "armstrong": Armstrong(
        **DRIVELINE, **STRIBECK, stiffness=50.0, memory=0.003, rise_time=0.2, rest_damping=0.05
    ),
    "lugre": LuGre(**DRIVELINE, **STRIBECK, stiffness=50.0, micro_damping=0.02),
    "dahl": Dahl(**DRIVELINE, stiffness=50.0),
    "smoothed tanh": Smoothed(**DRIVELINE, **STRIBECK, width=0.01),
    "smoothed root": Smoothed(**DRIVELINE, **STRIBECK, width=0.01, sign="root"),
}


def mass_of(value: float) -> Inertia:
    """Return a mass or inertia without a speed limit, as compiled code reads it."""
    return Inertia(inv_J=1.0 / value, clamp=UNLIMITED, stall=UNLIMITED, inv_no_load=0.0)


@compiled
def pushed(law, mass, state, forces, h):
    """Return (steps, 3): speed, distance and friction after each step of held forces, from rest."""
    out = np.empty((len(forces), 3))
    speed = distance = 0.0
    for k in range(len(forces)):
        speed, travel = move(law, mass, forces[k], state, speed, h)
        distance += travel
        out[k, 0] = speed
        out[k, 1] = distance
        out[k, 2] = friction_of(law, state, speed, forces[k])
    return out


@compiled
def pulled(law, mass, state, spring, pull, h, steps):
    """Return (steps, 2): speed and distance of a mass pulled through a spring whose far end moves at `pull`."""
    out = np.empty((steps, 2))
    speed = distance = 0.0
    for k in range(steps):
        # the spring's force in the middle of the step, at the speed of its start: second order
        force = spring * (pull * (k + 0.5) * h - distance - 0.5 * h * speed)
        speed, travel = move(law, mass, force, state, speed, h)
        distance += travel
        out[k, 0], out[k, 1] = speed, distance
    return out


def push(law, forces: np.ndarray, h: float, mass: float = 1.0) -> np.ndarray:
    """Return (steps, 3): speed, distance and friction of a mass under held forces, from a long rest."""
    return pushed(law.numbers(), mass_of(mass), law.initial_state(h), np.asarray(forces, float), h)


def pull_by_spring(
    law, *, spring: float, speed: float, duration: float, h: float, mass: float = 1.0
) -> np.ndarray:
    """Return (steps, 2): speed and distance of a mass pulled through a spring."""
    steps = round(duration / h)
    return pulled(law.numbers(), mass_of(mass), law.initial_state(h), spring, speed, h, steps)
