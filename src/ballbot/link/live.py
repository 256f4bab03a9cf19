"""A live robot from arming to disarming: its references or torques, sample by sample, and its log.

    robot = LiveRobot(session)
    robot.test()
    robot.arm(confirm, controller=ControllerPlace.ROBOT)
    ending = robot.run(FollowReference(reference), duration=32.0, record=recorder.append)
    robot.disarm()

After every sample a `Commander` gives what is sent: a reference for the controller on the robot, or
torques of a program on this computer. A row of the log is a sample from arming on, in the frame of the start
(`ballbot.link.references`): measurements and estimate of a time, and the torques held from there on.

Every run ends with one sentence (`Ending`): the time is over, the driver or the safety layer stops it, or the link
is lost. A robot whose link is lost stops by itself.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.control.parts import KINDS
from ballbot.control.safety import StopReason
from ballbot.errors import InputError
from ballbot.firmware.records import ESTIMATORS, SelfTestOutcome
from ballbot.link.messages import AnswerResult, ControllerPlace, State, wrapped
from ballbot.link.operators import MOVEMENTS, Operator
from ballbot.link.references import LiveReference, in_robot_frame, in_start_frame
from ballbot.link.session import MOVING_TIME, Session, reason, stop_reason
from ballbot.link.transport import LinkError
from ballbot.link.tuning import Tuner
from ballbot.log.columns import TRUE_PREFIX
from ballbot.simulation.batch_result import column_names

#: longest wait for the next sample [s]; the session finds out before that whether the robot is silent
_PATIENCE = 0.1
#: longest time from an accepted arming until the robot shows it [s]
_ARMING_TIME = 0.5
#: after which a reference that the robot does not show is sent again [s]
_REFERENCE_TIME = 0.05

#: what each stop of the robot's safety layer means and what to do
STOPS: dict[StopReason, str] = {
    StopReason.MISSING: "a sensor gave nothing for three samples; check the IMU's and the encoders' cables",
    StopReason.LEAN: "it leaned further than its limit",
    StopReason.TORQUE: "a torque was not a finite number",
    StopReason.LATE: "a sample came too late; the robot's processor has too much to do",
    StopReason.STUCK: "a sensor did not change; check the cable of the sensor, and whether the wheel turns freely",
    StopReason.LINK: "nothing valid came from this computer for 50 ms",
}
_MOTOR = "motor {wheel} was driven"
_SELF_TESTS: dict[SelfTestOutcome, str] = {
    SelfTestOutcome.DEAD_MOTOR: f"{_MOTOR} and no encoder turned: it has no power, or its wheel is stuck",
    SelfTestOutcome.TORQUE_ORDER: f"{_MOTOR} and another encoder turned the most: cables are in the wrong order",
    SelfTestOutcome.TORQUE_SIGN: (
        f"{_MOTOR} forward and its encoder turned backward: one of the two has the wrong sign"
    ),
    SelfTestOutcome.STOPPED: "the safety layer stopped it",
    SelfTestOutcome.HOLD_UPRIGHT: (
        f"the robot was not upright and still within {MOVING_TIME:.0f} s; if it was, the IMU is mounted at an angle or "
        "its frame does not have z up: correct ballbot_read_imu"
    ),
    SelfTestOutcome.TILT_FORWARD: f"the robot was not tilted forward and held within {MOVING_TIME:.0f} s",
    SelfTestOutcome.TILT_LEFT: f"the robot was not tilted to the left and held within {MOVING_TIME:.0f} s",
    SelfTestOutcome.TURN_LEFT: f"the robot was not turned to the left and held within {MOVING_TIME:.0f} s",
    SelfTestOutcome.IMU_AXES: (
        "when the robot was {moved}, its attitude turned about another axis or the other way: turn the IMU's frame in "
        "ballbot_read_imu, or repeat the test if the robot was moved otherwise"
    ),
    SelfTestOutcome.IMU_GYRO: (
        "when the robot was {moved}, the gyro's turn was not the attitude's: it has other axes, signs or another unit"
    ),
}


@dataclass(frozen=True, kw_only=True)
class RobotSample:
    """One sample of an armed robot."""

    t: float  #: since arming [s]
    state: NDArray[np.float64]  #: (10,) the robot's estimate, in the frame of the start; NaN if it has none
    reference: NDArray[np.float64]  #: (10,) that held at the sample, in the frame of the start
    torques: NDArray[np.float64]  #: (n,) from there on [N m]
    wheel_angles: NDArray[np.float64]  #: (n,) since arming [rad]
    wheel_speeds: NDArray[np.float64]  #: (n,) [rad/s]
    gyro: NDArray[np.float64]  #: (3,) body frame [rad/s]; NaN if the IMU gave nothing
    start: NDArray[np.float64]  #: (3,) x, y [m] and psi [rad] at arming, as the robot estimates them
    time: int  #: by the robot's clock [us], modulo 2^32

    def row(self) -> list[float]:
        """Return the sample as a row of a log."""
        sensed = self.wheel_angles, self.wheel_speeds, self.gyro
        return [
            self.t,
            *np.concatenate([self.torques, self.state, *sensed, self.reference[[0, 1, 4]]]).tolist(),
        ]


def log_columns(wheel_count: int) -> tuple[str, ...]:
    """Return the columns of the rows of `RobotSample`: those of a simulation, but for the truth."""
    return tuple(name for name in column_names(wheel_count) if not name.startswith(TRUE_PREFIX))


class FollowReference:
    """Gives references to the controller on the robot; one that does not arrive is sent again. A tuner tunes it."""

    place: ClassVar = ControllerPlace.ROBOT  #: whose torques the robot obeys

    def __init__(self, reference: LiveReference, *, sample_time: float, tuner: Tuner | None = None) -> None:
        self._source, self._step, self._tuner = reference, sample_time, tuner
        self._asked: NDArray[np.float64] | None = None
        self._sent = np.zeros(10, np.float32)  # the same in the robot's frame
        self._sent_at = 0.0  # time of the sample [s]

    @property
    def ended(self) -> bool:
        """Whether the driver ends the run."""
        return self._source.ended

    def command(self, session: Session, sample: RobotSample) -> None:
        """Send the reference of the next sample if it is another one, or if the robot still lacks the last one."""
        if self._tuner is not None:
            self._tuner.update(session, sample.t, sample.time)
        wanted = self._source.update(sample.t + self._step)
        if self._asked is None or not np.array_equal(wanted, self._asked):
            self._asked = wanted.copy()
            self._sent = in_robot_frame(wanted, sample.start).astype(np.float32)
        else:
            arrived = session.state is None or np.array_equal(session.state.reference, self._sent)
            if arrived or sample.t - self._sent_at < _REFERENCE_TIME:
                return
        session.set_reference(self._sent)
        self._sent_at = sample.t


class TorqueProgram:
    """Gives torques as a function of time: a sweep of the free wheels, or torques that stir a ball."""

    place: ClassVar = ControllerPlace.HOST
    ended = False

    def __init__(self, torques: Callable[[float], NDArray[np.float64]], *, sample_time: float) -> None:
        self._torques, self._step = torques, sample_time

    def command(self, session: Session, sample: RobotSample) -> NDArray[np.float64]:
        """Send the torques of the next sample; return the pose of the start."""
        session.set_torques(self._torques(sample.t + self._step))
        return np.zeros(10)


#: decides what is sent to the robot after a sample, and whether the run is to end
Commander = FollowReference | TorqueProgram


@dataclass(frozen=True, kw_only=True)
class Ending:
    """How a run ended."""

    kind: Literal["time", "driver", "interrupt", "stop", "link"]
    text: str  #: one sentence
    t: float  #: of the last sample, since arming [s]


class Samples:
    """Makes samples of a robot's states, from the first of them on."""

    def __init__(self, first: State, *, wheel_count: int, encoder_step: float) -> None:
        self._start = first.estimate[[0, 1, 4]].astype(np.float64)
        self._n, self._encoder_step = wheel_count, encoder_step
        self._last_time, self._micros = first.time, 0
        self._counts = first.wheel_counts.astype(np.int64)
        self._turned = np.zeros(len(self._counts), dtype=np.int64)

    def sample(self, state: State) -> RobotSample:
        """Return the sample of a state; its clock and its encoders may wrap around."""
        self._micros += (state.time - self._last_time) % 2**32
        self._last_time = state.time
        gone = wrapped(state.wheel_counts - self._counts)
        angles = np.full(self._n, np.nan)
        if state.encoders_valid:
            self._turned += gone
            self._counts = state.wheel_counts.astype(np.int64)
            angles = self._encoder_step * self._turned[: self._n].astype(np.float64)
        estimate = in_start_frame(state.estimate.astype(np.float64), self._start)
        return RobotSample(
            t=round(1e-6 * self._micros, 6),
            time=state.time % 2**32,
            start=self._start,
            state=estimate if state.estimate_valid else np.full(10, np.nan),
            reference=in_start_frame(state.reference.astype(np.float64), self._start),
            torques=state.torques[: self._n].astype(np.float64),
            wheel_angles=angles,
            wheel_speeds=state.wheel_speeds[: self._n].astype(np.float64),
            gyro=state.gyro.astype(np.float64) if state.imu_valid else np.full(3, np.nan),
        )


class LiveRobot:
    """A robot at the other end of a session."""

    def __init__(self, session: Session) -> None:
        """Take a session that is connected."""
        assert session.welcome is not None
        self.session, self.welcome = session, session.welcome
        self.parameters = session.read_parameters()  #: (1,), those on the robot

    @property
    def sample_time(self) -> float:
        """Of the robot [s]."""
        return round(float(self.parameters["sample_time"][0]), 9)  # of single precision

    @property
    def wheel_count(self) -> int:
        """Number of wheels."""
        return int(self.parameters["wheel_count"][0])

    @property
    def torque_limit(self) -> float:
        """Of the controller on the robot, each wheel [N m]."""
        return float(self.parameters["law"]["torque_limit"][0])

    @property
    def encoder_step(self) -> float:
        """Turn of a wheel in one count of its encoder [rad]."""
        return float(self.parameters["encoder_step"][0])

    @property
    def ball_from_wheels(self) -> NDArray[np.float64]:
        """T_obw (3, n) of the robot."""
        return self.parameters["onboard"]["ball_from_wheels"][0, :, : self.wheel_count].astype(np.float64)

    def parameter_lines(self) -> list[str]:
        """Return lines on the robot, its estimator and its controller."""
        record = self.parameters
        estimator = {number: name for name, number in ESTIMATORS.items()}[int(record["estimator"][0])]
        parts = [name for name in KINDS if record["law"][name]["on"][0]]
        return [
            f"{self.wheel_count} wheels, {1e3 * self.sample_time:g} ms a sample, estimator {estimator}",
            f"torque limit {self.torque_limit:g} N m, lean limit {record['safety']['lean'][0]:g} rad, "
            f"parts of the controller: {', '.join(parts) or 'none'}",
        ]

    def watch(self, show: Callable[[State], None], *, duration: float) -> None:
        """Show every state for a duration [s], or until Ctrl-C."""
        end = self.session.clock() + duration
        try:
            for state in self._states():
                show(state)
                if self.session.clock() >= end:
                    return
        except KeyboardInterrupt:
            return

    def use_parameters(self, parameters: NDArray[np.void]) -> bool:
        """Let the robot use these parameters (1,); return whether it had others.

        InputError if the robot has another number of wheels or sample time, is armed or does not accept them.
        """
        for name, unit in (("wheel_count", " wheels"), ("sample_time", " s between samples")):
            held, wanted = self.parameters[name][0], parameters[name][0]
            if held != wanted:
                raise InputError(
                    f"The robot has {held:g}{unit} and the controller is for {wanted:g}; export the firmware with this "
                    "controller and flash it."
                )
        if parameters.tobytes() == self.parameters.tobytes():
            return False
        self.session.write_parameters(parameters)
        self.parameters = self.session.read_parameters()
        if parameters.tobytes() != self.parameters.tobytes():
            raise LinkError("The robot does not have the parameters that were sent; send them again.")
        return True

    def test(
        self,
        operator: Operator | None = None,  # moves the robot if the axes of its IMU are still to be checked
        *,
        # motors and watch: as for `Session.self_test`
        motors: bool = True,
        watch: Callable[[State], None] = lambda _: None,
    ) -> SelfTestOutcome:
        """Run the self-test and return its result: PASSED, or IMU_PASSED before the motors' test.

        InputError if it fails or the link is lost.
        """
        move = operator.move if operator else None
        outcome = self.session.self_test(move=move, motors=motors, watch=watch)
        if outcome in (SelfTestOutcome.PASSED, SelfTestOutcome.IMU_PASSED):
            return outcome
        state = self.session.state
        wheel = state.self_test_wheel if state else 0  # or the movement, of the IMU
        moved = dict(enumerate(movement.words for movement in MOVEMENTS.values())).get(wheel)
        stop = stop_reason(state) if state else None
        text = _SELF_TESTS.get(outcome, "it did not run").format(wheel=wheel, moved=moved)
        if outcome == SelfTestOutcome.STOPPED and stop is not None:
            text = f"the safety layer stopped it: {STOPS[stop]}"
        raise InputError(f"The self-test failed: {text}.")

    def arm(
        self,
        confirm: Callable[[], bool],  # asks a person here
        *,
        controller: ControllerPlace,  # whose torques the robot obeys
        ramp: float = 0.0,  # time over which the torque limit rises from zero [s]
    ) -> None:
        """Arm, after a confirmation here.

        InputError if it is not confirmed, the robot refuses, or the link is lost.
        """
        result = self.session.arm(confirm, controller=controller, ramp=ramp)
        if result == AnswerResult.CONFIRM:
            raise InputError("Arming was not confirmed; the robot stays disarmed.")
        if result != AnswerResult.OK:
            raise InputError(f"The robot does not arm: {reason(result)}.")

    def disarm(self) -> None:
        """Disarm; a robot whose link is lost has stopped by itself."""
        if self.session.connected:
            self.session.disarm()

    def run(
        self,
        commander: Commander,
        *,
        duration: float,  # from arming on [s]
        record: Callable[[Sequence[float]], None],  # takes each sample's row
        watch: Callable[[RobotSample], None],  # takes each sample, for a monitor
    ) -> Ending:
        """Send an armed robot the commander's references or torques until the time is over or the run ends."""
        samples: Samples | None = None
        t, began = 0.0, self.session.clock()
        try:
            for state in self._states():
                if samples is None and not state.armed and self.session.clock() - began < _ARMING_TIME:
                    continue  # from before the arming
                if not state.armed or state.stop:
                    return Ending(kind="stop", text=_why_disarmed(state, t), t=t)
                if samples is None:
                    samples = Samples(state, wheel_count=self.wheel_count, encoder_step=self.encoder_step)
                sample = samples.sample(state)
                t = sample.t
                if t > duration - 0.5 * self.sample_time:
                    return Ending(kind="time", text=f"The run of {duration:g} s is over.", t=t)
                if commander.ended:
                    return Ending(kind="driver", text=f"The driver ended the run after {t:.1f} s.", t=t)
                wanted = commander.command(self.session, sample)
                if wanted is not None:
                    sample = replace(sample, reference=wanted)
                record(sample.row())
                watch(sample)
        except LinkError as error:
            return Ending(kind="link", text=str(error), t=t)
        except KeyboardInterrupt:
            return Ending(kind="interrupt", text=f"The run was interrupted after {t:.1f} s.", t=t)
        raise AssertionError  # the states have no end

    def _states(self) -> Iterator[State]:
        """Yield the robot's states as they come."""
        while True:
            yield from (message for message in self.session.poll(_PATIENCE) if isinstance(message, State))


def _why_disarmed(state: State, t: float) -> str:
    stop = stop_reason(state)
    if stop is None:
        return f"The robot was disarmed after {t:.2f} s."
    wheel = f" (wheel {state.stop_wheel})" if state.stop_wheel else ""
    return f"The robot stopped after {t:.2f} s: {STOPS[stop]}{wheel}."
