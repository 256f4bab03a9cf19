"""Friction from logs, end to end: a known truth is found, errors by horizon, and findings on uninformative logs."""

import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from ballbot import Robot
from ballbot.errors import InputError
from ballbot.findings import texts
from ballbot.fitting.run import DEFAULT_RUN, Run, Threads
from ballbot.identification import Bounds, Identification, Progress, cross_validate, identify
from ballbot.identification.excitation import check_excitation
from ballbot.identification.holdout import friction_by_horizon
from ballbot.identification.identify import IdentificationOptions, estimated_parameters
from ballbot.identification.prediction import Predictor
from ballbot.identification.windows import cut_windows
from ballbot.log import STATE_NAMES, Log
from tests.support.control_examples import alten
from tests.support.identification_examples import TRUTH, balancing_log, exact, late, noisy
from tests.workflows.test_excite import assert_errors_are_those_expected

#: a fit that ended in another basin would be off the truth by more than the 4 standard errors that the tests allow;
#: an inner step of 2.5 ms changes a cost by 1e-4, and takes 2.5 times less work; profiles have tests of their own
#: (test_balancing.py, tests/fitting/test_fit.py)
BRIEF = IdentificationOptions(search_windows=24, step=2.5e-3, most_profiles=0)
#: v_s and delta held at the truth where others are looked at: the search follows their long valley in half of its steps
HELD = Bounds({"stribeck_speed": (0.6, 0.6), "stribeck_exponent": (1.1, 1.1)})


@pytest.fixture(scope="module")
def found() -> Identification:
    return identify(exact(), noisy(balancing_log(), seed=5), seed=1, options=BRIEF)


@pytest.mark.slow
def test_known_friction_is_found_within_its_standard_errors(found):
    deviation = (found.values - TRUTH) / found.errors
    # 4 of them: one in 16 000 if normal, and twelve are looked at
    assert np.abs(deviation).max() < 4.0
    # the errors say something: Coulomb friction of 0.1 N m to better than a quarter, of which the variation between
    # logs alone is 0.016 N m for one log (0.105 of c + s)
    assert max(found.standard_errors["c"]) < 0.025
    assert found.standard_errors["C_rr"] < 0.001
    assert max(found.held_out.with_over_without.values()) < 0.5
    held_out, fitted = (
        {(span.log, span.start) for span in spans} for spans in (found.held_out.spans, found.fit.spans)
    )
    assert not fitted & held_out
    # 8 s of every 28 s, and windows across the edges
    assert 0.2 < len(held_out) / len(fitted | held_out) < 0.4


@pytest.mark.slow
def test_errors_are_those_that_excite_expects(found):
    assert_errors_are_those_expected(found, balancing_log())


def quick(log: Log, *, bounds: Bounds | None = None, run: Run = DEFAULT_RUN) -> Identification:
    options = replace(BRIEF, most_steps=4)
    return identify(alten(), log, bounds=bounds, window=0.1, seed=3, options=options, run=run)


@pytest.mark.slow
def test_result_does_not_depend_on_the_number_of_threads():
    log = noisy(balancing_log(), seed=2).between(6.0, 10.0)
    one, three = (quick(log, run=Run(executor=Threads(count=count))) for count in (1, 3))
    assert json.dumps(one.to_dict()) == json.dumps(three.to_dict())


@pytest.mark.slow
def test_a_parameter_without_influence_gets_no_number():
    # without break-away friction nothing depends on where and how it fades
    log = noisy(balancing_log(), seed=4).between(6.0, 10.0)
    found = quick(log, bounds=Bounds({"stribeck": (0.0, 0.0)}))
    assert math.isnan(found.parameters["v_s"])
    assert math.isnan(found.parameters["delta"])
    assert math.isnan(found.standard_errors["v_s"])
    assert any(sentence.startswith("v_s and delta have no influence") for sentence in texts(found.findings))
    assert found.to_dict()["parameters"]["v_s"] is None
    assert found.robot.friction.stribeck_speed == alten().friction.stribeck_speed  # as it was before
    assert not found.unknown[:9].any()


@pytest.mark.slow
def test_active_bounds_are_kept_and_reported():
    log = noisy(balancing_log(), seed=4).between(6.0, 10.0)
    bounds = Bounds({"rolling": (0.012, 0.05), "viscous": (0.0, 0.03)})  # the truth is 0.007
    found = quick(log, bounds=bounds)
    assert found.parameters["C_rr"] == 0.012
    assert math.isnan(found.standard_errors["C_rr"])
    assert any(sentence.startswith("C_rr is at its lower bound 0.012") for sentence in texts(found.findings))
    assert all(0.0 <= b <= 0.03 for b in found.parameters["b"])


@pytest.mark.slow
def test_progress_rises_and_the_cost_falls():
    reported, log = list[Progress](), noisy(balancing_log(), seed=4).between(6.0, 10.0)
    options, steps = replace(BRIEF, search_windows=12, most_steps=2, most_profiles=1), 8
    identify(alten(), log, window=0.1, options=options, run=Run(progress=reported.append))
    assert [(one.stage, one.done) for one in reported[:steps]] == [
        ("search", step + 1) for step in range(steps)
    ]
    assert reported[steps].stage == "gauss_newton"
    assert all(one.done <= one.total for one in reported)
    assert all(later.cost <= earlier.cost for earlier, later in pairwise(reported[:steps]))


def test_a_robot_at_rest_is_refused():
    random, log = np.random.default_rng(0), balancing_log()
    still = {name: 1e-4 * random.standard_normal(len(log)) for name in STATE_NAMES}
    with pytest.raises(InputError, match=r"The robot stands still: .* in only 0 of"):
        identify(alten(), log.with_columns(still))


@pytest.mark.slow
def test_motors_and_sensors_are_found_with_the_friction():
    """Truth: friction of `TRUTH`, motors weaker than they say, a delay and a tilted IMU."""
    log, (a, b) = balancing_log(), (0.004, -0.006)
    gain, offset = np.array([0.9, 1.0, 1.1]), np.array([0.02, -0.03, 0.0])
    torques = np.roll((log.torques - offset) / gain, -2, axis=0)  # logged two rows before they act
    c, s = np.cos(log["psi"]), np.sin(log["psi"])
    changed = {f"u{i + 1}": torques[:, i] for i in range(3)}
    changed |= {"theta": log["theta"] + c * a - s * b, "phi": log["phi"] + s * a + c * b}
    log = noisy(log.with_columns(changed).between(0.0, 14.0), seed=9)
    found = identify(
        alten(), log, free=("friction", "torque", "lean_bias"), bounds=HELD, seed=2, options=BRIEF
    )
    truth = np.concatenate([TRUTH, gain, offset, [0.01], [a, b]])
    deviation = (found.values - truth) / found.errors
    assert np.nanmax(np.abs(deviation)) < 4.0  # 19 of them
    assert np.isfinite(found.errors[11:]).all()


@pytest.mark.slow
def test_command_and_sensor_delays_are_separated():
    """Truth: friction of `TRUTH`, commands two rows late, an IMU 16 ms late, velocities 6 ms."""
    seen = noisy(late(balancing_log(), imu=0.016, velocity=0.006), seed=1)
    torques = np.roll(seen.torques, -2, axis=0)
    log = seen.with_columns({f"u{i + 1}": torques[:, i] for i in range(3)}).between(0.0, 15.0)
    found = identify(exact(), log, free=("friction", "delays"), bounds=HELD, seed=2, options=BRIEF)
    truth = np.array([*TRUTH, 0.01, 0.016, 0.006])
    deviation = (found.values - truth) / found.errors
    assert np.nanmax(np.abs(deviation)) < 4.0  # 13 of them
    # a millisecond or better: a fifth of a row
    assert max(found.standard_errors[name] for name in ("delay", "late_imu", "late_v")) < 1e-3


def test_unidentifiable_quantities_get_no_number():
    log = noisy(balancing_log(), seed=4).between(6.0, 10.0)
    coordinates = estimated_parameters(alten(), free=("friction", "delay"), law="stribeck", bounds=Bounds())
    windows = cut_windows([log], wheel_count=3, duration=0.1)
    constant = replace(windows, torques=np.broadcast_to(windows.torques[:1, :1], windows.torques.shape))
    refused, (finding,) = check_excitation(constant, alten(), coordinates)
    assert np.array(coordinates.labels)[refused].tolist() == ["delay"]
    assert finding.text.startswith(
        "The torques change by only 0 N m per row; add steps to the reference: delay"
    )
    alone = estimated_parameters(alten(), free=("delay",), law="stribeck", bounds=Bounds())
    with pytest.raises(
        InputError, match="These logs do not determine the parameters to be estimated: The torques change"
    ):
        check_excitation(constant, alten(), alone)


@pytest.mark.sample
def test_measured_logs_of_the_stand_in_robot(shared_data):
    # 24 s of each is 190 windows for twelve parameters; half a minute gave the largest ratios to 0.01 the same
    names = ("square_soft.csv", "hold_soft.csv")
    logs = [Log.read(shared_data / "bbr" / name).between(0.0, 24.0) for name in names]
    found = identify(Robot.load("alten"), logs, options=BRIEF)
    # a trial reached 0.14 (phi_dot) to 0.43 (psi); play and rollers leave the heading least predictable
    assert max(found.held_out.with_over_without.values()) < 0.5
    step, stiff = (
        cross_validate(found, Log.read(shared_data / "bbr" / f"{name}.csv"), name=name)
        for name in ("thesis_step_soft", "square_stiff")
    )
    assert max(step.errors.with_over_without.values()) < 0.5
    assert step.findings == ()
    # the wheels chatter within the play: friction makes the lean's prediction worse, and a finding gives the reason
    worse = [state for state, ratio in stiff.errors.with_over_without.items() if ratio >= 1.0]
    assert [finding for finding in texts(stiff.findings) if "within the gearbox's play" in finding]
    (not_predicted,) = [one.text for one in stiff.findings if one.code == "not-predicted"]
    assert all(state in not_predicted for state in worse)
    # v_s and delta have errors only if s is significant, which three quarters of a minute do not always show
    known = found.errors
    assert np.isfinite([*known[:9], known[11]]).all()


PREDICTOR = Predictor(robot=Robot.load("alten"), step=1e-3)
#: b, c, s of three wheels and C_rr are amounts of friction; v_s and delta are its form
AMOUNTS = np.array([*range(9), 11])


def errors(factor: float):
    values = TRUTH.copy()
    values[AMOUNTS] *= factor
    return friction_by_horizon(PREDICTOR, values, noisy(balancing_log(), seed=3))


def test_friction_share_is_one_of_the_identified_log_and_scales_with_the_friction():
    for one in errors(1.0):
        for part in (one.wheel_speed, one.lean):
            # starts are noisy: four standard errors
            assert abs(part.share - 1.0) < 4.0 * part.share_error
            assert part.with_friction < part.viscous_part < part.without_friction
    first = errors(0.5)[0]
    # not quite twice, as wheels that stand still do not feel it in proportion
    for part in (first.wheel_speed, first.lean):
        assert part.share == pytest.approx(2.0, rel=0.25)
        assert abs(part.share - 1.0) > 3.0 * part.share_error
