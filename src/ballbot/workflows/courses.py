"""Courses: the reference that a robot follows and the conditions of its runs, as values and as TOML files.

The built-in courses are in courses.toml beside this file, in sets; a user's own file has the same form.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Literal, cast

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, NonNegativeFloat, PositiveFloat

from ballbot.control.references import REFERENCES, Reference, is_reference_file, read_reference
from ballbot.errors import InputError, about, check_known
from ballbot.file_formats import take_format
from ballbot.files import parse_toml, read_toml
from ballbot.robot import Friction, Robot, RobotLike, as_robot
from ballbot.robot.components import scaled_body, scaled_friction
from ballbot.schema import validate_table
from ballbot.simulation.imperfections import Grip, Push
from ballbot.twin.imperfections import with_identified
from ballbot.twin.scenario import Scenario
from ballbot.twin.scenario_file import scenario_of
from ballbot.workflows.grid import LoopRobot, TwinRobot
from ballbot.workflows.metrics import BAND, METRIC_BY_KEY, SETTLE, Rules


@dataclass(frozen=True, kw_only=True)
class ReferenceSpec:
    """The name and options of a reference, so that it can be sent to other processes."""

    name: str  #: of `ballbot.control.references`, or a reference file
    options: tuple[tuple[str, float], ...] = ()  #: of the named one, such as ("ramp", 0.0)

    def reference(self) -> Reference:
        """Return the reference; raise InputError if the name or an option of it is unknown."""
        if is_reference_file(self.name):
            if self.options:
                raise InputError(
                    f"The reference file {self.name} takes no options; remove {self.options[0][0]}."
                )
            return read_reference(self.name)
        check_known(self.name, REFERENCES, f"There is no reference {self.name!r}", otherwise="the names are")
        make = REFERENCES[self.name]
        known = inspect.signature(make).parameters
        for key, _ in self.options:
            if key not in known:
                raise InputError(f"The reference {self.name} has no option {key}; it has {', '.join(known)}.")
        return make(**dict(self.options))


@dataclass(frozen=True, kw_only=True)
class ModelMismatch:
    """Factors from the robot as described, which the controllers know, to the one that runs."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)

    mass: PositiveFloat = 1.0  #: of the body
    height: PositiveFloat = 1.0  #: of its centre of mass above the ball's centre
    friction: NonNegativeFloat = 1.0  #: of the wheels' and the rolling friction


PlantName = Literal["model", "twin"]
#: directions of pushes that are bisected, one a seed
DIRECTIONS = 8


class LargestPush(BaseModel):
    """One push a run, its size by bisection; turned by 45 degrees from seed to seed."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    time: PositiveFloat  #: [s]
    duration: PositiveFloat  #: [s]
    height: NonNegativeFloat  #: above the ball's centre [m]

    def push(self, impulse: float, seed: int) -> Push:
        """Return the push of an impulse [N s]."""
        direction = 2.0 * math.pi * (seed % DIRECTIONS) / DIRECTIONS
        return Push.of_impulse(impulse, direction, time=self.time, duration=self.duration, height=self.height)


@dataclass(frozen=True, kw_only=True)
class Course:
    """A reference with the conditions and rules of its runs."""

    name: str
    about: str  #: in a sentence, for those who read the table
    reference_spec: ReferenceSpec
    duration: float  #: [s]
    rules: Rules
    metrics: tuple[str, ...] = ()  #: those that its table shows; the league's if there are none
    published: tuple[str, ...] = ()  #: published results on it, each with its source
    until_fall: bool = False  #: whether it gets harder until the robot falls, so that falls are not counted
    mismatch: ModelMismatch = ModelMismatch()
    largest_push: LargestPush | None = None
    scenario: Scenario
    on: PlantName

    def with_wheel_friction(self, friction: Friction) -> Course:
        """Return the course with that friction of the wheels on the twin, too; the floor's stays its own."""
        floor = self.scenario.friction
        friction = replace(friction, rolling=floor.rolling, pivoting=floor.pivoting)
        return replace(self, scenario=replace(self.scenario, friction=friction))

    def plant(self, robot: Robot, *pushes: Push) -> LoopRobot | TwinRobot:
        """Return the robot to run, by the model with the robot's friction, by the twin with the scenario's."""
        other, scenario = self.mismatch, self.scenario
        if pushes:
            scenario = replace(scenario, pushes=pushes)
        true = robot
        if other != ModelMismatch():
            body = scaled_body(robot.body, mass=other.mass, height=other.height)
            true = robot.replace(body=body, friction=scaled_friction(robot.friction, other.friction))
        if self.on == "model":
            loop = LoopRobot.of(true, with_identified(scenario, true.friction), known=robot)
            if self.largest_push is None:
                return loop
            grip = Grip(wheels=scenario.roller_grip, floor=scenario.floor_grip)  # it decides the largest push
            return replace(loop, imperfections=replace(loop.imperfections, grip=grip))
        friction = scaled_friction(scenario.friction, other.friction)
        return TwinRobot(robot=true, scenario=replace(scenario, friction=friction), known=robot)


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
    band: PositiveFloat = BAND
    stop: PositiveFloat | None = None
    metrics: list[str] = []
    published: list[str] = []
    until_fall: bool = False
    largest_push: LargestPush | None = None
    mismatch: ModelMismatch = ModelMismatch()
    scenario: dict[str, object] = {}


def choose_courses(words: str, robot: RobotLike, plant: PlantName) -> tuple[Course, ...]:
    """Return the courses that a text names: sets, courses and files, with commas; InputError if there is one not."""
    robot, by_name = as_robot(robot), dict[str, Course]()
    for word in (part.strip() for part in words.split(",")):
        is_file = Path(word).suffix == ".toml"
        for location, name, table in _in_file(word) if is_file else _built_in(word):
            beside = Path(word).parent if is_file else Path()
            course = _course(name, table, robot, plant, location=location, beside=beside)
            if by_name.setdefault(name, course) != course:
                raise InputError(f"There are two courses {name!r}; rename the one in {word}.")
    return tuple(by_name.values())


def _in_file(path: str) -> Iterator[tuple[str, str, Mapping[str, object]]]:
    """Yield the place, the name and the table of each course in a file."""
    tree = read_toml(Path(path))
    with about(path):
        sets = take_format(tree, "courses")
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
    otherwise = "the name of a course file ends in .toml; sets and courses are"
    check_known(word, [*sets, *known], f"There is no set or course {word!r}", otherwise=otherwise)
    named = sets[word] if word in sets else {word: known[word]}
    yield from ((f"the course {name!r}", name, table) for name, table in named.items())


def _course(
    name: str, table: Mapping[str, object], robot: Robot, plant: PlantName, *, location: str, beside: Path
) -> Course:
    with about(location):
        given = validate_table(CourseTable, table, of="a course")
        spec = _reference_spec(given.reference, beside)
        spec.reference()  # raises InputError before anything runs
        scenario = scenario_of(given.scenario, robot, default_name=name)
        for key in given.metrics:
            check_known(key, METRIC_BY_KEY, f"There is no metric {key!r}", otherwise="there are")
        largest = given.largest_push
        if largest and (scenario.pushes or scenario.changes()):
            raise InputError(
                "largest_push is the only disturbance of its course; remove the scenario's pushes, and times of a "
                "payload or a carpet."
            )
        if given.stop is not None and given.stop >= given.duration:
            raise InputError(
                f"stop is {given.stop:g} s, and the run ends at {given.duration:g} s; let it stop before."
            )
    pushed = [largest.time] if largest else [push.time for push in scenario.pushes]
    return Course(
        name=name,
        about=given.about,
        reference_spec=spec,
        duration=given.duration,
        rules=Rules(
            settle=given.settle,
            band=given.band,
            disturbed=tuple(sorted([*pushed, *scenario.changes()])),
            stop=given.stop,
        ),
        metrics=tuple(given.metrics),
        published=tuple(given.published),
        until_fall=given.until_fall,
        largest_push=largest,
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
