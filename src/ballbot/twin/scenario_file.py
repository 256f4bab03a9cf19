"""Scenario files: TOML that says in what a twin differs from a named scenario.

    base = "nominal"
    backlash = 0.0

    [compliance]
    frequency = 12.0
    damping_ratio = 0.05

What a file leaves out is as in its base, "nominal" where it names none. `compliance = false` switches off what the
base has on. Units are SI. A file written by `write_scenario` says everything that is on, has an example of everything
that is off, and reads back as the same scenario.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields, is_dataclass, replace
from pathlib import Path
from types import NoneType
from typing import get_args, get_type_hints

from ballbot.errors import InputError, suggest
from ballbot.files import read_toml, write_text
from ballbot.printable import toml_string
from ballbot.robot import Robot
from ballbot.robot.parameters import DIMENSIONLESS, headings_of, parameters_of
from ballbot.schema import validate_table
from ballbot.twin.scenario import LAW_NAMES, BristleLaw, Scenario, check_scenario

#: a fault of each kind, of a size that a robot like the thesis's could have
EXAMPLES: dict[str, object] = {
    one.name: one.metadata["example"] for one in fields(Scenario) if one.metadata.get("example") is not None
}

_HEADINGS = headings_of(Scenario)
_PARAMETERS = {one.name: one for one in parameters_of(Scenario)}
_HINTS = get_type_hints(Scenario)


def load_scenario(source: str | Path, robot: Robot) -> Scenario:
    """Return the scenario of that name, or the one in that TOML file, for a robot.

    Raises
    ------
    InputError
        If there is neither, or the file does not describe a scenario.
    """
    if source in Scenario.names():
        return Scenario.named(str(source), robot)
    if not Path(source).exists():
        hint = suggest(str(source), Scenario.names(), otherwise="the named ones are")
        raise InputError(f"There is no scenario or scenario file {str(source)!r}; {hint}")
    return read_scenario(source, robot)


def read_scenario(path: str | Path, robot: Robot) -> Scenario:
    """Return the scenario that a TOML file describes, for a robot.

    Raises
    ------
    InputError
        If the file cannot be read, is no TOML, misspells a key, or describes no scenario of that robot.
    """
    path = Path(path)
    tree = read_toml(path)
    try:
        return scenario_of(tree, robot, default_name=path.stem)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def scenario_of(changes: Mapping[str, object], robot: Robot, *, default_name: str) -> Scenario:
    """Return the scenario that tables as those of a scenario file describe, for a robot.

    Parameters
    ----------
    changes : mapping
        What a scenario file says, as nested dictionaries; empty is `nominal`.
    robot : Robot
    default_name : str
        The scenario's, where the tables name none.

    Raises
    ------
    InputError
        If they misspell a key or describe no scenario of that robot.
    """
    return _scenario(dict(changes), robot, default_name=default_name)


def _scenario(tree: dict[str, object], robot: Robot, *, default_name: str) -> Scenario:
    base = tree.pop("base", "nominal")
    if not isinstance(base, str):
        raise InputError(f"base is {base!r}; it must be a text in quotes, such as {Scenario.names()[0]!r}.")
    start = Scenario.named(base, robot)
    _refuse_unknown(tree)
    laws = tree.pop("driveline_laws", None)
    values = _merged(asdict(replace(start, driveline_laws=())), {"name": default_name, **tree})
    scenario = validate_table(Scenario, values, of="a scenario file")
    scenario = replace(scenario, driveline_laws=start.driveline_laws if laws is None else _laws(laws))
    check_scenario(scenario, robot)
    return scenario


def _merged(base: Mapping[str, object], changes: Mapping[str, object]) -> dict[str, object]:
    """Return the base with the changes in it, table by table."""
    merged = dict(base)
    for key, value in changes.items():
        known = merged.get(key)
        if isinstance(known, dict) and isinstance(value, dict):
            merged[key] = _merged(known, value)
        else:
            merged[key] = None if value is False and _may_be_off(key) else value
    return merged


def _may_be_off(key: str) -> bool:
    return NoneType in get_args(_HINTS.get(key))


def _refuse_unknown(tree: Mapping[str, object], place: str = "") -> None:
    """Raise InputError if a table has a key that the schema has not; a law's own keys are left to it."""
    known = (one.removeprefix(place) for one in (*_PARAMETERS, *_HEADINGS) if one.startswith(place))
    keys = list(dict.fromkeys(one.partition(".")[0] for one in known))
    for key, value in tree.items():
        if key not in keys:
            offered = keys if place else [*keys, "base"]
            hint = suggest(key, offered, otherwise="the keys there are")
            raise InputError(f"{place}{key} is not a key of a scenario file; {hint}")
        if f"{place}{key}" in _HEADINGS and key != "driveline_laws":
            for one in value if isinstance(value, list) else [value]:
                if isinstance(one, dict):
                    _refuse_unknown(one, f"{place}{key}.")


def _laws(tables: object) -> tuple[BristleLaw, ...]:
    if not (isinstance(tables, list) and all(isinstance(table, dict) for table in tables)):
        raise InputError(
            "driveline_laws must be tables: write [[driveline_laws]] above the keys of each wheel."
        )
    return tuple(_law(dict(table)) for table in tables)


def _law(table: dict[str, object]) -> BristleLaw:
    name = table.pop("law", None)
    if not (isinstance(name, str) and name in LAW_NAMES):
        raise InputError(f"driveline_laws.law is {name!r}; it must be one of {', '.join(LAW_NAMES)}.")
    kind = LAW_NAMES[name]
    known = [field.name for field in fields(kind)]
    for key in table:
        if key not in known:
            hint = suggest(key, known, otherwise="it has")
            raise InputError(f"driveline_laws.{key} is not a parameter of the law {name!r}; {hint}")
    return validate_table(kind, table, of=f"the law {name!r}")


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
        If the file cannot be written.
    """
    write_text(path, scenario_text(scenario))


def scenario_text(scenario: Scenario) -> str:
    """Return the text that `write_scenario` writes."""
    tables: list[str] = []
    lines = [_HEADER, 'base = "nominal"']
    for field in fields(scenario):
        name, value = field.name, getattr(scenario, field.name)
        if name == "driveline_laws":
            tables += [line for law in value for line in _law_lines(law)]
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
        absent = value is None or (value == () and field.default == ())
        if not absent:
            yield _line(field.name, value, place + field.name)


def _line(key: str, value: object, name: str) -> str:
    comment = "".join(_comment(name, "  "))
    return f"{key} = {_toml(value)}{comment}"


def _comment(name: str, space: str) -> list[str]:
    """Return what is said about a key or a table, in a list; nothing about a key of a friction law."""
    if name in _PARAMETERS:
        one = _PARAMETERS[name]
        unit = "" if one.unit == DIMENSIONLESS else f" [{one.unit}]"
        return [f"{space}# {one.meaning}{unit}"]
    return [f"{space}# {_HEADINGS[name]}"] if name in _HEADINGS else []


def _law_lines(law: object) -> Iterator[str]:
    name = next(name for name, kind in LAW_NAMES.items() if isinstance(law, kind))
    yield from ("", *_comment("driveline_laws", ""), "[[driveline_laws]]", f'law = "{name}"')
    yield from _lines(law, "driveline_laws.")


def _switched_off(name: str) -> list[str]:
    if name not in EXAMPLES:
        return []
    heading = f"[[{name}]]" if name == "pushes" else f"[{name}]"
    lines = [heading, *_lines(EXAMPLES[name], f"{name}.")]
    return ["", f"# Off: {_HEADINGS[name]}", *(f"# {line}" for line in lines)]


def _toml(value: object) -> str:
    if isinstance(value, tuple | list):
        return f"[{', '.join(_toml(one) for one in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return toml_string(value)
    return repr(value)
