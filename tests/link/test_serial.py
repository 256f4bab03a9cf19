"""A serial port: one end of a pseudo terminal, with a robot at the other."""

import os
import select
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.firmware.build import compilers
from ballbot.link.transport import LinkError, SerialTransport, Transport
from tests.link.test_emulated import balancing, emulated, states
from tests.support.processes import PATIENCE

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo terminals are those of POSIX")


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

    def __init__(self, port: Transport, far: int) -> None:
        self.robot = emulated()
        self.clock = self.robot.clock
        self._port, self._far, self._written = port, far, 0

    def read(self, timeout: float) -> bytes:  # noqa: ARG002
        """Let the robot take a sample with what the host wrote, and return what it sent."""
        self.robot.write(arrived(self._far, self._written))
        self._written = 0
        sent = self.robot.read(0.0)
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


@pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")
def test_robot_balances_over_a_serial_port_and_follows_a_reference():
    with serial_line() as (port, far):
        session = balancing(Loop(port, far))
        states(session, 1.0)
        reference = session.state.reference.copy()
        reference[0] += 0.2
        session.set_reference(reference)
        found = states(session, 4.0)
        assert all(state.armed for state in found)
        assert np.abs(found[-1].reference - reference).max() < 1e-6
        # it comes within a centimetre; 0.05 m is a quarter of the way
        assert abs(np.mean([state.estimate[0] for state in found[-400:]]) - reference[0]) < 0.05
        assert session.ask_counts().refused.tolist() == [0] * 9
        assert sum(session.counts.refused) == 0
        session.disarm()
        assert not states(session, 0.02)[-1].armed


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
