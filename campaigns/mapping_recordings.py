"""The recorded logs of `campaigns.mapping_corpus`: robots, motions and seeds of its halves.

The third to fifth development halves judged earlier versions of the inference. Their robots, and those of the test
half, are simulated by the equations of motion with the twin's sensors, play, torque noise and friction, which takes a
fraction of the twin's time. The references of the test half never stand still: in two recordings of the fifth
development half dry friction holds the robot throughout, so that they show nothing of it. Recorded logs are kept in
build/mapping_corpus and are not recorded again.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.presets import nominal_controller
from ballbot.control.references import Reference, change_pose, circle, figure_eight, hold, square
from ballbot.log import Log
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.components import Ball, scaled_friction
from ballbot.simulation.plant import Plant
from ballbot.simulation.run import simulate
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin import Scenario, Twin
from ballbot.twin.imperfections import imperfections_of, true_model
from campaigns.foreign_logs import commands
from campaigns.section import is_kept

Half = Literal[
    "development",
    "second_development",
    "third_development",
    "fourth_development",
    "fifth_development",
    "test",
]

#: robots of each half; a name that ends in `_four_wheels` is that robot with four wheels
ROBOTS: dict[Half, tuple[str, ...]] = {
    "development": ("alten", "kugle", "rezero_four_wheels"),
    "second_development": ("rob311", "rezero", "cmu"),
    "third_development": ("lantern", "barrel", "scout_four_wheels"),
    "fourth_development": ("kettle", "crane", "sledge_four_wheels"),
    "fifth_development": ("spinner", "mast", "cart_four_wheels"),
    "test": ("heron", "drum", "trolley_four_wheels"),
}
MOTIONS: dict[Half, tuple[str, ...]] = {
    "development": ("hold", "square", "sway", "turn", "wander", "dead_band"),
    "second_development": ("circle", "figure_eight", "sway", "turn", "wander", "dead_band"),
    "third_development": ("patrol", "orbit", "nudges", "dead_band"),
    "fourth_development": ("corners", "slalom", "sentry", "dead_band"),
    "fifth_development": ("errands", "loops", "station", "dead_band"),
    "test": ("delivery", "spirals", "tour", "dead_band"),
}
#: halves whose robots are simulated by the equations of motion, which takes a fraction of the twin's time
BY_EQUATIONS: tuple[Half, ...] = ("third_development", "fourth_development", "fifth_development", "test")
#: first seed of each half, of its recordings and of its teams' habits
RECORDED_SEED: dict[Half, int] = {
    "development": 0,
    "second_development": 100,
    "third_development": 700,
    "fourth_development": 1300,
    "fifth_development": 1900,
    "test": 2500,
}
HABITS_SEED: dict[Half, int] = {
    "development": 0,
    "second_development": 1_000_000,
    "third_development": 7_000_000,
    "fourth_development": 13_000_000,
    "fifth_development": 19_000_000,
    "test": 25_000_000,
}
#: part of the wheels' dry friction that the firmware adds in the duty's direction, in the motion dead_band
COMPENSATED = 0.6
#: [s] of each recording
DURATION = 62.0
#: [kg m^2], in place of a preset's own, which is more than its body could have
WHEEL_INERTIA = {"rob311": 5e-5}
#: [kg], the body that the nominal scenario's friction and noise belong to
NOMINAL_MASS = 17.076
KEPT = Path(__file__).parents[1] / "build" / "mapping_corpus"


@cache
def robot_named(name: str) -> Robot:
    """Return a robot of the corpus as its team would describe it: a preset, one with four wheels, or one of its own."""
    if name in OWN_ROBOTS:
        return OWN_ROBOTS[name]()
    preset = name.removesuffix("_four_wheels")
    robot = Robot.load(preset)
    if preset in WHEEL_INERTIA:
        robot = robot.replace(wheels=replace(robot.wheels, inertia=WHEEL_INERTIA[preset]))
    return robot if preset == name else _with_wheels(robot, count=4, first=0.0)


def _with_wheels(robot: Robot, *, count: int, first: float) -> Robot:
    """Return a robot with so many wheels, evenly, the first at an azimuth [rad]."""
    azimuths = tuple(first + 2.0 * np.pi * k / count for k in range(count))
    friction = robot.friction.__class__.none(count)
    return robot.replace(wheels=replace(robot.wheels, azimuths=azimuths), friction=friction)


def _with_body(robot: Robot, *, mass: float, height: float, slenderness: float) -> Robot:
    """Return a robot with another body.

    Parameters
    ----------
    robot : Robot
    mass : float
        [kg]
    height : float
        Of the centre of mass above the ball's [m].
    slenderness : float
        Inertia about the ball's centre over mass times height squared.
    """
    about = slenderness * mass * height**2
    old = robot.body.inertia
    inertia = (about, about, old[2] * mass / robot.body.mass, 0.0, 0.0, 0.0)
    body = replace(robot.body, mass=mass, center_of_mass=height, inertia=inertia, inertia_about="ball_center")
    return robot.replace(body=body)


def _ball(robot: Robot, *, radius: float, mass: float) -> Ball:
    # between a solid ball's 2/5 and a thin shell's 2/3
    return replace(robot.ball, radius=radius, mass=mass, inertia=0.55 * mass * radius**2)


def _lantern() -> Robot:
    """Return a light robot with a high centre of mass, the first wheel at 20 degrees."""
    robot = _with_body(Robot.load("alten"), mass=9.0, height=0.45, slenderness=1.3)
    robot = robot.replace(
        ball=_ball(robot, radius=0.115, mass=2.2),
        wheels=replace(robot.wheels, radius=0.045, tilt=float(np.radians(42.0)), inertia=6e-4),
        drive=replace(robot.drive, torque_limit=3.5, gear_ratio=30.0),
    )
    return _with_wheels(robot, count=3, first=float(np.radians(20.0)))


def _barrel() -> Robot:
    """Return a heavy robot on a large ball, the first wheel at -40 degrees."""
    robot = _with_body(Robot.load("kugle"), mass=21.0, height=0.5, slenderness=1.2)
    robot = robot.replace(
        ball=_ball(robot, radius=0.14, mass=4.0),
        drive=replace(robot.drive, torque_limit=9.0, gear_ratio=21.0),
        sensors=replace(robot.sensors, encoder_counts=1024),
    )
    return _with_wheels(robot, count=3, first=float(np.radians(-40.0)))


def _scout() -> Robot:
    """Return a low robot with four wheels, the first at 30 degrees."""
    robot = _with_body(Robot.load("rezero"), mass=11.0, height=0.36, slenderness=1.25)
    robot = robot.replace(
        ball=_ball(robot, radius=0.12, mass=2.8),
        drive=replace(robot.drive, torque_limit=4.5, gear_ratio=29.0),
    )
    return _with_wheels(robot, count=4, first=float(np.radians(30.0)))


def _kettle() -> Robot:
    """Return a small robot on a small ball, the first wheel at 75 degrees."""
    robot = _with_body(Robot.load("alten"), mass=6.0, height=0.3, slenderness=1.35)
    robot = robot.replace(
        ball=_ball(robot, radius=0.095, mass=1.3),
        wheels=replace(robot.wheels, radius=0.035, tilt=float(np.radians(40.0)), inertia=2e-4),
        drive=replace(robot.drive, torque_limit=2.5, gear_ratio=19.0),
    )
    return _with_wheels(robot, count=3, first=float(np.radians(75.0)))


def _crane() -> Robot:
    """Return a tall robot with steep wheels, the first at 10 degrees."""
    robot = _with_body(Robot.load("kugle"), mass=14.0, height=0.55, slenderness=1.25)
    robot = robot.replace(
        ball=_ball(robot, radius=0.125, mass=3.0),
        wheels=replace(robot.wheels, tilt=float(np.radians(50.0))),
        drive=replace(robot.drive, torque_limit=7.0, gear_ratio=26.0),
        sensors=replace(robot.sensors, encoder_counts=2000),
    )
    return _with_wheels(robot, count=3, first=float(np.radians(10.0)))


def _sledge() -> Robot:
    """Return a heavy robot with four wheels, the first at 45 degrees."""
    robot = _with_body(Robot.load("rezero"), mass=18.0, height=0.4, slenderness=1.2)
    robot = robot.replace(
        ball=_ball(robot, radius=0.13, mass=3.5),
        drive=replace(robot.drive, torque_limit=6.0, gear_ratio=23.0),
    )
    return _with_wheels(robot, count=4, first=float(np.radians(45.0)))


def _spinner() -> Robot:
    """Return a robot of a teaching laboratory: light, on a basketball, the first wheel at -15 degrees."""
    robot = _with_body(Robot.load("alten"), mass=7.5, height=0.36, slenderness=1.2)
    robot = robot.replace(
        ball=_ball(robot, radius=0.12, mass=0.9),
        wheels=replace(robot.wheels, radius=0.05, tilt=float(np.radians(47.0)), inertia=8e-4),
        drive=replace(robot.drive, torque_limit=3.0, gear_ratio=16.0),
        sensors=replace(robot.sensors, encoder_counts=2048),
    )
    return _with_wheels(robot, count=3, first=float(np.radians(-15.0)))


def _mast() -> Robot:
    """Return a tall and heavy robot on a bowling ball, the first wheel at 50 degrees."""
    robot = _with_body(Robot.load("kugle"), mass=26.0, height=0.62, slenderness=1.15)
    robot = robot.replace(
        ball=_ball(robot, radius=0.11, mass=5.0),
        wheels=replace(robot.wheels, tilt=float(np.radians(43.0))),
        drive=replace(robot.drive, torque_limit=10.0, gear_ratio=24.0),
        sensors=replace(robot.sensors, encoder_counts=1500),
    )
    return _with_wheels(robot, count=3, first=float(np.radians(50.0)))


def _cart() -> Robot:
    """Return a robot that carries a load low, with four wheels, the first at 10 degrees."""
    robot = _with_body(Robot.load("rezero"), mass=15.0, height=0.33, slenderness=1.3)
    robot = robot.replace(
        ball=_ball(robot, radius=0.125, mass=2.4),
        wheels=replace(robot.wheels, tilt=float(np.radians(44.0))),
        drive=replace(robot.drive, torque_limit=5.5, gear_ratio=26.0),
    )
    return _with_wheels(robot, count=4, first=float(np.radians(10.0)))


def _heron() -> Robot:
    """Return a slim robot on a basketball, the first wheel at 100 degrees."""
    robot = _with_body(Robot.load("alten"), mass=8.5, height=0.48, slenderness=1.2)
    robot = robot.replace(
        ball=_ball(robot, radius=0.12, mass=0.62),
        wheels=replace(robot.wheels, radius=0.04, tilt=float(np.radians(45.0)), inertia=4e-4),
        drive=replace(robot.drive, torque_limit=3.0, gear_ratio=22.0),
        sensors=replace(robot.sensors, encoder_counts=1024),
    )
    return _with_wheels(robot, count=3, first=float(np.radians(100.0)))


def _drum() -> Robot:
    """Return a heavy robot of a middle height, the first wheel at -70 degrees."""
    robot = _with_body(Robot.load("kugle"), mass=19.0, height=0.42, slenderness=1.25)
    robot = robot.replace(
        ball=_ball(robot, radius=0.135, mass=3.6),
        wheels=replace(robot.wheels, tilt=float(np.radians(48.0))),
        drive=replace(robot.drive, torque_limit=8.0, gear_ratio=20.0),
        sensors=replace(robot.sensors, encoder_counts=1800),
    )
    return _with_wheels(robot, count=3, first=float(np.radians(-70.0)))


def _trolley() -> Robot:
    """Return a robot with four wheels, the first at 25 degrees."""
    robot = _with_body(Robot.load("rezero"), mass=13.0, height=0.37, slenderness=1.22)
    robot = robot.replace(
        ball=_ball(robot, radius=0.118, mass=2.6),
        wheels=replace(robot.wheels, tilt=float(np.radians(42.0))),
        drive=replace(robot.drive, torque_limit=5.0, gear_ratio=28.0),
    )
    return _with_wheels(robot, count=4, first=float(np.radians(25.0)))


#: robots that are no preset
OWN_ROBOTS = {
    "lantern": _lantern,
    "barrel": _barrel,
    "scout_four_wheels": _scout,
    "kettle": _kettle,
    "crane": _crane,
    "sledge_four_wheels": _sledge,
    "spinner": _spinner,
    "mast": _mast,
    "cart_four_wheels": _cart,
    "heron": _heron,
    "drum": _drum,
    "trolley_four_wheels": _trolley,
}


def recording(half: Half, robot: str, motion: str) -> Log:
    """Return the log of a robot's own sensors, from `KEPT` if it was recorded before."""
    path = KEPT / f"{half}_{robot}_{motion}.parquet"
    if not is_kept(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        _recorded(half, robot, motion).write(path)
    return Log.read(path)


def _recorded(half: Half, name: str, motion: str) -> Log:
    robot = robot_named(name)
    seed = RECORDED_SEED[half] + 10 * ROBOTS[half].index(name) + MOTIONS[half].index(motion)
    base = Scenario.named("nominal", robot)
    heavier = robot.body.mass / NOMINAL_MASS
    scenario = replace(
        base,
        friction=scaled_friction(base.friction, heavier),
        torque_noise=heavier * base.torque_noise,
    )
    plant: Plant = Twin(robot, scenario)
    if half in BY_EQUATIONS:
        plant = SensedPlant(true_model(robot, scenario), imperfections_of(scenario, known=robot))
    controller = nominal_controller(robot)
    if motion == "dead_band":
        controller = FirmwareDeadBand(controller, robot, dead_band(robot))
    log = simulate(plant, controller, _reference(motion, seed), duration=DURATION, seed=seed)
    return log.without_truth()


def dead_band(robot: Robot) -> float:
    """Return the duty that the firmware adds, in the motion dead_band."""
    heavier = robot.body.mass / NOMINAL_MASS
    dry = float(np.mean(Scenario.named("nominal", robot).friction.coulomb))
    return COMPENSATED * heavier * dry / robot.drive.torque_limit


class FirmwareDeadBand:
    """A controller behind a firmware that adds to each duty, in its direction."""

    def __init__(self, controller: Controller, robot: Robot, added: float) -> None:
        self.controller, self.sample_time, self.added = controller, controller.sample_time, added
        self.robot, self.model = robot, Model(robot)

    def reset(self) -> None:
        """Start anew."""
        self.controller.reset()

    def update(
        self, t: float, state: NDArray[np.float64], reference: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the torques (n,) that reach the wheels [N m]."""
        torques = self.controller.update(t, state, reference)
        speeds = self.model.wheel_speed(state[:5], state[5:])
        duty = commands(self.robot, torques, speeds, "duty")
        return torques + self.added * self.robot.drive.torque_limit * np.sign(duty)


def _reference(motion: str, seed: int) -> Reference:
    random = np.random.default_rng([15, seed])
    size = random.uniform(0.3, 0.8)  # [m]
    if motion == "hold":
        return hold()
    if motion == "square":
        return square(side=0.6 * size, period=random.uniform(16.0, 32.0))
    if motion == "circle":
        return circle(radius=0.5 * size, period=random.uniform(12.0, 24.0))
    if motion == "figure_eight":
        return figure_eight(length=size, width=0.5 * size, period=random.uniform(16.0, 32.0))
    if motion == "turn":
        turn = random.uniform(0.5 * np.pi, np.pi)
        return change_pose(x=size, y=-0.5 * size, psi=turn, at=6.0, ramp=40.0)
    if motion in ("patrol", "orbit", "nudges"):
        return _path(motion, random, size)
    if motion in ("corners", "slalom", "sentry"):
        return _round(motion, random, size)
    if motion in ("errands", "loops", "station"):
        return _errand(motion, random, size)
    if motion in ("delivery", "spirals", "tour"):
        return _on_the_move(motion, random, size)
    return _sway(random, heading=0.6 if motion == "sway" else 0.2)


def _path(motion: str, random: np.random.Generator, size: float) -> Reference:
    """Return a reference along a path of a size [m], which begins at rest."""
    slow, way, turn = random.uniform(0.25, 0.5), random.uniform(0.0, 2.0 * np.pi), random.uniform(0.4, 1.0)
    places = size * random.uniform(-0.4, 0.4, (20, 2)) @ np.array([1.0, 1j])

    def reference(t: float) -> NDArray[np.float64]:
        pose, now, start = np.zeros(10), slow * t, min(t / 5.0, 1.0)
        if motion == "patrol":
            # along a line, to and fro, and turned at its ends
            place = 0.7 * size * np.sin(now) * np.exp(1j * way)
            pose[4] = turn * start * np.tanh(3.0 * np.cos(now))
        elif motion == "orbit":
            # around a circle and back, which the heading follows
            angle = 2.0 * np.sin(0.7 * now)
            place = 0.5 * size * (np.exp(1j * angle) - 1.0) * np.exp(1j * way)
            pose[4] = 0.5 * start * angle
        else:
            # stands, and is sent to another place near by every 6 s
            last, part = int(t // 6.0), np.clip((t % 6.0) / 1.5, 0.0, 1.0)
            smooth = part * part * (3.0 - 2.0 * part)
            place = (1.0 - smooth) * places[last] + smooth * places[last + 1]
            pose[4] = 0.3 * turn * start * np.sin(0.9 * now)
        place = start * place
        pose[:2] = place.real, place.imag
        return pose

    return reference


def _round(motion: str, random: np.random.Generator, size: float) -> Reference:
    """Return a reference of a robot on duty, of a size [m], which begins at rest."""
    slow, way, turn = random.uniform(0.25, 0.5), random.uniform(0.0, 2.0 * np.pi), random.uniform(0.4, 1.0)
    corners = 0.5 * size * (np.exp(2j * np.pi * np.arange(4) / 3.0) - 1.0) * np.exp(1j * way)

    def reference(t: float) -> NDArray[np.float64]:
        pose, now, start = np.zeros(10), slow * t, min(t / 5.0, 1.0)
        if motion == "corners":
            # goes from corner to corner of a triangle, stops for 2 s at each, and looks about
            last, part = int(t // 6.0) % 3, np.clip((t % 6.0) / 4.0, 0.0, 1.0)
            smooth = part * part * (3.0 - 2.0 * part)
            place = (1.0 - smooth) * corners[last] + smooth * corners[last + 1]
            pose[4] = 0.5 * turn * start * np.sin(0.6 * now)
        elif motion == "slalom":
            # to and fro, three times as often across as along, headed where it goes
            place = 0.5 * size * (np.sin(now) + 0.3j * np.sin(3.0 * now)) * np.exp(1j * way)
            pose[4] = 0.6 * turn * start * np.cos(3.0 * now)
        else:
            # keeps its place but for a few centimetres, and turns to and fro
            place = 0.1 * size * (np.sin(1.7 * now) + 1j * np.sin(1.1 * now)) * np.exp(1j * way)
            pose[4] = turn * start * np.sin(now)
        place = start * place
        pose[:2] = place.real, place.imag
        return pose

    return reference


def _errand(motion: str, random: np.random.Generator, size: float) -> Reference:
    """Return a reference of a robot that is sent about, of a size [m], which begins at rest."""
    slow, way, turn = random.uniform(0.25, 0.5), random.uniform(0.0, 2.0 * np.pi), random.uniform(0.4, 1.0)
    places = size * random.uniform(-0.5, 0.5, (30, 2)) @ np.array([1.0, 1j])
    looks = turn * random.uniform(-1.0, 1.0, 30)

    def reference(t: float) -> NDArray[np.float64]:
        pose, now, start = np.zeros(10), slow * t, min(t / 5.0, 1.0)
        if motion == "errands":
            # to another place every 5 s, without a stop, and to another heading in every second of them
            last, part = int(t // 5.0), (t % 5.0) / 5.0
            smooth = part * part * (3.0 - 2.0 * part)
            place = (1.0 - smooth) * places[last] + smooth * places[last + 1]
            before, after = looks[last // 2], looks[(last + 1) // 2]
            pose[4] = start * ((1.0 - smooth) * before + smooth * after)
        elif motion == "loops":
            # a rosette of three leaves, with a heading that follows slowly
            place = 0.5 * size * np.sin(3.0 * now) * np.exp(1j * (now + way))
            pose[4] = 0.8 * turn * start * np.sin(0.8 * now)
        else:
            # stands where it is for 8 s, and moves on by a few centimetres
            last, part = int(t // 8.0), np.clip((t % 8.0) / 2.0, 0.0, 1.0)
            smooth = part * part * (3.0 - 2.0 * part)
            place = 0.25 * ((1.0 - smooth) * places[last] + smooth * places[last + 1])
            pose[4] = 0.25 * start * ((1.0 - smooth) * looks[last] + smooth * looks[last + 1])
        place = start * place
        pose[:2] = place.real, place.imag
        return pose

    return reference


def _on_the_move(motion: str, random: np.random.Generator, size: float) -> Reference:
    """Return a reference of a robot that never stands, of a size [m], which begins at rest."""
    slow, way, turn = random.uniform(0.35, 0.6), random.uniform(0.0, 2.0 * np.pi), random.uniform(0.4, 1.0)
    phases = random.uniform(0.0, 2.0 * np.pi, 3)

    def reference(t: float) -> NDArray[np.float64]:
        pose, now, start = np.zeros(10), slow * t, min(t / 5.0, 1.0)
        if motion == "delivery":
            # a closed path of two loops across and three along, headed to and fro
            place = 0.4 * size * (np.sin(2.0 * now) + 1j * np.sin(3.0 * now + phases[0])) * np.exp(1j * way)
            pose[4] = turn * start * np.sin(0.7 * now)
        elif motion == "spirals":
            # out and in again around a point, with a heading that follows in part
            place = 0.6 * size * np.sin(0.4 * now + 0.3) * np.exp(1j * (1.5 * now + way))
            pose[4] = 0.7 * turn * start * np.sin(1.5 * now + phases[1])
        else:
            # two slow sways and a quicker one of a few centimetres, now and then turned
            slower = np.sin(0.8 * now + phases[0]) + 1j * np.sin(0.55 * now + phases[1])
            place = size * (0.35 * slower * np.exp(1j * way) + 0.05 * np.exp(1j * (4.0 * now + phases[2])))
            pose[4] = 0.8 * turn * start * np.sin(0.5 * now) ** 3
        place = start * place
        pose[:2] = place.real, place.imag
        return pose

    return reference


def _sway(random: np.random.Generator, *, heading: float) -> Reference:
    """Return a reference that moves to and fro in all directions and turns its heading."""
    rates, phases = random.uniform(0.5, 1.5, 3), random.uniform(0.0, 2.0 * np.pi, 3)  # [rad/s], [rad]
    amplitudes = np.array([*random.uniform(0.1, 0.25, 2), heading])

    def reference(t: float) -> NDArray[np.float64]:
        pose = np.zeros(10)
        # starts from rest at the origin
        start = min(t / 3.0, 1.0)
        pose[[0, 1, 4]] = start * amplitudes * np.sin(rates * t + phases)
        return pose

    return reference
