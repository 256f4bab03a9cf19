"""The safety layer: what it bridges, stops and reports, and that it changes nothing else; and the self-test.

The self-test before balancing passes a robot that is wired correctly, and names what is wrong with one that is not.
"""

import doctest
import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot import Robot
from ballbot.control import safety
from ballbot.control.interface import LARGEST_STATE
from ballbot.control.presets import nominal_controller
from ballbot.control.references import hold
from ballbot.control.safety import (
    SELF_TEST_DURATION,
    SafeController,
    Safety,
    SafetyLimits,
    SelfTest,
    StopReason,
    evaluate_self_test,
)
from ballbot.errors import InputError
from ballbot.estimation.kalman import KalmanFilter
from ballbot.estimation.onboard import OnboardState
from ballbot.findings import Finding
from ballbot.mechanics.equations import LARGEST_LEAN
from ballbot.mechanics.model import Model
from ballbot.simulation.model_plant import ModelPlant
from ballbot.simulation.plant import Measurement
from ballbot.simulation.run import simulate
from tests.support.control_examples import FRICTION, alten, four_wheeled, leaning

ROBOT = alten(FRICTION)
H = ROBOT.sensors.sample_time


class Constant:
    """A controller that answers what it is given and counts how often it is asked."""

    sample_time = H

    def __init__(self, torques=(1.0, -0.5, 0.25)) -> None:
        self.torques, self.asked = torques, 0

    def reset(self) -> None:
        self.asked = 0

    def update(self, _t, _state, _reference):
        self.asked += 1
        return np.array(self.torques)


def guarded(controller=None, **limits) -> SafeController:
    return SafeController(controller or Constant(), ROBOT, SafetyLimits(**limits))


samples = st.tuples(
    st.booleans(),  # measured
    st.sampled_from([0.0, 0.1, -0.29, 0.31, -0.5, math.nan, math.inf]),  # theta
    st.sampled_from([0.0, 0.3, -0.31, math.nan]),  # phi
    st.sampled_from([0.0, 1.0, -2.0, math.nan, math.inf]),  # torque
)


@settings(max_examples=200)
@given(st.integers(0, 3), st.lists(samples, max_size=20))
def test_safety_stop_follows_its_rule_and_stays(max_missing, run):
    """The layer against its three rules written out over the whole history."""
    safety = Safety(SafetyLimits(max_missing=max_missing, lean=0.3))
    missing, stopped = 0, None
    for k, (measured, theta, phi, torque) in enumerate(run):
        known = math.isfinite(theta) and math.isfinite(phi)
        missing = 0 if measured and known else missing + 1
        may = safety.admit(k * H, measured=measured, theta=theta, phi=phi)
        if stopped is None and missing > max_missing:
            stopped = StopReason.MISSING, k
        elif stopped is None and known and max(abs(theta), abs(phi)) > 0.3:
            stopped = StopReason.LEAN, k
        assert may == (stopped is None and known)
        released = safety.release(k * H, 1, torque) if may else 0.0
        if may and not math.isfinite(torque):
            stopped = StopReason.TORQUE, k
        assert released == (torque if may and stopped is None else 0.0)
        assert (safety.stop is None) == (stopped is None)
        if stopped is not None and safety.stop is not None:
            assert (safety.stop.reason, safety.stop.t) == (stopped[0], stopped[1] * H)
    safety.reset()
    assert safety.stop is None
    assert safety.missing == 0
    assert safety.admit(0.0, measured=True, theta=0.0, phi=0.0)


@given(st.lists(st.sampled_from([H, 2.0 * H, 3.0 * H]), min_size=1, max_size=20))
def test_late_sample_stops(intervals):
    safety = Safety(SafetyLimits(max_interval=2.5 * H))
    t = 0.0
    for k, interval in enumerate(intervals):
        t += interval if k else 0.0
        safety.admit(t, measured=True, theta=0.0, phi=0.0)
    late = any(interval > 2.5 * H for interval in intervals[1:])
    assert (safety.stop is not None) == late
    if safety.stop is not None:
        assert safety.stop.reason is StopReason.LATE
        assert "0.015 s since the last sample; at most 0.0125 s are allowed" in safety.stop.text


@given(st.lists(st.sampled_from([0.0, 1.0, math.nan]), max_size=25), st.integers(0, 4))
def test_imu_that_repeats_itself_stops(values, most):
    """NaN is missing, which is another rule's business."""
    safety = Safety(SafetyLimits(max_unchanged=most))
    longest, run = 0, 0
    for k, value in enumerate(values):
        run = run + 1 if k and value == values[k - 1] else 0
        longest = max(longest, run)
        safety.watch(k * H, imu=(0.5, value), angles=(float(k),), torques=(9.0,))
    assert (safety.stop is not None) == (most > 0 and longest >= most)


@given(st.lists(st.tuples(st.sampled_from([0.0, 0.1]), st.sampled_from([2.0, 0.5, -2.0])), max_size=25))
def test_encoder_that_does_not_count_stops(samples):
    safety = Safety(SafetyLimits(max_unchanged=3, turning_torque=1.0))
    stuck = False
    for k, (angle, torque) in enumerate(samples):
        safety.watch(k * H, imu=(float(k),), angles=(float(k), angle), torques=(2.0, torque))
        last = samples[k - 2 : k + 1] if k >= 3 else []
        still = bool(last) and len({one[0] for one in samples[k - 3 : k + 1]}) == 1
        stuck |= still and abs(sum(one[1] for one in last)) == 6.0
    assert (safety.stop is not None) == stuck
    if safety.stop is not None:
        assert safety.stop.reason is StopReason.STUCK
        assert "wheel 2 was driven for 3 samples and its encoder did not count" in safety.stop.text


def test_limits_of_a_real_robot():
    limits = SafetyLimits.on_robot(ROBOT, sample_time=0.005)
    assert limits == SafetyLimits(lean=0.35, max_interval=0.0175, max_unchanged=20, turning_torque=1.5)


def test_silent_host_stops_until_reset():
    safety = Safety()
    assert safety.admit(0.0, measured=True, theta=0.0, phi=0.0)
    safety.halt(0.1, StopReason.LINK, "no valid frame for 50 ms")
    safety.halt(0.2, StopReason.LATE, "another reason")
    assert safety.stop is not None
    assert safety.stop.reason is StopReason.LINK
    assert safety.stop.text == "stopped at t = 0.100 s: no valid frame for 50 ms."
    assert not safety.admit(0.2, measured=True, theta=0.0, phi=0.0)
    assert safety.release(0.2, 1, 0.5) == 0.0
    safety.reset()
    assert safety.admit(0.3, measured=True, theta=0.0, phi=0.0)


def test_the_reason_is_one_sentence_with_the_time():
    controller = guarded(max_missing=1)
    for k in range(3):
        controller.update(k * H, np.zeros(10), np.zeros(10), measured=k == 0)
    assert controller.stop is not None
    assert controller.stop.reason == "missing"
    assert (
        controller.stop.text == "stopped at t = 0.010 s: no valid measurement for 2 samples; 1 are bridged."
    )
    controller.reset()
    assert controller.stop is None
    controller.update(0.5, leaning(-1.3), np.zeros(10))
    assert controller.stop.text == "stopped at t = 0.500 s: the lean is 1.3 rad; the limit is 1.2 rad."
    controller = guarded(Constant((1.0, np.nan, 0.0)))
    assert (controller.update(0.25, np.zeros(10), np.zeros(10)) == 0.0).all()
    assert controller.stop is not None
    assert "torque nan on wheel 2 is not a finite number" in controller.stop.text


def test_controller_is_not_called_without_a_state():
    controller = guarded()
    asked = controller.controller
    assert (controller.update(0.0, np.zeros(10), np.zeros(10), measured=False) == asked.torques).all()
    assert (controller.update(H, np.full(10, np.nan), np.zeros(10)) == 0.0).all()
    assert asked.asked == 1
    assert controller.stop is None
    assert (controller.update(2 * H, np.zeros(10), np.zeros(10)) == asked.torques).all()


@pytest.mark.parametrize("place", range(10))
@pytest.mark.parametrize("bad", [np.nan, np.inf, -2.0 * LARGEST_STATE])
def test_any_of_the_ten_numbers_makes_a_state_invalid(place, bad):
    controller, state = guarded(max_missing=0), np.zeros(10)
    state[place] = bad
    assert (controller.update(0.0, state, np.zeros(10)) == 0.0).all()
    assert controller.stop is not None
    assert controller.stop.reason is StopReason.MISSING
    assert (controller.update(H, np.zeros(10), np.zeros(10)) == 0.0).all()


def test_valid_runs_are_the_same_to_the_bit():
    controller, start = nominal_controller(ROBOT), leaning(0.05)
    behind = guarded(nominal_controller(ROBOT))
    for k in range(50):
        x = start * math.cos(0.2 * k)
        np.testing.assert_array_equal(
            behind.update(k * H, x, np.zeros(10)), controller.update(k * H, x, np.zeros(10))
        )
    assert behind.stop is None


class Gapped(ModelPlant):
    """A plant whose measurement is missing, or predicted, from a sample on."""

    def __init__(self, model: Model, first: int, *, predicted: bool) -> None:
        super().__init__(model)
        self.first, self.predicted = first, predicted

    def step(self, torques, duration):
        measured = super().step(torques, duration)
        if round(measured.t / duration) < self.first:
            return measured
        state = measured.state if self.predicted else np.full(10, np.nan)
        return replace(measured, state=state, valid=False)


@pytest.mark.parametrize("predicted", [True, False])
def test_a_run_ends_where_the_motors_are_stopped(predicted):
    plant = Gapped(Model(ROBOT), 20, predicted=predicted)
    start = leaning(0.02)
    log = simulate(plant, nominal_controller(ROBOT), hold(), duration=1.0, initial_state=start)
    assert log.ended == "stopped at t = 0.110 s: no valid measurement for 3 samples; 2 are bridged"
    assert len(log) == 22
    assert (log.torques[20:] != 0.0).any() == predicted
    longer = SafeController(nominal_controller(ROBOT), ROBOT, SafetyLimits(max_missing=4))
    assert len(simulate(plant, longer, hold(), duration=1.0, initial_state=start)) == 24
    strict = SafeController(nominal_controller(ROBOT), ROBOT, SafetyLimits(lean=0.01))
    with pytest.raises(InputError, match=r"before its first sample: stopped at .* the limit is 0\.01 rad"):
        simulate(Model(ROBOT), strict, hold(), duration=1.0, initial_state=start)


def test_controller_returning_nan_ends_the_run():
    class Broken(Constant):
        def update(self, t, _state, _reference):
            return np.full(3, np.nan if t > 0.1 else 0.0)

    log = simulate(Model(ROBOT), Broken(), hold(), duration=1.0)
    assert log.ended == (
        "stopped at t = 0.105 s: the controller's torque nan on wheel 1 is not a finite number"
    )
    assert np.isfinite(log.torques).all()


@pytest.mark.slow
@pytest.mark.parametrize("estimator", [KalmanFilter, OnboardState])
def test_the_twin_s_estimator_bridges_a_gap_and_the_layer_stops_a_longer_one(estimator):
    pytest.importorskip("mujoco")
    from ballbot.twin import Twin

    twin = Twin(ROBOT, estimator=estimator(ROBOT, sample_time=H))
    read, lost = twin._sensors.read, {10, 11}

    def reading(t, *rest):
        one = read(t, *rest)
        return replace(one, gyro=np.full(3, np.nan)) if round(t / H) in lost else one

    twin._sensors.read = reading
    log = simulate(twin, nominal_controller(ROBOT), hold(), duration=0.2)
    assert log.ended is None
    assert np.isfinite(log.states).all()
    assert np.isnan(log["gyro_x"][10:12]).all()
    lost |= {20, 21, 22}
    log = simulate(twin, nominal_controller(ROBOT), hold(), duration=0.2)
    assert log.ended == "stopped at t = 0.110 s: no valid measurement for 3 samples; 2 are bridged"


@pytest.mark.parametrize(
    ("limits", "sentence"),
    [
        ({"max_missing": -1}, "max_missing of the safety limits is -1"),
        ({"max_missing": 1.5}, "whole number"),
        ({"lean": 0.0}, "lean of the safety limits is 0; it must be above zero"),
        ({"lean": math.nan}, "finite"),
        ({"max_unchanged": -1}, "max_unchanged of the safety limits is -1"),
        ({"max_interval": 0.0}, "max_interval of the safety limits is 0; it must be above zero"),
        ({"turning_torque": math.nan}, "turning_torque of the safety limits"),
    ],
)
def test_wrong_limits_are_refused(limits, sentence):
    with pytest.raises(InputError, match=sentence):
        SafetyLimits(**limits)


def test_the_default_lean_is_the_model_s_own_end():
    assert SafetyLimits().lean == LARGEST_LEAN


def test_nan_torque_of_a_user_controller_is_an_error(tmp_path):
    """In a comparison a mistake in the user's file is no fall."""
    from ballbot.workflows.candidates import UserController

    path = tmp_path / "mine.py"
    path.write_text(
        "class Mine:\n"
        "    sample_time = 0.005\n"
        "    def __init__(self, robot): ...\n"
        "    def reset(self): ...\n"
        "    def update(self, t, state, reference):\n"
        "        return [float('nan') if t > 0.1 else 0.0, 0.0, 0.0]\n"
    )
    modules = set(sys.modules)
    with pytest.raises(
        InputError, match=r"mine\.py:Mine returned torques \[nan, 0\.0, 0\.0\] at t = 0\.105 s"
    ):
        simulate(Model(ROBOT), UserController(str(path), "Mine", ROBOT), hold(), duration=1.0)
    for name in set(sys.modules) - modules:  # the file is this test's alone
        del sys.modules[name]


class Miswired:
    """A plant whose motors' cables are mixed up: motor i gets sign[i] times the torque of motor order[i]."""

    def __init__(self, robot: Robot, *, order: tuple[int, ...], signs: tuple[int, ...]) -> None:
        self._plant = ModelPlant(Model(robot))
        self.robot = robot
        self._order, self._signs = list(order), np.array(signs)

    def reset(self, initial_state: np.ndarray | None, *, seed: int) -> Measurement:
        return self._plant.reset(initial_state, seed=seed)

    def step(self, torques: np.ndarray, duration: float) -> Measurement:
        return self._plant.step(self._signs * torques[self._order], duration)


def findings_of(plant) -> list[Finding]:
    robot = plant.robot
    log = simulate(plant, SelfTest(robot), hold(), duration=SELF_TEST_DURATION)
    return list(evaluate_self_test(robot, log).findings)


@pytest.mark.parametrize(
    "robot",
    [alten(FRICTION), pytest.param(four_wheeled(friction=True), marks=pytest.mark.slow)],
    ids=["three", "four"],
)
def test_correctly_wired_robot_passes_the_self_test(robot):
    n = robot.wheel_count
    assert findings_of(Miswired(robot, order=tuple(range(n)), signs=(1,) * n)) == []


def test_the_nominal_twin_passes_and_stays_upright():
    pytest.importorskip("mujoco")
    from ballbot.twin import Twin

    robot = alten()
    upright = np.zeros(10)
    log = simulate(
        Twin(robot), SelfTest(robot), hold(), duration=SELF_TEST_DURATION, initial_state=upright, seed=3
    )
    result = evaluate_self_test(robot, log)
    assert result.passed
    assert log.ended is None
    # one degree of play is 0.017 rad: motors move through it, the robot does not
    assert np.abs(log.truth().states[:, 2:4]).max() < 0.02


@pytest.mark.parametrize("wrong", [0, 1, 2])
def test_a_wrong_sign_is_named(wrong):
    signs = tuple(-1 if i == wrong else 1 for i in range(3))
    (finding,) = findings_of(Miswired(alten(FRICTION), order=(0, 1, 2), signs=signs))
    assert f"Motor {wrong + 1} was driven forward and its encoder turned back" in finding.text
    assert finding.code == "torque-sign"


@pytest.mark.parametrize("order", [(1, 0, 2), (2, 0, 1), (0, 2, 1)])
def test_a_wrong_order_is_named(order):
    findings = findings_of(Miswired(alten(FRICTION), order=order, signs=(1, 1, 1)))
    wrong = [motor for motor in range(3) if order[motor] != motor]
    assert len(findings) == len(wrong)
    for motor, finding in zip(wrong, findings, strict=True):
        turning = order.index(motor) + 1
        assert f"Motor {motor + 1} was driven and encoder {turning} turned the most" in finding.text
        assert finding.code == "torque-order"


def test_a_motor_without_power_is_named():
    (finding,) = findings_of(Miswired(alten(FRICTION), order=(0, 1, 2), signs=(1, 0, 1)))
    assert "Motor 2 was driven and no encoder turned" in finding.text
    assert finding.code == "dead-motor"


def test_the_example_of_the_module_runs():
    pytest.importorskip("mujoco")
    done = doctest.testmod(safety)
    assert done.attempted >= 9
    assert not done.failed


def test_invalid_input_is_refused():
    with pytest.raises(InputError, match=r"above the largest break-away torque, 0\.18 N m"):
        SelfTest(alten(FRICTION), torque=0.1)
    strong = alten(replace(FRICTION, coulomb=(7.0, 7.0, 7.0)))
    with pytest.raises(InputError, match="the torque limit of the drive, 6 N m"):
        SelfTest(strong, torque=8.0)
    robot = alten(FRICTION)
    short = simulate(Model(robot), SelfTest(robot), hold(), duration=0.2)
    with pytest.raises(InputError, match=r"lasts 0\.2 s; it must last 0\.5 s"):
        evaluate_self_test(robot, short)
