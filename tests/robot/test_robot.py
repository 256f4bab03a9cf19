"""Robots as values: presets against the thesis's tables, copies, sources."""

import dataclasses
import pickle

import numpy as np
import pytest

from ballbot.robot import Robot


@pytest.fixture
def alten() -> Robot:
    return Robot.load("alten")


def test_inertia_about_either_point_differs_by_steiner(alten: Robot) -> None:
    ml2 = 17.076 * 0.393**2  # 2.637
    steiner = alten.body.inertia_about_ball_center() - alten.body.inertia_about_center_of_mass()
    assert steiner == pytest.approx(np.diag([ml2, ml2, 0.0]), abs=1e-14)
    central = (*np.diag(alten.body.inertia_about_center_of_mass()), 0.0, 0.0, 0.0)
    same = dataclasses.replace(alten.body, inertia=central, inertia_about="center_of_mass")
    about_ball = alten.body.inertia_about_ball_center()
    assert same.inertia_about_ball_center() == pytest.approx(about_ball, abs=1e-14)


def test_changing_a_value_removes_its_source(alten: Robot) -> None:
    other = alten.replace(ball=dataclasses.replace(alten.ball, mass=3.1, inertia=0.0250))
    assert "ball.mass" not in other.sources
    assert other.sources["ball.radius"] == alten.sources["ball.radius"]
    found = other.annotated(sources={**other.sources, "ball.mass": "identified"})
    assert found.sources["ball.mass"] == "identified"


def test_robots_can_be_sent_to_other_processes_and_used_as_keys(alten: Robot) -> None:
    sent = pickle.loads(pickle.dumps(alten))
    assert sent == alten
    assert sent.sources == alten.sources
    assert {alten: "found"}[sent] == "found"
