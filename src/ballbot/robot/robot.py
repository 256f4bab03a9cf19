"""A robot: components whose values have been checked, with the presets that ship with Ballbot."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from ballbot.errors import InputError, check_known, nearest
from ballbot.files import nearest_file, write_text
from ballbot.robot.checks import check_correlation, check_deviations, check_robot
from ballbot.robot.components import (
    BY_NAME,
    PARAMETERS,
    Ball,
    Body,
    Correlation,
    Drive,
    Friction,
    RobotValues,
    Sensors,
    Wheels,
    deviation_labels,
    parameters_of_robot,
)
from ballbot.robot.file import read_robot, robot_text
from ballbot.robot.parameters import Value, build, to_si, value_of
from ballbot.summary import Plotted, Summary, listed

_PRESETS = Path(__file__).parent / "presets"
#: suffixes of robots as models of other tools: MJCF and URDF
MODEL_SUFFIXES = (".xml", ".mjcf", ".urdf")


@dataclass(frozen=True, kw_only=True, repr=False)
class Robot(Plotted, RobotValues):
    """A ball-balancing robot. Load one with `Robot.load`; change a copy with `replace`.

    `plot()` shows it from its right and from above, to scale.

    Parameters
    ----------
    name : str
    ball, body, wheels, drive, sensors : Ball, Body, Wheels, Drive, Sensors
        Its components, in SI units; `wheel_count` and `weight` follow from them.
    friction : Friction
        Of every wheel, and the rolling friction of the ball.
    gravity : float
        [m/s^2].
    sources : mapping of str to str
        Where a value came from, by dotted name, such as {"ball.mass": "measured: kitchen scale"}.
    standard_deviations, correlation, intervals, identified_from
        What is known of the errors of its values, and the logs they were identified from; `annotated` states them.

    Raises
    ------
    InputError
        If the values are not those of a robot (see `ballbot.robot.checks`).

    Examples
    --------
    >>> robot = Robot.load("alten")
    >>> robot.wheel_count, robot.ball.radius
    (3, 0.11)
    """

    def __post_init__(self) -> None:
        check_robot(self)
        check_deviations(self)
        check_correlation(self)

    def replace(
        self,
        values: Mapping[str, Value | str] | None = None,
        /,
        *,
        name: str | None = None,
        ball: Ball | None = None,
        body: Body | None = None,
        wheels: Wheels | None = None,
        drive: Drive | None = None,
        sensors: Sensors | None = None,
        friction: Friction | None = None,
        gravity: float | None = None,
    ) -> Robot:
        """Return a copy with other values by dotted name in SI units, or with other components; each may be left out.

        A value that stays keeps its source and its standard deviation. A value that changes loses both: a file then
        gives "assumed" as its source. `annotated` states them anew.

        Parameters
        ----------
        values : mapping of str to float or to a sequence of n floats, optional
            By dotted name, SI units; one number stands for all wheels. "friction.law" is the name of a law
            (`ballbot.register_friction_law`), whose own parameters have their defaults until they are given.
        name : str, optional
        ball, body, wheels, drive, sensors, friction : Ball, Body, Wheels, Drive, Sensors, Friction, optional
        gravity : float, optional
            [m/s^2].

        Returns
        -------
        Robot

        Raises
        ------
        InputError
            If a name is not a parameter's, or the copy would not be a robot (see `ballbot.robot.checks`).

        Examples
        --------
        >>> heavier = Robot.load("alten").replace({"body.mass": 20.0, "friction.coulomb": 0.1})
        >>> heavier.body.mass, heavier.friction.coulomb
        (20.0, (0.1, 0.1, 0.1))
        """
        numbers, before = dict(values or {}), self
        if "friction.law" in numbers:
            law = str(numbers.pop("friction.law"))
            before = dataclasses.replace(self, friction=self.friction.with_law(law, dict(self.friction.own)))
        changed = with_values(before, {name: _shaped(before, name, value) for name, value in numbers.items()})
        parts = {"ball": ball, "body": body, "wheels": wheels, "drive": drive, "sensors": sensors}
        parts |= {"name": name, "friction": friction, "gravity": gravity}
        given = {key: part for key, part in parts.items() if part is not None}
        copy = dataclasses.replace(changed, **given) if given else changed
        stays = {key for key, item in BY_NAME.items() if value_of(copy, item) == value_of(self, item)}
        deviations = self.standard_deviations.items()
        return copy.annotated(
            sources={key: source for key, source in self.sources.items() if key in stays},
            standard_deviations={key: deviation for key, deviation in deviations if key in stays},
            correlation=self.correlation,
            intervals=self.intervals,
            identified_from=self.identified_from,
        )

    def annotated(
        self,
        *,
        sources: Mapping[str, str] | None = None,
        standard_deviations: Mapping[str, Value] | None = None,
        correlation: Correlation | None = None,
        intervals: Mapping[str, tuple[float, float]] | None = None,
        identified_from: Collection[str] | None = None,
    ) -> Robot:
        """Return a copy with other sources or standard deviations; what is not given stays.

        Parameters
        ----------
        sources : mapping of str to str, optional
            By dotted name.
        standard_deviations : mapping of str to float or to a sequence of n floats, optional
            By dotted name, in SI units; infinite where a value is only known to lie in an interval.
        correlation : Correlation, optional
            Kept among numbers with a finite standard deviation.
        intervals : mapping of str to (float, float), optional
            95 %; kept for those that have an infinite standard deviation.
        identified_from : collection of str, optional
            What identifies the logs that were used.

        Returns
        -------
        Robot

        Raises
        ------
        InputError
            If a name is not a parameter's, or a source or a standard deviation is invalid.

        Examples
        --------
        >>> robot = Robot.load("alten")
        >>> weighed = robot.annotated(sources={**robot.sources, "ball.mass": "measured: kitchen scale"})
        >>> weighed.sources["ball.mass"]
        'measured: kitchen scale'
        """
        deviations = self.standard_deviations if standard_deviations is None else standard_deviations
        sizes = {label: size for label, *_, size in deviation_labels(deviations)}
        known = {label for label, size in sizes.items() if math.isfinite(size)}
        limits = self.intervals if intervals is None else intervals
        return dataclasses.replace(
            self,
            sources=self.sources if sources is None else sources,
            standard_deviations=deviations,
            correlation=(self.correlation if correlation is None else correlation).among(known),
            intervals={
                label: interval for label, interval in limits.items() if label in sizes and label not in known
            },
            identified_from=self.identified_from if identified_from is None else tuple(identified_from),
        )

    @staticmethod
    def load(source: str | Path) -> Robot:
        """Return the preset of that name, or the robot in that TOML file.

        Parameters
        ----------
        source : str or Path
            `Robot.presets` lists the presets.

        Returns
        -------
        Robot

        Raises
        ------
        InputError
            If there is neither, or the file does not describe a robot.

        Examples
        --------
        >>> Robot.load("alten").wheel_count
        3
        >>> Robot.load("altn")
        Traceback (most recent call last):
        ballbot.errors.InputError: There is no robot file or preset 'altn'; did you mean the preset 'alten'?
        """
        presets = Robot.presets()
        if source in presets:
            return _preset(str(source))
        if not isinstance(source, str | Path):
            raise InputError(
                f"A robot is given as an object of type {type(source).__name__}; give a Robot, a preset's name or the "
                "path of a robot file."
            )
        if not Path(source).exists():
            near, file = nearest(str(source), presets), nearest_file(source)
            hint = f"did you mean the file {file}?" if file else f"the presets are {', '.join(presets)}."
            hint = f"did you mean the preset {near[0]!r}?" if near else hint
            raise InputError(f"There is no robot file or preset {str(source)!r}; {hint}")
        if is_model_file(source):
            raise InputError(
                f"{source} is a model in MJCF or URDF; make it a robot file with: ballbot new NAME --from {source}"
            )
        return read_robot(source, Robot)

    def write(self, path: str | Path) -> None:
        """Write the robot as a commented TOML file that reads back as the same floats.

        Parameters
        ----------
        path : str or Path
            A parameter without an entry in `sources` is written as "assumed".

        Raises
        ------
        InputError
            If the file cannot be written.

        Examples
        --------
        >>> import tempfile
        >>> folder = tempfile.TemporaryDirectory()
        >>> path = Path(folder.name) / "heavy.toml"
        >>> heavy = Robot.load("alten").replace({"body.mass": 20.0}, name="heavy")
        >>> heavy.write(path)
        >>> Robot.load(path).body.mass
        20.0
        """
        write_text(path, robot_text(self))

    @staticmethod
    def presets() -> list[str]:
        """Return the names of the robots that ship with Ballbot.

        Returns
        -------
        list of str

        Examples
        --------
        >>> Robot.presets()
        ['alten', 'cmu', 'kugle', 'rezero', 'rob311']
        """
        return sorted(path.stem for path in _PRESETS.glob("*.toml"))

    def summary(self) -> Summary:
        """Return the robot's main parameters, and where they came from."""
        kinds = Counter(source.partition(":")[0] for source in self.sources.values())
        tables = dict.fromkeys(parameter.table for parameter in parameters_of_robot(self))
        sources = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
        stated = f"of {len(self.standard_deviations)} parameters" if self.standard_deviations else "none"
        return Summary(
            title=f"Robot {self.name}: {self.wheel_count} wheels",
            rows=(
                *((table or "robot", _stated(self, table)) for table in tables),
                ("sources", sources or "none"),
                ("standard deviations", stated),
            ),
        )


def _stated(robot: Robot, table: str) -> str:
    """Return the values in a table of a robot file, in the file's units: radius 0.11 m, mass 3 kg."""
    if table == "friction" and robot.friction == Friction.none(robot.wheel_count):
        return "none"
    said = []
    for parameter in parameters_of_robot(robot):
        if parameter.table == table and (value := value_of(robot, parameter)) != ():
            values = np.atleast_1d(value) / to_si(1.0, parameter.written_in, parameter.unit)
            said.append(f"{parameter.key} {listed(values, parameter.written_in.removesuffix('1'), digits=4)}")
    if table == "body.inertia":
        centre = "ball's centre" if robot.body.inertia_about == "ball_center" else "centre of mass"
        said.append(f"about the {centre}")
    if table == "friction.own":
        said.append(f"law {robot.friction.law}")
    return ", ".join(said)


#: a robot, the name of a preset, or the path of a robot file
RobotLike = Robot | str | Path


def as_robot(source: RobotLike) -> Robot:
    """Return the robot itself, the preset of that name, or the robot in that file.

    InputError if it is none of these.

    >>> as_robot("alten") == as_robot(Robot.load("alten"))
    True
    """
    return source if isinstance(source, Robot) else Robot.load(source)


def is_model_file(path: str | Path) -> bool:
    """Return whether a file's name has the suffix of a model of another tool; `ballbot.twin.model_files` reads it."""
    return Path(path).suffix.lower() in MODEL_SUFFIXES


@cache
def _preset(name: str) -> Robot:
    return read_robot(_PRESETS / f"{name}.toml", Robot)


def _shaped(robot: Robot, name: str, value: Value | str) -> Value:
    """Return a value of a parameter as a robot holds it: one number for all wheels stands for each of them."""
    check_known(name, BY_NAME, f"{name!r} is not a parameter of a robot", otherwise="there are")
    own = value_of(robot, BY_NAME[name])
    if name.startswith("friction.own.") and own == ():
        raise InputError(
            f"The friction law of {robot.name} ({robot.friction.law}) has no parameter {name!r}."
        )
    if not isinstance(own, tuple):
        return value  # pyright: ignore[reportReturnType] (a text is refused as no number)
    return tuple(value) if np.ndim(value) else (float(value),) * len(own)  # pyright: ignore[reportArgumentType]


def with_values(robot: Robot, changes: Mapping[str, Value]) -> Robot:
    """Return the robot with other values of some parameters, by dotted name; without its standard deviations.

    InputError if that is not a robot.
    """
    values = {parameter.name: value_of(robot, parameter) for parameter in PARAMETERS} | dict(changes)
    own = {name: values.pop(f"friction.own.{name}", value) for name, value in robot.friction.own}
    texts = {"name": robot.name, "body.inertia_about": robot.body.inertia_about, "sources": robot.sources}
    law = {"friction.law": robot.friction.law, "friction.own": tuple(own.items())}
    return build(Robot, {**values, **texts, **law})
