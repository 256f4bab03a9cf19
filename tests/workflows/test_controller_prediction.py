"""Predicted performance: intervals that hold, files that read back, verdicts on logs whose truth is known."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot import Robot
from ballbot.control.file import controller_text, write_controller
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.errors import InputError
from ballbot.estimation import named_estimator
from ballbot.files import write_text
from ballbot.findings import warning
from ballbot.log import Log
from ballbot.mechanics.model import Model
from ballbot.report.study import previous_controller_text
from ballbot.results import as_json
from ballbot.robot.components import scaled_friction
from ballbot.simulation.run import simulate
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin import Scenario, Twin
from ballbot.twin.faults import Timing
from ballbot.twin.imperfections import imperfections_of
from ballbot.workflows.controller_choice import NamedCourse, PlantDraw, choose_controller
from ballbot.workflows.controller_prediction import (
    ControllerPrediction,
    ControllerVerdict,
    checksum_of,
    course_of,
    evaluate_log,
    lognormal_interval,
    performance_intervals,
    predict,
    read_prediction,
)
from ballbot.workflows.metrics import QUANTITIES, LogScore

ALTEN = Robot.load("alten")
SCENARIO = Scenario.nominal(ALTEN)
KNOWN = ALTEN.replace(friction=SCENARIO.friction)
CONTROLLER = precise_controller(KNOWN)
#: half of the square: with less motion the parts of the torque cannot be separated
COURSE = NamedCourse(name="square", duration=24.0)

# most need a run around the square with every part, whose forms are compiled first
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def log() -> Log:
    """Return the log of a simulated run of the precise controller."""
    plant = SensedPlant(Model(KNOWN), imperfections_of(SCENARIO, known=KNOWN), estimator=CONTROLLER.estimator)
    reference = COURSE.reference_spec.reference()
    return simulate(plant, CONTROLLER, reference, duration=COURSE.duration, seed=1).without_truth()


@pytest.fixture(scope="module")
def prediction(log: Log) -> ControllerPrediction:
    """Return a prediction about what that log shows, and without compensation forty times its errors."""
    seen = LogScore.of(log, torque_limit=CONTROLLER.torque_limit)
    random = np.random.default_rng(0)
    numbers = np.array(list(asdict(seen).values())) * np.exp(0.1 * random.standard_normal((20, 5)))
    similar = [LogScore(**dict(zip(QUANTITIES, each, strict=True))) for each in numbers.tolist()]
    without = [
        replace(one, peak_error=40.0 * one.peak_error, rms_error=40.0 * one.rms_error) for one in similar
    ]
    factor = dict.fromkeys(QUANTITIES, (0.6, 1.7))
    return ControllerPrediction(
        course=COURSE,
        controller="precise",
        checksum=checksum_of(CONTROLLER),
        torque_limit=CONTROLLER.torque_limit,
        scenario="nominal",
        draws=20,
        chosen=performance_intervals(similar, discrepancy=factor),
        none=performance_intervals(without, discrepancy=factor),
        log_findings=("short",),
    )


@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    spread=st.floats(0.01, 2.0),
    center=st.floats(-10.0, 10.0),
    count=st.integers(6, 40),
)
def test_interval_holds_95_percent_of_new_lognormal_values(seed, spread, center, count):
    random = np.random.default_rng(seed)
    trials, inside = 400, 0
    for _ in range(trials):
        *sample, new = np.exp(center + spread * random.standard_normal(count + 1))
        inside += lognormal_interval(np.array(sample)).place(float(new)) == "inside"
    # 380 expected, standard deviation 4.4; five of them
    assert abs(inside - 0.95 * trials) < 22


def stored(prediction: ControllerPrediction, path: Path) -> Path:
    write_text(path, as_json({"prediction": prediction}))
    return path


def test_stored_prediction_reads_back(prediction: ControllerPrediction, tmp_path: Path):
    found = read_prediction(stored(prediction, tmp_path / "results.json"))
    assert found == prediction


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda tree: tree.clear(), "holds no prediction; give the results.json of a `ballbot study`"),
        (lambda tree: tree["prediction"]["chosen"]["lean"].update(low="a"), r"chosen\.lean\.low is 'a'"),
        (lambda tree: tree["prediction"]["chosen"].pop("lean"), "of another version; run"),
    ],
)
def test_wrong_files_get_one_sentence(change, sentence, prediction: ControllerPrediction, tmp_path: Path):
    path = stored(prediction, tmp_path / "results.json")
    tree = json.loads(path.read_text(encoding="utf-8"))
    change(tree)
    path.write_text(json.dumps(tree), encoding="utf-8")
    with pytest.raises(InputError, match=sentence) as refusal:
        read_prediction(path)
    assert "\n" not in str(refusal.value)


def test_previous_controller_is_the_one_replaced(tmp_path: Path):
    baseline = nominal_controller(KNOWN)
    first = previous_controller_text(tmp_path, new=CONTROLLER, baseline=baseline)
    assert first.endswith(controller_text(baseline))
    assert first.startswith("# The controller without friction compensation")
    older = CONTROLLER.with_compensation("partial")
    write_controller(older, tmp_path / "controller.toml")
    assert previous_controller_text(tmp_path, new=CONTROLLER, baseline=baseline) == controller_text(older)
    # the same study once more keeps what was before it, and so does one that recommends none
    write_controller(CONTROLLER, tmp_path / "controller.toml")
    write_controller(older, tmp_path / "previous_controller.toml")
    assert previous_controller_text(tmp_path, new=CONTROLLER, baseline=baseline) == controller_text(older)
    (tmp_path / "controller.toml").unlink()
    assert previous_controller_text(tmp_path, new=CONTROLLER, baseline=baseline) == controller_text(older)


def test_run_as_predicted_is_kept(prediction: ControllerPrediction, log: Log):
    verdict = evaluate_log(prediction, log, CONTROLLER)
    assert verdict.recommendation == "keep"
    assert verdict.confirmed
    assert {one.place for one in verdict.quantities} == {"inside"}
    assert not verdict.foreign
    found = [warning("short", "The log is short."), warning("torque-delay", "The torques are late.")]
    other = log.with_columns({name: -log[name] for name in ("u1", "u2", "u3")})
    verdict = evaluate_log(prediction, other, CONTROLLER, log_findings=found)
    assert verdict.foreign  # torques of another controller
    assert verdict.differences == ("The torques are late.",)  # the study's logs were short, too


def displaced(log: Log, size: float) -> Log:
    """Return a log whose robot stands that far from where it is asked to be [m]."""
    return log.with_columns({"x": log["x"] + size})


def test_larger_error_refutes_by_its_factor_and_advises_weaken_then_revert(prediction, log):
    low = prediction.none["peak_error"].low
    verdict = evaluate_log(prediction, displaced(log, 0.7 * low), CONTROLLER)
    assert not verdict.confirmed
    assert verdict.recommendation == "weaken"
    peak = verdict.quantities[0]
    # the true errors of some millimetres add to the displacement, at most; the verdict has two digits
    assert peak.factor == pytest.approx(0.7 * low / prediction.chosen["peak_error"].high, rel=0.1)
    assert verdict.reason.startswith("Refuted: the peak error is ")
    assert f"{peak.factor:.2g} times" in verdict.reason
    worse = evaluate_log(prediction, displaced(log, 1.1 * low), CONTROLLER)
    assert (worse.confirmed, worse.recommendation) == (False, "revert")


def test_fall_reverts_even_if_its_reason_is_not_logged(prediction, log):
    part = log.between(0.0, 7.0)
    fallen = part.with_columns({"theta": part["theta"] + 0.4 * np.maximum(part.t - 6.0, 0.0)})
    verdict = evaluate_log(prediction, fallen, CONTROLLER)
    assert verdict.recommendation == "revert"
    assert verdict.ended is not None
    assert "fallen" in verdict.ended


def test_single_missing_values_do_not_count_and_many_are_refused(prediction, log):
    x = log["x"].copy()
    x[[300, 1500]] = np.nan
    verdict = evaluate_log(prediction, log.with_columns({"x": x}), CONTROLLER)
    assert verdict.recommendation == "keep"
    x[::10] = np.nan
    with pytest.raises(InputError, match="480 of 4800 rows of the log lack a state"):
        evaluate_log(prediction, log.with_columns({"x": x}), CONTROLLER)


def test_another_course_controller_or_sample_time_is_refused(prediction, log):
    moved, coarse = log.with_columns({"ref_x": log["ref_x"] + 0.3}), log.select(slice(None, None, 2))
    for other, driver, sentence in (
        (moved, CONTROLLER, "is not the course 'square'"),
        (log, CONTROLLER.with_compensation("partial"), "not the one whose performance is predicted"),
        (coarse, CONTROLLER, r"sample time is 0\.01 s and the controller's 0\.005 s"),
    ):
        with pytest.raises(InputError, match=sentence):
            evaluate_log(prediction, other, driver)


@settings(max_examples=10, deadline=None)
@given(before=st.integers(1, 400), shift=st.floats(-100.0, 100.0))
def test_course_is_found_after_rows_before_it(before, shift, prediction: ControllerPrediction, log: Log):
    h = log.sample_time
    columns = {name: np.concatenate([np.repeat(log[name][0], before), log[name]]) for name in log.names}
    columns["t"] = shift + h * np.arange(len(log) + before)
    found = course_of(Log(columns), prediction, sample_time=h)
    assert len(found) == len(log)
    np.testing.assert_array_equal(found["x"], log["x"])


@pytest.mark.sample
def test_prediction_from_perturbed_plants_holds_on_the_twin():
    controllers = {"none": nominal_controller(KNOWN), "precise": CONTROLLER}
    plants = [
        PlantDraw(
            robot=ALTEN.replace(friction=scaled_friction(SCENARIO.friction, 0.8 + 0.08 * k)),
            known=KNOWN,
            scenario=SCENARIO,
            seed=k,
        )
        for k in range(6)
    ]
    choice = choose_controller(controllers, plants, course=COURSE)
    found = predict(choice)
    assert found is not None
    assert found.controller == "precise"

    def verdict(scenario: Scenario) -> ControllerVerdict:
        state = named_estimator("kalman", KNOWN, sample_time=CONTROLLER.sample_time)
        reference = COURSE.reference_spec.reference()
        log = simulate(
            Twin(ALTEN, scenario, estimator=state), CONTROLLER, reference, duration=COURSE.duration, seed=7
        )
        return evaluate_log(found, log.without_truth(), CONTROLLER)

    assert verdict(SCENARIO).recommendation == "keep"
    # 80 ms late it still stands, and wanders less than the nominal gain does; from 90 ms on it falls
    late = verdict(replace(SCENARIO, timing=Timing(delay=24)))
    assert late.recommendation == "revert"
    assert late.ended is not None
