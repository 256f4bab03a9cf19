"""What a part of the controller is: settings, a record, what it remembers, and the steps that it adds to the law.

A part is one file with

    settings    a frozen dataclass, a `Part`; its table in a controller file follows from it
    record      a dataclass of the numbers that compiled code reads, made from the settings by `Part.numbers`
    state       a dataclass of what it remembers from update to update, all zero at the start; none by default
    steps       compiled functions, each for one stage of the law (`Steps`)

and becomes part of the law by a line in `ballbot.control.parts.Parts`. In compiled code `law.NAME` is its record and
`memory.NAME` its state, NAME being its field in `Parts`; a record of zeros means that the controller has no such part,
which every step must heed.
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
    """What a part adds to each stage of the law, in their order; see `ballbot.control.law`.

    `law` and `memory` are the whole records, `a` the attitude, `n` the number of wheels, `i` a wheel, `now` a `Sample`.
    """

    #: (law, memory, a, measured, n): look back on the sample that has passed
    observe: Callable | None = None
    #: (law, memory, a, state, n) -> state, whether it is another: the state to be fed back
    predict: Callable | None = None
    #: (law, memory, state, wanted) -> wanted: three `Smooth`, of x, y and psi
    shape: Callable | None = None
    #: (law, memory, a, wanted, e) -> e, whether a limit made it smaller: the error (10,) in the heading frame
    error: Callable | None = None
    #: (law, memory, now, i) -> a summand of the feedback's own torque [N m]
    torque: Callable | None = None
    #: (law, memory, i, torque) -> torque: after friction compensation, before the torque limit
    filter: Callable | None = None
    #: (law, memory, now, limited): step what is learnt; `limited` says that a torque or the error was at its limit
    learn: Callable | None = None


class Smooth(NamedTuple):
    """The reference of x, y or psi with its derivatives, in compiled code."""

    value: float
    rate: float
    second: float
    third: float
    fourth: float


class Sample(NamedTuple):
    """What the law knows when it computes torques, in compiled code."""

    a: tuple  #: `ballbot.mechanics.equations.Attitude` of the state
    state: NDArray[np.float64]  #: (10,) that is fed back
    wanted: tuple  #: `Smooth` of x, y and psi
    e: tuple  #: error (10,), heading frame


@dataclass(frozen=True, kw_only=True, eq=False)
class LawSettings:
    """What parts may use of the controller that they belong to."""

    robot: Robot
    gain: NDArray[np.float64]  #: K (n, 10)
    sample_time: float  #: [s]
    compensation: str  #: "none", "full" or "partial"
    speed_band: float  #: [rad/s]
    delay: (
        float  #: from a measurement to the action of its torque, where it is predicted over; otherwise 0 [s]
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class NoState:
    """What a part remembers that remembers nothing; compiled records have at least one field."""

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
