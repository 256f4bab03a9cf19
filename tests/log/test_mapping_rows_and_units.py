"""Foreign logs whose stamps jitter, whose columns have several units, or whose names are those of other quantities."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.log.mapping_inference.command_units import GAIN_BIAS
from ballbot.log.mapping_inference.conclusions import conclusions_of
from ballbot.log.mapping_inference.drive import RATIO_ERROR
from ballbot.log.mapping_inference.evidence import CONFIDENT
from ballbot.log.mapping_inference.file_signals import pitch_in_rolls_unit
from ballbot.log.mapping_inference.open_names import with_rates_of
from ballbot.log.mapping_inference.proposal import propose
from ballbot.log.mapping_inference.refusal import LARGEST_MISSED, refusal_of
from ballbot.log.mapping_inference.report import Evaluation, evaluate
from ballbot.log.mapping_inference.roles import roles_by_name
from ballbot.log.mapping_inference.stall import (
    STRONGER,
    STRONGEST,
    WEAKER,
    back_emf_damping,
    resistance_confidence,
    with_other_motors,
)
from ballbot.log.mapping_inference.units import (
    Scale,
    UnitEvidence,
    heading_units,
    likeliest_units,
    wheel_units,
)
from ballbot.robot import Robot
from tests.support.foreign_log_examples import Habits, columns_of, small_robot, swaying_log, write_foreign

Columns = dict[str, np.ndarray]


@pytest.fixture
def evaluated(tmp_path: Path) -> Callable[..., Evaluation]:
    """Return a function that writes columns as a stranger's file and evaluates its proposal for a robot."""

    def made(columns: Columns, robot: Robot | None = None) -> Evaluation:
        path = write_foreign(tmp_path / "run.csv", columns, Habits(separator=","))
        robot = robot or small_robot()
        return evaluate(propose(path, robot, dead_band=0.0), robot, file=path)

    return made


@pytest.fixture(scope="module")
def plain() -> Columns:
    """Return columns of 15 s with duties, and roll, pitch and yaw in degrees."""
    columns = columns_of(swaying_log(), Habits(counts=True))
    return {name: values[:1300] for name, values in columns.items() if name != "i"}


def renamed(columns: Columns, names: dict[str, str], **values: np.ndarray) -> Columns:
    """Return columns under other names, some with other values, by their old names."""
    return {names.get(name, name): values.get(name, old) for name, old in columns.items()}


def test_stamps_that_jitter_keep_the_log(evaluated, plain: Columns):
    t = plain["t_now"]
    late = t + 0.4 * 0.0115 * np.random.default_rng(2).standard_normal(len(t))
    found: Evaluation = evaluated(plain | {"t_now": late})
    assert found.proposal.rows is None
    assert 'unordered_rows = "drop"' in found.text
    assert any("rows are out of order" in one.text for one in found.findings)
    assert found.log is not None, found.refusal
    assert np.ptp(found.log.t) > 0.9 * np.ptp(t)


YAW_DEGREES = {"theta_x": "roll", "theta_y": "pitch", "theta_z": "yaw_deg"}


@pytest.mark.parametrize("yaw", ["yaw_deg", "yaw"])
def test_a_yaw_in_degrees_beside_a_lean_in_radians_is_read_as_such(evaluated, plain: Columns, yaw: str):
    radians = {name: np.radians(plain[name]) for name in ("theta_x", "theta_y")}
    found: Evaluation = evaluated(renamed(plain, YAW_DEGREES | {"theta_z": yaw}, **radians))
    assert found.log is not None, found.refusal
    assert 'unit = ["rad", "rad", "deg"]' in found.text
    (unit,) = (one for one in found.conclusions if one.name == "unit of the heading")
    assert unit.value == "deg"
    true = np.interp(found.log.t, swaying_log().t, swaying_log()["psi"])
    own = found.log["psi"] - found.log["psi"].mean()
    np.testing.assert_allclose(own, true - true.mean(), atol=0.03)  # the IMU's delay of 17.5 ms


RADIANS = Scale(unit="rad", factor=1.0, reason="")


def test_a_heading_of_unknown_unit_is_that_of_the_wheels():
    still = 0.3 * np.sin(np.linspace(0.0, 10.0, 500))
    wheels = {Scale(unit="rad", factor=1.0, reason=""): 0.0}
    motion = UnitEvidence(
        assumed=(RADIANS, RADIANS, RADIANS), gain=1.0, gain_error=0.05, turning=np.pi / 180.0
    )

    def headings(lean: Scale) -> dict[Scale, float]:
        return heading_units(still, None, lean, None)

    # the wheels turn 57 times too little for a heading in radians
    _, _, heading = likeliest_units({RADIANS: 0.0}, wheels, headings, motion)
    assert (heading.unit, heading.confidence > CONFIDENT) == ("deg", True)
    alike = replace(motion, turning=None)
    assert likeliest_units({RADIANS: 0.0}, wheels, headings, alike)[2].unit == "rad"


def test_a_pitch_of_another_unit_than_the_roll_by_name_is_converted():
    roles = roles_by_name(["t", "roll_deg", "pitch_rad", "enc1", "enc2", "enc3"], wheel_count=3)
    assert pitch_in_rolls_unit(roles) == pytest.approx(180.0 / np.pi)
    alike = roles_by_name(["t", "roll_deg", "pitch", "enc1", "enc2", "enc3"], wheel_count=3)
    assert pitch_in_rolls_unit(alike) == 1.0


@pytest.mark.parametrize("of", ["wheels", "body", "ball"])
def test_a_matrix_omega_is_of_the_wheels_the_body_or_neither(evaluated, plain: Columns, of: str):
    truth, t = swaying_log(), plain["t_now"]
    names = {
        "wheels": ("wheel1_dot", "wheel2_dot", "wheel3_dot"),
        "body": ("theta_dot", "phi_dot", "psi_dot"),
        "ball": ("y_dot", "x_dot", "psi_dot"),
    }
    late = t - (0.0175 if of == "body" else 0.0)
    omega = {f"omega_{k}": np.interp(late, truth.t, truth[name]) for k, name in enumerate(names[of], 1)}
    roles = evaluated(plain | omega).proposal.roles
    assert roles.speeds == (tuple(omega) if of == "wheels" else ())
    assert roles.gyro == (tuple(omega) if of == "body" else ())


def test_rates_that_were_not_tested_are_not_said_to_be_of_neither(plain: Columns):
    columns = plain | {f"omega_{k}": np.zeros(len(plain["t_now"])) for k in (1, 2, 3)}
    roles, note = with_rates_of(roles_by_name(columns, wheel_count=3), columns)
    assert roles.speeds == ()
    assert note == "omega_1, omega_2, omega_3 are not used: the log does not show whose rates they are."


def test_a_response_by_a_placement_in_doubt_is_no_reason_to_doubt_the_wheels_unit(
    tmp_path: Path, plain: Columns
):
    path = write_foreign(tmp_path / "run.csv", plain, Habits(separator=","))
    proposal = propose(path, small_robot(), dead_band=0.0)
    tested = proposal.lean_test
    assert tested is not None
    best = replace(tested.placements[0], gain=10.0)

    def asked(confidence: float) -> list[str]:
        other = replace(tested, placements=(best, *tested.placements[1:]), confidence=confidence)
        found = conclusions_of(replace(proposal, lean_test=other))
        return [one.name for one in found if not one.determined]

    assert "unit of the wheel angles" in asked(0.99)
    assert "unit of the wheel angles" not in asked(0.4)


def test_a_resistance_unlike_that_of_the_torque_limit_is_asked_for(evaluated, plain: Columns):
    duties = {name: 1.5 * plain[name] for name in ("u1", "u2", "u3")}
    found: Evaluation = evaluated(plain | duties)
    (asked,) = found.undetermined
    assert asked.name == "resistance of the motors"
    assert "ohm, by the motion" in asked.answers
    drive = next(one for one in found.findings if one.code == "drive")
    assert "The motion gives" in drive.text
    own: Evaluation = evaluated(plain)
    assert not own.refusal
    assert "the motion and the robot file's masses give" in own.text


def test_a_lean_that_seems_late_is_noted_and_rows_that_miss_torques_are_refused(evaluated, plain: Columns):
    found: Evaluation = evaluated(plain)
    assert found.proposal.sensor_delay == 0.0
    assert [one for one in found.findings if "The lean seems to lag behind the wheels" in one.text]
    missing = replace(found.proposal, missed=1.25 * LARGEST_MISSED)
    assert "miss about 15 % of the torques: log every sample" in refusal_of(missing, (), "mapping.toml")
    assert not refusal_of(found.proposal, (), "mapping.toml")


def test_the_bias_of_a_gain_is_that_of_torques_and_currents(evaluated, plain: Columns):
    drive = evaluated(plain).proposal.drive
    ratios = {}
    for unit in drive.standstill:
        other = replace(drive, units={unit: 1.0}, known_inertia=True)
        ratio, _ = other.torque_ratio
        ratios.setdefault(unit.kind, set()).add(
            round(ratio / other.response.gain / other.standstill[unit], 9)
        )
    unbiased, biased = {1.0}, {round(np.exp(-GAIN_BIAS), 9)}
    assert ratios == {"torque": biased, "current": biased, "duty": unbiased, "voltage": unbiased}


@pytest.mark.parametrize("times", [0.79, 1.27])
def test_a_resistance_is_doubted_from_a_fifth_on(times):
    """A course's motor has 2.18 ohm by its data sheet, and 2.76 give its robot file's torque limit."""
    error = math.hypot(RATIO_ERROR, 0.03)  # of the gain, the median of the development halves
    assert resistance_confidence(times, error) < CONFIDENT
    assert resistance_confidence(times**0.4, error) >= CONFIDENT
    # a log that shows nothing leaves what is assumed, which is not stated with confidence
    assert 0.8 < resistance_confidence(times, 2.0) < CONFIDENT


@pytest.mark.parametrize("times", [0.4, 2.5])
def test_motors_of_another_strength_are_expected_with_the_back_emf_of_theirs(times: float):
    """On a course's log, full duty gives 0.38 of its robot file's torque limit, and the damping is of such a motor."""
    robot = Robot.load("rob311")
    off, deviation, contradicted = -math.log(times), 0.15, -30.0
    damping = back_emf_damping(robot) * times + 0.005 * robot.drive.torque_limit
    own, without, farther = (
        with_other_motors(contradicted, one, deviation, (damping * emf, 0.01), robot)
        for one, emf in ((off, 1.0), (off, 0.0), (2.5 * off, 1.0))
    )
    prior = STRONGER if times > 1.0 else WEAKER
    # the damping's outlier, 0.01, is all that is added
    assert own == pytest.approx(
        math.log(prior * math.sqrt(2.0 * math.pi) / math.log(STRONGEST) * 1.01), abs=1e-3
    )
    # a motor that drives brakes, and 2.5 squared and more is beyond what must be expected
    assert own > without + 0.5
    assert farther < own - 3.0


def test_counts_of_a_robot_unlike_its_file_are_asked_for(evaluated, plain: Columns):
    without_yaw = {name: values for name, values in plain.items() if name != "theta_z"}
    found: Evaluation = evaluated(without_yaw, Robot.load("rezero"))
    unit = next(one for one in found.undetermined if one.name == "unit of the wheel angles")
    assert "a robot unlike its file" in unit.answers
    # and whatever the unit, if the lean responds to the wheels as no such robot's does
    own = evaluated(plain).proposal
    best, *others = own.lean_test.placements
    for gain, doubted in ((1.3, False), (3.0, True), (0.3, True)):
        tested = replace(own.lean_test, placements=(replace(best, gain=gain), *others))
        unit = next(
            one for one in conclusions_of(replace(own, lean_test=tested)) if "wheel angles" in one.name
        )
        assert ("unlike its file" in unit.answers) == doubted
        assert unit.determined != doubted


def test_counts_without_the_gear_are_asked_for():
    robot = Robot.load("alten")
    counts = np.round(2000.0 * np.random.default_rng(1).standard_normal((300, 3)))
    weights = wheel_units(counts, robot, None)
    # the lean's response is that of counts of the encoder's own shaft
    own = next(one for one in weights if one.unit == "counts" and "of the wheel" in one.reason)
    motion = UnitEvidence(assumed=(RADIANS, own, RADIANS), gain=1.0, gain_error=0.05, turning=None)
    _, wheel, _ = likeliest_units({RADIANS: 0.0}, weights, lambda lean: {lean: 0.0}, motion)
    assert wheel.confidence < CONFIDENT
    assert "a robot unlike its file" in wheel.alternatives[0]


def test_a_log_that_is_too_short_says_so_and_how_long_it_must_be(evaluated, plain: Columns):
    found: Evaluation = evaluated({name: values[:390] for name, values in plain.items()})
    assert "too short for this: record at least 15 s" in found.refusal


def test_a_wheel_that_stands_still_in_a_short_log_may_have_had_nothing_to_do(evaluated, plain: Columns):
    short = {name: values[:400] for name, values in plain.items()}
    with pytest.raises(
        InputError, match=r"in a log of 5 s, a wheel that had nothing to do\. Record at least 15 s"
    ):
        evaluated(short | {"psi_2": 0.0 * short["psi_2"]})


def test_a_unit_that_no_angle_has_leaves_the_pitch_in_the_rolls():
    names = ("t", "c1_V", "c2_V")
    roles = replace(roles_by_name(names, wheel_count=3), attitude=names[1:])
    assert roles.reading(names[1:2]) is not None
    assert pitch_in_rolls_unit(roles) == 1.0


def test_a_gyro_in_turns_a_second_is_read_without_its_name(evaluated, plain: Columns):
    log, t = swaying_log(), plain["t_now"] - 0.0175
    rates = (log["theta_dot"] + 1j * log["phi_dot"]) * np.exp(-1j * log["psi"])
    gyro = (rates.real, rates.imag, log["psi_dot"])
    columns = {f"omega_rps_{k + 1}": np.interp(t, log.t, rate) for k, rate in enumerate(gyro)}
    found: Evaluation = evaluated(plain | columns)
    assert found.proposal.gyro is not None
    assert found.proposal.gyro.unit == "rad/s"


def test_a_yaw_in_its_own_fine_unit_is_read_as_such():
    lean = Scale(unit="deg", factor=np.pi / 180.0, reason="")
    yaw = 1000.0 * np.sin(np.linspace(0.0, 9.0, 500))
    units = heading_units(yaw, "mrad", lean, "deg")
    assert max(units, key=lambda one: units[one]).unit == "mrad"
