"""How far a robot can go: the edge of the region of recovery."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot import Controller, InputError, Model, Robot
from ballbot.control.gain_set import tunable
from ballbot.control.presets import design_gain, nominal_controller, precise_controller
from ballbot.twin import Scenario
from ballbot.twin.faults import Timing
from ballbot.workflows import limits
from ballbot.workflows.limits import ControlledRobot, reach
from tests.support.control_examples import FRICTION, alten

DIRECTIONS = np.linspace(0.0, 2.0 * np.pi, 6, endpoint=False)


def loop(torque_limit: float, *, robot: Robot | None = None, grip: float = np.inf) -> ControlledRobot:
    body = robot or alten()
    return ControlledRobot(
        robot=body, controller=Controller(body, design_gain(body).gain, torque_limit=torque_limit), grip=grip
    )


def leans(one: ControlledRobot, *, end: float = 1.0, directions=DIRECTIONS):
    return reach(
        one.recovers, lambda sizes: limits.leaning_state(directions, sizes), shape=directions.shape, end=end
    )


def controllable_lean(torque_limit: float):
    """The lean at rest beyond which no controller whatever saves the linear robot.

    Along any left eigenvector w of an unstable pole, xi = w x obeys xi_dot = lambda xi + w B u, which bounded torques
    can bring back where |xi| lambda < sum |w B_i| u_max, and nowhere else.
    """
    linear = Model(alten()).linearize()
    poles, vectors = np.linalg.eig(linear.A.T)
    unstable = np.flatnonzero(np.real(poles) > 1.0)
    assert len(unstable) == 2
    pole, basis = np.real(poles[unstable[0]]), np.real(vectors[:, unstable])
    w = basis @ np.stack([np.cos(turns := np.linspace(0.0, np.pi, 720)), np.sin(turns)])
    most = np.abs(w.T @ linear.B).sum(axis=1) * torque_limit / pole
    xi = np.abs(w.T @ limits.leaning_state(DIRECTIONS, 1.0).T)
    return (most[:, None] / xi).min(axis=0)


def test_recovery_region_is_close_below_the_theoretical_limit():
    limit = 0.3  # N m: leans of 2 degrees, where the robot is linear
    found, bound = leans(loop(limit), end=0.1), controllable_lean(limit)
    # sampling and the saturated gain cost a little; sin(lean) < lean gains 1e-4, the rays end on 1/12288 of 0.1 rad
    assert (found < 1.001 * bound).all()
    assert (found > 0.9 * bound).all()


def test_a_wheel_lets_go_before_the_robot_is_lost():
    robot = alten(FRICTION)
    slippery, rubber, glue = (leans(loop(6.0, robot=robot, grip=grip)) for grip in (0.5, 1.0, np.inf))
    assert (slippery < rubber).all()
    assert (rubber < 0.5 * glue).all()


def test_sensors_leave_the_limit_and_delay_takes_from_it():
    robot = alten(FRICTION)
    scenario = Scenario.nominal(robot)
    clean = ControlledRobot(robot=robot, controller=precise_controller(robot), grip=np.inf)
    sensed = replace(clean, scenario=scenario)
    late = replace(clean, scenario=replace(scenario, timing=Timing(delay=8)))
    without, with_sensors, delayed = (
        leans(one, end=0.7, directions=DIRECTIONS[:1])[0] for one in (clean, sensed, late)
    )
    # milliradians of noise beside a limit of some 300 mrad; 40 ms of delay let a fall grow by a fifth, exp(5.2 * 0.04)
    assert with_sensors == pytest.approx(without, rel=0.05)
    assert delayed < 0.9 * without
    # the soft gain's loop is unstable from 0.1 s of delay on
    hopeless = replace(
        clean, controller=nominal_controller(robot), scenario=replace(scenario, timing=Timing(delay=60))
    )
    assert not hopeless.recovers(limits.leaning_state(DIRECTIONS, 0.02)).any()


def test_a_ray_stops_at_the_first_loss():
    def banded(points):
        return (points[:, 0] < 0.3) | (points[:, 0] > 0.5)

    def start_of(sizes):
        return np.concatenate([sizes[..., None], np.zeros((*sizes.shape, 9))], axis=-1)

    found = reach(banded, start_of, shape=(1,), end=1.0)
    assert found[0] == pytest.approx(0.3, abs=1.0 / 12288)
    free = reach(lambda points: np.ones(len(points), bool), start_of, shape=(1,), end=1.0)
    assert free[0] == 1.0


def test_gains_are_not_compared_with_one_that_recovers_from_nothing():
    controller = loop(1e-6).controller
    with pytest.raises(InputError, match="recovers from no impulse"):
        limits.recovered_shares(tunable(controller, [controller]))
