"""The body's inertia from a swing (Appendix III): truth by SciPy's integrator, in logs and in a film."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import binom

from ballbot.errors import InputError
from ballbot.identification.swing import (
    SwingFit,
    fit_swing,
    inertia_of_swing,
    pendulum_motion,
    swing_in_log,
    swing_of,
)
from ballbot.log import Log
from ballbot.robot import Robot
from ballbot.workflows.robot_check import check_swing
from tests.support.vision_examples import pendulum, sensor_noise

#: of Appendix III: m g r / I
STIFFNESS = 17.076 * 9.81 * 0.393 / 4.37


def swung(
    *, duration: float, h: float, amplitude: float = 0.25, viscous: float = 0.01, dry: float = 0.01
) -> Log:
    """Return the motion of Appendix III's body, let go at `amplitude`."""
    t = np.arange(0.0, duration, h)
    angle, rate = pendulum(t, stiffness=STIFFNESS, viscous=viscous, dry=dry, amplitude=amplitude)
    return Log({"t": t, "theta": angle, "theta_dot": rate})


def fitted(log: Log, noise: NDArray[np.float64] | float = 0.0) -> SwingFit:
    """Return the pendulum fitted to a log's angle with noise of its sensor."""
    return fit_swing(swing_of(log.t, log["theta"] + noise, kind="angle", source="theta"))


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.load("alten")


@settings(max_examples=8, deadline=None)
@given(
    amplitude=st.floats(0.02, 2.5),
    viscous=st.floats(0.0, 0.3),
    dry=st.floats(0.0, 0.3),
    h=st.floats(0.005, 0.05),
)
def test_pendulum_motion_equals_scipys_integration(amplitude, viscous, dry, h):
    t = np.arange(0.0, 6.0, h)
    angle, rate = pendulum(t, stiffness=STIFFNESS, viscous=viscous, dry=dry, amplitude=amplitude)
    p = np.array([STIFFNESS, viscous, dry, amplitude, 0.0])
    angles, rates = pendulum_motion(p, t)
    np.testing.assert_allclose(angles, angle, atol=1e-5)
    # where it turns, the acceleration jumps by 0.6 / s^2 within a step of 0.03 / 3.9 s, of which the spline misses 4 %
    np.testing.assert_allclose(rates, rate, atol=2e-4)


@pytest.mark.parametrize("amplitude", [0.5, 1.5])
def test_large_swings_give_the_small_ones_frequency(amplitude: float, robot: Robot) -> None:
    fit = fitted(swung(duration=25.0, h=0.02, amplitude=amplitude))
    # of Appendix III: 4.37 kg m^2, which is not an input
    assert fit.frequency == pytest.approx(np.sqrt(STIFFNESS), rel=2e-6)
    assert inertia_of_swing(fit, robot).findings == ()


@pytest.mark.parametrize(
    ("viscous", "dry"), [(0.09, 0.0), (0.0, 0.035), (0.03, 0.02)], ids=["viscous", "dry", "both"]
)
def test_viscous_and_dry_pivot_friction_are_separated(viscous: float, dry: float) -> None:
    truth = swung(duration=40.0, h=0.01, viscous=viscous, dry=dry)
    fit = fitted(truth, sensor_noise(len(truth), deviation=0.002, seed=3))
    half = fit.half_widths
    # an interval of 95 % may miss; one and a half of it miss in 0.3 %
    assert abs(fit.values[1] - viscous) < 1.5 * half[1]
    assert abs(fit.values[2] - dry) < 1.5 * half[2]
    assert (fit.values[1] > 3.0 * half[1]) == (viscous > 0.0)
    assert (fit.values[2] > 3.0 * half[2]) == (dry > 0.0)


def test_intervals_hold_the_truth(robot: Robot) -> None:
    """Of 25 swings with noise that goes together over samples, and a mass and a distance that are mismeasured."""
    truth = swung(duration=15.0, h=0.05)
    deviations = {"body.mass": 0.02, "body.center_of_mass": 0.002}
    random, held, runs = np.random.default_rng(5), 0, 25
    for seed in range(runs):
        fit = fitted(truth, sensor_noise(len(truth), deviation=0.003, seed=seed, memory=0.8) + 0.1)
        # errors of scale and tube: N(0, their standard deviations)
        mass, height = (17.076, 0.393) + np.array([0.02, 0.002]) * random.standard_normal(2)
        body = replace(robot.body, mass=float(mass), center_of_mass=float(height))
        file = robot.replace(body=body).annotated(standard_deviations=deviations)
        own = inertia_of_swing(fit, file).about_center_of_mass
        held += abs(own.value - (4.37 - 17.076 * 0.393**2)) <= own.half_width
    # as many as in 99.9 % of draws with a true 95 %
    assert held >= binom.ppf(0.001, runs, 0.95)


def test_pivot_elsewhere(robot: Robot) -> None:
    """Hung 0.3 m from its centre of mass, the same body swings otherwise and has the same inertia."""
    own = 4.37 - 17.076 * 0.393**2
    stiffness = 17.076 * 9.81 * 0.3 / (own + 17.076 * 0.3**2)
    t = np.linspace(0.0, 24.98, 1250)
    angle, _ = pendulum(t, stiffness=stiffness, viscous=0.02, amplitude=0.2)
    fit = fitted(Log({"t": t, "theta": angle}))
    found = inertia_of_swing(fit, robot, distance=0.3, deviation=0.003)
    assert found.about_center_of_mass.value == pytest.approx(own, rel=1e-4)
    assert found.about_ball_center.value == pytest.approx(4.37, rel=1e-4)
    # by differences: the same swing read with the distance one deviation off
    off = inertia_of_swing(fit, robot, distance=0.303)
    change = off.about_ball_center.value - found.about_ball_center.value
    # to second order in 1 % of the distance, m times the square of 3 mm
    assert abs(change) == pytest.approx(found.about_ball_center.deviation, abs=17.1 * 0.003**2)


def test_recording_before_and_after_the_swing_is_left_out() -> None:
    """Held for three seconds at its largest angle, let go, and at rest for the last ten."""
    truth = swung(duration=40.0, h=0.01, dry=0.2, viscous=0.0)
    held = np.concatenate([np.full(300, truth["theta"][0]), truth["theta"]])
    t = np.linspace(0.0, 0.01 * (len(held) - 1), len(held))
    fit = fitted(Log({"t": t, "theta": held}), sensor_noise(len(t), deviation=0.001, seed=1))
    assert fit.frequency == pytest.approx(np.sqrt(STIFFNESS), abs=1.5 * fit.frequency_half_width)
    assert 3.0 < fit.swing.t[0] < 3.0 + 2.0 * np.pi / np.sqrt(STIFFNESS)
    assert fit.swing.t[-1] < t[-1] - 10.0


def test_gyro_about_any_axis_is_read(robot: Robot) -> None:
    truth = swung(duration=25.0, h=0.01)
    log = Log(
        {"t": truth.t}
        | {
            name: share * truth["theta_dot"] + sensor_noise(len(truth), deviation=0.002, seed=seed)
            for seed, (name, share) in enumerate({"gyro_x": 0.6, "gyro_y": -0.8, "gyro_z": 0.0}.items())
        }
    )
    fit = fit_swing(swing_in_log(log))
    assert inertia_of_swing(fit, robot).about_pivot.value == pytest.approx(4.37, rel=2e-4)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.zeros(500), "no motion"),
        (np.degrees(0.3) * np.cos(4.0 * 0.02 * np.arange(500)), "degrees"),
        (0.3 * np.cos(0.02 * np.arange(500)), "need at least"),
        (np.random.default_rng(0).standard_normal(500) * 0.1, "samples in a swing"),
    ],
    ids=["still", "in degrees", "too short", "noise"],
)
def test_records_without_a_swing_are_refused(values: NDArray[np.float64], words: str) -> None:
    with pytest.raises(InputError, match=words):
        fit_swing(swing_of(np.linspace(0.0, 9.98, 500), values, kind="angle", source="theta"))


def test_impossible_pivot_distance_is_refused(robot: Robot) -> None:
    fit = fitted(swung(duration=10.0, h=0.02))
    with pytest.raises(InputError, match=r"the distance must be below 0\.651"):
        inertia_of_swing(fit, robot, distance=0.7)
    with pytest.raises(InputError, match="must be above zero"):
        inertia_of_swing(fit, robot, distance=-0.1)


@pytest.mark.parametrize(
    ("amplitude", "time_unit", "angle_unit", "code"),
    [(0.3, 1e3, 1.0, "swing-inertia"), (np.radians(1.0), 1.0, np.degrees(1.0), "swing-unit")],
    ids=["milliseconds", "1 degree in degrees"],
)
def test_swing_recorded_wrongly_is_stopped_with_its_cause(tmp_path, amplitude, time_unit, angle_unit, code):
    truth = swung(duration=30.0, h=0.02, amplitude=amplitude, dry=0.0)
    file = tmp_path / "swing.csv"
    Log({"t": time_unit * truth.t, "theta": angle_unit * truth["theta"]}).write(file)
    with pytest.raises(InputError, match=f"--accept {code}"):
        check_swing(Robot.load("alten"), file)


def test_sensor_that_froze_is_refused_and_one_that_is_clipped_gets_a_warning(robot: Robot) -> None:
    truth = swung(duration=30.0, h=0.02, amplitude=0.3, dry=0.0)
    angle = truth["theta"]
    frozen = np.where((truth.t > 10.0) & (truth.t < 14.0), angle[500], angle)
    with pytest.raises(InputError, match="is not a free swing"):
        fitted(truth.with_columns({"theta": frozen}))
    found = inertia_of_swing(fitted(truth.with_columns({"theta": np.clip(angle, -0.2, 0.2)})), robot)
    assert [one.code for one in found.findings] == ["swing-fit"]
    # crossings of the middle have the frequency all the same
    assert found.about_ball_center.value == pytest.approx(4.37, rel=0.005)


def test_file_is_contradicted_by_a_swing_outside_its_deviations(robot: Robot) -> None:
    t = np.linspace(0.0, 25.0, 1251)
    angle, _ = pendulum(t, stiffness=STIFFNESS * 4.37 / 4.1, viscous=0.02, amplitude=0.2)
    fit = fitted(Log({"t": t, "theta": angle}))
    (finding,) = inertia_of_swing(fit, robot).findings
    assert (finding.code, finding.severity) == ("swing-inertia", "warning")
    told = robot.annotated(standard_deviations={"body.inertia.xx": 0.2})
    assert inertia_of_swing(fit, told).findings == ()  # 0.27 less, of 0.39


def test_swing_of_another_body_gets_a_warning(robot: Robot) -> None:
    """A body with twice the file's inertia: the file, the mass or the clock is wrong."""
    t = np.linspace(0.0, 25.0, 1251)
    angle, _ = pendulum(t, stiffness=0.5 * STIFFNESS, viscous=0.02, amplitude=0.2)
    fit = fitted(Log({"t": t, "theta": angle}))
    findings = inertia_of_swing(fit, robot).findings
    assert {one.severity for one in findings} == {"warning"}
    assert any("2 times the file's 4.37" in one.text for one in findings)
