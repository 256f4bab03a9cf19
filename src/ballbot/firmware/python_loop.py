"""The files of `ballbot export --python`: a module of Python's standard library that runs the C sources.

The module speaks the columns of the robot's logs. A mapping is turned round in it: what turns the log's numbers into
SI units stays, and what turns commands into torques is inverted.
"""

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ballbot.control.controller import Controller
from ballbot.errors import InputError
from ballbot.files import read_text
from ballbot.firmware.records import SelfTestOutcome
from ballbot.log.columns import ATTITUDE_NAMES, torque_names, wheel_angle_names
from ballbot.log.mapping import (
    IMU_NAMES,
    AttitudeTable,
    ColumnTable,
    DutyTable,
    LogMapping,
    TorqueTable,
    motor_resistance,
)
from ballbot.robot import Robot
from ballbot.robot.derived import encoder_step

PYTHON_PROJECT = Path(__file__).parent / "python_project"
MODULE = "ballbot_loop.py"
_GYRO_NAMES = ("gyro_x", "gyro_y", "gyro_z")
#: difference of two gear ratios beyond which they are of two robots
_LARGEST_DIFFERENCE = 0.01


def python_module(controller: Controller, mapping: LogMapping | None) -> str:
    """Return the module for a controller, in the units of its robot's logs; by default of Ballbot's logs.

    InputError if the mapping is of another robot, or lacks a column that a reading needs, or its commands.
    """
    n = controller.robot.wheel_count
    if mapping is None:
        names = ("t", *ATTITUDE_NAMES, *_GYRO_NAMES, *wheel_angle_names(n))
        columns = {name: ColumnTable(source=name) for name in names}
        mapping = LogMapping(columns=columns, input=TorqueTable(kind="torque", sources=torque_names(n)))
    words = tuple(outcome.name.lower().replace("_", " ") for outcome in SelfTestOutcome)
    numbers = {"SAMPLE_TIME": controller.sample_time, "SELF_TEST": words}
    numbers |= _columns(mapping, controller.robot)
    text = read_text(PYTHON_PROJECT / MODULE)
    for name, value in numbers.items():
        line = re.compile(rf"^({name}: .*?) = .*?(  # .*)$", re.MULTILINE)
        text, count = line.subn(lambda found, value=value: f"{found[1]} = {value!r}{found[2]}", text)
        assert count == 1, name
    return text


def _columns(mapping: LogMapping, robot: Robot) -> dict[str, object]:
    """Return the module's constants that follow from a mapping, by their names."""
    drive, sources, n = mapping.input, mapping.sources, robot.wheel_count
    imu = mapping.attitude or AttitudeTable(sources=ATTITUDE_NAMES, sequence="XYZ")
    angles, gyro = (IMU_NAMES[:3], IMU_NAMES[3:]) if mapping.attitude else (ATTITUDE_NAMES, _GYRO_NAMES)
    wheels, torques = wheel_angle_names(n), torque_names(n)
    needed = {"[wheels] angle": wheels, "the IMU's rates": gyro, "its angles": angles[:2], "[input]": torques}
    for table, names in needed.items():
        if missing := [name for name in names if name not in sources or not sources[name].factor]:
            raise InputError(f"The loop needs {table}; the mapping lacks {', '.join(missing)}.")
    assert drive is not None
    gear_ratio, own = getattr(drive, "gear_ratio", robot.drive.gear_ratio), robot.drive.gear_ratio
    if len(drive.sources) != n or abs(gear_ratio / own - 1.0) > _LARGEST_DIFFERENCE:
        raise InputError(
            f"The mapping is of another robot: it has {len(drive.sources)} motors of gear ratio {gear_ratio:g}, "
            f"and {robot.name!r} has {n} of {own:g}."
        )

    def columns(names: Sequence[str], unit: float = 1.0) -> tuple[tuple[str, float, float], ...]:
        found = [sources[name] for name in names if name in sources]
        return tuple((source.column, source.factor / unit, source.offset / unit + 0.0) for source in found)

    step = encoder_step(robot)
    quaternion = tuple((name, 1.0, 0.0) for name in imu.quaternion)
    resistance = motor_resistance(mapping, robot)
    by_command, by_speed = drive.torque(np.array([1.0, 0.0]), np.array([0.0, 1.0]), resistance).tolist()
    read = (*columns(wheels), *columns(gyro), *(quaternion or columns(angles)))
    constants: dict[str, object] = {
        "COLUMNS": tuple(name for name, _, _ in read),
        "TIME_UNIT": sources["t"].factor,
        "WHEELS": columns(wheels, step),
        "WRAP": abs(sources["wheel1"].factor / step) * (mapping.wheels.angle.wrap or 0.0),
        "GYRO": columns(gyro),
        "QUATERNION": quaternion,
        "ATTITUDE": columns(angles),
        "SEQUENCE": imu.sequence,
        "TURN": math.radians(imu.turn),
        "UPSIDE_DOWN": imu.upside_down,
        "MOTORS": columns(torques),
        "DIRECTIONS": tuple(filter(None, (sources[name].direction for name in torques))),
        "PER_TORQUE": 1.0 / by_command,
        "PER_SPEED": 0.0 - step * by_speed / by_command,
    }
    if isinstance(drive, DutyTable):
        constants |= {"DEAD_BAND": drive.dead_band or 0.0, "LIMIT": drive.duty_limit}
    return constants
