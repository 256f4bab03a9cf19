"""The report's texts and figures; its whole page is tested with the study."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure

from ballbot.fitting.intervals import Uncertainty
from ballbot.identification.coulomb import CoulombEquivalent
from ballbot.identification.prediction import Predictor
from ballbot.identification.quantities import scale_between
from ballbot.identification.result import Identification, OtherOptimum, WindowErrors
from ballbot.identification.result_findings import optimum_findings
from ballbot.identification.variation import Variation
from ballbot.identification.windows import Span
from ballbot.mechanics.friction import wheel_friction
from ballbot.report.identification import _parameter_sheet, friction_curve, friction_sentence
from ballbot.report.style import drawn
from ballbot.report.words import state_mark, with_symbols
from ballbot.robot import Friction
from tests.support.validation_examples import true_robot


def test_names_of_states_become_symbols_and_other_words_stay():
    assert with_symbols("psi_dot (psi) of e_x_dot") == "ψ\u0307 (ψ) of ε(x\u0307)"
    assert with_symbols("the axis, physics and theta2") == "the axis, physics and theta2"
    assert state_mark("phi") == "φ"


def _found() -> Identification:
    span = Span(log=0, start=0.0, end=0.25)
    errors = WindowErrors(
        spans=(span,), window_samples=1, squares_with=np.ones((1, 10)), squares_without=np.ones((1, 10))
    )
    correlation = np.corrcoef(np.random.default_rng(2).normal(size=(12, 24)))
    coordinates = scale_between(true_robot())
    point = coordinates.scaled(coordinates.nominal)
    sizes = np.array([1e-3] * 3 + [3e-3] * 3 + [4e-3] * 3 + [0.01, 0.02, 1e-4]) / coordinates.slopes(point)
    return Identification(
        robot=true_robot(),
        predictor=Predictor(robot=true_robot(), step=1e-3),
        uncertainty=Uncertainty(
            coordinates=coordinates,
            point=point,
            covariance=correlation * np.outer(sizes, sizes),
            intervals={},
        ),
        unknown=np.zeros(12, dtype=bool),
        variation=Variation(logs=1, differ=False, factor=1.0, deviations={}, predictions={}, prior_robots=0),
        coulomb=CoulombEquivalent(
            values=np.full(3, 0.1),
            standard_errors=np.full(3, 5e-3),
            speeds=np.full(3, 3.0),
            coulomb=np.full(3, 0.1),
            coulomb_errors=np.full(3, 0.02),
        ),
        fit=errors,
        held_out=errors,
        file_share=np.full(12, 0.25),
        window=0.25,
        excluded_states=(),
        gauss_newton_cost=(),
        findings=(),
    )


def test_a_second_optimum_is_a_column_and_a_sentence():
    found = _found()
    values = found.values.copy()
    values[10] = 2.71  # delta
    other = OtherOptimum(values=values, rise=0.01)
    made = _parameter_sheet(replace(found, other=other))
    assert made.rows[10][made.headings.index("other optimum")] == "2.71"
    coordinates = scale_between(true_robot())
    (finding,) = optimum_findings(coordinates, coordinates.scaled(found.values), other)
    assert "delta" in finding.text
    assert "2.71" in finding.text
    assert "1 % larger" in finding.text


@pytest.mark.parametrize(
    ("dry", "viscous", "words"),
    [
        # 0.1 + 0.2 exp(-(3/0.2)^0.3) + 0.09
        ((0.1, 0.2, 0.3), 0.03, "A wheel breaks away at 0.30 N m and needs 0.21 N m at 3.0 rad/s; the"),
        ((0.1, 0.0, 0.3), 0.01, "is 0.10 N m at any speed plus 0.010 N m per rad/s; the"),
        ((0.0, 0.0, 1.0), 0.05, "is viscous only: 0.050 N m per rad/s; the"),
    ],
)
def test_the_friction_in_words_is_that_of_the_law(dry, viscous, words):
    """The robot file's speed v_s belongs to a Stribeck part, which fades slowly with a small exponent."""
    coulomb, stribeck, exponent = dry
    friction = Friction(
        viscous=(viscous,) * 3,
        coulomb=(coulomb,) * 3,
        stribeck=(stribeck,) * 3,
        stribeck_speed=0.2,
        stribeck_exponent=exponent,
        rolling=0.0,
    )
    assert words in friction_sentence(replace(_found(), robot=true_robot().replace(friction=friction)))


@pytest.mark.parametrize("wheel", [0, 2])
def test_the_friction_band_is_that_of_drawn_parameters(wheel):
    found = _found()
    speed = np.array([-2.0, -0.4, 0.05, 0.7, 3.0])
    at = np.tile(speed[:, None], 3)
    torque, error = friction_curve(found, wheel, speed)
    np.testing.assert_allclose(torque, wheel_friction(at, found.robot.friction)[:, wheel])
    drawn_sets = np.random.default_rng(0).multivariate_normal(found.values, found.covariance, size=4000)
    robots = [found.layout.robot_of(found.robot, values) for values in drawn_sets]
    torques = [wheel_friction(at, robot.friction)[:, wheel] for robot in robots]
    # 4000 draws give a deviation to 1.1 %; the law is not linear in v_s and delta, which bends it a little
    np.testing.assert_allclose(error, np.std(torques, axis=0), rtol=0.06)


def test_a_parameter_without_a_standard_error_is_as_uncertain_as_its_range():
    found = _found()
    covariance = found.uncertainty.covariance.copy()
    covariance[10] = covariance[:, 10] = np.nan
    lost = replace(found, uncertainty=replace(found.uncertainty, covariance=covariance))
    assert np.isnan(lost.covariance[10]).all()
    # from 0.3 to 10
    assert lost.assumed_covariance[10, 10] == pytest.approx(9.7**2 / 12.0)
    assert np.isfinite(lost.assumed_covariance).all()


def _plot() -> Figure:
    figure = Figure(figsize=(7.4, 2.0))
    figure.subplots(subplot_kw={"title": "a title"}).plot([0, 1], [0, 1])
    return figure


def test_a_figure_is_one_svg_element_whose_names_are_its_own():
    first, again, other = (drawn(_plot, name=name) for name in "aab")
    assert first == again
    for svg in (first, other):
        assert ElementTree.fromstring(svg).tag == "{http://www.w3.org/2000/svg}svg"
    ids = [set(re.findall(r'\bid="([^"]+)"', svg)) for svg in (first, other)]
    assert ids[0]
    assert not ids[0] & ids[1]
    # what is referred to is there
    assert set(re.findall(r'href="#([^"]+)"', first)) <= ids[0]
