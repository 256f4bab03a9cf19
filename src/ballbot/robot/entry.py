"""One entry of a robot file, such as `{ value = 0.11, unit = "m", source = "measured" }`, read and checked.

A bare number is refused: the file exists to say what its numbers are. How well a value is known may stand beside it,
in the same unit: `standard_deviation = 0.001`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches

from pydantic import BaseModel, ConfigDict, ValidationError

from ballbot.errors import InputError
from ballbot.robot.checks import check_source
from ballbot.robot.parameters import Parameter, Value
from ballbot.robot.units import DIMENSIONLESS, to_si


class Entry(BaseModel):
    """What a file says of one parameter."""

    model_config = ConfigDict(extra="forbid", strict=True)

    value: int | float | list[float]
    unit: str = DIMENSIONLESS
    source: str
    standard_deviation: int | float | list[float] | None = None


@dataclass(frozen=True, kw_only=True)
class ParsedEntry:
    """One parameter as `Robot` holds it, in SI units."""

    value: Value
    source: str
    standard_deviation: Value | None  #: of the value's shape; None where the file gives none


def parse_entry(parameter: Parameter, raw: object) -> ParsedEntry:
    """Return a parameter's value, source and standard deviation.

    Raises
    ------
    InputError
        Where a key is missing, unknown or of the wrong type, or the unit or the source is not understood.
    """
    if not isinstance(raw, dict):
        raise InputError(
            f"{parameter.name} is {raw!r}, without a unit and a source; write {example(parameter)}."
        )
    try:
        entry = Entry.model_validate(raw)
    except ValidationError as error:
        raise InputError(_sentence(parameter, raw, error)) from None
    if parameter.unit != DIMENSIONLESS and "unit" not in entry.model_fields_set:
        raise InputError(f'{parameter.name} has no unit; write unit = "{parameter.written_in}".')
    check_source(parameter.name, entry.source)
    deviation = entry.standard_deviation
    return ParsedEntry(
        value=_in_si(parameter, entry.value, entry.unit),
        source=entry.source,
        standard_deviation=None if deviation is None else _deviation_in_si(parameter, entry, deviation),
    )


def example(parameter: Parameter) -> str:
    """Return a line that a file could give the parameter in."""
    number = {"number": "0.0", "whole number": "2", "list": "[0.0, 0.0, 0.0]"}[parameter.shape]
    unit = "" if parameter.written_in == DIMENSIONLESS else f'unit = "{parameter.written_in}", '
    return f'{parameter.key} = {{ value = {number}, {unit}source = "assumed" }}'


def _sentence(parameter: Parameter, raw: Mapping[str, object], error: ValidationError) -> str:
    """Return the first of pydantic's findings as a sentence of ours."""
    first = error.errors()[0]
    key = str(first["loc"][0])
    if first["type"] == "missing":
        return f"{parameter.name} has no {key}; write {example(parameter)}."
    if first["type"] == "extra_forbidden":
        near = get_close_matches(key, Entry.model_fields, n=1)
        hint = (
            f"did you mean {near[0]!r}?" if near else "it has value, unit and source, and standard_deviation."
        )
        return f"{parameter.name} has the unknown key {key!r}; {hint}"
    takes = _takes(parameter) if key in ("value", "standard_deviation") else "a text in quotes"
    return f"{parameter.name} has the {key} {raw[key]!r}; it must be {takes}."


def _takes(parameter: Parameter) -> str:
    return "a list with a number for each wheel" if parameter.shape == "list" else f"one {parameter.shape}"


def _deviation_in_si(parameter: Parameter, entry: Entry, deviation: float | list[float]) -> Value:
    """Return a standard deviation in SI units; one number stands for every wheel's."""
    if parameter.shape == "whole number":
        raise InputError(f"{parameter.name} is a whole number and cannot have a standard deviation.")
    if isinstance(entry.value, list) and not isinstance(deviation, list):
        deviation = [float(deviation)] * len(entry.value)
    return _in_si(parameter, deviation, entry.unit)


def _in_si(parameter: Parameter, value: float | list[float], unit: str) -> Value:
    fits = isinstance(value, list) == (parameter.shape == "list")
    if not fits or (parameter.shape == "whole number" and not isinstance(value, int)):
        raise InputError(f"{parameter.name} has the value {value!r}; it must be {_takes(parameter)}.")
    try:
        if isinstance(value, list):
            return tuple(to_si(float(one), unit, parameter.unit) for one in value)
        converted = to_si(float(value), unit, parameter.unit)
    except OverflowError:
        raise InputError(f"{parameter.name} has a value too large for a number.") from None
    except InputError as error:
        raise InputError(f"{parameter.name}: {error}.") from None
    return int(value) if parameter.shape == "whole number" else converted
