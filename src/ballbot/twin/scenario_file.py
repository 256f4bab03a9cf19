"""Scenario files.

A scenario file states the differences from a named scenario, "nominal" if it names none, in SI units:

    base = "nominal"
    backlash = 0.0

    [compliance]
    frequency = 12.0
    damping_ratio = 0.05

`compliance = false` switches off a fault of the base. The text of `scenario_text` has every fault that is on
and, commented out, an example of every other one; it reads back as the same scenario.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields, is_dataclass, replace
from pathlib import Path
from types import NoneType
from typing import get_args, get_type_hints

from ballbot.errors import InputError, about, check_known, suggest
from ballbot.file_formats import format_line, take_format
from ballbot.files import read_toml
from ballbot.robot import Friction, RobotLike, as_robot
from ballbot.robot.friction_law import CLASSICAL, OWN_PARAMETERS, friction_law
from ballbot.robot.parameters import DIMENSIONLESS, parameters_of
from ballbot.schema import toml_line, validate_table
from ballbot.twin.scenario import Scenario, check_scenario

#: a fault of each kind, of a size that a robot like the thesis's could have
EXAMPLES: dict[str, object] = {
    key.name: key.metadata["example"] for key in fields(Scenario) if key.metadata.get("example") is not None
}

_HEADER = """\
# A scenario for Ballbot's twin: the robot's true properties, unknown to the identification. Units are SI.
# Record with it: ballbot record FILE --out DIR. A key that a file omits has the value of its base. A fault that is off
# is commented out; remove the # at the beginning of its lines to switch it on.

base = "nominal"
"""


def load_scenario(source: Scenario | str | Path, robot: RobotLike) -> Scenario:
    """Return the scenario itself, or the one of that name or in that TOML file for a robot.

    InputError if there is neither, or the file cannot be read, misspells a key or describes no scenario of that robot.

    >>> load_scenario("ideal", "alten").backlash
    0.0
    """
    if isinstance(source, Scenario):
        return source
    if source in Scenario.names():
        return Scenario.named(str(source), robot)
    path = Path(source)
    if not path.exists():
        hint = suggest(str(source), Scenario.names(), otherwise="the named ones are")
        raise InputError(f"There is no scenario or scenario file {str(source)!r}; {hint}")
    tree = read_toml(path)
    with about(path):
        tables = take_format(tree, "scenario")
        return scenario_of(tables, robot, default_name=path.stem, folder=path.parent)


def scenario_of(
    tree: Mapping[str, object], robot: RobotLike, *, default_name: str, folder: Path = Path()
) -> Scenario:
    """Return the scenario that the tables of a scenario file describe, for a robot; without any it is `nominal`.

    A friction law's Python file is in the folder. InputError if they misspell a key or describe no scenario of that
    robot.
    """
    changes = dict(tree)
    base = changes.pop("base", "nominal")
    if not isinstance(base, str):
        raise InputError(f"base is {base!r}; it must be a text in quotes, such as {Scenario.names()[0]!r}.")
    start = Scenario.named(base, robot)
    # files of earlier versions have it as zero
    if changes.pop("asymmetry", 0.0) != 0.0:
        raise InputError(
            "asymmetry is gone: give coulomb_asymmetry and stribeck_asymmetry in [friction] [N m]."
        )
    values = _merged(asdict(start), {"name": default_name, **changes})
    if isinstance(friction := values["friction"], dict):
        values["friction"] = _by_law(friction, folder)
    scenario = validate_table(Scenario, values, of="a scenario file")
    friction = scenario.friction.with_law(scenario.friction.law, dict(scenario.friction.own))
    scenario = replace(scenario, friction=friction)
    check_scenario(scenario, as_robot(robot))
    return scenario


def _by_law(friction: Mapping[str, object], folder: Path) -> dict[str, object]:
    """Return the friction with the law that it names, and this law's own parameters as pairs."""
    law, own = friction_law(str(friction["law"]), folder=folder), friction["own"]
    if isinstance(own, dict):
        known = [parameter.name for parameter in law.own] if law else []
        for name in own:
            check_known(name, known, f"friction.own.{name} is no parameter of the law", otherwise="it has")
        own = tuple(own.items())
    return {**friction, "law": law.text if law else CLASSICAL, "own": own}


def _merged(base: Mapping[str, object], changes: Mapping[str, object]) -> dict[str, object]:
    """Return the base with the changes in it, table by table; false switches a fault off."""
    merged, hints = dict(base), get_type_hints(Scenario)
    for key, value in changes.items():
        known = merged.get(key)
        if isinstance(known, dict) and isinstance(value, dict):
            merged[key] = _merged(known, value)
        else:
            merged[key] = None if value is False and NoneType in get_args(hints.get(key)) else value
    return merged


def scenario_text(scenario: Scenario) -> str:
    """Return a scenario as a TOML file, which reads back as the same."""
    keys: list[str] = []
    tables: list[str] = []
    for field in fields(scenario):
        value = getattr(scenario, field.name)
        if "heading" not in field.metadata:
            keys += _lines({field.name: value}, "")
        elif value is None or (value == () and field.name in EXAMPLES):
            off = _table(field.name, EXAMPLES[field.name])
            tables += ["", f"# Off: {field.metadata['heading']}", *(f"# {line}" for line in off)]
        else:
            for content in value if isinstance(value, tuple) else (value,):
                tables += ["", f"# {field.metadata['heading']}", *_table(field.name, content)]
    return "\n".join([_HEADER + "\n".join([format_line("scenario"), *keys]), *tables]) + "\n"


def _table(name: str, content: object) -> list[str]:
    """Return the lines of a table, in double brackets if there may be several."""
    assert is_dataclass(content)
    lines = [
        f"[[{name}]]" if name == "pushes" else f"[{name}]",
        *_lines({field.name: getattr(content, field.name) for field in fields(content)}, f"{name}."),
    ]
    if isinstance(content, Friction) and content.own_law:
        lines.insert(1, toml_line("law", content.law))
        lines += ["", "[friction.own]", *_lines(dict(content.own), "friction.own.")]
    return lines


def _lines(values: Mapping[str, object], prefix: str) -> Iterator[str]:
    """Yield a line for each key that is not empty."""
    stated = OWN_PARAMETERS | {parameter.name: parameter for parameter in parameters_of(Scenario)}
    for key, value in values.items():
        if value != () and f"{prefix}{key}" not in ("friction.law", "friction.own"):
            parameter = stated[f"{prefix}{key}"]
            unit = f" [{parameter.unit}]" if parameter.unit != DIMENSIONLESS else ""
            yield toml_line(key, value, f"{parameter.meaning}{unit}")
