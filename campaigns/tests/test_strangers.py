"""The rule by which strangers are drawn, and the tables of their runs."""

import math
from dataclasses import replace

import numpy as np
import pytest

from campaigns import strangers
from campaigns.strangers import RUNS, TUNING, Row, discrepancy, stranger


def test_a_stranger_follows_from_seed_and_number_and_its_file_lacks_the_truth():
    robot, again, other = stranger(TUNING, 7), stranger(TUNING, 7), stranger(TUNING, 12)
    assert (robot.true, robot.scenario, robot.seed) == (again.true, again.scenario, again.seed)
    assert robot.file.name == other.file.name == "kugle"
    assert other.true != robot.true
    assert not any(robot.file.friction.coulomb)
    for name in ("body.mass", "ball.radius", "body.center_of_mass"):
        parts = name.split(".")
        known, true = (getattr(getattr(one, parts[0]), parts[1]) for one in (robot.file, robot.true))
        assert 0.0 < abs(true / known - 1.0) < 0.15
    assert TUNING not in RUNS


ROW = Row(robot="alten 0", pivoting=0.02, play=0.01, friction=1.0, torque=1.0, delay=0.005)


def test_refused_and_fallen_robots_are_outside_and_worst(tmp_path, monkeypatch):
    good = replace(
        ROW, controller="precise", square=0.005, circle=0.01, figure_eight=0.02, heading=0.01, logged=0.004, low=0.002,
        high=0.03,
    )  # fmt: skip
    fallen = replace(good, fell="square", square=math.inf, logged=0.003)
    rows = [good, replace(good, logged=0.04), fallen, replace(ROW, refused="check-log: torque-scale")]
    assert [row.places[0] for row in rows] == ["inside", "worse", "fell: square", "check-log: torque-scale"]
    assert replace(good, square=0.04).places == ("inside", "worse")
    # the table that is kept says the same
    monkeypatch.setattr(strangers, "FOLDER", tmp_path)
    monkeypatch.setattr(strangers, "RUNS", {5: "none"})
    monkeypatch.setattr(strangers, "rows_of", lambda *_: rows)
    section = strangers.campaign()
    assert section.rows[0][2].startswith("25 %")
    assert section.rows[0][4] == "–, –"  # half of them have no peak
    assert section.rows[0][-2:] == ["1", "1"]
    monkeypatch.delattr(strangers, "rows_of")  # a table that is there is not made again
    assert strangers.campaign() == section


def test_discrepancy_is_what_the_spread_of_the_draws_does_not_cover():
    ratios = np.array([*np.linspace(0.5, 1.0, 20), *np.linspace(1.0, 3.0, 19)])
    excess = [strangers._excess([1.0 - 1e-6, 1.0, 1.0 + 1e-6], ratio) for ratio in ratios.tolist()]
    assert discrepancy(excess) == pytest.approx((0.5, 3.0), rel=1e-3)
    assert discrepancy([strangers._excess([0.5, 1.0, 2.0], 1.2)] * 9) == (1.0, 1.0)
