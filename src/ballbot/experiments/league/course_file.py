"""Course files: TOML with courses in sets, the built-in ones and a user's own; see courses.toml beside this."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    NonNegativeFloat,
    PositiveFloat,
)

from ballbot.control.references import is_reference_file
from ballbot.errors import InputError
from ballbot.experiments.league.course import Asked, Course, Unlike
from ballbot.experiments.metrics import SETTLE
from ballbot.inputs import read_toml
from ballbot.robot import Robot
from ballbot.schema import validated
from ballbot.twin.scenario_file import scenario_of

PlantName = Literal["model", "twin"]

#: the set that is these sets together
LEAGUE = "league"
_IN_LEAGUE = ("motions", "disturbances")
#: a course lasts at most a day [s]: the log of a longer one would not fit into memory
_LONGEST = 86400.0

_Tables = Mapping[str, Mapping[str, object]]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class UnlikeTable(_Table):
    """[set.course.unlike]: factors."""

    mass: PositiveFloat = 1.0
    height: PositiveFloat = 1.0
    friction: NonNegativeFloat = 1.0


class CourseTable(_Table):
    """[set.course]: a course as a file says it."""

    about: str = ""
    reference: str | dict[str, FiniteFloat | str]
    duration: float = Field(gt=0.0, le=_LONGEST)
    settle: NonNegativeFloat = SETTLE
    unlike: UnlikeTable = UnlikeTable()
    scenario: dict[str, object] = {}


def choose_courses(words: str, robot: Robot, plant: PlantName) -> tuple[Course, ...]:
    """Return the courses that a text names, each once.

    Parameters
    ----------
    words : str
        Names of built-in sets and courses, and paths of course files, with commas between.
    robot : Robot
        That will run them.
    plant : {"model", "twin"}
        On which; a course whose scenario differs from the nominal one is for the twin only.

    Raises
    ------
    InputError
        Where there is no such set, course or file, a file describes no courses, or two courses have one name.
    """
    sets = built_in_sets()
    found: dict[str, Course] = {}
    for word in (one.strip() for one in words.split(",")):
        for course in _of_word(word, sets, robot, plant):
            if found.setdefault(course.name, course) != course:
                raise InputError(f"There are two courses {course.name!r}; rename the one in {word}.")
    return tuple(found.values())


def built_in_sets() -> dict[str, _Tables]:
    """Return the tables of courses.toml, sets of courses by name; the first is `league`."""
    text = files("ballbot.experiments.league").joinpath("courses.toml").read_text(encoding="utf-8")
    sets: dict[str, _Tables] = tomllib.loads(text)
    return {LEAGUE: {name: table for part in _IN_LEAGUE for name, table in sets[part].items()}} | sets


def read_courses(path: str | Path, robot: Robot, plant: PlantName) -> list[Course]:
    """Return the courses of all sets of a course file.

    Raises
    ------
    InputError
        Where the file cannot be read, is no TOML, or describes no courses.
    """
    path = Path(path)
    sets = read_toml(path)
    courses = []
    for group, tables in sets.items():
        if not (isinstance(tables, dict) and all(isinstance(one, dict) for one in tables.values())):
            raise InputError(f"{path}: {group} holds no courses; write each under a line [{group}.NAME].")
        for name, table in tables.items():
            courses.append(
                _course(name, table, robot, plant, place=f"{path}: [{group}.{name}]", beside=path.parent)
            )
    if not courses:
        raise InputError(f"{path} holds no courses; write each under a line [SET.NAME].")
    return courses


def _of_word(word: str, sets: Mapping[str, _Tables], robot: Robot, plant: PlantName) -> list[Course]:
    if Path(word).suffix == ".toml":
        return read_courses(word, robot, plant)
    known = {name: table for tables in sets.values() for name, table in tables.items()}
    if word not in sets and word not in known:
        raise InputError(
            f"There is no set or course {word!r}. The sets are {', '.join(sets)}; the courses are "
            f"{', '.join(known)}; the name of a course file ends in .toml."
        )
    tables = sets[word] if word in sets else {word: known[word]}
    return [
        _course(name, table, robot, plant, place=f"the course {name!r}", beside=Path())
        for name, table in tables.items()
    ]


def _course(
    name: str, table: Mapping[str, object], robot: Robot, plant: PlantName, *, place: str, beside: Path
) -> Course:
    try:
        said = validated(CourseTable, table, of="a course")
        asked = _asked(said.reference, beside)
        asked.reference()  # refused before anything is run
        if plant == "model":
            if said.scenario:
                raise InputError("It has a scenario, which only the twin can simulate; choose --plant twin.")
            scenario = None
        else:
            scenario = scenario_of(said.scenario, robot, default_name=name)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
    return Course(
        name=name,
        about=said.about,
        asked=asked,
        duration=said.duration,
        settle=said.settle,
        unlike=Unlike(**said.unlike.model_dump()),
        scenario=scenario,
    )


def _asked(reference: str | Mapping[str, float | str], beside: Path) -> Asked:
    options = {} if isinstance(reference, str) else dict(reference)
    name = reference if isinstance(reference, str) else options.pop("name", None)
    if not isinstance(name, str):
        raise InputError('reference is a table without a name; add name = "square" or another.')
    words = [key for key, value in options.items() if isinstance(value, str)]
    if words:
        raise InputError(f"reference.{words[0]} is {options[words[0]]!r}; it must be a number.")
    numbers = tuple((key, float(value)) for key, value in options.items())
    return Asked(name=str(beside / name) if is_reference_file(name) else name, options=numbers)
