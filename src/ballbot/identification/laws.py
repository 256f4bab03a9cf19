"""The ladder of friction laws, each of which has the ones before it within it.

    none                 0
    viscous              b w
    coulomb              b w + c sgn(w)                                        and the ball's rolling friction C_rr
    stribeck             b w + (c + s exp(-|w/v_s|^delta)) sgn(w)              the thesis's law (3.8)
    asymmetric           the same, and a torque offset o of each wheel
    load                 the same as stribeck with c + mu |u| in place of c

Asymmetric. Let wheel i have dry friction c+ while it turns forward and c- while it turns backward, and at rest hold
any torque from -c- to c+. With c = (c+ + c-)/2 and o = (c+ - c-)/2 that is c sgn(w) + o:

    forward   c + o = c+          backward  -c + o = -c-          at rest   [-c, c] + o = [-c-, c+]

So it is the symmetric law and a constant torque -o on the wheel, the set of torques that hold it at rest included, and
the same holds with s exp(..) added to c on both sides. The offset is found as `torque_offset` (= -o): a motor driver's
own offset has the same effect, and no log tells one from the other. It is physical while |o| <= c. A viscous part that
differs with direction is another law, of |w|, and not in it.

Load. A gear's teeth rub in proportion to what they carry, here the motor's torque u, which is held over a sample; so is
then the friction's size. It stands beside asymmetric on the ladder, not above it: both have stribeck within them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Literal

from ballbot.errors import InputError
from ballbot.identification.bounds import Bounds
from ballbot.identification.quantities import FRICTION, Interval

LawName = Literal["viscous", "coulomb", "stribeck", "asymmetric", "load"]

_NO_STRIBECK: dict[str, Interval] = {
    "stribeck": (0.0, 0.0),
    "stribeck_speed": (1.0, 1.0),
    "stribeck_exponent": (1.0, 1.0),
}


@dataclass(frozen=True, kw_only=True)
class Law:
    """A rung of the ladder."""

    name: LawName
    formula: str
    within: LawName | None  #: the rung that it contains and is compared with; None: no friction
    sought: tuple[str, ...]  #: quantities
    held: Mapping[str, Interval]  #: quantities of `FRICTION` that it does not have, at values without effect
    #: bounds where none are given: without dry friction, b has to do its part
    wide: Mapping[str, Interval] = field(default_factory=dict[str, Interval])


LAWS: tuple[Law, ...] = (
    Law(
        name="viscous",
        formula="b w",
        within=None,
        sought=("viscous",),
        held={**_NO_STRIBECK, "coulomb": (0.0, 0.0), "rolling": (0.0, 0.0)},
        wide={"viscous": (0.0, 1.0)},
    ),
    Law(
        name="coulomb",
        formula="b w + c sgn w, rolling C_rr",
        within="viscous",
        sought=("viscous", "coulomb", "rolling"),
        held=_NO_STRIBECK,
    ),
    Law(
        name="stribeck",
        formula="b w + (c + s exp(-|w/v_s|^delta)) sgn w, C_rr",
        within="coulomb",
        sought=FRICTION,
        held={},
    ),
    Law(
        name="asymmetric",
        formula="stribeck, c and s of either direction",
        within="stribeck",
        sought=(*FRICTION, "torque_offset"),
        held={},
    ),
    Law(
        name="load",
        formula="stribeck, c + mu |u|",
        within="stribeck",
        sought=(*FRICTION, "load"),
        held={},
    ),
)


def law_named(name: str) -> Law:
    """Return the law of that name.

    Raises
    ------
    InputError
        Where there is none.
    """
    names = [law.name for law in LAWS]
    if name in names:
        return LAWS[names.index(name)]
    near = get_close_matches(name, names, n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(names)}."
    raise InputError(f"{name!r} is not a friction law; {hint}")


def bounds_of(law: Law, bounds: Bounds) -> Bounds:
    """Return bounds that hold what the law does not have; the rest stay as given."""
    given = {name: bounds.interval(name) for name in bounds.given}
    return Bounds(**{**law.wide, **given, **law.held})
