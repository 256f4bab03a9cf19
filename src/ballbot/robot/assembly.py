"""A robot put together from the flat list of its parameters' values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ballbot.robot.parameters import INERTIA_NAMES, Value
from ballbot.robot.robot import Ball, Body, Drive, Friction, InertiaPoint, Robot, Rollers, Sensors, Wheels


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
