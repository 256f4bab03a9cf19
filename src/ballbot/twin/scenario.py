"""Scenarios: what is true of a twin and unknown to whoever identifies it.

The twin takes its rigid body from the robot file and everything else from here. Its friction never comes from
`robot.friction`: that field holds what somebody has identified, and a twin that read it would hand its own answer
back. Each fault that a scenario may have is a value with its sizes. What is off is built neither into the MuJoCo model
nor into the steps, and so costs nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

from ballbot.arrays import SHORTEST_STEP
from ballbot.errors import InputError, suggest
from ballbot.mechanics.friction_laws import Armstrong, Dahl, LuGre, Smoothed
from ballbot.robot import Friction, Robot, Rollers, Sensors
from ballbot.robot.checks import check_number
from ballbot.robot.parameters import parameter, parameters_of, table
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

    stiffness: float = field(metadata=parameter("of each contact", unit="N/m"))
    damping: float = field(metadata=parameter("of each contact", unit="N s/m", least=0.0))


@dataclass(frozen=True, kw_only=True)
class Compliance:
    """A driveline that twists: a spring and a damper between the motor's side and the wheel's, beyond the play."""

    frequency: float = field(
        metadata=parameter("at which motor and balancing robot oscillate against each other", unit="Hz")
    )
    damping_ratio: float = field(metadata=parameter("of that mode", least=0.0, most=2.0))


@dataclass(frozen=True, kw_only=True)
class CurrentLoop:
    """A motor driver with a lag: the torque follows its command through a first-order filter."""

    bandwidth: float = field(metadata=parameter("at which the torque has fallen to 71 %", unit="Hz"))


@dataclass(frozen=True, kw_only=True)
class Supply:
    """A battery and the motors' windings: the voltage left over drives the current.

    T_max = n k_t (V - k_e n w) / R, T_min = -n k_t (V + k_e n w) / R, with V = V_0 - R_i I and the battery's
    current I = sum (T w + R i^2) / V_0. The nominal twin has a fixed speed limit instead.
    """

    winding_resistance: float = field(metadata=parameter("of a motor", unit="ohm"))
    internal_resistance: float = field(
        metadata=parameter("of the battery, by which it sags", unit="ohm", least=0.0)
    )


@dataclass(frozen=True, kw_only=True)
class LoadDependence:
    """Dry driveline friction that grows with the force N between wheel and ball.

    It is 1 - share + share N / N_0 times its size, where N_0 is the force at rest, upright.
    """

    share: float = field(metadata=parameter("fraction of it that follows the force", least=0.0, most=1.0))


@dataclass(frozen=True, kw_only=True)
class Push:
    """A force on the body for a while, in the world's frame; it starts and ends with a sample."""

    time: float = field(metadata=parameter("start of the push", unit="s", least=-math.inf))
    duration: float = field(metadata=parameter("of the push", unit="s"))
    force: tuple[float, float, float] = field(
        metadata=parameter("in the world's x, y, z", unit="N", least=-math.inf)
    )
    height: float = field(
        metadata=parameter(
            "of its point of action above the ball's centre, along the body's axis", unit="m", least=0.0
        )
    )


@dataclass(frozen=True, kw_only=True)
class Payload:
    """Something carried: a solid ball of aluminium's density, fixed to the body."""

    mass: float = field(metadata=parameter("of the payload", unit="kg"))
    position: tuple[float, float, float] = field(
        metadata=parameter(
            "of its centre from the ball's centre: forward, left, up", unit="m", least=-math.inf
        )
    )


@dataclass(frozen=True, kw_only=True)
class Roughness:
    """A floor with gentle bumps, by the force that their slope makes.

    A robot of weight m g at a place of height h(x, y) is pushed by -m g grad h. The height is a sum of waves in
    all directions, between one and four times the shortest wavelength.
    """

    height: float = field(metadata=parameter("root mean square", unit="m", least=0.0))
    wavelength: float = field(metadata=parameter("the shortest; the longest is four times this", unit="m"))
    seed: int = field(metadata=parameter("of the floor; the robot's run has its own", least=-math.inf))


@dataclass(frozen=True, kw_only=True)
class Timing:
    """A controller that is late or unsteady."""

    delay: int = field(
        default=0,
        metadata=parameter("whole samples by which torques are delayed", least=0.0, most=float(MAX_DELAY)),
    )
    jitter: float = field(
        default=0.0, metadata=parameter("largest deviation of a sampling instant", unit="s", least=0.0)
    )


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """The faults of a twin, their sizes, and how finely it is simulated.

    Those that are None, zero or empty are off.
    """

    name: str = field(metadata=parameter("name of the scenario"))
    friction: Friction = field(
        metadata=table(
            "True driveline friction b w + (c + s exp(-|w/v_s|^delta)) sgn(w) on the motor's speed, and rolling "
            "friction N C_rr."
        )
    )
    pivoting: float = field(
        metadata=parameter(
            "moment that resists the ball's pivoting on the spot, over the normal force", unit="m", least=0.0
        )
    )
    backlash: float = field(
        metadata=parameter("gearbox play at the wheel, from stop to stop", unit="rad", least=0.0)
    )
    torque_noise: float = field(
        metadata=parameter("standard deviation of each sample's torque", unit="N m", least=0.0)
    )
    rollers: Rollers = field(metadata=table("The actual rollers of the wheels."))
    sensors: Sensors = field(
        metadata=table("The actual errors of the sensors; the sample time is the twin's.")
    )
    speed_window: int = field(
        default=1,
        metadata=parameter("samples over which encoder counts are differenced into a speed", most=10_000.0),
    )
    floor_grip: float = field(
        default=1.0, metadata=parameter("friction coefficient of the ball on the floor")
    )
    roller_grip: float = field(
        default=1.0,
        metadata=parameter("friction coefficient of the rollers on the ball; a small one slips"),
    )
    contact_time: float = field(
        default=0.004, metadata=parameter("time constant of the rubber contacts (MuJoCo's solref)", unit="s")
    )
    timestep: float = field(
        default=0.0005, metadata=parameter("of the physics engine", unit="s", least=SHORTEST_STEP)
    )
    fallen_lean: float = field(default=0.6, metadata=parameter("lean at which the run ends", unit="rad"))
    wheel_contact: WheelContact = field(
        default="rollers",
        metadata=parameter('"rollers", or "point": a single contact point under each wheel'),
    )
    floor_tilt: tuple[float, float] = field(
        default=(0.0, 0.0),
        metadata=parameter("of the floor about the world's x and y axes", unit="rad", least=-math.inf),
    )
    asymmetry: float = field(
        default=0.0,
        metadata=parameter(
            "dry friction is (1 + asymmetry) times its size forward, (1 - asymmetry) times backward",
            least=-math.inf,
        ),
    )
    driveline_laws: tuple[BristleLaw, ...] = field(
        default=(),
        metadata=table(
            "Other friction laws, in place of those of the wheels in [friction]: one table for each wheel."
        ),
    )
    load_dependence: LoadDependence | None = field(
        default=None,
        metadata=table(
            "Dry driveline friction that grows with the force between wheel and ball.",
            example=LoadDependence(share=0.5),
        ),
    )
    softness: Softness | None = field(
        default=None,
        metadata=table(
            "A ball that deforms under the wheels.", example=Softness(stiffness=3e4, damping=200.0)
        ),
    )
    compliance: Compliance | None = field(
        default=None,
        metadata=table(
            "Drivelines that twist, with a resonance.",
            example=Compliance(frequency=40.0, damping_ratio=0.1),
        ),
    )
    current_loop: CurrentLoop | None = field(
        default=None, metadata=table("Motor drivers with a lag.", example=CurrentLoop(bandwidth=100.0))
    )
    supply: Supply | None = field(
        default=None,
        metadata=table(
            "A battery and windings in place of a fixed speed limit.",
            example=Supply(winding_resistance=0.6, internal_resistance=0.15),
        ),
    )
    payload: Payload | None = field(
        default=None,
        metadata=table(
            "A payload, which shifts the centre of mass.",
            example=Payload(mass=1.0, position=(0.05, 0.0, 0.6)),
        ),
    )
    roughness: Roughness | None = field(
        default=None,
        metadata=table(
            "A floor with gentle bumps.", example=Roughness(height=0.0005, wavelength=0.1, seed=1)
        ),
    )
    timing: Timing | None = field(
        default=None,
        metadata=table("A controller with delay or jitter.", example=Timing(delay=1, jitter=0.001)),
    )
    pushes: tuple[Push, ...] = field(
        default=(),
        metadata=table(
            "A push on the body; write the table again for another one.",
            example=Push(time=5.0, duration=0.1, force=(20.0, 0.0, 0.0), height=0.4),
        ),
    )
    sensor_faults: SensorFaults | None = field(
        default=None,
        metadata=table(
            "Errors of the AHRS besides noise.",
            example=SensorFaults(gyro_bias=0.001, gyro_bias_walk=1e-5, lean_error=0.003, latency=0.005),
        ),
    )
    accelerometer: Accelerometer | None = field(
        default=None,
        metadata=table("An accelerometer on the body: acc_x to acc_z in the log.", example=Accelerometer()),
    )
    fix: FixSource | None = field(
        default=None,
        metadata=table(
            "An external position sensor, used only by a Kalman filter.", example=FixSource(rate=10.0)
        ),
    )

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
    def names() -> list[str]:
        """Return the names that `named` knows."""
        return list(_NAMED)

    @staticmethod
    def named(name: str, robot: Robot) -> Scenario:
        """Return the scenario of that name for a robot.

        Raises
        ------
        InputError
            If there is none.
        """
        if name not in _NAMED:
            hint = suggest(name, _NAMED, otherwise="there are")
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
    for one in parameters_of(Scenario):
        if one.shape not in ("text", "truth value"):
            for value in _values_at(scenario, one.name):
                check_number(one, one.name, value)
    _check_wheels(scenario, robot)
    _check_shares(scenario)
    _check_rates(scenario)


def _values_at(record: object, name: str) -> Iterator[object]:
    """Yield the numbers under a dotted name: none of a fault that is off, those of every push."""
    key, _, rest = name.partition(".")
    content = getattr(record, key)
    for one in content if isinstance(content, tuple) else (content,):
        if not rest:
            yield one
        elif one is not None:
            yield from _values_at(one, rest)


def _check_wheels(scenario: Scenario, robot: Robot) -> None:
    friction, rollers = scenario.friction, scenario.rollers
    optional = (friction.coulomb_asymmetry, friction.stribeck_asymmetry, friction.load)
    for part in (friction.viscous, friction.coulomb, friction.stribeck, *filter(None, optional)):
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
    if rollers.radius >= robot.wheels.radius:
        raise InputError(
            f"The radius of the rollers is {rollers.radius} m; it must be below the wheel's {robot.wheels.radius} m."
        )


def _check_shares(scenario: Scenario) -> None:
    if abs(scenario.asymmetry) >= 1:
        raise InputError(f"asymmetry is {scenario.asymmetry:g}; it must be between -1 and 1.")
    if max(map(abs, scenario.floor_tilt)) > _STEEPEST_FLOOR:
        raise InputError(
            f"floor_tilt is {list(scenario.floor_tilt)} rad; each must be within "
            f"{_STEEPEST_FLOOR} rad, because no robot balances on a steeper floor."
        )
    laws = scenario.driveline_laws
    if laws and (scenario.asymmetry or scenario.load_dependence):
        raise InputError(
            "asymmetry and load_dependence need the classical friction; remove them or driveline_laws."
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
