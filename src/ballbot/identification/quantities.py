"""The table of quantities that identification can estimate: name, symbol, unit, scale and default bounds.

Those of the robot's own parameters are stated beside the fields in `ballbot.robot.components`. A row of parameters
begins with friction, [b_1 .. b_n, c_1 .. c_n, s_1 .. s_n, v_s, delta, C_rr]; others follow in the order of the table.
A quantity that is not estimated has the robot's own value, or the neutral one of an input or a sensor without fault,
which is 1 for a gain and 0 for all others.

The body's second moments S_x, S_y, S_z about its centre of mass stand for its inertia: J_xx = S_y + S_z, and so on in
turn. Any positive second moments belong to some body, because S > 0 is the triangle inequality of the inertia.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np

from ballbot.arguments import names_listed
from ballbot.arrays import Floats
from ballbot.errors import InputError, about, check_known
from ballbot.files import read_toml
from ballbot.fitting.parameter import FitParameter, Limits, ParameterSpace, Scale
from ballbot.mechanics.geometry import wheel_load
from ballbot.robot import Robot
from ballbot.robot.components import BY_NAME as ROBOT_PARAMETERS
from ballbot.robot.derived import thin_shell_inertia
from ballbot.robot.friction_law import OWN_PARAMETERS
from ballbot.robot.parameters import DIMENSIONLESS, Value, value_of

#: quantities of the rigid body
RIGID = ("center_of_mass", "second_moment", "ball_inertia", "wheel_inertia", "rotor_inertia")
#: least second moment as a share of their sum, so that their ratios are defined
_THINNEST = 1e-3
#: wheel load times radius [N m] up to which the usual friction of a wheel is that of `robot.components`; beyond,
#: it grows in proportion, as friction of gears and rollers does with the load that they carry
_USUAL_LOAD = 5.0


def second_moments(robot: Robot) -> Sequence[float]:
    """Return S_x, S_y, S_z [kg m^2], the integrals of x^2, y^2 and z^2 dm about the body's centre of mass.

    From J = (trace S) I - S, so that S = (trace J) / 2 I - J. A flat body counts as slightly thick.
    """
    S = np.diag(_second_moment_matrix(robot))
    return np.maximum(S, _THINNEST * S.sum()).tolist()


def with_rigid_body(robot: Robot, quantities: Mapping[str, Floats]) -> Robot:
    """Return the robot with these quantities of `RIGID`.

    Products of inertia scale in proportion, S_xy by the ratio of new to old sqrt(S_x S_y), which keeps a positive
    definite S positive definite. Rotor and gear are scaled by one factor; if both are zero, the rotor has it all.
    """
    ball, body, wheels, drive = robot.ball, robot.body, robot.wheels, robot.drive
    if "ball_inertia" in quantities:
        ball = replace(ball, inertia=float(quantities["ball_inertia"][0]))
    if "wheel_inertia" in quantities:
        wheels = replace(wheels, inertia=float(quantities["wheel_inertia"][0]))
    if "rotor_inertia" in quantities:
        wanted, before = float(quantities["rotor_inertia"][0]), drive.reflected_inertia
        factor = wanted / before if before else 1.0
        motor = factor * drive.motor_inertia if before else wanted / drive.gear_ratio**2
        drive = replace(drive, motor_inertia=motor, gear_inertia=factor * drive.gear_inertia)
    if {"center_of_mass", "second_moment"} & quantities.keys():
        S = _second_moment_matrix(robot)
        height = float(quantities.get("center_of_mass", [body.center_of_mass])[0])
        if "second_moment" in quantities:
            ratio = np.sqrt(quantities["second_moment"] / np.array(second_moments(robot)))
            S = S * np.outer(ratio, ratio)
            np.fill_diagonal(S, quantities["second_moment"])
        J = np.trace(S) * np.eye(3) - S
        if body.inertia_about == "ball_center":
            J = J + body.mass * height**2 * np.diag([1.0, 1.0, 0.0])
        xx, yy, zz, xy, xz, yz = J[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].tolist()
        body = replace(body, center_of_mass=height, inertia=(xx, yy, zz, xy, xz, yz))
    return robot.replace(ball=ball, body=body, wheels=wheels, drive=drive)


def _second_moment_matrix(robot: Robot) -> Floats:
    J = robot.body.inertia_about_center_of_mass()
    return 0.5 * np.trace(J) * np.eye(3) - J


@dataclass(frozen=True)
class Quantity:
    """One row of the table."""

    name: str  #: in options and files
    symbol: str  #: in results
    unit: str
    bounds: Limits  #: of each number, as shares of `share_of(robot)` if that is given
    each: str = ""  #: one a number, "wheels", or letters, as "xyz"
    scale: Scale = "signed"
    _: KW_ONLY
    #: the robot's own values; None for an input or a sensor, whose nominal values are neutral
    own: Callable[[Robot], Sequence[float]] | None = None
    share_of: Callable[[Robot], Sequence[float]] | None = None
    stands_for: str | None = None  #: other effects in its estimate from balancing; None if not measured
    lines: tuple[str, ...] = ()  #: keys in a robot file

    def labels(self, wheel_count: int) -> tuple[str, ...]:
        """Return the label of each of its numbers, as "b1" or "S_x"."""
        if self.each == "wheels":
            return tuple(f"{self.symbol}{i}" for i in range(1, wheel_count + 1))
        return tuple(f"{self.symbol}_{letter}" for letter in self.each) if self.each else (self.symbol,)

    @property
    def neutral(self) -> float:
        """The value without effect."""
        return 1.0 if self.scale == "ratio" else 0.0

    def nominal(self, robot: Robot) -> Floats:
        """Return the robot's own values, or the neutral ones."""
        count = len(self.labels(robot.wheel_count))
        return np.full(count, self.neutral) if self.own is None else np.array(self.own(robot), dtype=float)

    def limits(self, robot: Robot) -> Floats:
        """Return the default bounds of its numbers (k, 2); InputError if a lower and an upper one are equal."""
        count = len(self.labels(robot.wheel_count))
        unit = np.ones(count) if self.share_of is None else np.array(self.share_of(robot))
        limits = unit[:, None] * np.array(self.bounds)
        if not np.all(limits[:, 1] > limits[:, 0]):
            raise InputError(
                f"{self.name} is zero in the robot's description, which gives no default bounds; give it bounds."
            )
        return limits


def _of_robot(
    key: str,
    stands_for: str | None = None,
    *,
    name: str = "",
    bounds: Limits | None = None,
    share_of: Callable[[Robot], Sequence[float]] | None = None,
) -> Quantity:
    """Return the quantity of a robot's parameter; its bounds may be shares of `share_of(robot)` or of the own value."""
    stated = ROBOT_PARAMETERS[key]

    def own(robot: Robot) -> Sequence[float]:
        value = value_of(robot, stated)
        return (value or (0.0,) * robot.wheel_count) if isinstance(value, tuple) else (value,)

    return Quantity(
        name or stated.key,
        stated.symbol,
        stated.unit.removeprefix(DIMENSIONLESS),
        bounds or stated.usual,
        "wheels" if stated.shape == "list" else "",
        "ratio" if not stated.least_is_allowed else "amount" if stated.least == 0.0 else "signed",
        own=own,
        share_of=share_of or (own if bounds else None),
        stands_for=stands_for,
        lines=(key,),
    )


def _heavier(robot: Robot) -> Sequence[float]:
    return (max(1.0, wheel_load(robot) * robot.wheels.radius / _USUAL_LOAD),) * robot.wheel_count


_PLAY = "play of the gears and the change from roller to roller"
QUANTITIES: tuple[Quantity, ...] = (
    _of_robot(
        "friction.viscous",
        "losses of the rollers and their slip, which grow with the speed",
        share_of=_heavier,
    ),
    _of_robot(
        "friction.coulomb",
        "dry friction less what slip of the rollers and play move to other parameters",
        share_of=_heavier,
    ),
    _of_robot("friction.stribeck", _PLAY, share_of=_heavier),
    *(_of_robot(f"friction.stribeck_{of}", _PLAY) for of in ("speed", "exponent")),
    _of_robot("friction.rolling", "losses of the rollers on the ball, and play of the gears"),
    _of_robot("friction.stribeck_asymmetry"),
    _of_robot("friction.load"),
    Quantity(
        "pivoting",
        "T_p",
        "N m",
        ROBOT_PARAMETERS["friction.pivoting"].usual,
        "",
        "amount",
        own=lambda robot: (robot.pivoting_torque or 0.0,),
        share_of=lambda robot: (robot.weight,),
        lines=("friction.pivoting",),
    ),
    _of_robot("body.center_of_mass", bounds=(0.5, 2.0)),
    Quantity(
        "second_moment",
        "S",
        "kg m^2",
        (0.25, 4.0),
        "xyz",
        "ratio",
        own=second_moments,
        share_of=second_moments,
        lines=tuple(f"body.inertia.{axes}" for axes in ("xx", "yy", "zz", "xy", "xz", "yz")),
    ),
    # between a solid ball's and a thin shell's
    _of_robot(
        "ball.inertia",
        name="ball_inertia",
        bounds=(0.6, 1.0),
        share_of=lambda robot: (thin_shell_inertia(mass=robot.ball.mass, radius=robot.ball.radius),),
    ),
    _of_robot("wheels.inertia", name="wheel_inertia", bounds=(0.0, 5.0)),
    Quantity(
        "rotor_inertia",
        "j_r",
        "kg m^2",
        (0.0, 5.0),
        "",
        "amount",
        own=lambda robot: (robot.drive.reflected_inertia,),
        share_of=lambda robot: (robot.drive.reflected_inertia,),
        lines=("drive.motor_inertia", "drive.gear_inertia"),
    ),
    # a motor's torque for each N m logged, and when none is logged
    Quantity("torque_gain", "gain", "", (0.5, 2.0), "wheels", "ratio"),
    Quantity("torque_offset", "offset", "N m", (-0.2, 0.2), "wheels"),
    # from a torque's row in the log to its effect in the states
    Quantity("delay", "delay", "s", (0.0, 0.03)),
    # by which the body's angles and rates, and velocities from differenced encoder counts, are older than x and y
    Quantity("imu_delay", "late_imu", "s", (-0.01, 0.03)),
    Quantity("velocity_delay", "late_v", "s", (-0.01, 0.03)),
    # tilt of the IMU against the line from ball to centre of mass
    Quantity("lean_bias", "lean", "rad", (-0.1, 0.1), "xy"),
    # what the gyro reads at rest, about the body's axes; the one about z turns the heading
    Quantity("gyro_bias", "gyro", "rad/s", (-0.1, 0.1), "xyz"),
)
#: prefix of the dotted names of a friction law's own parameters
OWN = "friction.own."


class _ByName(Mapping[str, Quantity]):
    """The quantities by name: those of the table, then the own parameters of registered friction laws."""

    _table: ClassVar = {quantity.name: quantity for quantity in QUANTITIES}

    def __getitem__(self, name: str) -> Quantity:
        return self._table[name] if name in self._table else _of_robot(f"{OWN}{name}")

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys([*self._table, *(name.removeprefix(OWN) for name in OWN_PARAMETERS)]))

    def __len__(self) -> int:
        return len(tuple(iter(self)))


BY_NAME = _ByName()
FRICTION = ("viscous", "coulomb", "stribeck", "stribeck_speed", "stribeck_exponent", "rolling")
#: further terms of the friction; a torque offset stands for the asymmetry of c
TERMS = ("stribeck_asymmetry", "load")
#: names of groups of quantities
GROUPS: Mapping[str, tuple[str, ...]] = {
    "friction": FRICTION,
    "rigid_body": ("center_of_mass", "second_moment"),
    "torque": ("torque_gain", "torque_offset", "delay"),
    "delays": ("delay", "imu_delay", "velocity_delay"),
    "bias": ("lean_bias", "gyro_bias"),
}


def names_in(free: Sequence[str] | str) -> tuple[str, ...]:
    """Return the quantities in a list of names and groups, in the table's order; InputError if one is neither."""
    words = names_listed(free) if isinstance(free, str) else free
    if not words:
        raise InputError(f"There is nothing to estimate. Name some of {', '.join([*GROUPS, *BY_NAME])}.")
    named: set[str] = set()
    for word in words:
        sentence = f"{word!r} is not a quantity that can be identified"
        check_known(word, [*GROUPS, *BY_NAME], sentence, otherwise="there are")
        named.update(GROUPS.get(word, (word,)))
    return tuple(name for name in BY_NAME if name in named)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """The quantities in a row of parameters (p,), and their columns."""

    wheel_count: int
    extra: tuple[str, ...] = ()  #: quantities after the friction, in the order of the table

    @property
    def names(self) -> tuple[str, ...]:
        """All quantities, in order."""
        return (*FRICTION, *self.extra)

    @property
    def own(self) -> tuple[str, ...]:
        """The own parameters of a registered friction law."""
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
        columns = zip(self.names, sizes, ends, strict=True)
        return {name: slice(end - size, end) for name, size, end in columns}

    def columns(self, name: str) -> slice | None:
        """Return the columns of a quantity in a row of parameters, None if it is not among them."""
        return self._columns.get(name)

    def part(self, name: str, values: Floats) -> Floats | None:
        """Return a quantity's numbers (..., k) from rows of parameters (..., p), None if it is not among them."""
        columns = self.columns(name)
        return None if columns is None else values[..., columns]

    def number(self, name: str, values: Floats) -> Floats:
        """Return a quantity of one number (...) from rows of parameters (..., p)."""
        return values[..., self._columns[name]][..., 0]

    def nominal(self, robot: Robot) -> Floats:
        """Return the parameters (p,) before identification."""
        return np.concatenate([BY_NAME[name].nominal(robot) for name in self.names])

    def with_rigid_body(self, robot: Robot, values: Floats) -> Robot:
        """Return the robot with the rigid body from parameters (p,), as far as it is among them."""
        quantities = {name: part for name in RIGID if (part := self.part(name, values)) is not None}
        return with_rigid_body(robot, quantities) if quantities else robot

    def robot_of(self, robot: Robot, values: Floats, *, asymmetric: bool = False) -> Robot:
        """Return the robot with friction and rigid body from parameters (p,).

        Terms of friction that are not among them are removed. If `asymmetric`, the torque offset is a difference of
        Coulomb friction between the directions, clipped to c, beyond which it is no friction; likewise that of s.
        """
        b, c, s, (v_s,), (delta,), (C_rr,) = (values[self._columns[name]].tolist() for name in FRICTION)
        offset = self.part("torque_offset", values) if asymmetric else None
        by_direction, load = (self.part(name, values) for name in TERMS)
        pivoting = self.part("pivoting", values)
        friction = replace(
            robot.friction,
            viscous=tuple(b),
            coulomb=tuple(c),
            stribeck=tuple(s),
            stribeck_speed=v_s,
            stribeck_exponent=delta,
            rolling=C_rr,
            # an arm [m]: a micrometre for none, for zero means unknown
            pivoting=robot.friction.pivoting
            if pivoting is None
            else max(float(pivoting[0]) / robot.weight, 1e-6),
            coulomb_asymmetry=() if offset is None else _within(-offset, c),
            stribeck_asymmetry=() if by_direction is None else _within(by_direction, s),
            load=() if load is None else tuple(load.tolist()),
            own=tuple(
                (name, value if (part := self.part(name, values)) is None else _shaped_like(value, part))
                for name, value in robot.friction.own
            ),
        )
        return self.with_rigid_body(robot.replace(friction=friction), values)

    def without_friction(self, values: Floats, *, keep: Sequence[str] = ()) -> Floats:
        """Return parameters (..., p) without friction, except the quantities to `keep`."""
        result = values.copy()
        for name in (*FRICTION, *TERMS, *self.own):
            part = self.part(name, result)
            if part is not None and name not in keep:
                part[...] = BY_NAME[name].neutral
        return result

    def by_symbol(self, values: Floats) -> dict[str, list[float] | float]:
        """Return parameters (p,) as {"b": [..], "c": [..], "s": [..], "v_s": .., "delta": .., "C_rr": .., ..}."""
        table: dict[str, list[float] | float] = {}
        for name, columns in self._columns.items():
            numbers = values[columns].tolist()
            table[BY_NAME[name].symbol] = numbers if BY_NAME[name].each else numbers[0]
        return table


def _shaped_like(value: Value, numbers: Floats) -> Value:
    return tuple(numbers.tolist()) if isinstance(value, tuple) else float(numbers[0])


def _within(values: Floats, sizes: Sequence[float]) -> tuple[float, ...]:
    """Return values (n,) clipped to plus and minus these sizes (n,)."""
    return tuple(np.clip(values, np.negative(sizes), sizes).tolist())


@dataclass(frozen=True)
class Bounds:
    """Lower and upper bounds of quantities, by name; the others keep the defaults.

    InputError if a name is not a quantity, or its bounds are not finite, not in order or below what is physical.

    >>> Bounds({"coulomb": (0.0, 0.5), "delay": (0.012, 0.012)}).limits["delay"]  # held at 12 ms
    (0.012, 0.012)
    """

    limits: Mapping[str, Limits] = field(default_factory=dict[str, Limits])

    def __post_init__(self) -> None:
        for name, (lower, upper) in self.limits.items():
            sentence = f"{name!r} is not a quantity that can be identified"
            check_known(name, BY_NAME, sentence, otherwise="the keys are")
            if not (math.isfinite(lower) and math.isfinite(upper) and lower <= upper):
                raise InputError(
                    f"The bounds of {name} are [{lower}, {upper}]; the lower one must come first."
                )
            scale = BY_NAME[name].scale
            if (lower < 0.0 and scale != "signed") or (lower <= 0.0 and scale == "ratio"):
                least = "above zero" if scale == "ratio" else "zero or more"
                raise InputError(f"The lower bound of {name} is {lower:g}; it must be {least}.")
            if name == "delay" and lower < 0.0:
                raise InputError(
                    f"The lower bound of delay is {lower:g}; it must be "
                    "zero or more, because an effect cannot precede its cause."
                )


def read_bounds(path: str | Path) -> Bounds:
    """Read bounds from a TOML file with lines such as `coulomb = [0.0, 0.5]`, in the unit of the quantity.

    InputError if the file cannot be read, is not TOML, or has an invalid key or value.

    >>> from pathlib import Path
    >>> _ = Path("bounds.toml").write_text("coulomb = [0.0, 0.5]")
    >>> read_bounds("bounds.toml").limits
    {'coulomb': (0.0, 0.5)}
    """
    limits: dict[str, Limits] = {}
    for key, value in read_toml(path).items():
        match value:
            case [int() | float() as lower, int() | float() as upper]:
                limits[key] = (float(lower), float(upper))
            case _:
                raise InputError(f"{path}: {key} is {value!r}; write two numbers, as in {key} = [0.1, 0.5].")
    with about(path):
        return Bounds(limits)


@dataclass(frozen=True, kw_only=True, eq=False)
class Coordinates(ParameterSpace):
    """The parameters of a robot in the order of its layout."""

    layout: Layout


def scale_between(
    robot: Robot, *, free: Sequence[str] = FRICTION, bounds: Bounds | None = None
) -> Coordinates:
    """Return the coordinates of a robot's parameters.

    `free` names quantities or groups to estimate. Quantities with bounds are estimated too; the others are held.
    InputError if a name is not a quantity or a group, or a quantity has no default bounds for this robot.
    """
    given, estimated = bounds.limits if bounds else {}, names_in(free)
    extra = tuple(name for name in BY_NAME if name not in FRICTION and (name in estimated or name in given))
    layout = Layout(wheel_count=robot.wheel_count, extra=extra)
    parameters = []
    for name in layout.names:
        quantity, labels = BY_NAME[name], BY_NAME[name].labels(robot.wheel_count)
        nominal = quantity.nominal(robot)
        if name in given:
            limits = np.tile(given[name], (len(labels), 1))
        else:
            limits = quantity.limits(robot) if name in estimated else np.stack([nominal, nominal], axis=1)
        parameters += [
            FitParameter(
                name=name,
                symbol=label,
                unit=quantity.unit,
                scale=quantity.scale,
                bounds=(low, high),
                default=value,
            )
            for label, (low, high), value in zip(labels, limits.tolist(), nominal.tolist(), strict=True)
        ]
    return Coordinates(layout=layout, parameters=tuple(parameters))
