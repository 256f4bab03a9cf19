"""A part of the controller: settings, a record, a memory, and its steps in the law.

A part is one file with

    settings    a frozen dataclass, a `Part`; its table in a controller file follows from it
    record      a dataclass of the numbers that compiled code reads, computed from the settings by `Part.numbers`
    state       a dataclass of its memory from update to update, all zero at the start; none by default
    steps       compiled functions, each for one stage of the law (`Steps`)

and joins the law by a line in `ballbot.control.parts.Parts`. In compiled code `law.NAME` is its record and
`memory.NAME` its state, NAME being its field in `Parts`. A record of zeros means that the controller has no such part;
every step must then return its value unchanged.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.control.records import check_settings, number
from ballbot.robot import Robot


@dataclass(frozen=True, kw_only=True)
class Steps:
    """A part's functions by stage of the law, in the order of the stages; see `ballbot.control.law`.

    `law` and `memory` are the whole records, `n` the number of wheels, `i` a wheel, `now` a `Sample`. A step with a
    result receives the value of the step before it and returns its own.
    """

    #: (law, memory, seen, n): evaluate the sample that has passed; `seen` is a `Measured`
    observe: Callable | None = None
    #: (law, memory, seen, n) -> `Measured`: the state to be fed back
    predict: Callable | None = None
    #: (law, memory, wanted, state) -> wanted: three `Smooth`, of x, y and psi
    shape: Callable | None = None
    #: (law, memory, (e, limited), a, wanted) -> (e, limited): error (10,) in the heading frame, and if it is limited
    error: Callable | None = None
    #: (law, memory, torque, now, i) -> torque [N m]: the feedback's, with the part's summand
    torque: Callable | None = None
    #: (law, memory, torque, i) -> torque [N m]: after friction compensation, before the torque limit
    filter: Callable | None = None
    #: (law, memory, now, limited): update slow states; `limited` if a torque or the error was at its limit
    learn: Callable | None = None


class Smooth(NamedTuple):
    """The reference of x, y or psi with its derivatives, in compiled code."""

    value: float
    rate: float
    second: float
    third: float
    fourth: float


class Measured(NamedTuple):
    """A state with its attitude, in compiled code."""

    a: tuple  #: `ballbot.mechanics.equations.Attitude` of the state
    state: NDArray[np.float64]  #: (10,)


class Sample(NamedTuple):
    """The values from which torques are computed, in compiled code."""

    a: tuple  #: `ballbot.mechanics.equations.Attitude` of the state
    state: NDArray[np.float64]  #: (10,) that is fed back
    wanted: tuple  #: `Smooth` of x, y and psi
    e: tuple  #: error (10,), heading frame


@dataclass(frozen=True, kw_only=True, eq=False)
class LawSettings:
    """The numbers of a controller that its parts may use."""

    robot: Robot
    gain: NDArray[np.float64]  #: K (n, 10)
    sample_time: float  #: [s]
    compensation: str  #: "none", "full" or "partial"
    speed_band: float  #: [rad/s]
    delay: float  #: from a measurement to the action of its torque if the state is predicted; otherwise 0 [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class NoState:
    """The state of a part without memory; compiled records have at least one field."""

    unused: float = field(default=0.0, metadata=number("1"))


@dataclass(frozen=True, kw_only=True, eq=False)
class Part(ABC):
    """The settings of a part; see the module's docstring.

    Raises
    ------
    InputError
        If a setting is outside its range.
    """

    label: ClassVar[str]  #: its name in sentences, as "lean limit"
    comment: ClassVar[str]  #: stands above its table in a controller file
    record: ClassVar[type]
    state: ClassVar[type] = NoState
    steps: ClassVar[Steps]

    def __post_init__(self) -> None:
        check_settings(self, self.label)

    @abstractmethod
    def numbers(self, settings: LawSettings) -> object:
        """Return the part's `record` for a controller.

        Raises
        ------
        InputError
            If the part is not possible with that robot, sample time or number of wheels.
        """
