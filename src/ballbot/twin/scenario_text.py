"""A scenario as a commented TOML file: everything that is on, and an example of everything that is off."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path

from ballbot.files import write_text
from ballbot.printable import toml_string
from ballbot.twin.bristles import LAW_NAMES
from ballbot.twin.scenario import Scenario
from ballbot.twin.scenario_words import EXAMPLES, MEANINGS

_HEADER = (
    "# A scenario for Ballbot's twin: the robot's true properties, unknown to the "
    "identification. Units are SI.\n# Record with it: ballbot record FILE --out "
    "DIR. A key that a file omits has the value of its base. What is off is\n# "
    "commented out; remove the # at the beginning of its lines to switch it on.\n"
)


def write_scenario(scenario: Scenario, path: str | Path) -> None:
    """Write a scenario as a TOML file that reads back as the same one.

    Raises
    ------
    InputError
        Where the file cannot be written.
    """
    write_text(path, scenario_text(scenario))


def scenario_text(scenario: Scenario) -> str:
    """Return the text that `write_scenario` writes."""
    tables: list[str] = []
    lines = [_HEADER, 'base = "nominal"']
    for field in fields(scenario):
        name, value = field.name, getattr(scenario, field.name)
        if name == "driveline_laws":
            tables += [line for law in value for line in _law(law)]
        elif is_dataclass(value):
            tables += ["", *_comment(name, ""), f"[{name}]", *_lines(value, f"{name}.")]
        elif name == "pushes" and value:
            for push in value:
                tables += ["", *_comment(name, ""), f"[[{name}]]", *_lines(push, f"{name}.")]
        elif value is None or name == "pushes":
            tables += _switched_off(name)
        else:
            lines.append(_line(name, value, name))
    return "\n".join([*lines, *tables]) + "\n"


def _lines(table: object, place: str) -> Iterator[str]:
    assert is_dataclass(table)
    for field in fields(table):
        value = getattr(table, field.name)
        if value is not None:
            yield _line(field.name, value, place + field.name)


def _line(key: str, value: object, name: str) -> str:
    comment = "".join(_comment(name, "  "))
    return f"{key} = {_toml(value)}{comment}"


def _comment(name: str, space: str) -> list[str]:
    return [f"{space}# {MEANINGS[name]}"] if name in MEANINGS else []


def _law(law: object) -> Iterator[str]:
    name = next(name for name, kind in LAW_NAMES.items() if isinstance(law, kind))
    yield from ("", *_comment("driveline_laws", ""), "[[driveline_laws]]", f'law = "{name}"')
    yield from _lines(law, "driveline_laws.")


def _switched_off(name: str) -> list[str]:
    if name not in EXAMPLES:
        return []
    heading = f"[[{name}]]" if name == "pushes" else f"[{name}]"
    lines = [heading, *_lines(EXAMPLES[name], f"{name}.")]
    return ["", f"# Off: {MEANINGS[name]}", *(f"# {line}" for line in lines)]


def _toml(value: object) -> str:
    if isinstance(value, tuple | list):
        return f"[{', '.join(_toml(one) for one in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return toml_string(value)
    return repr(value)
