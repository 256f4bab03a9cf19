"""References: their shape over time, and that they ask for places only."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.control import references
from ballbot.errors import InputError
from ballbot.log import Log

EVERY = {name: references.named_reference(name) for name in references.REFERENCES}
REST = [2, 3, 5, 6, 7, 8, 9]  # lean and all rates


@given(st.sampled_from(sorted(EVERY)), st.floats(0.0, 1e4))
def test_only_position_and_heading_are_ever_asked_for(name, t):
    reference = EVERY[name](t)
    assert reference.shape == (10,)
    np.testing.assert_array_equal(reference[REST], 0.0)
    assert np.isfinite(reference).all()


@pytest.mark.parametrize("name", sorted(EVERY))
def test_every_named_reference_starts_where_the_robot_starts(name):
    np.testing.assert_array_equal(EVERY[name](0.0), np.zeros(10))


def test_hold_holds_whatever_is_tried_with_its_array():
    reference = references.hold(x=1.0, y=2.0, psi=3.0)
    with pytest.raises(ValueError, match="read-only"):
        reference(0.0)[:] = 9.0
    np.testing.assert_array_equal(reference(5.0), [1, 2, 0, 0, 3, 0, 0, 0, 0, 0])


def test_the_square_is_the_shared_logs_square(shared_data):
    log = Log.read(shared_data / "bbr" / "square_soft.csv")
    asked = np.array([references.square(side=0.5, period=32.0)(t) for t in log.t])
    # that log's clock was summed up from 5 ms steps, so some of its corners come one row late
    differ = np.any(asked != log.reference, axis=1)
    corners = np.abs(log.t / 8.0 - np.round(log.t / 8.0)) < 0.006 / 8.0
    assert not np.any(differ & ~corners)
    assert differ.sum() <= 12


def test_the_change_of_pose_is_the_shared_logs(shared_data):
    log = Log.read(shared_data / "bbr" / "thesis_step_soft.csv")
    asked = np.array([references.change_pose()(t) for t in log.t])
    # 1e-6: the log has seven digits
    np.testing.assert_allclose(asked, log.reference, atol=1e-6)


def test_a_square_turns_at_the_sample_though_the_clock_is_rounded():
    reference = references.square(side=1.0, period=4.0)
    clock = np.cumsum(
        np.full(400, 0.01)
    )  # 1.0 comes out as 1.0000000000000007, 2.0 as 2.0000000000000013, ..
    assert reference(clock[98])[0] == 0.0
    assert reference(clock[99])[0] == 1.0
    assert reference(1.0 - 1e-13)[0] == 1.0


def test_a_change_without_ramp_is_a_step():
    reference = references.change_pose(x=2.0, y=0.0, psi=0.0, at=1.0, ramp=0.0)
    assert reference(0.999)[0] == 0.0
    assert reference(1.0)[0] == 2.0


@given(st.floats(0.0, 100.0))
def test_the_circle_is_one(t):
    x, y = references.circle(radius=0.7, period=12.0)(t)[:2]
    assert np.hypot(x, y - 0.7) == pytest.approx(0.7, rel=1e-12)


def test_the_eight_crosses_itself_in_the_origin_and_fills_its_box():
    reference = references.figure_eight(length=2.0, width=1.0, period=8.0)
    path = np.array([reference(t)[:2] for t in np.linspace(0.0, 8.0, 801)])
    np.testing.assert_allclose(path.max(axis=0), [1.0, 0.5], rtol=1e-4)
    np.testing.assert_allclose(path.min(axis=0), [-1.0, -0.5], rtol=1e-4)
    np.testing.assert_allclose(path[[0, 400, 800]], 0.0, atol=1e-12)


def test_bad_references_end_in_a_sentence():
    with pytest.raises(InputError, match="the names are hold, square, change_pose, circle, figure_eight"):
        references.named_reference("spiral")
    with pytest.raises(InputError, match="period is 0; it must be positive"):
        references.square(period=0.0)
    with pytest.raises(InputError, match="ramp is -1 s"):
        references.change_pose(ramp=-1.0)
    assert references.named_reference("change-pose")(100.0)[4] == np.pi
