"""Controller files: commented TOML with gain, sample time, parts, and the friction that is compensated.

The geometry is not in a controller file: a controller is read together with its robot. Each part of the controller has
a table of its own, whose name is its field in `ballbot.control.parts.Parts` and whose keys are the part's settings. A
missing key has the part's default. Numbers that follow from the robot are not written but computed for the robot that
the file is read with. The table `designed_for` has the robot's values that the design depends on. If they differ from
those of the robot, a warning names them.
"""

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, get_type_hints

import numpy as np
from pydantic import ConfigDict, Field, PositiveFloat

from ballbot.control.controller import Compensation, Controller, grip_torque_limit
from ballbot.control.linear import lacking_margin
from ballbot.control.overcompensation import overcompensation_warning
from ballbot.control.parts import Parts
from ballbot.control.parts.part import Part
from ballbot.errors import InputError, UnsuitedController, about, every
from ballbot.estimation.interface import EstimatorName
from ballbot.file_formats import format_line, take_format
from ballbot.files import read_toml, write_text
from ballbot.printable import toml_string
from ballbot.robot import Friction, Robot, RobotLike, as_robot
from ballbot.robot.components import BY_NAME, PARAMETERS
from ballbot.robot.parameters import DIMENSIONLESS, Value, value_of
from ballbot.schema import toml_line, validate_table

_GainRow = Annotated[tuple[float, ...], Field(min_length=10, max_length=10)]


@dataclass(frozen=True, kw_only=True)
class ControllerTable(Parts):
    """A controller file: a table for each part, and what every controller has."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)  # also of the tables in it
    robot: str
    sample_time: PositiveFloat
    compensation: Compensation
    torque_limit: PositiveFloat
    speed_band: PositiveFloat
    estimator: EstimatorName = "onboard"
    gain: Annotated[tuple[_GainRow, ...], Field(min_length=3, max_length=4)]
    friction: Friction  #: as in a robot file, in SI units
    designed_for: dict[str, float | tuple[float, ...]] | None = None  #: see `design_values`


def read_controller(path: str | Path, robot: RobotLike) -> Controller:
    """Return the controller of a file, for a robot's geometry; warn as `warn_if_unsuited`.

    InputError if the file cannot be read or holds no controller, or its number of wheels is not the robot's, or a
    learned policy in it is for another robot, another rate or stronger motors.
    """
    described, tree = as_robot(robot), read_toml(path)
    with about(path):
        tree = _with_planner(take_format(tree, "controller"), described)
        table = validate_table(ControllerTable, tree, of="a controller file")
        controller = _controller(table, described)
        _check_policy(table, described)
    warn_if_unsuited(controller, described, name=str(path))
    return controller


#: settings of the shaping that earlier files have in place of a planner, and that it has no more
_FORMER_SHAPING = ("frequency", "acceleration_limit", "drag", "approach_rate")


def _with_planner(tree: dict[str, object], robot: Robot) -> dict[str, object]:
    """Return a file's tables with a planner of the same limits in place of the shaping that earlier files have."""
    shaping, limit = tree.get("shaping"), tree.get("torque_limit")
    if not isinstance(shaping, dict) or not isinstance(limit, float | int) or "planner" in tree:
        return tree
    kept = {name: value for name, value in shaping.items() if name not in _FORMER_SHAPING}
    planner = {"torque_limit": min(float(limit), grip_torque_limit(robot))} | kept
    return {name: table for name, table in tree.items() if name != "shaping"} | {"planner": planner}


def _check_policy(table: ControllerTable, robot: Robot) -> None:
    """Raise InputError unless a policy, if there is one, was trained for such a robot; a design is only warned of."""
    if table.policy is None:
        return
    own, limit = robot.sensors.sample_time, robot.drive.torque_limit
    reason = ""
    if table.robot != robot.name:
        reason = f"the robot {table.robot!r}, not for {robot.name!r}"
    elif abs(table.sample_time - own) > 1e-9:
        reason = f"samples of {table.sample_time:g} s; those of {robot.name!r} are {own:g} s"
    elif table.policy.torque_limit > limit * (1.0 + 1e-6):
        reason = f"torques of up to {table.policy.torque_limit:g} N m; {robot.name!r} gives {limit:g} N m"
    if reason:
        raise InputError(f"its policy was learned for {reason}. Learn one for this robot: ballbot learn.")


def warn_if_unsuited(controller: Controller, robot: Robot, *, name: str) -> None:
    """Warn with `UnsuitedController` if a controller, called `name` in the warning, does not suit a described robot.

    It may be designed for other values of the robot, its loop may have no stability margin, or its compensation may
    exceed what is certain of the robot's friction.
    """
    changed = list(changed_values(controller))
    sentences = [lacking_margin(controller), overcompensation_warning(controller, robot)]
    if changed:
        more = f"; {len(changed) - _MOST_NAMED} more differ" if len(changed) > _MOST_NAMED else ""
        sentences.insert(
            0,
            f"The controller was designed for other values: {every(changed[:_MOST_NAMED])}{more}. Design it again for "
            f"the robot {robot.name!r}.",
        )
    for sentence in filter(None, sentences):
        warnings.warn(f"{name}: {sentence}", UnsuitedController, stacklevel=3)


#: number of differing values that a warning names
_MOST_NAMED = 4
#: values of drive and sensors that a design depends on, besides the rigid body
_OF_DRIVE_AND_SENSORS = (
    "drive.gear_ratio",
    "drive.motor_inertia",
    "drive.gear_inertia",
    "drive.torque_limit",
    "sensors.sample_time",
    "sensors.encoder_counts",
)
_RIGID_TABLES = ("", "ball", "body", "body.inertia", "wheels")
#: key of the controller's own sample time, which may differ from the robot's
_SAMPLE_TIME = "sample_time"


def design_values(controller: Controller) -> dict[str, Value]:
    """Return the values of the robot that gain, limits and parts depend on, by the names of a robot file, SI units.

    Friction is not among them: the file has its own. The inertia is about the ball's centre.
    """
    robot = controller.robot
    J = robot.body.inertia_about_ball_center()
    inertia = (*J.diagonal().tolist(), *J[[0, 0, 1], [1, 2, 2]].tolist())
    robot = robot.replace(body=replace(robot.body, inertia=inertia, inertia_about="ball_center"))
    return {_SAMPLE_TIME: controller.sample_time} | {
        parameter.name: value_of(robot, parameter)
        for parameter in PARAMETERS
        if parameter.table in _RIGID_TABLES or parameter.name in _OF_DRIVE_AND_SENSORS
    }


def changed_values(controller: Controller) -> Iterator[str]:
    """Yield a clause for each value that differs from the one that a controller was designed for."""
    values = design_values(controller)
    for name, before in (controller.designed_for or {}).items():
        if name not in values:  # written by a later version
            continue
        old, new = np.atleast_1d(before), np.atleast_1d(values[name])
        # tolerance for rounding by units and by the parallel-axis theorem
        if len(old) != len(new) or not np.allclose(old, new, rtol=1e-6, atol=1e-9):
            unit = BY_NAME[name].unit if name in BY_NAME else "s"
            texts = [", ".join(f"{number:.6g}" for number in numbers.tolist()) for numbers in (old, new)]
            yield f"{name} was {texts[0]} and is {texts[1]}{'' if unit == '1' else f' {unit}'}"


def write_controller(controller: Controller, path: str | Path) -> None:
    """Write a controller as a commented TOML file that reads back as the same numbers; InputError if it cannot be."""
    write_text(path, controller_text(controller))


def controller_text(controller: Controller) -> str:
    """Return the text that `write_controller` writes."""
    # a prediction identifies its controller by a checksum of this text, comments included: keep every word
    friction = controller.robot.friction
    rows = "\n".join(f"  {_row(row)}," for row in controller.gain.tolist())
    parts = "".join(_part_text(name, part) for name, part in controller.parts.present())
    return f"""\
# A controller for Ballbot: u = K S(psi) (r - x) + friction compensation, within the torque limit.
# S(psi) turns the error into the heading frame. Use it with: ballbot simulate ROBOT --controller FILE

{format_line("controller")}
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
{_friction_terms_text(friction)}{parts}{_designed_for_text(controller)}"""


def _part_text(name: str, part: Part) -> str:
    """Return the table of a part, each key with its meaning and unit."""
    lines, kinds = [f"\n# {part.comment}", f"[{name}]"], get_type_hints(type(part))
    for setting in fields(part):
        stated, value = *setting.metadata.values(), getattr(part, setting.name)
        unit = "" if stated.unit == DIMENSIONLESS else f" [{stated.unit}]"
        rows = "".join(f"\n  {_row(row)}," for row in np.atleast_2d(value))
        text = f"[{rows}\n]" if np.ndim(value) else repr(kinds[setting.name](value))
        lines += [f"# {stated.meaning}{unit}", f"{setting.name} = {text}"]
    return "\n".join(lines) + "\n"


def _friction_terms_text(friction: Friction) -> str:
    """Return the lines of the friction terms that only some files have."""
    terms = {
        "coulomb_asymmetry": "c forward less the mean of both directions [N m]",
        "stribeck_asymmetry": "s forward less the mean of both directions [N m]",
        "load": "mu, dry friction for each N m of the motor's torque [-]",
    }
    given = {key: text for key, text in terms.items() if getattr(friction, key)}
    lines = [f"# {text}\n{key} = {_row(getattr(friction, key))}\n" for key, text in given.items()]
    if friction.own_law:
        own = [[name, list(value) if isinstance(value, tuple) else value] for name, value in friction.own]
        lines.append(f"# in place of c + s exp(..): {friction.own_law.formula}, with these parameters\n")
        lines.append(f"{toml_line('law', friction.law)}\n{toml_line('own', own)}\n")
    return "".join(lines)


def _designed_for_text(controller: Controller) -> str:
    """Return the table of the robot's values that the design depends on; empty if they are not known."""
    values = design_values(controller) if controller.designed_for is None else controller.designed_for
    if not values:
        return ""
    lines = [
        f'"{name}" = {_row(value) if isinstance(value, tuple) else repr(float(value))}'
        for name, value in values.items()
    ]
    heading = (
        "# What the design depends on: values of the robot, SI units. Others raise a warning; do not edit."
    )
    return "\n".join(["", heading, "[designed_for]", *lines, ""])


def _row(values: Sequence[float]) -> str:
    return f"[{', '.join(repr(float(value)) for value in values)}]"


def _controller(table: ControllerTable, robot: Robot) -> Controller:
    if len(table.gain) != robot.wheel_count:
        raise InputError(
            f"gain has {len(table.gain)} rows; the robot {robot.name!r} has {robot.wheel_count} wheels."
        )
    controller = Controller(
        robot.replace(friction=table.friction),
        table.gain,
        sample_time=table.sample_time,
        compensation=table.compensation,
        torque_limit=table.torque_limit,
        speed_band=table.speed_band,
        parts=Parts(**dict(table.present())),  # pyright: ignore[reportArgumentType] (each by its name)
        estimator=table.estimator,
    )
    controller.designed_for = table.designed_for or {}
    return controller
