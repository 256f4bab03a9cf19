"""Scenarios: the properties of a twin that are unknown to the identification.

The rigid body of the twin is the robot file's; everything else is the scenario's. The friction of the twin never comes
from `robot.friction`: that field is the friction that somebody identified, and a twin with it would return that answer.

A field states its key's unit, range, default and meaning once. File, checks and documentation derive from it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

from pydantic import ConfigDict

from ballbot.arrays import SHORTEST_STEP
from ballbot.errors import InputError, check_known
from ballbot.mechanics.geometry import wheel_load
from ballbot.robot import Friction, Robot, RobotLike, Rollers, Sensors, as_robot
from ballbot.robot.checks import check_parameters
from ballbot.robot.components import scaled_friction
from ballbot.robot.parameters import parameter, parameter_class, parameters_of, table
from ballbot.simulation.imperfections import Push, Roughness, Supply
from ballbot.simulation.sensors import Accelerometer, FixSource, SensorFaults
from ballbot.twin.faults import (
    NEVER,
    Carpet,
    Compliance,
    CurrentLoop,
    LoadDependence,
    Payload,
    Softness,
    Timing,
)
from ballbot.twin.parts import check_rollers

#: the robot whose friction, play and noise `nominal` has
_REPRODUCED = "alten"

#: how a wheel touches the ball: by its rollers, or by one point that is always there
WheelContact = Literal["rollers", "point"]


@parameter_class
class Scenario:
    """The faults of a twin, their sizes, and the resolution of its simulation.

    A fault that is None, zero or empty is off.
    """

    __pydantic_config__ = ConfigDict(extra="forbid")  # also of the tables in it

    name: str = parameter("name of the scenario")
    friction: Friction = table(
        "True driveline friction b w + (c + s exp(-|w/v_s|^delta)) sgn(w) on the motor's speed, and rolling "
        "friction N C_rr."
    )
    pivoting: float = parameter(
        "moment that resists the ball's pivoting on the spot, over the normal force", "m", least=0.0
    )
    backlash: float = parameter("gearbox play at the wheel, from stop to stop", "rad", least=0.0)
    torque_noise: float = parameter("standard deviation of each sample's torque", "N m", least=0.0)
    rollers: Rollers = table("The actual rollers of the wheels.")
    sensors: Sensors = table("The actual errors of the sensors; the sample time is the twin's.")
    speed_window: int = parameter(
        "samples over which encoder counts are differenced into a speed", default=1, most=10_000.0
    )
    floor_grip: float = parameter("friction coefficient of the ball on the floor", default=1.0)
    roller_grip: float = parameter(
        "friction coefficient of the rollers on the ball; a small one slips", default=1.0
    )
    contact_time: float = parameter(
        "time constant of the rubber contacts (MuJoCo's solref)", "s", default=0.004
    )
    timestep: float = parameter("of the physics engine", "s", default=0.0005, least=SHORTEST_STEP)
    fallen_lean: float = parameter("lean at which the run ends", "rad", default=0.6)
    wheel_contact: WheelContact = parameter(
        '"rollers", or "point": a single contact point under each wheel', default="rollers"
    )
    floor_tilt: tuple[float, float] = parameter(
        "of the floor about the world's x and y axes", "rad", default=(0.0, 0.0), least=-math.inf, most=0.2
    )
    load_dependence: LoadDependence | None = table(
        "Dry driveline friction that grows with the force between wheel and ball.",
        default=None,
        example=LoadDependence(fraction=0.5),
    )
    softness: Softness | None = table(
        "A ball that deforms under the wheels.", default=None, example=Softness(stiffness=3e4, damping=200.0)
    )
    compliance: Compliance | None = table(
        "Drivelines that twist, with a resonance.",
        default=None,
        example=Compliance(frequency=40.0, damping_ratio=0.1),
    )
    current_loop: CurrentLoop | None = table(
        "Motor drivers with a lag.", default=None, example=CurrentLoop(bandwidth=100.0)
    )
    supply: Supply | None = table(
        "A battery and the robot's windings in place of a fixed speed limit.",
        default=None,
        example=Supply(internal_resistance=0.15),
    )
    payload: Payload | None = table(
        "A payload, which shifts the centre of mass.",
        default=None,
        example=Payload(mass=1.0, position=(0.05, 0.0, 0.6)),
    )
    roughness: Roughness | None = table(
        "A floor with gentle bumps.", default=None, example=Roughness(height=0.0005, wavelength=0.1, seed=1)
    )
    carpet: Carpet | None = table(
        "Another floor for a while.", default=None, example=Carpet(rolling=0.02, pivoting=0.04, begins=10.0)
    )
    timing: Timing | None = table(
        "A controller with delay or jitter.", default=None, example=Timing(delay=1, jitter=0.001)
    )
    pushes: tuple[Push, ...] = table(
        "A push on the body; write the table again for another one.",
        default=(),
        example=Push(time=5.0, duration=0.1, force=(20.0, 0.0, 0.0), height=0.4),
    )
    sensor_faults: SensorFaults | None = table(
        "Errors of the AHRS besides noise.",
        default=None,
        example=SensorFaults(gyro_bias=0.001, gyro_bias_walk=1e-5, lean_error=0.003, latency=0.005),
    )
    accelerometer: Accelerometer | None = table(
        "An accelerometer on the body: acc_x to acc_z in the log.", default=None, example=Accelerometer()
    )
    fix: FixSource | None = table(
        "An external position sensor, used only by a Kalman filter.",
        default=None,
        example=FixSource(rate=10.0),
    )

    def changes(self) -> tuple[float, ...]:
        """Return when a payload is put on or taken off, or the floor becomes another one [s], in order."""
        times = [self.payload.put_on, self.payload.taken_off] if self.payload else []
        times += [self.carpet.begins, self.carpet.ends] if self.carpet else []
        return tuple(sorted({t for t in times if 0.0 < t < NEVER}))

    def at(self, t: float) -> Scenario:
        """Return the scenario that stays as this one is at the time t [s]."""
        payload, carpet, friction, pivoting = self.payload, self.carpet, self.friction, self.pivoting
        if payload:
            there = payload.put_on <= t < payload.taken_off
            payload = replace(payload, put_on=0.0, taken_off=NEVER) if there else None
        if carpet and carpet.begins <= t < carpet.ends:
            pivoting = carpet.pivoting
            known = pivoting if friction.pivoting else 0.0
            friction = replace(friction, rolling=carpet.rolling, pivoting=known)
        return replace(self, payload=payload, carpet=None, friction=friction, pivoting=pivoting)

    @staticmethod
    def nominal(robot: RobotLike) -> Scenario:
        """Return the scenario that reproduces the robot of the thesis.

        Its values are frozen: tuning them to suit a result would make the result worthless. They are those of a
        three-wheeled robot; with another number of wheels they repeat. Rollers and sensors are those of the robot file.

        Parameters
        ----------
        robot : Robot, preset or robot file

        Returns
        -------
        Scenario

        Raises
        ------
        InputError
            If there is no such robot.

        Examples
        --------
        >>> Scenario.nominal("alten").friction.coulomb
        (0.11, 0.09, 0.12)
        """
        robot = as_robot(robot)
        friction = Friction(
            viscous=_repeated((0.014, 0.016, 0.013), robot),
            coulomb=_repeated((0.11, 0.09, 0.12), robot),
            stribeck=_repeated((0.05, 0.04, 0.06), robot),
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
    def ideal(robot: RobotLike) -> Scenario:
        """Return `nominal` without friction, play or noise; the ball still does not pivot, as in the exact model."""
        return Scenario.named("ideal", robot)

    @staticmethod
    def names() -> list[str]:
        """Return the names of the named scenarios."""
        return list(_NAMED)

    @staticmethod
    def named(name: str, robot: RobotLike) -> Scenario:
        """Return the scenario of that name for a robot; raise InputError if the name is unknown.

        >>> Scenario.named("ideal", "alten").backlash
        0.0
        """
        check_known(name, _NAMED, f"There is no scenario {name!r}", otherwise="there are")
        nominal = Scenario.nominal(robot)
        return replace(nominal, name=name, **_NAMED[name](nominal))


def assumed_friction(robot: RobotLike) -> Friction:
    """Return friction for a robot whose own is unknown: `nominal`'s, the wheels' torques by wheel load times radius.

    Friction of gears and rollers grows with the load that they carry; C_rr already counts per force, and stays.
    """
    known, reproduced = as_robot(robot), Robot.load(_REPRODUCED)
    lever, of = (wheel_load(one) * one.wheels.radius for one in (known, reproduced))
    return scaled_friction(Scenario.nominal(known).friction, lever / of, rolling_factor=1.0)


def _repeated(values: tuple[float, ...], robot: Robot) -> tuple[float, ...]:
    return tuple(values[i % len(values)] for i in range(robot.wheel_count))


#: the named scenarios: what they have other than `nominal`
_NAMED: dict[str, Callable[[Scenario], dict[str, Any]]] = {
    "nominal": lambda _: {},
    "ideal": lambda nominal: {
        "friction": Friction.none(len(nominal.friction.coulomb)),
        "backlash": 0.0,
        "torque_noise": 0.0,
        "sensors": replace(nominal.sensors, gyro_noise=0.0, attitude_noise=0.0, heading_drift=0.0),
    },
    # rows of rollers 22 mm apart, as on the wheels of a cheap robot
    "wide_rows": lambda nominal: {"rollers": replace(nominal.rollers, row_spacing=0.022)},
    # single-row wheels of twice as many rollers, as the thesis recommends
    "single_row": lambda nominal: {
        "rollers": replace(nominal.rollers, rows=1, per_row=2 * nominal.rollers.per_row)
    },
    # wheels that touch the ball in a single point, as in the equations of motion
    "single_point": lambda _: {"wheel_contact": "point"},
    # drivelines that twist, lightly damped. The nominal gain still balances them; at 30 Hz or with half the damping the
    # robot oscillates until it falls
    "resonant": lambda _: {"compliance": Compliance(frequency=40.0, damping_ratio=0.1)},
    # a ball that deforms by 30 um for each newton of a wheel, like an inflated one
    "soft_ball": lambda _: {"softness": Softness(stiffness=3e4, damping=200.0)},
}

#: pushes in a run
_MOST_PUSHES = 1000
#: largest phase [rad] that the fastest oscillation may advance in a timestep
_LARGEST_PHASE = 1.0


def check_scenario(scenario: Scenario, robot: Robot) -> None:
    """Raise InputError if the scenario cannot be simulated with that robot."""
    if len(scenario.pushes) > _MOST_PUSHES:
        raise InputError(
            f"The scenario has {len(scenario.pushes)} pushes; it can have at most {_MOST_PUSHES}."
        )
    check_parameters(scenario)
    check_rollers(scenario.rollers, robot)
    payload, carpet = scenario.payload, scenario.carpet
    if payload and payload.taken_off <= payload.put_on:
        raise InputError(
            f"payload.taken_off is {payload.taken_off:g} s; it must be later than put_on, {payload.put_on:g} s."
        )
    if carpet and carpet.ends <= carpet.begins:
        raise InputError(
            f"carpet.ends is {carpet.ends:g} s; it must be later than begins, {carpet.begins:g} s."
        )
    if scenario.supply:
        robot.drive.known_resistance("The scenario's supply")
    _check_friction(scenario, robot)
    _check_rates(scenario)


def _check_friction(scenario: Scenario, robot: Robot) -> None:
    for row in parameters_of(Friction):
        values = getattr(scenario.friction, row.name)
        if row.shape == "list" and len(values) != robot.wheel_count and values != row.default:
            raise InputError(
                f"The scenario {scenario.name!r} has friction for {len(values)} wheels, but the robot "
                f"{robot.name!r} has {robot.wheel_count}. Give one value for each wheel."
            )
    if scenario.friction.own_law:
        robot.replace(friction=scenario.friction)


def _check_rates(scenario: Scenario) -> None:
    sample_time, step = scenario.sensors.sample_time, scenario.timestep
    steps = sample_time / step
    if steps < 0.5 or abs(steps - round(steps)) > 1e-6 * steps:
        raise InputError(
            f"The sample time {sample_time} s must be a whole multiple of the twin's timestep, {step} s."
        )
    compliance = scenario.compliance
    if compliance and 2 * math.pi * compliance.frequency * step > _LARGEST_PHASE / 2:
        # twice the margin: free wheels swing faster than the robot on its ball, on the BBR 1.7 times
        raise InputError(
            f"compliance.frequency is {compliance.frequency:g} Hz, too fast for a timestep of {step:g} s; "
            f"it must be below {_LARGEST_PHASE / (4 * math.pi * step):.3g} Hz, or the timestep shorter."
        )
    timing = scenario.timing
    if timing and timing.jitter >= sample_time / 2:
        raise InputError(
            f"timing.jitter is {timing.jitter:g} s; it must be "
            f"below half a sample time, {sample_time / 2:g} s."
        )
