"""The control loop of one robot: a reading in, the motors' command out, computed as on a board.

    from ballbot_loop import SAMPLE_TIME, Loop

    loop = Loop()
    loop.start_self_test()                              # README.md says how to hold the robot
    loop.arm()                                          # upright, when loop.self_test is "passed"
    command = loop.update(time, reading, reference)     # every SAMPLE_TIME

`reading` has a number for each of `COLUMNS`, None for a missing one, and `command` one for each motor: columns of the
robot's logs, in their units, signs and order. The first import compiles the C sources in `src`.

Written by `ballbot export --python`; needs Python 3.9 and a C compiler, `cc`.
"""

from __future__ import annotations

import ctypes
import hashlib
import math
import os
import subprocess
import sysconfig
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Optional

Reading = Mapping[str, Optional[float]]  # a number by column, None if it is missing
Column = tuple[str, float, float]  # of the log, factor and offset: value = factor * cell + offset

COLUMNS: tuple[str, ...] = ()  # of a reading
SAMPLE_TIME: float = 0.005  # [s]
TIME_UNIT: float = 1.0  # [s], of the times that `update` takes
SELF_TEST: tuple[str, ...] = ()  # what `Loop.self_test` can be
WHEELS: tuple[Column, ...] = ()  # angles [counts of the encoders]
WRAP: float = 0.0  # [counts] after which they begin again; 0 if they do not
GYRO: tuple[Column, ...] = ()  # [rad/s], about the IMU's axes
QUATERNION: tuple[Column, ...] = ()  # w, x, y, z, of which the attitude is made
ATTITUDE: tuple[Column, ...] = ()  # [rad] of the IMU about x, y and z; without the last, the gyro gives it
SEQUENCE: str = "XYZ"  # of the turns about these axes
TURN: float = 0.0  # [rad] of the IMU's x axis from the robot's, towards the left
UPSIDE_DOWN: bool = False  # whether the IMU is
MOTORS: tuple[Column, ...] = ()  # commands
DIRECTIONS: tuple[str, ...] = ()  # columns of their directions, if the commands are magnitudes
PER_TORQUE: float = 1.0  # command for a torque at the wheel [1/(N m)]
PER_SPEED: float = 0.0  # command that overcomes the back-EMF [s/count]
DEAD_BAND: float = 0.0  # that the motors' board adds to a command
LIMIT: float = math.inf  # of a command with the dead band

#: of the compiler; with -ffp-contract=off every processor computes the same numbers
OPTIONS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared")


def _library() -> ctypes.CDLL:
    """Return the compiled sources, from a file beside this one if it was compiled from the same."""
    folder = Path(__file__).resolve().parent
    digest = hashlib.sha256(repr((OPTIONS, sysconfig.get_platform())).encode())
    for path in sorted(folder.glob("src/**/*.[ch]")):
        digest.update(path.read_bytes())
    target = folder / f"ballbot_loop-{digest.hexdigest()[:16]}.so"
    if not target.exists():
        with tempfile.TemporaryDirectory(dir=folder) as room:
            made = Path(room) / target.name
            command = ["cc", *OPTIONS, f"-I{folder / 'src'}", *folder.glob("src/**/*.c"), "-o", made]
            try:
                done = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False)
            except FileNotFoundError:
                raise ImportError("ballbot_loop needs a C compiler: there is no `cc`; install gcc.") from None
            if done.returncode:
                raise ImportError(f"cc refuses the sources of ballbot_loop: {done.stderr.strip()}")
            os.replace(made, target)  # at once: another process may look for it
    return ctypes.CDLL(str(target))


_C = _library()
_C.ballbot_loop_size.restype = ctypes.c_size_t
_C.ballbot_loop_start.restype = _C.ballbot_arm.restype = _C.ballbot_is_active.restype = ctypes.c_bool
_C.ballbot_stop_word.restype = ctypes.c_char_p


class Loop:
    """Self-test, filter, control law, limits and stops of the robot. It starts disarmed."""

    def __init__(self) -> None:
        self._memory = ctypes.create_string_buffer(_C.ballbot_loop_size())
        self._time, self._counted, self._heading = math.nan, math.nan, 0.0
        self._last, self._speeds = list[float](), [0.0] * len(WHEELS)
        if not _C.ballbot_loop_start(self._memory):
            raise RuntimeError("The library does not allow these parameters; export the controller again.")

    def start_self_test(self) -> None:
        """Let the next updates be a self-test: the first that of the IMU, the next that of the motors."""
        _C.ballbot_start_self_test(self._memory)

    def skip_self_test(self) -> None:
        """Count the self-test as passed: for a simulated robot, or if nothing was changed since it passed."""
        _C.ballbot_skip_self_test(self._memory)

    def arm(self) -> bool:
        """Forget a stop, and balance from the next update on; return False unless the self-test has passed."""
        return _C.ballbot_arm(self._memory)

    def disarm(self) -> None:
        """Command nothing until armed again; end a self-test that is running."""
        _C.ballbot_disarm(self._memory)

    @property
    def active(self) -> bool:
        """Whether the motors are to be enabled: armed without a stop, or a self-test drives them."""
        return _C.ballbot_is_active(self._memory)

    @property
    def stop(self) -> str:
        """Why the robot was stopped, such as "lean"; "" if it was not."""
        return _C.ballbot_stop_word(_C.ballbot_stop_of(self._memory)).decode()

    @property
    def self_test(self) -> str:
        """What the self-test waits for, or its result, such as "tilt forward" or "dead motor"."""
        return SELF_TEST[_C.ballbot_self_test_of(self._memory)]

    @property
    def wheel(self) -> int:
        """The wheel, from 1, that a stop or the self-test's result is about; 0 if it is about none."""
        return _C.ballbot_loop_wheel(self._memory)

    def update(self, time: float, reading: Reading, reference: Sequence[float] = ()) -> dict[str, float]:
        """Take the sample of a time; return the motors' command.

        The reference is x, y, theta, phi, psi and their rates [m, rad, s], those that it lacks zero: x, y, 0, 0, psi
        for a place, a row of a plan for a motion. Without one, the last holds.
        """
        passed, self._time = TIME_UNIT * time - self._time, TIME_UNIT * time
        gyro = _values(reading, GYRO)
        if passed > 0.0 and math.isfinite(gyro[2]):
            self._heading += gyro[2] * passed
        imu = (ctypes.c_float * 6)(*_turned(gyro), *_attitude(reading, self._heading))
        wanted = (ctypes.c_float * 10)(*reference) if len(reference) else None
        torques, microseconds = (ctypes.c_float * 4)(), ctypes.c_uint32(round(1e6 * self._time) % 2**32)
        _C.ballbot_loop_update(self._memory, microseconds, self._counts(reading), imu, wanted, torques)
        active, command = self.active, {}
        for i, ((column, factor, offset), torque, speed) in enumerate(zip(MOTORS, torques, self._speeds)):
            value = PER_TORQUE * torque + PER_SPEED * speed if active else 0.0
            cell = math.copysign(max(min(abs(value), LIMIT) - DEAD_BAND, 0.0), value) / factor
            if DIRECTIONS:
                command[DIRECTIONS[i]], cell = float(cell > 0.0), abs(cell)
            command[column] = cell - offset / factor
        return command

    def _counts(self, reading: Reading) -> ctypes.Array[ctypes.c_int32] | None:
        """Return the encoders' counts, None if one is missing; keep the wheels' speeds."""
        counts = _values(reading, WHEELS)
        if not all(map(math.isfinite, counts)):
            return None
        passed, self._counted = self._time - self._counted, self._time
        lasts, self._last = self._last or counts, counts
        if WRAP:
            counts[:] = [now + WRAP * round((last - now) / WRAP) for now, last in zip(counts, lasts)]
        if passed > 0.0:
            self._speeds = [(now - last) / passed for now, last in zip(counts, lasts)]
        return (ctypes.c_int32 * len(counts))(*map(round, counts))


def _values(reading: Reading, columns: Sequence[Column]) -> list[float]:
    """Return a reading's values in SI units, NaN for those that are missing."""
    cells = [(reading[name], factor, offset) for name, factor, offset in columns]
    values = [math.nan if cell is None else factor * cell + offset for cell, factor, offset in cells]
    return [value if abs(value) < 1e30 else math.nan for value in values]


def _turned(vector: Sequence[float]) -> list[float]:
    """Return a vector's components along the robot's axes from those along the IMU's."""
    (x, y, *others), c, s = vector, math.cos(TURN), math.sin(TURN)
    return [c * x - s * y, s * x + c * y, *others] if TURN else [*vector]  # a missing x leaves y


def _attitude(reading: Reading, heading: float) -> tuple[float, float, float]:
    """Return theta, phi and psi [rad], with the gyro's heading if the reading has none."""
    if QUATERNION:
        w, x, y, z = _values(reading, QUATERNION)
        roll = math.atan2(2.0 * (w * x + y * z), w * w - x * x - y * y + z * z)
        ahead, left = w * w + x * x - y * y - z * z, 2.0 * (w * z + x * y)
        pitch = math.atan2(2.0 * (w * y - x * z), math.hypot(ahead, left) or math.nan)  # none of four zeros
        reading = dict(zip((name for name, _, _ in ATTITUDE), (roll, pitch, math.atan2(left, ahead))))
    roll, pitch, yaw = (*_values(reading, ATTITUDE), heading)[:3]
    if SEQUENCE == "XYZ":
        return roll, pitch, yaw - TURN
    roll = roll % (2.0 * math.pi) - math.pi if UPSIDE_DOWN else roll
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(angle), math.cos(angle)) for angle in (roll, pitch, yaw))
    # R_world_body = Rz(yaw) Ry(pitch) Rx(roll) Rz(-turn) = Rx(theta) Ry(phi) Rz(psi)
    x, y, z = *_turned([cy * cp, cy * sp * sr - sy * cr]), cy * sp * cr + sy * sr
    return math.atan2(cy * sr - sy * sp * cr, cp * cr), math.atan2(z, math.hypot(x, y)), math.atan2(-y, x)
