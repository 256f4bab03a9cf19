"""The recorded logs of `campaigns.mapping_corpus`: robots and motions.

Presets are recorded by the twin. Robots of their own are simulated by the equations of motion with the twin's sensors,
play, torque noise and friction, which takes a fraction of its time. Recorded logs are kept in build/mapping_corpus and
are not recorded again. Constants of the search and of the checks were chosen on earlier recordings of these robots, of
other motions and seeds: the development halves.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.presets import nominal_controller
from ballbot.control.references import Reference, change_pose, figure_eight, hold, square
from ballbot.log import Log
from ballbot.log.mapping_search.commands import assumed_resistance
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.components import scaled_friction
from ballbot.simulation.plant import Plant
from ballbot.simulation.run import simulate
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin import Scenario, Twin
from ballbot.twin.imperfections import imperfections_of, true_model
from tests.support.foreign_logs import commands

Floats = NDArray[np.float64]

#: a name that ends in `_four_wheels` is that robot with four wheels
PRESETS = ("alten", "kugle", "rezero_four_wheels", "rob311", "rezero", "cmu")
MOTIONS = ("hold", "square", "figure_eight", "turn", "tour", "dead_band")
#: first seed of the recordings
RECORDED_SEED = 5000
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
    """Return a robot of the corpus as its team would describe it: a preset, one with four wheels, or one of its own.

    Full duty at standstill gives the torque limit.
    """
    robot = _own_robot(name) or _preset(name)
    drive = replace(robot.drive, resistance=0.0)
    return robot.replace(drive=replace(drive, resistance=assumed_resistance(drive)))


def _preset(name: str) -> Robot:
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


#: robots that are no preset, as a preset with another body, ball, wheels and drive: masses [kg], lengths [m], angles
#: [deg], the torque limit [N m]. Slenderness is the inertia about the ball's centre over mass times height squared,
#: height that of the centre of mass above the ball's, `first` the azimuth of wheel 1; - keeps the preset's own
OWN_ROBOTS = """
name                preset mass height slenderness r_ball m_ball radius inertia tilt limit gear counts wheels first
lantern             alten  9.0  0.45   1.3         0.115  2.2    0.045  6e-4    42   3.5   30   -      3      20
barrel              kugle  21.0 0.5    1.2         0.14   4.0    -      -       -    9.0   21   1024   3      -40
scout_four_wheels   rezero 11.0 0.36   1.25        0.12   2.8    -      -       -    4.5   29   -      4      30
kettle              alten  6.0  0.3    1.35        0.095  1.3    0.035  2e-4    40   2.5   19   -      3      75
crane               kugle  14.0 0.55   1.25        0.125  3.0    -      -       50   7.0   26   2000   3      10
sledge_four_wheels  rezero 18.0 0.4    1.2         0.13   3.5    -      -       -    6.0   23   -      4      45
spinner             alten  7.5  0.36   1.2         0.12   0.9    0.05   8e-4    47   3.0   16   2048   3      -15
mast                kugle  26.0 0.62   1.15        0.11   5.0    -      -       43   10.0  24   1500   3      50
cart_four_wheels    rezero 15.0 0.33   1.3         0.125  2.4    -      -       44   5.5   26   -      4      10
heron               alten  8.5  0.48   1.2         0.12   0.62   0.04   4e-4    45   3.0   22   1024   3      100
drum                kugle  19.0 0.42   1.25        0.135  3.6    -      -       48   8.0   20   1800   3      -70
trolley_four_wheels rezero 13.0 0.37   1.22        0.118  2.6    -      -       42   5.0   28   -      4      25
"""


def _own_robot(name: str) -> Robot | None:
    """Return the robot of a row of `OWN_ROBOTS`; None without one."""
    headings, *rows = (line.split() for line in OWN_ROBOTS.strip().splitlines())
    row = next((cells for cells in rows if cells[0] == name), None)
    if row is None:
        return None
    robot = Robot.load(row[1])
    given = {key: float(value) for key, value in zip(headings[2:], row[2:], strict=True) if value != "-"}
    mass, height, old = given["mass"], given["height"], robot.body
    about = given["slenderness"] * mass * height**2
    inertia = (about, about, old.inertia[2] * mass / old.mass, 0.0, 0.0, 0.0)
    radius, ball_mass = given["r_ball"], given["m_ball"]
    wheels = robot.wheels
    robot = robot.replace(
        body=replace(old, mass=mass, center_of_mass=height, inertia=inertia, inertia_about="ball_center"),
        # between a solid ball's 2/5 and a thin shell's 2/3
        ball=replace(robot.ball, radius=radius, mass=ball_mass, inertia=0.55 * ball_mass * radius**2),
        wheels=replace(
            wheels,
            radius=given.get("radius", wheels.radius),
            inertia=given.get("inertia", wheels.inertia),
            tilt=float(np.radians(given["tilt"])) if "tilt" in given else wheels.tilt,
        ),
        drive=replace(robot.drive, torque_limit=given["limit"], gear_ratio=given["gear"]),
        sensors=replace(robot.sensors, encoder_counts=int(given.get("counts", robot.sensors.encoder_counts))),
    )
    return _with_wheels(robot, count=int(given["wheels"]), first=float(np.radians(given["first"])))


#: every robot of the corpus
ROBOTS = (*PRESETS, *(line.split()[0] for line in OWN_ROBOTS.strip().splitlines()[1:]))


def recording(robot: str, motion: str) -> Log:
    """Return the log of a robot's own sensors, from `KEPT` if it was recorded before."""
    path = KEPT / f"{robot}_{motion}.parquet"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        _recorded(robot, motion).write(path)
    return Log.read(path)


def _recorded(name: str, motion: str) -> Log:
    robot = robot_named(name)
    seed = RECORDED_SEED + 10 * ROBOTS.index(name) + MOTIONS.index(motion)
    base = Scenario.named("nominal", robot)
    heavier = robot.body.mass / NOMINAL_MASS
    friction = scaled_friction(base.friction, heavier)
    scenario = replace(base, friction=friction, torque_noise=heavier * base.torque_noise)
    plant: Plant = Twin(robot, scenario)
    if name not in PRESETS:
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

    def update(self, t: float, state: Floats, reference: Floats) -> Floats:
        """Return the torques (n,) that reach the wheels [N m]."""
        torques = self.controller.update(t, state, reference)
        speeds = self.model.wheel_speed(state[:5], state[5:])
        duty = commands(self.robot, torques, speeds, "duty")
        return torques + self.added * self.robot.drive.torque_limit * np.sign(duty)


def _reference(motion: str, seed: int) -> Reference:
    random = np.random.default_rng([15, seed])
    size, turn = random.uniform(0.3, 0.8), random.uniform(0.5, 1.0)  # [m], [rad]
    slow, way, *phases = random.uniform([0.25, *[0.0] * 4], [0.6, *[2.0 * np.pi] * 4])
    match motion:
        case "hold":
            return hold()
        case "square":
            return square(side=0.6 * size, period=random.uniform(16.0, 32.0))
        case "figure_eight":
            return figure_eight(length=size, width=0.5 * size, period=random.uniform(16.0, 32.0))
        case "turn":
            return change_pose(x=size, y=-0.5 * size, psi=np.pi * turn, at=6.0, ramp=40.0)

    def tour(t: float) -> Floats:
        """Two slow sways and a quicker one of a few centimetres, now and then turned, from rest."""
        now, pose = slow * t, np.zeros(10)
        slower = np.sin(0.8 * now + phases[0]) + 1j * np.sin(0.55 * now + phases[1])
        position = size * (0.35 * slower * np.exp(1j * way) + 0.05 * np.exp(1j * (4.0 * now + phases[2])))
        pose[[0, 1, 4]] = min(t / 5.0, 1.0) * np.array(
            [position.real, position.imag, turn * np.sin(0.5 * now) ** 3]
        )
        return pose

    return tour
