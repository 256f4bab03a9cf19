"""`causal_states`: states from the rows up to a moment, of a simulated robot whose truth is known."""

import numpy as np
import pytest

from ballbot.log import STATE_NAMES, Log
from ballbot.log.mapping import LogMapping, parse_mapping
from ballbot.log.mapping_search.motion import Stated
from ballbot.log.pose import causal_states
from ballbot.log.proposal import mapping_text, propose
from tests.support.foreign_log_examples import (
    SENSOR_DELAY,
    foreign_columns,
    small_robot,
    swaying_log,
    write_foreign,
)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return write_foreign(tmp_path_factory.mktemp("foreign") / "run.txt", foreign_columns())


@pytest.fixture(scope="module")
def mapping(file) -> LogMapping:
    text = mapping_text(propose(file, small_robot(), Stated(command="duty")))
    # wheels and lean alone do not show the IMU's delay: it is filled in
    text = text.replace("[attitude]", f"[attitude]\ndelay = {SENSOR_DELAY}", 1)
    return parse_mapping(text, source="proposed")


@pytest.fixture(scope="module")
def moments(file, mapping) -> np.ndarray:
    return Log.read(file, mapping=mapping, robot=small_robot()).t[500:2000:50]


def test_causal_states_do_not_depend_on_later_rows(file, mapping, moments, tmp_path):
    robot = small_robot()
    header, *lines = file.read_text().strip().splitlines()
    rows = np.array([line.split() for line in lines], dtype=float)
    t = rows[:, header.split().index("t_now")]
    after = rows.copy()
    moment = float(moments[3])
    # the first row that shows the moment counts, and none after it
    later = np.flatnonzero(t >= moment + mapping.sensor_delay)[1:]
    after[later, 1:] += np.random.default_rng(1).standard_normal((len(later), rows.shape[1] - 1))
    changed = tmp_path / "changed.txt"
    changed.write_text("\n".join([header, *(" ".join(map(repr, row)) for row in after.tolist())]) + "\n")

    def states(path):
        return causal_states(path, mapping=mapping, robot=robot, moments=np.array([moment]))

    assert np.isfinite(states(file)).all()
    np.testing.assert_array_equal(states(changed), states(file))


def test_causal_states_are_near_the_truth(file, mapping, moments):
    truth = swaying_log()
    states = causal_states(file, mapping=mapping, robot=small_robot(), moments=moments)

    def error(name: str) -> float:
        found = states[:, STATE_NAMES.index(name)]
        return np.sqrt(np.mean((found - np.interp(moments, truth.t, truth[name])) ** 2))

    # an IMU's noise of 0.5 mrad, and where the log's clock lies within a message's interval
    assert error("theta") < 1e-3
    # what a line's middle, 20 ms ago, lags behind: the lean's acceleration is some 2 rad/s^2, the ball's 0.5 m/s^2
    assert error("theta_dot") < 0.5 * np.std(truth["theta_dot"])
    assert error("x_dot") < 0.1 * np.std(truth["x_dot"])


def test_too_little_past_gives_no_state(file, mapping):
    log = Log.read(file, mapping=mapping, robot=small_robot())
    states = causal_states(file, mapping=mapping, robot=small_robot(), moments=log.t[[0, 200]])
    assert mapping.sensor_delay == SENSOR_DELAY
    assert np.isnan(states[0]).all()
    assert np.isfinite(states[1]).all()
