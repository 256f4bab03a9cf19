"""Robot files: TOML in which every number states its unit and its source.

    [ball]
    radius = { value = 0.11, unit = "m", source = "measured" }

A number without a unit and a source is refused. A standard deviation may stand beside the value, in the same unit:
`standard_deviation = 0.001`, or a list with one for each wheel. Units other than SI are converted on reading
(`ballbot.robot.parameters`). A file written by `Robot.write` reads back as the same floats.

Numbers identified together have correlated errors. The table `[correlation]` at a file's end lists them:

    [correlation]
    of = ["friction.viscous[0]", "friction.coulomb[0]"]
    lower = [
        [1.0],
        [-0.93, 1.0],
    ]

A standard deviation of inf belongs to a number that was estimated without a standard error: how well it is known is
unknown. The table `[intervals]` has its least and greatest value, as far as the data limit it:

    [intervals]
    "friction.stribeck[2]" = [0.0, 0.06]
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from ballbot.errors import InputError, about, suggest
from ballbot.file_formats import format_line, take_format
from ballbot.files import read_toml
from ballbot.printable import toml_string
from ballbot.robot.checks import check_source
from ballbot.robot.components import BY_NAME, PARAMETERS, Correlation, RobotValues, parameters_of_robot
from ballbot.robot.friction_law import CLASSICAL, OWN_PARAMETERS, friction_law
from ballbot.robot.parameters import (
    ASSUMED,
    DIMENSIONLESS,
    Parameter,
    Value,
    build,
    from_si,
    headings_of,
    numbers_of,
    to_si,
    value_of,
)
from ballbot.schema import toml_line, toml_value, validate_table

R = TypeVar("R", bound=RobotValues)


class Entry(BaseModel):
    """One parameter as a file states it."""

    model_config = ConfigDict(extra="forbid", strict=True)

    value: int | float | list[float]
    unit: str = DIMENSIONLESS
    source: str
    standard_deviation: int | float | list[float] | None = None


class IdentificationTables(BaseModel):
    """The tables that an identification leaves in a file: how well numbers are known, and by which logs."""

    model_config = ConfigDict(extra="forbid", strict=True)

    correlation: Correlation = Correlation()
    intervals: dict[str, Annotated[tuple[float, ...], Field(min_length=2, max_length=2)]] = {}
    identified_from: dict[Literal["rows"], tuple[str, ...]] = {}


def parse_entry(parameter: Parameter, raw: object) -> tuple[Value, str, Value | None]:
    """Return a parameter's value and source, and its standard deviation if there is one; both numbers in SI units.

    InputError if a key is missing, unknown or of the wrong type, or the unit or the source is not understood.
    """
    if not isinstance(raw, dict):
        raise InputError(
            f"{parameter.name} is {raw!r}, without a unit and a source; write {example(parameter, raw)}."
        )
    with about(parameter.name):
        entry = validate_table(Entry, raw, of="a parameter")
    if parameter.unit != DIMENSIONLESS and "unit" not in entry.model_fields_set:
        raise InputError(f'{parameter.name} has no unit; write unit = "{parameter.written_in}".')
    check_source(parameter.name, entry.source)
    value, deviation = _in_si(parameter, entry.value, entry.unit), entry.standard_deviation
    if deviation is None:
        return value, entry.source, None
    if parameter.shape == "whole number":
        raise InputError(f"{parameter.name} is a whole number and cannot have a standard deviation.")
    # one number stands for every wheel's
    if isinstance(entry.value, list) and not isinstance(deviation, list):
        deviation = [float(deviation)] * len(entry.value)
    return value, entry.source, _in_si(parameter, deviation, entry.unit)


def example(parameter: Parameter, value: object = None) -> str:
    """Return a line that a file could give the parameter in, with the value that it gives if it is a number or list."""
    number = {"number": "0.0", "whole number": "2", "list": "[0.0, 0.0, 0.0]"}[parameter.shape]
    if isinstance(value, int | float | list) and isinstance(value, list) == (parameter.shape == "list"):
        number = repr(value)
    unit = "" if parameter.written_in == DIMENSIONLESS else f'unit = "{parameter.written_in}", '
    return f'{parameter.key} = {{ value = {number}, {unit}source = "assumed" }}'


def _in_si(parameter: Parameter, value: float | list[float], unit: str) -> Value:
    fits = isinstance(value, list) == (parameter.shape == "list")
    if not fits or (parameter.shape == "whole number" and not isinstance(value, int)):
        listed = parameter.shape == "list"
        wanted = "a list with a number for each wheel" if listed else f"one {parameter.shape}"
        raise InputError(f"{parameter.name} has the value {value!r}; it must be {wanted}.")
    try:
        if isinstance(value, list):
            return tuple(to_si(float(number), unit, parameter.unit) for number in value)
        converted = to_si(float(value), unit, parameter.unit)
    except InputError as error:
        raise InputError(f"{parameter.name}: {error}.") from None
    return int(value) if parameter.shape == "whole number" else converted


#: a friction law, and the table of its own parameters
_LAW, _OWN = "friction.law", "friction.own"
#: the texts of a file, each as it could be written; every other key is a parameter
_TEXTS = {
    "name": 'name = "myrobot"',
    "body.inertia.about": 'about = "ball_center"',
    _LAW: 'law = "FILE.py:NAME"',
}

_HEADER = """\
# A ball-balancing robot for Ballbot. Check it with: ballbot check FILE
#
# Every parameter has a value, a unit and a source: measured, data sheet, previous work, calculated, identified
# or assumed, with details after a colon. Units may be changed, as from m to cm or from deg to rad. The standard
# deviation of a value may be added, as standard_deviation = 0.001, in the same unit. The body's frame has
# x forward, y left and z up.
"""


def read_robot(path: str | Path, kind: type[R]) -> R:
    """Return the robot that a TOML file describes, as the class `kind`; `Robot.load` calls this.

    InputError if the file cannot be read, is no TOML, lacks or misspells a key, or describes no robot.
    """
    tree = read_toml(path)
    with about(path):
        tree = take_format(tree, "robot")
        tables = {name: tree.pop(name) for name in IdentificationTables.model_fields if name in tree}
        stated = validate_table(IdentificationTables, tables, of="a robot file")
        return build(kind, _fields(dict(_leaves(tree)), stated, Path(path).parent))


def robot_text(robot: RobotValues) -> str:
    """Return a robot as a commented TOML file, which reads back as the same floats; see `Robot.write`."""
    blocks = [f"{_HEADER}\n{format_line('robot')}\nname = {toml_string(robot.name)}", *_lines(robot, "")]
    for table, heading in headings_of(RobotValues).items():
        blocks += ["", f"# {heading}", f"[{table}]"]
        if table == "body.inertia":
            blocks.append(f"about = {toml_string(robot.body.inertia_about)}")
        if table == "friction" and robot.friction.own_law:
            blocks.append(f"law = {toml_string(robot.friction.law)}")
        blocks += _lines(robot, table)
    if robot.friction.own:
        blocks += ["", "# Parameters of the friction law's own.", f"[{_OWN}]", *_lines(robot, _OWN)]
    return "\n".join([*blocks, *_identification_lines(robot)]) + "\n"


def _identification_lines(robot: RobotValues) -> Iterator[str]:
    correlation = robot.correlation
    if robot.identified_from:
        yield "\n# Hashes of some rows of the logs that it was identified from: validation names these logs."
        yield f"[identified_from]\n{toml_line('rows', robot.identified_from)}"
    if robot.intervals:
        yield "\n# Numbers estimated without a standard error: as far as the data limit them, in SI units."
        yield "[intervals]"
        for label, ends in robot.intervals.items():
            yield toml_line(toml_string(label), [float(end) for end in ends])
    if correlation.of:
        yield "\n# Correlations of the errors of numbers identified together."
        yield from ("[correlation]\nof = [", *(f"    {toml_string(label)}," for label in correlation.of), "]")
        rows = ([float(number) for number in row] for row in correlation.lower)
        yield from ("lower = [", *(f"    {toml_value(row)}," for row in rows), "]")


def _lines(robot: RobotValues, table: str) -> Iterator[str]:
    for parameter in parameters_of_robot(robot):
        if parameter.table == table and (value := value_of(robot, parameter)) != ():
            values = [value]
            if parameter.name in robot.standard_deviations:
                values.append(robot.standard_deviations[parameter.name])
            texts, unit = _written(values, parameter)
            unit_text = "" if unit == DIMENSIONLESS else f"unit = {toml_string(unit)}, "
            deviation = f"standard_deviation = {texts[1]}, " if len(texts) > 1 else ""
            source = toml_string(robot.sources.get(parameter.name, ASSUMED))
            yield f"# {parameter.meaning}"
            yield f"{parameter.key} = {{ value = {texts[0]}, {unit_text}{deviation}source = {source} }}"


def _written(values: Sequence[Value], parameter: Parameter) -> tuple[list[str], str]:
    """Return values as texts and their unit: the file's unit where all read back exactly, else SI."""
    if parameter.shape == "whole number":
        return [str(value) for value in values], parameter.unit
    numbers = [[float(number) for number in numbers_of(value)] for value in values]
    converted = [[from_si(number, parameter.written_in, parameter.unit) for number in row] for row in numbers]
    exact = all(None not in row for row in converted)
    texts = [[repr(number) for number in row] for row in (converted if exact else numbers)]
    joined = [f"[{', '.join(row)}]" if parameter.shape == "list" else row[0] for row in texts]
    return joined, parameter.written_in if exact else parameter.unit


def _leaves(tree: Mapping[str, object], *, table: str = "") -> Iterator[tuple[str, object]]:
    """Yield the dotted name and the raw content of every key below the tables; refuse unknown names."""
    for key, content in tree.items():
        name = f"{table}.{key}" if table else key
        if name in headings_of(RobotValues) or name == _OWN:
            if not isinstance(content, dict):
                raise InputError(f"{name} must be a table: write its keys under a line [{name}].")
            yield from _leaves(content, table=name)
        elif name in BY_NAME or name in _TEXTS:
            yield name, content
        else:
            raise InputError(f"{name!r} is not a parameter of a robot; {_nearest(key, table)}")


def _nearest(key: str, table: str) -> str:
    """Return a hint: the key of the table that was meant, or all its keys ("" is the top of the file)."""
    names = [*headings_of(RobotValues), *_TEXTS, *BY_NAME]
    siblings = [name.rpartition(".")[2] for name in names if name.rpartition(".")[0] == table]
    return suggest(key, siblings, otherwise=f"{f'[{table}]' if table else 'the top level'} has")


def _fields(leaves: Mapping[str, object], stated: IdentificationTables, folder: Path) -> dict[str, object]:
    """Return the values of a robot's fields by dotted name, in SI units."""
    name, about = _text(leaves, "name"), _text(leaves, "body.inertia.about")
    # a Python file's path is relative to the folder of the robot file
    law = friction_law(_text(leaves, _LAW, default=CLASSICAL), folder=folder)
    own = {law_parameter.stated.name: law_parameter for law_parameter in law.own} if law else {}
    for key in leaves:
        if key in OWN_PARAMETERS and key not in own:
            raise InputError(f"{key} is no parameter of the friction law {law.name if law else CLASSICAL}.")
    values: dict[str, Value] = {}
    sources: dict[str, str] = {}
    deviations: dict[str, Value] = {}
    for parameter in (*PARAMETERS, *(law_parameter.stated for law_parameter in own.values())):
        key = parameter.name
        if key in leaves:
            values[key], sources[key], deviation = parse_entry(parameter, leaves[key])
            if deviation is not None:
                deviations[key] = deviation
        elif parameter.default is not None:
            sources[key] = ASSUMED
        else:
            raise InputError(f"{key} is missing; add {example(parameter)} {_place(key)}.")
    return {
        **values,
        _LAW: law.text if law else CLASSICAL,
        _OWN: tuple((law_parameter.name, values[name]) for name, law_parameter in own.items()),
        "name": name,
        "body.inertia_about": about,
        "sources": sources,
        "standard_deviations": deviations,
        "correlation.of": stated.correlation.of,
        "correlation.lower": stated.correlation.lower,
        "identified_from": stated.identified_from.get("rows", ()),
        "intervals": stated.intervals,
    }


def _text(leaves: Mapping[str, object], name: str, *, default: str | None = None) -> str:
    text = leaves.get(name, default)
    if text is None:
        raise InputError(f"{name} is missing; add {_TEXTS[name]} {_place(name)}.")
    if not isinstance(text, str):
        raise InputError(f"{name} is {text!r}; it must be a text in quotes, such as {_TEXTS[name]}.")
    return text


def _place(name: str) -> str:
    table = name.rpartition(".")[0]
    return f"under [{table}]" if table else "at the top of the file"
