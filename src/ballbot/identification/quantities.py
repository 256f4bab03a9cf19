"""The table of quantities that identification can estimate: name, symbol, unit, scale and default bounds.

Those of a quantity that is a parameter of the robot stand beside its field in `ballbot.robot.components`.

A row of parameters begins with the friction, in the order [b_1 .. b_n, c_1 .. c_n, s_1 .. s_n, v_s, delta, C_rr]. Other
quantities follow in the table's order. A quantity that is not estimated has its nominal value. That is the robot's own
value, or the neutral value of an input or a sensor without fault: a gain of 1, and 0 for all others.

The bounds keep the robot physical. The body's second moments S_x, S_y, S_z about its centre of mass stand for its
inertia: J_xx = S_y + S_z, and so on in turn. Any positive second moments belong to some body, because S > 0 is the
triangle inequality of the inertia.

A user may set bounds in Python or in a TOML file:

    coulomb = [0.0, 0.5]             # c [N m], every wheel's
    delay = [0.012, 0.012]           # held at that value [s]

Keys left out keep the defaults of the table. Bounds hold for every number of a quantity, in its unit. Equal bounds hold
it at that value, so that a value known from elsewhere, as a delay, takes part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ballbot.arguments import names_listed
from ballbot.errors import InputError, suggest
from ballbot.files import read_toml
from ballbot.fitting.parameter import Limits, Parameter, ParameterSpace, Scale
from ballbot.robot import Body, Drive, Robot
from ballbot.robot.components import BY_NAME as ROBOT_PARAMETERS
from ballbot.robot.derived import thin_shell_inertia
from ballbot.robot.friction_law import OWN_PARAMETERS
from ballbot.robot.parameters import DIMENSIONLESS, Value, value_of

#: quantities of which the rigid body is made; what changes one of them makes another robot
RIGID = ("center_of_mass", "second_moment", "ball_inertia", "wheel_inertia", "rotor_inertia")


#: the least second moment as a share of their sum, so that their ratios mean something
_THINNEST = 1e-3


def second_moments(robot: Robot) -> Sequence[float]:
    """Return S_x, S_y, S_z [kg m^2], the integrals of x^2, y^2 and z^2 dm about the body's centre of mass.

    From J = (trace S) I - S, so that S = (trace J) / 2 I - J. A body that is flat counts as a little thick.
    """
    S = np.diag(_second_moment_matrix(robot))
    return np.maximum(S, _THINNEST * S.sum()).tolist()


def rotor_inertia(robot: Robot) -> Sequence[float]:
    """Return the inertia [kg m^2] of rotor and gear as felt at the wheel."""
    return (robot.drive.reflected_inertia,)


def with_rigid_body(robot: Robot, found: Mapping[str, NDArray[np.float64]]) -> Robot:
    """Return the robot with these quantities of `RIGID` in place of its own.

    Products of inertia keep their size in proportion: S_xy is scaled by sqrt(S_x S_y) new over old, which leaves a
    positive definite S positive definite. Of rotor and gear, both are scaled by one factor; where both are zero,
    the rotor has it all.
    """
    ball, wheels = robot.ball, robot.wheels
    if "ball_inertia" in found:
        ball = replace(ball, inertia=float(found["ball_inertia"][0]))
    if "wheel_inertia" in found:
        wheels = replace(wheels, inertia=float(found["wheel_inertia"][0]))
    return robot.replace(ball=ball, body=_body(robot, found), wheels=wheels, drive=_drive(robot, found))


def _body(robot: Robot, found: Mapping[str, NDArray[np.float64]]) -> Body:
    if not {"center_of_mass", "second_moment"} & found.keys():
        return robot.body
    S = _second_moment_matrix(robot)
    if "second_moment" in found:
        ratio = np.sqrt(found["second_moment"] / np.array(second_moments(robot)))
        S = S * np.outer(ratio, ratio)
        np.fill_diagonal(S, found["second_moment"])
    J = np.trace(S) * np.eye(3) - S
    height = float(found["center_of_mass"][0]) if "center_of_mass" in found else robot.body.center_of_mass
    if robot.body.inertia_about == "ball_center":
        J = J + robot.body.mass * height**2 * np.diag([1.0, 1.0, 0.0])
    six = (J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])
    xx, yy, zz, xy, xz, yz = (float(element) for element in six)
    return replace(robot.body, center_of_mass=height, inertia=(xx, yy, zz, xy, xz, yz))


def _drive(robot: Robot, found: Mapping[str, NDArray[np.float64]]) -> Drive:
    if "rotor_inertia" not in found:
        return robot.drive
    drive, wanted = robot.drive, float(found["rotor_inertia"][0])
    before = rotor_inertia(robot)[0]
    if before == 0.0:
        return replace(drive, motor_inertia=wanted / drive.gear_ratio**2)
    factor = wanted / before
    return replace(
        drive, motor_inertia=factor * drive.motor_inertia, gear_inertia=factor * drive.gear_inertia
    )


def _second_moment_matrix(robot: Robot) -> NDArray[np.float64]:
    J = robot.body.inertia_about_center_of_mass()
    return 0.5 * np.trace(J) * np.eye(3) - J


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One line of the table."""

    name: str  #: in options and files
    symbol: str  #: in results
    unit: str
    meaning: str
    #: what its numbers belong to: "" for one number, "wheels" for one a wheel, or letters, as "xyz"
    each: str = ""
    scale: Scale = "amount"
    #: default bounds of each of its numbers; in shares of `of(robot)`, where that is given
    bounds: Limits
    of: Callable[[Robot], Sequence[float]] | None = None
    #: the nominal values; zero if None
    nominal_of: Callable[[Robot], Sequence[float]] | None = None
    #: what else its estimate from balancing stands for; empty for one that is physical, None where nobody looked. By
    #: `campaigns.between_logs.effective`, on the twin with single faults on and off
    stands_for: str | None = None

    def labels(self, wheel_count: int) -> tuple[str, ...]:
        """Return the label of each of its numbers, as "b1" or "S_x"."""
        if self.each == "wheels":
            return tuple(f"{self.symbol}{i}" for i in range(1, wheel_count + 1))
        return tuple(f"{self.symbol}_{letter}" for letter in self.each) if self.each else (self.symbol,)

    def parameter(self, label: str, bounds: Limits, default: float) -> Parameter:
        """Return the one of its numbers with that label as a parameter of a fit."""
        return Parameter(
            name=self.name,
            symbol=label,
            unit=self.unit,
            scale=self.scale,
            bounds=bounds,
            default=default,
            meaning=self.meaning,
        )

    def nominal(self, robot: Robot) -> NDArray[np.float64]:
        """Return its numbers as the robot has them, or the neutral ones."""
        count = len(self.labels(robot.wheel_count))
        return np.zeros(count) if self.nominal_of is None else np.array(self.nominal_of(robot), dtype=float)

    def default_bounds(self, robot: Robot) -> NDArray[np.float64]:
        """Return the least and greatest value of each of its numbers (k, 2)."""
        unit = np.ones(len(self.labels(robot.wheel_count))) if self.of is None else np.array(self.of(robot))
        return unit[:, None] * np.array(self.bounds)


def _of_robot(
    place: str,
    *,
    name: str = "",
    bounds: Limits | None = None,
    of: Callable[[Robot], Sequence[float]] | None = None,
    stands_for: str | None = None,
) -> Quantity:
    """Return the quantity that is a parameter of the robot, with what is stated beside its field.

    Its bounds are the usual values, unless they are given, in shares of `of(robot)` or of the robot's own value.
    """
    stated = ROBOT_PARAMETERS[place]
    of_wheels = stated.shape == "list"

    def nominal(robot: Robot) -> Sequence[float]:
        own = value_of(robot, stated)
        return (own or (0.0,) * robot.wheel_count) if isinstance(own, tuple) else (own,)

    return Quantity(
        name=name or stated.key,
        symbol=stated.symbol,
        unit=stated.unit.removeprefix(DIMENSIONLESS),
        meaning=stated.meaning.partition(", ")[2],
        each="wheels" if of_wheels else "",
        scale="ratio" if not stated.least_is_allowed else "amount" if stated.least == 0.0 else "signed",
        bounds=bounds or stated.usual,
        of=of or (nominal if bounds else None),
        nominal_of=nominal,
        stands_for=stands_for,
    )


QUANTITIES: tuple[Quantity, ...] = (
    _of_robot(
        "friction.viscous", stands_for="losses of the rollers and their slip, which grow with the speed"
    ),
    _of_robot(
        "friction.coulomb",
        stands_for="dry friction less what slip of the rollers and play move to other parameters",
    ),
    *(
        _of_robot(f"friction.{name}", stands_for="play of the gears and the change from roller to roller")
        for name in ("stribeck", "stribeck_speed", "stribeck_exponent")
    ),
    _of_robot("friction.rolling", stands_for="losses of the rollers on the ball, and play of the gears"),
    _of_robot("friction.stribeck_asymmetry"),
    _of_robot("friction.load"),
    Quantity(
        name="pivoting",
        symbol="T_p",
        unit="N m",
        meaning="largest friction against the ball's pivoting on the floor",
        bounds=(0.0, 0.5),
    ),
    _of_robot("body.center_of_mass", bounds=(0.5, 2.0)),
    Quantity(
        name="second_moment",
        symbol="S",
        unit="kg m^2",
        meaning="integral of x^2 dm, y^2 dm and z^2 dm over the body about its centre of mass",
        each="xyz",
        scale="ratio",
        bounds=(0.25, 4.0),
        of=second_moments,
        nominal_of=second_moments,
    ),
    # between a solid ball's and a thin shell's
    _of_robot(
        "ball.inertia",
        name="ball_inertia",
        bounds=(0.6, 1.0),
        of=lambda robot: (thin_shell_inertia(mass=robot.ball.mass, radius=robot.ball.radius),),
    ),
    _of_robot("wheels.inertia", name="wheel_inertia", bounds=(0.0, 5.0)),
    Quantity(
        name="rotor_inertia",
        symbol="j_r",
        unit="kg m^2",
        meaning="of a motor's rotor and gear, as felt at the wheel",
        bounds=(0.0, 5.0),
        of=rotor_inertia,
        nominal_of=rotor_inertia,
    ),
    Quantity(
        name="torque_gain",
        symbol="gain",
        unit="",
        meaning="torque that acts for each N m logged, of each motor",
        each="wheels",
        scale="ratio",
        bounds=(0.5, 2.0),
        nominal_of=lambda robot: (1.0,) * robot.wheel_count,
    ),
    Quantity(
        name="torque_offset",
        symbol="offset",
        unit="N m",
        meaning="torque that acts when none is logged, of each motor",
        each="wheels",
        scale="signed",
        bounds=(-0.2, 0.2),
    ),
    Quantity(
        name="delay",
        symbol="delay",
        unit="s",
        meaning="from a torque's row in the log to its effect in the states' rows",
        scale="signed",
        bounds=(0.0, 0.03),
    ),
    Quantity(
        name="imu_delay",
        symbol="late_imu",
        unit="s",
        meaning="by which the body's angles and their rates are older than x and y in the same row",
        scale="signed",
        bounds=(-0.01, 0.03),
    ),
    Quantity(
        name="velocity_delay",
        symbol="late_v",
        unit="s",
        meaning="by which x_dot and y_dot are older than x and y in the same row, as differenced encoders are",
        scale="signed",
        bounds=(-0.01, 0.03),
    ),
    Quantity(
        name="lean_bias",
        symbol="lean",
        unit="rad",
        meaning="tilt of the IMU against the line from the ball's centre to the body's centre of mass",
        each="xy",
        scale="signed",
        bounds=(-0.1, 0.1),
    ),
    Quantity(
        name="gyro_bias",
        symbol="gyro",
        unit="rad/s",
        meaning="what the gyro reads at rest, about the body's axes; that about z turns the heading",
        each="xyz",
        scale="signed",
        bounds=(-0.1, 0.1),
    ),
)


class _ByName(Mapping[str, Quantity]):
    """The quantities by name: those of the table, then the own parameters of registered friction laws."""

    _table = MappingProxyType({quantity.name: quantity for quantity in QUANTITIES})

    def __getitem__(self, name: str) -> Quantity:
        return self._table[name] if name in self._table else _of_robot(f"{OWN}{name}")

    def __iter__(self) -> Iterator[str]:
        yield from self._table
        yield from (
            name.removeprefix(OWN) for name in OWN_PARAMETERS if name.removeprefix(OWN) not in self._table
        )

    def __len__(self) -> int:
        return len(tuple(iter(self)))


#: begins the dotted names of a friction law's own parameters
OWN = "friction.own."


BY_NAME = _ByName()
FRICTION = ("viscous", "coulomb", "stribeck", "stribeck_speed", "stribeck_exponent", "rolling")
#: further terms of the friction, beside the asymmetry that a torque offset stands for
TERMS = ("stribeck_asymmetry", "load")
#: of the wheels, in the same order: without the floor's
OF_WHEELS = tuple(name for name in FRICTION if name != "rolling")
#: names that stand for several
GROUPS = MappingProxyType(
    {
        "friction": FRICTION,
        "rigid_body": ("center_of_mass", "second_moment"),
        "torque": ("torque_gain", "torque_offset", "delay"),
        "delays": ("delay", "imu_delay", "velocity_delay"),
        "bias": ("lean_bias", "gyro_bias"),
    }
)


def names_in(free: Sequence[str] | str) -> tuple[str, ...]:
    """Return the quantities' names that these names and names of groups stand for, in the table's order.

    A string has commas between the names.

    Raises
    ------
    InputError
        If one is neither, or the list is empty.
    """
    if isinstance(free, str):
        free = names_listed(free)
    if not free:
        raise InputError(f"There is nothing to estimate. Name some of {', '.join([*GROUPS, *BY_NAME])}.")
    named: set[str] = set()
    for word in free:
        if word not in BY_NAME and word not in GROUPS:
            hint = suggest(word, [*GROUPS, *BY_NAME], otherwise="there are")
            raise InputError(f"{word!r} is not a quantity that can be identified; {hint}")
        named.update(GROUPS.get(word, (word,)))
    return tuple(name for name in BY_NAME if name in named)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Which quantities a row of parameters (p,) holds, and where."""

    wheel_count: int
    extra: tuple[str, ...] = ()  #: names after friction's, in the table's order

    @property
    def names(self) -> tuple[str, ...]:
        """All quantities, in order."""
        return (*FRICTION, *self.extra)

    @property
    def own(self) -> tuple[str, ...]:
        """Those that are a registered friction law's own."""
        return tuple(name for name in self.extra if f"{OWN}{name}" in OWN_PARAMETERS)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """The label of each number (p,)."""
        return tuple(label for name in self.names for label in BY_NAME[name].labels(self.wheel_count))

    @cached_property
    def _columns(self) -> dict[str, slice]:
        """The columns of each quantity in a row of parameters."""
        sizes = [len(BY_NAME[name].labels(self.wheel_count)) for name in self.names]
        ends = np.cumsum(sizes).tolist()
        places = zip(self.names, sizes, ends, strict=True)
        return {name: slice(end - size, end) for name, size, end in places}

    def columns(self, name: str) -> slice | None:
        """Return where a quantity stands in a row of parameters, None if it is not among them."""
        return self._columns.get(name)

    def part(self, name: str, values: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return a quantity's numbers (..., k) out of rows of parameters (..., p), None if it is not among them."""
        columns = self.columns(name)
        return None if columns is None else values[..., columns]

    def number(self, name: str, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a quantity of one number (...) out of rows of parameters (..., p) that have it."""
        return values[..., self._columns[name]][..., 0]

    def nominal(self, robot: Robot) -> NDArray[np.float64]:
        """Return the parameters (p,) before identification."""
        return np.concatenate([BY_NAME[name].nominal(robot) for name in self.names])

    def with_rigid_body(self, robot: Robot, values: NDArray[np.float64]) -> Robot:
        """Return the robot with the rigid body out of parameters (p,), as far as it is among them."""
        parts = {name: self.part(name, values) for name in RIGID}
        found = {name: part for name, part in parts.items() if part is not None}
        return with_rigid_body(robot, found) if found else robot

    def robot_of(self, robot: Robot, values: NDArray[np.float64], *, asymmetric: bool = False) -> Robot:
        """Return the robot with friction and rigid body out of parameters (p,).

        Terms of friction that are not among them become absent. A torque that acts where none is logged stands, if
        `asymmetric`, for Coulomb friction that is as much smaller forward as backward is larger: as far as it is no
        more than c, beyond which it is no friction. Likewise s by direction.
        """
        b, c, s, (v_s,), (delta,), (C_rr,) = (values[self._columns[name]].tolist() for name in FRICTION)
        offset = self.part("torque_offset", values) if asymmetric else None
        by_direction, load = (self.part(name, values) for name in TERMS)
        friction = replace(
            robot.friction,
            viscous=tuple(b),
            coulomb=tuple(c),
            stribeck=tuple(s),
            stribeck_speed=v_s,
            stribeck_exponent=delta,
            rolling=C_rr,
            coulomb_asymmetry=() if offset is None else _within(-offset, c),
            stribeck_asymmetry=() if by_direction is None else _within(by_direction, s),
            load=() if load is None else tuple(load.tolist()),
            own=tuple(
                (name, value if (part := self.part(name, values)) is None else _shaped_like(value, part))
                for name, value in robot.friction.own
            ),
        )
        return self.with_rigid_body(robot.replace(friction=friction), values)

    def without_friction(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return parameters (..., p) with all friction taken out of them; v_s and delta are then without effect."""
        return self._without((*FRICTION, *TERMS, *self.own), values)

    def viscous_part(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return parameters (..., p) with all friction taken out of them but the wheels' viscous one."""
        dry = (name for name in FRICTION if name != "viscous")
        return self._without((*dry, *TERMS, *self.own), values)

    def _without(self, names: Sequence[str], values: NDArray[np.float64]) -> NDArray[np.float64]:
        result = values.copy()
        for name in names:
            part = self.part(name, result)
            if part is not None:
                part[...] = 1.0 if BY_NAME[name].scale == "ratio" else 0.0
        return result

    def by_symbol(self, values: NDArray[np.float64]) -> dict[str, list[float] | float]:
        """Return parameters (p,) as {"b": [..], "c": [..], "s": [..], "v_s": .., "delta": .., "C_rr": .., ..}."""
        numbers = {BY_NAME[name]: values[columns].tolist() for name, columns in self._columns.items()}
        return {one.symbol: own if one.each else own[0] for one, own in numbers.items()}


def _shaped_like(value: Value, numbers: NDArray[np.float64]) -> Value:
    return tuple(numbers.tolist()) if isinstance(value, tuple) else float(numbers[0])


def _within(values: NDArray[np.float64], sizes: Sequence[float]) -> tuple[float, ...]:
    """Return values (n,) brought within plus and minus these sizes (n,)."""
    return tuple(np.clip(values, np.negative(sizes), sizes).tolist())


@dataclass(frozen=True)
class Bounds:
    """The least and the greatest value of quantities, by name; the others keep the default.

    InputError if a name is not a quantity, or a pair is not two finite numbers in rising order or reaches below what is
    physical.
    """

    limits: Mapping[str, Limits] = field(default_factory=dict[str, Limits])

    def __post_init__(self) -> None:
        for name, (lower, upper) in self.limits.items():
            if name not in BY_NAME:
                hint = suggest(name, BY_NAME, otherwise="the keys are")
                raise InputError(f"{name!r} is not a quantity that can be identified; {hint}")
            if not (math.isfinite(lower) and math.isfinite(upper) and lower <= upper):
                raise InputError(
                    f"The bounds of {name} are [{lower}, {upper}]; the lower one must come first."
                )
            scale = BY_NAME[name].scale
            if (lower < 0.0 and scale != "signed") or (lower <= 0.0 and scale == "ratio"):
                least = "above zero" if scale == "ratio" else "zero or more"
                raise InputError(f"The lower bound of {name} is {lower:g}; it must be {least}.")
        if self.limits.get("delay", (0.0, 0.0))[0] < 0.0:
            raise InputError(
                f"The lower bound of delay is {self.limits['delay'][0]:g}; it must be "
                "zero or more, because an effect cannot precede its cause."
            )


def read_bounds(path: str | Path) -> Bounds:
    """Read bounds from a TOML file; the module's text shows one.

    InputError if the file cannot be read, is no TOML, or has a key or a value that makes no bounds.
    """
    entries = read_toml(path)
    try:
        return Bounds({key: _limits_in_file(key, value) for key, value in entries.items()})
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


#: bounds, or the path of the TOML file that they are read from
BoundsLike = Bounds | str | Path


def as_bounds(source: BoundsLike | None) -> Bounds:
    """Return the bounds themselves, or those in that file; the default ones of every parameter if there are none."""
    if source is None:
        return Bounds()
    return source if isinstance(source, Bounds) else read_bounds(source)


def _limits_in_file(key: str, value: object) -> Limits:
    match value:
        case [int() | float() as lower, int() | float() as upper]:
            return float(lower), float(upper)
    raise InputError(f"{key} is {value!r}; write two numbers, as in {key} = [0.1, 0.5].")


@dataclass(frozen=True, kw_only=True, eq=False)
class Coordinates(ParameterSpace):
    """The parameters of a robot in the order of its layout, friction's 3 n + 3 first."""

    layout: Layout
    alike: tuple[str, ...] = ()  #: quantities of wheels that have one number for all of them

    @cached_property
    def first(self) -> NDArray[np.int64]:
        """The place of the number that each one (p,) equals: its own, or the first wheel's."""
        places = np.arange(len(self.parameters))
        for name in self.alike:
            columns = self.layout.columns(name)
            assert columns is not None, name
            places[columns] = columns.start
        return places

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Which parameters (p,) a fit moves; of numbers that are equal, the first."""
        return (self.upper > self.lower) & (self.first == np.arange(len(self.parameters)))

    def physical(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return parameters (..., p) in SI units from scaled ones (..., p)."""
        return super().physical(scaled[..., self.first])


def scale_between(
    robot: Robot, *, free: Sequence[str] = FRICTION, bounds: Bounds | None = None
) -> Coordinates:
    """Return the coordinates of a robot's parameters.

    `free` names the quantities to estimate, or groups of them. Quantities with bounds are estimated as well; the others
    are fixed. InputError if a name is not a quantity or a group, or a quantity has no default bounds for this robot.
    """
    bounds = bounds or Bounds()
    estimated = names_in(free)
    asked = {*estimated, *bounds.limits}
    extra = tuple(name for name in BY_NAME if name not in FRICTION and name in asked)
    layout = Layout(wheel_count=robot.wheel_count, extra=extra)
    parameters = []
    for name in layout.names:
        quantity = BY_NAME[name]
        limits = _limits(quantity, robot, estimated, bounds)
        values = zip(quantity.labels(robot.wheel_count), limits, quantity.nominal(robot), strict=True)
        parameters += [
            quantity.parameter(label, (float(low), float(high)), float(value))
            for label, (low, high), value in values
        ]
    return Coordinates(layout=layout, parameters=tuple(parameters))


def _limits(
    quantity: Quantity, robot: Robot, estimated: Sequence[str], bounds: Bounds
) -> NDArray[np.float64]:
    """Return the least and greatest value of each of a quantity's numbers (k, 2); equal where it is held."""
    given = bounds.limits.get(quantity.name)
    if given is not None:
        return np.tile(given, (len(quantity.labels(robot.wheel_count)), 1))
    if quantity.name not in estimated:
        return np.repeat(quantity.nominal(robot)[:, None], 2, axis=1)
    default = quantity.default_bounds(robot)
    if not np.all(default[:, 1] > default[:, 0]):
        raise InputError(
            f"{quantity.name} is zero in the robot's description, "
            "so the search has no scale for it; give it bounds."
        )
    return default
