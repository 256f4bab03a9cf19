"""A twin's scenario on the equations of motion: the same file drives the compiled loop and the twin.

    model, imperfections = true_model(robot, scenario), imperfections_of(scenario)
    simulate_batch(model, controller, reference, duration=20.0, imperfections=imperfections)

`true_model` has what belongs to the robot, friction and payload; `imperfections_of` its sensors, drive, floor and
pushes. Faults that the equations of motion do not have are left out; `left_out` names them for a report.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbot.estimation.interface import EstimatorName
from ballbot.mechanics.geometry import rotation_to
from ballbot.mechanics.model import Model
from ballbot.robot import Body, Friction, Robot
from ballbot.simulation.imperfections import Grip, Imperfections, Later, RollerContacts
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin.faults import Payload
from ballbot.twin.mjcf import floor_normal
from ballbot.twin.parts import point_inertia
from ballbot.twin.scenario import Scenario
from ballbot.twin.scenario_file import load_scenario

#: what a scenario may have and the equations of motion do not, and how it is called in a report
_BEYOND = {
    "softness": "the ball's softness",
    "compliance": "the drivelines' resonance",
}


def with_identified(scenario: Scenario, friction: Friction) -> Scenario:
    """Return a scenario with identified friction; if that contains the rollers' losses, wheels touch in a point.

    They would otherwise count twice.
    """
    contact = scenario.wheel_contact if friction.roller_softness else "point"
    return replace(scenario, friction=friction, wheel_contact=contact)


def left_out(scenario: Scenario, *, identified: bool = False) -> tuple[str, ...]:
    """Return what the equations of motion leave out of a scenario, in words for a report.

    Slip of the contacts is named always: `roller_grip` and `floor_grip` of a scenario are finite. `identified` as in
    `with_identified`.
    """
    beyond = [words for name, words in _BEYOND.items() if getattr(scenario, name)]
    if identified and scenario.wheel_contact == "rollers":
        beyond.append("the rollers' passing, but for what the identified friction contains")
    return (*beyond, "slip of wheels and ball")


def imperfections_of(scenario: Scenario, *, known: Robot | None = None, slips: bool = False) -> Imperfections:
    """Return a scenario's sensors, drive, floor and pushes; `left_out` names what is not among them.

    `known` is the robot that the estimator knows; the true one by default. With `slips` wheels and ball slip beyond the
    scenario's grip.
    """
    normal = floor_normal(scenario)
    timing, loop = scenario.timing, scenario.current_loop
    soft = scenario.softness
    contacts = RollerContacts(
        rollers=scenario.rollers,
        grip=scenario.roller_grip,
        contact_time=scenario.contact_time,
        softness=scenario.friction.roller_softness or 1.0,
    )
    if soft:
        contacts = replace(contacts, give=1.0 / soft.stiffness, relaxation=soft.damping / soft.stiffness)
    return Imperfections(
        sensors=scenario.sensors,
        speed_window=scenario.speed_window,
        sensor_faults=scenario.sensor_faults,
        accelerometer=scenario.accelerometer,
        fix=scenario.fix,
        delay=timing.delay if timing else 0,
        jitter=timing.jitter if timing else 0.0,
        torque_noise=scenario.torque_noise,
        lag=1.0 / (2.0 * math.pi * loop.bandwidth) if loop else 0.0,
        supply=scenario.supply,
        backlash=scenario.backlash,
        contacts=contacts if scenario.wheel_contact == "rollers" else None,
        grip=Grip(wheels=scenario.roller_grip, floor=scenario.floor_grip) if slips else None,
        load_dependence=scenario.load_dependence.fraction if scenario.load_dependence else 0.0,
        slope=(float(-normal[0] / normal[2]), float(-normal[1] / normal[2])),
        imbalance=_imbalance(scenario.at(0.0)),
        pushes=scenario.pushes,
        roughness=scenario.roughness,
        fallen_lean=scenario.fallen_lean,
        known=known,
    )


def _imbalance(scenario: Scenario) -> tuple[float, float]:
    payload = scenario.payload
    return (payload.mass * payload.position[0], payload.mass * payload.position[1]) if payload else (0.0, 0.0)


def changes_of(robot: Robot, scenario: Scenario) -> tuple[Later, ...]:
    """Return how a scenario's payload and floor change after the start, with the robot's own friction of the wheels."""
    stages = [(t, scenario.at(t)) for t in scenario.changes()]
    return tuple(
        Later(time=t, model=true_model(robot, stage), imbalance=_imbalance(stage)) for t, stage in stages
    )


def sensed(model: Model, scenario: Scenario | str | Path, *, estimator: EstimatorName) -> SensedPlant:
    """Return a model with its own friction behind a scenario's sensors, drive, floor and payload."""
    identified = with_identified(load_scenario(scenario, model.robot), model.robot.friction)
    robot = model.robot
    start = true_model(robot, identified)
    pivoting = start.pivoting if model.pivoting is None and model.formulation == "exact" else model.pivoting
    true = Model(start.robot, model.formulation, model.step, pivoting)
    imperfections = replace(imperfections_of(identified, known=robot), later=changes_of(robot, identified))
    return SensedPlant(true, imperfections, estimator=estimator)


def true_model(robot: Robot, scenario: Scenario) -> Model:
    """Return the model of a twin at the start: the robot with the scenario's friction, of the floor too, and payload.

    The ball pivots if the friction says how; else it does not, where on the twin it pivots little.
    """
    start = scenario.at(0.0)
    body = loaded_body(robot.body, start.payload) if start.payload else robot.body
    true = robot.replace(friction=start.friction, body=body)
    return Model(true, pivoting=true.pivoting_torque)


def loaded_body(body: Body, payload: Payload) -> Body:
    """Return a body with a payload, about the axis through their common centre of mass."""
    position = np.array(payload.position)
    mass = body.mass + payload.mass
    moment = payload.mass * position + [0.0, 0.0, body.mass * body.center_of_mass]
    solid = 0.4 * payload.radius**2 * np.eye(3)
    inertia = body.inertia_about_ball_center() + payload.mass * (point_inertia(position) + solid)
    turn = rotation_to(moment)
    J = turn.T @ inertia @ turn
    return replace(
        body,
        mass=mass,
        center_of_mass=float(np.linalg.norm(moment) / mass),
        inertia=(J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]),
        inertia_about="ball_center",
    )
