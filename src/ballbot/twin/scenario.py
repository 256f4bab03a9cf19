"""Scenarios: what is true of a twin and unknown to whoever identifies it.

The twin takes its rigid body from the robot file and everything else from here. Its friction never comes
from `robot.friction`: that field holds what somebody has identified, and a twin that read it would hand its
own answer back.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path

from ballbot.errors import InputError
from ballbot.robot.robot import Friction, Robot, Rollers, Sensors
from ballbot.simulation.accelerometer import Accelerometer
from ballbot.simulation.fixes import FixSource
from ballbot.simulation.sensors import SensorFaults
from ballbot.twin.bristles import BristleLaw
from ballbot.twin.faults import (
    Compliance,
    CurrentLoop,
    LoadDependence,
    Payload,
    Push,
    Roughness,
    Softness,
    Supply,
    Timing,
    WheelContact,
)


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """The faults of a twin, their sizes, and how finely it is simulated.

    Those that are None, zero or empty are off. `ballbot.twin.scenario_checks` says which sizes there can be.
    """

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
    wheel_contact: WheelContact = "rollers"  #: "point": ideal omni-wheels, a single point under each
    floor_tilt: tuple[float, float] = (0.0, 0.0)  #: of the floor about the world's x and y axes [rad]
    asymmetry: float = 0.0  #: dry friction is 1 + this times its size forward, 1 - this backward [-]
    driveline_laws: tuple[BristleLaw, ...] = ()  #: one for each wheel, in place of `friction`'s wheel part
    load_dependence: LoadDependence | None = None
    softness: Softness | None = None
    compliance: Compliance | None = None
    current_loop: CurrentLoop | None = None
    supply: Supply | None = None
    payload: Payload | None = None
    roughness: Roughness | None = None
    timing: Timing | None = None
    pushes: tuple[Push, ...] = ()
    sensor_faults: SensorFaults | None = None
    accelerometer: Accelerometer | None = None
    fix: FixSource | None = None

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
    def single_row(robot: Robot) -> Scenario:
        """Return `nominal` with single-row wheels of twice as many rollers: what the thesis recommends."""
        nominal = Scenario.nominal(robot)
        rollers = replace(nominal.rollers, rows=1, per_row=2 * nominal.rollers.per_row)
        return replace(nominal, name="single_row", rollers=rollers)

    @staticmethod
    def single_point(robot: Robot) -> Scenario:
        """Return `nominal` with wheels that touch the ball in a single point, as the equations have it."""
        return replace(Scenario.nominal(robot), name="single_point", wheel_contact="point")

    @staticmethod
    def resonant(robot: Robot) -> Scenario:
        """Return `nominal` with drivelines that twist: a lightly damped resonance at 40 Hz.

        The nominal gain still balances it; at 30 Hz or with half the damping it shakes itself.
        """
        compliance = Compliance(frequency=40.0, damping_ratio=0.1)
        return replace(Scenario.nominal(robot), name="resonant", compliance=compliance)

    @staticmethod
    def soft_ball(robot: Robot) -> Scenario:
        """Return `nominal` with a ball that gives way under the wheels by 1 N in 30 um, as an inflated one does."""
        softness = Softness(stiffness=3e4, damping=200.0)
        return replace(Scenario.nominal(robot), name="soft_ball", softness=softness)

    @staticmethod
    def load(source: str | Path, robot: Robot) -> Scenario:
        """Return the scenario of that name, or the one in that TOML file, for a robot.

        Raises
        ------
        InputError
            Where there is neither, or the file does not describe a scenario.
        """
        from ballbot.twin.scenario_file import read_scenario  # pydantic is loaded only where a file is read

        if source in _NAMED:
            return Scenario.named(str(source), robot)
        if not Path(source).exists():
            near = get_close_matches(str(source), _NAMED, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"the named ones are {', '.join(_NAMED)}."
            raise InputError(f"There is no scenario or scenario file {str(source)!r}; {hint}")
        return read_scenario(source, robot)

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
            near = get_close_matches(name, _NAMED, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(_NAMED)}."
            raise InputError(f"There is no scenario {name!r}; {hint}")
        return _NAMED[name](robot)


def _in_turn(values: tuple[float, ...], count: int) -> tuple[float, ...]:
    return tuple(values[i % len(values)] for i in range(count))


_NAMED: dict[str, Callable[[Robot], Scenario]] = {
    "nominal": Scenario.nominal,
    "ideal": Scenario.ideal,
    "wide_rows": Scenario.wide_rows,
    "single_row": Scenario.single_row,
    "single_point": Scenario.single_point,
    "resonant": Scenario.resonant,
    "soft_ball": Scenario.soft_ball,
}
