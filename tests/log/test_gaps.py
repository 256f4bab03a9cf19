"""Rows that lack a value are left out, whatever is missing: no check or analysis stops at them."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot import Robot
from ballbot.log import STATE_NAMES, Log
from ballbot.log.checks import check
from ballbot.log.checks.physics import examine
from ballbot.log.pose import measured_wheel_speeds, with_odometry
from ballbot.mechanics.model import Model
from ballbot.validation.models import ModelPair
from ballbot.validation.validation import validate_pair
from tests.support.log_examples import smooth_log, with_wheels
from tests.support.physics_examples import FRICTION, balancing

ALTEN = Robot.load("alten")


def with_gaps(log: Log, gaps: list[tuple[int, int, list[str]]]) -> Log:
    columns = {name: log[name].copy() for name in log.names}
    for start, length, names in gaps:
        for name in names:
            columns[name][start : start + length] = np.nan
    return Log(columns)


@st.composite
def gaps(draw) -> list[tuple[int, int, list[str]]]:
    """Draw up to four gaps of 1 row to the whole log, in one column, in some, or in all but the time."""
    log, _ = balancing()
    names = [name for name in log.names if name != "t"]
    found = []
    for _ in range(draw(st.integers(1, 4))):
        some = draw(st.one_of(st.just(names), st.lists(st.sampled_from(names), min_size=1, max_size=3)))
        length = draw(st.sampled_from([1, 1, 2, 30, 300, len(log)]))
        found.append((draw(st.integers(0, len(log) - 1)), length, some))
    return found


@pytest.mark.slow  # 12 times all checks of a log of 12 s
@given(gaps(), st.booleans())
@settings(max_examples=12, deadline=None)
def test_random_gaps_are_findings_and_no_failures(missing, wheels):
    log, robot = balancing()
    kept = Log({name: log[name] for name in log.names if wheels or not name.startswith("wheel")})
    missing = [(start, length, [n for n in names if n in kept]) for start, length, names in missing]
    gappy = with_gaps(kept, missing)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = check(gappy, robot=robot)
    named = {name for one in found if one.code == "missing" for name in one.where.columns}
    assert named == {name for name in gappy.names if np.isnan(gappy[name]).any()}


@pytest.mark.parametrize("columns", [["x_dot"], None], ids=["one cell", "a blank row"])
def test_one_gap_changes_no_conclusion(columns):
    log, robot = balancing()
    kept = Log({name: log[name] for name in log.names if not name.startswith("wheel")})
    names = columns or [name for name in kept.names if name != "t"]
    gappy = with_gaps(kept, [(1200, 1, names)])
    whole, found = examine(kept, robot), examine(gappy, robot)
    assert [one.code for one in found.findings] == [one.code for one in whole.findings]
    assert whole.gains
    assert found.gains
    # one row in 2400 is interpolated: far less than the uncertainty of the scale
    np.testing.assert_array_less(np.abs(found.gains.factors - whole.gains.factors), whole.gains.errors)
    (missing,) = (one for one in check(gappy, robot=robot) if one.code == "missing")
    assert missing.severity == "warning"
    assert missing.where.columns == tuple(names)


def test_wheel_speeds_and_odometry_come_from_the_rows_that_have_them():
    log = with_wheels(smooth_log(), ALTEN)
    gappy = with_gaps(log, [(50, 1, ["wheel2_dot"]), (70, 1, ["wheel1_dot", "theta_dot"])])
    speeds = measured_wheel_speeds(gappy, ALTEN)
    assert np.flatnonzero(np.isnan(speeds).any(axis=1)).tolist() == [70]
    # the states give what the encoder would: the log's wheels come from finite rotations, right to the interval squared
    assert speeds[50, 1] == pytest.approx(log["wheel2_dot"][50], abs=1e-4)
    kept = Log({name: gappy[name] for name in gappy.names if name not in ("x", "y", "x_dot", "y_dot")})
    moved = with_odometry(kept, ALTEN)
    assert len(moved) == len(log) - 2
    np.testing.assert_allclose(moved["x_dot"], np.delete(log["x_dot"], [50, 70]), atol=1e-4)


@pytest.mark.slow
def test_a_log_with_a_gap_is_validated():
    log, robot = balancing()
    models = ModelPair.by_friction(Model(robot.replace(friction=FRICTION)))
    gappy = validate_pair(models, with_gaps(log, [(900, 1, ["x_dot"]), (1500, 1, list(STATE_NAMES))]))
    assert gappy.closed_loop is not None
    assert gappy.open_loop is not None
