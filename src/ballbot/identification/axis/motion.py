"""An axis with a friction law, moved by forces or by its loop."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array, real_number
from ballbot.errors import InputError
from ballbot.identification.axis.laws import Rung, Values
from ballbot.identification.axis.motion_lanes import follow_forces, follow_loop
from ballbot.identification.axis.record import AxisRecord
from ballbot.simulation.driveline import Driveline

#: explicit steps are at most this part of the axis's fastest time constant
_LARGEST_RATE_STEP = 0.5
_MOST_STEPS = 1000  # a sample


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """What an axis does."""

    positions: NDArray[np.float64]  #: (n,) [m]
    forces: NDArray[np.float64]  #: (n,) [N]


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """A mass with friction and a constant force against it."""

    rung: Rung
    values: Values

    def open_loop(
        self, forces: ArrayLike, *, position: float, speed: float, sample_time: float
    ) -> NDArray[np.float64]:
        """Return the positions (n,) after each of the forces (n,) held over a sample.

        Raises
        ------
        InputError
            If the forces are not a row of finite numbers, another number is not finite, or the sample time is not
            above zero.
        """
        acting = real_array(forces, ("n",), "The row of forces")
        sample_time = positive_number(sample_time, "The sample time")
        position, speed = real_number(position, "The position"), real_number(speed, "The speed")
        (plus, minus), steps = self.rung.laws(self.values), self._steps(sample_time)
        positions = np.empty(len(acting))
        follow_forces(
            plus.numbers(),
            minus.numbers(),
            Driveline(inertia=self.values["mass"], friction=plus).numbers(),
            plus.initial_state(sample_time / steps),
            position,
            speed,
            acting - self._offset,
            sample_time,
            steps,
            positions,
        )
        return positions

    def closed_loop(self, record: AxisRecord, *, speed: float) -> Trajectory:
        """Return positions and forces (N,) at the record's rows, from its first position and that speed [m/s].

        Raises
        ------
        InputError
            Where the record has no loop or no reference.
        """
        loop = record.loop
        if loop is None or record.reference is None:
            raise InputError(
                f"{record.name} does not contain the control loop; give its gains and its reference."
            )
        speed = real_number(speed, "The speed")
        (plus, minus), steps = self.rung.laws(self.values), self._steps(record.sample_time)
        positions, forces = np.empty((2, len(record)))
        # a limit that is not finite is one that is never reached
        limit = loop.limit if math.isfinite(loop.limit) else np.finfo(float).max
        follow_loop(
            plus.numbers(),
            minus.numbers(),
            Driveline(inertia=self.values["mass"], friction=plus).numbers(),
            plus.initial_state(record.sample_time / steps),
            float(record.position[0]),
            speed,
            self._offset,
            record.reference,
            np.zeros(len(record)) if record.added is None else record.added,
            np.array([loop.position_gain, loop.velocity_gain, loop.force_per_input, limit]),
            loop.span,
            record.sample_time,
            steps,
            positions,
            forces,
        )
        return Trajectory(positions=positions, forces=forces)

    @property
    def _offset(self) -> float:
        return self.values.get("offset", 0.0)

    def _steps(self, sample_time: float) -> int:
        slope = max(law.explicit_slope() for law in self.rung.laws(self.values))
        wanted = sample_time * slope / self.values["mass"] / _LARGEST_RATE_STEP
        return min(max(1, math.ceil(wanted)), _MOST_STEPS)
