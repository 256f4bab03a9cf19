"""Scenarios: what is true of a twin and unknown to whoever identifies it.

The twin takes its rigid body from the robot file and everything else from here. Its friction never comes from
`robot.friction`: that field holds what somebody has identified, and a twin that read it would hand its own answer
back. Each fault that a scenario may have is a value with its sizes. What is off is built neither into the MuJoCo model
nor into the steps, and so costs nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Literal

from ballbot.arrays import SHORTEST_SAMPLE, SHORTEST_STEP
from ballbot.errors import InputError
from ballbot.mechanics.friction_laws import Armstrong, Dahl, LuGre, Smoothed
from ballbot.robot.robot import Friction, Robot, Rollers, Sensors
from ballbot.simulation.conditions import MAX_DELAY
from ballbot.simulation.sensors import Accelerometer, FixSource, SensorFaults

#: how a wheel touches the ball: by its rollers, or by one point that is always there
WheelContact = Literal["rollers", "point"]


#: driveline friction whose force is a function of its own state, in place of the classical law
BristleLaw = Armstrong | Dahl | LuGre | Smoothed

#: as scenario files call them
LAW_NAMES: dict[str, type[BristleLaw]] = {
    "armstrong": Armstrong,
    "dahl": Dahl,
    "lugre": LuGre,
    "smoothed": Smoothed,
}


@dataclass(frozen=True, kw_only=True)
class Softness:
    """A ball that gives way under the wheels: a spring and a damper at each contact, along its normal."""

    stiffness: float  #: [N/m]
    damping: float  #: [N s/m]


@dataclass(frozen=True, kw_only=True)
class Compliance:
    """A driveline that twists: a spring and a damper between the motor's side and the wheel's, beyond the play."""

    frequency: float  #: at which motor and robot swing against each other, the robot on its ball [Hz]
    damping_ratio: float  #: of that mode [-]


@dataclass(frozen=True, kw_only=True)
class CurrentLoop:
    """A motor driver that takes its time: the torque follows its command through a first-order lag."""

    bandwidth: float  #: at which the torque has fallen to 71 % [Hz]


@dataclass(frozen=True, kw_only=True)
class Supply:
    """A battery and the motors' windings: the voltage left over drives the current.

    T_max = n k_t (V - k_e n w) / R, T_min = -n k_t (V + k_e n w) / R, with V = V_0 - R_i I and the battery's
    current I = sum (T w + R i^2) / V_0. The nominal twin has a fixed speed limit instead.
    """

    winding_resistance: float  #: R of one motor [ohm]
    internal_resistance: float  #: R_i of the battery and its leads [ohm]; 0 does not sag


@dataclass(frozen=True, kw_only=True)
class LoadDependence:
    """Dry driveline friction that grows with the force N between wheel and ball.

    It is 1 - share + share N / N_0 times its size, where N_0 is the force at rest, upright.
    """

    share: float  #: part of the dry friction that follows the force, 0 to 1 [-]


@dataclass(frozen=True, kw_only=True)
class Push:
    """A force on the body for a while, in the world's frame; it starts and ends with a sample."""

    time: float  #: when it begins [s]
    duration: float  #: [s]
    force: tuple[float, float, float]  #: [N]
    height: float  #: of the point of attack above the ball's centre, along the body's axis [m]


@dataclass(frozen=True, kw_only=True)
class Payload:
    """Something carried: a solid ball of aluminium's density, fixed to the body."""

    mass: float  #: [kg]
    position: tuple[float, float, float]  #: of its centre from the ball's centre, body frame [m]


@dataclass(frozen=True, kw_only=True)
class Roughness:
    """A floor with gentle bumps, by the force that their slope makes.

    A robot of weight m g at a place of height h(x, y) is pushed by -m g grad h. The height is a sum of waves in
    all directions, between one and four times the shortest wavelength.
    """

    height: float  #: root mean square [m]
    wavelength: float  #: the shortest [m]
    seed: int  #: of the floor; the robot's run has its own


@dataclass(frozen=True, kw_only=True)
class Timing:
    """A controller that is late or unsteady."""

    delay: int = 0  #: samples by which torques come later than they were computed
    jitter: float = 0.0  #: largest deviation of a sampling instant from its place on the grid [s]


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """The faults of a twin, their sizes, and how finely it is simulated.

    Those that are None, zero or empty are off. `ballbot.twin.scenario` says which sizes there can be.
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
        from ballbot.twin.scenario_file import read_scenario

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


#: sizes that may be below zero; all others are zero or more
_SIGNED = ("asymmetry", "floor_tilt", "force", "position", "time", "heading_drift", "seed")

#: sizes that divide, or without which there is nothing
_POSITIVE = (
    "stiffness",
    "frequency",
    "bandwidth",
    "winding_resistance",
    "wavelength",
    "duration",
    "mass",
    "timestep",
    "sample_time",
    "floor_grip",
    "roller_grip",
    "contact_time",
    "fallen_lean",
    "stribeck_speed",
    "stribeck_exponent",
    "per_row",
    "encoder_counts",
    "speed_window",
)

#: sizes that decide how much is computed or kept, and the most that is
_LARGEST = {
    "delay": float(MAX_DELAY),  # samples
    "latency": 10.0,
    "speed_window": 10_000.0,
    "per_row": 500.0,
    "sample_time": 1.0,
    "lean_error_time": 1e6,
}
_SMALLEST = {"sample_time": SHORTEST_SAMPLE, "timestep": SHORTEST_STEP}
#: pushes in a run
_MOST_PUSHES = 1000

#: how much of a step the fastest swing that is computed explicitly may take [rad]
_LARGEST_PHASE = 1.0

_STEEPEST_FLOOR = 0.2  # [rad]


def check_scenario(scenario: Scenario, robot: Robot) -> None:
    """Raise `InputError` where the scenario cannot be simulated with that robot."""
    if len(scenario.pushes) > _MOST_PUSHES:
        raise InputError(
            f"The scenario has {len(scenario.pushes)} pushes; it can have at most {_MOST_PUSHES}."
        )
    _check_sizes(scenario, "")
    _check_wheels(scenario, robot)
    _check_shares(scenario)
    _check_rates(scenario)


def _check_sizes(value: object, place: str) -> None:
    """Check every number below a dataclass by its field's name."""
    if not is_dataclass(value):
        return
    for field in fields(value):
        content = getattr(value, field.name)
        name = f"{place}{field.name}"
        for one in content if isinstance(content, tuple) else (content,):
            if is_dataclass(one) and field.name != "driveline_laws":  # the laws check themselves
                _check_sizes(one, f"{name}.")
            elif isinstance(one, int | float):
                _check_number(float(one), name, field.name)


def _check_number(value: float, name: str, key: str) -> None:
    if not math.isfinite(value):
        raise InputError(f"{name} is {value}; it must be a finite number.")
    if key in _POSITIVE and value <= 0:
        raise InputError(f"{name} is {value:g}; it must be above zero.")
    if key not in _SIGNED and value < 0:
        raise InputError(f"{name} is {value:g}; it must be zero or more.")
    smallest, largest = _SMALLEST.get(key, -math.inf), _LARGEST.get(key, math.inf)
    if not smallest <= value <= largest:
        bound = f"at least {smallest:g}" if value < smallest else f"at most {largest:g}"
        raise InputError(f"{name} is {value:g}; it must be {bound}.")


def _check_wheels(scenario: Scenario, robot: Robot) -> None:
    friction, rollers = scenario.friction, scenario.rollers
    for part in (friction.viscous, friction.coulomb, friction.stribeck):
        if len(part) != robot.wheel_count:
            raise InputError(
                f"The scenario {scenario.name!r} has friction for {len(part)} "
                f"wheels, but the robot {robot.name!r} has {robot.wheel_count}."
            )
    if scenario.driveline_laws and len(scenario.driveline_laws) != robot.wheel_count:
        raise InputError(
            f"The scenario {scenario.name!r} has {len(scenario.driveline_laws)} driveline "
            f"laws, but the robot {robot.name!r} has {robot.wheel_count} wheels."
        )
    if rollers.rows not in (1, 2):
        raise InputError(f"The twin's wheels must have one or two rows of rollers, not {rollers.rows}.")
    widest = 2.0 * (robot.ball.radius + rollers.radius)
    if (rollers.rows - 1) * rollers.row_spacing >= widest:
        raise InputError(
            f"Rows of rollers {rollers.row_spacing:g} m apart do not "
            f"touch the ball; row_spacing must be below {widest:.3g} m."
        )
    if not 0 < rollers.radius < robot.wheels.radius:
        raise InputError(
            f"The radius of the rollers is {rollers.radius} m; it must "
            f"be above 0 and below the wheel's {robot.wheels.radius} m."
        )


def _check_shares(scenario: Scenario) -> None:
    if abs(scenario.asymmetry) >= 1:
        raise InputError(f"asymmetry is {scenario.asymmetry:g}; it must be between -1 and 1.")
    load = scenario.load_dependence
    if load and load.share > 1:
        raise InputError(f"load_dependence.share is {load.share:g}; it must be between 0 and 1.")
    if max(map(abs, scenario.floor_tilt)) > _STEEPEST_FLOOR:
        raise InputError(
            f"floor_tilt is {list(scenario.floor_tilt)} rad; each must be within "
            f"{_STEEPEST_FLOOR} rad, because no robot balances on a steeper floor."
        )
    laws = scenario.driveline_laws
    if laws and (scenario.asymmetry or load):
        raise InputError(
            "asymmetry and load_dependence need the classical friction; remove them or driveline_laws."
        )
    if scenario.compliance and scenario.compliance.damping_ratio > 2:
        raise InputError(
            f"compliance.damping_ratio is {scenario.compliance.damping_ratio:g}; it must be between 0 and 2."
        )


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
