"""Controller files: commented TOML with gain, sample time, parts, and the friction that is compensated.

The geometry is not in a controller file: a controller is read together with its robot. Each part of the controller is
a table of its own whose keys are the fields of the part. A key that is left out has the part's default. What follows
from the robot (the matrices of the feed-forward and the torque balance) is not written: it is computed for the robot
that the file is read with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, NonNegativeFloat, PositiveFloat

from ballbot.control.controller import Compensation, Controller
from ballbot.control.parts import Parts
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
from ballbot.control.parts.torque_balance import TorqueBalance
from ballbot.errors import InputError
from ballbot.estimation.interface import EstimatorName
from ballbot.files import read_toml, write_text
from ballbot.printable import toml_string
from ballbot.robot import Friction, Robot
from ballbot.schema import validate_table

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

    lean: PositiveFloat = LeanLimit.lean
    turn: PositiveFloat = LeanLimit.turn


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
        lean_bound=LeanLimit(**table.lean_bound.model_dump()) if table.lean_bound else None,
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


_GainRow = Annotated[tuple[FiniteFloat, ...], Field(min_length=10, max_length=10)]
_WheelValues = Annotated[tuple[NonNegativeFloat, ...], Field(min_length=3, max_length=4)]


class FrictionTable(Table):
    """[friction]: as in a robot file, in SI units."""

    viscous: _WheelValues
    coulomb: _WheelValues
    stribeck: _WheelValues
    stribeck_speed: PositiveFloat
    stribeck_exponent: PositiveFloat
    rolling: NonNegativeFloat


class ControllerTable(PartsTable):
    """A whole controller file."""

    robot: str
    sample_time: PositiveFloat
    compensation: Compensation
    torque_limit: PositiveFloat
    speed_band: PositiveFloat
    #: files written before the controller named its estimator were made for the thesis's state
    estimator: EstimatorName = "onboard"
    gain: Annotated[tuple[_GainRow, ...], Field(min_length=3, max_length=4)]
    friction: FrictionTable


def read_controller(path: str | Path, robot: Robot) -> Controller:
    """Return the controller of a file, for a robot.

    Parameters
    ----------
    path : str or Path
    robot : Robot
        Gives the geometry; the friction that is compensated is the file's.

    Raises
    ------
    InputError
        Where the file cannot be read or holds no controller, or its number of wheels is not the robot's.
    """
    tree = read_toml(path)
    try:
        return _controller(validate_table(ControllerTable, tree, of="a controller file"), robot)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def write_controller(controller: Controller, path: str | Path) -> None:
    """Write a controller as a commented TOML file that reads back as the same numbers.

    Raises
    ------
    InputError
        Where the file cannot be written.
    """
    write_text(path, controller_text(controller))


def controller_text(controller: Controller) -> str:
    """Return the text that `write_controller` writes."""
    friction = controller.robot.friction
    rows = "\n".join(f"  {_row(row)}," for row in controller.gain.tolist())
    return f"""\
# A controller for Ballbot: u = K S(psi) (r - x) + friction compensation, within the torque limit.
# S(psi) turns the error into the heading frame. Use it with: ballbot simulate ROBOT --controller FILE

# the robot it was designed for
robot = {toml_string(controller.robot.name)}
# [s] between two updates; torques are held
sample_time = {controller.sample_time!r}
# "none", "full" (all friction) or "partial" (only while it works against the intended motion)
compensation = "{controller.compensation}"
# [N m] for each wheel
torque_limit = {controller.torque_limit!r}
# [rad/s] wheel speed below which the compensated friction's sign is a ramp
speed_band = {controller.speed_band!r}
# the on-board state that it is made for: "onboard" (as in the thesis) or "kalman" (a filter of the same sensors)
estimator = "{controller.estimator}"
# K, a row for each wheel [N m per m, m, rad, rad, rad, and per each of their rates]
gain = [
{rows}
]

# The friction that is compensated: b w + (c + s exp(-|w/v_s|^delta)) sgn(w), and rolling friction N C_rr.
[friction]
# b [N m s/rad]
viscous = {_row(friction.viscous)}
# c [N m]
coulomb = {_row(friction.coulomb)}
# s [N m]
stribeck = {_row(friction.stribeck)}
# v_s [rad/s]
stribeck_speed = {friction.stribeck_speed!r}
# delta [-]
stribeck_exponent = {friction.stribeck_exponent!r}
# C_rr [-]
rolling = {friction.rolling!r}
{parts_text(controller.parts)}"""


def _row(values: Sequence[float]) -> str:
    return f"[{', '.join(repr(float(value)) for value in values)}]"


def _controller(table: ControllerTable, robot: Robot) -> Controller:
    if len(table.gain) != robot.wheel_count:
        raise InputError(
            f"gain has {len(table.gain)} rows; the robot {robot.name!r} has {robot.wheel_count} wheels."
        )
    return Controller(
        robot.replace(friction=Friction(**table.friction.model_dump())),
        table.gain,
        sample_time=table.sample_time,
        compensation=table.compensation,
        torque_limit=table.torque_limit,
        speed_band=table.speed_band,
        parts=parts_of(table, robot, table.sample_time),
        estimator=table.estimator,
    )
