"""A robot at the other end of a link, the person beside it, and what a terminal shows while it runs."""

from __future__ import annotations

import gc
import io
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.text import Text

from ballbot.errors import InputError
from ballbot.firmware.records import SelfTestOutcome
from ballbot.link.emulated import EmulatedRobot
from ballbot.link.live import Commander, Ending, LiveRobot, RobotSample, Samples, TorqueProgram, log_columns
from ballbot.link.messages import State
from ballbot.link.operators import EmulatedCamera, EmulatedOperator, Operator, TerminalOperator
from ballbot.link.recorder import Recorder
from ballbot.link.session import Session, stop_reason
from ballbot.link.stream import LiveStream, StreamAddress
from ballbot.link.transport import Transport
from ballbot.log import Log
from ballbot.robot import Robot
from ballbot.rounding import percent

#: between two pictures of the monitor on a terminal, and between two lines of it elsewhere [s]
_PICTURE, _LINE = 0.1, 5.0


class Monitor:
    """Shows a robot while it runs: a line that changes on a terminal, or a line every five seconds elsewhere."""

    def __init__(
        self,
        console: Console | None,  # nothing is shown without one
    ) -> None:
        self._live, self._quiet = None, console is None
        if console is not None and console.is_terminal:
            self._live = Live(console=console, auto_refresh=False, transient=True)
            # the first picture takes longer to draw than a robot waits; nobody sees this one
            Console(file=io.StringIO()).print(Text(""))
        #: when the next picture is due, by the clock; or the next line, by the robot's time [s]
        self._next = 0.0

    @contextmanager
    def shown(self) -> Iterator[Monitor]:
        """Remove the line from the terminal when the block ends."""
        try:
            yield self
        finally:
            if self._live is not None:
                self._live.stop()

    def show(self, t: float, line: Callable[[], str]) -> None:
        """Show a line that is made at the robot's time t [s], if the last one is old."""
        now, interval = (t, _LINE) if self._live is None else (time.monotonic(), _PICTURE)
        # the robot's time begins again after 71 minutes
        if self._quiet or self._next - interval <= now < self._next:
            return
        self._next = now + interval
        if self._live is None:
            print(f"ballbot: {line()}", file=sys.stderr, flush=True)
        else:
            self._live.start()  # not before there is something to show: the person may have to type first
            self._live.update(Text(line()), refresh=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class LiveRun:
    """A run's log and how it ended."""

    ending: Ending
    log: Log | None  #: None if the run ended before its first sample
    trouble: str | None  #: why the recording ends before the run, in one sentence

    def whole_log(self) -> Log:
        """Return the log; InputError if the run ended before its first sample."""
        if self.log is None:
            raise InputError(self.ending.text)
        return self.log


@dataclass(frozen=True, kw_only=True)
class Connection:
    """A robot at the other end of a link, and the person beside it."""

    robot: LiveRobot
    described: Robot | None  #: its description, if it is known
    operator: Operator
    address: str  #: port or "emulated"
    stream: LiveStream  #: to programs that show the robot live
    camera: EmulatedCamera | None = None  #: above an emulated robot that is upside down

    @property
    def words(self) -> str:
        """Which robot it is, and where, in a sentence."""
        name = "A robot" if self.described is None else f"The robot {self.described.name}"
        where = ", emulated on this computer" if self.address == "emulated" else f" at {self.address}"
        return f"{name}{where}."

    @property
    def provenance(self) -> dict[str, object]:
        """The robot, parameters and session of a log."""
        return {
            "robot": self.described.name if self.described else None,
            "port": self.address,
            "session": f"{self.robot.welcome.session % 2**32:08x}",
            "parameters_sha256": sha256(self.robot.parameters.tobytes()).hexdigest(),
        }

    def states_shown(self, monitor: Monitor) -> Callable[[State], None]:
        """Return a callback that shows each state of the robot, armed or not, on the monitor and in the stream."""
        samples, step, count = None, self.robot.encoder_step, self.robot.wheel_count

        def watch(state: State) -> None:
            nonlocal samples
            t = 1e-6 * (state.time % 2**32)
            monitor.show(t, lambda: state_line(state, wheel_count=count))
            samples = samples or Samples(state, wheel_count=count, encoder_step=step)
            sample = samples.sample(state)
            if state.imu_valid and not state.estimate_valid:
                sample.state[2:5] = state.attitude
            self.stream.append(sample.row())

        return watch

    def run(
        self,
        commander: Commander,
        monitor: Monitor,
        *,
        duration: float,  # [s]
        ramp: float = 0.0,  # time over which the torque limit rises from zero [s]
        recording: Path | None = None,  # where rows are kept while the robot runs; nowhere if it is not given
    ) -> LiveRun:
        """Test and arm the robot, run it with a commander, disarm it, and return the log; the monitor shows the run.

        The recording (`ballbot.link.recorder`) is opened before the robot arms, so that a disk that cannot be written
        stops the command and not the robot. Whatever ends the run, the robot is disarmed and the recording closed.

        InputError if the recording cannot be written, the self-test fails, arming is not confirmed, or the robot
        refuses.
        """
        line = bench_line if isinstance(commander, TorqueProgram) else sample_line
        robot, columns = self.robot, log_columns(self.robot.wheel_count)
        rows: list[Sequence[float]] = []
        with monitor.shown():
            robot.test(self.operator)
            with Recorder(recording, columns) if recording else nullcontext() as recorder:

                def record(row: Sequence[float]) -> None:
                    rows.append(row)
                    self.stream.append(row)
                    if recorder is not None:
                        recorder.append(row)

                def watch(sample: RobotSample) -> None:
                    monitor.show(sample.t, lambda: line(sample, torque_limit=robot.torque_limit))
                    if self.camera is not None:
                        self.camera.watch()

                gc.collect()
                gc.freeze()  # a collection that walks all imported code takes longer than the robot waits
                try:
                    robot.arm(self.operator.confirm_arming, controller=commander.place, ramp=ramp)
                    self.stream.append("The robot is armed.")
                    ending = robot.run(commander, duration=duration, record=record, watch=watch)
                    self.stream.append(ending.text)
                finally:
                    gc.unfreeze()
                    if recording and not rows:  # nothing to recover
                        recording.unlink(missing_ok=True)
                    robot.disarm()
        log = Log(dict(zip(columns, np.array(rows).T, strict=True))) if rows else None
        if log is not None and ending.kind in ("stop", "link"):
            log = Log(log.columns, ended=ending.text.removesuffix("."))
        return LiveRun(ending=ending, log=log, trouble=recorder.failure if recorder else None)

    def troubles(self, made: LiveRun) -> Iterator[str]:
        """Yield what went wrong in a run; InputError if the link was lost, KeyboardInterrupt if it was interrupted."""
        if made.trouble:
            yield made.trouble
        if made.ending.kind == "interrupt":
            raise KeyboardInterrupt("interrupted; the robot is disarmed.")
        if made.ending.kind == "link":
            raise InputError(made.ending.text)
        session = self.robot.session
        host = sum(session.counts.refused)
        robot = int(session.ask_counts().refused.sum()) if session.connected else 0
        if host or robot:
            yield (
                f"Frames refused: {host} by this computer, {robot} by the robot; the cable, the baud rate or the radio "
                "loses bytes."
            )


@contextmanager
def connect(
    transport: Transport,  # a port, or an emulated robot, which has its own clock and person
    described: Robot | None,
    *,
    address: str,
    say: Callable[[str], None],  # prints what the person is to do
    # random seed of a camera above an emulated robot upside down, if there is one
    filmed_by: int | None = None,
    stream: StreamAddress | None = None,  # of a server that shows its rows live; none by default
) -> Iterator[Connection]:
    """Hold the link to a robot while the block runs."""
    clock, operator, camera = time.monotonic, TerminalOperator(say), None
    if isinstance(transport, EmulatedRobot):
        clock, operator = transport.clock, EmulatedOperator(transport.hand)
        camera = None if filmed_by is None else EmulatedCamera(transport.hand, seed=filmed_by)
    with closing(Session(transport, clock=clock)) as session:
        session.connect()
        robot = LiveRobot(session)
        with LiveStream(stream, log_columns(robot.wheel_count), described) as live:
            yield Connection(
                robot=robot,
                described=described,
                address=address,
                operator=operator,
                stream=live,
                camera=camera,
            )


def sample_line(sample: RobotSample, *, torque_limit: float) -> str:
    """Return a sample in one line."""
    x, y, theta, phi, psi = sample.state[:5]
    away = math.hypot(*(sample.state[:2] - sample.reference[:2]))
    lean = math.acos(min(1.0, math.cos(theta) * math.cos(phi)))
    return (
        f"{sample.t:.1f} s, at ({x:+.3f}, {y:+.3f}) m, psi {math.degrees(psi):+.1f} degrees, "
        f"{1e3 * away:.0f} mm from the reference, lean {math.degrees(lean):.1f} degrees, "
        f"torque {percent(_share(sample, torque_limit))} of the limit"
    )


def bench_line(sample: RobotSample, *, torque_limit: float) -> str:
    """Return a sample of a held robot in one line."""
    speeds = " ".join(f"{speed:+.1f}" for speed in sample.wheel_speeds)
    torques = " ".join(f"{torque:+.2f}" for torque in sample.torques)
    share = percent(_share(sample, torque_limit))
    return f"{sample.t:.1f} s, torques {torques} N m ({share} of the limit), wheel speeds {speeds} rad/s"


def state_line(state: State, *, wheel_count: int) -> str:
    """Return a state in one line."""
    theta, phi, psi = np.degrees(state.attitude)
    gyro = " ".join(f"{rate:+.2f}" for rate in state.gyro)
    counts = " ".join(map(str, state.wheel_counts[:wheel_count].tolist()))
    speeds = " ".join(f"{speed:+.1f}" for speed in state.wheel_speeds[:wheel_count])
    stop = stop_reason(state)
    test = SelfTestOutcome(state.self_test).name.replace("_", " ").lower()
    wheel = f" ({state.self_test_wheel})" if state.self_test_wheel else ""
    return (
        f"{'armed' if state.armed else 'disarmed'}, self-test {test}{wheel}, "
        f"theta {theta:+.1f}, phi {phi:+.1f}, psi {psi:+.1f} degrees, gyro {gyro} rad/s, counts {counts}, "
        f"wheel speeds {speeds} rad/s" + (f", stopped: {stop}" if stop else "")
    )


def _share(sample: RobotSample, torque_limit: float) -> float:
    return float(np.abs(sample.torques).max()) / torque_limit
