"""Controller files: commented TOML with gain, sample time, parts, and the friction that is compensated.

The geometry is not in it: a controller is read together with its robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import (
    Field,
    FiniteFloat,
    NonNegativeFloat,
    PositiveFloat,
)

from ballbot.control.controller import Compensation, Controller
from ballbot.control.parts_file import PartsTable, Table, parts_of, parts_text
from ballbot.errors import InputError
from ballbot.estimation.named import EstimatorName
from ballbot.files import write_text
from ballbot.inputs import read_toml
from ballbot.printable import toml_string
from ballbot.robot import Friction, Robot
from ballbot.schema import validated

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
        return _controller(validated(ControllerTable, tree, of="a controller file"), robot)
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
