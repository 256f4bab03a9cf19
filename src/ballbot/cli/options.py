"""The options that several commands have, each declared once: `robot: options.Robot`."""

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, Token

from ballbot.errors import either
from ballbot.fitting.run import check_seed
from ballbot.log.formats import WRITTEN_SUFFIXES, written_format


def _whole_number(_: type, tokens: Sequence[Token]) -> int:
    """Return a whole number; raise ValueError for 1.5, which cyclopts would round."""
    given = tokens[0].value
    if not re.fullmatch(r"[+-]?\d+", given):
        raise ValueError(f"{given!r} is not a whole number.")
    return int(given)


Robot = Annotated[str, Parameter(help="A preset's name or a robot file.")]

Changes = Annotated[
    list[str] | None,
    Parameter(
        name="--set",
        negative="",
        help="Another value of the robot for this run, in SI units, such as --set body.mass=9.0 or --set "
        "friction.coulomb=[0.1,0.1,0.12]; one number stands for all wheels.",
    ),
]


def _check_positive(_: type, value: float | None) -> None:
    if value is not None and not 0.0 < value < math.inf:
        raise ValueError("It must be above 0.")


Positive = Annotated[float, Parameter(validator=_check_positive)]
Count = Annotated[int, Parameter(converter=_whole_number, validator=_check_positive)]

Reference = Annotated[
    str,
    Parameter(
        help="The reference motion: hold, square (at the start for 8 s), change_pose, circle, figure_eight, or a file "
        "with t, ref_x, ref_y and ref_psi, as ballbot excite writes it, or ballbot plan."
    ),
]

Scenario = Annotated[
    str,
    Parameter(
        help="Sensors, delay, play, noise and floor of the simulated robot: a scenario of the twin, or a scenario file."
    ),
]

Duration = Annotated[float, Parameter(help="Length of the run [s].")]

Mixed = Annotated[
    list[str] | None,
    Parameter(
        name="--with",
        negative="",
        help="Another controller, up to two, designed with the same options but for its weights. Its gain can be "
        "mixed with the first one's while the robot balances, if they share a Lyapunov function.",
    ),
]

LeanLimit = Annotated[
    float,
    Parameter(
        help="Largest tilt [rad] at which the robot gives torques; beyond it the robot is stopped. `ballbot limits` "
        "finds the largest tilt from which it recovers."
    ),
]

Out = Annotated[Path, Parameter(help="The folder to write into.")]
OptionalOut = Annotated[
    Path | None,
    Parameter(
        help="The folder for report.html, results.json and other files; without it nothing is written."
    ),
]
Force = Annotated[bool, Parameter(help="Replace an existing file.")]
Window = Annotated[float, Parameter(help="Length of the predicted windows [s].")]

Mapping = Annotated[
    Path | None,
    Parameter(
        help="A TOML file that describes the columns and units of foreign logs, as `ballbot check-log` writes it."
    ),
]

MocapMapping = Annotated[
    Path | None,
    Parameter(
        help="A TOML file that describes the columns and units of the motion capture, as --mapping does."
    ),
]

MotorsOf = Annotated[
    str | None,
    Parameter(
        help="A preset's name or a robot file, whose motors' resistance a mapping of duties or voltages needs."
    ),
]

WholeNumber = Annotated[int, Parameter(converter=_whole_number)]
SeedNumber = Annotated[int, Parameter(converter=_whole_number, validator=lambda _, seed: check_seed(seed))]
Seed = Annotated[SeedNumber, Parameter(help="Random seed. The same seed gives the same result.")]
Log = Annotated[Path, Parameter(required=True)]

LogFormat = Annotated[
    str,
    Parameter(
        validator=lambda _, word: written_format(f"log.{word}") and None,
        help=f"File format of the log and other time series: {either([name[1:] for name in WRITTEN_SUFFIXES])}.",
    ),
]

Accept = Annotated[
    list[str] | None,
    Parameter(
        name="--accept",
        negative="",
        help="Continue despite an error with this code, such as torque-sign. May be given more than once. "
        "The error names its code.",
    ),
]
