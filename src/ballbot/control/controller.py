"""The controller as one object: LQR gain, heading frame, friction compensation, torque limit, and parts to add."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import checked_sample_time, positive_number, real_array
from ballbot.control.law import ALLOWED, LAW_SIZE, LAW_TYPE, MEMORY_SIZE, MEMORY_TYPE, control_law, law_record
from ballbot.control.lqr import frictionless_model, gain_rows, sampling_words
from ballbot.control.parts import Parts
from ballbot.control.parts.part import LawSettings
from ballbot.control.tuning import Setting, take_setting
from ballbot.errors import InputError
from ballbot.estimation.interface import EstimatorName, checked_name
from ballbot.log.columns import STATE_NAMES
from ballbot.mechanics.geometry import wheel_load
from ballbot.mechanics.traction import torques_of_lean, traction_torque
from ballbot.results import to_results
from ballbot.robot import Friction, Robot, RobotLike, as_robot
from ballbot.robot.derived import encoder_step
from ballbot.robot.parameters import Value
from ballbot.summary import Plotted, Summary

Compensation = Literal["none", "full", "partial"]

#: width of the band around zero speed, in encoder counts a sample; see `default_speed_band`
BAND_COUNTS = 8.0


def default_speed_band(robot: Robot, sample_time: float) -> float:
    """Return the wheel speed [rad/s] below which the compensated friction's sign becomes a ramp.

    At a standstill an encoder's count flickers by one, which changes the compensation by 1/`BAND_COUNTS` of the
    friction. A narrower band chatters; a wider one leaves friction uncompensated (on the twin's square the peak error
    grows from 0.2 rad/s on).
    """
    step = encoder_step(robot)
    return BAND_COUNTS * step / sample_time


#: largest traction of a wheel over its load at rest, if the grip is unknown: beyond it a stiff controller spins its
#: wheels in a fall. A fall unloads wheels: most presets need a grip of 0.5 for it (`traction_torque`)
GRIP_FRACTION = 0.4
#: standard deviations by which the grip may be less than the robot file states
_GRIP_DEVIATIONS = 2.0


#: lean [rad] from which a robot must be brought back: errors command up to 0.1 rad (`LeanLimit`)
_CAUGHT_LEAN = 0.14
#: speed over the floor at which it is caught [m/s], also over that of the motors without load
_CATCH_SPEED, _CATCH_MOTOR_SPEED = 1.0, 0.4
#: least torque of motors over that commanded (weak magnets, warm windings, losses of gears), and for how long the robot
#: falls on until it acts [s]: a sample or two of transport and AHRS, and the drivers' lag
_LEAST_TORQUE, _LATE = 0.85, 0.0125


def torque_of_lean(robot: Robot) -> float:
    """Return the torque [N m/rad] of its most loaded wheel that holds a lean while the ball accelerates."""
    return float(np.linalg.norm(torques_of_lean(frictionless_model(robot)), axis=1).max())


def wheel_turns(robot: Robot) -> float:
    """Return a wheel's speed over that of the robot, in its fastest direction [rad/m]."""
    return float(np.linalg.norm(frictionless_model(robot).wheel_jacobian(np.zeros(5))[:, :2], axis=1).max())


def certain_grip(robot: Robot) -> float:
    """Return `wheels.grip` less two standard deviations; 0 if the grip is unknown, or its deviation too large.

    >>> certain_grip(Robot.load("alten").replace({"wheels.grip": 0.8}))
    0.8
    """
    deviation = robot.standard_deviations.get("wheels.grip", 0.0)
    assert isinstance(deviation, float)
    return max(robot.wheels.grip - _GRIP_DEVIATIONS * deviation, 0.0)


def assumed_grip(robot: Robot) -> float:
    """Return `certain_grip`, or 1, that of rubber on rubber, if it is unknown."""
    return certain_grip(robot) or 1.0


def grip_torque_limit(robot: Robot) -> float:
    """Return the largest wheel torque [N m] without slip on the ball, at most the motors' own limit.

    `wheels.grip` less two standard deviations gives it; one without a deviation only if that is less than by default.
    """
    friction = max(robot.friction.breakaway)  # the drive takes this part; it never reaches the contact
    traction = GRIP_FRACTION * wheel_load(robot) * robot.wheels.radius
    if certain := certain_grip(robot):
        known = traction_torque(frictionless_model(robot), certain)
        traction = known if robot.standard_deviations.get("wheels.grip") else min(known, traction)
    return min(robot.drive.torque_limit, traction + friction)


def catching_torque_limit(robot: Robot, certain: Friction) -> float:
    """Return `grip_torque_limit` with the `certain` friction, or what it takes to catch a fall if that is more [N m].

    A drive may take all of the break-away torque, also what is not certain of it, and of a motor on a voltage or a duty
    the back-EMF, which is viscous friction. Where this, and what weak motors give, leaves less than a lean of
    `_CAUGHT_LEAN` needs once the torque acts, a robot that spares its grip falls.
    """
    speed = min(_CATCH_SPEED * wheel_turns(robot), _CATCH_MOTOR_SPEED * robot.drive.top_speed)
    lost = max(robot.friction.breakaway) + max(certain.viscous) * speed
    spared = grip_torque_limit(robot.replace(friction=certain))
    # friction is identified by the torques commanded, so what motors lack is in it
    growth = float(frictionless_model(robot).linearize().poles().real.max())
    needed = _CAUGHT_LEAN * math.exp(_LATE * growth) * torque_of_lean(robot) / _LEAST_TORQUE
    return max(spared, min(robot.drive.torque_limit, needed + lost))


def torque_limit_words(controller: Controller) -> str:
    """Return a controller's torque limit, with the reason if it is below the motors' limit."""
    limit, motors = controller.torque_limit, controller.robot.drive.torque_limit
    if limit >= motors:
        return f"{limit:.4g} N m"
    of_grip = limit >= (1.0 - 1e-3) * grip_torque_limit(controller.robot)
    why = ", because more would spin the wheels on the ball" if of_grip else ""
    return f"{limit:.4g} N m of the {motors:.4g} N m that the motors give{why}"


class Controller(Plotted):
    """u = K S(psi) (r - x) + friction compensation, limited, and what is added to it; see `ballbot.control.law`.

    Its settings are fixed once it is made; `tune` changes them within bounds while it runs, `reset` clears its memory.
    `plot()` shows the Bode diagram of the loop; of an unstable one its poles.

    Parameters
    ----------
    robot : Robot, preset or robot file
        Its friction is what is compensated; its geometry gives the wheel speeds.
    gain : array_like (n, 10)
        K, designed at psi = 0, as `ballbot.lqr` returns it.
    sample_time : float, optional
        [s]; the robot's own if not given.
    compensation : {"none", "full", "partial"}
        "full": each wheel's whole friction; "partial": only while it works against the intended motion
        (thesis 5.2). Either carries the rolling friction by the wheels.
    torque_limit : float, optional
        [N m] for each wheel; the robot's own if not given.
    speed_band : float, optional
        Wheel speed [rad/s] below which the friction's sign is a linear ramp; `default_speed_band` if not given.
    parts : Parts
        Additional parts; none by default.
    estimator : {"onboard", "kalman"}
        The estimator whose state the controller is designed for. It does not change the law: a simulation with
        sensors and the firmware feed this state back.

    Raises
    ------
    InputError
        If a value is out of range, or a part belongs to another robot.

    Examples
    --------
    A robot at rest 0.1 m from its reference:

    >>> from ballbot import lqr
    >>> from ballbot.control.references import hold
    >>> design = lqr("alten", [20, 20, 500, 500, 5, 30, 30, 20, 20, 2], 30.0, sample_time=0.005)
    >>> controller = Controller("alten", design.gain, compensation="full")
    >>> controller.update(0.0, np.zeros(10), hold(x=0.1)(0.0)).round(3)
    array([-0.   ,  0.056, -0.056])
    """

    def __init__(
        self,
        robot: RobotLike,
        gain: ArrayLike,
        *,
        sample_time: float | None = None,
        compensation: Compensation = "none",
        torque_limit: float | None = None,
        speed_band: float | None = None,
        parts: Parts = Parts(),  # noqa: B008 (frozen)
        estimator: EstimatorName = "onboard",
    ) -> None:
        self.robot: Robot = as_robot(robot)
        robot = self.robot
        self.gain = _checked_gain(gain, robot.wheel_count)
        self.sample_time = checked_sample_time(
            robot.sensors.sample_time if sample_time is None else sample_time, "The controller's sample time"
        )
        if compensation not in get_args(Compensation):
            raise InputError(f"The compensation is {compensation!r}; it must be 'none', 'full' or 'partial'.")
        self.compensation: Compensation = compensation
        limit = robot.drive.torque_limit if torque_limit is None else torque_limit
        self.torque_limit = positive_number(limit, "The controller's torque limit")
        band = default_speed_band(robot, self.sample_time) if speed_band is None else speed_band
        self.speed_band = positive_number(band, "The controller's speed band")
        self.parts = parts
        self.estimator: EstimatorName = checked_name(estimator)
        #: values of the robot that the design assumed, from the controller's file; None if they are those of `robot`
        self.designed_for: Mapping[str, Value] | None = None
        #: whose gains it can mix with its own while it runs; `ballbot.control.gain_set.tunable` gives them
        self.others: tuple[Controller, ...] = ()
        settings = LawSettings(
            robot=robot,
            gain=self.gain,
            sample_time=self.sample_time,
            compensation=compensation,
            speed_band=self.speed_band,
            delay=parts.prediction.delay if parts.prediction else 0.0,
        )
        record = law_record(settings, torque_limit=self.torque_limit, parts=parts)
        weights = parts.policy.weights if parts.policy else ()
        #: the controller's numbers as the law reads them: the record, and a policy's weights behind it
        self.packed = np.concatenate([record.view(np.float64), weights])
        self._memory = np.zeros(MEMORY_SIZE)

    @property
    def record(self) -> NDArray[np.void]:
        """The controller's numbers, (1,) of `ballbot.control.law.LAW`."""
        return self.packed[:LAW_SIZE].view(LAW_TYPE)

    @property
    def memory(self) -> NDArray[np.void]:
        """Its memory, (1,) of `ballbot.control.law.MEMORY`."""
        return self._memory.view(MEMORY_TYPE)

    def summary(self) -> Summary:
        """Return the controller's settings and its gain."""
        parts = [name for name, _ in self.parts.present()]
        rows = (
            ("compensation", self.compensation),
            ("state from", f"the estimator {self.estimator}"),
            ("torque limit", torque_limit_words(self)),
            ("speed band", f"{self.speed_band:.3g} rad/s"),
            ("parts", ", ".join(parts).replace("_", " ") or "none"),
        )
        title = f"Controller of the robot {self.robot.name}, {sampling_words(self.sample_time)}"
        return Summary(title=title, rows=(*rows, *gain_rows(self.gain)))

    def to_dict(self) -> dict[str, object]:
        """Return the settings; the robot by name and with the friction that is compensated.

        Returns
        -------
        dict
            Of values that JSON can hold.

        Examples
        --------
        >>> from ballbot.control.presets import nominal_controller
        >>> nominal_controller("alten").to_dict()["compensation"]
        'none'
        """
        names = ("sample_time", "compensation", "torque_limit", "speed_band", "estimator", "gain", "parts")
        own = {"robot": self.robot.name, "friction": self.robot.friction}
        return to_results(own | {name: getattr(self, name) for name in names})

    def with_compensation(self, compensation: Compensation) -> Controller:
        """Return a copy that compensates friction in another way.

        Parameters
        ----------
        compensation : {"none", "full", "partial"}

        Returns
        -------
        Controller

        Raises
        ------
        InputError
            If `compensation` is another word.

        Examples
        --------
        >>> from ballbot.control.presets import nominal_controller
        >>> nominal_controller("alten").with_compensation("full").compensation
        'full'
        """
        return self._copy(compensation=compensation)

    def with_parts(self, parts: Parts) -> Controller:
        """Return a copy with other parts.

        Parameters
        ----------
        parts : Parts
            All that it is to have; those it has now are not kept.

        Returns
        -------
        Controller

        Raises
        ------
        InputError
            If a part belongs to another robot.

        Examples
        --------
        >>> from ballbot.control.presets import precise_controller
        >>> precise_controller("alten").with_parts(Parts()).follows_plans
        False
        """
        return self._copy(parts=parts)

    def with_estimator(self, estimator: EstimatorName) -> Controller:
        """Return a copy that is designed for the state of another estimator; its law is the same.

        Parameters
        ----------
        estimator : {"onboard", "kalman"}

        Returns
        -------
        Controller

        Raises
        ------
        InputError
            If there is no such estimator.

        Examples
        --------
        >>> from ballbot.control.presets import nominal_controller
        >>> nominal_controller("alten").with_estimator("kalman").estimator
        'kalman'
        """
        return self._copy(estimator=estimator)

    @property
    def follows_plans(self) -> bool:
        """Whether it follows references with leans and rates: if it has feed-forward."""
        return self.parts.feed_forward is not None

    def reset(self) -> None:
        """Clear the memory at the start of a run; a shaped reference then starts at the first measured pose.

        Examples
        --------
        >>> from ballbot.control.presets import precise_controller
        >>> precise_controller("alten").reset()
        """
        self._memory[:] = 0.0

    def tune(self, setting: Setting | None) -> None:
        """Change to another setting while it runs, or back; see `ballbot.control.tuning`.

        Parameters
        ----------
        setting : Setting or None
            None goes back to the former one.

        Raises
        ------
        InputError
            If the setting is not within its gains and compensation.

        Examples
        --------
        >>> from ballbot.control.presets import nominal_controller
        >>> from ballbot.control.tuning import Setting
        >>> controller = nominal_controller("alten")
        >>> controller.tune(None)
        """
        take_setting(self.record["tuning"][0], self.memory["tuning"][0], setting)

    def update(
        self,
        t: float,  # noqa: ARG002
        state: ArrayLike,
        reference: ArrayLike,
    ) -> NDArray[np.float64]:
        """Return the wheel torques for one sample; they do not depend on the time.

        Parameters
        ----------
        t : float
            [s].
        state : array_like (10,)
            Measured: x, y [m] of the ball in the world frame, theta, phi, psi [rad], and their rates. If a value is
            missing (NaN), infinite or beyond `LARGEST_STATE`, the torques are zero and the memory stays as it is.
        reference : array_like (10,)
            Desired state; without feed-forward only x, y and psi may differ from zero.

        Returns
        -------
        ndarray (n,)
            [N m], within the torque limit.

        Raises
        ------
        InputError
            If a shape is wrong, or the reference has a value that is not finite, or a lean or a rate without
            feed-forward.

        Examples
        --------
        A lean about x of 0.01 rad:

        >>> from ballbot.control.presets import nominal_controller
        >>> controller = nominal_controller("alten")
        >>> controller.update(0.0, [0, 0, 0.01, 0, 0, 0, 0, 0, 0, 0], np.zeros(10)).round(3)
        array([-0.246,  0.123,  0.123])
        """
        measured = real_array(state, (10,), "The state", finite=False)
        wanted = real_array(reference, (10,), "The reference")
        torques = np.empty(len(self.gain))
        plans = self.follows_plans
        index = control_law(self.packed, self._memory, measured, wanted, torques, plans=plans)
        if index != ALLOWED:
            raise InputError(refusal(index, float(wanted[index])))
        return torques

    def _copy(
        self,
        *,
        compensation: Compensation | None = None,
        parts: Parts | None = None,
        estimator: EstimatorName | None = None,
    ) -> Controller:
        copy = Controller(
            self.robot,
            self.gain,
            sample_time=self.sample_time,
            compensation=compensation or self.compensation,
            torque_limit=self.torque_limit,
            speed_band=self.speed_band,
            parts=self.parts if parts is None else parts,
            estimator=estimator or self.estimator,
        )
        copy.designed_for = self.designed_for
        return copy


def refusal(index: int, value: float) -> str:
    """Return why a reference with this value in an element of the state is refused."""
    return (
        f"The reference asks for {STATE_NAMES[index]} = {value:.6g}; it must be zero: without feed-forward only x, y "
        "and psi can be asked for. With it A r is not 0, and the closed loop e_dot = r_dot - A r + (A - B K) e "
        "does not settle on the reference. The precise controller has feed-forward."
    )


def _checked_gain(gain: ArrayLike, wheel_count: int) -> NDArray[np.float64]:
    if not isinstance(gain, list | tuple | np.ndarray):
        raise InputError(
            f"The gain is a {type(gain).__name__}; it must be {wheel_count} rows of 10 numbers, such as "
            "`lqr(...).gain`."
        )
    matrix = real_array(gain, (wheel_count, 10), "The gain").copy()
    matrix.setflags(write=False)
    return matrix
