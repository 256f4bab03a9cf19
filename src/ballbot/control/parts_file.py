"""A controller file's tables of the parts that a controller may have besides its gain.

Each part that is there is a table of its own, its keys those of the part; a key that is left out has the part's
default. What follows from the robot (the feed-forward's and the torque balance's matrices) is not written: it is
worked out anew for the robot that the file is read with.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, NonNegativeFloat, PositiveFloat

from ballbot.control.adaptation import Adaptation
from ballbot.control.disturbance_observer import DisturbanceObserver
from ballbot.control.feed_forward import FeedForward
from ballbot.control.integral import IntegralAction
from ballbot.control.lean_bound import LeanBound
from ballbot.control.notch import Notch
from ballbot.control.parts import Parts
from ballbot.control.reference_shaping import ReferenceShaping
from ballbot.control.standstill import Standstill
from ballbot.control.torque_balance import TorqueBalance
from ballbot.robot import Robot

_IntegralRow = Annotated[tuple[FiniteFloat, ...], Field(min_length=3, max_length=3)]
_Share = Annotated[float, Field(ge=0.0, le=1.0)]


class Table(BaseModel):
    """A table that knows its keys and refuses others."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class ShapingTable(Table):
    """[shaping]: see `ReferenceShaping`."""

    frequency: PositiveFloat = ReferenceShaping.frequency
    speed_limit: PositiveFloat = ReferenceShaping.speed_limit
    yaw_frequency: PositiveFloat = ReferenceShaping.yaw_frequency
    yaw_rate_limit: PositiveFloat = ReferenceShaping.yaw_rate_limit
    feed_forward: bool = False
    rolling_lean: bool = False


class IntegralTable(Table):
    """[integral]: see `IntegralAction`."""

    gain: Annotated[tuple[_IntegralRow, ...], Field(min_length=3, max_length=4)]
    limit: PositiveFloat = IntegralAction.limit
    yaw_limit: PositiveFloat = IntegralAction.yaw_limit
    memory: PositiveFloat = IntegralAction.memory
    dead_band: NonNegativeFloat = IntegralAction.dead_band


class StandstillTable(Table):
    """[standstill]: see `Standstill`."""

    ahead: _Share = Standstill.ahead
    feed: _Share = Standstill.feed
    feed_torque: PositiveFloat = Standstill.feed_torque


class ObserverTable(Table):
    """[disturbance_observer]: see `DisturbanceObserver`."""

    frequency: PositiveFloat = DisturbanceObserver.frequency
    limit: PositiveFloat = DisturbanceObserver.limit


class AdaptationTable(Table):
    """[adaptation]: see `Adaptation`."""

    time: PositiveFloat = Adaptation.time
    driveline_time: PositiveFloat = Adaptation.driveline_time
    driveline_spread: PositiveFloat = Adaptation.driveline_spread
    lowest: NonNegativeFloat = Adaptation.lowest
    highest: PositiveFloat = Adaptation.highest
    lowest_floor: NonNegativeFloat = Adaptation.lowest_floor
    highest_floor: PositiveFloat = Adaptation.highest_floor
    floor_margin: NonNegativeFloat = Adaptation.floor_margin
    noise: PositiveFloat = Adaptation.noise
    least_speed: PositiveFloat = Adaptation.least_speed


class LeanBoundTable(Table):
    """[lean_bound]: see `LeanBound`."""

    lean: PositiveFloat = LeanBound.lean
    turn: PositiveFloat = LeanBound.turn


class NotchTable(Table):
    """[notch]: see `Notch`."""

    frequency: PositiveFloat
    width: PositiveFloat = Notch.width
    depth: _Share = Notch.depth


class PartsTable(Table):
    """The tables of a file that may be missing."""

    shaping: ShapingTable | None = None
    integral: IntegralTable | None = None
    standstill: StandstillTable | None = None
    disturbance_observer: ObserverTable | None = None
    adaptation: AdaptationTable | None = None
    lean_bound: LeanBoundTable | None = None
    notch: NotchTable | None = None


def parts_of(table: PartsTable, robot: Robot) -> Parts:
    """Return the parts that tables describe, for a robot.

    Raises
    ------
    InputError
        Where a value is not one that a part can have.
    """
    shaping, integral, observer = table.shaping, table.integral, table.disturbance_observer
    standstill, adaptation = table.standstill, table.adaptation
    balance = TorqueBalance.of(robot) if observer or adaptation else None
    return Parts(
        shaping=ReferenceShaping(**shaping.model_dump(exclude={"feed_forward", "rolling_lean"}))
        if shaping
        else None,
        feed_forward=FeedForward.of(robot, rolling_lean=shaping.rolling_lean)
        if shaping and shaping.feed_forward
        else None,
        integral=IntegralAction(gain=np.array(integral.gain), **integral.model_dump(exclude={"gain"}))
        if integral
        else None,
        standstill=Standstill(**standstill.model_dump()) if standstill else None,
        observer=DisturbanceObserver(balance=balance, **observer.model_dump())
        if observer and balance
        else None,
        adaptation=Adaptation(balance=balance, **adaptation.model_dump()) if adaptation and balance else None,
        lean_bound=LeanBound(**table.lean_bound.model_dump()) if table.lean_bound else None,
        notch=Notch(**table.notch.model_dump()) if table.notch else None,
    )


def parts_text(parts: Parts) -> str:
    """Return the tables of the parts that are there; empty where there are none."""
    described = {
        "shaping": (parts.shaping, _SHAPING),
        "integral": (parts.integral, _INTEGRAL),
        "standstill": (parts.standstill, _STANDSTILL),
        "disturbance_observer": (parts.observer, _OBSERVER),
        "adaptation": (parts.adaptation, _ADAPTATION),
        "lean_bound": (parts.lean_bound, _LEAN_BOUND),
        "notch": (parts.notch, _NOTCH),
    }
    texts = []
    for name, (part, head) in described.items():
        if part is None:
            continue
        lines = [f"\n# {head}\n[{name}]"]
        lines += [
            f"{field.name} = {_number(getattr(part, field.name))}" for field in fields(part) if field.name != "balance"
        ]  # fmt: skip
        if name == "shaping":
            leans = parts.feed_forward is not None and parts.feed_forward.rolling_lean > 0.0
            lines.append(f"feed_forward = {str(parts.feed_forward is not None).lower()}")
            lines.append(f"rolling_lean = {str(leans).lower()}")
        texts.append("\n".join(lines) + "\n")
    return "".join(texts)


_SHAPING = (
    "References are made smooth: four lags of `frequency` [rad/s] for x and y and of `yaw_frequency` for psi, jumps\n"
    "# at most at `speed_limit` [m/s] and `yaw_rate_limit` [rad/s]; `feed_forward` gives each motion lean and torque,\n"
    "# and `rolling_lean` with it the lean into the rolling friction."
)
_INTEGRAL = (
    "The error's integral, a row of `gain` for each wheel [N m per m s, m s, rad s], within `limit` [m s] and\n"
    "# `yaw_limit` [rad s], forgotten over `memory` [s], at rest where the error is within `dead_band` [m, rad]."
)
_STANDSTILL = (
    "About zero speed: share of the speed asked for in the one compensated; share of the break-away torque that a\n"
    "# wheel at rest is given, in full where the law's own torque is `feed_torque` [N m]."
)
_OBSERVER = "Torque that is lost is given back over 1/`frequency` [rad/s], at most `limit` [N m]."
_ADAPTATION = (
    "As friction changes, the wheels' compensation is scaled between `lowest` and `highest` over `driveline_time`;\n"
    "# they are thought to be off by some `driveline_spread`. The rolling friction's is scaled between `lowest_floor`\n"
    "# and `highest_floor` over `time` [s of motion], as far as it is off by more than `floor_margin`. A wheel tells\n"
    "# nothing below `least_speed` [rad/s]; `noise` [N m s^0.5] is the error of its lost torque, mean of a second."
)

_LEAN_BOUND = (
    "Errors of place and speed ask for no more lean than `lean` [rad], those of the heading for no more than `turn`\n"
    "# [rad]."
)

_NOTCH = (
    "Torques pass a notch at `frequency` [Hz], its band `width` times as wide; `depth` is left at its middle."
)


def _number(value: float | np.ndarray) -> str:
    if isinstance(value, np.ndarray):
        rows = "".join(f"\n  [{', '.join(map(repr, row))}]," for row in value.tolist())
        return f"[{rows}\n]"
    return repr(float(value))
