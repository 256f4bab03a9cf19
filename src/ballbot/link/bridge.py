"""A bridge from UDP to a robot's serial line, for the computer on the robot.

    python -m ballbot.link.bridge /dev/ttyACM0                                          loopback only
    python -m ballbot.link.bridge /dev/ttyACM0 --host 192.168.4.1 --key robot.key       from another computer
    python -m ballbot.link.bridge emulated                                              an emulated robot

It hands on whole frames, one in a datagram, and serves one host: the address whose `Hello` came first. Another address
is heard only after that has been silent for a second. Bound to an address other than loopback it needs the robot's
key: a datagram that the key has not signed is dropped before anything of it is read, and every datagram to the host is
signed.

The bridge reads handshakes, and off loopback it hands on `Arm` only to a robot that needs its own button for that. The
robot's own checks stand behind it, and so does its watchdog if the bridge ends.

A robot stops if a frame is late. An emulated one waits: its clock stands still while the host, on a busy computer, is
late (`serve_emulated`).
"""

from __future__ import annotations

import argparse
import select
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from ballbot.errors import InputError
from ballbot.link.datagram import Direction, read_key, seal, unseal
from ballbot.link.emulated import EmulatedRobot, emulated_robot
from ballbot.link.frames import Frame, decode, message_of
from ballbot.link.messages import TO_HOST, TO_ROBOT, Arm, Capability, Hello, Welcome
from ballbot.link.transport import LinkError, Transport, datagram_socket, is_loopback, open_transport
from ballbot.robot import Robot
from ballbot.twin.scenario_file import load_scenario

DEFAULT_PORT = 5005
#: after which another host may come [s]
PEER_SILENCE = 1.0
#: after which a host that is late is gone: an emulated robot then goes on, sample by sample, until it stops [s]
_HOST_PATIENCE = 0.5
_LARGEST_DATAGRAM = 2048


class UdpBridge:
    """Hand frames on between one host on UDP and a robot's line.

    Parameters
    ----------
    line : Transport
        To the robot.
    host : str
        Address to bind; loopback by default.
    port : int
        0 for one that is free.
    key : bytes, optional
        Needed off loopback.
    clock : callable
        Gives the time [s].

    Raises
    ------
    InputError
        If the address is not loopback and there is no key.
    LinkError
        If the address cannot be bound.
    """

    def __init__(
        self,
        line: Transport,
        *,
        host: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
        key: bytes | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.refused = 0  #: datagrams of other addresses, or without the key's signature
        self._line, self._key, self._clock = line, key, clock
        self._peer: tuple[object, ...] | None = None
        self._heard = -PEER_SILENCE
        self._part = b""
        self._has_button = False
        self._socket, address = datagram_socket(host, port, key=key)
        self._is_local = is_loopback(str(address[0]))
        try:
            self._socket.bind(address)
        except OSError as problem:
            self._socket.close()
            raise LinkError(f"The address {host}:{port} cannot be bound: {problem}") from None

    @property
    def port(self) -> int:
        """Port that is bound."""
        return int(self._socket.getsockname()[1])

    def step(self, timeout: float) -> None:
        """Hand on what has come from both sides; wait at most `timeout` [s] for the host."""
        if select.select([self._socket], [], [], timeout)[0]:
            self._take_datagrams()
        *whole, self._part = (self._part + self._line.read(0.0)).split(b"\0")
        for coded in whole:
            self._send(coded + b"\0")

    def _take_datagrams(self) -> None:
        while True:
            try:
                datagram, sender = self._socket.recvfrom(_LARGEST_DATAGRAM)
            except BlockingIOError:
                return
            except OSError:
                continue  # the host's computer reports that nobody listens there any more
            frame = unseal(self._key, datagram, Direction.TO_ROBOT)
            if frame is None or not self._is_peer(sender, frame) or self._arms_alone(frame):
                self.refused += 1
                continue
            self._heard = self._clock()
            self._line.write(frame)

    def _is_peer(self, sender: tuple[object, ...], frame: bytes) -> bool:
        """Return whether a datagram comes from the host that is served, or from one that may be."""
        if sender == self._peer:
            return True
        found = decode(frame.removesuffix(b"\0"), TO_ROBOT)
        greets = isinstance(found, Frame) and found.kind == Hello.TYPE
        if not greets or self._clock() - self._heard < PEER_SILENCE:
            return False
        self._peer = sender
        return True

    def _arms_alone(self, frame: bytes) -> bool:
        """Return whether a frame would arm a robot from another computer, and nobody beside the robot."""
        found = decode(frame.removesuffix(b"\0"), TO_ROBOT)
        arms = isinstance(found, Frame) and found.kind == Arm.TYPE
        return arms and not self._is_local and not self._has_button

    def _send(self, frame: bytes) -> None:
        found = decode(frame.removesuffix(b"\0"), TO_HOST)
        if isinstance(found, Frame) and isinstance(welcome := message_of(found), Welcome):
            self._has_button = bool(welcome.capabilities & Capability.BUTTON)
        if self._peer is None:
            return
        try:
            self._socket.sendto(seal(self._key, frame, Direction.TO_HOST), self._peer)
        except OSError:
            return  # lost, as any datagram may be

    def close(self) -> None:
        """Close the socket; the line stays open."""
        self._socket.close()


def serve_emulated(bridge: UdpBridge, robot: EmulatedRobot) -> None:
    """Let an emulated robot run behind its bridge for one sample; its clock waits for a host that is late."""
    bridge.step(_HOST_PATIENCE if robot.waits else 0.0)


def main(argv: Sequence[str] | None = None) -> None:
    """Run a bridge until it is interrupted."""
    parser = argparse.ArgumentParser(
        prog="python -m ballbot.link.bridge", description="Bridge from UDP to a serial line."
    )
    parser.add_argument(
        "port", help="the robot's serial port, as /dev/ttyACM0?baud=921600; or emulated, for an emulated one"
    )
    parser.add_argument("--robot", default="alten", help="preset or file of an emulated robot")
    parser.add_argument("--host", default="127.0.0.1", help="address to bind; loopback by default")
    parser.add_argument("--udp-port", type=int, default=DEFAULT_PORT)
    parser.add_argument("--key", type=Path, help="file with the robot's key; needed off loopback")
    given = parser.parse_args(argv)
    try:
        key = read_key(given.key) if given.key else None
        emulated = _emulated(given.robot) if given.port == "emulated" else None
        line = emulated or open_transport(given.port)
        bridge = UdpBridge(line, host=given.host, port=given.udp_port, key=key)
        print(f"Bridge from {given.host}:{bridge.port} to {given.port}; Ctrl-C ends it.", flush=True)
        while True:
            if emulated:
                serve_emulated(bridge, emulated)
            else:
                bridge.step(0.001)
    except KeyboardInterrupt:
        return
    except (InputError, LinkError) as problem:
        raise SystemExit(str(problem)) from None


def _emulated(name: str) -> EmulatedRobot:
    """Return an emulated robot that runs in real time."""
    robot = Robot.load(name)
    return emulated_robot(robot, load_scenario("nominal", robot), real_time=True)


if __name__ == "__main__":
    main()
