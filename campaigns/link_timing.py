"""Measure what the link takes on a Cortex-M4F: instructions, cycles, flash, RAM and stack.

.venv/bin/python -m campaigns.evidence link_timing

The link's functions run on the emulator that `campaigns.firmware_timing` uses, with a host's frames. Times to take a
frame are from its first byte to its answer; what a sample costs more is the difference of two updates in the same
state.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ballbot import Robot
from ballbot.control.presets import nominal_controller
from ballbot.estimation.interface import Reading
from ballbot.firmware.build import source_files
from ballbot.firmware.emulator import CLOCK, Board, Run, compile_image
from ballbot.firmware.estimators import reading_record
from ballbot.firmware.export import PROJECT, export_controller
from ballbot.firmware.header import SOURCES
from ballbot.firmware.records import PARAMETERS, STATE
from ballbot.link.emulated import HARDWARE
from ballbot.link.frames import FrameReader, encode, message_of
from ballbot.link.messages import (
    PARAMETER_WORDS,
    TO_HOST,
    Hello,
    Keep,
    Message,
    Read,
    Reference,
    State,
    Torques,
    Welcome,
    Write,
    firmware_words,
    message_words,
)
from campaigns.firmware_timing import reachable
from campaigns.section import Section

_PERIOD = 5e-3  # [s]
_HOST = 12345  # the host's random number
_OUT = 1024  # bytes at the end of the link, after their count
_SIZES = Path(__file__).with_name("link_sizes.c")


class LinkOnBoard:
    """The link of an armed robot on the emulated processor."""

    def __init__(self) -> None:
        sources = [*source_files(), PROJECT / "robot.c", *sorted(HARDWARE.glob("*.c")), _SIZES]
        self.image = compile_image(sources, include=(SOURCES, PROJECT, HARDWARE))
        self.board = board = Board(self.image)
        self.link_size = board.call("size_of_link").returned
        self.robot_size = board.call("size_of_robot").returned
        robot = Robot.load("alten")
        self._parameters = board.place(export_controller(nominal_controller(robot)).parameters)
        self._link = board.place(np.zeros(self.link_size, np.uint8))
        self._state = board.place(np.zeros(1, STATE.dtype("single")))
        still = Reading(
            wheel_angles=np.zeros(3), wheel_speeds=np.zeros(3), gyro=np.zeros(3), attitude=np.full(3, 0.01)
        )
        self._reading = board.place(reading_record(still, robot=robot))
        self._torques = board.place(np.zeros(4, np.float32))
        self._bytes = board.place(np.zeros(256, np.uint8))
        self._session, self._sequence = _HOST, 0
        board.call("ballbot_init", self._state, self._parameters)
        board.call("ballbot_link_init", self._link, self._parameters, 0, 0)
        board.call("ballbot_skip_self_test", self._state)

    def arm(self) -> None:
        """Arm as the robot's own button does."""
        self.board.call("ballbot_arm", self._state)

    def take(self, message: Message) -> Run:
        """Let the link take a host's frame."""
        self._sequence += 1
        frame = encode(message, session=self._session, sequence=self._sequence)
        self.board.write(self._bytes, np.frombuffer(frame, np.uint8))
        run = self.board.call(
            "ballbot_link_receive", self._link, self._state, self._parameters, self._bytes, len(frame), 0
        )
        for answer in self.sent():
            if isinstance(answer, Welcome):
                self._session = answer.session % 2**32
        return run

    def update(self) -> Run:
        """Take a sample through the link."""
        return self.board.call(
            "ballbot_link_update",
            self._link,
            self._state,
            self._parameters,
            self._reading,
            0,
            self._torques,
        )

    def plain_update(self) -> Run:
        """Take a sample without the link."""
        return self.board.call(
            "ballbot_update", self._state, self._parameters, self._reading, 0, 0, self._torques
        )

    def sent(self) -> list[Message]:
        """Return what the link wants to send, and take it away."""
        place = self._link + self.link_size - _OUT
        count = int(self.board.read(place - 4, np.zeros(1, np.uint32))[0])
        data = self.board.read(place, np.zeros(_OUT, np.uint8)).tobytes()[:count]
        self.board.write(place - 4, np.zeros(1, np.uint32))
        found = [message_of(frame) for frame in FrameReader(TO_HOST).feed(data)]
        return [one for one in found if isinstance(one, tuple(TO_HOST.values()))]


def measure() -> tuple[list[tuple[str, int, int, int]], LinkOnBoard]:
    """Return instructions, cycles and bytes on the line of what the link does, and the link.

    Raises
    ------
    RuntimeError
        If the link does not answer as it should.
    """
    link = LinkOnBoard()
    words = np.zeros(PARAMETER_WORDS, np.int32)
    hello = Hello(firmware=firmware_words(), messages=message_words(), state_every=1)
    resting: Sequence[Message] = (
        hello,
        Keep(),
        Read(offset=0, count=PARAMETER_WORDS),
        Write(offset=0, count=PARAMETER_WORDS, words=words),
    )
    moving: Sequence[Message] = (
        Reference(reference=np.zeros(10, np.float32)),
        Torques(torques=np.full(4, 0.01, np.float32)),
    )
    found = []
    for message in (*resting, *moving):
        run = link.take(message)
        size = len(encode(message, session=2**32 - 1, sequence=1))
        found.append((f"take `{type(message).__name__}`", run.instructions, run.cycles, size))
    link.arm()
    for _ in range(3):  # the estimator has begun
        link.plain_update()
    with_state = link.update()
    states = [one for one in link.sent() if isinstance(one, State)]
    if not (len(states) == 1 and states[0].armed):
        raise RuntimeError("The link on the emulated processor sent no state of an armed robot.")
    plain = link.plain_update()
    cost = (with_state.instructions - plain.instructions, with_state.cycles - plain.cycles)
    found.append(("send `State`", *cost, len(encode(states[0], session=2**32 - 1, sequence=1))))
    return found, link


def campaign() -> Section:
    """Return what the link takes on the processor."""
    found, link = measure()
    flash = sum(
        len(link.image.functions[one])
        for one in reachable(link.image, "ballbot_link_receive")
        - reachable(link.image, "ballbot_link_update")
    )
    rows = [
        [
            name,
            str(size),
            f"{instructions:,}",
            f"{cycles:,}",
            f"{1e6 * cycles / CLOCK:.0f}",
            f"{100.0 * cycles / (CLOCK * _PERIOD):.2f} %",
        ]
        for name, instructions, cycles, size in found
    ]
    copy = PARAMETERS.dtype("single").itemsize
    stack = link.image.stack_bound("ballbot_link_receive"), link.image.stack_bound("ballbot_link_update")
    return Section(
        title="The link on the processor",
        before="The robot's side of the link on an emulated Cortex-M4F: exact instructions, and an upper estimate of "
        f"cycles, 3.3 for each, at {CLOCK / 1e6:.0f} MHz; the nominal controller of the thesis's "
        "robot. `State` is what a sample costs more if one is sent.",
        columns=["", "bytes", "instructions", "cycles", "time [us]", "share of 5 ms"],
        rows=rows,
        after=f"The link takes {link.link_size:,} bytes of RAM, of which {copy:,} are the copy that parameters are "
        f"written to, and `struct robot` with it {link.robot_size:,} bytes. The stack is at most {stack[0]:,} bytes to "
        f"take frames and {stack[1]:,} bytes for a sample with a state. Taking frames needs {flash:,} bytes of flash "
        "that a sample does not.",
    )
