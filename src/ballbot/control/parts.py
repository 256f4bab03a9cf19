"""The parts that a controller may have besides its gain, each of which can be left out or changed by itself."""

from __future__ import annotations

from dataclasses import dataclass

from ballbot.control.adaptation import Adaptation
from ballbot.control.disturbance_observer import DisturbanceObserver
from ballbot.control.feed_forward import FeedForward
from ballbot.control.integral import IntegralAction
from ballbot.control.lean_bound import LeanBound
from ballbot.control.notch import Notch
from ballbot.control.reference_shaping import ReferenceShaping
from ballbot.control.standstill import Standstill
from ballbot.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Parts:
    """What is added to u = K S(psi) (r - x) and its friction compensation; nothing by default.

    Raises
    ------
    InputError
        Where parts do not go together, or are of different robots.
    """

    shaping: ReferenceShaping | None = None  #: makes smooth motions of references
    feed_forward: FeedForward | None = (
        None  #: lean and torques that a shaped motion needs; with a shaping only
    )
    integral: IntegralAction | None = None  #: works against errors that stay
    standstill: Standstill | None = None  #: how friction is compensated about zero speed
    observer: DisturbanceObserver | None = None  #: gives back the torque that is lost
    adaptation: Adaptation | None = None  #: lets the compensation follow the friction
    lean_bound: LeanBound | None = None  #: keeps errors of place and speed from asking for too much
    notch: Notch | None = None  #: takes a resonance's band out of the torques

    def __post_init__(self) -> None:
        if self.feed_forward is not None and self.shaping is None:
            raise InputError(
                "A feed-forward needs a shaping: only a smooth reference says what its motion takes."
            )

    def check(self, wheel_count: int) -> None:
        """Raise `InputError` where a part is for another number of wheels."""
        sizes = {
            "feed-forward": self.feed_forward and len(self.feed_forward.by_turning),
            "integral action": self.integral and len(self.integral.gain),
            "disturbance observer": self.observer and len(self.observer.balance.by_lean),
            "adaptation": self.adaptation and len(self.adaptation.balance.by_lean),
        }
        for part, size in sizes.items():
            if size not in (None, wheel_count):
                raise InputError(f"The {part} is for {size} wheels; this robot has {wheel_count}.")
