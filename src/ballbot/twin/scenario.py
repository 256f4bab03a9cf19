"""Scenarios: what is true of a twin and unknown to whoever identifies it.

The twin takes its rigid body from the robot file and everything else from here. Its friction never comes
from `robot.friction`: that field holds what somebody has identified, and a twin that read it would hand its
own answer back.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from ballbot.errors import InputError
from ballbot.robot.robot import Friction, Robot, Rollers, Sensors


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """The faults of a twin, their sizes, and how finely it is simulated."""

    name: str
    friction: Friction  #: true driveline friction (on the motor's speed) and rolling friction
    pivoting: float  #: moment that resists the ball's turning on the spot, over the normal force [m]
    backlash: float  #: gearbox play at the wheel, from stop to stop [rad]; 0 leaves it out
    torque_noise: float  #: standard deviation of each sample's torque [N m]
    rollers: Rollers  #: the rollers that the wheels really have
    sensors: Sensors  #: what the sensors really do; its sample time is the twin's
    speed_window: int = 1  #: samples over which encoder counts are differenced into a speed
    floor_grip: float = 1.0  #: friction coefficient of the ball on the floor [-]
    roller_grip: float = 1.0  #: friction coefficient of the rollers on the ball [-]
    contact_time: float = 0.004  #: time constant of the rubber contacts (MuJoCo's solref) [s]
    timestep: float = 0.0005  #: of the physics engine [s]
    fallen_lean: float = 0.6  #: lean at which the run ends [rad]

    @staticmethod
    def nominal(robot: Robot) -> Scenario:
        """Return the scenario in which the thesis's robot is reproduced.

        Its sizes are frozen: tuning them to suit a result would make the result worthless. They are those of
        a three-wheeled robot; another number of wheels takes them in turn. Rollers and sensors are as the
        robot's file says.
        """
        count = robot.wheel_count
        friction = Friction(
            viscous=_in_turn((0.014, 0.016, 0.013), count),
            coulomb=_in_turn((0.11, 0.09, 0.12), count),
            stribeck=_in_turn((0.05, 0.04, 0.06), count),
            stribeck_speed=0.6,
            stribeck_exponent=1.1,
            rolling=0.007,
        )
        return Scenario(
            name="nominal",
            friction=friction,
            pivoting=0.02,
            backlash=math.radians(1.0),
            torque_noise=0.01,
            rollers=robot.wheels.rollers,
            sensors=robot.sensors,
        )

    @staticmethod
    def ideal(robot: Robot) -> Scenario:
        """Return `nominal` without friction, play or noise; rollers, grip and encoder counts stay.

        The ball is still kept from pivoting, as in the exact model.
        """
        nominal = Scenario.nominal(robot)
        return replace(
            nominal,
            name="ideal",
            friction=Friction.none(robot.wheel_count),
            backlash=0.0,
            torque_noise=0.0,
            sensors=replace(nominal.sensors, gyro_noise=0.0, attitude_noise=0.0, heading_drift=0.0),
        )

    @staticmethod
    def wide_rows(robot: Robot) -> Scenario:
        """Return `nominal` with the two rows of rollers 22 mm apart: the rough wheels of a cheap robot."""
        nominal = Scenario.nominal(robot)
        return replace(nominal, name="wide_rows", rollers=replace(nominal.rollers, row_spacing=0.022))

    @staticmethod
    def names() -> list[str]:
        """Return the names that `named` knows."""
        return list(_NAMED)

    @staticmethod
    def named(name: str, robot: Robot) -> Scenario:
        """Return the scenario of that name for a robot.

        Raises
        ------
        InputError
            Where there is none.
        """
        if name not in _NAMED:
            raise InputError(f"there is no scenario {name!r}; there are {', '.join(_NAMED)}.")
        return _NAMED[name](robot)

    def check(self, robot: Robot) -> None:
        """Raise `InputError` where the scenario cannot be simulated with that robot."""
        friction = self.friction
        for part in (friction.viscous, friction.coulomb, friction.stribeck):
            if len(part) != robot.wheel_count:
                raise InputError(
                    f"scenario {self.name!r} has friction for {len(part)} wheels, "
                    f"but robot {robot.name!r} has {robot.wheel_count}."
                )
        if self.rollers.rows not in (1, 2):
            raise InputError(f"the twin's wheels have one or two rows of rollers, not {self.rollers.rows}.")
        if not 0 < self.rollers.radius < robot.wheels.radius:
            raise InputError(
                f"a roller's radius must be between 0 and the wheel's {robot.wheels.radius} m, "
                f"not {self.rollers.radius} m."
            )
        if self.speed_window < 1:
            raise InputError(f"the speed window must be one sample or more, not {self.speed_window}.")
        steps = self.sensors.sample_time / self.timestep
        if steps < 0.5 or abs(steps - round(steps)) > 1e-6 * steps:
            raise InputError(
                f"the sample time {self.sensors.sample_time} s must be a whole number of the twin's "
                f"timesteps of {self.timestep} s."
            )


def _in_turn(values: tuple[float, ...], count: int) -> tuple[float, ...]:
    return tuple(values[i % len(values)] for i in range(count))


_NAMED: dict[str, Callable[[Robot], Scenario]] = {
    "nominal": Scenario.nominal,
    "ideal": Scenario.ideal,
    "wide_rows": Scenario.wide_rows,
}
