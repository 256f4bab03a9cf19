"""The parts that a controller may have besides its gain, each of which can be left out or changed by itself."""

from __future__ import annotations

from dataclasses import dataclass

from ballbot.control.parts.compensation import Standstill
from ballbot.control.parts.disturbance_observer import DisturbanceObserver
from ballbot.control.parts.driveline_adaptation import DrivelineAdaptation
from ballbot.control.parts.feed_forward import FeedForward
from ballbot.control.parts.floor_adaptation import FloorAdaptation
from ballbot.control.parts.integral import IntegralAction
from ballbot.control.parts.lean_limit import LeanLimit
from ballbot.control.parts.load_scaling import LoadScaling
from ballbot.control.parts.notch import Notch
from ballbot.control.parts.prediction import DelayPrediction
from ballbot.control.parts.reference_shaping import ReferenceShaping
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
    driveline_adaptation: DrivelineAdaptation | None = (
        None  #: lets the compensation follow the wheels' friction
    )
    floor_adaptation: FloorAdaptation | None = (
        None  #: follows what the floor takes; with shaping and integral action only
    )
    load_scaling: LoadScaling | None = None  #: lets the compensation follow the load on the wheels
    lean_bound: LeanLimit | None = None  #: keeps errors of place and speed from asking for too much
    notch: Notch | None = None  #: takes a resonance's band out of the torques
    prediction: DelayPrediction | None = None  #: of the state in which late torques will act

    def __post_init__(self) -> None:
        if self.feed_forward is not None and self.shaping is None:
            raise InputError(
                "A feed-forward needs reference shaping: it uses the derivatives of the shaped reference."
            )

        if self.floor_adaptation is not None and (self.integral is None or self.shaping is None):
            raise InputError(
                "A floor adaptation needs integral action, from which it learns the friction of the floor, and "
                "reference shaping, because only a smooth reference has a direction of motion at all times."
            )

    def check(self, wheel_count: int, sample_time: float) -> None:
        """Raise `InputError` where a part is for another number of wheels or another sample time."""
        sizes = {
            "feed-forward": self.feed_forward and len(self.feed_forward.by_turning),
            "integral action": self.integral and len(self.integral.gain),
            "disturbance observer": self.observer and len(self.observer.balance.by_lean),
            "driveline adaptation": self.driveline_adaptation
            and len(self.driveline_adaptation.balance.by_lean),
            "prediction": self.prediction and self.prediction.by_torque.shape[2],
        }
        for part, size in sizes.items():
            if size not in (None, wheel_count):
                raise InputError(f"The {part} is for {size} wheels; this robot has {wheel_count} wheels.")
        if self.notch is not None:
            self.notch.check(sample_time)
        if self.prediction is not None and self.prediction.sample_time != sample_time:
            raise InputError(
                f"The prediction is for a sample time of {self.prediction.sample_time:g} s; the controller's "
                f"sample time is {sample_time:g} s."
            )
