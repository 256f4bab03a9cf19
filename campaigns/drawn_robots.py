"""Robots drawn from a rule: what the campaigns that judge "any robot" run on.

The rule was fixed before the first run on what it draws. A robot is drawn from a size, uniform from 0 to 1, so that
what is heavy is tall; every other number is drawn within its range about the size, so that the whole is a robot that
`ballbot check` finds plausible. Nothing is drawn again.

    body          exp(size ln 60) kg; its centre of mass 0.15 m (1 / 0.15)^t above the ball's centre, t 0.65 parts
                  the size and 0.35 parts uniform; a box about it, 1.2 to 2.2 times as tall as that height, 1.2 to 2
                  ball radii wide
    ball          0.1 to 0.25 m of radius, so that the centre of mass lies 1.2 radii above its centre or more; a
                  shell of 3 to 20 kg/m^2, no heavier than the body
    wheels        three, or four in a quarter of the robots, of 0.35 to 0.6 ball radii, at 38 to 50 degrees
    motors        1.5 to 4 times the torque that the most loaded wheel needs to keep a lean of 8 degrees, in the worst
                  direction, while the ball accelerates under it, rotors not counted; without load the ball rolls at 1
                  to 3 m/s
    drive         by torque; by current, its voltage limited by winding and battery; or by PWM duty in proportion to
                  the torque, so that the back-EMF is viscous friction
    friction      break-away 3 to 15 % of the motors' torque, of it 60 to 90 % Coulomb, each wheel within 20 % of that;
                  viscous friction that at the motors' top speed takes 2 to 8 % of their torque
    sampling      100 to 1000 Hz; a delay of 0 to 1.5 samples, whole samples and, for the rest, a lag of the motors
    sensors       200 to 50,000 counts a turn of the wheel; the IMU's noise and drift are those of the nominal scenario
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ballbot.control.lqr import frictionless_model
from ballbot.mechanics.model import Model
from ballbot.robot import Ball, Body, Drive, Friction, Robot, Rollers, Sensors, Wheels
from ballbot.robot.derived import thin_shell_inertia
from ballbot.simulation.imperfections import Supply
from ballbot.twin.faults import CurrentLoop, Timing
from ballbot.twin.scenario import Scenario

#: of the forty robots that designs may be mended on; others judge
TRAINING_SEED = 68

Input = Literal["torque", "current", "duty"]
INPUTS: tuple[Input, ...] = ("torque", "current", "duty")
#: rates of control loops [Hz], whose periods are whole microseconds
RATES = np.array([100, 125, 160, 200, 250, 320, 400, 500, 625, 800, 1000])
#: lean that the motors' torque is measured by [rad]
LEAN = math.radians(8.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnRobot:
    """A robot as its user knows it, and what its loop has besides."""

    robot: Robot  #: with its friction
    input: Input
    delay: float  #: from a measurement until its torques act [s]
    scenario: Scenario  #: sensors, delay, drive and friction


def drawn_robots(seed: int, count: int = 40) -> list[DrawnRobot]:
    """Return robots drawn by the rule; robot k depends on the seed and k alone."""
    return [_drawn(np.random.default_rng([seed, k]), f"drawn {seed} {k}") for k in range(count)]


def _drawn(random: np.random.Generator, name: str) -> DrawnRobot:
    def between(low: float, high: float) -> float:
        return float(random.uniform(low, high))

    def spread(low: float, high: float) -> float:
        """Return a number of which every part of a scale of ratios is as likely."""
        return low * (high / low) ** between(0.0, 1.0)

    size = between(0.0, 1.0)
    mass, height = 60.0**size, 0.15 * (1.0 / 0.15) ** (0.65 * size + between(0.0, 0.35))
    lightest, heaviest = 3.0, 20.0  # shells [kg/m^2]
    radius = spread(0.1, min(0.25, height / 1.2, math.sqrt(mass / (4.0 * math.pi * lightest))))
    area = 4.0 * math.pi * radius**2
    ball_mass = area * spread(lightest, min(heaviest, mass / area))
    tall, wide = between(1.2, 2.2) * height, between(1.2, 2.0) * radius
    deep = between(0.8, 1.25) * wide
    moments = [mass / 12.0 * (a**2 + b**2) for a, b in ((tall, wide), (tall, deep), (wide, deep))]
    count = 3 if between(0.0, 1.0) < 0.75 else 4
    turn, wheel = between(0.0, 2.0 * math.pi / count), between(0.35, 0.6) * radius
    gear, rate = spread(4.0, 60.0), float(random.choice(RATES))  # RATES are evenly spaced in ratios
    loaded = Robot(
        name=name,
        ball=Ball(radius=radius, mass=ball_mass, inertia=thin_shell_inertia(mass=ball_mass, radius=radius)),
        body=Body(
            mass=mass,
            center_of_mass=height,
            inertia=(*moments, 0.0, 0.0, 0.0),
            inertia_about="center_of_mass",
        ),
        wheels=Wheels(
            radius=wheel,
            inertia=0.6 * spread(0.01, 0.05) * mass * wheel**2,
            tilt=math.radians(between(38.0, 50.0)),
            azimuths=tuple(turn + 2.0 * math.pi * k / count for k in range(count)),
            rollers=Rollers(rows=2, per_row=9, radius=0.14 * wheel, row_spacing=0.1 * wheel),
        ),
        drive=_drive(torque=1.0, speed=1.0, gear=gear, inertia=0.0),
        sensors=Sensors(
            sample_time=1.0 / rate,
            encoder_counts=max(1, round(spread(200.0, 50_000.0) / gear)),
            gyro_noise=math.radians(0.11),
            attitude_noise=math.radians(0.1),
            heading_drift=math.radians(5.333) / 60.0,
        ),
        friction=Friction.none(count),
    )
    torque = between(1.5, 4.0) * lean_torque(loaded)
    speed = between(1.0, 3.0) * _wheel_speed(loaded)
    # rotors that on the ball have 2 to 20 % of the body's inertia
    about_ball = float(np.diag(loaded.body.inertia_about_ball_center())[:2].min())
    rotor = spread(0.02, 0.2) * about_ball * (wheel / radius) ** 2
    kind, stall = INPUTS[int(random.integers(len(INPUTS)))], between(1.25, 2.5) * torque
    backlash, late = math.radians(between(0.0, 1.0)), between(0.0, 1.5)
    start = between(0.03, 0.15) * torque * random.uniform(0.8, 1.2, count)
    dry, viscous = between(0.6, 0.9), between(0.02, 0.08) * torque / speed
    friction = Friction(
        # by duty a motor at its top speed gives nothing: the back-EMF takes its torque at standstill
        viscous=(viscous + (torque / speed if kind == "duty" else 0.0),) * count,
        coulomb=tuple((dry * start).tolist()),
        stribeck=tuple(((1.0 - dry) * start).tolist()),
        stribeck_speed=between(0.3, 1.0),
        stribeck_exponent=between(0.8, 1.6),
        rolling=spread(0.002, 0.015),
    )
    drive = _drive(torque=torque, speed=speed, gear=gear, inertia=rotor / gear**2)
    resistance = gear * drive.torque_constant * drive.supply_voltage / stall
    robot = loaded.replace(drive=replace(drive, backlash=backlash, resistance=resistance), friction=friction)
    return DrawnRobot(
        robot=robot,
        input=kind,
        delay=late / rate,
        scenario=_scenario(robot, kind=kind, late=late),
    )


def lean_torque(robot: Robot) -> float:
    """Return the torque [N m] of the most loaded wheel that keeps a lean of `LEAN`, in its worst direction.

    By the linearised model without friction and rotors: the ball accelerates, and neither lean nor heading changes.
    """
    linear = frictionless_model(robot.replace({"drive.motor_inertia": 0.0})).linearize()
    needed = np.linalg.pinv(linear.B[7:]) @ linear.A[7:, 2:4]
    return LEAN * float(np.linalg.norm(needed, axis=1).max())


def _wheel_speed(robot: Robot) -> float:
    """Return the speed of the fastest wheel over the ball's, in its worst direction [rad/m]."""
    return float(np.linalg.norm(Model(robot).wheel_jacobian(np.zeros(5))[:, :2], axis=1).max())


def _drive(*, torque: float, speed: float, gear: float, inertia: float) -> Drive:
    """Return motors with a torque limit [N m] and a speed without load [rad/s] at the wheel, and a usual battery."""
    power = torque * speed
    voltage = 12.0 if power < 60.0 else 24.0 if power < 300.0 else 48.0
    constant = speed * gear / voltage
    return Drive(
        gear_ratio=gear,
        motor_inertia=inertia,
        gear_inertia=0.0,
        torque_constant=0.9 / constant,  # what the gears leave
        speed_constant=constant,
        supply_voltage=voltage,
        torque_limit=torque,
        backlash=0.0,
    )


def _scenario(robot: Robot, *, kind: Input, late: float) -> Scenario:
    """Return the scenario of a robot whose torques are late by so many samples."""
    drive, whole = robot.drive, math.floor(late)
    lag = (late - whole) * robot.sensors.sample_time
    return Scenario(
        name=robot.name,
        friction=robot.friction,
        pivoting=0.0,
        backlash=drive.backlash,
        torque_noise=drive.torque_limit / 600.0,  # the nominal scenario's on its robot
        rollers=robot.wheels.rollers,
        wheel_contact="point",  # the friction contains what the rollers lose
        sensors=robot.sensors,
        timing=Timing(delay=whole) if whole else None,
        current_loop=CurrentLoop(bandwidth=1.0 / (2.0 * math.pi * lag)) if lag > 0.0 else None,
        supply=Supply(internal_resistance=0.0) if kind == "current" else None,
    )
