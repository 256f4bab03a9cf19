"""The whole firmware on a board under QEMU: the bits of this computer."""

from __future__ import annotations

import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ballbot import Controller, Model
from ballbot.control.presets import precise_controller
from ballbot.control.safety import SafetyLimits
from ballbot.firmware.build import compilers
from ballbot.firmware.export import export_controller
from ballbot.firmware.processor_load import readings
from ballbot.firmware.records import SelfTestOutcome, parameter_record
from ballbot.link.emulated import CompiledRobot, EmulatedRobot
from ballbot.link.lock_step import LockStep, sensors_of
from ballbot.link.messages import Capability, Result
from ballbot.link.session import Session
from ballbot.link.transport import Transport
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.sensed_plant import SensedPlant
from tests.link.test_faults import FAULTS, Recording, drive
from tests.support.control_examples import FRICTION, alten
from tests.support.faulty_transport import FaultyTransport
from tests.support.processes import PATIENCE
from tests.support.qemu import SILENCE, BoardLine, QemuBoard, build_board, toolchains, what_to_install

pytestmark = [
    pytest.mark.board,
    pytest.mark.skipif(bool(what_to_install()), reason=what_to_install() or "all is installed"),
    pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)"),
]

ROBOT, H = alten(FRICTION), 0.005
TOOLCHAINS = ("gcc", "zig")


@cache
def controller() -> Controller:
    return precise_controller(ROBOT)


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    """Return a function that builds the board's program, each once."""
    folder = tmp_path_factory.mktemp("boards")

    @cache
    def built(toolchain: str = "", *, self_test: bool = False, silence: float = SILENCE) -> Path:
        if toolchain and toolchain not in toolchains():
            pytest.skip(f"the toolchain {toolchain} is not installed")
        image = folder / f"{toolchain}-{self_test}-{silence:g}.elf"
        files = export_controller(controller()).files
        build_board(files, image, toolchain=toolchain or None, self_test=self_test, silence=silence)
        return image

    return built


class Recorded:
    """A transport that keeps what went through it."""

    def __init__(self, line: Transport) -> None:
        self.line, self.read_bytes, self.written = line, b"", b""

    def read(self, timeout: float) -> bytes:
        data = self.line.read(timeout)
        self.read_bytes += data
        return data

    def write(self, data: bytes) -> None:
        self.written += data
        self.line.write(data)

    def close(self) -> None:
        self.line.close()


@pytest.mark.parametrize("toolchain", TOOLCHAINS)
def test_board_answers_with_the_bytes_of_this_computer(images, toolchain):
    """Handshake, self-test, arming and balancing: every byte that the board sends is that of the compiled program."""
    plant = SensedPlant(Model(ROBOT), Imperfections(sensors=ROBOT.sensors), estimator="kalman")
    with QemuBoard(images(toolchain, self_test=True)) as board:
        line = Recorded(BoardLine(board))
        robot = EmulatedRobot(plant, line, sample_time=H)
        session = Session(robot, clock=robot.clock)
        session.connect()
        assert session.self_test() is SelfTestOutcome.PASSED
        assert session.arm(lambda: True) is Result.OK
        for k in range(100):
            session.set_reference(np.array([0.002 * k, *np.zeros(9)]))
            session.poll(H)
        assert session.state is not None
        assert session.state.armed
        assert session.state.stop == 0
    assert len(line.read_bytes) > 10_000
    assert of_this_computer(line.written)[: len(line.read_bytes)] == line.read_bytes


def of_this_computer(written: bytes) -> bytes:
    """Return what the precise controller's firmware, compiled for this computer, answers to the same bytes."""
    parameters = parameter_record(controller(), SafetyLimits.on_robot(ROBOT, sample_time=H))
    here = CompiledRobot(parameters, capabilities=Capability.EMULATED)
    answers = b""
    for place in range(0, len(written), 50):
        here.write(written[place : place + 50])
        answers += here.read(0.0)
    return answers


@pytest.mark.parametrize("kind", ["corrupted", "all"])
def test_board_on_a_faulty_link_does_what_this_computer_does_and_ends_safe(images, kind):
    """On this computer no frame that fails a layer is acted on (`test_faults.py`)."""
    plant = SensedPlant(Model(ROBOT), Imperfections(sensors=ROBOT.sensors), estimator="kalman")
    with QemuBoard(images(self_test=True)) as board:
        line = Recorded(BoardLine(board))
        robot = Recording(EmulatedRobot(plant, line, sample_time=H))
        drive(FaultyTransport(robot, FAULTS[kind], seed=1), robot, seed=1)
    assert any(enabled for _, enabled, _, _ in robot.motors)
    assert robot.motors[-1][1:3] == (0, 0)
    assert not any(robot.motors[-1][3])
    assert len(line.read_bytes) > 10_000
    assert of_this_computer(line.written)[: len(line.read_bytes)] == line.read_bytes


def test_board_without_samples_disarms_by_its_own_timer(images):
    with QemuBoard(images(silence=0.5)) as board:
        line = LockStep(BoardLine(board), sample_time=H)
        line.sensors = sensors_of(next(readings(ROBOT, samples=1)), robot=ROBOT)
        session = Session(line, clock=line.clock)
        session.connect()
        end = time.monotonic() + PATIENCE
        enabled = False
        while (
            not enabled
        ):  # again if this computer was so busy that the board disarmed before its second sample
            assert time.monotonic() < end, f"the board is not armed within {PATIENCE:g} s"
            assert session.arm(lambda: True) is Result.OK
            enabled = bool(line.step().enabled)
        time.sleep(1.0)  # of the board's time as of this computer's
        motors = line.step()
        assert not motors.enabled
        assert not motors.torques.any()
