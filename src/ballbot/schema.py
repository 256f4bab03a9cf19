"""Tables of TOML files: validated by pydantic, with its errors as our sentences, and written with comments.

    input.kind is 'curent'; did you mean 'current'? It must be 'torque', 'current', 'voltage', 'duty' or 'pwm'.

A sentence names the key, its value, the allowed values, and the nearest name. Mappings, controllers, courses and
scenarios are validated here.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from ballbot.errors import InputError, nearest, suggest
from ballbot.printable import toml_string

T = TypeVar("T")

_LONGEST = 60  #: characters shown of a wrong value

#: what a value must be, by the type of pydantic's error
_WANTED = {
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "tuple_type": "a list",
    "list_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "dataclass_type": "a table",
    "dataclass_exact_type": "a table",
}
#: the same of a number that is out of range, by the type of the error and its key in the context
_RANGES = {
    "greater_than": ("gt", "above"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "below"),
    "less_than_equal": ("le", "at most"),
}
#: pydantic's label of a member of a union, which stands in an error's location but not in the file
_LABEL = re.compile(r".*[\[(].*|str|int|float|bool|constrained-\w+|none")


@dataclass(frozen=True, kw_only=True)
class _Mistake:
    """One of pydantic's errors, placed in the file."""

    error: ErrorDetails
    place: tuple[str | int, ...]  #: keys and indices of the file
    hints: tuple[object, ...]  #: what the table or list above the last key may be

    @property
    def context(self) -> Mapping[str, object]:
        """What pydantic adds to an error of this type: bounds, lengths, what is allowed."""
        return self.error.get("ctx", {})


def validate_table(schema: type[T], tree: object, *, of: str) -> T:
    """Return a file's tables as a model or a dataclass.

    Lists become tuples and whole numbers floats; no text becomes a number, and no true or false.

    Parameters
    ----------
    schema : type
        A pydantic model or a dataclass.
    tree : object
        What the TOML file holds.
    of : str
        What the file is, as "a controller file".

    Raises
    ------
    InputError
        With one sentence on the first mistake, a misspelt key before others.
    """
    try:
        # strict JSON knows tuples and floats by what they stand for, as strict Python does not
        return _adapter(schema).validate_json(json.dumps(tree, default=str), strict=True)
    except ValidationError as error:
        raise InputError(_first_sentence(error, schema, of)) from None


@cache
def _adapter(schema: type[T]) -> TypeAdapter[T]:
    return TypeAdapter(schema)


def renamed_keys(
    tree: Mapping[str, object], renamed: Mapping[str, Mapping[str, str]]
) -> tuple[dict[str, object], list[str]]:
    """Return the tables of an earlier version's file with the present keys, and a hint on each that was renamed.

    Parameters
    ----------
    tree : mapping
        What the TOML file holds.
    renamed : mapping
        By the name of a table, the present key of each old one.
    """
    tables, hints = dict(tree), []
    for name, keys in renamed.items():
        content = tables.get(name)
        if isinstance(content, Mapping):
            tables[name] = {keys.get(key, key): value for key, value in content.items()}
            hints += [f"{name}.{old} is now called {now}" for old, now in keys.items() if old in content]
    return tables, hints


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


def _first_sentence(error: ValidationError, schema: object, of: str) -> str:
    mistakes = [_placed(one, schema) for one in error.errors(include_url=False)]
    for mistake in mistakes:
        if mistake.error["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
            return _unknown_key(mistake, of)
    # of a union, the member that went furthest into the file is the one that was meant
    first = mistakes[0].place
    related = [one for one in mistakes if one.place[: len(first)] == first]
    deepest = max((one.place for one in related), key=len)
    return _sentence([one for one in related if one.place == deepest], of)


def _sentence(mistakes: Sequence[_Mistake], of: str) -> str:
    """Return the sentence on mistakes at one place: several if each member of a union was tried."""
    mistake = mistakes[0]
    given, place = mistake.error["input"], format_place(mistake.place)
    match mistake.error["type"]:
        case "missing":
            return _missing(mistake, of)
        case "union_tag_not_found":
            return f"{_tag_place(mistake)} is missing; it must be {_either(_tags(mistake))}."
        case "union_tag_invalid":
            key = str(mistake.context["discriminator"]).strip("'")
            tag = given.get(key) if isinstance(given, Mapping) else given
            return _choice(_tag_place(mistake), tag, _tags(mistake))
        case "too_short":
            return f"{place} has {_entries(mistake)}; it must have at least {mistake.context['min_length']}."
        case "too_long":
            return f"{place} has {_entries(mistake)}; it must have at most {mistake.context['max_length']}."
        case "literal_error" if len(mistakes) == 1:
            return _choice(place, given, _allowed(mistake))
    wanted = list(dict.fromkeys(one for each in mistakes for one in _wanted(each)))
    below = f": write its keys below a line [{place}]" if wanted == ["a table"] else ""
    return f"{place} is {format_value(given)}; it must be {_either(wanted)}{below}."


def _missing(mistake: _Mistake, of: str) -> str:
    *above, last = mistake.place
    if isinstance(last, int):
        return (
            f"{format_place(above)} has {('one entry' if last == 1 else f'{last} entries')}; it needs more."
        )
    table = f"[{format_place(above)}]" if above else of
    return f"{format_place(mistake.place)} is missing; {table} needs it."


def _unknown_key(mistake: _Mistake, of: str) -> str:
    known = list(dict.fromkeys(key for hint in mistake.hints for key in _keys(hint)))
    hint = suggest(str(mistake.place[-1]) if mistake.place else "", known, otherwise="the keys there are")
    return f"{format_place(mistake.place)} is not a key of {of}; {hint}"


def _choice(place: str, given: object, allowed: Sequence[str]) -> str:
    """Return that a value is none of those allowed, and the nearest of them."""
    near = nearest(repr(given), allowed) if isinstance(given, str) else []
    hint = f"did you mean {near[0]}? It" if near else "it"
    return f"{place} is {format_value(given)}; {hint} must be {_either(allowed)}."


def _wanted(mistake: _Mistake) -> list[str]:
    """Return what the value must be, in one or several alternatives."""
    kind, message = mistake.error["type"], mistake.error["msg"]
    if kind == "literal_error":
        return _allowed(mistake)
    if kind in _RANGES:
        key, words = _RANGES[kind]
        return [f"{words} {mistake.context[key]:g}"]
    message = message.removeprefix("Input should be ").removeprefix("Value error, ")
    return [_WANTED.get(kind, f"{message[0].lower()}{message[1:]}")]


def _allowed(mistake: _Mistake) -> list[str]:
    """Return the allowed values of a Literal as the file writes them."""
    return re.split(r", | or ", str(mistake.context["expected"]))


def _tag_place(mistake: _Mistake) -> str:
    """Return the place of the key by which the tables of a union differ."""
    return f"{format_place(mistake.place)}.{str(mistake.context['discriminator']).strip(chr(39))}"


def _tags(mistake: _Mistake) -> list[str]:
    """Return the values that such a key may have."""
    return [
        repr(tag)
        for hint in _after(mistake.hints, mistake.place[-1])
        for key in _schema_keys(hint)
        if get_origin(key.hint) is Literal and key.required
        for tag in get_args(key.hint)
    ]


def _entries(mistake: _Mistake) -> str:
    count = mistake.context["actual_length"]
    return "one entry" if count == 1 else f"{count} entries"


def _either(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"


def format_place(place: Sequence[str | int]) -> str:
    """Return keys and indices as a file's reader counts: gain[1][3] is the third number of the first row."""
    return "".join(f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in place).lstrip(".")


def format_value(value: object) -> str:
    """Return a wrong value as a file could write it, cut short."""
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _placed(error: ErrorDetails, schema: object) -> _Mistake:
    """Return an error with the keys of its location, without the labels that pydantic gives to a union's members."""
    hints: tuple[object, ...] = tuple(_members(schema))
    above, place = hints, []
    for part in error["loc"]:
        after = tuple(_after(hints, part))
        if isinstance(part, str) and not after and _chooses(hints, part):
            hints = tuple(hint for hint in hints if _is_labelled(hint, part)) or hints
            continue
        above, hints = hints, after
        place.append(part)
    return _Mistake(error=error, place=tuple(place), hints=above)


def _chooses(hints: Sequence[object], label: str) -> bool:
    return bool(_LABEL.fullmatch(label)) or any(_is_labelled(hint, label) for hint in hints)


def _is_labelled(hint: object, label: str) -> bool:
    """Return whether a union's member has that label: a model's name or the value of its key `kind`."""
    keys = _schema_keys(hint)
    named = bool(keys) and label == getattr(hint, "__name__", "")
    return named or any(label in get_args(key.hint) for key in keys)


def _after(hints: Sequence[object], part: str | int) -> Iterator[object]:
    """Return what may stand under a key or an index of what the hints describe."""
    for hint in hints:
        if isinstance(part, int):
            if get_origin(hint) in (tuple, list):
                for one in get_args(hint):
                    yield from _members(one)
        elif get_origin(hint) is dict:
            if not _LABEL.fullmatch(part):
                yield from _members(get_args(hint)[1])
        else:
            yield from _members(_keys(hint).get(part))


@dataclass(frozen=True, kw_only=True)
class _Key:
    """A key of a model or a dataclass."""

    name: str  #: in the file
    hint: object  #: its type
    required: bool


def _schema_keys(hint: object) -> list[_Key]:
    """Return the keys of a model or a dataclass; nothing of another type."""
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        return [
            _Key(name=one.alias or name, hint=one.annotation, required=one.is_required())
            for name, one in hint.model_fields.items()
        ]
    if not (isinstance(hint, type) and is_dataclass(hint)):
        return []
    hints = get_type_hints(hint, include_extras=True)
    return [
        _Key(
            name=_alias(hints[one.name]) or one.name,
            hint=hints[one.name],
            required=one.default is MISSING and one.default_factory is MISSING,
        )
        for one in fields(hint)
    ]


def _alias(hint: object) -> str | None:
    stated = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    return next((one.alias for one in stated if isinstance(one, FieldInfo) and one.alias), None)


def _keys(hint: object) -> dict[str, object]:
    """Return the keys of a model or a dataclass, each with its type."""
    return {key.name: key.hint for key in _schema_keys(hint)}


def _members(hint: object) -> Iterator[object]:
    """Return the types that a type may be, without what annotates them and without None."""
    if get_origin(hint) is Annotated:
        yield from _members(get_args(hint)[0])
    elif get_origin(hint) in (Union, UnionType):
        for one in get_args(hint):
            yield from _members(one)
    elif hint not in (None, NoneType):
        yield hint
