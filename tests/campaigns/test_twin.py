"""Samples of the campaigns of `campaigns.twin_*`: convergence to the exact model, and the thesis's observations."""

import numpy as np
import pytest

from ballbot.twin import Scenario
from campaigns import twin_convergence, twin_observed
from campaigns.twin_observed import PLAY, RESONANCE, Run, closed_loop


def test_twin_becomes_the_exact_model_as_contacts_get_stiffer_and_steps_shorter() -> None:
    """Two independent mechanics, MuJoCo's contacts and the Lagrangian, meet."""
    robot = twin_observed.ROBOT
    exact = twin_convergence.exact_motion(robot)
    contacts = twin_convergence.TOGETHER[:4]  # half a second of computing
    errors = np.array([twin_convergence.errors(robot, exact, one) for one in contacts])
    assert (errors[1:] < 0.6 * errors[:-1]).all()  # measured: 0.25 to 0.5 at each halving
    # a hundredth of the motion's 0.03 m, 0.17 rad, 0.14 m/s and 1.5 rad/s
    assert (errors[-1] < [1e-5, 3e-4, 1e-3, 2e-3]).all()


@pytest.mark.sample
def test_rollers_cause_a_speed_ripple_and_a_single_point_does_not() -> None:
    """The thesis's bumps (3.2): nine rollers of a row pass in a turn."""
    found = {}
    for name in ("wide_rows", "nominal", "single_point"):
        found[name] = twin_observed.roller_ripple(Scenario.named(name, twin_observed.ROBOT), seed=1)
    for name, times in (("wide_rows", 50.0), ("nominal", 10.0)):  # measured: 150 and 25
        assert found[name].line > times * found[name].background
    assert found["wide_rows"].line > 5 * found["nominal"].line  # measured: 15
    assert found["single_point"].line < 0.2 * found["nominal"].line  # measured: 0.08


@pytest.mark.sample
def test_play_causes_impulses() -> None:
    """The thesis's chapter 6; measured 350 and 29 rad/s^2, and 19 and 1.6 times a normal fourth moment."""
    played, without = (
        twin_observed.impulses(closed_loop(Run(scenario=one, duration=16.0))) for one in PLAY.values()
    )
    assert played.largest > 4 * without.largest
    assert played.kurtosis > 4 * without.kurtosis


@pytest.mark.sample
def test_compliant_driveline_causes_a_peak_in_the_residuals() -> None:
    """Measured: a line 300 times the median near 33 Hz when on, 6 times when off."""
    off, on = (
        twin_observed.residual_spectrum(closed_loop(Run(scenario=one, duration=16.0)), one.friction)
        for one in RESONANCE["without play"]
    )
    assert off.height < 20
    assert on.height > 100
    assert 25 < on.peak < 40
