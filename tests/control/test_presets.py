"""Kinds of controllers: each is one file, found by its name wherever a controller is named."""

from dataclasses import replace
from math import factorial

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot.control.controller import Controller, catching_torque_limit, grip_torque_limit
from ballbot.control.linear import refuse_without_margin
from ballbot.control.lqr import frictionless_model
from ballbot.control.presets import KINDS, design_gain, nominal_controller, precise_controller
from ballbot.control.references import hold
from ballbot.control.source import NAMED_CONTROLLERS, named_controller
from ballbot.errors import InputError
from ballbot.mechanics.model import Model
from ballbot.robot import Friction, Robot, as_robot
from ballbot.robot.components import scaled_friction
from ballbot.robot.wheel_directions import rolling_directions
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Push
from ballbot.simulation.run import initial_state_of
from ballbot.twin.imperfections import with_identified
from ballbot.twin.scenario import Scenario, assumed_friction
from ballbot.workflows.controller_design import GainOptions, design_controller
from ballbot.workflows.grid import LoopRobot
from tests.support.control_examples import FRICTION, alten

PRESETS = ("alten", "cmu", "kugle", "rezero", "rob311")


@pytest.mark.parametrize("name", KINDS)
def test_kind_is_made_designed_and_compared_by_its_name(name):
    made = named_controller(name, alten(FRICTION))
    designed = design_controller(alten(FRICTION), gain=GainOptions(kind=name)).controller
    assert made.packed.tolist() == designed.packed.tolist()
    assert made.compensation == KINDS[name].compensation
    assert name == "nominal" or name in NAMED_CONTROLLERS


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", PRESETS)
def test_kind_is_designed_for_every_preset_and_balances_it(name, kind):
    robot = as_robot(name)
    controller = design_controller(robot, gain=GainOptions(kind=kind)).controller
    start = np.zeros(10)
    start[2:4] = 0.03, -0.02
    batch = simulate_batch(Model(robot), controller, hold(), duration=3.0, initial_states=[start])
    assert np.abs(batch.states[0, -1, 2:4]).max() < 0.01


def test_friction_that_is_not_certain_is_no_fall_of_a_light_robot():
    # break-away of 0.18 N m, more than the 0.15 N m that its wheels' grip transmits; a third is certain
    true = Friction(
        viscous=(0.013,) * 3,
        coulomb=(0.13,) * 3,
        stribeck=(0.05,) * 3,
        stribeck_speed=0.6,
        stribeck_exponent=1.0,
        rolling=0.007,
    )
    robot = as_robot("rob311").replace(friction=true)
    controller = precise_controller(robot, compensated=scaled_friction(true, 1.0 / 3.0))
    plant = LoopRobot.of(robot, Scenario.nominal(robot), known=robot)
    starts = np.zeros((8, 10))
    starts[:, 2], starts[:, 3] = (0.02 * f(np.arange(8) * np.pi / 4.0) for f in (np.cos, np.sin))
    batch = simulate_batch(
        plant.model,
        controller,
        hold(),
        duration=8.0,
        initial_states=starts,
        imperfections=plant.imperfections,
    )
    assert batch.survived.all()
    assert np.abs(batch.states[:, :, :2]).max() < 0.03


def test_torque_limit_of_motors_on_a_duty_leaves_what_a_catch_at_speed_needs():
    robot = alten(FRICTION)
    assert catching_torque_limit(robot, FRICTION) == grip_torque_limit(robot)
    top = robot.drive.torque_limit / robot.drive.top_speed  # of such a motor nothing is left at top speed
    by_duty = replace(FRICTION, viscous=(top,) * 3)
    robot = alten(by_duty)
    # the lean of 0.14 rad needs 1.35 N m, 7 % more once they act, of motors that may give 85 %; friction takes 0.18; at
    # 1 m/s, 11.1 rad/s of a wheel, 2.4 are lost
    assert catching_torque_limit(robot, by_duty) == pytest.approx(1.07 * 1.35 / 0.85 + 0.18 + 2.4, rel=0.01)
    assert catching_torque_limit(robot, by_duty) > 1.7 * grip_torque_limit(robot)


def test_soft_gain_is_refused_where_the_back_emf_makes_it_unstable():
    """The nominal kind counts the back-EMF; a gain of one's own that does not is refused, and falls."""
    robot = alten()
    by_duty = alten(replace(FRICTION, viscous=(robot.drive.torque_limit / robot.drive.top_speed,) * 3))
    without = Controller(by_duty, design_gain(robot).gain)
    with pytest.raises(InputError, match="The viscous friction of the robot 'alten'"):
        refuse_without_margin(without)
    fitted = design_controller(by_duty).controller
    kept = [
        simulate_batch(Model(by_duty), tried, hold(), duration=20.0, initial_states=[initial_state_of(1)])
        for tried in (without, fitted, nominal_controller(by_duty, compensation="full"))
    ]
    assert [bool(batch.survived[0]) for batch in kept] == [False, True, True]


@pytest.mark.parametrize(("name", "limit"), [("alten", 0.5), ("rob311", 0.053)])
def test_the_observer_adds_no_more_than_a_share_of_what_the_robot_may_command(name: str, limit: float):
    robot = as_robot(name).replace(friction=assumed_friction(name))
    observer = precise_controller(robot).parts.disturbance_observer
    assert observer is not None
    assert observer.limit == pytest.approx(limit, rel=0.02)


@pytest.mark.parametrize("name", ["alten", "rob311"])
def test_a_motion_that_changes_into_braking_asks_no_more_than_the_motors_have(name: str):
    robot = as_robot(name).replace(friction=assumed_friction(name))
    controller = precise_controller(robot)
    shaping, needed = controller.parts.shaping, controller.record["feed_forward"][0]
    assert shaping is not None
    a, g = shaping.acceleration_limit, np.linspace(0.0, 20.0, 2001)
    # s'' and s'''' as five lags follow a change from the limit of acceleration to 0.875 of it backward
    parts = [g**k / factorial(k) * np.exp(-g) for k in range(5)]
    second = a * (1.0 - 1.875 * (1.0 - np.sum(parts, axis=0)))
    fourth = -1.875 * a * shaping.frequency**2 * (parts[3] - parts[4])
    torques = second[:, None, None] * needed["by_second"] + fourth[:, None, None] * needed["by_fourth"]
    largest = np.linalg.norm(torques, axis=2).max()
    left = grip_torque_limit(robot) - max(robot.friction.breakaway)
    assert 0.98 * left < largest < 1.005 * left  # settings have three digits


def gripping(grip: float, deviation: float = 0.0) -> Robot:
    robot = alten(FRICTION).replace({"wheels.grip": grip})
    return robot.annotated(standard_deviations={"wheels.grip": deviation} if deviation else {})


def test_grip_raises_the_torque_limit_only_with_a_standard_deviation():
    unknown = grip_torque_limit(alten(FRICTION))
    assert grip_torque_limit(gripping(1.0)) == unknown
    assert grip_torque_limit(gripping(0.3)) < unknown
    assert grip_torque_limit(gripping(1.0, 0.1)) > 1.2 * unknown
    assert grip_torque_limit(gripping(1.0, 0.1)) == pytest.approx(grip_torque_limit(gripping(0.9, 0.05)))


def survivors(controller: Controller, impulse: float) -> int:
    """Return of how many pushes from eight directions a robot recovers on the loop."""
    robot, heading = controller.robot, 2.0 * np.pi * np.arange(8) / 8.0
    nominal = with_identified(Scenario.nominal(robot), robot.friction)
    plants = [
        LoopRobot.of(
            robot,
            replace(nominal, pushes=(Push.of_impulse(impulse, d, time=1.0, duration=0.1, height=0.4),)),
            known=robot,
        )
        for d in heading
    ]
    batch = simulate_batch(
        plants[0].model,
        controller,
        hold(),
        duration=6.0,
        initial_states=np.zeros((8, 10)),
        imperfections=[plant.imperfections for plant in plants],
        every=0,
    )
    return int(batch.survived.sum())


def test_a_robot_of_known_grip_recovers_from_larger_pushes():
    assert [survivors(precise_controller(alten(FRICTION)), size) for size in (29.0, 34.0)] == [8, 0]
    assert survivors(precise_controller(gripping(1.0, 0.1)), 34.0) == 8


@pytest.mark.parametrize("name", ["alten", "kugle", "rob311"])
def test_with_the_cap_raised_a_robot_drives_at_what_its_motors_have(name: str):
    robot = as_robot(name).replace(friction=assumed_friction(name))
    controller = precise_controller(robot)
    shaping = controller.parts.shaping
    assert shaping is not None
    assert controller.record["shaping"]["speed"][0] == min(2.0, shaping.speed_limit)
    raised = controller.with_parts(replace(controller.parts, shaping=replace(shaping, speed_cap=100.0)))
    # a wheel turns fastest where the robot drives along its rolling; friction and a lean take 1 % of its speed or more
    along = rolling_directions(robot.wheels.azimuths)[0]
    turns = np.cos(robot.wheels.tilt) / robot.wheels.radius
    wanted = 0.85 * 0.99 * robot.drive.top_speed / turns

    def drive(t: float) -> NDArray[np.float64]:
        reference, rise = np.zeros(10), 2.0 * wanted  # 0.5 m/s^2
        reference[:2] = along[:2] * wanted * (t - 0.5 * rise if t > rise else 0.5 * t * t / rise)
        return reference

    plant = LoopRobot.of(robot, with_identified(Scenario.nominal(robot), robot.friction), known=robot)
    batch = simulate_batch(
        plant.model,
        raised,
        drive,
        duration=2.0 * wanted + 12.0,
        initial_states=[initial_state_of(seed) for seed in range(4)],
        imperfections=plant.imperfections,
        every=20,
    )
    assert batch.survived.all()
    seconds = (batch.states[:, -100:, 5:7] @ along[:2]).reshape(4, 10, 10).mean(axis=2)
    assert (seconds.max(axis=1) > 0.99 * wanted).all()


@pytest.mark.parametrize("name", PRESETS)
def test_nominal_gain_is_at_most_twice_as_fast_as_the_robot_falls(name):
    robot = as_robot(name)
    falling = np.linalg.eigvals(frictionless_model(robot).linearize().A).real.max()
    by_rule, fixed = design_gain(robot), design_gain(robot, torque_weight=30.0)
    assert np.abs(by_rule.poles).max() <= 2.0 * falling
    # the frozen gain where it is slow enough, as on all presets but the light robot with strong motors
    assert (np.abs(fixed.poles).max() > 2.0 * falling) == (name == "rob311")
    assert np.array_equal(by_rule.gain, fixed.gain) == (name != "rob311")
    # and wheels that shake in their play are not to shake the state that it acts on
    assert nominal_controller(robot).estimator == ("kalman" if name == "rob311" else "onboard")
