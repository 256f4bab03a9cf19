"""The components of a robot in SI units and radians: what Appendix I and Appendix III of the thesis list.

Names are long words here. The thesis's symbols stand beside each field and in `ballbot.mechanics.parameters`, the one
place that maps names to symbols. `RobotValues` puts the components together as a robot file does; nothing is checked
before it becomes a `ballbot.robot.Robot`. `scaled_body` and `scaled_friction` return components that differ from the
nominal ones by factors.
"""

from __future__ import annotations

import math
from collections import ChainMap
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict

from ballbot.arrays import LONGEST_SAMPLE, SHORTEST_SAMPLE
from ballbot.errors import InputError
from ballbot.robot.friction_law import CLASSICAL, OWN_PARAMETERS, FrictionLaw, friction_law
from ballbot.robot.parameters import (
    Parameter,
    Value,
    components,
    parameter,
    parameter_class,
    parameters_of,
    table,
)

#: errors of values that state none, relative: lengths by a ruler or a caliper, masses by a scale with a cable or a
#: battery more or less, a centre of mass found by balancing, inertias from CAD without screws and cables, and rotors
#: and gears by data sheets, whose tolerances are 10 to 20 %
_LENGTH, _MASS, _HEIGHT, _INERTIA, _DATA_SHEET = 0.01, 0.02, 0.03, 0.1, 0.1

#: fraction of the speeds up to the highest over which a motor's torque falls from its limit to nothing, as on the twin
FALLING_PART = 0.05

InertiaPoint = Literal["ball_center", "center_of_mass"]


@parameter_class
class Ball:
    """The ball: a sphere whose inertia is the same about every axis."""

    radius: float = parameter("r_b, outer radius", "m", most=1.0, usual=(0.03, 0.5), error=_LENGTH)
    mass: float = parameter("m_b, mass of the ball", "kg", most=200.0, error=_MASS)
    inertia: float = parameter("j_b, about the ball's centre", "kg m^2", error=_INERTIA)


@parameter_class
class Body:
    """Everything that leans: frame, motors and the locked wheels."""

    mass: float = parameter("m_r, with motors and wheels", "kg", most=2000.0, error=_MASS)
    center_of_mass: float = parameter("l, its height above the ball's centre", "m", most=3.0, error=_HEIGHT)
    inertia: tuple[float, float, float, float, float, float] = components(
        'The body\'s inertia, wheels locked, about "ball_center" or about "center_of_mass".',
        {
            "xx": Parameter("j_rx, about the axis that points forward", "kg m^2", most=2e4, error=_INERTIA),
            "yy": Parameter("j_ry, about the axis that points left", "kg m^2", most=2e4, error=_INERTIA),
            "zz": Parameter("j_rz, about the axis that points up", "kg m^2", most=2e4, error=_INERTIA),
            **{
                axes: Parameter(
                    f"element of the matrix, minus the integral of {axes[0]} {axes[1]} dm",
                    "kg m^2",
                    least=-math.inf,
                    least_is_allowed=True,
                )
                for axes in ("xy", "xz", "yz")
            },
        },
    )
    inertia_about: InertiaPoint  #: the point that `inertia` is about

    def inertia_about_ball_center(self) -> NDArray[np.float64]:
        """Return J_0 (3, 3) [kg m^2], body frame, about the ball's centre (by the parallel-axis theorem)."""
        inertia = self.inertia_matrix()
        if self.inertia_about == "center_of_mass":
            inertia = inertia + self._point_mass_inertia()
        return inertia

    def inertia_about_center_of_mass(self) -> NDArray[np.float64]:
        """Return the inertia (3, 3) [kg m^2], body frame, about the body's centre of mass."""
        return self.inertia_about_ball_center() - self._point_mass_inertia()

    def inertia_matrix(self) -> NDArray[np.float64]:
        """Return `inertia` as a (3, 3) matrix about the point that `inertia_about` names."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def _point_mass_inertia(self) -> NDArray[np.float64]:
        ml2 = self.mass * self.center_of_mass**2
        return np.diag([ml2, ml2, 0.0])


@parameter_class
class Rollers:
    """The rollers of one omni-wheel, as the twin builds them."""

    rows: int = parameter("rings of rollers on a wheel", most=10)
    per_row: int = parameter("rollers in a ring", most=500, usual=(4.0, 60.0))
    radius: float = parameter("of a roller at its middle", "m", written_in="mm", most=0.3)
    row_spacing: float = parameter(
        "between the planes of neighbouring rings", "m", written_in="mm", least=0.0, most=0.5
    )


@parameter_class
class Wheels:
    """The omni-wheels: three or four of them, at any azimuth, all of one tilt."""

    radius: float = parameter("r_w, to the middle of a roller's outside", "m", most=1.0, error=_LENGTH)
    inertia: float = parameter("j_w, one wheel about its axle", "kg m^2", least=0.0, most=1.0, error=_INERTIA)
    tilt: float = parameter("alpha, from the ball's zenith to the contact point", "rad", written_in="deg")
    azimuths: tuple[float, ...] = parameter(
        "beta_i, from forward towards the left", "rad", written_in="deg", least=-math.inf, most=2.0 * math.pi
    )
    grip: float = parameter(
        "mu, friction coefficient on the ball; 0: unknown",
        default=0.0,
        least=0.0,
        most=10.0,
        usual=(0.0, 1.5),
    )
    rollers: Rollers = table("The rollers of one wheel.")


@parameter_class
class Drive:
    """Motor, gearbox, driver and supply of one wheel."""

    gear_ratio: float = parameter("n, motor turns a wheel turn", usual=(1.0, 200.0))
    motor_inertia: float = parameter(
        "j_m, the rotor, on the motor's side",
        "kg m^2",
        written_in="g cm^2",
        least=0.0,
        most=0.1,
        error=_DATA_SHEET,
    )
    gear_inertia: float = parameter(
        "j_g, the gearbox, on the motor's side",
        "kg m^2",
        written_in="g cm^2",
        least=0.0,
        most=0.1,
        error=_DATA_SHEET,
    )
    torque_constant: float = parameter("k_t, at the motor's shaft", "N m/A", written_in="mN m/A", most=10.0)
    speed_constant: float = parameter("of the motor without load", "rad/s/V", written_in="rpm/V")
    resistance: float = parameter(
        "R, of a winding, from terminal to terminal; 0: unknown",
        "ohm",
        default=0.0,
        least=0.0,
        usual=(0.0, 50.0),
    )
    supply_voltage: float = parameter("of the batteries", "V", most=1000.0, usual=(3.0, 120.0))
    torque_limit: float = parameter("largest torque commanded at a wheel", "N m", most=1000.0)
    backlash: float = parameter(
        "play at the wheel, from stop to stop", "rad", written_in="deg", least=0.0, most=0.3
    )

    @property
    def top_speed(self) -> float:
        """The speed [rad/s] of a wheel without load at full supply, where back-EMF is its voltage (Appendix I)."""
        return self.supply_voltage * self.speed_constant / self.gear_ratio

    @property
    def falling_rate(self) -> float:
        """The part of its top speed that a motor loses with each N m [1/(N m)]: of the twin's, or by the resistance."""
        by_resistance = self.resistance / (self.gear_ratio * self.torque_constant * self.supply_voltage)
        return max(FALLING_PART / self.torque_limit, by_resistance)

    def known_resistance(self, user: str) -> float:
        """Return R [ohm]; raise InputError if it is not known, which this user needs."""
        if self.resistance > 0.0:
            return self.resistance
        line = 'resistance = { value = .., unit = "ohm", source = "measured" }'
        raise InputError(
            f"{user} needs the resistance of the motors' windings, stall voltage over stall current in data sheets: "
            f"write {line} under [drive] of the robot file."
        )

    @property
    def reflected_inertia(self) -> float:
        """The inertia [kg m^2] of rotor and gearbox as felt at the wheel, n^2 (j_m + j_g)."""
        return self.gear_ratio**2 * (self.motor_inertia + self.gear_inertia)


@parameter_class
class Sensors:
    """Encoders and IMU, and the rate at which the controller reads them."""

    sample_time: float = parameter(
        "of the controller",
        "s",
        written_in="ms",
        least=SHORTEST_SAMPLE,
        most=LONGEST_SAMPLE,
        usual=(2e-4, 1.0),
    )
    encoder_counts: int = parameter("a motor turn, quadrature")
    gyro_noise: float = parameter(
        "standard deviation of a sample", "rad/s", written_in="deg/s", least=0.0, most=1.0, usual=(0.0, 0.1)
    )
    attitude_noise: float = parameter(
        "standard deviation of the lean angles",
        "rad",
        written_in="deg",
        least=0.0,
        most=0.2,
        usual=(0.0, 0.03),
    )
    heading_drift: float = parameter(
        "rate at which the heading runs away",
        "rad/s",
        written_in="deg/min",
        least=-math.inf,
        most=1.0,
        usual=(-0.1, 0.1),
    )


@parameter_class
class Friction:
    """The friction of a robot's wheels and of its ball on the floor; `ballbot.mechanics.friction` has the law.

    The tuples hold a value for each wheel. Those of the last three terms are empty if the robot lacks the term.

    Usual values: torques are those of motors of some N m. A v_s far below the speeds of a log, with a large s, is
    friction that hardly ever acts, and traps a search. Measured delta range from 0.5 to 2, and are much larger where a
    lubricant separates the surfaces (Armstrong-Helouvry, Dupont and Canudas de Wit, 1994).
    """

    viscous: tuple[float, ...] = parameter(
        "b_i, torque for each rad/s", "N m s/rad", least=0.0, most=20.0, usual=(0.0, 0.1)
    )
    coulomb: tuple[float, ...] = parameter(
        "c_i, dry friction at speed", "N m", least=0.0, most=200.0, usual=(0.0, 0.5)
    )
    stribeck: tuple[float, ...] = parameter(
        "s_i, break-away torque above c_i", "N m", least=0.0, most=200.0, usual=(0.0, 0.5)
    )
    stribeck_speed: float = parameter("v_s, speed at which s_i has fallen to 37 %", "rad/s", usual=(0.1, 3.0))
    stribeck_exponent: float = parameter("delta, how sharply it falls", usual=(0.3, 10.0))
    rolling: float = parameter("C_rr, ball on floor", least=0.0, most=1.0, usual=(0.0, 0.05))
    pivoting: float = parameter(
        "p, arm of the largest moment against the ball's pivoting on the floor, over its load; 0: unknown",
        "m",
        default=0.0,
        least=0.0,
        most=1.0,
        usual=(0.0, 0.1),
    )
    roller_softness: float = parameter(
        "compliance of the rollers' contacts over the twin's, if this friction is without the rollers' losses; 0: with",
        default=0.0,
        least=0.0,
        most=1000.0,
        usual=(0.0, 10.0),
    )
    coulomb_asymmetry: tuple[float, ...] = parameter(
        "d_i, c_i forward less its mean of both directions",
        "N m",
        default=(),
        least=-math.inf,
        most=200.0,
        usual=(-0.2, 0.2),
    )
    stribeck_asymmetry: tuple[float, ...] = parameter(
        "e_i, s_i forward less its mean of both directions",
        "N m",
        default=(),
        least=-math.inf,
        most=200.0,
        usual=(-0.2, 0.2),
    )
    load: tuple[float, ...] = parameter(
        "mu_i, dry friction for each N m of the motor's torque",
        default=(),
        least=0.0,
        most=1.0,
        usual=(0.0, 0.5),
    )
    law: str = CLASSICAL  #: the friction law, as a robot file names it; see `ballbot.robot.friction_law`
    own: tuple[tuple[str, Value], ...] = ()  #: its parameters that are not among the above, as (name, value)

    @property
    def own_law(self) -> FrictionLaw | None:
        """The registered law of the dry friction; None for the classical one."""
        return friction_law(self.law)

    def of_wheel(self, index: int) -> Friction:
        """Return the friction of one wheel, 0 for the first, as that of a robot with this wheel only."""

        def one(value: Any) -> Any:
            return value[index : index + 1] if isinstance(value, tuple) else value

        numbers = {key.name: one(getattr(self, key.name)) for key in fields(self) if key.name != "own"}
        return replace(self, **numbers, own=tuple((name, one(value)) for name, value in self.own))

    def with_law(self, text: str, own: Mapping[str, Value] | None = None) -> Friction:
        """Return this friction by another law; parameters of its own that are not given have their defaults."""
        law, given, count = friction_law(text), own or {}, len(self.coulomb)
        if law is None:
            return replace(self, law=CLASSICAL, own=())
        values = {}
        for stated in law.own:
            usual = (stated.default,) * count if stated.each_wheel else stated.default
            values[stated.name] = given.get(stated.name, usual)
        return replace(self, law=law.text, own=tuple(values.items()))

    @property
    def is_plain(self) -> bool:
        """Whether the dry friction is c + s exp(-|w/v_s|^delta) in both directions, whatever the motors' torques."""
        terms = any((*self.coulomb_asymmetry, *self.stribeck_asymmetry, *self.load))
        return not terms and self.law == CLASSICAL

    def dry_size(self, speed: NDArray[np.float64], load: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return g(|w|, |u|) [N m] (..., n) of the registered law, for speeds and loads (..., n) of zero or more."""
        law, own = self.own_law, dict(self.own)
        assert law is not None
        numbers = {name: np.asarray(own[name] if name in own else getattr(self, name)) for name in law.takes}
        return law.size(speed, load, **numbers) + np.zeros(np.broadcast(speed, load).shape)

    @property
    def breakaway(self) -> tuple[float, ...]:
        """The torque [N m] that each wheel takes to start, in its harder direction and without load."""
        if self.law == CLASSICAL:
            start = tuple(c + s for c, s in zip(self.coulomb, self.stribeck, strict=True))
        else:
            zeros = np.zeros(len(self.coulomb))
            start = tuple(self.dry_size(zeros, zeros).tolist())
        none = (0.0,) * len(start)
        shifts = zip(self.coulomb_asymmetry or none, self.stribeck_asymmetry or none, strict=True)
        return tuple(g + abs(d + e) for g, (d, e) in zip(start, shifts, strict=True))

    @staticmethod
    def none(wheel_count: int) -> Friction:
        """Return the friction of a robot without any."""
        wheels = dict.fromkeys(("viscous", "coulomb", "stribeck"), (0.0,) * wheel_count)
        return Friction(**wheels, stribeck_speed=1.0, stribeck_exponent=1.0, rolling=0.0)


@dataclass(frozen=True, kw_only=True)
class Correlation:
    """Correlations of the errors of numbers that were identified together; all others count as independent."""

    __pydantic_config__ = ConfigDict(extra="forbid")  # of a robot file's table

    of: tuple[str, ...] = ()  #: the numbers: "friction.rolling", or "friction.viscous[0]" of a list
    lower: tuple[tuple[float, ...], ...] = ()  #: rows of the lower triangle, each to the diagonal's 1

    def matrix(self) -> NDArray[np.float64]:
        """Return the correlation matrix (k, k)."""
        full = np.zeros((len(self.of), len(self.of)))
        for i, row in enumerate(self.lower):
            full[i, : len(row)] = full[: len(row), i] = row
        return full

    def among(self, labels: Collection[str]) -> Correlation:
        """Return the correlations of those numbers that are among `labels`."""
        kept = [i for i, label in enumerate(self.of) if label in labels]
        lower = tuple(tuple(self.lower[i][j] for j in kept if j <= i) for i in kept)
        return Correlation(of=tuple(self.of[i] for i in kept), lower=lower)

    @staticmethod
    def of_matrix(labels: Sequence[str], matrix: NDArray[np.float64]) -> Correlation:
        """Return the correlations (k, k) of k numbers, rounded to five decimals."""
        rows = np.round(matrix, 5).tolist()
        return Correlation(of=tuple(labels), lower=tuple((*row[:i], 1.0) for i, row in enumerate(rows)))


@parameter_class
class RobotValues:
    """Name, components, gravity and sources of a robot, unchecked."""

    name: str
    ball: Ball = table("The ball: a sphere, its inertia about its centre.")
    body: Body = table("The body: all that leans, with motors and wheels.")
    wheels: Wheels = table("The omni-wheels: three or four, numbered as their azimuths are listed.")
    drive: Drive = table("Motor, gearbox and supply of one wheel.")
    sensors: Sensors = table("Encoders, IMU and the controller's sample time.")
    friction: Friction = table(
        "Wheel friction b w + (c + s exp(-|w/v_s|^delta)) sgn(w), and rolling friction N C_rr."
    )
    gravity: float = parameter(
        "g, the acceleration of free fall", "m/s^2", default=9.81, most=30.0, usual=(9.7, 9.9)
    )
    #: where each value came from, by dotted name ("ball.radius": "measured"), with detail after a colon where
    #: there is more to say ("data sheet: Maxon 449470"); not part of equality
    sources: Mapping[str, str] = field(default_factory=dict[str, str], compare=False)
    #: how well values are known, by dotted name, in SI units and of the value's shape ("ball.radius": 0.001). Zero is
    #: exact; infinite is unknown: estimated without a standard error. A parameter that is not named counts as stated,
    #: exactly; not part of equality
    standard_deviations: Mapping[str, Value] = field(default_factory=dict[str, Value], compare=False)
    #: least and greatest value, by label ("friction.stribeck[2]"), of numbers whose standard deviation is infinite: as
    #: far as the data limit them; not part of equality
    intervals: Mapping[str, tuple[float, float]] = field(
        default_factory=dict[str, tuple[float, float]], compare=False
    )
    #: of numbers identified together; not part of equality
    correlation: Correlation = field(default=Correlation(), compare=False)
    #: hashes of some rows of the logs that it was identified from; see `ballbot.log.fingerprints`
    identified_from: tuple[str, ...] = field(default=(), compare=False)

    @property
    def wheel_count(self) -> int:
        """Number of wheels and motors, n."""
        return len(self.wheels.azimuths)

    @property
    def weight(self) -> float:
        """The weight N [N] of the ball and the body, which the floor carries."""
        return (self.ball.mass + self.body.mass) * self.gravity

    @property
    def pivoting_torque(self) -> float | None:
        """The largest moment N p [N m] against the ball's pivoting on a level floor; None if unknown."""
        return self.weight * self.friction.pivoting or None

    @property
    def rolling_force(self) -> float:
        """The friction N C_rr [N] of a ball that rolls on a level floor, and the largest that holds one at rest."""
        return self.weight * self.friction.rolling


#: every parameter of a robot, in the order of robot files, and by its dotted name
PARAMETERS = parameters_of(RobotValues)
#: those of registered friction laws too
BY_NAME: Mapping[str, Parameter] = ChainMap(OWN_PARAMETERS, {item.name: item for item in PARAMETERS})


def parameters_of_robot(robot: RobotValues) -> tuple[Parameter, ...]:
    """Return every parameter of a robot, those of its friction law's own too."""
    return (*PARAMETERS, *(BY_NAME[f"friction.own.{name}"] for name, _ in robot.friction.own))


def deviation_labels(deviations: Mapping[str, Value]) -> Iterator[tuple[str, str, int, float]]:
    """Yield label, name, place and size of each standard deviation above zero, infinite ones too, as in robot files."""
    for name in BY_NAME:
        deviation = deviations.get(name, 0.0)
        listed = isinstance(deviation, tuple)
        for index, size in enumerate(deviation if listed else (deviation,)):
            if size > 0.0:
                yield f"{name}[{index}]" if listed else name, name, index, float(size)


def scaled_body(body: Body, *, mass: float, height: float) -> Body:
    """Return a body of another mass whose centre lies at another height, each by its factor.

    The inertia about the centre of mass grows with the mass; that about the ball's centre follows from the
    height.
    """
    central = mass * body.inertia_about_center_of_mass()
    return replace(
        body,
        mass=mass * body.mass,
        center_of_mass=height * body.center_of_mass,
        inertia=tuple(float(central[i]) for i in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))),
        inertia_about="center_of_mass",
    )


def scaled_friction(
    friction: Friction, factor: float | Sequence[float], *, rolling_factor: float | None = None
) -> Friction:
    """Return friction whose torques and whose floor friction are that many times as large; v_s and delta stay.

    The factor is that of every term, of all wheels or of each. `rolling_factor` is that of C_rr and p, needed if each
    wheel has a factor of its own, and `factor` by default.
    """
    factors = factor if isinstance(factor, Sequence) else (factor,) * len(friction.coulomb)
    of_floor = factor if rolling_factor is None else rolling_factor
    assert not isinstance(of_floor, Sequence)
    law = friction.own_law
    proportional = {item.name for item in law.own if item.is_proportional} if law else ()

    def scaled(value: Value) -> Value:
        if not isinstance(value, tuple):
            return value * max(factors)
        # a term that the robot lacks is empty
        return tuple(factor * number for factor, number in zip(factors if value else (), value, strict=True))

    names = ("viscous", "coulomb", "stribeck", "coulomb_asymmetry", "stribeck_asymmetry", "load")
    return replace(
        friction,
        **{name: scaled(getattr(friction, name)) for name in names},
        rolling=of_floor * friction.rolling,
        pivoting=of_floor * friction.pivoting,
        own=tuple((name, scaled(value) if name in proportional else value) for name, value in friction.own),
    )
