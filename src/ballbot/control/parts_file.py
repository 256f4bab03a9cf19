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

from ballbot.control.disturbance_observer import DisturbanceObserver
from ballbot.control.driveline_adaptation import DrivelineAdaptation
from ballbot.control.feed_forward import FeedForward
from ballbot.control.floor_adaptation import FloorAdaptation
from ballbot.control.integral import IntegralAction
from ballbot.control.lean_bound import LeanBound
from ballbot.control.load_scaling import LoadScaling
from ballbot.control.notch import Notch
from ballbot.control.parts import Parts
from ballbot.control.prediction import DelayPrediction
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
    acceleration_limit: PositiveFloat = ReferenceShaping.acceleration_limit
    yaw_acceleration_limit: PositiveFloat = ReferenceShaping.yaw_acceleration_limit
    feed_forward: bool = False


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


class DrivelineAdaptationTable(Table):
    """[driveline_adaptation]: see `DrivelineAdaptation`."""

    time: PositiveFloat = DrivelineAdaptation.time
    spread: PositiveFloat = DrivelineAdaptation.spread
    lowest: NonNegativeFloat = DrivelineAdaptation.lowest
    highest: PositiveFloat = DrivelineAdaptation.highest
    floor_time: PositiveFloat = DrivelineAdaptation.floor_time
    noise: PositiveFloat = DrivelineAdaptation.noise
    least_speed: PositiveFloat = DrivelineAdaptation.least_speed


class FloorAdaptationTable(Table):
    """[floor_adaptation]: see `FloorAdaptation`."""

    time: PositiveFloat = FloorAdaptation.time
    slope_time: PositiveFloat = FloorAdaptation.slope_time
    highest: PositiveFloat = FloorAdaptation.highest
    full_speed: PositiveFloat = FloorAdaptation.full_speed


class LoadScalingTable(Table):
    """[load_scaling]: see `LoadScaling`."""

    share: _Share


class LeanBoundTable(Table):
    """[lean_bound]: see `LeanBound`."""

    lean: PositiveFloat = LeanBound.lean
    turn: PositiveFloat = LeanBound.turn


class NotchTable(Table):
    """[notch]: see `Notch`."""

    frequency: PositiveFloat
    width: PositiveFloat = Notch.width
    depth: _Share = Notch.depth


class PredictionTable(Table):
    """[prediction]: see `DelayPrediction`."""

    delay: PositiveFloat


class PartsTable(Table):
    """The tables of a file that may be missing."""

    shaping: ShapingTable | None = None
    integral: IntegralTable | None = None
    standstill: StandstillTable | None = None
    disturbance_observer: ObserverTable | None = None
    driveline_adaptation: DrivelineAdaptationTable | None = None
    floor_adaptation: FloorAdaptationTable | None = None
    load_scaling: LoadScalingTable | None = None
    lean_bound: LeanBoundTable | None = None
    notch: NotchTable | None = None
    prediction: PredictionTable | None = None


def parts_of(table: PartsTable, robot: Robot, sample_time: float) -> Parts:
    """Return the parts that tables describe, for a robot and a controller's sample time [s].

    Raises
    ------
    InputError
        Where a value is not one that a part can have.
    """
    shaping, integral, observer = table.shaping, table.integral, table.disturbance_observer
    standstill, drivelines, floor = table.standstill, table.driveline_adaptation, table.floor_adaptation
    balance = TorqueBalance.of(robot) if observer or drivelines else None
    return Parts(
        shaping=ReferenceShaping(**shaping.model_dump(exclude={"feed_forward"})) if shaping else None,
        feed_forward=FeedForward.of(robot) if shaping and shaping.feed_forward else None,
        integral=IntegralAction(gain=np.array(integral.gain), **integral.model_dump(exclude={"gain"}))
        if integral
        else None,
        standstill=Standstill(**standstill.model_dump()) if standstill else None,
        observer=DisturbanceObserver(balance=balance, **observer.model_dump())
        if observer and balance
        else None,
        driveline_adaptation=DrivelineAdaptation(balance=balance, **drivelines.model_dump())
        if drivelines and balance
        else None,
        floor_adaptation=FloorAdaptation(**floor.model_dump()) if floor else None,
        load_scaling=LoadScaling(**table.load_scaling.model_dump()) if table.load_scaling else None,
        lean_bound=LeanBound(**table.lean_bound.model_dump()) if table.lean_bound else None,
        notch=Notch(**table.notch.model_dump()) if table.notch else None,
        prediction=DelayPrediction.of(robot, delay=table.prediction.delay, sample_time=sample_time)
        if table.prediction
        else None,
    )


#: fields of parts that follow from the robot and are not written
_DERIVED = ("balance", "sample_time", "transition", "by_torque")


def parts_text(parts: Parts) -> str:
    """Return the tables of the parts that are there; empty where there are none."""
    described = {
        "shaping": (parts.shaping, _SHAPING),
        "integral": (parts.integral, _INTEGRAL),
        "standstill": (parts.standstill, _STANDSTILL),
        "disturbance_observer": (parts.observer, _OBSERVER),
        "driveline_adaptation": (parts.driveline_adaptation, _DRIVELINE_ADAPTATION),
        "floor_adaptation": (parts.floor_adaptation, _FLOOR_ADAPTATION),
        "load_scaling": (parts.load_scaling, _LOAD_SCALING),
        "lean_bound": (parts.lean_bound, _LEAN_BOUND),
        "notch": (parts.notch, _NOTCH),
        "prediction": (parts.prediction, _PREDICTION),
    }
    texts = []
    for name, (part, head) in described.items():
        if part is None:
            continue
        written = [field.name for field in fields(part) if field.name not in _DERIVED]
        lines = [f"\n# {head}\n[{name}]", *(f"{key} = {_number(getattr(part, key))}" for key in written)]
        if name == "shaping":
            lines.append(f"feed_forward = {str(parts.feed_forward is not None).lower()}")
        texts.append("\n".join(lines) + "\n")
    return "".join(texts)


_SHAPING = (
    "References are made smooth: four lags of `frequency` [rad/s] for x and y and of `yaw_frequency` for psi, jumps\n"
    "# at most at `speed_limit` [m/s] and `yaw_rate_limit` [rad/s]. A steady motion is not lagged, nor one that bends\n"
    "# within `acceleration_limit` [m/s^2], `yaw_acceleration_limit` [rad/s^2]; `feed_forward` gives\n"
    "# each motion lean and torque."
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
_DRIVELINE_ADAPTATION = (
    "As friction changes, each wheel's compensation is scaled between `lowest` and `highest`, over `time` of motion\n"
    "# [s]; they are thought to be off by some `spread`, and another floor is told from them over `floor_time` [s].\n"
    "# A wheel tells nothing below `least_speed` [rad/s]; `noise` [N m s^0.5] is the error of its lost torque."
)
_FLOOR_ADAPTATION = (
    "The part of the integral that turns with the motion, followed over `time` [s of motion], is told from the part\n"
    "# that stays, a slope's, followed over `slope_time` [s]; it is at most `highest` [m s], and whole from\n"
    "# `full_speed` [m/s] asked for."
)
_LOAD_SCALING = "Of each wheel's dry friction, `share` follows the force between wheel and ball."
_LEAN_BOUND = (
    "Errors of place and speed ask for no more lean than `lean` [rad], those of the heading for no more than `turn`\n"
    "# [rad]."
)

_NOTCH = (
    "Torques pass a notch at `frequency` [Hz], its band `width` times as wide; `depth` is left at its middle."
)

_PREDICTION = "Torques act `delay` [s] after the measurement; the law is that for the state of then."


def _number(value: float | np.ndarray) -> str:
    if isinstance(value, np.ndarray):
        rows = "".join(f"\n  [{', '.join(map(repr, row))}]," for row in value.tolist())
        return f"[{rows}\n]"
    return repr(float(value))
