"""The parts that a controller may have besides its gain: one file a part, and this list of them.

`ballbot.control.parts.part` explains how to add one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import get_args, get_type_hints

from ballbot.control.parts.disturbance_observer import DisturbanceObserver
from ballbot.control.parts.feed_forward import FeedForward
from ballbot.control.parts.integral import IntegralAction
from ballbot.control.parts.lean_limit import LeanLimit
from ballbot.control.parts.notch import Notch
from ballbot.control.parts.part import Part
from ballbot.control.parts.prediction import DelayPrediction
from ballbot.control.parts.reference_shaping import ReferenceShaping
from ballbot.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Parts:
    """What is added to u = K S(psi) (r - x) and its friction compensation; nothing by default.

    A field is a part: its name is that of the table in a controller file and of the records in compiled code, its order
    that of the steps within each stage of the law.

    InputError if a part lacks another that it needs.
    """

    shaping: ReferenceShaping | None = None  #: makes smooth motions of references
    feed_forward: FeedForward | None = None  #: lean and torques that a shaped motion needs
    integral: IntegralAction | None = None  #: works against errors that stay
    disturbance_observer: DisturbanceObserver | None = None  #: estimates the torque that is lost, and adds it
    lean_limit: LeanLimit | None = None  #: keeps errors of position and speed from asking for too much
    notch: Notch | None = None  #: takes a resonance's band out of the torques
    prediction: DelayPrediction | None = None  #: of the state in which late torques will act

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
