"""Slips of units: which one parameter, had it been meant in another unit, explains what is wrong with a robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from ballbot.errors import InputError
from ballbot.findings import Finding
from ballbot.robot.parameters import BY_NAME, INERTIA_NAMES, PARAMETERS, Parameter, Value, value_of
from ballbot.robot.robot import Robot, Values, assemble
from ballbot.robot.units import DIMENSIONLESS, UNITS, to_si

Find = Callable[[Robot], Iterable[Finding]]

#: slip together: who has one of them in another unit has all of them in it
_INERTIA = tuple(f"body.inertia.{axes}" for axes in INERTIA_NAMES)


@dataclass(frozen=True, kw_only=True)
class Slip:
    """One parameter meant in another unit, and what then is left to find."""

    names: tuple[str, ...]  #: the parameters that it changes
    words: str
    decimal: bool  #: the decimal point slipped, not the unit
    left: tuple[Finding, ...]

    def mends(self, finding: Finding) -> bool:
        """Return whether the finding is gone."""
        return all((one.code, one.where) != (finding.code, finding.where) for one in self.left)

    @property
    def rank(self) -> tuple[int, bool, int]:
        """How many errors it leaves, whether the unit stays, how many findings it leaves; less is likelier."""
        return sum(one.severity == "error" for one in self.left), self.decimal, len(self.left)


def likeliest_slip(robot: Robot, errors: Sequence[Finding], find: Find) -> Slip | None:
    """Return the slip of units that leaves the fewest errors, if any leaves fewer than there are.

    Parameters
    ----------
    robot : Robot
    errors : sequence of Finding
        Of that robot; the columns of their places name the parameters to look at.
    find : callable
        Returns what is to find in a robot.
    """
    names = dict.fromkeys(name for finding in errors for name in finding.where.columns)
    found = len(list(find(robot)))
    # a slip that makes something else unusual explains nothing
    slips = [
        slip
        for name in names
        for slip in _slips(robot, name, find)
        if len(slip.left) - slip.rank[0] <= found - len(errors)
    ]
    best = min(slips, key=lambda slip: slip.rank, default=None)
    if best is None or best.rank[0] >= len(errors):
        return None
    # a decimal point may have slipped in any of several parameters: then none is likelier than another
    rivals = {slip.names for slip in slips if slip.decimal and slip.rank[0] == best.rank[0]}
    return None if best.decimal and len(rivals) > 1 else best


def _slips(robot: Robot, name: str, find: Find) -> Iterator[Slip]:
    """Yield what is left to find if a parameter was meant in another unit, or its decimal point slipped."""
    values: dict[str, Value] = {one.name: value_of(robot, one) for one in PARAMETERS}
    parameter, value = BY_NAME[name], values[name]
    if parameter.shape == "whole number":
        return
    together = _INERTIA if name in _INERTIA else (name,)
    for scale, decimal in _scales(parameter.unit):
        for meant in _scaled(value, scale):
            changed = {other: _times(values[other], scale) for other in together} | {name: meant}
            try:
                slipped = assemble(
                    name=robot.name,
                    inertia_about=robot.body.inertia_about,
                    values=Values(by_name=values | changed),
                    sources={},
                )
            except InputError:
                continue
            words = f"{name} {_in_radians(parameter, meant)}{with_unit(parameter, meant)}"
            yield Slip(names=together, words=words, decimal=decimal, left=tuple(find(slipped)))


def _scales(si_unit: str) -> Iterator[tuple[float, bool]]:
    """Yield what to multiply by if a number was meant in another unit, or given in one and meant in SI.

    Last come slips of the decimal point, which are marked.
    """
    for unit in UNITS[si_unit]:
        if unit != si_unit:
            factor = to_si(1.0, unit, si_unit)
            yield from ((factor, False), (1.0 / factor, False))
    yield from ((0.1, True), (10.0, True))


def _scaled(value: Value, scale: float) -> Iterator[Value]:
    """Yield the value scaled; of a list, one number or all."""
    if isinstance(value, tuple):
        for place in range(len(value)):
            yield tuple(scale * one if i == place else one for i, one in enumerate(value))
    yield _times(value, scale)


def _times(value: Value, scale: float) -> Value:
    return tuple(scale * one for one in value) if isinstance(value, tuple) else scale * value


def with_unit(parameter: Parameter, value: Value) -> str:
    """Return a value with its unit, angles in degrees."""
    numbers = value if isinstance(value, tuple) else (value,)
    unit = "" if parameter.unit == DIMENSIONLESS else f" {parameter.unit}"
    if parameter.unit == "rad":
        numbers, unit = tuple(math.degrees(one) for one in numbers), " deg"
    text = ", ".join(f"{one:.4g}" for one in numbers)
    return f"{f'[{text}]' if isinstance(value, tuple) else text}{unit}"


def _in_radians(parameter: Parameter, value: Value) -> str:
    """Return "0.785 rad, that is " for an angle."""
    if parameter.unit != "rad":
        return ""
    text = ", ".join(f"{one:.4g}" for one in (value if isinstance(value, tuple) else (value,)))
    return f"{f'[{text}]' if isinstance(value, tuple) else text} rad, that is "


def listed(names: Sequence[str]) -> str:
    """Return "a, b and c"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
