"""Friction laws by name: how the dry friction of a wheel depends on its speed and its load.

    tau(w) = b w + g(|w|, |u|) sgn(w)

The classical law is g = c + s exp(-|w/v_s|^delta), `ballbot.mechanics.friction`. Any other is registered: a function g
of speed and load whose further arguments are its parameters. Those named as fields of `Friction` (`SHARED`) are the
robot's own numbers of that name; every other one is described by a `LawParameter` and has its value in the table
[friction.own] of a robot file, beside `law = "NAME"` in [friction], or `law = "FILE.py:NAME"` if the file is to be run.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np

from ballbot.errors import InputError, suggest
from ballbot.robot.parameters import DIMENSIONLESS, Parameter
from ballbot.user_files import user_module

#: fields of `Friction` that a law may take
SHARED = ("coulomb", "stribeck", "stribeck_speed", "stribeck_exponent")
#: parameters that a law may have: compiled code has room for so many
MOST_PARAMETERS = 8
#: the name of the law of a robot that names none
CLASSICAL = "classical"


@dataclass(frozen=True, kw_only=True)
class LawParameter:
    """A parameter of a friction law that is no field of `Friction`.

    Parameters
    ----------
    name : str
        As the function's argument.
    symbol, meaning : str
        In results.
    unit : str
        SI.
    usual : (float, float)
        Bounds within which it is estimated. If the lower one is above zero the parameter must be, and its estimate is
        by ratios, as of a speed; if it is zero the parameter is not negative; else it may have either sign.
    default : float
        Of a robot that states none.
    each_wheel : bool
        Whether there is a number for each wheel, or one for all.
    proportional : bool, optional
        Whether it is one of those, with `coulomb` and `stribeck`, to which the friction is proportional together; by
        default if its unit begins with N m.

    Raises
    ------
    InputError
        If the name is no identifier, the bounds are not finite and in order, or the default is outside them.

    Examples
    --------
    >>> LawParameter(name="quadratic", symbol="b_2", meaning="torque for each (rad/s)^2", unit="N m s^2/rad^2",
    ...              usual=(0.0, 0.02), default=0.0).is_proportional
    True
    """

    name: str  #: as the function's argument
    symbol: str  #: in results
    meaning: str
    unit: str = DIMENSIONLESS  #: SI
    usual: tuple[float, float]
    default: float  #: of a robot that states none
    each_wheel: bool = True  #: a number for each wheel, or one for all
    #: whether it is one of those, with `coulomb` and `stribeck`, to which the friction is proportional together; by
    #: default if its unit begins with N m
    proportional: bool | None = None

    def __post_init__(self) -> None:
        low, high = self.usual
        if not (self.name.isidentifier() and math.isfinite(low) and low < high < math.inf):
            raise InputError(
                f"{self.name!r}: a parameter needs an identifier as its name and finite bounds in order."
            )
        if not low <= self.default <= high:
            raise InputError(
                f"The default of {self.name} is {self.default:g}; it must be from {low:g} to {high:g}."
            )

    @property
    def is_proportional(self) -> bool:
        """Whether the parameter doubles if the friction doubles."""
        return self.unit.startswith("N m") if self.proportional is None else self.proportional

    @property
    def stated(self) -> Parameter:
        """The line of a robot file."""
        low, _ = self.usual
        return Parameter(
            f"{self.symbol}, {self.meaning}",
            self.unit,
            least=-math.inf if low < 0.0 else 0.0,
            least_is_allowed=low <= 0.0,
            usual=self.usual,
            name=f"friction.own.{self.name}",
            field="friction.own",
            place=self.name,
            shape="list" if self.each_wheel else "number",
        )


@dataclass(frozen=True, kw_only=True)
class FrictionLaw:
    """A registered friction law."""

    name: str
    #: g(speed, load, ..) [N m] for speed and load of zero or more, on numbers and arrays
    size: Callable[..., Any]
    own: tuple[LawParameter, ...]
    takes: tuple[str, ...]  #: the names of its parameters, shared and own, as its function has them
    formula: str  #: for results, as "c + s/(1 + (w/v_s)^2)"
    file: Path | None  #: that a robot file names

    @property
    def text(self) -> str:
        """The law as a robot file names it."""
        return f"{self.file}:{self.name}" if self.file else self.name


#: the registered laws, by their names
REGISTERED: dict[str, FrictionLaw] = {}
#: parameters of all registered laws, by their dotted names
OWN_PARAMETERS: dict[str, Parameter] = {}


def register_friction_law(
    size: Callable[..., Any],
    *,
    parameters: Sequence[LawParameter] = (),
    name: str | None = None,
    formula: str = "",
) -> FrictionLaw:
    """Register a friction law, so that robots may name it; a second one of the same name replaces the first.

    Parameters
    ----------
    size : callable
        g(speed, load, ..) [N m], the size of a turning wheel's friction beside the viscous b w: of the speed's
        magnitude [rad/s], that of the motor's torque [N m] and the parameters, which are passed by name. At a speed of
        zero it is the break-away torque. It is called with floats, with arrays, and once with stand-ins for compiled
        code: so it uses arithmetic, `np.exp`, `np.log`, `np.sqrt`, `np.tanh`, `np.minimum`, `np.maximum`, `np.abs` and
        `np.where`, and no `if` on a number.
    parameters : sequence of LawParameter
        Those of its arguments that are not among `SHARED`.
    name : str, optional
        The function's own by default.
    formula : str
        For results.

    Returns
    -------
    FrictionLaw

    Raises
    ------
    InputError
        If the function's arguments do not agree with the parameters, or another law has a parameter of the same name
        and another meaning.

    Examples
    --------
    >>> import ballbot
    >>> def rational(speed, load, coulomb, stribeck, stribeck_speed, drag):
    ...     return coulomb + stribeck / (1.0 + (speed / stribeck_speed) ** 2) + drag * speed**2
    >>> drag = ballbot.LawParameter(
    ...     name="drag", symbol="b_2", meaning="torque for each (rad/s)^2", unit="N m s^2/rad^2",
    ...     usual=(0.0, 0.01), default=0.0,
    ... )
    >>> law = ballbot.register_friction_law(rational, parameters=[drag])
    >>> robot = ballbot.Robot.load("alten").replace({"friction.coulomb": 0.1, "friction.law": "rational"})
    >>> robot.replace({"friction.own.drag": 1e-3}).friction.law
    'rational'
    """
    name = name or size.__name__
    arguments = list(signature(size).parameters)
    own = {parameter.name: parameter for parameter in parameters}
    takes = tuple(arguments[2:])
    if not name.isidentifier() or name == CLASSICAL:
        raise InputError(
            f"A friction law cannot have the name {name!r}; it must be an identifier of its own."
        )
    complete = len(own) == len(parameters) and set(own) == set(takes) - set(SHARED)
    if arguments[:2] != ["speed", "load"] or len(takes) > MOST_PARAMETERS or not complete:
        raise InputError(
            f"The law {name} has the arguments {', '.join(arguments)} and describes the parameters "
            f"{', '.join(own) or 'none'}; they must be speed, load and at most {MOST_PARAMETERS} parameters, each "
            f"described or one of {', '.join(SHARED)}."
        )
    for other in REGISTERED.values():
        for parameter in other.own if other.name != name else ():
            if own.get(parameter.name, parameter) != parameter:
                raise InputError(
                    f"The law {other.name} has another parameter {parameter.name}; give it a name of its own."
                )
    described, file = tuple(own.values()), _LOADING.get("file")
    law = FrictionLaw(name=name, size=size, own=described, takes=takes, formula=formula or name, file=file)
    _check_proportional(law)
    REGISTERED[name] = law
    stated = [parameter.stated for law in REGISTERED.values() for parameter in law.own]
    OWN_PARAMETERS.clear()
    OWN_PARAMETERS.update({parameter.name: parameter for parameter in stated})
    return law


#: a number of each of `SHARED`, to try a law with
_TRIED = {"coulomb": 0.1, "stribeck": 0.05, "stribeck_speed": 0.6, "stribeck_exponent": 1.1}


def _check_proportional(law: FrictionLaw) -> None:
    """Raise InputError unless a law takes arrays and doubles with its proportional parameters, which scale it."""
    scaled = {parameter.name for parameter in law.own if parameter.is_proportional} | {"coulomb", "stribeck"}
    values = _TRIED | {parameter.name: 0.5 * sum(parameter.usual) for parameter in law.own}
    speed, load = np.array([0.0, 0.01, 0.5, 3.0, 20.0]), np.array([0.0, 0.1, 0.5, 1.0, 0.2])

    def size(factor: int) -> Any:
        given = {name: values[name] * (factor if name in scaled else 1) for name in law.takes}
        return law.size(speed, load, **given)

    try:
        once, twice = size(1), size(2)
    except Exception as error:  # of a function that is the user's
        raise InputError(
            f"The friction law {law.name} fails for arrays of speed and load ({error}); use NumPy's functions, and "
            "`np.where` in place of `if`."
        ) from error
    if not np.allclose(twice, 2.0 * np.asarray(once), rtol=1e-9, atol=0.0):
        together = ", ".join(parameter for parameter in law.takes if parameter in scaled)
        raise InputError(
            f"The friction law {law.name} is not proportional to {together} together; set `proportional` of its "
            "parameters."
        )


_LOADING: dict[str, Path] = {}


def friction_law(text: str, *, folder: Path = Path()) -> FrictionLaw | None:
    """Return the law that a robot names, or that FILE.py:NAME registers, in a folder; None for the classical one.

    InputError if there is no such law.
    """
    path, _, name = text.rpartition(":")
    file = (folder / path).resolve() if path.endswith(".py") else None
    if file and (name not in REGISTERED or REGISTERED[name].file != file):
        _LOADING["file"] = file
        try:
            user_module(file)
        finally:
            del _LOADING["file"]
        if name in REGISTERED and REGISTERED[name].file != file:
            raise InputError(
                f"{path} and another file or program register a friction law {name}; rename one of them."
            )
    if name in REGISTERED:
        return REGISTERED[name]
    if name == CLASSICAL and not path:
        return None
    hint = suggest(name, [CLASSICAL, *REGISTERED], otherwise="there are")
    raise InputError(
        f"There is no friction law {text!r}; {hint} Register it with ballbot.register_friction_law, or name the Python "
        "file that does, as FILE.py:NAME."
    )
