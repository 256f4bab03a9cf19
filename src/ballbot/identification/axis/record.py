"""Records of one axis.

`AxisRecord`: force and position of one axis over time, the load that it carries, and the loop that moved it if that is
known.

The axis is   (M + M_load) a = F + known forces - offset - G(q) - friction(v)   with F held over a sample. For an axis
that turns, M is an inertia [kg m^2], forces are torques [N m] and positions angles [rad].

Rows may come at uneven times, and rows may be missing: where the time between two rows is more than `GAP` times the
usual one, the force between them is unknown, and no prediction runs across.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import real_array, whole_number
from ballbot.errors import InputError

#: rows that make a record too short for any of the methods
LEAST_ROWS = 200
#: rows are even if no interval differs from the mean one by more than this share of it
EVEN = 0.05
#: an interval of so many usual ones is a gap
GAP = 4.0

Span = tuple[int, int]  #: first row and the row after the last


@dataclass(frozen=True, kw_only=True)
class PositionVelocityLoop:
    """A position loop around a velocity loop, both proportional.

    u = k_v (k_p (reference - position) - velocity), within +-limit; force = force_per_input u

    The velocity is the position's difference over `span` samples.
    """

    position_gain: float  #: k_p [1/s]
    velocity_gain: float  #: k_v [input s/m]
    force_per_input: float  #: [N/input]
    limit: float = np.inf  #: largest |u|
    span: int = 1  #: samples that the velocity is a difference over

    def __post_init__(self) -> None:
        for name in ("position_gain", "velocity_gain", "force_per_input", "limit"):
            if not getattr(self, name) > 0.0:
                words = name.replace("_", " ")
                raise InputError(f"The loop's {words} is {getattr(self, name):g}; it must be above zero.")
        whole_number(self.span, "The loop's span of samples", least=1)


@dataclass(frozen=True, kw_only=True)
class KnownLoad:
    """A load of known mass that the axis carries in addition to its own parts."""

    inertia: float = 0.0  #: added mass [kg] or inertia [kg m^2]
    weight: float = 0.0  #: its largest torque about an axis that turns, m g l [N m]
    hanging: float = 0.0  #: the angle at which it hangs straight down [rad]

    def __post_init__(self) -> None:
        for name in ("inertia", "weight", "hanging"):
            if not np.isfinite(getattr(self, name)):
                raise InputError(f"The load's {name} is {getattr(self, name):g}; it must be a finite number.")
        if self.inertia < 0.0:
            raise InputError(f"The load's mass is {self.inertia:g}; it must be zero or more.")


NO_LOAD = KnownLoad()


@dataclass(frozen=True, kw_only=True)
class Wraps:
    """How often a position began again after a turn, before it was unwrapped."""

    count: int = 0
    period: float = 0.0  #: after which it began again [m]


NO_WRAPS = Wraps()


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisRecord:
    """A record of one axis.

    Raises
    ------
    InputError
        If lengths differ, values are missing, the axis never moves, or there are too few rows.
    """

    name: str
    sample_time: float  #: h [s], the usual one if rows are uneven
    force: NDArray[np.float64]  #: (N,) F [N], held from each row to the next
    position: NDArray[np.float64]  #: (N,) [m]
    reference: NDArray[np.float64] | None = None  #: (N,) [m]; needed for closed loop
    loop: PositionVelocityLoop | None = None  #: needed for closed loop
    unit: Literal["m", "rad"] = "m"
    added: NDArray[np.float64] | None = None  #: (N,) the part of `force` that is not the loop's [N]
    times: NDArray[np.float64] | None = None  #: (N,) [s] of uneven rows; none of rows `sample_time` apart
    #: (N,), of any unit; residuals are tested for a dependence on it
    temperature: NDArray[np.float64] | None = None
    #: (N,), of the bearings, of any unit; residuals are tested for a dependence on it
    load: NDArray[np.float64] | None = None
    known_load: KnownLoad = NO_LOAD
    beyond_limit: float = (
        0.0  #: share of the rows whose recorded force exceeded the limit given; `force` is at it there
    )
    wraps: Wraps = NO_WRAPS  #: that the position had in its file; `position` has none

    def __post_init__(self) -> None:
        if not 0.0 < self.sample_time < np.inf:
            raise InputError(
                f"{self.name}: the sample time is {self.sample_time:g} s; it must be above zero."
            )
        words = {"added": "the added force", "times": "time"}
        for name in ("force", "position", "reference", "added", "times", "temperature", "load"):
            if getattr(self, name) is None:
                continue
            # contiguous and writable, as compiled code takes it
            values = real_array(getattr(self, name), ("N",), f"{self.name}: {name}", finite=False)
            object.__setattr__(self, name, values)
            if values.shape != (len(self.force),):
                raise InputError(
                    f"{self.name}: {words.get(name, name)} has {values.size} "
                    f"values and the force has {self.force.size}; name a column of the same length."
                )
            if not np.isfinite(values).all():
                row = int(np.flatnonzero(~np.isfinite(values))[0]) + 1
                raise InputError(
                    f"{self.name}: {name} is missing or not finite in row {row}; every row needs a value."
                )
        if len(self) < LEAST_ROWS:
            raise InputError(f"{self.name} has {len(self)} rows; at least {LEAST_ROWS} are needed.")
        if np.ptp(self.position) == 0.0:
            raise InputError(
                f"{self.name}: the position never changes, so friction cannot be identified; check its column."
            )
        if self.times is not None and not np.all(np.diff(self.times) > 0.0):
            raise InputError(f"{self.name}: time does not increase from each row to the next.")

    def __len__(self) -> int:
        return len(self.force)

    @property
    def even(self) -> bool:
        """Whether rows come at even times."""
        return self.times is None

    @property
    def loop_force(self) -> NDArray[np.float64]:
        """The part of the force that its loop gives (N,) [N]."""
        return self.force if self.added is None else self.force - self.added

    @cached_property
    def t(self) -> NDArray[np.float64]:
        """Time from the record's start (N,) [s]."""
        if self.times is not None:
            return self.times - self.times[0]
        return self.sample_time * np.arange(len(self), dtype=np.float64)

    @cached_property
    def durations(self) -> NDArray[np.float64]:
        """For how long each row's force is held (N,) [s]."""
        if self.times is None:
            return np.full(len(self), self.sample_time)
        return np.append(np.diff(self.times), self.sample_time)

    @cached_property
    def segments(self) -> tuple[Span, ...]:
        """The parts of the record between its gaps."""
        if self.times is None:
            return ((0, len(self)),)
        ends = np.flatnonzero(np.diff(self.times) > GAP * self.sample_time) + 1
        return tuple(pairwise((0, *ends.tolist(), len(self))))

    @property
    def duration(self) -> float:
        """From the first row to the end of the last one [s]."""
        return float(self.t[-1] + self.durations[-1])

    @property
    def force_unit(self) -> str:
        """[N], or [N m] for an axis that turns."""
        return "N" if self.unit == "m" else "N m"
