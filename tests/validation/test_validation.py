"""Validation against logs whose truth is known, and logs that can show nothing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.control.controller import Controller
from ballbot.control.references import square
from ballbot.errors import InputError
from ballbot.findings import texts
from ballbot.log import STATE_NAMES, Log
from ballbot.mechanics.model import Model
from ballbot.results import plain
from ballbot.robot import Friction, Robot
from ballbot.robot.components import scaled_friction
from ballbot.simulation.run import simulate
from ballbot.validation import (
    ErrorPair,
    ModelPair,
    Validation,
    findings,
    join_validations,
    recover_gain,
    validate,
    validate_pair,
)
from ballbot.validation.closed_loop import ClosedLoop, closed_loop, delay_of
from ballbot.validation.horizons import compare_horizons
from ballbot.validation.models import (
    Case,
    forecast,
    in_heading_frame,
    recoverable_lean,
    stretches,
    window_starts,
)
from ballbot.validation.open_loop import OpenLoop
from tests.support.validation_examples import (
    NOISE,
    gain,
    noisy_log,
    noisy_validation,
    perfect_log,
    true_robot,
    with_noise,
)


def _open_loop(validation: Validation) -> OpenLoop:
    assert validation.open_loop is not None
    return validation.open_loop


def _models(robot: Robot) -> ModelPair:
    return ModelPair.by_friction(Model(robot))


# --- rows that count ---


@given(
    gaps=st.lists(st.integers(1, 199), max_size=5),
    held=st.lists(st.tuples(st.floats(0.0, 3.0), st.floats(0.05, 2.0)), min_size=1, max_size=4),
    samples=st.integers(1, 30),
)
def test_windows_stay_within_holdout_intervals_and_cross_no_gap(gaps, held, samples):
    step = np.full(200, 0.01)
    step[gaps] = 0.05
    log = Log({"t": np.cumsum(step)})
    times = [(start, start + length) for start, length in held]
    try:
        parts = stretches(log, times)
    except InputError:
        assert not any(((log.t >= a) & (log.t < b)).any() for a, b in times)
        return
    for start in window_starts(parts, samples=samples, every=3):
        t = log.t[start : start + samples + 1]
        assert len(t) == samples + 1
        assert np.all(np.diff(t) < 0.015)
        assert all(any(a <= moment < b for a, b in times) for moment in t)


# --- the controller of a log ---


def test_the_gain_is_recovered_exactly_from_a_simulated_log():
    found = recover_gain(perfect_log())
    assert found.delay == 0
    assert found.torque_limit is None
    # the law is linear and the log is without noise: what remains is the least squares' rounding
    np.testing.assert_allclose(found.gain, gain(), atol=1e-6)
    assert np.all(found.r_squared > 1.0 - 1e-10)


@pytest.mark.parametrize("delay", [1, 3])
def test_a_late_controller_is_recovered_with_its_delay(delay):
    random = np.random.default_rng(0)
    states = random.normal(size=(600, 10)) * 0.1
    log = _log_of(states, np.roll(in_heading_frame(-states, states[:, 4]) @ gain().T, delay, axis=0))
    found = recover_gain(log)
    assert found.delay == delay
    # rolling put the last torques before the first states: `delay` of 600 rows are not of the law
    np.testing.assert_allclose(found.gain[:, 2], gain()[:, 2], rtol=0.1)


def test_clipped_samples_do_not_bend_the_gain():
    random = np.random.default_rng(0)
    states = random.normal(size=(800, 10)) * 0.05
    torques = np.clip(in_heading_frame(-states, states[:, 4]) @ gain().T, -1.0, 1.0)
    assert np.mean(np.abs(torques) == 1.0) > 0.05
    found = recover_gain(_log_of(states, torques))
    assert found.torque_limit == 1.0
    np.testing.assert_allclose(found.gain, gain(), atol=1e-9)


def test_torques_that_follow_no_law_are_refused():
    random = np.random.default_rng(0)
    with pytest.raises(InputError, match="explains only"):
        recover_gain(_log_of(random.normal(size=(500, 10)), random.normal(size=(500, 3))))


def test_another_controller_than_the_logs_is_refused():
    own, other = Controller(true_robot(), gain()), Controller(true_robot(), 3.0 * gain())
    assert delay_of(own, perfect_log()) == 0
    with pytest.raises(InputError, match="the controller that recorded the log"):
        delay_of(other, perfect_log())


# --- forecasts ---


def test_a_forecast_with_the_true_friction_is_the_log():
    log = perfect_log()
    states = forecast([Model(true_robot())], log, np.array([0, 700, 2000]), 100)[0]
    measured = np.stack([log.states[k + 1 : k + 101] for k in (0, 700, 2000)])
    # the log was simulated by the same engine; half a second lets rounding grow by e^(5.2/2), 13 times
    np.testing.assert_allclose(states, measured, atol=1e-10)


def test_the_recoverable_lean_is_where_the_torques_balance_gravity():
    model = Model(Robot.load("alten"))
    linear = model.linearize()
    limit = model.robot.drive.torque_limit
    small = min(
        limit * np.abs(linear.B[7]).sum() / linear.A[7, 2], limit * np.abs(linear.B[8]).sum() / linear.A[8, 3]
    )
    # the linear model is off by about lean^2/6, 7 % at 0.65 rad, and more through the mass matrix
    assert recoverable_lean(model) == pytest.approx(small, rel=0.15)
    weak = model.robot.replace({"drive.torque_limit": 1.0})
    assert recoverable_lean(Model(weak)) == pytest.approx(small / limit, rel=0.02)


# --- the three validations ---


def test_with_the_true_friction_only_noise_is_left_and_without_it_is_worse():
    validation = noisy_validation()
    loop = _open_loop(validation)
    floor = np.sqrt(loop.noise_floor**2 + NOISE**2)
    # about 24 runs whose errors are one-sided falls: their rms scatters by some 30 %
    assert np.all(loop.errors.rmse[0] < 2.0 * floor)
    assert np.all(loop.errors.ratio > 1.5)
    assert validation.closed_loop is not None
    assert np.all(validation.closed_loop.restarted.ratio[:7] > 1.5)
    horizon = validation.horizon
    assert horizon.horizons[0] == pytest.approx(0.005)
    assert horizon.horizons[-1] == pytest.approx(0.5)
    # one sample ahead noise decides, but for what friction does to the ball's speed in 5 ms
    np.testing.assert_allclose(horizon.ratio[0, :5], 1.0, atol=0.01)
    np.testing.assert_allclose(horizon.ratio[0, 5:], 1.0, atol=0.3)
    np.testing.assert_allclose(horizon.rmse[0], validation.horizon.noise_floor, rtol=0.5)
    assert loop.remarks() == ()
    assert validation.adequacy.up_to == horizon.horizons[-1]
    assert findings(validation)[0].code == "adequacy"


def test_a_model_of_wrong_friction_is_rejected_from_a_short_horizon_on():
    robot, log = true_robot(), noisy_log()
    wrong = robot.replace(friction=scaled_friction(robot.friction, 1.2))
    case = Case(models=_models(wrong), log=log, parts=stretches(log))
    assert compare_horizons(case).adequate_up_to < 0.05


def test_on_a_perfect_log_closed_loop_repeats_the_log():
    log, driver = perfect_log(), Controller(true_robot(), gain())
    case = Case(models=_models(true_robot()), log=log, parts=stretches(log), controller=driver)
    repeated = closed_loop(case)
    assert isinstance(repeated, ClosedLoop)
    # rounding, over 4 s of a closed loop that sticks and slips
    assert np.all(repeated.restarted.rmse[0] < 1e-6)
    assert np.all(repeated.restarted.rmse[1, :2] > 0.02)


def test_only_holdout_intervals_count():
    log = noisy_log().between(0.0, 14.0)
    spoiled = np.where((log.t > 6.0) & (log.t < 12.0), log["theta"], log["theta"] + 0.3)
    held = [(6.5, 11.5)]
    clean, other = (
        validate_pair(_models(true_robot()), one, holdout=held)
        for one in (log, log.with_columns({"theta": spoiled}))
    )
    np.testing.assert_array_equal(*(_open_loop(one).errors.by_run[:, 0] for one in (clean, other)))
    np.testing.assert_array_equal(clean.prediction.residuals, other.prediction.residuals)
    assert clean.duration == pytest.approx(5.0, abs=0.01)


@pytest.mark.slow
def test_wrong_friction_is_named_with_the_states_it_spoils():
    # a robot without friction, held against a model that has it
    bare = true_robot().replace(friction=Friction.none(3))
    start = np.array([0.0, 0.0, 0.02, -0.02, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    log = simulate(
        Model(bare), Controller(bare, gain()), square(period=16.0), duration=24.0, initial_state=start
    )
    assert "simulated by the model without friction itself" in str(
        validate(true_robot(), log.without_truth()).no_evidence
    )
    validation = validate(true_robot(), with_noise(log.without_truth(), scale=0.1))
    loop = _open_loop(validation)
    named, verdicts = " ".join(texts(loop.remarks())), loop.errors.verdicts()
    worse = [name for name, verdict in zip(STATE_NAMES, verdicts, strict=True) if verdict == "worse"]
    assert set(worse) >= {"x", "theta", "phi"}
    assert all(f"{name}: the model with friction is worse than the one without" in named for name in worse)
    assert any("eason" in finding for finding in texts(findings(validation)))


# --- refusals ---


def test_a_log_without_a_reference_has_no_closed_loop_and_gives_the_reason():
    log = noisy_log().between(0.0, 8.0)
    bare = Log({name: values for name, values in log.columns.items() if not name.startswith("ref_")})
    validation = validate(true_robot(), bare)
    assert validation.closed_loop is None
    assert "ref_x" in validation.refused["closed_loop"]
    assert any(finding.startswith("No closed-loop validation") for finding in texts(findings(validation)))


def test_invalid_validations_are_refused():
    log = perfect_log().between(0.0, 4.0)
    with pytest.raises(InputError, match="holdout intervals"):
        validate_pair(_models(true_robot()), log, holdout=[(100.0, 120.0)])
    with pytest.raises(InputError, match="phi"):
        validate(true_robot(), log.with_columns({"phi": np.full(len(log), np.nan)}))
    with pytest.raises(InputError, match="u4, but the robot has 3 wheels"):
        validate(true_robot(), log.with_columns({"u4": np.roll(log["u3"], 1)}))
    with pytest.raises(InputError, match="sample time"):
        validate(true_robot(), log.select(slice(None, None, 2)), controller=Controller(true_robot(), gain()))


def _log_of(states: np.ndarray, torques: np.ndarray) -> Log:
    columns: dict[str, np.ndarray] = {"t": 0.005 * np.arange(len(states))}
    columns |= {f"u{i + 1}": torques[:, i] for i in range(torques.shape[1])}
    columns |= {name: states[:, i] for i, name in enumerate(STATE_NAMES)}
    columns |= {name: np.zeros(len(states)) for name in ("ref_x", "ref_y", "ref_psi")}
    return Log(columns)


@pytest.mark.slow
def test_several_logs_are_validated_as_each_by_itself_and_joined(tmp_path):
    whole = noisy_log().without_truth()
    logs = {"first": whole.between(0.0, 4.0), "second": whole.between(4.0, 9.0)}
    logs["second"].write(tmp_path / "second.csv")
    parts = [validate(true_robot(), log) for log in logs.values()]
    joined = join_validations(parts)
    both = validate(true_robot(), {**logs, "second": tmp_path / "second.csv"})
    assert both.duration == joined.duration == pytest.approx(9.0, abs=0.1)
    assert plain(both.results()) == plain(joined.results())


def _still() -> Log:
    log = perfect_log().between(0.0, 2.0)
    return log.with_columns({name: np.zeros(len(log)) for name in log.names if name != "t"})


def test_a_log_that_a_model_simulated_shows_nothing():
    validation = validate(true_robot(), perfect_log().between(0.0, 6.0))
    sentence = "This log was simulated by the model with friction itself"
    assert validation.no_evidence is not None
    assert validation.no_evidence.startswith(sentence)
    assert validation.open_loop is None
    assert validation.closed_loop is None
    # one sentence everywhere
    assert validation.summary().sentences == (validation.no_evidence,)
    assert texts(findings(validation)) == [validation.no_evidence]
    results = validation.results()
    assert results["no_open_loop"] == results["no_closed_loop"] == validation.no_evidence


def test_a_log_at_rest_shows_nothing():
    models = ModelPair.by_friction(Model(true_robot()))
    validation = validate_pair(models, _still())
    assert validation.no_evidence is not None
    assert validation.no_evidence.startswith("The log does not move")
    assert validation.closed_loop is None


def test_logs_that_show_nothing_are_left_out_of_those_joined():
    models = ModelPair.by_friction(Model(true_robot()))
    still, moving = validate_pair(models, _still()), noisy_validation()
    joined = join_validations([still, moving])
    assert joined.left_out == (still.no_evidence,)
    assert joined.duration == moving.duration
    assert still.no_evidence in texts(findings(joined))
    assert join_validations([still, still]).no_evidence == still.no_evidence


def test_an_error_below_the_floor_counts_as_the_floor():
    runs = [np.full((10, 10), value) for value in np.linspace(0.9, 1.1, 9)]
    exact = ErrorPair.of_runs(
        [np.zeros((10, 10))] * 9, [1e-16 * run for run in runs], [1e-13 * run for run in runs]
    )
    assert np.all(exact.unresolved)
    np.testing.assert_allclose(exact.ratio, 1.0)
    np.testing.assert_allclose(exact.ratio_interval, 1.0)
    assert exact.ratio_interval is exact.ratio_interval  # its bootstrap is drawn once
    assert set(exact.verdicts()) == {"undecided"}
    assert np.isnan(exact.normalised_rmse).all()
