"""The whole firmware on a board under QEMU: the bits of this computer, and it balances the twin."""

from __future__ import annotations

import math
import os
import signal
import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ballbot import Controller, InputError, Model, simulate
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.references import circle
from ballbot.control.safety import SafetyLimits
from ballbot.estimation import named_estimator
from ballbot.firmware.build import compilers
from ballbot.firmware.export import export_controller
from ballbot.firmware.processor_load import readings
from ballbot.firmware.records import READING, SelfTestOutcome, parameter_record
from ballbot.link.emulated import CompiledRobot, EmulatedRobot
from ballbot.link.lock_step import LockStep, sensors_of
from ballbot.link.messages import Capability, Result, State
from ballbot.link.session import Session
from ballbot.link.transport import LinkError, Transport
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin import Twin
from campaigns.board import board_log, courses, pairs_needed, python_log
from tests.link.test_faults import FAULTS, Recording, drive
from tests.support.board_controller import FirmwareController, ReadingTap
from tests.support.compiled_firmware import Firmware
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
def controller_of(name: str) -> Controller:
    """Return the nominal or the precise controller."""
    return (
        precise_controller(ROBOT) if name == "precise" else nominal_controller(ROBOT, compensation="partial")
    )


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    """Return a function that builds the board's program, each once."""
    folder = tmp_path_factory.mktemp("boards")

    @cache
    def built(name: str, toolchain: str = "", *, self_test: bool = False, silence: float = SILENCE) -> Path:
        if toolchain and toolchain not in toolchains():
            pytest.skip(f"the toolchain {toolchain} is not installed")
        image = folder / f"{name}-{toolchain}-{self_test}-{silence:g}.elf"
        files = export_controller(controller_of(name)).files
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
    with QemuBoard(images("precise", toolchain, self_test=True)) as board:
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
    parameters = parameter_record(controller_of("precise"), SafetyLimits.on_robot(ROBOT, sample_time=H))
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
    with QemuBoard(images("precise", self_test=True)) as board:
        line = Recorded(BoardLine(board))
        robot = Recording(EmulatedRobot(plant, line, sample_time=H))
        drive(FaultyTransport(robot, FAULTS[kind], seed=1), robot, seed=1)
    assert any(enabled for _, enabled, _, _ in robot.motors)
    assert robot.motors[-1][1:3] == (0, 0)
    assert not any(robot.motors[-1][3])
    assert len(line.read_bytes) > 10_000
    assert of_this_computer(line.written)[: len(line.read_bytes)] == line.read_bytes


def reading_of(state: State) -> np.ndarray:
    """Return the reading that a state was made from."""
    record = np.zeros(1, READING.dtype("single"))
    for name in ("encoders_valid", "wheel_counts", "wheel_speeds", "gyro", "attitude"):
        record[name] = getattr(state, name)
    record["fix_position"], record["fix_heading"] = np.nan, np.nan
    return record


@pytest.mark.parametrize("name", ["nominal", "precise"])
def test_torques_are_bit_for_bit_those_of_the_library_on_this_computer(images, name):
    """The law, estimator and safety layer alone, called with the readings that the board reports."""
    controller = controller_of(name)
    here = Firmware(parameter_record(controller, SafetyLimits.on_robot(ROBOT, sample_time=H)))
    here.skip_self_test()
    with QemuBoard(images(name)) as board:
        line = LockStep(BoardLine(board), sample_time=H)
        session = Session(line, clock=line.clock)
        session.connect()
        assert session.arm(lambda: True) is Result.OK
        assert here.arm()
        compared = 0
        for k, reading in enumerate(readings(ROBOT, samples=200)):
            line.sensors = sensors_of(reading, robot=ROBOT)
            session.set_reference(np.array([0.001 * k, 0.3, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0]))
            motors = line.step()
            session.poll()
            state = session.state
            assert state is not None
            torques = here.update(reading_of(state), state.time % 2**32, state.reference.astype(np.float64))
            assert torques.tobytes() == motors.torques[:3].tobytes() == state.torques[:3].tobytes(), k
            assert here.estimate.tobytes() == state.estimate.tobytes()
            compared += bool(torques.any())
            assert state.stop == 0
        assert compared > 150


@pytest.mark.parametrize("name", ["nominal", "precise"])
def test_firmware_on_the_board_balances_the_twin_as_python_does(images, name):
    """The square, its first 6 s: the same torques at first, and places that rounding has not yet driven apart."""
    controller = controller_of(name)
    course = courses()["square"]
    of_board = board_log(images(name), controller, course, seed=300, duration=6.0)
    of_python = python_log(controller, course, seed=300, duration=6.0)
    assert of_board.ended is None
    assert len(of_board) == len(of_python) == 1200
    # float32 against float64; the bound is that of the firmware's numbers (campaigns/firmware_numbers.py)
    first = np.abs(of_board.torques[:3] - of_python.torques[:3]).max()
    assert first < 1e-5 * controller.torque_limit
    # measured: 0.8 mm and 5 cm within 8 s of this seed; the nominal controller wanders by centimetres
    apart = np.hypot(of_board["true_x"] - of_python["true_x"], of_board["true_y"] - of_python["true_y"]).max()
    assert apart < (0.01 if name == "precise" else 0.15)


def test_firmware_that_ran_is_not_run_again_and_needs_the_tap(images):
    with QemuBoard(images("precise")) as board:
        tap = ReadingTap(named_estimator("kalman", ROBOT, sample_time=H))
        firmware = FirmwareController(BoardLine(board), tap, robot=ROBOT, sample_time=H)
        with pytest.raises(InputError, match="must be the firmware controller's tap"):
            firmware.update(0.0, np.zeros(10), np.zeros(10))
        log = simulate(Twin(ROBOT, estimator=tap), firmware, circle(radius=0.5, period=8.0), duration=0.1)
        assert len(log) == 20
        with pytest.raises(InputError, match="start another emulated robot"):
            simulate(Twin(ROBOT, estimator=tap), firmware, circle(radius=0.5, period=8.0), duration=0.1)


def test_board_without_samples_disarms_by_its_own_timer(images):
    with QemuBoard(images("precise", silence=0.5)) as board:
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


def test_board_that_has_gone_ends_the_link(images):
    board = QemuBoard(images("precise"))
    line = BoardLine(board)
    os.killpg(board._process.pid, signal.SIGKILL)
    with pytest.raises(LinkError, match="The board has gone"):
        line.read(PATIENCE)
    line.close()
    assert not board.running


def test_pairs_that_an_interval_needs():
    differences = np.random.default_rng(1).normal(0.0, 5e-3, 30)
    differences *= 5e-3 / differences.std(ddof=1)
    # Student's half width t s / sqrt(n) for n = 99 and 98 with s = 5 mm, t from a table: 1.984 and 1.985
    assert 1.984 * 5.0 / math.sqrt(99) < 1.0 < 1.985 * 5.0 / math.sqrt(98)
    assert pairs_needed(differences) == 99
