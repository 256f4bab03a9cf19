"""Records of one axis.

The axis is   M a = F - offset - G(q) - friction(v)   with F held over a sample. For an axis that turns, M is an inertia
[kg m^2], forces are torques [N m] and positions angles [rad].

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

from ballbot.arrays import real_array
from ballbot.errors import InputError

#: rows that make a record too short for any of the methods
LEAST_ROWS = 200
#: rows are even if no interval differs from the mean one by more than this share of it
EVEN = 0.05
#: an interval of so many usual ones is a gap
GAP = 4.0

Span = tuple[int, int]  #: first row and the row after the last


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
    unit: Literal["m", "rad"] = "m"
    times: NDArray[np.float64] | None = None  #: (N,) [s] of uneven rows; none of rows `sample_time` apart
    wrap: float = 0.0  #: period after which the position begins again in its file [m]; `position` counts on

    def __post_init__(self) -> None:
        if not 0.0 < self.sample_time < np.inf:
            raise InputError(
                f"{self.name}: the sample time is {self.sample_time:g} s; it must be above zero."
            )
        words = {"times": "time"}
        for name in ("force", "position", "times"):
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
