"""Records of one axis.

The axis is   M a = F - offset - G(q) - friction(v)   with F held over a row. For an axis that turns, M is an inertia
[kg m^2], forces are torques [N m] and positions angles [rad].

Rows are even. Where the time between two of them is more than `GAP` times the usual one, the force between them is
unknown: the record has parts there, and no prediction runs across. Rows that came at uneven times are interpolated.
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
from ballbot.findings import Finding

#: rows that make a record too short for any of the methods
LEAST_ROWS = 200
#: rows are even if no interval within a part differs from the usual one by more than this share of it
EVEN = 0.05
#: an interval of so many usual ones is a gap
GAP = 4.0

Span = tuple[int, int]  #: first row and the row after the last


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisRecord:
    """A record of one axis; `record_of_rows` makes one of rows at any times.

    InputError if lengths differ, values are missing, the axis never moves, or there are too few rows.
    """

    name: str
    sample_time: float  #: h [s]
    force: NDArray[np.float64]  #: (N,) F [N], held from each row to the next
    position: NDArray[np.float64]  #: (N,) [m]
    unit: Literal["m", "rad"] = "m"
    times: NDArray[np.float64] | None = None  #: (N,) [s] of rows with gaps between them; none without
    even: bool = True  #: whether rows came at even times, as those of a loop that holds the force
    findings: tuple[Finding, ...] = ()  #: what was done to the file's values

    def __post_init__(self) -> None:
        if not 0.0 < self.sample_time < np.inf:
            raise InputError(
                f"{self.name}: the sample time is {self.sample_time:g} s; it must be above zero."
            )
        for name in ("force", "position", *(() if self.times is None else ("times",))):
            # contiguous and writable, as compiled code takes it
            values = real_array(getattr(self, name), (np.size(self.force),), f"{self.name}: {name}")
            object.__setattr__(self, name, values)
        if len(self) < LEAST_ROWS:
            raise InputError(f"{self.name} has {len(self)} rows; at least {LEAST_ROWS} are needed.")
        if np.ptp(self.position) == 0.0:
            raise InputError(
                f"{self.name}: the position never changes, so friction cannot be identified; check its column."
            )

    def __len__(self) -> int:
        return len(self.force)

    @cached_property
    def t(self) -> NDArray[np.float64]:
        """Time from the record's start (N,) [s]."""
        if self.times is not None:
            return self.times - self.times[0]
        return self.sample_time * np.arange(len(self), dtype=np.float64)

    @cached_property
    def parts(self) -> tuple[Span, ...]:
        """The parts of the record between its gaps."""
        ends = np.flatnonzero(np.diff(self.t) > GAP * self.sample_time) + 1
        return tuple(pairwise((0, *ends.tolist(), len(self))))

    @property
    def duration(self) -> float:
        """From the first row to the end of the last one [s]."""
        return float(self.t[-1] + self.sample_time)

    @property
    def force_unit(self) -> str:
        """[N], or [N m] for an axis that turns."""
        return "N" if self.unit == "m" else "N m"


def record_of_rows(
    name: str,
    t: NDArray[np.float64],
    force: NDArray[np.float64],
    position: NDArray[np.float64],
    *,
    unit: Literal["m", "rad"] = "m",
    findings: tuple[Finding, ...] = (),
) -> AxisRecord:
    """Return the record of rows at times t (N,) [s]; uneven ones are interpolated in each part between gaps.

    InputError if time does not increase from row to row, or the rows make no record.
    """
    if len(t) < 2:
        raise InputError(f"{name}: the time has fewer than two rows.")
    steps = np.diff(t)
    if not steps.min() > 0.0:
        row = int(np.argmin(steps)) + 2
        raise InputError(
            f"{name}, row {row}: time does not increase ({t[row - 1]:.12g} after {t[row - 2]:.12g} s). "
            "Sort the rows, leave out repeated ones, or split the file."
        )
    usual = float(np.median(steps))
    gaps = steps > GAP * usual
    h = float(np.mean(steps[~gaps]))
    even = bool(np.abs(steps[~gaps] - h).max() <= EVEN * h)
    h = h if even else usual
    times = []
    for first, end in pairwise((0, *(np.flatnonzero(gaps) + 1).tolist(), len(t))):
        count = end - first if even else int((t[end - 1] - t[first]) / h + 1e-9) + 1
        times.append(t[first] + h * np.arange(count))
    rows = np.concatenate(times)
    return AxisRecord(
        name=name,
        sample_time=h,
        force=force if even else np.interp(rows, t, force),
        position=position if even else np.interp(rows, t, position),
        unit=unit,
        times=rows if gaps.any() else None,
        even=even,
        findings=findings,
    )
