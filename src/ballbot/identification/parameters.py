"""The parameters of a fit: their bounds, which a user may set in Python or in a TOML file, and their scaling.

    coulomb = [0.0, 0.5]             # c [N m], every wheel's
    delay = [0.012, 0.012]           # held at that value [s]

Keys left out keep the defaults of `ballbot.identification.quantities`. Bounds hold for every number of a quantity, in
its unit. Equal bounds hold it at that value, so that a value known from elsewhere, as a delay, takes part.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, suggest
from ballbot.files import read_toml
from ballbot.fitting.parameter import Parameter, ParameterSpace
from ballbot.identification.quantities import BY_NAME, FRICTION, Layout, Limits, Quantity, names_in
from ballbot.robot import Robot


@dataclass(frozen=True)
class Bounds:
    """The least and the greatest value of quantities, by name; the others keep the default.

    InputError if a name is not a quantity, or a pair is not two finite numbers in rising order or reaches below what is
    physical.
    """

    limits: Mapping[str, Limits] = field(default_factory=dict[str, Limits])

    def __post_init__(self) -> None:
        for name, (lower, upper) in self.limits.items():
            if name not in BY_NAME:
                hint = suggest(name, BY_NAME, otherwise="the keys are")
                raise InputError(f"{name!r} is not a quantity that can be identified; {hint}")
            if not (math.isfinite(lower) and math.isfinite(upper) and lower <= upper):
                raise InputError(
                    f"The bounds of {name} are [{lower}, {upper}]; the lower one must come first."
                )
            scale = BY_NAME[name].scale
            if (lower < 0.0 and scale != "signed") or (lower <= 0.0 and scale == "ratio"):
                least = "above zero" if scale == "ratio" else "zero or more"
                raise InputError(f"The lower bound of {name} is {lower:g}; it must be {least}.")
        if self.limits.get("delay", (0.0, 0.0))[0] < 0.0:
            raise InputError(
                f"The lower bound of delay is {self.limits['delay'][0]:g}; it must be "
                "zero or more, because an effect cannot precede its cause."
            )

    def without(self, *names: str) -> Bounds:
        """Return the bounds of the other quantities."""
        return Bounds({name: limits for name, limits in self.limits.items() if name not in names})


def read_bounds(path: str | Path) -> Bounds:
    """Read bounds from a TOML file; the module's text shows one.

    InputError if the file cannot be read, is no TOML, or has a key or a value that makes no bounds.
    """
    entries = read_toml(path)
    try:
        return Bounds({key: _limits_in_file(key, value) for key, value in entries.items()})
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


#: bounds, or the path of the TOML file that they are read from
BoundsLike = Bounds | str | Path


def as_bounds(source: BoundsLike | None) -> Bounds:
    """Return the bounds themselves, or those in that file; the default ones of every parameter if there are none."""
    if source is None:
        return Bounds()
    return source if isinstance(source, Bounds) else read_bounds(source)


def _limits_in_file(key: str, value: object) -> Limits:
    match value:
        case [int() | float() as lower, int() | float() as upper]:
            return float(lower), float(upper)
    raise InputError(f"{key} is {value!r}; write two numbers, as in {key} = [0.1, 0.5].")


@dataclass(frozen=True, kw_only=True, eq=False)
class Coordinates(ParameterSpace):
    """The parameters of a robot in the order of its layout, friction's 3 n + 3 first."""

    layout: Layout
    alike: tuple[str, ...] = ()  #: quantities of wheels that have one number for all of them

    @cached_property
    def first(self) -> NDArray[np.int64]:
        """The place of the number that each one (p,) equals: its own, or the first wheel's."""
        places = np.arange(len(self.parameters))
        for name in self.alike:
            columns = self.layout.columns(name)
            assert columns is not None, name
            places[columns] = columns.start
        return places

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Which parameters (p,) a fit moves; of numbers that are equal, the first."""
        return (self.upper > self.lower) & (self.first == np.arange(len(self.parameters)))

    def physical(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return parameters (..., p) in SI units from scaled ones (..., p)."""
        return super().physical(scaled[..., self.first])

    def scaled_one(self, place: int, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values (k,) of the parameter at a place, scaled and brought within its bounds."""
        rows = np.tile(self.nominal, (len(values), 1))
        rows[:, place] = values
        return self.scaled(rows)[:, place]


def scale_between(
    robot: Robot, *, free: Sequence[str] = FRICTION, bounds: Bounds | None = None
) -> Coordinates:
    """Return the coordinates of a robot's parameters.

    `free` names the quantities to estimate, or groups of them. Quantities with bounds are estimated as well; the others
    are fixed. InputError if a name is not a quantity or a group, or a quantity has no default bounds for this robot.
    """
    bounds = bounds or Bounds()
    estimated = names_in(free)
    asked = {*estimated, *bounds.limits}
    extra = tuple(name for name in BY_NAME if name not in FRICTION and name in asked)
    layout = Layout(wheel_count=robot.wheel_count, extra=extra)
    parameters = []
    for name in layout.names:
        quantity = BY_NAME[name]
        limits = _limits(quantity, robot, estimated, bounds)
        values = zip(quantity.labels(robot.wheel_count), limits, quantity.nominal(robot), strict=True)
        parameters += [
            Parameter(
                name=name,
                symbol=label,
                unit=quantity.unit,
                scale=quantity.scale,
                bounds=(float(low), float(high)),
                default=float(value),
            )
            for label, (low, high), value in values
        ]
    return Coordinates(layout=layout, parameters=tuple(parameters))


def _limits(
    quantity: Quantity, robot: Robot, estimated: Sequence[str], bounds: Bounds
) -> NDArray[np.float64]:
    """Return the least and greatest value of each of a quantity's numbers (k, 2); equal where it is held."""
    given = bounds.limits.get(quantity.name)
    if given is not None:
        return np.tile(given, (len(quantity.labels(robot.wheel_count)), 1))
    if quantity.name not in estimated:
        return np.repeat(quantity.nominal(robot)[:, None], 2, axis=1)
    default = quantity.default_bounds(robot)
    if not np.all(default[:, 1] > default[:, 0]):
        raise InputError(
            f"{quantity.name} is zero in the robot's description, "
            "so the search has no scale for it; give it bounds."
        )
    return default
