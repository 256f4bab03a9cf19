"""Standing still: what friction compensation does where a wheel's speed says little; see `.compensation`."""

from __future__ import annotations

from dataclasses import dataclass, field

from ballbot.control.parts.part import LawSettings, Part, Steps
from ballbot.control.records import number, setting, whole


@dataclass(frozen=True, kw_only=True, eq=False)
class StandstillRecord:
    """Fractions, and 1/u_0."""

    on: int = field(default=1, metadata=whole())
    ahead: float = field(metadata=number("1"))
    feed: float = field(metadata=number("1"))
    feed_steepness: float = field(metadata=number("1/(N m)"))


@dataclass(frozen=True, kw_only=True)
class Standstill(Part):
    """How friction is compensated about zero speed.

    Raises
    ------
    InputError
        If a fraction is not between 0 and 1, or the torque is not positive.
    """

    label = "standstill"
    comment = "Compensation about zero speed."
    record = StandstillRecord
    steps = Steps()

    ahead: float = field(
        default=0.0,
        metadata=setting(
            "1", "fraction of the speed asked for in the speed compensated", at_least=0.0, at_most=1.0
        ),
    )
    feed: float = field(
        default=0.0,
        metadata=setting(
            "1", "fraction of the breakaway torque that a wheel at rest is given", at_least=0.0, at_most=1.0
        ),
    )
    feed_torque: float = field(
        default=0.2, metadata=setting("N m", "the feedback's torque at which it is given in full", above=0.0)
    )

    def numbers(self, settings: LawSettings) -> StandstillRecord:
        """Return the record."""
        return StandstillRecord(ahead=self.ahead, feed=self.feed, feed_steepness=1.0 / self.feed_torque)
