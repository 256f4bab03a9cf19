"""The parts that a controller may have besides its gain: one file a part, and this list of them.

`ballbot.control.parts.part` explains how to add one.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import get_args, get_type_hints

from ballbot.control.parts.disturbance_observer import DisturbanceObserver
from ballbot.control.parts.feed_forward import FeedForward
from ballbot.control.parts.integral import IntegralAction
from ballbot.control.parts.lean_limit import LeanLimit
from ballbot.control.parts.notch import Notch
from ballbot.control.parts.part import Part
from ballbot.control.parts.planner import Planner
from ballbot.control.parts.policy import Policy
from ballbot.control.parts.prediction import DelayPrediction
from ballbot.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Parts:
    """What is added to u = K S(psi) (r - x) and its friction compensation; nothing by default.

    A field is a part: its name is that of the table in a controller file and of the records in compiled code, its order
    that of the steps within each stage of the law.

    InputError if a part lacks another that it needs.

    Examples
    --------
    A controller without and with a notch at 12 Hz; a loop with smooth references:

    >>> from ballbot.control.presets import nominal_controller
    >>> controller = nominal_controller("alten")
    >>> quiet = controller.with_parts(Parts(notch=Notch(frequency=12.0)))
    >>> smooth = controller.with_parts(Parts(planner=Planner(torque_limit=1.5), feed_forward=FeedForward()))
    >>> [name for name, part in smooth.parts.present()]
    ['planner', 'feed_forward']
    """

    planner: Planner | None = None  #: makes motions of references that the robot can follow
    feed_forward: FeedForward | None = None  #: lean and torques that a planned motion needs
    integral: IntegralAction | None = None  #: removes lasting errors
    disturbance_observer: DisturbanceObserver | None = None  #: estimates the lost torque and adds it
    lean_limit: LeanLimit | None = None  #: limits the lean that errors of position and speed command
    notch: Notch | None = None  #: removes a resonance's band from the torques
    prediction: DelayPrediction | None = None  #: predicts the state at which delayed torques will act
    policy: Policy | None = None  #: a learned network that decides the torques

    def __post_init__(self) -> None:
        for _, part in self.present():
            for needed, why in part.needs.items():
                if getattr(self, needed) is None:
                    raise InputError(f"The {part.label} needs {KINDS[needed].label}: {why}.")

    def present(self) -> Iterator[tuple[str, Part]]:
        """Return the parts that the controller has, by name."""
        for name in KINDS:
            part = getattr(self, name)
            if part is not None:
                yield name, part


#: every part by its name in `Parts`
KINDS: dict[str, type[Part]] = {name: get_args(hint)[0] for name, hint in get_type_hints(Parts).items()}
