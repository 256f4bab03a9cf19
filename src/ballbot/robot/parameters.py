"""Every parameter of a robot file, in the files' order: its dotted name, symbol, units and meaning.

This one table is what reading, writing and `ballbot check` walk along, so that they cannot disagree.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from ballbot.robot.robot import Robot

Shape = Literal["number", "whole number", "list"]
Value = float | int | tuple[float, ...]

#: kinds of source; a file may add detail after a colon ("data sheet: Maxon 449470")
SOURCES = ("measured", "data sheet", "previous work", "calculated", "identified", "assumed")

#: the body's moments and products of inertia, in the order of `Body.inertia`
INERTIA_NAMES = ("xx", "yy", "zz", "xy", "xz", "yz")


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One line of a robot file."""

    name: str  #: dotted, as in `Robot`: "ball.radius"
    meaning: str
    unit: str  #: SI, as `Robot` holds it
    written_in: str  #: the unit that files are written in
    shape: Shape

    @property
    def table(self) -> str:
        """The TOML table that the line stands in ("" for the top)."""
        return self.name.rpartition(".")[0]

    @property
    def key(self) -> str:
        """The line's key within its table."""
        return self.name.rpartition(".")[2]


def _line(
    name: str, meaning: str, unit: str, *, written_in: str | None = None, shape: Shape = "number"
) -> Parameter:
    return Parameter(name=name, meaning=meaning, unit=unit, written_in=written_in or unit, shape=shape)


PARAMETERS: tuple[Parameter, ...] = (
    _line("gravity", "g, the acceleration of free fall", "m/s^2"),
    _line("ball.radius", "r_b, outer radius", "m"),
    _line("ball.mass", "m_b, mass of the ball", "kg"),
    _line("ball.inertia", "j_b, about the ball's centre", "kg m^2"),
    _line("body.mass", "m_r, with motors and wheels", "kg"),
    _line("body.center_of_mass", "l, its height above the ball's centre", "m"),
    _line("body.inertia.xx", "j_rx, about the axis that points forward", "kg m^2"),
    _line("body.inertia.yy", "j_ry, about the axis that points left", "kg m^2"),
    _line("body.inertia.zz", "j_rz, about the axis that points up", "kg m^2"),
    _line("body.inertia.xy", "element of the matrix, minus the integral of x y dm", "kg m^2"),
    _line("body.inertia.xz", "element of the matrix, minus the integral of x z dm", "kg m^2"),
    _line("body.inertia.yz", "element of the matrix, minus the integral of y z dm", "kg m^2"),
    _line("wheels.radius", "r_w, to the middle of a roller's outside", "m"),
    _line("wheels.inertia", "j_w, one wheel about its axle", "kg m^2"),
    _line("wheels.tilt", "alpha, from the ball's zenith to the contact point", "rad", written_in="deg"),
    _line("wheels.azimuths", "beta_i, from forward towards the left", "rad", written_in="deg", shape="list"),
    _line("wheels.rollers.rows", "rings of rollers on a wheel", "1", shape="whole number"),
    _line("wheels.rollers.per_row", "rollers in a ring", "1", shape="whole number"),
    _line("wheels.rollers.radius", "of a roller at its middle", "m", written_in="mm"),
    _line("wheels.rollers.row_spacing", "between the planes of neighbouring rings", "m", written_in="mm"),
    _line("drive.gear_ratio", "n, motor turns a wheel turn", "1"),
    _line("drive.motor_inertia", "j_m, the rotor, on the motor's side", "kg m^2", written_in="g cm^2"),
    _line("drive.gear_inertia", "j_g, the gearbox, on the motor's side", "kg m^2", written_in="g cm^2"),
    _line("drive.torque_constant", "k_t, at the motor's shaft", "N m/A", written_in="mN m/A"),
    _line("drive.speed_constant", "of the motor without load", "rad/s/V", written_in="rpm/V"),
    _line("drive.supply_voltage", "of the batteries", "V"),
    _line("drive.torque_limit", "largest torque commanded at a wheel", "N m"),
    _line("drive.backlash", "play at the wheel, from stop to stop", "rad", written_in="deg"),
    _line("sensors.sample_time", "of the controller", "s", written_in="ms"),
    _line("sensors.encoder_counts", "a motor turn, quadrature", "1", shape="whole number"),
    _line("sensors.gyro_noise", "standard deviation of a sample", "rad/s", written_in="deg/s"),
    _line("sensors.attitude_noise", "standard deviation of the lean angles", "rad", written_in="deg"),
    _line("sensors.heading_drift", "rate at which the heading runs away", "rad/s", written_in="deg/min"),
    _line("friction.viscous", "b_i, torque for each rad/s", "N m s/rad", shape="list"),
    _line("friction.coulomb", "c_i, dry friction at speed", "N m", shape="list"),
    _line("friction.stribeck", "s_i, break-away torque above c_i", "N m", shape="list"),
    _line("friction.stribeck_speed", "v_s, speed at which s_i has fallen to 37 %", "rad/s"),
    _line("friction.stribeck_exponent", "delta, how sharply it falls", "1"),
    _line("friction.rolling", "C_rr, ball on floor", "1"),
)

BY_NAME = {parameter.name: parameter for parameter in PARAMETERS}


def value_of(robot: Robot, parameter: Parameter) -> Value:
    """Return a parameter's value in SI units, a tuple where there is one for each wheel."""
    if parameter.table == "body.inertia":
        return robot.body.inertia[INERTIA_NAMES.index(parameter.key)]
    return attrgetter(parameter.name)(robot)
