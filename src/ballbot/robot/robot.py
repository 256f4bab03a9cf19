"""The robot as values in SI units and radians: what Appendix I and Appendix III of the thesis list.

Names are long words here. The thesis's symbols stand beside each field and in `ballbot.mechanics.parameters`, the one
place that maps names to symbols. `assemble` makes a robot from a flat table of values; `scaled_body` and
`scaled_friction` return parts that differ from the nominal ones by factors.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.robot.checks import check_robot
from ballbot.robot.deviations import check_deviations
from ballbot.robot.parameters import BY_NAME, INERTIA_NAMES, Value, value_of

InertiaPoint = Literal["ball_center", "center_of_mass"]

_PRESETS = Path(__file__).parent / "presets"


@dataclass(frozen=True, kw_only=True)
class Ball:
    """The ball: a sphere whose inertia is the same about every axis."""

    radius: float  #: r_b [m]
    mass: float  #: m_b [kg]
    inertia: float  #: j_b [kg m^2], about its centre


@dataclass(frozen=True, kw_only=True)
class Body:
    """Everything that leans: frame, motors and the locked wheels."""

    mass: float  #: m_r [kg]
    center_of_mass: float  #: l [m], height above the ball's centre
    inertia: tuple[float, float, float, float, float, float]  #: j_r [kg m^2]: xx, yy, zz, xy, xz, yz
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


@dataclass(frozen=True, kw_only=True)
class Rollers:
    """The rollers of one omni-wheel, as the twin builds them."""

    rows: int
    per_row: int
    radius: float  #: [m]
    row_spacing: float  #: distance between the planes of the two rows [m]


@dataclass(frozen=True, kw_only=True)
class Wheels:
    """The omni-wheels: three or four of them, at any azimuth, all of one tilt."""

    radius: float  #: r_w [m]
    inertia: float  #: j_w [kg m^2], one wheel about its axle
    tilt: float  #: alpha [rad], from the ball's zenith to the contact point
    azimuths: tuple[float, ...]  #: beta_i [rad]
    rollers: Rollers


@dataclass(frozen=True, kw_only=True)
class Drive:
    """Motor, gearbox, driver and supply of one wheel."""

    gear_ratio: float  #: n [-]
    motor_inertia: float  #: j_m [kg m^2], rotor, motor side
    gear_inertia: float  #: j_g [kg m^2], gearbox, motor side
    torque_constant: float  #: k_t [N m/A], motor side
    speed_constant: float  #: [rad/s/V], motor side
    supply_voltage: float  #: [V]
    torque_limit: float  #: largest torque commanded at a wheel [N m]
    backlash: float  #: gearbox play at the wheel [rad], from stop to stop


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """Encoders and IMU, and the rate at which the controller reads them."""

    sample_time: float  #: [s]
    encoder_counts: int  #: quadrature counts a motor turn
    gyro_noise: float  #: standard deviation of a sample [rad/s]
    attitude_noise: float  #: standard deviation of the AHRS's lean angles [rad]
    heading_drift: float  #: [rad/s]


@dataclass(frozen=True, kw_only=True)
class Friction:
    """Wheel friction tau(w) = b w + (c + s exp(-|w/v_s|^delta)) sgn(w), and rolling friction N C_rr.

    Equations (3.7) and (3.8) of the thesis; the tuples hold a value for each wheel.
    """

    viscous: tuple[float, ...]  #: b [N m s/rad]
    coulomb: tuple[float, ...]  #: c [N m]
    stribeck: tuple[float, ...]  #: s [N m], break-away above Coulomb
    stribeck_speed: float  #: v_s [rad/s]
    stribeck_exponent: float  #: delta [-]
    rolling: float  #: C_rr [-]

    @staticmethod
    def none(wheel_count: int) -> Friction:
        """Return the friction of a robot without any."""
        zero = (0.0,) * wheel_count
        return Friction(
            viscous=zero, coulomb=zero, stribeck=zero, stribeck_speed=1.0, stribeck_exponent=1.0, rolling=0.0
        )


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A ball-balancing robot. Load one with `Robot.load`; change a copy with `replace`.

    Raises
    ------
    InputError
        Where the values are not those of a robot (see `ballbot.robot.checks`).
    """

    name: str
    ball: Ball
    body: Body
    wheels: Wheels
    drive: Drive
    sensors: Sensors
    friction: Friction
    gravity: float = 9.81  #: g [m/s^2]
    #: where each value came from, by dotted name ("ball.radius": "measured"), with detail after a colon where
    #: there is more to say ("data sheet: Maxon 449470"); not part of equality
    sources: Mapping[str, str] = field(default_factory=dict[str, str], compare=False)
    #: how well values are known, by dotted name, in SI units and of the value's shape ("ball.radius": 0.001); a
    #: parameter that is not named counts as known; not part of equality
    standard_deviations: Mapping[str, Value] = field(default_factory=dict[str, Value], compare=False)

    def __post_init__(self) -> None:
        check_robot(self)
        check_deviations(self)

    @property
    def wheel_count(self) -> int:
        """Number of wheels and motors, n."""
        return len(self.wheels.azimuths)

    def replace(
        self,
        *,
        name: str | None = None,
        ball: Ball | None = None,
        body: Body | None = None,
        wheels: Wheels | None = None,
        drive: Drive | None = None,
        sensors: Sensors | None = None,
        friction: Friction | None = None,
        gravity: float | None = None,
        sources: Mapping[str, str] | None = None,
        standard_deviations: Mapping[str, Value] | None = None,
    ) -> Robot:
        """Return a copy with the parts given in place of this robot's own.

        Without `sources`, values that stay keep their source and values that change lose theirs (a file then
        says "assumed"); standard deviations likewise.

        Raises
        ------
        InputError
            Where the copy would not be a robot (see `ballbot.robot.checks`).
        """
        copy = Robot(
            name=self.name if name is None else name,
            ball=ball or self.ball,
            body=body or self.body,
            wheels=wheels or self.wheels,
            drive=drive or self.drive,
            sensors=sensors or self.sensors,
            friction=friction or self.friction,
            gravity=self.gravity if gravity is None else gravity,
        )
        stays = {key for key, one in BY_NAME.items() if value_of(copy, one) == value_of(self, one)}
        if sources is None:
            sources = {key: source for key, source in self.sources.items() if key in stays}
        if standard_deviations is None:
            standard_deviations = {
                key: deviation for key, deviation in self.standard_deviations.items() if key in stays
            }
        return dataclasses.replace(copy, sources=sources, standard_deviations=standard_deviations)

    @staticmethod
    def load(source: str | Path) -> Robot:
        """Return the preset of that name, or the robot in that TOML file.

        Raises
        ------
        InputError
            Where there is neither, or the file does not describe a robot.
        """
        from ballbot.robot.file import read_robot

        presets = Robot.presets()
        if source in presets:
            return read_robot(_PRESETS / f"{source}.toml")
        if not Path(source).exists():
            near = get_close_matches(str(source), presets, n=1)
            hint = (
                f"did you mean the preset {near[0]!r}?" if near else f"the presets are {', '.join(presets)}."
            )
            raise InputError(f"There is no robot file or preset {str(source)!r}; {hint}")
        return read_robot(source)

    @staticmethod
    def presets() -> list[str]:
        """Return the names of the robots that ship with Ballbot."""
        return sorted(path.stem for path in _PRESETS.glob("*.toml"))


@dataclass(frozen=True, kw_only=True)
class Values:
    """Every parameter's value in SI units by dotted name, each of the shape that its `Parameter` says."""

    by_name: Mapping[str, Value]

    def number(self, name: str) -> float:
        """Return the value of a parameter that is one number."""
        value = self.by_name[name]
        assert not isinstance(value, tuple)
        return value

    def numbers(self, name: str) -> tuple[float, ...]:
        """Return the value of a parameter that has a number for each wheel."""
        value = self.by_name[name]
        assert isinstance(value, tuple)
        return value


def assemble(*, name: str, inertia_about: InertiaPoint, values: Values, sources: Mapping[str, str]) -> Robot:
    """Return the robot of these values.

    Raises
    ------
    InputError
        Where they are not those of a robot (see `ballbot.robot.checks`).
    """
    return Robot(
        name=name,
        ball=_ball(values),
        body=_body(values, inertia_about),
        wheels=_wheels(values),
        drive=_drive(values),
        sensors=_sensors(values),
        friction=_friction(values),
        gravity=values.number("gravity"),
        sources=sources,
    )


def _ball(values: Values) -> Ball:
    return Ball(
        radius=values.number("ball.radius"),
        mass=values.number("ball.mass"),
        inertia=values.number("ball.inertia"),
    )


def _body(values: Values, inertia_about: InertiaPoint) -> Body:
    xx, yy, zz, xy, xz, yz = (values.number(f"body.inertia.{name}") for name in INERTIA_NAMES)
    return Body(
        mass=values.number("body.mass"),
        center_of_mass=values.number("body.center_of_mass"),
        inertia=(xx, yy, zz, xy, xz, yz),
        inertia_about=inertia_about,
    )


def _wheels(values: Values) -> Wheels:
    return Wheels(
        radius=values.number("wheels.radius"),
        inertia=values.number("wheels.inertia"),
        tilt=values.number("wheels.tilt"),
        azimuths=values.numbers("wheels.azimuths"),
        rollers=Rollers(
            rows=int(values.number("wheels.rollers.rows")),
            per_row=int(values.number("wheels.rollers.per_row")),
            radius=values.number("wheels.rollers.radius"),
            row_spacing=values.number("wheels.rollers.row_spacing"),
        ),
    )


def _drive(values: Values) -> Drive:
    return Drive(
        gear_ratio=values.number("drive.gear_ratio"),
        motor_inertia=values.number("drive.motor_inertia"),
        gear_inertia=values.number("drive.gear_inertia"),
        torque_constant=values.number("drive.torque_constant"),
        speed_constant=values.number("drive.speed_constant"),
        supply_voltage=values.number("drive.supply_voltage"),
        torque_limit=values.number("drive.torque_limit"),
        backlash=values.number("drive.backlash"),
    )


def _sensors(values: Values) -> Sensors:
    return Sensors(
        sample_time=values.number("sensors.sample_time"),
        encoder_counts=int(values.number("sensors.encoder_counts")),
        gyro_noise=values.number("sensors.gyro_noise"),
        attitude_noise=values.number("sensors.attitude_noise"),
        heading_drift=values.number("sensors.heading_drift"),
    )


def _friction(values: Values) -> Friction:
    return Friction(
        viscous=values.numbers("friction.viscous"),
        coulomb=values.numbers("friction.coulomb"),
        stribeck=values.numbers("friction.stribeck"),
        stribeck_speed=values.number("friction.stribeck_speed"),
        stribeck_exponent=values.number("friction.stribeck_exponent"),
        rolling=values.number("friction.rolling"),
    )


def scaled_body(body: Body, *, mass: float, height: float) -> Body:
    """Return a body of another mass whose centre lies at another height, each by its factor.

    The inertia about the centre of mass grows with the mass; what the height does to it about the ball's centre
    follows.
    """
    central = mass * body.inertia_about_center_of_mass()
    return replace(
        body,
        mass=mass * body.mass,
        center_of_mass=height * body.center_of_mass,
        inertia=tuple(float(central[i]) for i in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))),
        inertia_about="center_of_mass",
    )


def scaled_friction(friction: Friction, factor: float) -> Friction:
    """Return friction whose torques and whose rolling resistance are that many times as large; speeds stay."""
    return replace(
        friction,
        viscous=tuple(factor * one for one in friction.viscous),
        coulomb=tuple(factor * one for one in friction.coulomb),
        stribeck=tuple(factor * one for one in friction.stribeck),
        rolling=factor * friction.rolling,
    )
