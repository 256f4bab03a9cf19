"""A robot's sensors, drive and floor beyond what its model has, and the record of them that the compiled loop reads.

A robot on a floor of slope s = grad h is stepped in the floor's frame, in which gravity is not along z. A body whose
centre of mass is off its axis by (d_x, d_y), forward and to the left, is stepped in the frame whose z axis goes through
it, so its wheels are slightly tilted: the ball's rolling turns them as those of a leaning body. Both are exact except
for the lean shown, that of the body in the world's frame: the lean of its frame on the floor and, to first order,

    (theta, phi) + (s_y, -s_x) + (s d_x + c d_y, -c d_x + s d_y) / l          s, c = sin psi, cos psi

Omni-wheels of radius r_w touch the ball by one roller after another, of radius r at its middle, and of one ring or two
in turn. A ring s/2 off the wheel's middle plane touches the ball at n cos d +- a sin d, sin d = (s/2) / (r_b + r), so
that the axle in the wheel's row of A is a cos d -+ n sin d: the ball's turning about the normal n turns the wheel too.
An ellipsoidal roller, as round as the wheel at its middle, falls short of the wheel's circle by

    D(x) = (r_w - r) r_w / (8 r) x^4           x: the wheel's angle from the roller's middle

and the force N between wheel and ball at rest turns the wheel by N D'(x), away from the middle. Halfway between
two rollers both touch. Their contacts are springs that give way by y under N, with dampers of a time constant t_c, so
the nearer bears the share

    1/2 + (d + t_c d_dot) / 2y          d = D(p - x) - D(x)

of N, at least none and at most all, where p is the angle from a roller to the next. The dampers make this a friction
that grows with the wheel's speed: on the BBR's twin 0.005 N m s/rad, a third of the drivelines' viscous one. Rollers of
both rings then impose different speeds on the wheel: they creep over the ball, and the less loaded one slips beyond its
grip, which brakes the ball's turning about n. On the twin this is most of what rollers do: of two rows 6 mm apart,
0.15 N m in a third of the wheel's positions. (MuJoCo's convex friction pushes sliding contacts apart, which loads
the lesser contact more: at slow motion rows 22 mm apart brake a third more there than here, rows 6 mm apart 9 %.)

Dry friction of a driveline may follow the force between wheel and ball: 1 - f + f N / N_0 of it, with N from the
accelerations at the sample's start (`ballbot.simulation.model_plant`).
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.estimation.interface import EstimatorName
from ballbot.estimation.onboard import ONBOARD, onboard_record
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.mechanics.geometry import rotation_to, transforms
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import pack
from ballbot.records import MAX_WHEELS, Schema, fill_record, number, schema_of, whole
from ballbot.robot import Robot, Rollers, Sensors
from ballbot.robot.checks import check_parameters
from ballbot.robot.components import FALLING_PART
from ballbot.robot.parameters import parameter, parameter_class, table
from ballbot.robot.wheel_directions import contact_directions
from ballbot.simulation.sensors import SENSORS, Accelerometer, FixSource, SensorFaults, sensor_record

#: the steepest slope for which the first order is taken: 0.1 is 5.7 degrees
MAX_SLOPE = 0.1
#: samples by which torques may be late: 5 s at 200 Hz, in which any ballbot falls; each takes room in a batch
MAX_DELAY = 1000
#: samples over which counts may be differenced
_LONGEST_WINDOW = 10_000
#: of MuJoCo's contacts of rubber: compliance over mobility and the square of their time constant, by its defaults, and
#: tangential force over creep speed, times mobility and time constant, measured on the BBR's twin
_GIVE, _CREEP = 1.0 / 9.0, 216.0
#: over that time constant, damping by stiffness of a contact that is critically damped
_DAMPED = 2.0


@parameter_class
class Push:
    """A force on the body for a limited time, in the world frame; it starts and ends at a sample."""

    time: float = parameter("start of the push", "s", least=-math.inf)
    duration: float = parameter("of the push", "s")
    force: tuple[float, float, float] = parameter("in the world frame: x, y, z", "N", least=-math.inf)
    height: float = parameter(
        "of its point of application above the ball's centre, along the body's axis", "m", least=0.0
    )

    @staticmethod
    def of_impulse(impulse: float, angle: float, *, time: float, duration: float, height: float) -> "Push":
        """Return the push by an impulse [N s] towards an angle on the floor, from x towards y [rad]."""
        force = impulse / duration
        along = (force * math.cos(angle), force * math.sin(angle), 0.0)
        return Push(time=time, duration=duration, force=along, height=height)


@parameter_class
class Supply:
    """A battery, and the motors' windings of the robot file: the voltage left after the back-EMF drives the current.

    T_max = n k_t (V - k_e n w) / R, T_min = -n k_t (V + k_e n w) / R, with V = V_0 - R_i I and the battery's
    current I = sum (T w + R i^2) / V_0. Without it the supply sets a fixed speed limit.
    """

    internal_resistance: float = parameter("of the battery", "ohm", least=0.0)


@parameter_class
class Roughness:
    """A floor with gentle bumps, modelled by the force of their slope.

    The force on a robot of mass m at the height h(x, y) is -m g grad h. The height is a sum of waves in all directions
    with wavelengths between one and four times the shortest.
    """

    height: float = parameter("root mean square", "m", least=0.0)
    wavelength: float = parameter("shortest wavelength; the longest is four times as long", "m")
    seed: int = parameter("random seed of the floor; the run has its own", least=-math.inf)


#: waves of which a floor's bumps are the sum
_WAVES = 24


def waves_of(roughness: Roughness) -> NDArray[np.float64]:
    """Return the waves (m, 4) of a floor's bumps: wave vector k [rad/m], phase [rad] and amplitude a [m].

    The height is the sum of a sin(k . place + phase), drawn from the floor's seed.
    """
    random = np.random.default_rng([roughness.seed, 900])
    heading = random.uniform(0.0, 2 * np.pi, _WAVES)  # U(0, 2 pi)
    # log-uniform, up to four times
    length = roughness.wavelength * 4.0 ** random.uniform(0.0, 1.0, _WAVES)
    phases = random.uniform(0.0, 2 * np.pi, _WAVES)  # U(0, 2 pi)
    k = (2 * np.pi / length)[:, None] * np.column_stack((np.cos(heading), np.sin(heading)))
    return np.column_stack((k, phases, np.full(_WAVES, roughness.height * np.sqrt(2.0 / _WAVES))))


def slope_of(waves: NDArray[np.float64], position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return grad h (2,) of a floor's waves (m, 4) at a place (2,) [m]."""
    k, phases, amplitudes = waves[:, :2], waves[:, 2], waves[:, 3]
    return (amplitudes * np.cos(k @ position + phases)) @ k


class DriveLimits:
    """Torque limit of the drivers, and what the supply leaves: a battery, or a fixed limit near the highest speed."""

    def __init__(self, robot: Robot, supply: Supply | None = None) -> None:
        drive = robot.drive
        self._supply = supply
        self.torque_limit = drive.torque_limit  #: [N m]
        self.top_speed = drive.top_speed  #: [rad/s] at the wheel
        self._full = drive.supply_voltage
        self._ampere = drive.gear_ratio * drive.torque_constant  # [N m/A] at the wheel
        self._back = drive.gear_ratio / drive.speed_constant  # [V s/rad] at the wheel
        self._winding = drive.known_resistance("A supply") if supply else 0.0  # [ohm]

    def within(self, torques: NDArray[np.float64], speeds: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the torques (n,) [N m] that the motors can give of those commanded at motor speeds (n,) [rad/s]."""
        clipped = np.minimum(np.maximum(torques, -self.torque_limit), self.torque_limit)
        if self._supply is not None:
            return self._within_supply(self._supply, clipped, speeds)
        # one-sided: a motor at its highest speed can still brake with full torque
        left = (self.top_speed - speeds * np.sign(clipped)) / (FALLING_PART * self.top_speed)
        available = np.clip(left, 0.0, 1.0) * self.torque_limit
        return np.sign(clipped) * np.minimum(np.abs(clipped), available)

    def _within_supply(
        self, supply: Supply, torques: NDArray[np.float64], speeds: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        current = torques / self._ampere
        power = float(torques @ speeds + self._winding * (current @ current))
        # a loaded battery has V = V_0 - R_i P / V_0; braking motors charge it
        voltage = max(self._full - supply.internal_resistance * power / self._full, 0.0)
        most = self._ampere * voltage / self._winding
        back_emf = self._ampere * self._back / self._winding * speeds
        return np.clip(torques, -most - back_emf, most - back_emf)


@parameter_class
class Grip:
    """Coulomb friction of the contacts, beyond which they slip."""

    wheels: float = parameter("friction coefficient of the wheels on the ball", default=1.0)
    floor: float = parameter("friction coefficient of the ball on the floor", default=1.0)

    def __post_init__(self) -> None:
        check_parameters(self)


@dataclass(frozen=True, kw_only=True)
class RollerContacts:
    """Wheels that touch the ball by one roller after another: of rubber as the twin's, unless its numbers are given."""

    rollers: Rollers  #: as they really are, in one ring or two
    grip: float = 1.0  #: friction coefficient of the rollers on the ball
    contact_time: float = 0.004  #: time constant of the rubber [s]
    softness: float = 1.0  #: how much softer than the twin's it is
    give: float | None = None  #: by which a contact gives way for each newton [m/N]
    creep: float | None = None  #: tangential force over the speed with which a roller creeps [N s/m]
    relaxation: float | None = None  #: time constant of a contact's spring and damper [s]


def _contact_mobility(robot: Robot, rollers: Rollers, *, play: bool) -> float:
    """Return the mobility [1/kg] of ball and roller at a contact, the mean over directions, as MuJoCo softens it.

    With play, a wheel moves without its rotor.
    """
    wheels, body, ball = robot.wheels, robot.body, robot.ball
    normal = contact_directions(wheels.azimuths, wheels.tilt)[0]
    arm = (ball.radius + rollers.radius) * normal - np.array([0.0, 0.0, body.center_of_mass])
    turning = np.linalg.inv(body.inertia_about_center_of_mass()) @ (
        arm @ arm * np.eye(3) - np.outer(arm, arm)
    )
    inertia = wheels.inertia + (0.0 if play else robot.drive.reflected_inertia)
    across = (wheels.radius - rollers.radius) ** 2
    of_wheel = across / inertia if inertia > 0.0 else math.inf
    return 1.0 / ball.mass + 1.0 / body.mass + (float(np.trace(turning)) + of_wheel) / 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Later:
    """What a robot is from an instant on: a payload was put on or taken off, or the floor is another one.

    Poses and velocities stay at the change.
    """

    time: float  #: [s]
    model: Model  #: of the same kind as that at the start
    imbalance: tuple[float, float] = (0.0, 0.0)  #: see `Imperfections` [kg m]


@parameter_class
class Imperfections:
    """A robot's sensors, drive and floor, beyond what its model has; all is off by default but the drive's limits.

    InputError if a value is not a number of its kind, or out of its bounds.
    """

    #: their sample time is the plant's; None if the controller sees the true state
    sensors: Sensors | None = table("The sensors as they really are.", default=None)
    speed_window: int = parameter(
        "samples over which encoder counts are differenced into a speed", default=1, most=_LONGEST_WINDOW
    )
    sensor_faults: SensorFaults | None = None
    accelerometer: Accelerometer | None = None
    fix: FixSource | None = None
    delay: int = parameter(
        "samples by which torques come later than they were computed", default=0, least=0.0, most=MAX_DELAY
    )
    jitter: float = parameter("largest deviation of a sampling instant", "s", default=0.0, least=0.0)
    torque_noise: float = parameter(
        "standard deviation of each sample's torque", "N m", default=0.0, least=0.0
    )
    lag: float = parameter(
        "time constant with which a motor's torque follows its command", "s", default=0.0, least=0.0
    )
    backlash: float = parameter("gearbox play at the wheel, from stop to stop", "rad", default=0.0, least=0.0)
    contacts: RollerContacts | None = None  #: None if each wheel touches in a single point
    grip: Grip | None = None  #: None if contacts never slip
    load_dependence: float = parameter(
        "fraction of the dry driveline friction that follows the contact's force",
        default=0.0,
        least=0.0,
        most=1.0,
    )
    supply: Supply | None = None  #: a battery in place of the fixed limit of the motors' speed
    slope: tuple[float, float] = (0.0, 0.0)  #: rise of the floor along x and along y [-]
    #: mass times distance of the body's centre of mass from its axis, forward and to the left [kg m]
    imbalance: tuple[float, float] = (0.0, 0.0)
    pushes: tuple[Push, ...] = ()
    roughness: Roughness | None = None  #: bumps of the floor
    later: tuple[Later, ...] = ()  #: changes of payload or floor, in the order of their times
    #: in a row from sample `missing_from` on; the law gives no torque in them
    missing: int = parameter("samples without a measurement", default=0, least=0.0)
    missing_from: int = parameter("the first of them", default=0, least=0.0)
    fallen_lean: float = parameter("lean at which a run ends", "rad", default=LARGEST_LEAN, most=LARGEST_LEAN)
    known: Robot | None = None  #: the robot that the estimator knows; the true one by default
    seed: int = 0  #: all that is random in a batch's lane follows from it

    def __post_init__(self) -> None:
        check_parameters(self)
        if not np.hypot(*self.slope) <= MAX_SLOPE:
            raise InputError(
                f"The slope of the floor is {np.hypot(*self.slope):.3g}; it must be at most {MAX_SLOPE:g}."
            )

    @property
    def random(self) -> bool:
        """Whether anything in a run depends on its seed besides the sampling instants and the place in the play."""
        return self.sensors is not None or self.torque_noise > 0.0


def off_axis(robot: Robot, imbalance: tuple[float, float]) -> NDArray[np.float64]:
    """Return the angles (2,) [rad] by which a body's centre of mass is off its axis, forward and to the left."""
    return np.array(imbalance) / (robot.body.mass * robot.body.center_of_mass)


def packed_on_floor(model: Model, imperfections: Imperfections) -> NDArray[np.float64]:
    """Return the row of an exact model's numbers, as `Model.packed`: a body off its axis on a floor that slopes."""
    if not (any(imperfections.slope) or any(imperfections.imbalance)):
        return model.packed
    normal = np.array([-imperfections.slope[0], -imperfections.slope[1], 1.0])
    x, y = off_axis(model.robot, imperfections.imbalance).tolist()
    if not math.hypot(x, y) < 1.0:
        raise InputError(
            f"The imbalance is {np.hypot(*imperfections.imbalance):.3g} kg m; it must be below the body's mass "
            "times the height of its centre of mass."
        )
    return pack(
        model.robot,
        model.formulation,
        pivoting=model.pivoting or 0.0,
        upward=rotation_to(normal)[2],
        seat=rotation_to(np.array([x, y, math.sqrt(1.0 - x * x - y * y)])),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopRecord:
    """The numbers of one robot's sensors, drive, floor and estimator, as the compiled loop reads them."""

    delay: int = field(default=0, metadata=whole())
    missing_from: int = field(default=0, metadata=whole())
    missing_until: int = field(default=0, metadata=whole())
    #: 1 if the drive limits the torque, 2 if a battery does
    limited: int = field(default=0, metadata=whole())
    torque_limit: float = field(default=0.0, metadata=number("N m"))
    top_speed: float = field(default=1.0, metadata=number("rad/s"))
    #: of a battery without load, its resistance over that, a motor's, and at the wheel k_t and k_e
    voltage: float = field(default=0.0, metadata=number("V"))
    sag: float = field(default=0.0, metadata=number("V/W"))
    winding: float = field(default=1.0, metadata=number("ohm"))
    ampere: float = field(default=1.0, metadata=number("N m/A"))
    back: float = field(default=0.0, metadata=number("V s/rad"))
    #: largest deviation of a sampling instant
    jitter: float = field(default=0.0, metadata=number("s"))
    torque_noise: float = field(default=0.0, metadata=number("N m"))
    #: time constant of the motors
    lag: float = field(default=0.0, metadata=number("s"))
    play: float = field(default=0.0, metadata=number("rad"))
    rotor_inertia: float = field(default=0.0, metadata=number("kg m^2"))
    #: angle from a roller to the next; 0 if a wheel touches in a single point
    pitch: float = field(default=0.0, metadata=number("rad"))
    #: of a contact at rest: its force, how far it gives way, and D(x) / x^4
    pressure: float = field(default=0.0, metadata=number("N"))
    give: float = field(default=1.0, metadata=number("m"))
    out_of_round: float = field(default=0.0, metadata=number("m"))
    relaxation: float = field(default=0.0, metadata=number("s"))
    #: what a wheel's row of A has more where its second ring touches, and less where its first does
    off_middle: NDArray[np.float64] = field(
        default_factory=lambda: np.zeros((1, 3)), metadata=number("1", MAX_WHEELS, 3)
    )
    #: of the first ring from the second, half; and how each wheel's speed turns the ball about each normal
    lever: float = field(default=0.0, metadata=number("m"))
    grip: float = field(default=0.0, metadata=number("1"))
    creep: float = field(default=0.0, metadata=number("N s/m"))
    about_normal: NDArray[np.float64] = field(
        default_factory=lambda: np.zeros((1, 1)), metadata=number("1", MAX_WHEELS, MAX_WHEELS)
    )
    load_dependence: float = field(default=0.0, metadata=number("1"))
    #: friction coefficients of contacts that may slip; 0 if they never do
    wheel_grip: float = field(default=0.0, metadata=number("1"))
    floor_grip: float = field(default=0.0, metadata=number("1"))
    fallen_cosine: float = field(default=-1.0, metadata=number("1"))
    #: of the floor's frame in the world's
    floor_lean: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2), metadata=number("rad", 2))
    #: of the body's centre of mass off its axis; the lean shown at psi = 0 is larger by (y, -x) of it
    off_axis: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2), metadata=number("rad", 2))
    sample_time: float = field(default=1.0, metadata=number("s"))
    #: 0 if the controller sees the true state, 1 for the on-board state, 2 for the Kalman filter's
    estimator: int = field(default=0, metadata=whole())


#: the on-board state's numbers are of the robot that the estimator knows
LOOP = Schema(
    name="loop",
    fields={**schema_of(LoopRecord).fields, "sensors": SENSORS, "onboard": ONBOARD},
)


def loop_record(
    imperfections: Imperfections, robot: Robot, *, estimator: EstimatorName | None, sample_time: float
) -> NDArray[np.float64]:
    """Return the row of numbers, the float64 view of a record of `LOOP`, of the true robot.

    The estimator is where there are sensors; None if they are read elsewhere. InputError for play without rotors.
    """
    drive = robot.drive
    rotor = drive.reflected_inertia
    if imperfections.backlash > 0.0 and not rotor > 0.0:
        raise InputError(
            f"The motors and gears of {robot.name!r} have no inertia, so nothing limits their speed within the play; "
            "give drive.motor_inertia or drive.gear_inertia."
        )
    values: dict[str, object] = {
        "sample_time": sample_time,
        "delay": imperfections.delay,
        "missing_from": imperfections.missing_from,
        "missing_until": imperfections.missing_from + imperfections.missing,
        "limited": 1,
        "torque_limit": drive.torque_limit,
        "top_speed": drive.top_speed,
        "jitter": imperfections.jitter,
        "torque_noise": imperfections.torque_noise,
        "lag": imperfections.lag,
        "play": imperfections.backlash,
        "rotor_inertia": rotor,
        "fallen_cosine": math.cos(imperfections.fallen_lean)
        if imperfections.fallen_lean < LARGEST_LEAN
        else -1.0,
        "floor_lean": np.array([imperfections.slope[1], -imperfections.slope[0]]),
        "off_axis": off_axis(robot, imperfections.imbalance),
        **_of_contacts(imperfections, robot),
    }
    if imperfections.supply is not None:
        values |= {
            "limited": 2,
            "voltage": drive.supply_voltage,
            "sag": imperfections.supply.internal_resistance / drive.supply_voltage,
            "winding": drive.known_resistance("A supply"),
            "ampere": drive.gear_ratio * drive.torque_constant,
            "back": drive.gear_ratio / drive.speed_constant,
        }
    record = LOOP.zeros()
    if imperfections.sensors is not None and estimator is not None:
        values["estimator"] = 1 if estimator == "onboard" else 2
        shown = sensor_record(
            robot,
            imperfections.sensors,
            sample_time=sample_time,
            window=imperfections.speed_window,
            faults=imperfections.sensor_faults,
        )
        fill_record(record["sensors"], shown)
        known = imperfections.known or robot
        fill_record(record["onboard"], onboard_record(known, sample_time=sample_time))
    fill_record(record, LoopRecord(**values))  # pyright: ignore[reportArgumentType] (a value for each field)
    return record.view(np.float64)


def _of_contacts(imperfections: Imperfections, robot: Robot) -> dict[str, object]:
    wheels = robot.wheels
    normals = contact_directions(wheels.azimuths, wheels.tilt)
    at_rest = robot.body.mass * robot.gravity / (len(normals) * math.cos(wheels.tilt))
    values: dict[str, object] = {"load_dependence": imperfections.load_dependence, "pressure": at_rest}
    if imperfections.grip is not None:
        if not wheels.inertia > 0.0:
            raise InputError(f"Wheels that slip need an inertia; wheels.inertia of {robot.name!r} is zero.")
        values |= {"wheel_grip": imperfections.grip.wheels, "floor_grip": imperfections.grip.floor}
    if imperfections.contacts is None:
        return values
    contacts, radius = imperfections.contacts, robot.ball.radius
    rollers, time = contacts.rollers, contacts.contact_time
    mobility = contacts.softness * _contact_mobility(robot, rollers, play=imperfections.backlash > 0.0)
    give = _GIVE * mobility * time**2 if contacts.give is None else contacts.give
    off = 0.5 * rollers.row_spacing / (radius + rollers.radius) if rollers.rows == 2 else 0.0
    pitch = 2.0 * math.pi / (rollers.rows * rollers.per_row)
    out_of_round = (wheels.radius - rollers.radius) * wheels.radius / (8.0 * rollers.radius)
    return values | {
        "pitch": pitch,
        "give": min(at_rest * give, out_of_round * pitch**4),  # beyond, a third roller would touch
        "out_of_round": out_of_round,
        "relaxation": _DAMPED * time if contacts.relaxation is None else contacts.relaxation,
        "off_middle": radius / wheels.radius * off * normals,
        "lever": radius * off,
        "grip": contacts.grip,
        "creep": _CREEP / (mobility * time) if contacts.creep is None else contacts.creep,
        "about_normal": normals @ transforms(robot).T_obw,
    }
