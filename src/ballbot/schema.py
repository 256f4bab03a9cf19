"""Tables of TOML files: validated by pydantic, with its errors as our sentences, and written with comments.

    input.kind is 'curent'; did you mean 'current'? It must be 'torque', 'current', 'duty', 'pwm' or 'voltage'.

A sentence names the key, its value, the allowed values, and the nearest name. Mappings, controllers, courses and
scenarios are validated here.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from ballbot.errors import InputError, either, nearest, suggest
from ballbot.printable import toml_string

T = TypeVar("T")

_LONGEST = 60  #: characters shown of a wrong value

#: what a value must be, by the type of pydantic's error; other errors say it themselves
_WANTED = {
    "string_type": "a text in quotes",
    **dict.fromkeys(("bool_type", "bool_parsing"), "true or false"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "a whole number"),
    **dict.fromkeys(("float_type", "float_parsing"), "a number"),
    "finite_number": "a finite number",
    **dict.fromkeys(("tuple_type", "list_type"), "a list"),
    **dict.fromkeys(
        ("dict_type", "model_type", "model_attributes_type", "dataclass_type", "dataclass_exact_type"),
        "a table",
    ),
    "greater_than": "above {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "below {lt:g}",
    "less_than_equal": "at most {le:g}",
}


@dataclass(frozen=True, kw_only=True)
class _Violation:
    """One of pydantic's errors, placed in the file."""

    error: ErrorDetails
    place: tuple[str | int, ...]  #: keys and indices of the file

    @property
    def context(self) -> Mapping[str, object]:
        """What pydantic adds to an error of this type: bounds, lengths, what is allowed."""
        return self.error.get("ctx", {})


def validate_table(
    schema: type[T],  # A pydantic model or a dataclass
    tree: object,  # what the TOML file holds
    *,
    of: str,  # what the file is, as "a controller file"
) -> T:
    """Return a file's tables as a model or a dataclass.

    Lists become tuples and whole numbers floats; no text becomes a number, and no true or false.

    InputError with one sentence on the first mistake, a misspelt key before others.
    """
    try:
        # strict JSON knows tuples and floats by what they stand for, as strict Python does not
        return _adapter(schema).validate_json(json.dumps(tree, default=str), strict=True)
    except ValidationError as error:
        raise InputError(_first_sentence(error, tree, _Keys(_adapter(schema).json_schema()), of)) from None


@cache
def _adapter(schema: type[T]) -> TypeAdapter[T]:
    return TypeAdapter(schema)


def toml_value(value: object) -> str:
    """Return a value as TOML writes it: floats to the last bit, sequences as lists, mappings as inline tables."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return toml_string(value)
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{key} = {toml_value(one)}' for key, one in value.items())} }}"
    if isinstance(value, Sequence):
        return f"[{', '.join(map(toml_value, value))}]"
    return repr(value)


def toml_line(key: str, value: object, comment: str = "") -> str:
    """Return a line of a TOML file: a key, its value, and a comment if there is one."""
    return f"{key} = {toml_value(value)}{f'  # {comment}' if comment else ''}"


def _first_sentence(error: ValidationError, tree: object, keys: _Keys, of: str) -> str:
    mistakes = [_Violation(error=one, place=_place(one, tree)) for one in error.errors(include_url=False)]
    for mistake in mistakes:
        if mistake.error["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
            return _unknown_key(mistake, keys, of)
    # of a union, the member that went furthest into the file is the one that was meant
    first = mistakes[0].place
    related = [one for one in mistakes if one.place[: len(first)] == first]
    deepest = max((one.place for one in related), key=len)
    return _sentence([one for one in related if one.place == deepest], keys, of)


def _place(error: ErrorDetails, tree: Any) -> tuple[str | int, ...]:
    """Return the keys and indices of an error's location that the file has, without pydantic's labels of a union."""
    place: list[str | int] = []
    for part in error["loc"]:
        try:
            tree = tree[part]
        except (KeyError, IndexError, TypeError):  # a label, or the key that is missing
            if error["type"] != "missing" or part is not error["loc"][-1]:
                continue
        place.append(part)
    return tuple(place)


class _Keys:
    """The keys that a file may have, by the JSON schema of its type."""

    def __init__(self, schema: Mapping[str, Any]) -> None:
        self._schema = schema

    def known(self, place: Sequence[str | int]) -> list[str]:
        """Return the keys of the table at a place."""
        return list(dict.fromkeys(key for one in self._at(place) for key in one.get("properties", ())))

    def tags(self, place: Sequence[str | int]) -> list[str]:
        """Return the values of the key by which the tables of a union at a place differ."""
        tags: list[str] = []
        for one in self._at(place):
            mapping = one.get("discriminator", {}).get("mapping", {})
            order = [member.get("$ref") for member in one.get("oneOf", ())]
            tags += sorted(mapping, key=lambda tag: order.index(mapping[tag]))
        return [repr(tag) for tag in tags]

    def _at(self, place: Sequence[str | int]) -> list[Mapping[str, Any]]:
        """Return what may stand at a place: unions, and each of their members."""
        level = self._members(self._schema)
        for part in place:
            below = []
            for one in level:
                items = one.get("prefixItems", [])[part:] if isinstance(part, int) else []
                more = one.get("items") if isinstance(part, int) else one.get("additionalProperties")
                inner = one.get("properties", {}).get(part) or (items[0] if items else more)
                below += self._members(inner) if isinstance(inner, Mapping) else []
            level = below
        return level

    def _members(self, schema: Mapping[str, Any]) -> list[Mapping[str, Any]]:
        if "$ref" in schema:
            return self._members(self._schema["$defs"][schema["$ref"].rpartition("/")[2]])
        inner = [one for kind in ("anyOf", "oneOf", "allOf") for one in schema.get(kind, ())]
        return [schema, *(member for one in inner for member in self._members(one))]


def _sentence(mistakes: Sequence[_Violation], keys: _Keys, of: str) -> str:
    """Return the sentence on mistakes at one place: several if each member of a union was tried."""
    mistake = mistakes[0]
    given, place, context = mistake.error["input"], format_place(mistake.place), mistake.context
    count = context.get("actual_length")
    entries = "one entry" if count == 1 else f"{count} entries"
    match mistake.error["type"]:
        case "value_error" if isinstance(context["error"], InputError):
            return str(context["error"])
        case "missing":
            above = f"[{format_place(mistake.place[:-1])}]" if mistake.place[:-1] else of
            return f"{place} is missing; {above} needs it."
        case "union_tag_not_found" | "union_tag_invalid" as kind:
            key = str(context["discriminator"]).strip("'")
            if kind == "union_tag_not_found":
                return f"{place}.{key} is missing; it must be {either(keys.tags(mistake.place))}."
            tag = given.get(key) if isinstance(given, Mapping) else given
            return _choice(f"{place}.{key}", tag, keys.tags(mistake.place))
        case "too_short":
            return f"{place} has {entries}; it must have at least {context['min_length']}."
        case "too_long":
            return f"{place} has {entries}; it must have at most {context['max_length']}."
        case "literal_error" if len(mistakes) == 1:
            return _choice(place, given, _allowed(mistake))
    wanted = list(dict.fromkeys(one for each in mistakes for one in _wanted(each)))
    wanted = [one for one in wanted if one != "a whole number" or "a number" not in wanted]
    below = f": write its keys below a line [{place}]" if wanted == ["a table"] else ""
    return f"{place} is {format_value(given)}; it must be {either(wanted)}{below}."


def _unknown_key(mistake: _Violation, keys: _Keys, of: str) -> str:
    *above, last = mistake.place
    hint = suggest(str(last), keys.known(above), otherwise="the keys there are")
    return f"{format_place(mistake.place)} is not a key of {of}; {hint}"


def _choice(place: str, given: object, allowed: Sequence[str]) -> str:
    """Return that a value is none of those allowed, and the nearest of them."""
    near = nearest(repr(given), allowed) if isinstance(given, str) else []
    hint = f"did you mean {near[0]}? It" if near else "it"
    return f"{place} is {format_value(given)}; {hint} must be {either(allowed)}."


def _wanted(mistake: _Violation) -> list[str]:
    """Return what the value must be, in one or several alternatives."""
    kind, message = mistake.error["type"], mistake.error["msg"]
    if kind == "literal_error":
        return _allowed(mistake)
    if kind in _WANTED:
        return [_WANTED[kind].format(**mistake.context)]
    message = message.removeprefix("Input should be ").removeprefix("Value error, ")
    return [f"{message[0].lower()}{message[1:]}"]


def _allowed(mistake: _Violation) -> list[str]:
    """Return the allowed values of a Literal as the file writes them."""
    return re.split(r", | or ", str(mistake.context["expected"]))


def format_place(place: Sequence[str | int]) -> str:
    """Return keys and indices as a file's reader counts: gain[1][3] is the third number of the first row."""
    return "".join(f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in place).lstrip(".")


def format_value(value: object) -> str:
    """Return a wrong value as a file could write it, cut short."""
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
