"""Courses: the reference that a robot follows and the conditions it meets, as values and as TOML files.

The built-in courses are in courses.toml beside this file, in sets; a user's own file has the same form.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Literal, cast

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, NonNegativeFloat, PositiveFloat

from ballbot.control.references import REFERENCES, Reference, is_reference_file, read_reference
from ballbot.errors import InputError, suggest
from ballbot.file_formats import take_format
from ballbot.files import parse_toml, read_toml
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.robot.components import scaled_body, scaled_friction
from ballbot.schema import validate_table
from ballbot.twin.imperfections import with_identified
from ballbot.twin.scenario import Scenario
from ballbot.twin.scenario_file import scenario_of
from ballbot.workflows.grid import LoopRobot, TwinRobot
from ballbot.workflows.metrics import SETTLE


@dataclass(frozen=True, kw_only=True)
class ReferenceSpec:
    """A reference by what makes it, so that it can go to other processes."""

    name: str  #: of `ballbot.control.references`, or a reference file
    options: tuple[tuple[str, float], ...] = ()  #: of the named one, such as ("ramp", 0.0)

    def reference(self) -> Reference:
        """Return it; InputError if there is no such reference, or it has no such option."""
        if is_reference_file(self.name):
            if self.options:
                raise InputError(
                    f"The reference file {self.name} takes no options; remove {self.options[0][0]}."
                )
            return read_reference(self.name)
        if self.name not in REFERENCES:
            hint = suggest(self.name, REFERENCES, otherwise="the names are")
            raise InputError(f"There is no reference {self.name!r}; {hint}")
        make = REFERENCES[self.name]
        known = inspect.signature(make).parameters
        for key, _ in self.options:
            if key not in known:
                raise InputError(f"The reference {self.name} has no option {key}; it has {', '.join(known)}.")
        return make(**dict(self.options))


@dataclass(frozen=True, kw_only=True)
class ModelMismatch:
    """How the robot that runs differs from the one described, which the controllers know: factors."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)

    mass: PositiveFloat = 1.0  #: of the body
    height: PositiveFloat = 1.0  #: of its centre of mass above the ball's centre
    friction: NonNegativeFloat = 1.0  #: of the wheels' and the rolling friction


PlantName = Literal["model", "twin"]


@dataclass(frozen=True, kw_only=True)
class Course:
    """What every controller is put through."""

    name: str
    about: str  #: in a sentence, for those who read the table
    reference_spec: ReferenceSpec
    duration: float  #: [s]
    settle: float  #: errors count from so long after the start and each jump of the reference on [s]
    mismatch: ModelMismatch = ModelMismatch()
    scenario: Scenario
    on: PlantName

    @property
    def disturbed(self) -> tuple[float, ...]:
        """When something pushes the robot [s]."""
        return tuple(push.time for push in self.scenario.pushes)

    def plant(self, robot: Robot) -> LoopRobot | TwinRobot:
        """Return the robot to run; of the model the friction is the robot's, of the twin the scenario's."""
        other = self.mismatch
        true = robot
        if other != ModelMismatch():
            body = scaled_body(robot.body, mass=other.mass, height=other.height)
            true = robot.replace(body=body, friction=scaled_friction(robot.friction, other.friction))
        if self.on == "model":
            return LoopRobot.of(true, with_identified(self.scenario, true.friction), known=robot)
        friction = scaled_friction(self.scenario.friction, other.friction)
        return TwinRobot(robot=true, scenario=replace(self.scenario, friction=friction), known=robot)


#: the set that is these sets together
LEAGUE = "league"
_IN_LEAGUE = ("motions", "disturbances")
#: a course lasts at most a day [s]: the log of a longer one would not fit into memory
_MAX_DURATION = 86400.0

_Tables = Mapping[str, Mapping[str, object]]


class CourseTable(BaseModel):
    """[set.course]: a course in a file."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    about: str = ""
    reference: str | dict[str, FiniteFloat | str]
    duration: float = Field(gt=0.0, le=_MAX_DURATION)
    settle: NonNegativeFloat = SETTLE
    mismatch: ModelMismatch = ModelMismatch()
    scenario: dict[str, object] = {}


def choose_courses(words: str, robot: RobotLike, plant: PlantName) -> tuple[Course, ...]:
    """Return the courses that a text names, each once: sets, courses and course files, with commas between.

    InputError if there is no such course, a file cannot be read or describes no courses, or two have one name.
    """
    robot, found = as_robot(robot), dict[str, Course]()
    for word in (part.strip() for part in words.split(",")):
        is_file = Path(word).suffix == ".toml"
        for place, name, table in _in_file(word) if is_file else _built_in(word):
            beside = Path(word).parent if is_file else Path()
            course = _course(name, table, robot, plant, place=place, beside=beside)
            if found.setdefault(name, course) != course:
                raise InputError(f"There are two courses {name!r}; rename the one in {word}.")
    return tuple(found.values())


def _in_file(path: str) -> Iterator[tuple[str, str, Mapping[str, object]]]:
    """Yield the place, the name and the table of each course in a file."""
    tree = read_toml(Path(path))
    try:
        sets = take_format(tree, "courses")
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if not any(sets.values()):
        raise InputError(f"{path} holds no courses; write each under a line [SET.NAME].")
    for group, tables in sets.items():
        if not (isinstance(tables, dict) and all(isinstance(table, dict) for table in tables.values())):
            raise InputError(f"{path}: {group} holds no courses; write each under a line [{group}.NAME].")
        yield from ((f"{path}: [{group}.{name}]", name, table) for name, table in tables.items())


def _built_in(word: str) -> Iterator[tuple[str, str, Mapping[str, object]]]:
    """Yield the place, the name and the table of each course of a set in courses.toml, or of one course."""
    text = files("ballbot.workflows").joinpath("courses.toml").read_text(encoding="utf-8")
    sets = cast("dict[str, _Tables]", take_format(parse_toml(text, source="courses.toml"), "courses"))
    sets = {LEAGUE: {name: table for part in _IN_LEAGUE for name, table in sets[part].items()}} | sets
    known = {name: table for tables in sets.values() for name, table in tables.items()}
    if word not in sets and word not in known:
        hint = suggest(
            word, [*sets, *known], otherwise="the name of a course file ends in .toml; sets and courses are"
        )
        raise InputError(f"There is no set or course {word!r}; {hint}")
    named = sets[word] if word in sets else {word: known[word]}
    yield from ((f"the course {name!r}", name, table) for name, table in named.items())


def _course(
    name: str, table: Mapping[str, object], robot: Robot, plant: PlantName, *, place: str, beside: Path
) -> Course:
    try:
        given = validate_table(CourseTable, table, of="a course")
        spec = _reference_spec(given.reference, beside)
        spec.reference()  # refused before anything is run
        scenario = scenario_of(given.scenario, robot, default_name=name)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
    return Course(
        name=name,
        about=given.about,
        reference_spec=spec,
        duration=given.duration,
        settle=given.settle,
        mismatch=given.mismatch,
        scenario=scenario,
        on=plant,
    )


def _reference_spec(reference: str | Mapping[str, float | str], beside: Path) -> ReferenceSpec:
    options = {} if isinstance(reference, str) else dict(reference)
    name = reference if isinstance(reference, str) else options.pop("name", None)
    if not isinstance(name, str):
        raise InputError('reference is a table without a name; add name = "square" or another.')
    words = [key for key, value in options.items() if isinstance(value, str)]
    if words:
        raise InputError(f"reference.{words[0]} is {options[words[0]]!r}; it must be a number.")
    numbers = tuple((key, float(value)) for key, value in options.items())
    return ReferenceSpec(name=str(beside / name) if is_reference_file(name) else name, options=numbers)
