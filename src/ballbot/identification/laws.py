"""Friction laws, and the selection of one by its error on held-out windows.

Each law contains another one:

    none                 0
    viscous              b w
    coulomb              b w + c sgn(w)                                        and the ball's rolling friction C_rr
    stribeck             b w + (c + s exp(-|w/v_s|^delta)) sgn(w)              the thesis's law (3.8)
    asymmetric           the same, and a torque offset o of each wheel
    directed             the same, and s that differs with direction by e of each wheel
    load                 the same as stribeck with c + mu |u| in place of c

Asymmetric. Let wheel i have dry friction c+ while it turns forward and c- while it turns backward, and at rest hold
any torque from -c- to c+. With c = (c+ + c-)/2 and o = (c+ - c-)/2 that is c sgn(w) + o:

    forward   c + o = c+          backward  -c + o = -c-          at rest   [-c, c] + o = [-c-, c+]

So it is the symmetric law and a constant torque -o on the wheel, the set of torques that hold it at rest included, and
the same holds with s exp(..) added to c on both sides. The offset is found as `torque_offset` (= -o): a motor driver's
own offset has the same effect, and no log separates the two. It is physical while |o| <= c. A viscous part that
differs with direction is another law, of |w|, and not in it.

Directed. With s+ and s- by direction and e = (s+ - s-)/2 the friction is the asymmetric one and e exp(-|w/v_s|^delta).
It differs from an offset at speeds around v_s, where the exponential fades. It is physical while |e| <= s.

Load. A gear's teeth rub in proportion to what they carry, here the motor's torque u, which is held over a sample; so is
then the friction's size. It is an alternative to asymmetric: both contain stribeck.

Each law is fitted to the same windows; `ballbot.fitting.model_selection` has how one is selected.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from ballbot.errors import InputError, suggest
from ballbot.fitting.model_selection import Candidate, HeldOut, ModelSelection, select_model
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
    within: str | None  #: the law that it contains and is compared with; None: no friction
    free: tuple[str, ...]  #: quantities
    #: bounds if none are given
    wide_bounds: Mapping[str, Limits] = field(default_factory=dict[str, Limits])

    @property
    def fixed(self) -> dict[str, Limits]:
        """The quantities of `FRICTION` that it does not have, at values without effect."""
        absent = [name for name in FRICTION if name not in self.free]
        return {name: (1.0, 1.0) if BY_NAME[name].scale == "ratio" else (0.0, 0.0) for name in absent}


_COULOMB = ("viscous", "coulomb", "rolling")
_ASYMMETRIC = (*FRICTION, "torque_offset")
LAWS: tuple[Law, ...] = (
    # without dry friction, b has to take its part
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
    """Return the law of that name, or the registered one of that name or of FILE.py:NAME.

    InputError if there is no such law.
    """
    names = [law.name for law in LAWS]
    if name in names:
        return LAWS[names.index(name)]
    if ".py:" in name or name in registered_laws():
        law = friction_law(name)
        assert law is not None
        for one in law.own:
            if one.name in [quantity.name for quantity in QUANTITIES]:
                raise InputError(
                    f"The friction law {law.name} has a parameter {one.name}, the name of a quantity that is "
                    "identified; give it another name."
                )
        free = ("viscous", *law.takes, "rolling")
        return Law(law.name, f"b w + ({law.formula}) sgn w, C_rr", None, free)
    names += registered_laws()
    hint = suggest(name, names, otherwise="there are")
    raise InputError(f"{name!r} is not a friction law; {hint}")


def robot_by_law(robot: Robot, name: str, *, free: Sequence[str] | str) -> Robot:
    """Return the robot with the friction law that is estimated, its own if friction is not."""
    if not set(FRICTION) <= set(names_in(free)):
        return robot
    classical = law_named(name) in LAWS
    friction = robot.friction.with_law(CLASSICAL if classical else name, dict(robot.friction.own))
    return robot if friction == robot.friction else robot.replace(friction=friction)


def bounds_of(law: Law, bounds: Bounds) -> Bounds:
    """Return bounds that fix what the law does not have; the rest stay as given."""
    return Bounds({**law.wide_bounds, **bounds.limits, **law.fixed})


#: from a law and the identification to begin from, to an identification by that law
LawFit = Callable[[str, Identification | None], Identification]


def select_law(fit: LawFit) -> ModelSelection[Identification]:
    """Fit every friction law and select the one that the held-out windows support; no friction is the baseline.

    `fit` calls `ballbot.identification.identify` with its law and `warm_start`, all else the same each time.
    """
    by_name = {law.name: law for law in LAWS}

    def held_out(name: str, inner: Identification | None) -> HeldOut[Identification]:
        found = fit(by_name[name].name, inner)
        return HeldOut(
            model=found,
            squares=found.held_out.squares_with[:, found.counted],
            baseline=found.held_out.squares_without[:, found.counted],
            groups=window_blocks(found.held_out_windows),
        )

    return select_model({law.name: law.within for law in LAWS}, held_out)


def law_results(selection: ModelSelection[Identification]) -> dict[str, object]:
    """Return what results.json holds of a selection of laws."""
    return {"candidates": [_law_result(one) for one in selection.candidates], "best": selection.best.name}


def _law_result(one: Candidate[Identification]) -> dict[str, object]:
    assert one.gain is not None  # there is a baseline
    assert one.gain_over is not None
    return {
        "law": one.name,
        "formula": law_named(one.name).formula,
        "within": one.within,
        "gain": one.gain.to_dict(),
        "highest_accepted_below": one.over,
        "gain_over_highest_accepted": one.gain_over.to_dict(),
        "accepted": one.accepted,
        "decision": one.decision,
        "error_over_no_friction": one.error,
        "parameters": one.model.to_dict()["parameters"],
    }
