"""What the thesis observed, on the twin: samples of `campaigns.twin_observed`."""

import numpy as np
import pytest

from ballbot.twin import Scenario
from campaigns import twin_observed
from campaigns.twin_observed import PLAY, RESONANCE, Run, closed_loop


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
    assert (np.array(played) > 4 * np.array(without)).all()


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
