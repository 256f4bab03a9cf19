"""Tables of TOML files: validated by pydantic, with its errors as our sentences, and written with comments.

    input.kind is 'curent'; did you mean 'current'? It must be 'current', 'duty', 'pwm', 'torque' or 'voltage'.

A sentence names the key, its value, the allowed values, and the nearest name. Mappings, controllers, courses and
scenarios are validated here.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from ballbot.errors import InputError, either, nearest, suggest
from ballbot.printable import toml_string

T = TypeVar("T")
#: keys and indices of a file, from the top
Place = tuple[str | int, ...]
JsonSchema = Mapping[str, Any]

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
    adapter = _adapter(schema)
    try:
        # strict JSON knows tuples and floats by what they stand for, as strict Python does not
        return adapter.validate_json(json.dumps(tree, default=str), strict=True)
    except ValidationError as error:
        mistakes = [(_place(one, tree), one) for one in error.errors(include_url=False)]
    raise InputError(_first_sentence(mistakes, adapter.json_schema(), of))


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


def _place(error: ErrorDetails, tree: Any) -> Place:
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


def _schemas_at(place: Place, schema: JsonSchema, root: JsonSchema) -> Iterator[JsonSchema]:
    """Yield the JSON schemas of what may stand at a place below a schema: unions, and each of their members."""
    schema = root.get("$defs", {}).get(schema.get("$ref", "").rpartition("/")[2], schema)
    for member in (one for kind in ("anyOf", "oneOf", "allOf") for one in schema.get(kind, ())):
        yield from _schemas_at(place, member, root)
    if not place:
        yield schema
        return
    if isinstance(place[0], int):
        inner = schema.get("items") or dict(enumerate(schema.get("prefixItems", ()))).get(place[0])
    else:
        inner = schema.get("properties", {}).get(place[0]) or schema.get("additionalProperties")
    if isinstance(inner, Mapping):
        yield from _schemas_at(place[1:], inner, root)


def _first_sentence(mistakes: Sequence[tuple[Place, ErrorDetails]], schema: JsonSchema, of: str) -> str:
    for place, mistake in mistakes:
        if mistake["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
            keys = [
                key for one in _schemas_at(place[:-1], schema, schema) for key in one.get("properties", ())
            ]
            hint = suggest(str(place[-1]), dict.fromkeys(keys), otherwise="the keys there are")
            return f"{format_place(place)} is not a key of {of}; {hint}"
    # of a union, the member that went furthest into the file is the one that was meant
    first = mistakes[0][0]
    deepest = max((place for place, _ in mistakes if place[: len(first)] == first), key=len)
    tags = [
        repr(tag)
        for one in _schemas_at(deepest, schema, schema)
        for tag in one.get("discriminator", {}).get("mapping", ())
    ]
    return _sentence(deepest, [one for place, one in mistakes if place == deepest], tags, of)


def _sentence(place: Place, mistakes: Sequence[ErrorDetails], tags: Sequence[str], of: str) -> str:
    """Return the sentence on mistakes at one place: several if each member of a union was tried."""
    given, context, at = mistakes[0]["input"], mistakes[0].get("ctx", {}), format_place(place)
    match mistakes[0]["type"]:
        case "value_error" if isinstance(context["error"], InputError):
            return str(context["error"])
        case "missing":
            return f"{at} is missing; {f'[{format_place(place[:-1])}]' if place[:-1] else of} needs it."
        case "union_tag_not_found" | "union_tag_invalid":
            key = context["discriminator"].strip("'")
            if isinstance(given, Mapping) and key not in given:
                return f"{at}.{key} is missing; it must be {either(tags)}."
            return _choice(f"{at}.{key}", given[key] if isinstance(given, Mapping) else given, tags)
        case "too_short" | "too_long" as kind:
            count = context["actual_length"]
            bound = (
                f"least {context['min_length']}" if kind == "too_short" else f"most {context['max_length']}"
            )
            return f"{at} has {'one entry' if count == 1 else f'{count} entries'}; it must have at {bound}."
        case "literal_error" if len(mistakes) == 1:
            return _choice(at, given, _wanted(mistakes[0]))
    wanted = list(dict.fromkeys(one for each in mistakes for one in _wanted(each)))
    wanted = [one for one in wanted if one != "a whole number" or "a number" not in wanted]
    below = f": write its keys below a line [{at}]" if wanted == ["a table"] else ""
    return f"{at} is {format_value(given)}; it must be {either(wanted)}{below}."


def _choice(at: str, given: object, allowed: Sequence[str]) -> str:
    """Return that a value is none of those allowed, and the nearest of them."""
    near = nearest(repr(given), allowed) if isinstance(given, str) else []
    hint = f"did you mean {near[0]}? It" if near else "it"
    return f"{at} is {format_value(given)}; {hint} must be {either(allowed)}."


def _wanted(mistake: ErrorDetails) -> list[str]:
    """Return what the value must be, in one or several alternatives."""
    kind, message, context = mistake["type"], mistake["msg"], mistake.get("ctx", {})
    if kind == "literal_error":
        return re.split(r", | or ", context["expected"])
    if kind in _WANTED:
        return [_WANTED[kind].format(**context)]
    message = message.removeprefix("Input should be ").removeprefix("Value error, ")
    return [f"{message[0].lower()}{message[1:]}"]


def format_place(place: Sequence[str | int]) -> str:
    """Return keys and indices as a file's reader counts: gain[1][3] is the third number of the first row."""
    return "".join(f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in place).lstrip(".")


def format_value(value: object) -> str:
    """Return a wrong value as a file could write it, cut short."""
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
