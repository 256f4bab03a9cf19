"""Friction laws.

Each law contains a simpler one:

    none                 0
    viscous              b w
    coulomb              b w + c sgn(w)                                        and the ball's rolling friction C_rr
    stribeck             b w + (c + s exp(-|w/v_s|^delta)) sgn(w)              the thesis's law (3.8)
    asymmetric           the same, and a torque offset o of each wheel
    directed             the same, and s that differs with direction by e of each wheel
    load                 the same as stribeck with c + mu |u| in place of c

Asymmetric. Dry friction c+ turning forward and c- backward, which holds any torque from -c- to c+ at rest, is
c sgn(w) + o with c = (c+ + c-)/2 and o = (c+ - c-)/2: the symmetric law with a constant torque -o, estimated as
`torque_offset`. The offset of a motor driver has the same effect, and no log separates the two. It is friction while
|o| <= c. Directed: with s+ and s- by direction and e = (s+ - s-)/2, |e| <= s, e exp(-|w/v_s|^delta) adds to it.

Load. Gear teeth rub in proportion to their load, here the motor's torque u. It is an alternative to asymmetry.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ballbot.errors import InputError, suggest
from ballbot.fitting.parameter import Limits
from ballbot.identification.quantities import BY_NAME, FRICTION, QUANTITIES, Bounds, names_in
from ballbot.robot import Robot
from ballbot.robot.friction_law import CLASSICAL, REGISTERED, friction_law


@dataclass(frozen=True)
class Law:
    """A friction law to select from."""

    name: str
    formula: str
    within: str | None  #: the simpler law that it contains and is compared with; None: no friction
    free: tuple[str, ...]  #: quantities that are estimated
    #: bounds unless others are given
    wide_bounds: Mapping[str, Limits] = field(default_factory=dict[str, Limits])


_COULOMB = ("viscous", "coulomb", "rolling")
_ASYMMETRIC = (*FRICTION, "torque_offset")
LAWS: tuple[Law, ...] = (
    # without dry friction, b takes its part
    Law("viscous", "b w", None, ("viscous",), {"viscous": (0.0, 1.0)}),
    Law("coulomb", "b w + c sgn w, rolling C_rr", "viscous", _COULOMB),
    Law("stribeck", "b w + (c + s exp(-|w/v_s|^delta)) sgn w, C_rr", "coulomb", FRICTION),
    Law("asymmetric", "stribeck, c of either direction", "stribeck", _ASYMMETRIC),
    Law(
        "directed",
        "stribeck, c and s of either direction",
        "asymmetric",
        (*_ASYMMETRIC, "stribeck_asymmetry"),
    ),
    Law("load", "stribeck, c + mu |u|", "stribeck", (*FRICTION, "load")),
)


def law_named(name: str) -> Law:
    """Return the law, or the registered law, of that name or of FILE.py:NAME; InputError if it is unknown."""
    names = [law.name for law in LAWS]
    if name in names:
        return LAWS[names.index(name)]
    if ".py:" in name or name in REGISTERED:
        law = friction_law(name)
        assert law is not None
        for own in law.own:
            if own.name in [quantity.name for quantity in QUANTITIES]:
                raise InputError(
                    f"The friction law {law.name} has a parameter {own.name}, the name of a quantity that is "
                    "identified; give it another name."
                )
        free = ("viscous", *law.takes, "rolling")
        return Law(law.name, f"b w + ({law.formula}) sgn w, C_rr", None, free)
    hint = suggest(name, [*names, *REGISTERED], otherwise="there are")
    raise InputError(f"{name!r} is not a friction law; {hint}")


def robot_by_law(robot: Robot, name: str, *, free: Sequence[str] | str) -> Robot:
    """Return the robot with the friction law that is estimated, or its own law if friction is not estimated."""
    if not set(FRICTION) <= set(names_in(free)):
        return robot
    classical = law_named(name) in LAWS
    friction = robot.friction.with_law(CLASSICAL if classical else name, dict(robot.friction.own))
    return robot if friction == robot.friction else robot.replace(friction=friction)


def bounds_of(law: Law, bounds: Bounds) -> Bounds:
    """Return the bounds, with friction that the law does not have held at values without effect."""
    absent = [name for name in FRICTION if name not in law.free]
    held = {name: (BY_NAME[name].neutral, BY_NAME[name].neutral) for name in absent}
    return Bounds({**law.wide_bounds, **bounds.limits, **held})
