"""Faults of the link: no frame that fails a layer is acted on, and every run ends safe: torques zero, stop latched.

An independent model in Python decides which of the frames that arrived are valid. A second robot is given those alone,
at the same samples; its motors must do the same, bit for bit.
"""

import numpy as np
import pytest

from ballbot.control.safety import StopReason
from ballbot.firmware.build import compilers
from ballbot.firmware.records import SelfTestOutcome
from ballbot.link.emulated import EmulatedRobot
from ballbot.link.frames import FrameReader, LayerCounts, encode, is_newer, message_of
from ballbot.link.messages import (
    FIRMWARE_WORDS,
    LONGEST_RAMP,
    MESSAGE_WORDS,
    TO_HOST,
    TO_ROBOT,
    AnswerResult,
    Arm,
    AskCounts,
    Commit,
    ControllerPlace,
    Disarm,
    Hello,
    Keep,
    Layer,
    Message,
    Read,
    Reference,
    SelfTest,
    Torques,
    Welcome,
    Write,
)
from ballbot.link.session import Session, stop_reason
from ballbot.link.transport import LinkError
from tests.link.test_emulated import H, balancing, connected, emulated, parameters
from tests.support.faulty_transport import Faults, FaultyTransport

pytestmark = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")

FAULTS = {
    "repeated": Faults(repeated=0.5),
    "corrupted": Faults(corrupted=0.3),
    "all": Faults(lost=0.1, repeated=0.2, reordered=0.2, corrupted=0.2, late=0.1),
}


class Model:
    """The rules of docs/link.md in Python: which frames a robot accepts."""

    def __init__(self) -> None:
        self.counts = LayerCounts()
        self.reader = FrameReader(TO_ROBOT, self.counts)
        self.host, self.session, self.last = 0, 0, 0

    def accepted(self, data: bytes, *, active: bool, sessions: dict[int, int]) -> list[bytes]:
        """Return the frames that count, each encoded anew.

        active: whether the robot moves. sessions: the robot's session by the host's number, as its answers have it.
        """
        found = []
        for frame in self.reader.feed(data):
            if frame.kind == Hello.TYPE:
                refused = self._hello(frame, active=active, sessions=sessions)
            elif not self.session or frame.session != self.session:
                refused = Layer.SESSION
            elif not is_newer(frame.sequence, self.last):
                refused = Layer.SEQUENCE
            else:
                refused = self._values(message_of(frame))
            if refused is None:
                self.counts.accepted += 1
                self.last = frame.sequence
                message = message_of(frame)
                assert not isinstance(message, Layer)
                found.append(encode(message, session=frame.session, sequence=frame.sequence))
            else:
                self.counts.refuse(refused)
        return found

    def _hello(self, frame, *, active: bool, sessions: dict[int, int]) -> Layer | None:
        again = self.session and frame.session == self.host
        if again and not is_newer(frame.sequence, self.last):
            return Layer.SEQUENCE
        if not again and active:
            return Layer.SESSION
        if not again:
            self.host, self.session = frame.session, sessions[frame.session]
        return None

    def _values(self, message: Message | Layer) -> Layer | None:
        words = parameters().itemsize // 4
        good = {
            Arm: lambda one: one.controller in (0, 1) and 0.0 <= one.ramp <= LONGEST_RAMP,
            Reference: lambda one: np.abs(one.reference).max() <= 1e6,  # the precise controller follows plans
            Read: lambda one: 1 <= one.count <= 32 and 0 <= one.offset <= words - one.count,
            Write: lambda one: 1 <= one.count <= 32 and 0 <= one.offset <= words - one.count,
        }
        if isinstance(message, Layer):
            return message
        return None if good.get(type(message), lambda _: True)(message) else Layer.VALUES


def answered_sessions(robot_bytes: bytes) -> dict[int, int]:
    """Return the session by the host's number, of every welcome in what a robot has sent."""
    frames = [(frame.session, message_of(frame)) for frame in FrameReader(TO_HOST).feed(robot_bytes)]
    return {host: one.session % 2**32 for host, one in frames if isinstance(one, Welcome)}


class Recording:
    """An emulated robot whose motors and sent bytes are kept."""

    def __init__(self, robot: EmulatedRobot) -> None:
        self.robot, self.clock = robot, robot.clock
        self.motors: list[tuple] = []
        self.sent: list[bytes] = []
        self.taken: list[bytes] = []
        self._waiting = b""

    def read(self, timeout: float) -> bytes:  # noqa: ARG002
        """Take one sample."""
        self.taken.append(self._waiting)
        self._waiting = b""
        data = self.robot.read(0.0)
        motors = self.robot.motors
        assert motors is not None
        self.motors.append((motors.time, motors.enabled, motors.armed, motors.torques.tobytes()))
        self.sent.append(data)
        return data

    def write(self, data: bytes) -> None:
        self._waiting += data
        self.robot.write(data)

    def close(self) -> None:
        self.robot.close()


def any_command(random: np.random.Generator) -> Message:
    """Draw a command of a host that tries everything, wrong values among it."""
    reference = np.zeros(10, dtype=np.float32)
    reference[[0, 1, 4]] = 0.2 * random.normal(size=3)
    if random.uniform() < 0.2:
        reference[random.integers(10)] = random.choice([np.nan, np.inf, 1e9, 0.1])
    choices: list[Message] = [
        Keep(),
        Reference(reference=reference),
        Reference(reference=reference),
        Torques(torques=random.choice([0.1, np.nan, 1e30], size=4).astype(np.float32)),
        Read(offset=int(random.integers(-5, 1300)), count=int(random.integers(-1, 40))),
        Write(
            offset=int(random.integers(-5, 1300)),
            count=int(random.integers(-1, 40)),
            words=random.integers(-(2**31), 2**31, 32).astype(np.int32),
        ),
        Commit(crc=int(random.integers(-(2**31), 2**31))),
        AskCounts(),
        Arm(
            nonce=int(random.integers(-(2**31), 2**31)),
            controller=int(random.integers(-1, 3)),
            ramp=float(random.choice([0.0, 1.0, 61.0])),
        ),
        SelfTest(),
    ]
    return choices[random.integers(len(choices))]


def drive(link: FaultyTransport, robot: Recording, *, seed: int) -> None:
    """Connect, test, arm and balance as far as the faults let it, then fall silent."""
    random = np.random.default_rng(seed)
    session = Session(link, clock=robot.clock)
    for _ in range(3):
        try:
            session.connect()
            if session.self_test() is not SelfTestOutcome.PASSED:
                continue  # the faults silenced the host for 50 ms
            session.arm(lambda: True)
            for _ in range(100):
                session.poll(0.0)
                if random.uniform() < 0.5:
                    session.send(any_command(random))
        except LinkError:
            continue  # silent, or no answer: a host begins anew
    link.dead = True
    for _ in range(40):
        link.read(0.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.sample)])
@pytest.mark.parametrize("kind", ["repeated", "corrupted", "all"])
def test_frame_that_fails_a_layer_is_not_acted_on_and_the_end_is_safe(kind, seed):
    robot = Recording(emulated(seed=seed))
    link = FaultyTransport(robot, FAULTS[kind], seed=seed)
    drive(link, robot, seed=seed)
    other, model = Recording(emulated(seed=seed)), Model()
    for k, data in enumerate(robot.taken):
        # an answer to what comes now is sent in this sample
        sessions = answered_sessions(robot.sent[k])
        active = k > 0 and bool(robot.motors[k - 1][1])
        for frame in model.accepted(data, active=active, sessions=sessions):
            other.write(frame)
        other.read(0.0)
    assert other.motors == robot.motors
    assert model.counts.accepted > 20
    if kind in ("repeated", "corrupted"):  # what is lost or late may silence the host before it arms
        assert any(armed for _, _, armed, _ in robot.motors)
        assert sum(model.counts.refused) > 0
    _, enabled, armed, torques = robot.motors[-1]
    assert not enabled
    assert not armed
    assert not any(torques)
    # a new host: the counts are those of the model, and nothing moves until it arms
    session = connected(robot)
    assert session.state is None or not session.state.armed
    counts = session.ask_counts()
    assert counts.refused.tolist() == model.counts.refused
    assert counts.accepted == model.counts.accepted + 2  # the handshake and the question itself


SILENT_FOR = 0.05  # [s] that the robot waits for a valid frame


@pytest.mark.parametrize("place", list(ControllerPlace))
def test_silence_stops_the_robot_within_50_ms_latched(place):
    robot = Recording(emulated())
    session = balancing(robot, controller=place)
    for _ in range(30):
        session.poll(H)
        if place is ControllerPlace.HOST:
            session.set_torques([0.02, -0.01, -0.01])
    assert session.state.armed
    session.send(Keep() if place is ControllerPlace.ROBOT else Torques(torques=np.full(4, 0.01, np.float32)))
    silent = len(robot.motors)
    for _ in range(100):
        robot.read(0.0)
    torques = [np.frombuffer(torques, "f4") for *_, torques in robot.motors[silent:]]
    moved = [k for k, torque in enumerate(torques) if torque.any()]
    # the frame arrives with the first of these samples
    assert moved[-1] * H < SILENT_FOR <= (moved[-1] + 1) * H + 1e-9
    session.connect()
    session.poll(0.1)
    assert session.state is not None
    assert stop_reason(session.state) is StopReason.LINK
    assert not session.state.torques.any()
    assert session.arm(lambda: True, controller=place) is AnswerResult.OK  # the self-test has passed before
    session.poll(H)
    assert session.state.armed
    assert stop_reason(session.state) is None


def test_host_says_that_the_robot_is_silent_and_stops_sending():
    robot = Recording(emulated())
    link = FaultyTransport(robot, Faults(), seed=0)
    session = Session(link, clock=robot.clock)
    session.connect()
    session.poll(H)
    link.dead = True
    began = robot.clock()
    with pytest.raises(LinkError, match=r"silent for \d+ ms"):
        session.poll(1.0)
    assert robot.clock() - began <= 0.05 + 2 * 0.01  # a wait may last 10 ms
    for act in (session.poll, lambda: session.send(Keep()), lambda: session.set_torques(np.zeros(3))):
        with pytest.raises(LinkError, match="connect first"):
            act()


def test_moving_robot_is_not_taken_over_by_another_host():
    robot = Recording(emulated())
    first = balancing(robot)
    hello = Hello(firmware=FIRMWARE_WORDS, messages=MESSAGE_WORDS, state_every=1)
    robot.write(encode(hello, session=4711, sequence=9))
    robot.write(encode(Disarm(), session=4711, sequence=10))
    first.poll(H)
    first.poll(H)
    assert first.state.armed
    assert first.ask_counts().refused[Layer.SESSION] == 2


def test_repeated_arming_is_not_arming():
    """All frames of a run that armed the robot, sent again to the same robot switched on anew, do not arm it."""
    robot = Recording(emulated())
    balancing(robot)
    other = Recording(emulated())
    other.read(0.0)  # its clock is a sample further: another session, another number of arming
    for data in robot.taken:
        other.write(data)
        other.read(0.0)
    assert not any(enabled for _, enabled, _, _ in other.motors)


@pytest.mark.parametrize("wrong", ["FIRMWARE_WORDS", "MESSAGE_WORDS"])
def test_firmware_of_another_version_gets_no_session(wrong, monkeypatch):
    robot = Recording(emulated())
    session = Session(robot, clock=robot.clock)
    monkeypatch.setattr(f"ballbot.link.session.{wrong}", np.ones(8, np.int32))
    with pytest.raises(LinkError, match="another version; export it again"):
        session.connect()
    with pytest.raises(LinkError, match="connect first"):
        session.send(Keep())


@pytest.mark.parametrize("late", [9.9, 10.1])
def test_confirmation_is_good_for_ten_seconds(late):
    robot = Recording(emulated())
    session = connected(robot)
    session.self_test()

    def think() -> bool:
        for _ in range(round(late / H)):
            robot.read(0.0)
        return True

    assert session.arm(think) is (AnswerResult.OK if late < 10.0 else AnswerResult.NONCE)
