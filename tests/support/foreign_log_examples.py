"""Logs as other people's robots write them, made from a simulated run whose truth is known."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ballbot import Controller, Log, Model, simulate
from ballbot.control.presets import nominal_controller
from ballbot.log import STATE_NAMES
from ballbot.robot import Friction, Robot

MESSAGES = 0.005  #: the robot sends so often [s]
POLL = 0.0115  #: and the host logs the latest message so often [s]
SENSOR_DELAY, COMMAND_DELAY = 0.0175, 0.010  #: [s]


@cache
def small_robot() -> Robot:
    """Return the course's robot with about the friction that its logs show: light, and busy at some hertz."""
    friction = Friction(
        viscous=(0.02, 0.02, 0.02),
        coulomb=(0.1, 0.12, 0.1),
        stribeck=(0.0, 0.0, 0.0),
        stribeck_speed=1.0,
        stribeck_exponent=1.0,
        rolling=0.01,
    )
    return Robot.load("rob311").replace(friction=friction)


@cache
def swaying_log(*, heading: float = 0.6, duration: float = 30.0) -> Log:
    """Return a run of the small robot that sways in all directions and turns its heading to and fro."""

    def reference(t: float) -> np.ndarray:
        r = np.zeros(10)
        r[0], r[1] = 0.25 * np.sin(1.3 * t), 0.25 * np.sin(1.9 * t + 1.0)
        r[4] = heading * np.sin(1.1 * t)
        return r

    robot = small_robot()
    return simulate(Model(robot), Dithered(nominal_controller(robot)), reference, duration=duration)


class Dithered:
    """A controller with noise on its torques, without which no log separates a command's delay from the lean's."""

    def __init__(self, controller: Controller) -> None:
        self.controller, self.sample_time = controller, controller.sample_time
        self.random = np.random.default_rng(7)

    def reset(self) -> None:
        self.controller.reset()

    def update(self, t: float, state: np.ndarray, reference: np.ndarray) -> np.ndarray:
        noise = 0.15 * self.random.standard_normal(
            3
        )  # [N m]; its mean is a push along the way or of the heading
        return self.controller.update(t, state, reference) + noise


@dataclass(frozen=True, kw_only=True)
class Habits:
    """How a team writes its logs."""

    order: tuple[int, ...] = (1, 2, 3)  #: the file's wheels in turn are these of the robot
    signs: tuple[int, ...] = (1, 1, 1)  #: of the file's wheels
    turn: float = 0.0  #: of the IMU's x axis from the robot's [rad]
    pitch_sign: int = 1
    degrees: bool = True
    counts: bool = False
    full_duty: float = 1.0
    command_sign: int = 1
    yaw: bool = True
    names: tuple[str, ...] | None = None  #: None: as the course's; () for no header
    separator: str = " "


def columns_of(log: Log, habits: Habits) -> dict[str, np.ndarray]:
    """Return the columns that a host would log, by the course's names."""
    robot = small_robot()
    host = np.arange(0.5, log.t[-1] - 0.5, POLL)
    host = host + 2e-4 * np.random.default_rng(3).standard_normal(len(host))
    sent = MESSAGES * np.floor(host / MESSAGES)

    def at(times: np.ndarray, values: np.ndarray) -> np.ndarray:
        return np.column_stack([np.interp(times, log.t, column) for column in values.T])

    states = np.column_stack([log[name] for name in STATE_NAMES])
    body = Rotation.from_euler("XYZ", states[:, 2:5])
    yaw, pitch, roll = (body * Rotation.from_euler("z", habits.turn)).as_euler("ZYX").T
    attitude = at(sent - SENSOR_DELAY, np.column_stack([roll, habits.pitch_sign * pitch, np.unwrap(yaw)]))
    attitude += 5e-4 * np.random.default_rng(4).standard_normal(attitude.shape)  # an IMU's noise

    places = [wheel - 1 for wheel in habits.order]
    turn = robot.sensors.encoder_counts * robot.drive.gear_ratio
    counts = np.round(at(sent, log.wheel_angles)[:, places] * turn / (2.0 * np.pi)) * habits.signs
    wheels = counts if habits.counts else counts * (2.0 * np.pi / turn)

    duty = at(host + COMMAND_DELAY, duties(log))[:, places] * habits.command_sign * habits.full_duty
    columns = {"i": np.arange(len(host)), "t_now": host}
    columns |= {f"u{k}": duty[:, k - 1] for k in (1, 2, 3)}
    lean = np.degrees(attitude) if habits.degrees else attitude
    columns |= {"theta_x": lean[:, 0], "theta_y": lean[:, 1]}
    if habits.yaw:
        columns["theta_z"] = lean[:, 2]
    return columns | {f"psi_{k}": wheels[:, k - 1] for k in (1, 2, 3)}


def duties(log: Log) -> np.ndarray:
    """Return the duties (N, 3) behind the torques of a DC motor whose standstill torque is the robot's torque limit."""
    drive = small_robot().drive
    resistance = drive.gear_ratio * drive.torque_constant * drive.supply_voltage / drive.torque_limit
    current = log.torques / (drive.gear_ratio * drive.torque_constant)
    back_emf = drive.gear_ratio * log.wheel_speeds / drive.speed_constant
    return (current * resistance + back_emf) / drive.supply_voltage


def write_foreign(path: Path, columns: dict[str, np.ndarray], habits: Habits, *, tail: str = "") -> Path:
    """Write columns as text, with a blank at each line's end as the course's logger does."""
    names = tuple(columns) if habits.names is None else habits.names
    rows = np.column_stack(list(columns.values())).tolist()
    mark = habits.separator
    lines = [mark.join(names)] if names else []
    lines += [mark.join(map(repr, row)) + (" " if mark == " " else "") for row in rows]
    path.write_text("\n".join(lines) + "\n\n" + tail)
    return path
