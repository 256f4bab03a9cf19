"""Friction laws, and the selection of one by its error on held-out windows.

Each law contains a simpler one:

    none                 0
    viscous              b w
    coulomb              b w + c sgn(w)                                        and the ball's rolling friction C_rr
    stribeck             b w + (c + s exp(-|w/v_s|^delta)) sgn(w)              the thesis's law (3.8)
    asymmetric           the same, and a torque offset o of each wheel
    directed             the same, and s that differs with direction by e of each wheel
    load                 the same as stribeck with c + mu |u| in place of c

Asymmetric. Let wheel i have dry friction c+ turning forward and c- turning backward, and hold any torque from -c- to
c+ at rest. With c = (c+ + c-)/2 and o = (c+ - c-)/2 that is c sgn(w) + o:

    forward   c + o = c+          backward  -c + o = -c-          at rest   [-c, c] + o = [-c-, c+]

So it is the symmetric law with a constant torque -o on the wheel, estimated as `torque_offset`. The offset of a motor
driver has the same effect, and no log separates the two. It is friction while |o| <= c. Directed: with s+ and s- by
direction and e = (s+ - s-)/2 e exp(-|w/v_s|^delta) adds to the friction and fades at speeds around v_s; |e| <= s.

Load. Gear teeth rub in proportion to their load, here the motor's torque u, which is constant over a sample, as is then
the size of the friction. It is an alternative to asymmetric: both contain stribeck.

Selection. All laws are fitted to the same windows and predict the same held-out windows. A law is accepted if the
interval of its gain (`ballbot.fitting.model_selection`) is above zero over the simpler law within it and, if that one
was not accepted, over the largest accepted law within it; the simplest is no friction. The best law is the accepted one
with the least error. A law is rejected if an interval lies below a useful gain of 1 %; otherwise it is undecided.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from ballbot.errors import InputError, suggest
from ballbot.fitting.model_selection import USEFUL_GAIN, Gain, gain_between
from ballbot.identification.quantities import BY_NAME, FRICTION, QUANTITIES, Bounds, Limits, names_in
from ballbot.identification.result import Identification
from ballbot.identification.verdict import window_blocks
from ballbot.robot import Robot
from ballbot.robot.friction_law import CLASSICAL, friction_law, registered_laws


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
    """Return the law of that name, or the registered law of that name or of FILE.py:NAME.

    InputError if there is none.
    """
    names = [law.name for law in LAWS]
    if name in names:
        return LAWS[names.index(name)]
    if ".py:" in name or name in registered_laws():
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
    hint = suggest(name, [*names, *registered_laws()], otherwise="there are")
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


@dataclass(frozen=True, kw_only=True, eq=False)
class LawCandidate:
    """A fitted law, and its gain on held-out windows."""

    law: Law
    found: Identification
    gain: Gain  #: over the simpler law within it
    over: str | None  #: the largest accepted law within it; None: no friction
    gain_over: Gain  #: over that one
    error: float  #: relative to the error without friction

    @property
    def accepted(self) -> bool:
        """Whether held-out windows support the law."""
        return self.gain.significant and self.gain_over.significant

    @property
    def decision(self) -> Literal["accepted", "rejected", "undecided"]:
        """Whether held-out windows support the law, exclude a useful gain, or leave it undecided."""
        if self.accepted:
            return "accepted"
        return "rejected" if min(self.gain.upper, self.gain_over.upper) < USEFUL_GAIN else "undecided"

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "law": self.law.name,
            "formula": self.law.formula,
            "within": self.law.within,
            "gain": self.gain.to_dict(),
            "highest_accepted_below": self.over,
            "gain_over_highest_accepted": self.gain_over.to_dict(),
            "accepted": self.accepted,
            "decision": self.decision,
            "error_over_no_friction": self.error,
            "parameters": self.found.to_dict()["parameters"],
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class LawSelection:
    """All fitted laws, and the best one."""

    candidates: tuple[LawCandidate, ...]

    @property
    def best(self) -> LawCandidate:
        """The accepted law with the least error; viscous friction if none is accepted."""
        accepted = [candidate for candidate in self.candidates if candidate.accepted]
        return min(accepted, key=lambda candidate: candidate.error, default=self.candidates[0])

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "candidates": [candidate.to_dict() for candidate in self.candidates],
            "best": self.best.law.name,
        }


def select_law(fit: Callable[[str, Identification | None], Identification]) -> LawSelection:
    """Fit every friction law and select one by its error on held-out windows.

    `fit` calls `ballbot.identification.identify` with the name of a law and, as `warm_start`, the identification by the
    simpler law within it (None for the first); everything else is the same each time.
    """
    known: dict[str | None, LawCandidate] = {}
    for law in LAWS:
        inner = over = known.get(law.within)
        found = fit(law.name, inner and inner.found)
        while over and not over.accepted:
            over = known.get(over.law.within)
        known[law.name] = LawCandidate(
            law=law,
            found=found,
            gain=_gain(found, inner),
            over=over and over.law.name,
            gain_over=_gain(found, over),
            error=1.0 - _gain(found, None).share,
        )
    return LawSelection(candidates=tuple(known.values()))


def _gain(found: Identification, other: LawCandidate | None) -> Gain:
    """Return the gain over another law, or over no friction."""
    theirs = found.held_out.squares_without if other is None else other.found.held_out.squares_with
    ours, counted = found.held_out.squares_with, found.counted
    return gain_between(ours[:, counted], theirs[:, counted], window_blocks(found.held_out.spans))
