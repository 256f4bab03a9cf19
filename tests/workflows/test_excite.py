"""`ballbot excite`: a design keeps its limits and is more informative than a square; impossible ones are refused."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ballbot import Controller, Model, simulate
from ballbot.control.presets import nominal_controller
from ballbot.control.references import sampled_reference, square
from ballbot.errors import InputError
from ballbot.identification import Identification
from ballbot.identification.identify import IdentificationOptions
from ballbot.log import Log
from ballbot.report.excitation import gain_sentence
from ballbot.robot.components import scaled_friction
from ballbot.workflows.excite import (
    Extent,
    Law,
    criterion,
    design,
    expected_errors,
    largest_sines,
    run_on_model,
    task,
)
from tests.support.control_examples import FRICTION, alten
from tests.support.identification_examples import NOISE

#: deviations of the nominal twin's states, about
DEVIATIONS = np.array([2e-3, 2e-3, 3.5e-3, 3.5e-3, 4.7e-3, 2e-2, 2e-2, 2.3e-2, 2.3e-2, 4e-2])
LIMITS = Extent(lean=math.radians(8.0), floor=0.8, torque=3.0)


def asked(
    *, limits=LIMITS, duration=10.0, robot=None, controller=None, deviations=DEVIATIONS, law: Law = "stribeck"
):
    robot = robot or alten(FRICTION)
    return task(
        robot,
        controller or nominal_controller(robot),
        limits=limits,
        duration=duration,
        deviations=deviations,
        law=law,
    )


@pytest.fixture(scope="module")
def designed():
    return design(asked())


@pytest.mark.slow
def test_the_limits_hold_on_the_model_with_any_of_the_frictions(designed):
    """`simulate`, not the batch that the design was made with, at a finer step."""
    for factor in (0.5, 1.5):
        plant = Model(alten(scaled_friction(FRICTION, factor)))
        log = simulate(plant, nominal_controller(alten()), designed[0].reference, duration=10.0)
        assert log.ended is None
        peaks = Extent.of(log.states, log.torques)
        assert peaks.exceeding(LIMITS) == []
        assert max(peaks.used_of(LIMITS).values()) > 0.2  # and the robot does move


@pytest.mark.slow
def test_designed_excitation_is_more_informative_than_a_square(designed):
    plain = expected_errors(asked(), [run_on_model(asked(), square(side=0.5, period=10.0)).log])
    _, _, errors = designed
    assert errors.max() < 0.8 * plain.max()
    assert criterion(errors) < 0.8 * criterion(plain)


@pytest.mark.parametrize(("axis", "place"), [(1, 3), (2, 2)])
def test_a_sine_alone_brings_a_frictionless_robot_near_a_limit(axis, place):
    """The caps come from the linear loop; the nonlinear simulation at half of one must give half of a limit."""
    robot, controller = alten(), nominal_controller(alten())
    choice = largest_sines(robot, controller, limits=LIMITS, duration=20.0, fastest=3.0)
    frequency, half = choice.frequencies[axis, place], 0.5 * choice.amplitudes[axis, place]
    t = choice.times
    poses = np.zeros((len(t), 3))
    poses[:, axis] = half * np.sin(2.0 * np.pi * frequency * t) * np.clip(t / 8.0, 0.0, 1.0)
    log = simulate(Model(robot), controller, sampled_reference(t, poses), duration=20.0).between(12.0, 20.0)
    # of either lean and of either coordinate by itself, as the linear answers are
    used = (
        np.abs(log.states[:, 2:4]).max() / LIMITS.lean,
        np.abs(log.states[:, :2]).max() / LIMITS.floor,
        np.abs(log.torques).max() / LIMITS.torque,
    )
    turned = half == 0.5 and axis == 2  # capped by the heading itself
    # 5 %: the sampled loop against the continuous one, and sines of the lean
    assert max(used) == pytest.approx(0.5, rel=0.05) or (turned and max(used) < 0.5)


def test_information_adds_and_noise_reduces_it():
    log = run_on_model(asked(), square(side=0.5, period=10.0)).log
    errors = expected_errors(asked(), [log])
    # two equal logs: half the variance, as windows are independent
    np.testing.assert_allclose(expected_errors(asked(), [log, log]), errors / math.sqrt(2.0), rtol=1e-6)
    noisier = asked(deviations=2.0 * DEVIATIONS)
    # 10 %: the starts' differences are as wide as the deviations, and friction has kinks
    np.testing.assert_allclose(expected_errors(noisier, [log]), 2.0 * errors, rtol=0.1)


def assert_errors_are_those_expected(found: Identification, log: Log) -> None:
    """With independent noise on the states, and nothing unmodelled; the linear bound neglects the curved valley."""
    question = asked(duration=25.0, deviations=NOISE, robot=alten(FRICTION))
    expected = question.in_units(expected_errors(question, [log]))
    # of these, what the log's own residuals show: with one log the variation between logs is that of other robots
    between = [found.variation.deviations.get(label, 0.0) for label in found.labels]
    errors = np.sqrt(found.errors**2 - np.square(between))
    known = np.isfinite(errors)
    assert known.sum() >= 9
    ratio = errors[known] / (expected[known] / math.sqrt(1.0 - IdentificationOptions().held_out))
    # 1.05 to 1.89 in 14 seeds with C_rr from the fit; found by the momentum, its error of 6 % is in all others too, and
    # the ratio is 2.01. The estimates themselves scatter by 0.97 to 2.0 times what is expected
    assert 0.95 < np.exp(np.median(np.log(ratio))) < 2.2


def test_robot_without_friction_uses_the_search_start():
    assumed = asked(robot=alten()).robot.friction
    assert assumed.coulomb == pytest.approx((0.125,) * 3)  # a quarter of the bounds' 0.5
    assert asked(robot=alten(FRICTION)).robot.friction.coulomb == pytest.approx(FRICTION.coulomb)


def test_only_parameters_of_the_law_are_designed_for():
    question = asked(law="coulomb")
    assert question.labels == ("b1", "b2", "b3", "c1", "c2", "c3", "C_rr")
    log = run_on_model(question, square(side=0.5, period=10.0)).log
    assert np.isfinite(expected_errors(question, [log])).all()


def test_impossible_limits_are_refused():
    limits = Extent(lean=0.14, floor=1e-4, torque=3.0)
    with pytest.raises(InputError, match="the robot hardly moves, and no reference makes b1"):
        design(asked(limits=limits, duration=4.0))


def test_a_controller_that_lets_it_fall_is_refused():
    wrong = Controller(alten(), -nominal_controller(alten()).gain)
    small = replace(FRICTION, coulomb=(1e-3,) * 3, stribeck=(1e-3,) * 3)  # too small to hold it upright
    with pytest.raises(InputError, match="falls on every reference"):
        design(asked(controller=wrong, robot=alten(small)))


def test_design_worse_than_a_square_is_reported():
    assert "4.0 times a square's, so the square is more informative" in gain_sentence(0.25)
    assert "4.0 times smaller than a square's" in gain_sentence(4.0)
    assert "some parameters cannot be identified" in gain_sentence(math.inf)
