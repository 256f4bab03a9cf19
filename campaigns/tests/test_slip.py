"""Pushes after which wheels slip, and false alarms."""

from functools import partial

import numpy as np
import pytest

pytest.importorskip("mujoco")

from ballbot.fitting.run import Processes
from ballbot.workflows.grid import run_grid
from campaigns.slip import CLOSE, alarm_runs, alarms, gripping, pushed_log, samples_left_out

pytestmark = pytest.mark.sample


def test_robot_knows_where_it_stands_after_a_push_that_makes_its_wheels_slip() -> None:
    """A sample of the campaign in docs/generated/evidence.md; a filter that takes a slip for a push is 0.2 m off."""
    robot = gripping()
    log, watched = pushed_log(robot, 30.0, direction=2, seed=1)
    assert log.ended is None
    assert 0.2 < 0.005 * sum(watched.left_out) < 1.0
    errors = np.hypot(*(log.states - log.truth().states)[:, :2].T)
    assert errors[-200:].max() < CLOSE
    # the rule by the log sees the slip, and nothing before the push
    seen = samples_left_out(log, robot)
    assert seen[200:].any()
    assert not seen[:200].any()


def test_wheels_that_hold_are_not_left_out() -> None:
    runs, known = alarm_runs(0, range(1))
    answers = run_grid(runs, partial(alarms, known), workers=Processes(count=1)).answers
    assert sum(one.time for one in answers) > 600.0
    assert not any(one.count or one.ended for one in answers)
