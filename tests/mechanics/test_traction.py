"""The largest torque that the grip transmits, beside the loop's search for the friction that a wheel needs."""

import numpy as np
import pytest

from ballbot.control.lqr import frictionless_model
from ballbot.mechanics.geometry import wheel_load
from ballbot.mechanics.traction import pack_contacts, torques_of_lean, traction_torque
from ballbot.robot import Robot
from ballbot.simulation.model_plant import friction_needed_along


@pytest.mark.parametrize("grip", [0.4, 0.9])
@pytest.mark.parametrize("name", ["alten", "cmu", "rob311"])
def test_traction_torque_is_where_a_wheel_of_a_caught_fall_slips(name: str, grip: float):
    robot = Robot.load(name)
    model, falls = frictionless_model(robot), np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    directions = np.stack([np.cos(falls), np.sin(falls)], axis=-1)
    held = directions @ torques_of_lean(model).T
    largest = traction_torque(model, grip) / np.abs(held).max(axis=1)  # the lean of that torque, by direction

    def needed(share: float) -> float:
        states, found = np.zeros((48, 10)), np.zeros(48)
        states[:, 2:4] = share * largest[:, None] * directions
        torques = share * largest[:, None] * held
        friction_needed_along(model.selected, model.packed, pack_contacts(robot), states, torques, found)
        return found.max()

    # the first order in leans of up to 0.7 rad is within 5 %
    assert needed(0.95) < grip < needed(1.05)


def test_a_small_grip_transmits_itself_times_the_load_at_rest():
    light = Robot.load("alten").replace(
        {"wheels.inertia": 0.0, "drive.motor_inertia": 0.0, "drive.gear_inertia": 0.0}
    )
    at_rest = 1e-3 * wheel_load(light) * light.wheels.radius
    # the lean that 0.001 of the load holds moves 1 % of it at most
    assert traction_torque(frictionless_model(light), 1e-3) == pytest.approx(at_rest, rel=0.01)
