"""Floor adaptation: what the floor takes is learnt, turns with the motion, stays bounded and rests without motion."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot import Controller, InputError, Model, Robot, simulate
from ballbot.control.parts import Parts
from ballbot.control.parts.floor_adaptation import FloorAdaptation
from ballbot.control.parts.integral import IntegralAction
from ballbot.control.presets import design_gain, precise_controller
from ballbot.control.references import Reference, change_pose, circle, square
from tests.support.control_examples import FRICTION, MisjudgedLean, alten, four_wheeled


def adaptive(robot: Robot, floor: FloorAdaptation | None = None) -> Controller:
    whole = precise_controller(robot)
    return whole.with_parts(replace(whole.parts, floor_adaptation=floor or FloorAdaptation()))


def on_carpet(robot: Robot) -> Robot:
    return robot.replace(friction=replace(robot.friction, rolling=0.021))


def errors(robot: Robot, controller: Controller, reference: Reference, *, duration: float) -> np.ndarray:
    log = simulate(Model(robot), controller, reference, duration=duration)
    assert log.ended is None
    return np.hypot(log["x"] - log["ref_x"], log["y"] - log["ref_y"])[log.t > 20.0]


@pytest.mark.slow
@pytest.mark.parametrize(
    "robot",
    [
        pytest.param(alten(FRICTION), id="three"),
        pytest.param(four_wheeled(friction=True), id="four", marks=pytest.mark.sample),
    ],
)
def test_floor_adaptation_removes_most_of_the_error_on_carpet(robot: Robot):
    reference, cost = circle(period=32.0), {}
    for name, made in (("fixed", precise_controller), ("adaptive", adaptive)):
        smooth, rough = (
            errors(one, made(robot), reference, duration=40.0).mean() for one in (robot, on_carpet(robot))
        )
        cost[name] = rough - smooth
    assert cost["fixed"] > 0.003
    assert abs(cost["adaptive"]) < 0.25 * cost["fixed"]


def test_a_robot_that_stands_learns_nothing_of_the_floor():
    robot = alten(FRICTION)
    controller, way = adaptive(robot), change_pose(x=1.0, y=0.0, psi=0.0, at=1.0, ramp=5.0)
    state, drags = np.zeros(10), []
    for k in range(4000):  # it goes there, 5 mm behind, stands for 6 s and is then thought to lean
        t = k * 0.005
        state[:2] = way(t)[:2]
        state[0] -= 0.005
        state[5] = 0.2 if 1.0 < t < 6.0 else 0.0
        state[2] = 0.01 if t > 12.0 else 0.0
        controller.update(t, state, way(t))
        drags.append(controller.drag)
    assert abs(drags[1200]) > 1e-3
    # the shaped motion is below a tenth of the speed from which on the drag is whole after some 5 s
    assert drags[-1] == drags[2400]


def test_its_drag_stays_within_its_bound():
    robot = alten(FRICTION)
    controller = adaptive(robot, FloorAdaptation(time=0.5, highest=0.02))
    simulate(Model(on_carpet(robot)), controller, circle(period=32.0), duration=20.0)
    assert controller.drag == 0.02
    controller.reset()
    assert controller.drag == 0.0


@pytest.mark.slow
def test_slope_is_separated_from_floor_friction():
    """A lean that is misjudged asks for what a slope asks for, which does not turn with the motion."""
    robot = alten(FRICTION)
    carpet, found = on_carpet(robot), {}
    for name, plant, tilted in (("smooth", robot, False), ("tilted", robot, True), ("rough", carpet, False)):
        controller = adaptive(robot)
        used = MisjudgedLean(controller, degrees=0.5) if tilted else controller
        simulate(Model(plant), used, square(period=32.0), duration=64.0)
        found[name] = controller.drag
    # the slope asks for half as much again as carpet does
    assert abs(found["tilted"] - found["smooth"]) < 0.1 * (found["rough"] - found["smooth"])


def test_compensation_is_continuous_when_the_estimate_is_carried_over():
    robot = alten(FRICTION)
    quick, whole = adaptive(robot, FloorAdaptation(time=0.05)), precise_controller(robot)
    state, reference = np.zeros(10), np.zeros(10)
    torques = {}
    for name, controller in (("carried", quick), ("left", whole)):
        controller.reset()
        given = []
        for k in range(400):  # the reference moves on at 0.1 m/s and the robot, 5 mm behind, with it
            reference[0] = 0.1 * 0.005 * k
            state[0], state[5] = reference[0] - 0.005, 0.1
            given.append(controller.update(0.0, state, reference).copy())
        torques[name] = np.array(given)[100:]
    assert abs(quick.drag) > 0.01
    # the leak of the integral, 1/60 s, acts on its remainder only
    np.testing.assert_allclose(torques["carried"], torques["left"], atol=0.03 * np.ptp(torques["left"]))


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: FloorAdaptation(time=0.0), "time of the floor adaptation is 0; it must be positive"),
        (lambda: FloorAdaptation(highest=np.inf), "highest of the floor adaptation"),
        (lambda: Parts(floor_adaptation=FloorAdaptation()), "needs integral action"),
        (
            lambda: Parts(floor_adaptation=FloorAdaptation(), integral=IntegralAction(gain=np.zeros((3, 3)))),
            "needs reference shaping",
        ),
    ],
)
def test_invalid_floor_adaptation_is_refused(make, sentence):
    with pytest.raises(InputError, match=sentence):
        make()


def test_without_floor_adaptation_no_torque_is_added():
    robot = alten(FRICTION)
    controller = Controller(robot, design_gain(robot).gain)
    simulate(Model(robot), controller, circle(period=32.0), duration=4.0)
    assert controller.drag == 0.0
