"""A serial port: one end of a pseudo terminal, with a robot at the other; bytes that are lost or split."""

import os
import select
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.firmware.build import compilers
from ballbot.firmware.records import SelfTestOutcome
from ballbot.link.messages import AnswerResult, Layer
from ballbot.link.session import Session
from ballbot.link.transport import LinkError, SerialTransport, Transport
from tests.link.test_emulated import H, emulated
from tests.support.processes import PATIENCE

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo terminals are those of POSIX")
needs_compiler = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")

#: what happens to bytes on their way: given what comes, returns what arrives now
Way = Callable[[bytes], bytes]


@contextmanager
def serial_line() -> Iterator[tuple[SerialTransport, int]]:
    """Hold a serial port, and the descriptor of what is at its other end, while the block runs."""
    far, near = os.openpty()
    try:
        port = SerialTransport(os.ttyname(near))
        yield port, far
        port.close()
    finally:
        os.close(near)
        os.close(far)


def arrived(descriptor: int, count: int) -> bytes:
    """Return so many bytes that were sent to the other end."""
    found = b""
    while len(found) < count:
        assert select.select([descriptor], [], [], PATIENCE)[0], f"{count - len(found)} bytes did not come"
        found += os.read(descriptor, count - len(found))
    return found


class Loop:
    """A robot at the other end of a serial port, in the robot's time: a read of the host lets it run."""

    def __init__(self, port: Transport, far: int, *, to_robot: Way = bytes, to_host: Way = bytes) -> None:
        self.robot = emulated()
        self._port, self._far = port, far
        self._to_robot, self._to_host = to_robot, to_host
        self._written = 0

    def read(self, timeout: float) -> bytes:  # noqa: ARG002
        """Let the robot take a sample with what the host wrote, and return what it sent."""
        self.robot.write(self._to_robot(arrived(self._far, self._written)))
        self._written = 0
        sent = self._to_host(self.robot.read(0.0))
        assert os.write(self._far, sent) == len(sent)
        found = b""
        while len(found) < len(sent):
            found += self._port.read(PATIENCE)
        return found

    def write(self, data: bytes) -> None:
        self._port.write(data)
        self._written += len(data)

    def close(self) -> None:
        self._port.close()

    def session(self) -> Session:
        """Return a session with the robot; repeated handshakes make up for what is lost."""
        session = Session(self, clock=self.robot.clock)
        session.connect()
        return session


def split(random: np.random.Generator) -> Way:
    """Bytes come in pieces: some of them now, the rest with the next ones."""
    waiting = b""

    def way(data: bytes) -> bytes:
        nonlocal waiting
        waiting += data
        count = int(random.integers(len(waiting) // 2, len(waiting) + 1))
        now, waiting = waiting[:count], waiting[count:]
        return now

    return way


def lost(random: np.random.Generator) -> Way:
    """One byte of 300 is lost, which breaks its frame."""
    return lambda data: bytes(byte for byte in data if random.uniform() > 1.0 / 300.0)


@needs_compiler
@pytest.mark.parametrize("fault", [split, lost])
def test_robot_balances_over_a_serial_port_whose_bytes_are_split_or_lost(fault):
    to_robot, to_host = (fault(np.random.default_rng([7, way])) for way in range(2))
    with serial_line() as (port, far):
        loop = Loop(port, far, to_robot=to_robot, to_host=to_host)
        session = loop.session()
        assert session.self_test() is SelfTestOutcome.PASSED
        assert session.arm(lambda: True) is AnswerResult.OK
        for k in range(200):
            session.set_reference([1e-4 * k, *np.zeros(9)])
            session.poll(H)
        assert session.state is not None
        assert session.state.armed
        refused = session.ask_counts().refused
        # a byte that is missing breaks a frame, and one whose bytes come apart is whole
        assert (refused.sum() > 0) == (sum(session.counts.refused) > 0) == (fault is lost)
        assert refused[Layer.VALUES] == 0
        session.disarm()
        for _ in range(10):  # a state may be lost or late
            session.poll(H)
        assert not session.state.armed


def test_port_that_has_gone_is_said_so():
    far, near = os.openpty()
    port = SerialTransport(os.ttyname(near))
    os.close(near)
    os.close(far)
    end = time.monotonic() + PATIENCE
    with pytest.raises(LinkError, match="serial port has gone"):
        read_until(port, end)
    with pytest.raises(LinkError, match="serial port has gone"):
        port.write(b"abc")
    port.close()


def read_until(port: SerialTransport, end: float) -> None:
    """Read until a time."""
    while time.monotonic() < end:
        port.read(0.01)


def test_addresses_of_transports():
    for wrong in ("/dev/ttyACM0?baud=fast", "/dev/ttyACM0?baud=0", ""):
        with pytest.raises(InputError):
            SerialTransport(wrong)
    for gone in ("/dev/no-such-port?baud=115200", "udp://127.0.0.1:5005"):
        with pytest.raises(LinkError, match="cannot be opened"):
            SerialTransport(gone)
