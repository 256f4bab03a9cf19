"""The parameters as a search sees them: each scaled to run from 0 to 1 between its bounds.

    p = lower + z (upper - lower)          amounts and numbers of either sign
    p = lower (upper / lower)^z            sizes of which ratios matter, as v_s, delta and a torque's gain

Their order is that of a `ballbot.identification.quantities.Layout`: friction's 3 n + 3 numbers first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.bounds import Bounds
from ballbot.identification.quantities import BY_NAME, FRICTION, Layout, Quantity, names_in
from ballbot.robot import Robot


@dataclass(frozen=True, kw_only=True, eq=False)
class Coordinates:
    """How p parameters are scaled."""

    layout: Layout
    before: NDArray[np.float64]  #: (p,), the robot's own values, and the neutral ones of inputs and sensors
    lower: NDArray[np.float64]  #: (p,)
    upper: NDArray[np.float64]  #: (p,)
    logarithmic: NDArray[np.bool_]  #: (p,)
    amounts: NDArray[np.bool_]  #: (p,), those that a random search looks at more closely near zero

    @property
    def labels(self) -> tuple[str, ...]:
        """The parameters' labels (p,), as "b1" or "C_rr"."""
        return self.layout.labels

    @property
    def names(self) -> tuple[str, ...]:
        """The quantity that each parameter belongs to (p,)."""
        count = self.layout.wheel_count
        return tuple(name for name in self.layout.names for _ in BY_NAME[name].labels(count))

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which parameters their bounds leave free (p,)."""
        return self.upper > self.lower

    def physical(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return parameters (..., p) in SI units from scaled ones (..., p)."""
        low = np.where(self.logarithmic, self.lower, 1.0)
        ratio = np.where(self.logarithmic, self.upper / low, 1.0)
        linear = self.lower + scaled * (self.upper - self.lower)
        return np.clip(np.where(self.logarithmic, low * ratio**scaled, linear), self.lower, self.upper)

    def scaled(self, physical: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return scaled parameters (..., p) from those in SI units, brought within their bounds."""
        values = np.clip(physical, self.lower, self.upper)
        width = np.where(self.free, self.upper - self.lower, 1.0)
        low = np.where(self.logarithmic, self.lower, 1.0)
        width_log = np.log(np.where(self.logarithmic & self.free, self.upper / low, np.e))
        log = np.log(np.where(self.logarithmic, values, 1.0) / low) / width_log
        return np.where(self.logarithmic, log, (values - self.lower) / width)

    def from_search(self, sought: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return scaled parameters from those of a random search, which looks closer near zero: z = y^2 for amounts."""
        return np.where(self.amounts, sought**2, sought)

    def slopes(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return dp/dz (..., p): what turns an error of a scaled parameter into one in SI units."""
        low = np.where(self.logarithmic, self.lower, 1.0)
        rate = np.log(np.where(self.logarithmic, self.upper / low, 1.0))
        return np.where(self.logarithmic, self.physical(scaled) * rate, self.upper - self.lower)


def scale_between(
    robot: Robot, *, free: Sequence[str] = FRICTION, bounds: Bounds | None = None
) -> Coordinates:
    """Return the coordinates of a robot's parameters.

    Parameters
    ----------
    robot : Robot
    free : sequence of str
        Names of the quantities sought, or of groups of them. What is given bounds is sought as well; the rest is held.
    bounds : Bounds, optional

    Raises
    ------
    InputError
        Where a name is none, or a quantity has no default bounds for this robot.
    """
    bounds = bounds or Bounds()
    sought = names_in(free)
    asked = {*sought, *bounds.given}
    extra = tuple(name for name in BY_NAME if name not in FRICTION and name in asked)
    layout = Layout(wheel_count=robot.wheel_count, extra=extra)
    quantities = [BY_NAME[name] for name in layout.names]
    intervals = np.concatenate([_interval(one, robot, sought, bounds) for one in quantities])
    of_each = [one for one in quantities for _ in one.labels(robot.wheel_count)]
    return Coordinates(
        layout=layout,
        before=layout.values_before(robot),
        lower=intervals[:, 0],
        upper=intervals[:, 1],
        logarithmic=np.array([one.scale == "ratio" for one in of_each]),
        amounts=np.array([one.scale == "amount" for one in of_each]),
    )


def _interval(quantity: Quantity, robot: Robot, sought: Sequence[str], bounds: Bounds) -> NDArray[np.float64]:
    """Return the least and greatest value of each of a quantity's numbers (k, 2); equal where it is held."""
    given = bounds.interval(quantity.name)
    if given is not None:
        return np.tile(given, (len(quantity.labels(robot.wheel_count)), 1))
    if quantity.name not in sought:
        return np.repeat(quantity.values_before(robot)[:, None], 2, axis=1)
    default = quantity.default_bounds(robot)
    if not np.all(default[:, 1] > default[:, 0]):
        raise InputError(
            f"{quantity.name} is zero in the robot's description, "
            "so the search has no scale for it; give it bounds."
        )
    return default
