"""Wrong but plausible logs, each made from correct ones."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.control.presets import nominal_controller
from ballbot.control.references import circle, square
from ballbot.log import Log
from ballbot.log.columns import POSITION_NAMES
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.twin import Twin

TORQUES = ("u1", "u2", "u3")
WHEELS = ("wheel1", "wheel2", "wheel3")
SPEEDS = ("wheel1_dot", "wheel2_dot", "wheel3_dot")
GYRO = ("gyro_x", "gyro_y", "gyro_z")
LEAN = ("theta", "phi")
LEAN_RATES = ("theta_dot", "phi_dot")
PLACE = ("x", "y", "x_dot", "y_dot")
DEGREES = 180.0 / np.pi


@dataclass(frozen=True, kw_only=True)
class CorrectLogs:
    """Two runs of the nominal twin."""

    robot: Robot
    log: Log
    other: Log  #: another run of the same robot


def record() -> CorrectLogs:
    """Return logs of 14 s around a square and a circle; the heading turns."""
    robot = Robot.load("alten")
    controller = nominal_controller(robot)
    runs = [
        simulate(Twin(robot), controller, reference, duration=14.0, seed=seed).without_truth()
        for seed, reference in (
            (1, _turning(square(side=0.6, period=12.0))),
            (2, circle(radius=0.4, period=10.0)),
        )
    ]
    return CorrectLogs(robot=robot, log=runs[0], other=runs[1])


def _turning(reference: Callable[[float], NDArray[np.float64]]) -> Callable[[float], NDArray[np.float64]]:
    def turned(t: float) -> NDArray[np.float64]:
        pose = np.array(reference(t))
        pose[4] = 0.8 * np.sin(0.7 * t)
        return pose

    return turned


def clipped(log: Log, share: float, *names: str) -> Log:
    """Return columns cut off at a share of their largest values."""
    peaks = {name: share * np.abs(log[name]).max() for name in names}
    return log.with_columns({name: np.clip(log[name], -peak, peak) for name, peak in peaks.items()})


def scaled(log: Log, factor: float, *names: str) -> Log:
    return log.with_columns({name: factor * log[name] for name in names})


def exchanged(log: Log, *pairs: tuple[str, str]) -> Log:
    return log.with_columns({a: log[b] for pair in pairs for a, b in (pair, pair[::-1])})


def renamed(log: Log, order: Sequence[int], *prefixes: str, suffix: str = "") -> Log:
    """Return the log whose wheel i has what was wheel order[i - 1]'s."""
    return log.with_columns(
        {f"{p}{i}{suffix}": log[f"{p}{k}{suffix}"] for p in prefixes for i, k in enumerate(order, start=1)}
    )


def late(log: Log, delay: float, *names: str) -> Log:
    return log.with_columns({name: np.interp(log.t - delay, log.t, log[name]) for name in names})


def with_time(log: Log, factor: float) -> Log:
    return log.with_columns({"t": factor * log.t})


def frozen(log: Log, start: float, end: float, *names: str) -> Log:
    """Return the log in which columns keep their value from one time to another [s]."""
    rows = np.flatnonzero((log.t >= start) & (log.t < end))
    columns = {name: log[name].copy() for name in names}
    for values in columns.values():
        values[rows] = values[rows[0]]
    return log.with_columns(columns)


def held(log: Log, rows: int, *names: str) -> Log:
    """Return the log in which columns change every so many rows only."""
    source = np.arange(len(log)) // rows * rows
    return log.with_columns({name: log[name][source] for name in names})


def spliced(log: Log, start: float, end: float, *shifted: str) -> Log:
    """Return the log without a stretch [s], its time closed up; of what the stretch changed, only `shifted` stays."""
    first, second = log.between(-1.0, start), log.between(end, 1e9)
    columns = {}
    for name in log:
        after = second[name]
        if name == "t":
            after = after - after[0] + first.t[-1] + log.sample_time
        elif name in POSITION_NAMES and name not in shifted:
            after = after - after[0] + first[name][-1]
        columns[name] = np.concatenate((first[name], after))
    return Log(columns)


def random_torques(log: Log, *names: str) -> Log:
    random = np.random.default_rng(0)
    return log.with_columns({name: 0.5 * random.standard_normal(len(log)) for name in names or TORQUES})


def everything(log: Log) -> tuple[str, ...]:
    return tuple(name for name in log if name != "t" and not name.startswith("ref_"))


def constant(log: Log, value: float, *names: str) -> Log:
    return log.with_columns({name: np.full(len(log), value) for name in names})


def shifted(log: Log, offset: float, *names: str) -> Log:
    return log.with_columns({name: log[name] + offset for name in names})


def rounded(log: Log, step: float, *names: str) -> Log:
    return log.with_columns({name: step * np.round(log[name] / step) for name in names})


def turned_imu(log: Log, angle: float) -> Log:
    """Return the log of an IMU that is mounted turned by an angle [degrees] about the vertical; the gyro left out."""
    turn = np.exp(1j * np.radians(angle))
    columns = {}
    for first, second in (LEAN, LEAN_RATES):
        turned = (log[first] + 1j * log[second]) * turn
        columns |= {first: turned.real, second: turned.imag}
    return Log({name: columns.get(name, log[name]) for name in log if name not in GYRO})


def reversed_rows(log: Log) -> Log:
    return log.with_columns({name: log[name][::-1] for name in log if name != "t"})


def motor_counts(robot: Robot) -> float:
    """Return encoder counts a radian of the wheel."""
    return robot.sensors.encoder_counts * robot.drive.gear_ratio / (2.0 * np.pi)
