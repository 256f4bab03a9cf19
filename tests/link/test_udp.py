"""UDP: off loopback only with a key, one host only, nothing unsigned or repeated is acted on; peers that are killed."""

import os
import re
import socket
import time
from contextlib import ExitStack, contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.firmware.build import compilers
from ballbot.link.bridge import UdpBridge, serve_emulated
from ballbot.link.datagram import TAG, Direction, seal
from ballbot.link.frames import encode
from ballbot.link.live import FollowReference, LiveRobot, Sample
from ballbot.link.messages import (
    WATCHDOG,
    Capability,
    ControllerPlace,
    Disarm,
    Hello,
    Keep,
    Layer,
    Result,
    firmware_words,
    message_words,
)
from ballbot.link.references import live_reference
from ballbot.link.session import EMULATED_SILENCE, Session
from ballbot.link.transport import LinkError, UdpTransport, open_transport
from tests.link.test_emulated import emulated
from tests.support.processes import PATIENCE, Child

needs_compiler = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")
KEY = bytes(range(32))


class Loop:
    """A robot behind a bridge, in the robot's time: a read of the host lets the bridge hand on, and the robot run."""

    def __init__(self, *, key: bytes | None = None, host: str = "127.0.0.1", capabilities: int = 0) -> None:
        self.robot = emulated(capabilities=capabilities)
        self.bridge = UdpBridge(self.robot, host=host, port=0, key=key, clock=self.robot.clock)
        self.udp = UdpTransport("127.0.0.1", self.bridge.port, key=key)
        self.sent: list[bytes] = []

    def read(self, timeout: float) -> bytes:
        """Let the bridge hand on; loopback delivers at once."""
        self.bridge.step(0.0)
        return self.udp.read(min(timeout, 0.01))

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        self.udp.write(data)

    def close(self) -> None:
        self.udp.close()
        self.bridge.close()

    def session(self) -> Session:
        session = Session(self, clock=self.robot.clock)
        session.connect()
        return session


def stranger(loop: Loop, data: bytes) -> None:
    """Send a datagram from another port, and let the robot run."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.sendto(data, ("127.0.0.1", loop.bridge.port))
        loop.bridge.step(0.1)


@needs_compiler
@pytest.mark.parametrize("key", [None, KEY], ids=["open", "signed"])
def test_robot_is_armed_and_followed_over_udp(key):
    loop = Loop(key=key)
    session = loop.session()
    session.self_test()
    assert session.arm(lambda: True) is Result.OK
    for _ in range(50):
        session.poll(0.005)
    assert session.state.armed
    assert loop.bridge.refused == 0
    assert loop.udp.refused == 0
    loop.close()


@pytest.mark.parametrize("host", ["192.0.2.1", "0.0.0.0"])
def test_other_computers_need_the_key(host):
    with pytest.raises(InputError, match="datagrams must be signed"):
        UdpTransport(host, 5005)
    with pytest.raises(InputError, match="datagrams must be signed"):
        UdpBridge(None, host=host)  # type: ignore[arg-type]
    UdpTransport(host, 5005, key=KEY).close()


def test_bridge_binds_to_loopback_unless_a_host_is_given():
    bridge = UdpBridge(None, port=0)  # type: ignore[arg-type]
    assert bridge._socket.getsockname()[0] == "127.0.0.1"
    bridge.close()


@needs_compiler
def test_only_the_host_of_the_handshake_is_heard():
    loop = Loop()
    session = loop.session()
    session.poll(0.005)
    before = session.ask_counts()
    # with the right session and a sequence number to come: only the address is wrong
    stranger(loop, encode(Disarm(), session=session._session, sequence=session._sequence + 100))
    hello = Hello(firmware=firmware_words(), messages=message_words(), state_every=1)
    stranger(loop, encode(hello, session=77, sequence=1))
    session.poll(0.005)
    after = session.ask_counts()
    assert loop.bridge.refused == 2
    assert after.refused.tolist() == before.refused.tolist()
    for _ in range(210):  # silent for more than a second: another host may come
        loop.bridge.step(0.0)
    stranger(loop, encode(hello, session=77, sequence=1))
    assert loop.bridge.refused == 2
    loop.close()


@needs_compiler
def test_datagram_that_the_key_did_not_sign_is_dropped():
    loop = Loop(key=KEY)
    session = loop.session()
    frame = encode(Keep(), session=session._session, sequence=session._sequence + 1)
    with_wrong_key = seal(KEY[::-1], frame, Direction.TO_ROBOT)
    back = seal(KEY, frame, Direction.TO_HOST)  # a datagram of the robot sent back to it
    right = seal(KEY, frame, Direction.TO_ROBOT)
    changed = bytes([*right[:5], right[5] ^ 1, *right[6:]])
    before = session.ask_counts().accepted
    for k, datagram in enumerate([frame, with_wrong_key, back, changed, right[:-1], b"", right[-TAG:]]):
        loop.udp._socket.send(datagram)  # from the host's own address
        loop.bridge.step(0.1)
        assert loop.bridge.refused == k + 1
    assert session.ask_counts().accepted == before + 1  # the question itself
    loop.close()


@needs_compiler
def test_signed_datagrams_sent_again_are_refused_by_sequence_and_session():
    loop = Loop(key=KEY)
    session = loop.session()
    session.self_test()
    assert session.arm(lambda: True) is Result.OK
    session.disarm()
    recorded = list(loop.sent)
    session.ask_counts()
    before = session.ask_counts().refused
    for data in recorded:
        loop.udp.write(data)
    session.poll(0.005)
    after = session.ask_counts().refused
    assert sum(after - before) == len(recorded)
    assert (after - before)[Layer.SEQUENCE] >= len(recorded) - 2
    assert not session.state.armed
    # a new session: all that was recorded is of another one, but its handshake, which opens a session that nobody has
    second = loop.session()
    for data in recorded[1:]:
        loop.udp.write(data)
    second.poll(0.005)
    assert second.ask_counts().refused[Layer.SESSION] >= len(recorded) - 2
    assert not second.state.armed
    loop.close()


@needs_compiler
@pytest.mark.parametrize("capabilities", [0, Capability.BUTTON])
def test_robot_is_armed_from_another_computer_only_with_its_own_button(capabilities):
    loop = Loop(key=KEY, host="0.0.0.0", capabilities=capabilities)
    session = loop.session()
    session.self_test()
    if not capabilities:
        with pytest.raises(LinkError, match="does not answer the command Arm"):
            session.arm(lambda: True)
        assert loop.bridge.refused > 0
    else:
        assert session.arm(lambda: True) is Result.BUTTON
        assert session.arm(lambda: loop.robot._steps.line.press_button() is None) is Result.OK
    loop.close()


def test_addresses_of_transports():
    for wrong in ("udp://127.0.0.1", "udp://:5005", "udp://127.0.0.1:99999", "/dev/ttyACM0?baud=fast", ""):
        with pytest.raises(InputError):
            open_transport(wrong)
    with pytest.raises(LinkError, match="cannot be opened"):
        open_transport("/dev/no-such-port?baud=115200")
    with pytest.raises(LinkError, match="cannot be opened"):
        open_transport("tcp://127.0.0.1:9")  # no address of ours: TCP has no key


HOST = """
import sys
from ballbot.link.messages import Result
from ballbot.link.session import Session
from ballbot.link.transport import LinkError, open_transport

session = Session(open_transport(sys.argv[1]))
while True:
    try:
        session.connect(timeout=20.0)
        session.self_test(timeout=60.0)
        while session.arm(lambda: True) is Result.OK:
            while not session.state.stop:
                session.poll(0.01)
    except LinkError:
        continue  # this computer is busy
"""


@needs_compiler
@pytest.mark.slow
def test_killed_host_leaves_a_robot_that_stops():
    robot = emulated()
    bridge = UdpBridge(robot, port=0)
    with Child("-c", HOST, f"udp://127.0.0.1:{bridge.port}") as host:
        end = time.monotonic() + PATIENCE
        while robot.motors is None or not robot.motors.armed:
            assert host.running, host.errors()
            assert time.monotonic() < end, f"the host has not armed the robot within {PATIENCE:g} s"
            bridge.step(0.5 if robot.waits else 0.02)  # a sample for each frame of the host, or after a while
        host.kill()
    for _ in range(200):  # what is still in the socket, then silence
        bridge.step(0.0)
    assert not robot.motors.enabled
    assert not robot.motors.armed
    assert not robot.motors.torques.any()
    bridge.close()


def poll_for(session: Session, seconds: float) -> None:
    """Poll for a time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        session.poll(0.01)


@contextmanager
def robot_behind_udp():
    """Hold an emulated robot in a process of its own, with its port, while the block runs."""
    with Child("-m", "ballbot.link.bridge", "emulated", "--udp-port", "0") as robot:
        yield robot, int(re.search(r":(\d+) ", robot.line())[1])  # type: ignore[index]


@needs_compiler
@pytest.mark.slow
def test_killed_robot_is_noticed_by_the_host():
    with robot_behind_udp() as (robot, port):
        session = Session(open_transport(f"udp://127.0.0.1:{port}"))
        session.connect(timeout=PATIENCE)
        robot.kill()
        with pytest.raises(LinkError, match="silent"):
            poll_for(session, PATIENCE)
        assert not session.connected
        with pytest.raises(LinkError, match="connect first"):
            session.send(Keep())


@needs_compiler
def test_clock_of_an_emulated_robot_waits_for_a_host_that_is_late():
    loop = Loop()
    session = loop.session()
    session.self_test()
    assert session.arm(lambda: True) is Result.OK
    samples = 0
    while not loop.robot.waits:
        loop.bridge.step(0.0)
        samples += 1
    assert samples * 0.005 <= WATCHDOG / 2 + 0.005
    loop.udp.write(encode(Keep(), session=session._session, sequence=session._sequence + 1))
    serve_emulated(loop.bridge, loop.robot)
    assert not loop.robot.waits  # the frame was there, and the robot took it
    for _ in range(20):
        loop.bridge.step(0.0)
    assert not loop.robot.motors.enabled  # by the robot's clock the host was silent for too long
    assert not loop.robot.waits  # and nothing is driven any more
    loop.bridge.close()
    loop.close()


@needs_compiler
def test_silence_of_an_emulated_robot_by_the_clock_on_the_wall_is_no_lost_link(monkeypatch):
    now = 0.0

    def later(seconds: float = 1e-5) -> float:  # each look at the clock takes a moment
        nonlocal now
        now += seconds
        return now

    def silence(timeout: float) -> bytes:
        later(timeout)
        return b""

    monkeypatch.setattr("ballbot.link.session.time", SimpleNamespace(monotonic=later))
    loop = Loop()
    session = Session(loop, clock=later)
    session.connect()
    loop.read = silence  # type: ignore[method-assign]
    session._queued.clear()
    assert session.poll(0.9 * EMULATED_SILENCE) == []
    assert session.connected
    with pytest.raises(LinkError, match="silent"):
        session.poll(0.2 * EMULATED_SILENCE)
    loop.close()


#: keeps a core busy as long as the process that started it runs
BUSY = """
import os
owner = os.getppid()
while os.getppid() == owner:
    pass
"""


@needs_compiler
@pytest.mark.sample
def test_emulated_robot_balances_over_udp_for_ten_seconds_on_a_busy_computer():
    """Host and robot are two processes in real time, and twice as many others as there are cores keep them waiting."""
    samples: list[Sample] = []
    with robot_behind_udp() as (_, port), ExitStack() as others:
        session = Session(open_transport(f"udp://127.0.0.1:{port}"))
        session.connect(timeout=PATIENCE)
        live = LiveRobot(session)
        live.test()
        reference = FollowReference(live_reference("hold"), sample_time=0.005)
        for _ in range(2 * (os.cpu_count() or 1)):
            others.enter_context(Child("-c", BUSY))
        live.arm(lambda: True, controller=ControllerPlace.ROBOT)
        ending = live.run(reference, duration=10.0, record=lambda _: None, watch=samples.append)
        live.disarm()
    assert ending.kind == "time"
    times = np.array([one.t for one in samples])
    np.testing.assert_allclose(times, 0.005 * np.arange(2000), atol=1e-6)  # not one sample is lost or late
    assert max(np.abs(one.state[2:4]).max() for one in samples) < 0.1


@needs_compiler
def test_pulled_plug_ends_the_session():
    loop = Loop()
    session = loop.session()

    def gone(timeout: float) -> bytes:
        raise LinkError(f"The serial port has gone, within {timeout:g} s.")

    loop.read = gone  # type: ignore[method-assign]
    session._queued.clear()
    with pytest.raises(LinkError, match="has gone"):
        session.poll(0.01)
    assert not session.connected
    loop.close()
