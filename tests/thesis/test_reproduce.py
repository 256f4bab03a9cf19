"""The thesis remade: verdicts, the mistakes' numbers, recordings that are kept, the page. The whole is a command."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from ballbot.control.presets import design_gain, nominal_controller
from ballbot.control.references import hold
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from tests.support.report_pages import figure_count

pytest.importorskip("mujoco")

from ballbot.file_formats import results_text
from ballbot.report.page import page_of
from ballbot.thesis.reproduce import figures, mistakes
from ballbot.thesis.reproduce.bench import Bench, linear_run
from ballbot.thesis.reproduce.campaign import Reproduction
from ballbot.thesis.reproduce.item import ClaimCheck, Item
from ballbot.thesis.reproduce.item import check as check_of
from ballbot.thesis.reproduce.mistakes import MISTAKES
from ballbot.thesis.reproduce.page import reproduction_report
from ballbot.thesis.reproduce.recordings import CHANGE, ModelOnGrid, TwinOnGrid
from ballbot.thesis.reproduce.runs import above
from ballbot.twin import Scenario, Twin


@pytest.fixture(scope="module")
def bench() -> Bench:
    """A bench without recordings: enough for what is of models and parameters alone."""
    return Bench(robot=Robot.load("alten"), seed=0)


def check(*, value: float, lowest: float = -math.inf, highest: float = math.inf) -> ClaimCheck:
    return check_of("it is so", "a number", value, "m", lowest, highest)


def item_of(*checks: ClaimCheck) -> Item:
    return Item(title="Paths", thesis="It does.", ours="It does.", checks=checks)


def test_verdict_requires_the_whole_interval() -> None:
    def over(*values: float) -> ClaimCheck:
        return check_of("it is so", "a number", values, lowest=1.0)

    clear, uncertain, against = over(*range(2, 11)), over(*(0.1 * k for k in range(6, 15))), over(*[0.5] * 9)
    assert [one.cells[-1] for one in (clear, uncertain, against)] == ["yes", "undecided", "no"]
    # of nine values the second and the eighth hold the median with 96 %: 1 - 2 (1 + 9) / 2^9
    assert clear.interval == (3, 9)
    assert clear.cells[2] == "6 (3 to 9), 9 runs"
    assert item_of(clear, uncertain).verdict == "undecided"
    assert "do not decide whether it is so" in item_of(clear, uncertain).sentence
    assert item_of(clear, uncertain, against).verdict == "agrees in part"
    assert item_of(uncertain, against).verdict == "does not agree"


def test_fast_part_is_above_its_frequency() -> None:
    """Of 1 Hz and 25 Hz together the latter is left: 5 Hz, order 2 run both ways, takes 1 Hz down by 25^2."""
    t = np.arange(4000) / 200.0
    slow, fast = np.sin(2.0 * np.pi * t), 0.01 * np.sin(2.0 * np.pi * 25.0 * t)
    left = above(np.column_stack([slow + fast, slow]), 1.0 / 200.0, 5.0)[400:-400]
    # the filter's square gain is 1 / (1 + 1/5^4) at 25 Hz
    np.testing.assert_allclose(left[:, 0] - left[:, 1], fast[400:-400], rtol=0.0, atol=2e-5)
    assert np.abs(left[:, 1]).max() < 1.1 / 5.0**4


def test_appendix_iii_comes_out_of_a_simulated_swing(bench: Bench) -> None:
    item = figures.figure_iii_1(bench)
    assert item.verdict == "agrees"
    # what 4.37 kg m^2 swings at, by hand: sqrt(17.076 * 9.81 * 0.393 / 4.37)
    assert "3.8813 rad/s" in item.ours or "3.8814 rad/s" in item.ours
    assert bench.swings[0].frequency == pytest.approx(3.88135, rel=1e-3)
    assert "Nothing was filmed" in item.ours


@pytest.mark.parametrize(
    ("make", "number", "values"),
    [
        (mistakes.rotation_about_y, 1, {0: 0.0}),  # cos(2 * 45 degrees)
        (mistakes.velocity_over_ground, 2, {0: 1.0 / 0.063}),
        (mistakes.derivative_of_angles, 3, {0: 0.0}),
        (mistakes.rates_of_angles, 4, {0: math.sqrt(2.0)}),  # two unit vectors at right angles
        (
            mistakes.inertia_counted_twice,
            5,
            # the poles are those of docs/generated/published_models.md
            {0: 17.076 * 0.393**2, 1: 5.2015 / 3.6250, 2: 5.2015 / 5.2676},
        ),
        (mistakes.no_counter_torque, 6, {0: 0.173 / 0.11, 1: 9.5038 / 5.8293}),
        (mistakes.rotors_left_out, 7, {0: 27.6**2 * (2.42e-6 + 1.6e-7) / 1e-3}),
        (mistakes.friction_on_absolute_spin, 8, {0: math.sqrt(0.5)}),  # a wheel's axle leans by 45 degrees
        (mistakes.seam_curve, 10, {2: 0.0}),
        (mistakes.rounded_constants, 12, {2: 0.5}),
        (mistakes.error_over_count, 15, {0: math.sqrt(12.0)}),
        (mistakes.ball_inertia, 11, {0: 2.0 / 3.0 * 3.0 * 0.11**2}),
        (mistakes.nonholonomic_rates, 16, {1: 0.0}),
        # 3 wheels of 1 g m^2, sin^2(45 degrees) each
        (mistakes.locked_wheels_twice, 17, {0: 100.0 * 1.5e-3 / 0.193}),
        (mistakes.undefined_inverses, 18, {0: 2.0, 1: 2.0}),
        (mistakes.reference_and_stability, 19, {2: 1.0}),
    ],
)
def test_mistakes_are_shown_by_their_numbers(bench, make, number, values):
    mistake = make(bench)
    assert MISTAKES.index(make) == number - 1
    assert mistake.proven
    for place, value in values.items():
        assert mistake.shown_by[place].value == pytest.approx(value, rel=1e-4, abs=1e-12)


def test_clamp_of_the_thesis_winds_up(bench: Bench) -> None:
    """x_2 is the integral of 1 N m sin(2 pi t / 62.83 s) over 1 g m^2: at most 2 * 62.83 / (2 pi * 1e-3) rad/s."""
    mistake = mistakes.speed_clamp_printed(bench)
    assert mistake.proven
    assert mistake.shown_by[1].value == pytest.approx(62.83 / (math.pi * 1e-3), rel=1e-3)
    # the wheel is back at 27.7 rad/s just before the period's end: cos(2 pi t / T) = 1 - 27.7 * 2 pi * 1e-3 / T
    angle = math.acos(1.0 - 27.7 * 2.0 * math.pi * 1e-3 / 62.83)
    assert mistake.shown_by[2].value == pytest.approx(62.83 * (0.5 - angle / (2.0 * math.pi)), abs=0.05)


def test_gain_of_one_heading_falls_where_the_turned_one_stands(bench: Bench) -> None:
    mistake = mistakes.gain_at_other_headings(bench)
    assert mistake.proven
    # the heading is asked to turn by 180 degrees from 3 s on
    assert 3.0 < mistake.shown_by[0].value < 8.0


def test_linear_run_is_the_closed_loop_solution() -> None:
    """One sample after another, by the exponential of the whole loop's matrix, from SciPy."""
    robot = Robot.load("alten")
    gain, h = design_gain(robot).gain, robot.sensors.sample_time
    log = linear_run(robot, gain, hold(x=0.3, y=-0.2), duration=10.0)
    linear = Model(robot).linearize()
    # x' = A x + B u, u' = 0 over a sample
    whole = expm(h * np.block([[linear.A, linear.B], [np.zeros((3, 13))]]))
    wanted = np.zeros(10)
    wanted[:2] = (0.3, -0.2)
    x = np.zeros(10)
    for _ in range(len(log) - 1):
        x = (whole @ np.concatenate([x, gain @ (wanted - x)]))[:10]
    np.testing.assert_allclose(log.states[-1], x, atol=1e-9)
    np.testing.assert_allclose(x[:2], wanted[:2], atol=5e-3)


@pytest.mark.parametrize("plant", [pytest.param("twin", marks=pytest.mark.sample), "model"])
def test_run_on_a_grid_is_the_same_under_a_change_of_1e_12(plant: str) -> None:
    """So it is on another processor, whose last digits differ by much less; without the grid the twin's runs part."""

    def run(factor: float, *, grid: bool) -> NDArray[np.float64]:
        robot = Robot.load("alten")
        nominal = Scenario.nominal(robot)
        friction = replace(nominal.friction, rolling=factor * nominal.friction.rolling)
        if plant == "twin":
            twin = Twin(robot, replace(nominal, friction=friction))
            active = TwinOnGrid(twin) if grid else twin
        else:
            active = ModelOnGrid(Model(robot.replace(friction=friction)))
        log = simulate(active, nominal_controller(robot), CHANGE, duration=8.0, seed=1)
        return log.truth().states

    changed = 1.0 + 1e-12
    # a sample's own difference stays in what is read before rounding
    np.testing.assert_allclose(run(1.0, grid=True), run(changed, grid=True), rtol=0.0, atol=1e-9)
    if plant == "twin":
        assert np.abs(run(1.0, grid=False) - run(changed, grid=False)).max() > 1e-6


def test_page_and_results_have_every_verdict(bench: Bench) -> None:
    items = {
        "Figure III.1": figures.figure_iii_1(bench),
        "Table 4.1": replace(item_of(check(value=0.0, lowest=1.0)), title="<b>"),
    }
    made = Reproduction(bench=bench, items=items, mistakes=(mistakes.seam_curve(bench),))
    page = page_of(reproduction_report(made))
    assert figure_count(page) == 1
    assert "&lt;b&gt;" in page
    assert "Of 2, 1 agree, 1 do not agree." in page
    results = json.loads(results_text(reproduction_report(made).to_dict()))
    assert [one["verdict"] for one in results["items"]] == ["agrees", "does not agree"]
    assert results["mistakes"][0]["proven"] is True
