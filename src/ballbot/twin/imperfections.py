"""A twin's scenario on the equations of motion: its sensors, delay, play, torque noise and floor.

    plant = SensedPlant(Model(robot), imperfections_of(scenario), known=robot)

Not used, because the equations have their own or none: rollers and wheel contact, grip, `contact_time`, `timestep`,
and friction, which is the model's (`true_model` returns the model with the scenario's friction). A fault that the
equations cannot have is refused.
"""

from __future__ import annotations

from ballbot.errors import InputError
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.imperfections import Imperfections
from ballbot.twin.mjcf import floor_normal
from ballbot.twin.scenario import Scenario

#: faults of a scenario that the equations of motion do not have
_BEYOND = (
    "asymmetry",
    "driveline_laws",
    "load_dependence",
    "softness",
    "compliance",
    "current_loop",
    "supply",
    "payload",
    "roughness",
    "pushes",
)


def imperfections_of(scenario: Scenario) -> Imperfections:
    """Return a scenario's sensors, delay, play, torque noise, floor and fallen lean, for a `SensedPlant`.

    Raises
    ------
    InputError
        If the scenario has a fault that the equations of motion cannot have: one of those above, or a jitter.
    """
    beyond = [name for name in _BEYOND if getattr(scenario, name)]
    if scenario.timing is not None and scenario.timing.jitter > 0:
        beyond.append("timing.jitter")
    if beyond:
        raise InputError(
            f"scenario {scenario.name!r} has {', '.join(beyond)}, which the equations of motion do not have; switch it "
            "off, or run the scenario on the twin (ballbot record)."
        )
    normal = floor_normal(scenario)
    return Imperfections(
        sensors=scenario.sensors,
        speed_window=scenario.speed_window,
        sensor_faults=scenario.sensor_faults,
        accelerometer=scenario.accelerometer,
        fix=scenario.fix,
        delay=scenario.timing.delay if scenario.timing else 0,
        torque_noise=scenario.torque_noise,
        backlash=scenario.backlash,
        slope=(float(-normal[0] / normal[2]), float(-normal[1] / normal[2])),
        fallen_lean=scenario.fallen_lean,
    )


def true_model(robot: Robot, scenario: Scenario) -> Model:
    """Return the model of a twin: the robot with the scenario's friction of drivelines and rolling.

    The ball does not pivot; on the twin it pivots little. Other faults of the scenario are not in the model.
    """
    return Model(robot.replace(friction=scenario.friction))
