"""A part of the controller: settings, a record, a memory, and its steps in the law.

A part is one file with

    settings    a frozen dataclass, a `Part`; its table in a controller file follows from it
    record      a dataclass of the numbers that compiled code reads, computed from the settings by `Part.numbers`
    state       a dataclass of its memory from update to update, all zero at the start; none by default
    steps       compiled functions that the law calls

and joins the law by a line in `ballbot.control.parts.Parts` and the calls of its steps in `ballbot.control.law`. In
compiled code `law.NAME` is its record and `memory.NAME` its state, NAME being its field in `Parts`. To add a part:

1. Copy `notch.py`. Each setting is a `parameter`: meaning, unit and range. `eq=False` only if a setting is a matrix;
   records and states always have it. A constant of the robot's hardware is no setting: take it from `settings.robot`
   in `numbers`.
2. Begin the record with `on`. If the controller lacks the part, its record is all zeros, so that `on` is 0. Every step
   must then do nothing, or return its value unchanged: because it asks for `on`, or because it only adds products with
   numbers of the record or the state.
3. Choose a state in which zeros mean rest: this is the memory at the start and after `reset`. If a value does not rest
   at zero, keep its difference from the start, or a flag `started` (`PlannerState`).
4. Call its steps at their stage of the law: the past sample, the state, the reference, the error, the torques, and at
   the end the slow states.
5. Leave the torque limit to the law, which clips the filtered torques. If a torque exceeded the limit, or the error
   was reduced, the steps at the end receive `limited` as true: a slow state may then shrink but not grow.
6. Read any record and any memory, but write your own state only. One exception: a torque added against an estimated
   disturbance is also added to `disturbance_compensation` of the `TorqueHistory`. Name the parts that yours cannot work
   without in `needs`.
7. The disturbance observer takes `acting` of the history, the filtered and limited command, as the motors' torque; the
   prediction takes it less both compensations.
8. Have its C written: name it in `PARTS` of `tests/support/firmware_law.py` and run
   `python -m tests.support.firmware_headers`; `tests/firmware/test_law.py` compares both. A function that C has by
   hand is in `EXTERNALS` there.
9. Write `tests/control/test_NAME.py` for what is particular to the part. The tests of files, records, batches and
   missing samples, and damaged controller files, run with `example_parts` of
   `tests/support/control_examples.py`.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.control.lqr import frictionless_model
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.elementary import sine_cosine
from ballbot.mechanics.model import LinearModel
from ballbot.records import MAX_WHEELS, number
from ballbot.robot import Robot
from ballbot.robot.checks import check_parameters

#: updates in the history
MAX_PAST = 22


class Pair(NamedTuple):
    """A vector over the floor."""

    x: float
    y: float


class Pose(NamedTuple):
    """Place and heading."""

    x: float  # [m]
    y: float  # [m]
    psi: float  # [rad]


class HeadingFrame(NamedTuple):
    """The world's frame turned by psi about the vertical."""

    sin_psi: float
    cos_psi: float


class RobotState(NamedTuple):
    """A state, or an error of one."""

    x: float  # [m]
    y: float  # [m]
    theta: float  # [rad]
    phi: float  # [rad]
    psi: float  # [rad]
    x_dot: float  # [m/s]
    y_dot: float  # [m/s]
    theta_dot: float  # [rad/s]
    phi_dot: float  # [rad/s]
    psi_dot: float  # [rad/s]


class SmoothReference(NamedTuple):
    """The reference of x, y or psi with its derivatives."""

    value: float  # [m] or [rad]
    rate: float
    second: float
    third: float
    fourth: float


class FollowedMotion(NamedTuple):
    """The motion that is followed, relative to the measured pose."""

    x: SmoothReference
    y: SmoothReference
    psi: SmoothReference


class Sample(NamedTuple):
    """The values from which torques are computed; places are relative to the measured pose.

    A difference of two places is then rounded in proportion to itself, and not to their distance from the origin.
    """

    a: HeadingFrame  # of the state
    state: RobotState  # that is fed back
    to: FollowedMotion
    e: RobotState  # error, heading frame


@dataclass(frozen=True, kw_only=True, eq=False)
class TorqueHistory:
    """Each wheel's torques at the last updates, the newest first.

    Without a prediction only the newest are kept.
    """

    #: the command, which acts on the wheel
    acting: NDArray[np.float64] = field(metadata=number("N m", MAX_PAST, MAX_WHEELS))
    #: the summand against the friction of the robot's model
    friction_compensation: NDArray[np.float64] = field(metadata=number("N m", MAX_PAST, MAX_WHEELS))
    #: the summand against disturbances that parts estimate
    disturbance_compensation: NDArray[np.float64] = field(metadata=number("N m", MAX_PAST, MAX_WHEELS))
    #: 1 if any wheel's torque was at its limit
    limited: NDArray[np.float64] = field(metadata=number("1", MAX_PAST, MAX_WHEELS))


@inlined
def heading_frame(psi):
    """Return the heading frame of psi."""
    sin_psi, cos_psi = sine_cosine(psi)
    return HeadingFrame(sin_psi, cos_psi)


@inlined
def heading_frame_after(a, turn):
    """Return the heading frame after a small turn; the sum of a large psi and a small turn would be rounded."""
    small = heading_frame(turn)
    return HeadingFrame(
        small.cos_psi * a.sin_psi + small.sin_psi * a.cos_psi,
        small.cos_psi * a.cos_psi - small.sin_psi * a.sin_psi,
    )


@inlined
def turned(a, v_x, v_y):
    """Return a vector of the world in the heading frame."""
    return Pair(a.cos_psi * v_x + a.sin_psi * v_y, a.cos_psi * v_y - a.sin_psi * v_x)


@inlined
def turned_back(a, v_x, v_y):
    """Return a vector of the heading frame in the world."""
    return Pair(a.cos_psi * v_x - a.sin_psi * v_y, a.sin_psi * v_x + a.cos_psi * v_y)


@inlined
def turned_state(a, v):
    """Return a state or an error of the world in the heading frame."""
    place, lean = turned(a, v.x, v.y), turned(a, v.theta, v.phi)
    speed, lean_rate = turned(a, v.x_dot, v.y_dot), turned(a, v.theta_dot, v.phi_dot)
    return RobotState(
        place.x, place.y, lean.x, lean.y, v.psi, speed.x, speed.y, lean_rate.x, lean_rate.y, v.psi_dot
    )


@inlined
def pair_times(M, v):
    """Return the product of two rows of two and a vector."""
    return Pair(M[0, 0] * v.x + M[0, 1] * v.y, M[1, 0] * v.x + M[1, 1] * v.y)


@inlined
def clipped(value, limit):
    """Return a value within -limit .. limit; NaN stays NaN."""
    return limit if value > limit else (-limit if value < -limit else value)


@dataclass(frozen=True, kw_only=True, eq=False)
class LawSettings:
    """The numbers of a controller that its parts may use."""

    robot: Robot
    gain: NDArray[np.float64]  #: K (n, 10)
    sample_time: float  #: [s]
    compensation: str  #: "none", "full" or "partial"
    speed_band: float  #: [rad/s]
    delay: float  #: from a measurement to the action of its torque if the state is predicted; otherwise 0 [s]

    @cached_property
    def linear(self) -> LinearModel:
        """The robot's exact model without friction, linearised about upright."""
        return frictionless_model(self.robot).linearize()


@dataclass(frozen=True, kw_only=True, eq=False)
class NoState:
    """The state of a part without memory; compiled records have at least one field."""

    unused: float = field(default=0.0, metadata=number("1"))


@dataclass(frozen=True, kw_only=True, eq=False)
class Part(ABC):
    """The settings of a part; see the module's docstring. InputError if a setting is outside its range."""

    label: ClassVar[str]  #: its name in sentences, as "lean limit"
    comment: ClassVar[str]  #: stands above its table in a controller file
    record: ClassVar[type]
    state: ClassVar[type] = NoState
    needs: ClassVar[Mapping[str, str]] = {}  #: parts that it cannot work without, and why

    def __post_init__(self) -> None:
        try:
            check_parameters(self)
        except InputError as error:
            raise InputError(f"The {self.label}: {error}") from None

    @abstractmethod
    def numbers(self, settings: LawSettings) -> object:
        """Return the part's `record` for a controller.

        InputError if the part is not possible with that robot, sample time or number of wheels.
        """
