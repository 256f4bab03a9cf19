"""Emulated robots: the firmware runs in lock-step with a plant, behind a transport.

    robot = EmulatedRobot(plant, CompiledRobot(parameters), sample_time=0.005)
    session = Session(robot, clock=robot.clock)

The firmware is the whole program of a robot: link, estimator, control law, safety layer and `robot.c`, compiled for
this computer. Only sensors and motors are replaced: each step takes a sample of the sensors with its time, which is
the robot's clock, obeys what the host has sent before, and returns the torques. Equal plants, seeds and bytes of the
host therefore give equal runs, bit for bit, however fast the computer is.

Until it is armed, a hand holds the robot (`ballbot.simulation.held_robot`), so that the self-test can turn its wheels.
When it is armed the hand lets go, and the plant starts; when it stops or falls, the hand holds it again.
"""

from __future__ import annotations

import ctypes
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.control.presets import nominal_controller
from ballbot.errors import InputError
from ballbot.firmware.build import shared_library, source_files
from ballbot.firmware.estimators import whole_counts
from ballbot.firmware.export import PROJECT, export_controller
from ballbot.firmware.records import PARAMETERS
from ballbot.records import MAX_WHEELS
from ballbot.robot import Robot
from ballbot.simulation.held_robot import HeldRobot, Hold
from ballbot.simulation.plant import Plant
from ballbot.twin.scenario import Scenario
from ballbot.workflows.courses import PlantName
from ballbot.workflows.grid import LoopRobot, TwinRobot

#: the hardware of emulated robots, in C
HARDWARE = Path(__file__).parents[1] / "firmware" / "emulated"
_ROOM = 8192


@dataclass(frozen=True, kw_only=True, eq=False)
class Motors:
    """What an emulated robot commands its motors after a sample."""

    time: int  #: of the sample [us], modulo 2^32
    enabled: bool
    armed: bool  #: whether it balances, or follows torques of the host
    torques: NDArray[np.float32]  #: (MAX_WHEELS,) [N m]; zero while the motors are disabled


class EmulatedRobot:
    """A plant and the firmware that drives it, behind a transport for the host.

    Reading lets the robot run: `read` takes at least one sample, and more until the robot has sent something or
    `timeout` of the robot's time is over. So a host that waits does not wait for ever.
    """

    def __init__(
        self,
        plant: Plant,  # the robot when nobody holds it: a model, the twin, your own
        firmware: CompiledRobot,
        *,
        sample_time: float,  # of the firmware [s]
        seed: int = 0,  # of everything random in the plant
        hand: HeldRobot | None = None,  # the robot while it is held; by default upright on its ball
        always_held: bool = False,  # never let the robot go: for a sweep of its free wheels, and upside down
        # wait so that the robot runs no faster than the clock on the wall. A late sample slows the robot's clock down;
        # it is not caught up, because the host would then be silent for too many samples.
        real_time: bool = False,
    ) -> None:
        self.plant = plant
        self.firmware = firmware
        self.motors: Motors | None = None  #: what the robot commanded last
        self._sample_time = sample_time
        self._samples = 0
        self._seed = seed
        self._always_held = always_held
        self._due = time.monotonic() if real_time else None  # when the next sample is
        self.hand = HeldRobot(plant.robot) if hand is None else hand  #: that holds the robot
        if not always_held:  # the first sample loads compiled code, for longer than a host waits
            plant.reset(None, seed=seed)
            plant.step(np.zeros(plant.robot.wheel_count), sample_time)
        self._held, self._caught = True, False
        self._measured = self.hand.reset(seed=seed)
        self._turned = np.zeros(plant.robot.wheel_count)  # wheel angles when the present plant began

    def clock(self) -> float:
        """Return the robot's time [s]."""
        return self._samples * self._sample_time

    def read(self, timeout: float) -> bytes:
        """Let the robot run until it has sent something, and return that; b"" after `timeout` [s] of its time."""
        end = self.clock() + timeout
        self._sample()
        while not (sent := self.firmware.take()) and self.clock() < end - 0.5 * self._sample_time:
            self._sample()
        return sent

    def write(self, data: bytes) -> None:
        """Send bytes to the robot, which takes them with its next sample."""
        self.firmware.put(data)

    def close(self) -> None:
        """Do nothing: there is nothing to close."""

    def _sample(self) -> None:
        """Let the robot take one sample, and hold its torques until the next."""
        if self._due is not None:
            late = time.monotonic() - self._due
            time.sleep(max(0.0, -late))
            self._due += self._sample_time + (late if late > self._sample_time else 0.0)
        self._samples += 1
        measured, robot = self._measured, self.plant.robot
        attitude = measured.state[2:5] if measured.attitude is None else measured.attitude
        self.motors = self.firmware.step(
            round(1e6 * self.clock()) % 2**32,
            imu=np.concatenate([measured.gyro, attitude]),
            # the encoders go on counting when the plant changes
            counts=whole_counts(self._turned + measured.wheel_angles, robot=robot)
            if np.isfinite(measured.wheel_angles).all()
            else None,
        )
        self._let_go_or_hold(self.motors)
        plant = self.hand if self._held else self.plant
        torques = self.motors.torques[: plant.robot.wheel_count].astype(np.float64)
        self._measured = plant.step(torques, self._sample_time)

    def _let_go_or_hold(self, motors: Motors) -> None:
        """Let the robot go when it is armed; hold it again when it is not, or has fallen."""
        fallen = not self._held and self._measured.ended is not None
        self._caught = motors.armed and (self._caught or fallen)
        held = not motors.armed or self._caught or self._always_held
        if held == self._held:
            return
        self._turned = self._turned + np.nan_to_num(self._measured.wheel_angles)
        start = np.zeros(10)
        start[[0, 1, 4]] = self._measured.truth[[0, 1, 4]]
        self._held, self._seed = held, self._seed + 1
        plant = self.hand if held else self.plant
        self._measured = plant.reset(start, seed=self._seed)


def emulated_robot(
    robot: Robot,  # as its firmware knows it
    scenario: Scenario,  # true friction, sensors and play
    *,
    plant: PlantName = "model",  # its body: the equations of motion, or the physics engine
    hold: Hold = "on_ball",  # how it is held; in the air and upside down it stays so when it arms
    seed: int = 0,
    real_time: bool = False,  # as for `EmulatedRobot`
    imu_checked: bool = True,  # whether the axes of the IMU count as checked
    weights: str = "",  # the header of a policy that the host will send (`ballbot.firmware.export.Export.weights`)
) -> EmulatedRobot:
    """Return an emulated robot with the nominal controller.

    InputError if there is no compiler, the twin is not installed, or the scenario's IMU has no noise.
    """
    if not (scenario.sensors.gyro_noise or scenario.sensors.attitude_noise):
        raise InputError(
            "The scenario's IMU has no noise, so that its values repeat while the robot stands, and the firmware stops "
            "as for a broken sensor. Take another scenario, such as nominal, or give gyro_noise and attitude_noise."
        )
    controller = nominal_controller(robot)
    loop = LoopRobot.of(robot.replace(friction=scenario.friction), scenario, known=robot)
    body = TwinRobot(robot=robot, scenario=scenario, known=robot) if plant == "twin" else loop
    return EmulatedRobot(
        body("onboard"),
        CompiledRobot(export_controller(controller).parameters, imu_checked=imu_checked, weights=weights),
        sample_time=controller.sample_time,
        seed=seed,
        hand=HeldRobot(
            loop.model.robot, sensors=scenario.sensors, hold=hold, torque_noise=scenario.torque_noise
        ),
        always_held=hold != "on_ball",
        real_time=real_time,
    )


class CompiledRobot:
    """The program of a robot, compiled for this computer.

    InputError if there is no C compiler, or the parameters are not those of the library.
    """

    def __init__(
        self,
        parameters: NDArray[np.void],  # (1,) Of `ballbot.firmware.records.PARAMETERS` in single precision
        *,
        capabilities: int = 0,  # bits of `Capability`
        # whether the axes of the IMU count as checked; if not, the first self-test checks them
        imu_checked: bool = True,
        starts: int = 0,  # number of this start, as `robot_start` in C takes it
        weights: str = "",  # the header of a policy's weights; none by default
    ) -> None:
        self._functions = _program(weights)
        self._memory = np.zeros(self._functions.emulated_robot_size(), dtype=np.uint8)
        self._parameters = np.ascontiguousarray(parameters, PARAMETERS.dtype("single"))
        memory, record = self._memory.ctypes.data, self._parameters.ctypes.data
        if not self._functions.emulated_robot_start(memory, record, capabilities, starts):
            raise InputError("The firmware does not know these parameters: they are of another version.")
        if not imu_checked:
            self._functions.emulated_robot_mount(self._memory.ctypes.data)

    def step(self, time: int, *, imu: NDArray[np.float64], counts: NDArray[np.int32] | None) -> Motors:
        """Take one sample at a time [us] modulo 2^32, and return what the robot commands its motors.

        The IMU gives gyro [rad/s] and attitude [rad], (6,). If one of these is not finite, all of it is invalid, as by
        a checksum. The counts of the encoders (n,) are None if they give nothing.
        """
        shown = np.ascontiguousarray(imu, np.float32) if np.isfinite(imu).all() else None
        counted = None if counts is None else np.concatenate([counts, np.zeros(MAX_WHEELS, np.int32)])
        torques = np.zeros(MAX_WHEELS, np.float32)
        sensed = (None if array is None else array.ctypes.data for array in (shown, counted))
        bits = self._functions.emulated_robot_step(
            self._memory.ctypes.data, time, *sensed, torques.ctypes.data
        )
        return Motors(time=time, enabled=bool(bits & 1), armed=bool(bits & 2), torques=torques)

    def put(self, data: bytes) -> None:
        """Let the host send bytes."""
        self._functions.emulated_robot_put(self._memory.ctypes.data, data, len(data))

    def take(self) -> bytes:
        """Return what the robot has sent to the host."""
        room = ctypes.create_string_buffer(_ROOM)
        count = self._functions.emulated_robot_take(self._memory.ctypes.data, room, _ROOM)
        return room.raw[:count]

    def press_button(self) -> None:
        """Press the robot's button that lets a host arm it."""
        self._functions.emulated_robot_confirm(self._memory.ctypes.data)


@cache
def _program(weights: str) -> ctypes.CDLL:
    """Return the compiled program with a header of weights, once for this process."""
    sources = [*source_files(), PROJECT / "robot.c", *sorted(HARDWARE.glob("*.c"))]
    functions = shared_library("emulated", sources, include=(PROJECT, HARDWARE), weights=weights)
    pointer, size, number = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_uint32
    for name, result, arguments in (
        ("size", size, ()),
        ("start", ctypes.c_bool, (pointer, pointer, ctypes.c_int32, number)),
        ("mount", None, (pointer,)),
        ("step", ctypes.c_int32, (pointer, number, pointer, pointer, pointer)),
        ("put", None, (pointer, ctypes.c_char_p, size)),
        ("take", size, (pointer, ctypes.c_char_p, size)),
        ("confirm", None, (pointer,)),
    ):
        function = getattr(functions, f"emulated_robot_{name}")
        function.restype, function.argtypes = result, arguments
    return functions
