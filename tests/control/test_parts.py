"""What is added to the gain: planned motions, feed-forward, integral action, observer."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot import Controller, InputError, Model, Robot, simulate
from ballbot.control.parts import Parts
from ballbot.control.parts.disturbance_observer import DisturbanceObserver
from ballbot.control.parts.feed_forward import FeedForward
from ballbot.control.parts.integral import IntegralAction
from ballbot.control.parts.planner import MOTION_TORQUE, Planner
from ballbot.control.presets import design_gain, design_integral_gain, precise_controller
from ballbot.control.references import hold, square
from ballbot.twin import Scenario
from ballbot.workflows.courses import choose_courses
from ballbot.workflows.league import run_league
from ballbot.workflows.metrics import falls_of
from tests.support.control_examples import FRICTION, Altered, alten, four_wheeled

SAMPLE = 0.005
#: 1.2 m/s^2
PLANNER = Parts(planner=Planner(torque_limit=1.6 / MOTION_TORQUE))


def planned(robot: Robot, reference, duration: float) -> np.ndarray:
    """Return the planned x, y (N, 2) of a robot that stays at the origin, with feed-forward alone."""
    parts, places = replace(PLANNER, feed_forward=FeedForward()), []
    controller = Controller(robot, np.zeros((robot.wheel_count, 10)), parts=parts)
    for k in range(round(duration / SAMPLE)):
        controller.update(k * SAMPLE, np.zeros(10), reference(k * SAMPLE))
        places.append(controller.memory["planner"]["place"][0].copy())
    return np.array(places)


def test_a_motion_starts_where_the_robot_is():
    controller = Controller(alten(), design_gain(alten()).gain, parts=PLANNER)
    state, reference = np.zeros(10), np.zeros(10)
    state[[0, 1, 4]] = 1.0, 2.0, 0.5
    for _ in range(2):
        controller.reset()
        np.testing.assert_allclose(controller.update(0.0, state, reference), 0.0, atol=1e-12)


@pytest.mark.parametrize(
    "robot",
    [
        pytest.param(alten(), id="three"),
        # compiles the engine of four wheels
        pytest.param(four_wheeled(friction=False), id="four", marks=pytest.mark.sample),
    ],
)
def test_feed_forward_makes_a_robot_without_friction_do_the_planned_motion(robot: Robot):
    gain, reference = design_gain(robot).gain, hold(x=0.3, y=-0.4)
    flat = planned(robot, reference, 8.0)
    errors, leaned = {}, 0.0
    for name, part in (("without", None), ("with", FeedForward())):
        controller = Controller(robot, gain, parts=replace(PLANNER, feed_forward=part))
        log = simulate(Model(robot), controller, reference, duration=8.0)
        errors[name] = np.hypot(log["x"] - flat[:, 0], log["y"] - flat[:, 1]).max()
        leaned = np.hypot(log["theta"], log["phi"]).max()
    # the place is behind the flat output by 0.078 s^2 times an acceleration of up to 1.2 m/s^2 by design
    assert errors["with"] < 0.1
    assert errors["without"] > 2.5 * errors["with"]
    # 0.139 rad s^2/m times 1.2 m/s^2 in the wheels' worst direction
    assert 0.1 < leaned < 0.18


@pytest.mark.slow
def test_on_a_slope_a_motion_is_left_the_torque_that_it_needs():
    """With the level floor's acceleration the robot falls; the torque that holds it there is 0.86 of 2.2 N m."""
    robot = Robot.load("alten")
    robot = robot.replace(friction=Scenario.nominal(robot).friction)
    controllers = {"precise": precise_controller(robot)}
    league = run_league(robot, controllers, choose_courses("slope_5", robot, "model"), seeds=range(1, 5))
    assert falls_of(league.scores["slope_5", "precise"]) == 0


def test_integral_action_takes_away_an_error_that_stays():
    robot = alten()
    design = design_integral_gain(robot)
    left = {}
    for name, part in (("without", None), ("with", IntegralAction(gain=design.integral_gain, memory=1e6))):
        controller = Controller(robot, design.gain, parts=Parts(integral=part))
        controller = Altered(
            controller, state=lambda x: x + np.radians(1.0) * np.eye(10)[2]
        )  # an AHRS that leans
        log = simulate(Model(robot), controller, hold(psi=1.0), duration=18.0)
        left[name] = float(np.hypot(log["x"][-1], log["y"][-1]))
    assert left["without"] > 0.04  # a degree times the gain's lean over its place, 3.5 m/rad
    assert left["with"] < 1e-4  # the slowest pole is at -0.65 rad/s: 18 s leave exp(-11) of a transient


def test_the_integral_rests_within_its_dead_band_and_at_the_torque_limit_and_stays_within_its_own():
    robot, gain = alten(), np.ones((3, 3))
    state = np.zeros(10)

    def grown(part: IntegralAction) -> float:
        controller = Controller(robot, np.zeros((3, 10)), parts=Parts(integral=part), torque_limit=1.0)
        return [controller.update(0.0, state, np.array([0.1, *np.zeros(9)]))[0] for _ in range(400)][-1]

    still = IntegralAction(gain=gain * [1, 0, 0], memory=1e9)
    assert grown(still) == pytest.approx(0.1 * 399 * SAMPLE)
    assert grown(replace(still, dead_band=0.2)) == 0.0
    assert grown(replace(still, limit=0.05)) == pytest.approx(0.05)
    over = Controller(robot, np.zeros((3, 10)), parts=Parts(integral=still), torque_limit=1e-3)
    for error in [0.1] * 400 + [-0.1] * 40:
        turned = over.update(0.0, state, np.array([error, *np.zeros(9)]))
    assert turned[0] < 0.0  # 0.2 s; 2 s of it, wound up, would take 2 s to unwind


def test_an_observer_that_knows_no_friction_at_least_halves_its_error():
    robot = alten(FRICTION)
    gain, errors = design_gain(robot).gain, []
    for observer in (None, DisturbanceObserver(limit=0.5)):
        controller = Controller(robot, gain, parts=Parts(disturbance_observer=observer))
        log = simulate(Model(robot), controller, square(), duration=16.0)
        late = log.t >= 14.0  # on the way to the second corner
        errors.append(np.hypot(*(log.states[late, :2] - log.reference[late, :2]).T).max())
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Planner(torque_limit=0.0), "The planner: torque_limit is 0 N m"),
        (lambda: Planner(torque_limit=1.0, yaw_rate_limit=np.nan), "yaw_rate_limit"),
        (lambda: IntegralAction(gain=np.zeros((3, 2))), r"gain of the integral action has the shape"),
        (lambda: IntegralAction(gain=np.zeros((3, 3)), memory=0.0), "The integral action: memory is 0"),
        (lambda: IntegralAction(gain=np.zeros((3, 3)), dead_band=-1.0), "dead_band"),
        (lambda: DisturbanceObserver(frequency=-1.0, limit=0.5), "The disturbance observer: frequency is"),
        (lambda: Parts(feed_forward=FeedForward()), "needs planner"),
        (
            lambda: Controller(alten(), np.zeros((3, 10)), parts=Parts(integral=IntegralAction(gain=np.zeros((4, 3))))),
            "integral action is for 4 wheels; this robot has 3",
        ),
    ],
)  # fmt: skip
def test_invalid_parts_are_refused(make, sentence):
    with pytest.raises(InputError, match=sentence):
        make()


def test_planned_reference_gets_the_torques_of_the_linear_model():
    """On the plan itself, what remains is B^+ (r' - A r), with the rates' change since the last sample."""
    robot = alten()
    controller = Controller(
        robot, design_gain(robot).gain, parts=replace(PLANNER, feed_forward=FeedForward())
    )
    linear, h = Model(robot).linearize(), controller.sample_time
    lean_rates, lean_accelerations = np.array([0.2, -0.3]), np.array([1.5, 0.7])
    r = np.array([0.4, -0.2, 0.03, -0.05, 0.0, 0.6, 0.3, *lean_rates, 0.0])
    before = r - h * np.array([0.6, 0.3, *lean_rates, 0.0, 0.0, 0.0, *lean_accelerations, 0.0])
    controller.update(0.0, before, before)
    found = controller.update(h, r, r)
    # the position's acceleration is what these leans and torques give: the flat output feels no torque
    r_dot = linear.A @ r
    unknown = np.linalg.lstsq(linear.B[7:], np.array([*lean_accelerations, 0.0]) - r_dot[7:], rcond=None)[0]
    np.testing.assert_allclose(found, unknown, atol=1e-6)
    with pytest.raises(InputError, match="without feed-forward"):
        Controller(robot, design_gain(robot).gain).update(0.0, r, r)


def test_plan_whose_rows_are_lost_is_followed_for_50_ms():
    """Where two of three rows are lost, torques stay near those of the whole plan; without rows it ends at rest."""
    robot = alten()
    parts = replace(PLANNER, feed_forward=FeedForward())
    whole, lossy = (Controller(robot, design_gain(robot).gain, parts=parts) for _ in range(2))
    t = np.arange(60) * SAMPLE
    lean = 0.05 * np.sin(8.0 * t)  # 3.2 rad/s^2
    rows = np.zeros((60, 10))
    rows[:, 3], rows[:, 8] = lean, np.gradient(lean, SAMPLE)
    rows[:, 5] = 9.81 * np.cumsum(lean) * SAMPLE
    rows[:, 0] = np.cumsum(rows[:, 5]) * SAMPLE + 1.0
    given = rows[np.arange(60) // 3 * 3]
    torques = np.array(
        [(whole.update(0.0, a, a), lossy.update(0.0, a, b)) for a, b in zip(rows[1:], given[1:], strict=True)]
    )
    late, most = np.abs(torques[9:, 1] - torques[9:, 0]).max(), np.abs(torques[9:]).max(axis=(0, 2))
    # 0.44 of 1.41 N m; with the rates' change over one sample 1.98, and 3.39 N m at most
    assert late < 0.4 * most[0]
    assert most[1] < 1.02 * most[0]
    at_rest = np.zeros(10)
    at_rest[[0, 1, 4]] = given[-1, [0, 1, 4]]
    after = [np.abs(lossy.update(0.3 + k * SAMPLE, at_rest, given[-1])).max() for k in range(12)]
    assert after[5] > 0.1
    np.testing.assert_allclose(after[9:], 0.0, atol=1e-9)
