"""What the robot file does not know, on logs of a robot whose numbers and friction are known."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot.findings import texts
from ballbot.fitting.fit import fit
from ballbot.fitting.uncertainty import WindowEquations
from ballbot.identification import Bounds, identify
from ballbot.identification.file_values import (
    FileValue,
    _pair,
    file_value_findings,
    from_file,
    own_estimate,
    with_file_errors,
)
from ballbot.identification.identify import IdentificationOptions, Prepared, prepare
from ballbot.identification.quantities import scale_between
from ballbot.robot import Robot
from ballbot.robot.variations import uncertain
from tests.support.validation_examples import noisy_log, true_robot

#: v_s and delta are held: the search follows their long valley in half of its steps
HELD = Bounds({"stribeck_speed": (0.6, 0.6), "stribeck_exponent": (1.1, 1.1)})
BRIEF = IdentificationOptions(search_windows=32, most_profiles=0)
FREE = ("viscous", "coulomb", "stribeck", "rolling")


def _prepared(robot: Robot) -> Prepared:
    coordinates = scale_between(robot, free=FREE)
    return prepare(robot, coordinates, [noisy_log().between(0.0, 16.0)], window=0.25, options=BRIEF)


def test_masses_inertias_torques_and_friction_wrong_by_one_factor_change_nothing():
    experiment = _prepared(true_robot()).experiment
    coordinates, robot = experiment.coordinates, with_file_errors(true_robot(), ())
    point = coordinates.scaled(coordinates.nominal)
    numbers = [
        number for number in uncertain(robot) if not number.name.endswith(("radius", "_mass", "_time"))
    ]
    pairs = [_pair(experiment, robot, number) for number in numbers]
    about = experiment.linearize_widely(point, experiment.windows.initial, others=pairs)
    # all by one per cent, in scaled parameters and in deviations; heights and rolling friction are no torques
    by_factor = np.where(np.isin(coordinates.names, FREE[:3]), coordinates.nominal, 0.0)
    step = 0.01 * by_factor / np.where(coordinates.free, coordinates.slopes(point), np.inf)
    values = {"drive.torque_constant": robot.drive.torque_constant} | dict(
        zip(*_inertias(robot), strict=True)
    )
    others = np.array([0.01 * values.get(number.label, 0.0) / number.deviation for number in numbers])
    both, H = np.concatenate([step, others]), about.equations.matrix
    alone = np.where(np.arange(len(both)) < len(step), 0.0, both)
    # differences over 0.1 deviations, and over events of sticking
    assert both @ H @ both < 1e-3 * (alone @ H @ alone)


def _inertias(robot: Robot) -> tuple[list[str], list[float]]:
    ball, body, drive = robot.ball, robot.body, robot.drive
    names = [
        "ball.mass",
        "ball.inertia",
        "body.mass",
        *(f"body.inertia.{axes}" for axes in ("xx", "yy", "zz")),
    ]
    values = [ball.mass, ball.inertia, body.mass, *body.inertia[:3]]
    names += ["wheels.inertia", "drive.motor_inertia", "drive.gear_inertia"]
    return names, [*values, robot.wheels.inertia, drive.motor_inertia, drive.gear_inertia]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["drive.torque_constant", "body.inertia.zz", "body.center_of_mass"])
def test_the_linear_response_to_a_wrong_value_is_that_of_another_fit(name: str):
    others = {number.name: 0.0 for number in uncertain(with_file_errors(true_robot(), ()))}
    known = true_robot().annotated(
        standard_deviations={key: size for key, size in others.items() if key != name}
    )
    prepared = _prepared(known)
    coordinates = prepared.experiment.coordinates
    at = coordinates.scaled(coordinates.nominal)
    estimate = fit(prepared.experiment, at, options=BRIEF)
    by_file = from_file(prepared.experiment, estimate, None)
    (value,) = by_file.values
    number = next(one for one in uncertain(with_file_errors(known, ())) if one.name == name)
    ahead, _, distance = _pair(
        prepared.experiment, with_file_errors(known, ()), replace(number, deviation=10.0 * number.deviation)
    )
    assert distance == pytest.approx(0.2)
    again = fit(ahead, at, options=BRIEF)
    errors = np.sqrt(estimate.scaled_covariance.diagonal())
    moved = (again.finished.point - estimate.finished.point) / errors
    expected = np.sqrt(by_file.added.diagonal()) / errors
    # of friction that is known; by another value windows stick elsewhere
    kept = np.isfinite(moved)
    np.testing.assert_allclose(np.abs(moved[kept]), expected[kept], rtol=0.15, atol=0.7)
    assert abs(value.apart) < 3.0


@pytest.mark.slow
def test_a_right_file_is_not_refused_and_is_part_of_each_variance():
    found = identify("alten", noisy_log().between(0.0, 16.0), bounds=HELD, options=BRIEF)
    assert found.contradicted == ()
    assert max(abs(value.apart) for value in found.file_values) < 3.0
    known = np.isfinite(found.errors)
    assert np.all((found.file_share[known] >= 0.0) & (found.file_share[known] < 1.0))
    assert found.file_share[known].max() > 0.05
    assert "all wrong by one factor" in " ".join(texts(found.findings))
    refused = replace(found, contradicted=("body.mass is wrong",))
    assert refused.verdict.reasons == ("body.mass is wrong",)


def test_a_value_beyond_four_deviations_of_the_difference_is_an_error_that_names_it():
    value = FileValue(label="body.mass", value=20.0, deviation=0.4, own=17.0, own_error=0.5, degrees=1e6)
    assert value.apart == pytest.approx(-3.0 / np.hypot(0.4, 0.5), rel=1e-4)
    (finding,) = file_value_findings([replace(value, own=19.0), value])
    assert (finding.code, finding.severity) == ("file-value", "error")
    assert finding.text.startswith("body.mass is 20.0 +- 0.40 in the robot file and 17.0 +- 0.50 by the logs")
    # an error by what few other values show is itself uncertain, unless the file's is the larger by far
    few = replace(value, degrees=3.0)
    assert abs(few.apart) < 3.5
    assert replace(few, own_error=0.01, deviation=0.6).apart == pytest.approx(-5.0, rel=1e-3)


def test_what_the_model_lacks_widens_the_logs_own_estimate_and_a_wrong_value_does_not():
    """Windows that tell three values, one of them wrong by twelve deviations, or all of them a little."""
    random, kept = np.random.default_rng(0), np.ones(2, dtype=bool)

    def apart(pulls: list[float]) -> float:
        J = random.standard_normal((60, 40, 5)) * [1.0, 1.0, 0.3, 0.3, 0.3]
        r = random.standard_normal((60, 40)) - J @ np.array([0.0, 0.0, *pulls])
        joint = WindowEquations(np.einsum("wri,wrj->wij", J, J), np.einsum("wri,wr->wi", J, r))
        step, error, degrees = own_estimate(joint, kept, 0, clustered=1.0)
        assert step == pytest.approx(pulls[0], rel=0.1)
        return FileValue(label="", value=0.0, deviation=1.0, own=step, own_error=error, degrees=degrees).apart

    assert abs(apart([12.0, 0.0, 0.0])) > 4.0
    assert abs(apart([12.0, -9.0, 14.0])) < 3.0


def test_deviations_in_a_robot_file_replace_those_of_their_kind(tmp_path):
    own = {"sensors.sample_time": 1e-5, "drive.torque_constant": 0.0, "body.mass": 0.01}
    Robot.load("alten").annotated(standard_deviations=own).write(tmp_path / "robot.toml")
    robot = Robot.load(tmp_path / "robot.toml")
    sizes = {
        number.label: number.deviation for number in uncertain(with_file_errors(robot, {"second_moment"}))
    }
    assert (sizes["sensors.sample_time"], sizes["body.mass"]) == (1e-5, 0.01)
    assert sizes["ball.mass"] == pytest.approx(0.02 * robot.ball.mass)
    # exact, and estimated
    assert not {"drive.torque_constant", "body.inertia.xx"} & sizes.keys()
