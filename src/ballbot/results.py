"""The one way from values to results.json and back: dataclasses by their fields, arrays as lists.

JSON has no word for NaN and infinity: a missing number (NaN) is null, an infinite one the string "Infinity" or
"-Infinity", as in the JSON of Protocol Buffers. Most languages turn these strings into numbers.

A dataclass is written with its fields' names. A field can have another key or be left out, and a property can be
written too:

    @dataclass(frozen=True, kw_only=True)
    class Use:
        value: float
        limit: float
        samples: NDArray[np.float64] = field(metadata=left_out)
        at_limit: float = field(metadata=key("share_at_limit"))

        @reported
        def share(self) -> float: ...
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from ballbot.printable import json_escaped

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

_KEY = "results.json"

_INFINITE = {"Infinity": math.inf, "-Infinity": -math.inf}

#: metadata of a field that is not written
left_out: Mapping[str, str] = MappingProxyType({_KEY: ""})


def key(name: str) -> Mapping[str, str]:
    """Return the metadata of a field that is written under another name."""
    return {_KEY: name}


class reported(property):  # noqa: N801 (a decorator, named as `property` is)
    """A property that is written beside the fields."""


def to_results(value: DataclassInstance | Mapping[str, object]) -> dict[str, object]:
    """Return a dataclass or a mapping as results.json holds it.

    Parameters
    ----------
    value : dataclass or mapping
        Its values may be dataclasses, mappings, sequences, arrays, paths, enums, rotations (quaternions wxyz) and
        complex numbers ([real, imaginary]).
    """
    if isinstance(value, Mapping):
        return {str(name): plain(entry) for name, entry in value.items()}
    written = {
        name: plain(getattr(value, field.name))
        for field in fields(value)
        if (name := field.metadata.get(_KEY, field.name))
    }
    properties = {
        name: member
        for base in reversed(type(value).__mro__)
        for name, member in vars(base).items()
        if isinstance(member, reported)
    }
    return written | {name: plain(getattr(value, name)) for name in properties}


def plain(value: object) -> object:
    """Return a value as JSON can hold it: plain containers, NaN as None, infinities as their names."""
    match value:
        case np.ndarray():
            return plain(value.tolist())
        case np.generic():
            return plain(value.item())
        case Mapping():
            return to_results(value)
        case Path():
            return str(value)
        case Enum():
            return plain(value.value)
        case complex():
            return [plain(value.real), plain(value.imag)]
        case float() if math.isnan(value):
            return None
        case float() if math.isinf(value):
            return "Infinity" if value > 0.0 else "-Infinity"
    if hasattr(value, "as_quat"):  # a rotation of SciPy's: its unit quaternion in the order wxyz
        return plain(value.as_quat(canonical=True)[..., [3, 0, 1, 2]])  # pyright: ignore[reportAttributeAccessIssue]
    if hasattr(value, "to_dict"):  # whose entries are not its fields
        return plain(value.to_dict())  # pyright: ignore[reportAttributeAccessIssue]
    if is_dataclass(value) and not isinstance(value, type):
        return to_results(value)
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(entry) for entry in value]
    return value


def as_json(results: Mapping[str, object]) -> str:
    """Return results as JSON text."""
    return json_escaped(json.dumps(plain(results), indent=2, ensure_ascii=False, allow_nan=False)) + "\n"


def with_infinities(value: object) -> object:
    """Return a value that JSON held with its infinite numbers as numbers."""
    match value:
        case dict():
            return {name: with_infinities(entry) for name, entry in value.items()}
        case list():
            return [with_infinities(entry) for entry in value]
        case str():
            return _INFINITE.get(value, value)
    return value
