"""Scenario files: TOML that says in what a twin differs from a named scenario.

    base = "nominal"
    backlash = 0.0

    [compliance]
    frequency = 12.0
    damping_ratio = 0.05

What a file leaves out is as in its base, "nominal" where it names none. `compliance = false` switches off what the
base has on. Units are SI. A file written by `write_scenario` says everything and reads back as the same scenario.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from types import NoneType
from typing import get_args, get_type_hints

from ballbot.errors import InputError
from ballbot.inputs import read_toml
from ballbot.robot.robot import Robot
from ballbot.schema import validated
from ballbot.twin.bristles import LAW_NAMES, BristleLaw
from ballbot.twin.scenario import Scenario
from ballbot.twin.scenario_checks import check_scenario

_HINTS = get_type_hints(Scenario)


def read_scenario(path: str | Path, robot: Robot) -> Scenario:
    """Return the scenario that a TOML file describes, for a robot.

    Raises
    ------
    InputError
        Where the file cannot be read, is no TOML, misspells a key, or describes no scenario of that robot.
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
        Where they misspell a key or describe no scenario of that robot.
    """
    return _scenario(dict(changes), robot, default_name=default_name)


def _scenario(tree: dict[str, object], robot: Robot, *, default_name: str) -> Scenario:
    base = tree.pop("base", "nominal")
    if not isinstance(base, str):
        raise InputError(f"base is {base!r}; it must be a text in quotes, such as {Scenario.names()[0]!r}.")
    start = Scenario.named(base, robot)
    _refuse_unknown(tree, Scenario, "")
    laws = tree.pop("driveline_laws", None)
    values = _merged(asdict(replace(start, driveline_laws=())), {"name": default_name, **tree})
    scenario = validated(Scenario, values, of="a scenario file")
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


def _refuse_unknown(tree: Mapping[str, object], kind: type, place: str) -> None:
    """Raise where a table has a key that its dataclass has not."""
    hints = get_type_hints(kind)
    for key, value in tree.items():
        if key not in hints:
            known = [*hints, "base"] if kind is Scenario else list(hints)
            near = get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"the keys there are {', '.join(known)}."
            raise InputError(f"{place}{key} is not a key of a scenario file; {hint}")
        below = _table_of(hints[key])
        if below:
            for one in value if isinstance(value, list) else [value]:
                if isinstance(one, dict):
                    _refuse_unknown(one, below, f"{place}{key}.")


def _table_of(hint: object) -> type | None:
    """Return the dataclass that a field's type is or holds, but for the laws, which there are several of."""
    if isinstance(hint, type) and is_dataclass(hint):
        return hint
    found = [one for one in map(_table_of, get_args(hint)) if one]
    return found[0] if len(found) == 1 else None


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
            near = get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(known)}."
            raise InputError(f"driveline_laws.{key} is not a parameter of the law {name!r}; {hint}")
    return validated(kind, table, of=f"the law {name!r}")
