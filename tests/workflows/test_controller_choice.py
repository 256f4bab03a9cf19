"""The choice of a controller: its rule, its plants and its statistics."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from ballbot.control.controller import Controller
from ballbot.control.lqr import LqrDesign
from ballbot.control.presets import KINDS, nominal_controller, precise_controller
from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.twin.scenario import Scenario
from ballbot.workflows.controller_choice import (
    CANDIDATES,
    SQUARE,
    Confirmation,
    ControllerChoice,
    NamedCourse,
    PlantDraw,
    Trial,
    candidates,
    equal_best,
    smoothest_of_best,
)
from ballbot.workflows.controller_prediction import discrepancy_of
from ballbot.workflows.grid import Condition, grid_runs, run_grid
from ballbot.workflows.metrics import QUANTITIES, LogScore, Score
from ballbot.workflows.statistics import median_with_interval
from ballbot.workflows.study import sampled_at
from tests.support.control_examples import FRICTION, alten
from tests.support.scores import score_of as run


@cache
def nominal() -> Controller:
    return nominal_controller(alten(FRICTION))


def trial(*runs: Score) -> Trial:
    return Trial(controller=nominal(), scores=runs)


def around(peak: float, roughness: float) -> Trial:
    """Return a trial of twenty runs within 10 % of a peak error."""
    return trial(*(run(peak * factor, roughness) for factor in np.linspace(0.9, 1.1, 20)))


def test_of_overlapping_intervals_the_smoothest_wins():
    trials = {"none": around(0.3, 0.01), "rough": around(0.0100, 0.09), "smooth": around(0.0102, 0.05)}
    assert equal_best(trials) == ("rough", "smooth")
    assert smoothest_of_best(trials) == "smooth"


def test_a_candidate_that_falls_once_is_excluded():
    best = around(0.01, 0.05)
    fallen = replace(best, scores=(*best.scores[:-1], run(0.01, ended="fallen")))
    trials = {"none": around(0.3, 0.05), "precise": fallen}
    assert fallen.falls == 1
    assert np.isnan(fallen.peaks[-1])
    assert smoothest_of_best(trials) == "none"
    assert equal_best({"precise": fallen}) == ()


def choice_of(trials: dict[str, Trial]) -> ControllerChoice:
    return ControllerChoice(
        plants=(), course=SQUARE, trials=trials, equals=equal_best(trials), chosen=smoothest_of_best(trials)
    )


def test_the_smoothest_of_equals_may_compensate_nothing_and_has_the_best_compensated_one_beside_it():
    # on the nominal twin's square: peak errors within their intervals, half as rough
    trials = {
        "none": around(0.378, 0.064),
        "full": around(0.099, 0.16),
        "partial": around(0.081, 0.17),
        "precise": around(0.0070, 0.060),
        "precise_without_compensation": around(0.0075, 0.032),
    }
    made = {
        name: replace(one, controller=nominal().with_compensation(CANDIDATES[name][1]))
        for name, one in trials.items()
    }
    found = choice_of(made)
    assert (found.chosen, found.compensated) == ("precise_without_compensation", "precise")
    assert choice_of({"none": made["none"]}).compensated is None


def test_every_kind_that_asks_is_tried_if_the_robot_can_have_it(monkeypatch):
    def impossible(*_: object, **__: object) -> LqrDesign:
        raise InputError("no such gain")

    soft = KINDS["nominal"]
    for name, kind in (
        ("third", replace(soft, name="third")),
        ("fourth", replace(soft, name="fourth", design=impossible, candidates={})),
    ):
        monkeypatch.setitem(CANDIDATES, name, (kind, "partial"))
    found = SimpleNamespace(robot=alten(FRICTION))
    made = candidates(found, sample_time=0.005)  # pyright: ignore[reportArgumentType]
    assert set(made) == {*CANDIDATES} - {"fourth"}
    assert made["third"].compensation == "partial"
    assert (made["precise"].parts.integral, made["precise_without_compensation"].compensation) != (
        None,
        "full",
    )
    widest = discrepancy_of("third")
    for calibrated in (discrepancy_of("full"), discrepancy_of("precise")):
        assert all(
            widest[name][0] <= low and high <= widest[name][1] for name, (low, high) in calibrated.items()
        )


def test_ratios_are_taken_draw_by_draw():
    none = trial(*(run(peak) for peak in (0.1, 0.2, 0.4, 0.8, 1.6, 3.2)))
    better = trial(*(run(peak / 10.0) for peak in (0.1, 0.2, 0.4, 0.8, 1.6, 3.2)))
    ratio = none.ratio_to(better)
    # the peaks spread by 32 times, their ratio not at all
    assert (ratio.low, ratio.median, ratio.high) == pytest.approx((10.0, 10.0, 10.0))


@given(st.integers(6, 60), st.integers(0, 2**32 - 1))
def test_median_interval_contains_the_median_and_respects_the_binomial_limit(count, seed):
    values = np.random.default_rng(seed).standard_normal(count)
    found = median_with_interval(values)
    assert found.low <= found.median <= found.high
    below = int((values < found.low).sum())
    # P(interval misses) = 2 P(at most `below` of n values lie below the median)
    assert 2.0 * stats.binom.cdf(below, count, 0.5) <= 0.05
    assert 2.0 * stats.binom.cdf(below + 1, count, 0.5) > 0.05


@given(st.floats(0.002, 0.02))
def test_a_scenario_is_sampled_as_the_logs_are(sample_time):
    scenario = sampled_at(Scenario.nominal(alten()), sample_time)
    steps = sample_time / scenario.timestep
    assert scenario.sensors.sample_time == sample_time
    assert steps == pytest.approx(round(steps), abs=1e-9)
    assert 0.8 <= scenario.timestep / Scenario.nominal(alten()).timestep <= 1.25


def test_a_draw_on_the_loop_is_the_plant_one_period_at_a_time_and_another_with_another_seed():
    robot = alten(FRICTION)
    plant = PlantDraw(robot=robot, known=robot, scenario=Scenario.nominal(robot), seed=3)
    course = NamedCourse(name="hold", duration=7.0)  # errors count from 6 s on

    conditions = [
        Condition(
            plant=one.on_loop,
            reference=course.reference_spec.reference,
            duration=course.duration,
            seed=one.seed,
        )
        for one in (plant, plant, replace(plant, seed=4))
    ]
    grid = grid_runs({"precise": precise_controller(robot)}, conditions)
    one, again, other = run_grid(grid, lambda _, log: log).answers
    np.testing.assert_array_equal(one.states, again.states)
    assert (one.states != other.states).any()
    # rounding differs, and sticking and play part the two later; for a second they are the same
    np.testing.assert_allclose(one.states[:200], grid[0].log().states[:200], atol=1e-9)
    with pytest.raises(InputError, match="nothing to compare"):
        run_grid([])


def confirmed(*, loop: tuple[Trial, Trial], twin: tuple[Trial, Trial]) -> Confirmation:
    return Confirmation(
        course=SQUARE,
        on_loop=dict(zip(("none", "precise"), loop, strict=True)),
        on_twin=dict(zip(("none", "precise"), twin, strict=True)),
    )


def test_the_twin_contradicts_by_a_fall_or_by_the_other_order():
    loop = around(0.3, 0.01), around(0.01, 0.05)
    few = [trial(*(run(peak * factor) for factor in (0.9, 1.0, 1.1))) for peak in (0.3, 0.01)]
    assert confirmed(loop=loop, twin=(few[0], few[1])).contradiction is None
    turned = confirmed(loop=loop, twin=(few[1], few[0])).contradiction
    assert turned is not None
    assert "worse than none in every run" in turned
    fallen = replace(few[1], scores=(*few[1].scores[:-1], run(0.01, ended="fallen")))
    fell = confirmed(loop=loop, twin=(few[0], fallen)).contradiction
    assert fell is not None
    assert "precise fell in 1 of 3 runs" in fell


def test_a_performance_is_read_from_the_logged_state_and_not_from_the_truth():
    t = np.arange(0.0, 10.0, 0.005)
    zero = np.zeros_like(t)
    columns = dict.fromkeys(("y", "theta", "phi", "psi", "ref_x", "ref_y", "ref_psi"), zero)
    rates = {f"{name}_dot": zero for name in ("x", "y", "theta", "phi", "psi")}
    torques = {f"u{i}": 0.1 * np.sign(np.sin(200.0 * t)) for i in (1, 2, 3)}
    log = Log(
        {"t": t, "x": 0.02 * np.ones_like(t), "true_x": zero, "true_y": zero, **columns, **rates, **torques}
    )
    log = log.with_columns(
        {"theta": np.where(t == t[700], 0.03, 0.0), "phi": np.where(t == t[700], 0.04, 0.0)}
    )
    found = LogScore.of(log, torque_limit=0.5)
    assert found.peak_error == pytest.approx(0.02)
    assert found.rms_error == pytest.approx(0.02)
    # about 0.05: the two add in squares
    assert found.lean == pytest.approx(np.arccos(np.cos(0.03) * np.cos(0.04)))
    assert found.torque_margin == pytest.approx(0.8)
    assert found.roughness == pytest.approx(np.sqrt(np.mean(np.diff(torques["u1"]) ** 2)))
    # measured torques beyond the limit leave no margin, and not less
    assert LogScore.of(log, torque_limit=0.099).torque_margin == 0.0
    assert len(QUANTITIES) == 5
