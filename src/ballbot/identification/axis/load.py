"""Dry friction that grows with the load of an axis's drive, as that of loaded gears and bearings does.

    friction(v) and mu W sgn(v)

The load W is one of these, each for any of the friction laws:

    position       |G(q)|            the forces over position, with the weight of a known load
    drive          |F|               the drive's force, without the offset
    transmitted    |F + G(q)| / 2    their mean, as what gears transmit is between what enters and what leaves them
    recorded       |W(t)|            a column of the record

The first is that of A. C. Bittencourt and S. Gunnarsson, Static friction in a robot joint, Journal of Dynamic Systems,
Measurement, and Control 134 (2012) 051013; the second that of a robot's wheels (`ballbot.mechanics.friction`); the
third that of M. Duclusaud, G. Passault, V. Padois and O. Ly, Extended friction models for the physics simulation of
servo actuators, arXiv 2410.08650 (2024), with mu twice theirs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, suggest
from ballbot.identification.axis.record import AxisRecord
from ballbot.mechanics.engine.compiled import by_types_of
from ballbot.mechanics.friction_laws.classical import ClassicalNumbers
from ballbot.mechanics.friction_laws.lugre import LuGreNumbers

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


class LoadNumbers(NamedTuple):
    """The load of an axis in compiled code."""

    mu: float  #: Coulomb friction over the load [-]
    of_force: float  #: share of F
    of_field: float  #: share of G(q)


def load_numbers(load: Load | None, mu: float) -> LoadNumbers:
    """Return what compiled code reads; without a load all is zero."""
    return LoadNumbers(mu, *_SHARES[load]) if load else LoadNumbers(0.0, 0.0, 0.0)


def recorded_load(load: Load | None, record: AxisRecord) -> NDArray[np.float64]:
    """Return the record's own load (N,); zeros of another kind.

    Raises
    ------
    InputError
        If friction depends on a recorded load and the record has none.
    """
    if load != "recorded":
        return np.zeros(len(record))
    if record.load is None:
        raise InputError(
            f"{record.name} has no load, on which the friction depends; name its column with --load."
        )
    return record.load


def load_at(
    load: Load, force: NDArray[np.float64], field: NDArray[np.float64], recorded: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return W (N,) [N] of a force F without the offset, a force over position G(q) and a recorded load (N,)."""
    of_force, of_field = _SHARES[load]
    return np.abs(of_force * force + of_field * field + recorded)


def force_with_load_friction(
    load: Load,
    mu: float,
    needed: NDArray[np.float64],
    field: NDArray[np.float64],
    recorded: NDArray[np.float64],
    sign: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the force F (N,) [N] of a motion with the friction mu W sgn(v).

    Parameters
    ----------
    load : {"position", "drive", "transmitted", "recorded"}
    mu : float
        Below 1 for the drive's force, and below 2 for its mean: beyond it no force moves the axis.
    needed : ndarray (N,)
        The force without that friction [N], with G(q).
    field, recorded : ndarray (N,)
        G(q) [N] and the recorded load.
    sign : ndarray (N,)
        sgn(v), or how far bristles are bent.
    """
    of_force, of_field = _SHARES[load]
    without = of_force * needed + of_field * field + recorded
    # F = needed + sign mu |W| and W = without + of_force (F - needed), whose sign is that of `without`
    way = sign * mu * np.sign(without)
    return needed + way * without / (1.0 - of_force * way)


def possible_loads(records: Sequence[AxisRecord], *, over_position: bool) -> list[Load]:
    """Return the loads that friction may depend on; `over_position`: whether the model has forces over position."""
    found = list[Load]()
    if over_position or any(one.known_load.weight for one in records):
        found += ("position", "drive", "transmitted")
    if all(one.load is not None for one in records):
        found.append("recorded")
    return found


def loaded(law, friction):  # pragma: no cover (compiled forms below)
    """Return a friction law with so much more Coulomb friction [N]."""
    raise NotImplementedError("compiled code only")


@by_types_of(loaded)
def _loaded(law, friction):  # noqa: ARG001 (a type)
    if law.instance_class is ClassicalNumbers:
        return lambda law, friction: ClassicalNumbers(law.b, law.c + friction, law.s, law.inv_vs, law.delta)
    if law.instance_class is LuGreNumbers:
        return lambda law, friction: LuGreNumbers(
            law.b, law.c + friction, law.s, law.inv_vs, law.delta, law.sigma_0, law.sigma_1, law.inv_vd
        )
    return None
