"""One entry of a robot file, such as `{ value = 0.11, unit = "m", source = "measured" }`, read and checked.

A bare number is refused: the file exists to say what its numbers are.
"""

from __future__ import annotations

from collections.abc import Mapping
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


def parse_entry(parameter: Parameter, raw: object) -> tuple[Value, str]:
    """Return a parameter's value in SI units and its source.

    Raises
    ------
    InputError
        Where a key is missing, unknown or of the wrong type, or the unit or the source is not understood.
    """
    if not isinstance(raw, dict):
        raise InputError(f"{parameter.name} is {raw!r}, without unit and source; write {example(parameter)}.")
    try:
        entry = Entry.model_validate(raw)
    except ValidationError as error:
        raise InputError(_sentence(parameter, raw, error)) from None
    if parameter.unit != DIMENSIONLESS and "unit" not in entry.model_fields_set:
        raise InputError(f'{parameter.name} has no unit; write unit = "{parameter.written_in}".')
    check_source(parameter.name, entry.source)
    return _in_si(parameter, entry), entry.source


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
        hint = f"did you mean {near[0]!r}?" if near else "it takes value, unit and source."
        return f"{parameter.name} has the unknown key {key!r}; {hint}"
    takes = _takes(parameter) if key == "value" else "a text in quotes"
    return f"{parameter.name} has the {key} {raw[key]!r}; it takes {takes}."


def _takes(parameter: Parameter) -> str:
    return "a list with a number for each wheel" if parameter.shape == "list" else f"one {parameter.shape}"


def _in_si(parameter: Parameter, entry: Entry) -> Value:
    value = entry.value
    fits = isinstance(value, list) == (parameter.shape == "list")
    if not fits or (parameter.shape == "whole number" and not isinstance(value, int)):
        raise InputError(f"{parameter.name} has the value {value!r}; it takes {_takes(parameter)}.")
    try:
        if isinstance(value, list):
            return tuple(to_si(float(one), entry.unit, parameter.unit) for one in value)
        converted = to_si(float(value), entry.unit, parameter.unit)
    except OverflowError:
        raise InputError(f"{parameter.name} has a value too large for a number.") from None
    except InputError as error:
        raise InputError(f"{parameter.name}: {error}.") from None
    return int(value) if parameter.shape == "whole number" else converted
