"""The safety layer: what it bridges, stops and reports, and that it changes nothing else."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot.control.presets import nominal_controller
from ballbot.control.references import hold
from ballbot.control.safety import SafeController, SafetyLimits
from ballbot.errors import InputError
from ballbot.mechanics.model import Model
from ballbot.simulation.model_plant import ModelPlant
from ballbot.simulation.run import simulate
from tests.support.control_examples import FRICTION, alten, leaning
from tests.support.firmware_safety import Safety

ROBOT = alten(FRICTION)
H = ROBOT.sensors.sample_time


class Constant:
    """A controller that answers what it is given."""

    sample_time = H

    def __init__(self, torques=(1.0, -0.5, 0.25)) -> None:
        self.torques = torques

    def reset(self) -> None:
        pass

    def update(self, _t, _state, _reference):
        return np.array(self.torques)


def guarded(controller=None, **limits) -> SafeController:
    return SafeController(controller or Constant(), ROBOT, SafetyLimits(**limits))


samples = st.tuples(
    st.sampled_from([H, 2.0 * H, 3.0 * H]),  # since the last sample
    st.booleans(),  # measured
    st.sampled_from([0.0, 0.1, -0.29, 0.31, -0.5, math.nan, math.inf]),  # theta
    st.sampled_from([0.0, 0.3, -0.31, math.nan]),  # phi
    st.sampled_from([0.0, 1.0, -2.0, math.nan, math.inf]),  # torque
)


@settings(max_examples=200)
@given(st.integers(0, 3), st.lists(samples, max_size=20))
def test_safety_stop_follows_its_rule_and_stays(max_missing, run):
    """The layer against another one, which the firmware's is compared with, too."""
    answer, limits = Constant(), {"max_missing": max_missing, "lean": 0.3, "max_interval": 2.5 * H}
    guard, other = guarded(answer, **limits), Safety(SafetyLimits(max_unchanged=0, **limits))
    t, stopped = 0.0, None
    for k, (interval, measured, theta, phi, torque) in enumerate(run):
        t += interval if k else 0.0
        state, answer.torques = np.zeros(10), (torque, 0.5, 0.0)
        state[2:4] = theta, phi
        may = other.admit(t, measured=measured, theta=theta, phi=phi)
        if may:
            other.release(torque)
        if other.stop and not stopped:
            stopped = other.stop, t
        released = guard.update(t, state, np.zeros(10), measured=measured)
        assert tuple(released) == (answer.torques if may and not stopped else (0.0, 0.0, 0.0))
        assert (guard.stop and (guard.stop.reason, guard.stop.t)) == stopped
    guard.reset()
    assert guard.stop is None
    answer.torques = (1.0, 2.0, 3.0)
    assert tuple(guard.update(0.0, np.zeros(10), np.zeros(10))) == answer.torques


def test_the_reason_is_one_sentence_with_the_time():
    controller = guarded()
    controller.update(0.5, leaning(-1.3), np.zeros(10))
    assert controller.stop is not None
    assert controller.stop.text == "stopped at t = 0.500 s: the lean is 1.3 rad; the limit is 1.2 rad."
    controller = guarded(Constant((1.0, np.nan, 0.0)))
    assert (controller.update(0.25, np.zeros(10), np.zeros(10)) == 0.0).all()
    assert controller.stop is not None
    assert "torque nan on wheel 2 is not a finite number" in controller.stop.text


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
