"""What an unknown delay or dead band changes in a log, and what the commands are."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.log.checks.torque_balance import Driving
from ballbot.log.checks.torques import DELAY_EXPLAINED, response_delay
from ballbot.log.mapping_inference.command_units import unit_probabilities
from ballbot.log.mapping_inference.commands import Assignment, Response, assign
from ballbot.log.mapping_inference.dead_band import (
    ADDS_ONE,
    LARGEST_DEAD_BAND,
    LARGEST_DUTY,
    DeadBandEstimate,
    dead_band_estimate,
    undone_dead_band,
)
from ballbot.log.mapping_inference.drive import _compared, _senses_and_signs, _turning_against
from ballbot.log.mapping_inference.evidence import CONFIDENT
from ballbot.log.mapping_inference.file_signals import GyroTest, Signals
from ballbot.log.mapping_inference.placement import LeanTest
from ballbot.log.mapping_inference.refusal import LARGEST_MISSED
from ballbot.log.mapping_inference.stall import back_emf_damping
from ballbot.log.mapping_inference.tolerances import (
    COMMAND_ERROR,
    LONGEST_COMMAND_DELAY,
    MISSED,
    NO_DELAY,
    TORQUE_PART,
    command_delay,
    delay_evidence,
    delay_words,
    harmless,
    lean_delay,
    missed_between_rows,
    quickness,
)
from ballbot.log.mapping_inference.wheel_response import CommandTest
from ballbot.log.signals import INTERVAL, Smooth
from ballbot.robot import Robot


@given(error=st.floats(1e-6, 10.0), more=st.floats(1.01, 100.0), tolerance=st.floats(1e-3, 1.0))
def test_a_larger_error_is_never_more_harmless(error, more, tolerance):
    assert 0.0 <= harmless(more * error, tolerance) <= harmless(error, tolerance) < 1.0


def test_harmless_is_the_normal_probability():
    random = np.random.default_rng(0)
    drawn = 0.3 * random.standard_normal(200_000)
    # 200,000 draws have a standard error of 0.001
    assert harmless(0.3, 0.5) == pytest.approx(np.mean(np.abs(drawn) < 0.5), abs=0.004)


def test_quickness_of_a_sine_wave_is_its_frequency():
    t = INTERVAL * np.arange(4000)
    wave = Smooth(
        value=np.sin(7.0 * t)[:, None] + 2.0,
        rate=7.0 * np.cos(7.0 * t)[:, None],
        acceleration=np.zeros((len(t), 1)),
    )
    assert quickness(wave, np.ones(len(t), dtype=bool)) == pytest.approx(7.0, rel=0.01)


def commanded(frequency: float) -> Signals:
    rows = (INTERVAL * np.arange(4000)).astype(np.float64)
    still = Smooth(value=np.zeros((4000, 3)), rate=np.zeros((4000, 3)), acceleration=np.zeros((4000, 3)))
    phases = np.array([0.0, 2.0, 4.0])
    return Signals(
        rows=rows,
        wheels=still,
        lean=None,
        heading=None,
        commands=np.sin(frequency * rows[:, None] + phases),
        usable=np.ones(4000, dtype=bool),
    )


def responding(delay: float, error: float, *, explained: float = 0.9) -> CommandTest:
    return CommandTest(
        order=(1, 2, 3),
        signs=(1, 1, 1),
        gains=((1.0,) * 3,) * 3,
        delay=delay,
        delay_error=error,
        explained=explained,
        margin=None,
    )


def test_an_unknown_delay_is_harmless_only_in_a_slow_log():
    every = np.ones(4000, dtype=bool)
    slow, quick = (command_delay(None, commanded(w), every, interval=0.005) for w in (2.0, 20.0))
    assert slow.applied == quick.applied == 0.0
    assert slow.harmless > 0.95
    assert quick.harmless < 0.9
    # what is assumed is not stated with confidence
    assert slow.confidence < 0.6


def test_a_delay_at_the_edge_of_its_search_is_not_undone():
    every = np.ones(4000, dtype=bool)
    assert command_delay(responding(-0.005, math.inf), commanded(20.0), every, interval=0.005).applied == 0.0
    # no driver takes 50 ms: something else explains the wheels later
    late = command_delay(responding(0.05, 1e-4), commanded(20.0), every, interval=0.005)
    assert late.applied == 0.0
    assert late.harmless < 0.9
    assert command_delay(
        responding(0.0105, 1e-4), commanded(20.0), every, interval=0.005
    ).applied == pytest.approx(0.0105)


def test_a_delay_is_not_undone_if_the_commands_explain_little():
    every, little = np.ones(4000, dtype=bool), responding(0.0105, 1e-4, explained=0.7)
    late = command_delay(little, commanded(2.0), every, interval=0.005)
    assert late.applied == 0.0
    assert "too few (75 %)" in late.evidence


@pytest.mark.parametrize("slow", [True, False])
def test_a_delay_is_undone_as_far_as_it_is_none_of_zero(slow):
    every, error = np.ones(4000, dtype=bool), math.hypot(0.002, COMMAND_ERROR / 0.9)
    signals = commanded(2.0 if slow else 20.0)
    none, unclear, clear = (
        command_delay(responding(times * error, 0.002), signals, every, interval=0.005)
        for times in (0.9, 1.3, 1.7)
    )
    assert none.applied == 0.0
    assert "no clear difference from zero" in none.evidence
    # delays as often as before a log is seen, and of them those whose estimate is this one
    random = np.random.default_rng(1)
    delays = np.where(random.random(10**6) < NO_DELAY, 0.0, random.uniform(0.0, LONGEST_COMMAND_DELAY, 10**6))
    seen = delays[np.abs(delays + error * random.standard_normal(10**6) - 1.3 * error) < 2e-4]
    # 0.1 ms: what 10^4 of them know, and a hundredth of the longest delay between the steps of the sum
    assert unclear.applied == pytest.approx(seen.mean(), abs=1.5e-4)
    assert unclear.error == pytest.approx(seen.std(), abs=1.5e-4)
    assert "the expected value" in unclear.evidence
    assert clear.applied == pytest.approx(1.7 * error, abs=1e-4)
    assert clear.error == pytest.approx(error, rel=0.1)
    assert unclear.measured
    # the larger error of one that is not undone counts
    assert none.error > 1.3 * error
    assert none.harmless > 0.99 if slow else none.harmless < 0.9


@pytest.mark.parametrize(
    ("frequency", "said"), [(2.0, "harmless in this log"), (40.0, "which matters in this log")]
)
def test_a_delay_that_is_not_measured_says_whether_that_matters(frequency, said):
    late = command_delay(None, commanded(frequency), np.ones(4000, dtype=bool), interval=0.005)
    assert not late.measured
    assert delay_words(late) == "0.0 ms, assumed"
    assert delay_evidence(late, late.harmless).endswith(said)
    assert "does not measure it: up to 15 ms" in late.evidence


def leaning(lag: float, error: float) -> LeanTest:
    """A lean that the wheels explain best so much earlier; what else the test found has no influence here."""
    return LeanTest(
        placements=(),
        confidence=1.0,
        phase_error=None,
        gain_error=0.0,
        lag=lag,
        lag_error=error,
        time_ratio=math.nan,
        time_error=math.nan,
        same_handedness=0.0,
        forwards=0.0,
        body_frame=0.0,
        headings=0.0,
        disturbance=0.0,
        balancing=np.ones(4000, dtype=bool),
        pushed=np.zeros(4000, dtype=bool),
    )


def gyro_before(lag: float) -> GyroTest:
    """A gyro that roll and pitch are so much later than; what else its test found has no influence here."""
    return GyroTest(
        order=(0, 1, 2),
        signs=(1, 1, 1),
        gain=1.0,
        unit="rad/s",
        factor=1.0,
        correlations=(1.0, 1.0, 1.0),
        lag=lag,
        lag_error=0.003,
        confidence=1.0,
        reason="",
    )


@pytest.mark.parametrize("lag", [0.0, 0.03])
@pytest.mark.parametrize(
    ("gyro", "early", "applied"),
    [
        (None, 0.0, 0.0),
        (gyro_before(0.0), 0.0, 0.0),
        (gyro_before(0.012), 0.0, 0.012),
        (None, 0.004, 0.0),  # less than a row
        (gyro_before(0.012), 0.02, 0.02),
    ],
)
def test_a_lean_is_late_only_if_a_gyro_or_the_commands_show_it(lag, gyro, early, applied):
    """Twins with play seem 20 ms late, to a fraction of a millisecond, whose sensors are in time."""
    signals = commanded(2.0)
    waves = signals.commands
    assert waves is not None
    lean = Smooth(value=waves[:, :2], rate=waves[:, 1:], acceleration=waves[:, 1:])
    late = lean_delay(leaning(lag, 2e-4), replace(signals, lean=lean), gyro, interval=0.005, early=early)
    assert late.applied == pytest.approx(applied)
    assert late.measured == (applied > 0.0)
    assert late.harmless > CONFIDENT
    # a delay that is assumed is not stated with confidence, harmless as it may be
    assert late.measured or late.confidence < 0.5


@pytest.mark.parametrize(
    ("tested", "early", "applied"),
    [
        (None, 0.02, 0.01),  # either the lean is late, or the commands are early
        (responding(0.021, 1e-3), 0.015, 0.021),  # the wheels show it
        (None, 0.004, 0.0),  # less than a row
    ],
)
def test_commands_that_respond_to_what_is_not_there_yet_take_half_of_it(tested, early, applied):
    every = np.ones(4000, dtype=bool)
    late = command_delay(tested, commanded(2.0), every, interval=0.005, early=early)
    assert late.applied == pytest.approx(applied)
    assert ("respond to the lean's noise" in late.evidence) == (applied == 0.01)
    assert late.measured == (tested is not None)


@pytest.mark.parametrize(("interval", "missed"), [(0.005, False), (0.0115, True)])
def test_rows_slower_than_the_controller_miss_what_chatters(interval, missed):
    """Commands of which half the power is noise of every row, and of which the back-EMF leaves a quarter."""
    random, signals = np.random.default_rng(5), commanded(2.0)
    waves, every = signals.commands, np.ones(4000, dtype=bool)
    assert waves is not None
    chattering = replace(signals, commands=waves + math.sqrt(0.5) * random.standard_normal(waves.shape))
    found = missed_between_rows(chattering, every, 4.0, interval=interval, sample_time=0.005)
    # half of the power of the noise of a sine wave, and what the filter leaves of either
    assert found == pytest.approx(MISSED * 4.0 * math.sqrt(0.5 * interval) if missed else 0.0, rel=0.1)
    calm = missed_between_rows(signals, every, 4.0, interval=interval, sample_time=0.005)
    assert calm < 0.2 * LARGEST_MISSED


@pytest.mark.parametrize("rows", [-3, 0, 4, 12])
def test_the_lag_of_a_response_is_found_from_the_noise_of_what_it_is_given(rows):
    random = np.random.default_rng(rows + 3)
    t = 0.005 * np.arange(4000)
    sensed = np.column_stack([np.sin(2.0 * t), np.cos(3.0 * t)]) + 1e-3 * random.standard_normal((4000, 2))
    own = 5e-3 * random.standard_normal((4000, 3))  # a gyro's, which no column has
    torques = np.roll(sensed, rows, axis=0) @ random.normal(0.0, 10.0, (2, 3)) + own
    found = response_delay(sensed, torques, 0.005)
    assert found is not None
    assert found.lag == pytest.approx(0.005 * rows)
    assert found.explained > DELAY_EXPLAINED


@pytest.mark.parametrize("late", [0.2, 1.0])
def test_turning_against_is_that_of_the_wheel_that_each_command_drives(late):
    """Of square waves that differ by an angle, the signs differ by 2 for that angle over pi of the time."""
    angle = np.linspace(0.0, 200.0 * np.pi, 200_001)[:, None]
    phases = np.array([0.0, 0.7, 1.9])
    speeds = 100.0 * np.sin(angle + phases)
    wheels, signs = (2, 0, 1), (1, -1, 1)  # of the file's commands in turn
    ahead = phases + np.array([0.0, late, 0.0])
    commands = np.sin(angle + ahead[list(wheels)]) * np.array(signs)
    zero = np.zeros((len(angle), 3))
    driving = Driving(
        torque=commands,
        needed=zero,
        friction=np.zeros((len(angle), 3, 3)),
        turning=zero,
        block=np.zeros(len(angle), dtype=np.intp),
    )
    compared = _compared(driving, zero, _senses_and_signs(commands, speeds))
    assigned = Assignment(
        wheels=wheels, signs=signs, explained=1.0, advantage=1.0, next_best="", confidence=1.0
    )
    # within the time in which a wheel is slower than 0.1 rad/s
    share = 2.0 * math.sqrt(late / np.pi)
    assert _turning_against(compared, assigned, np.ones(3)) == pytest.approx(share, abs=0.01)
    # the second wheel drives a third as much as the others: the same dead band is more of its torque
    found = _turning_against(compared, assigned, np.array([3.0, 1.0, 3.0]))
    assert found == pytest.approx(share * math.sqrt(19.0 / 3.0), abs=0.03)


def test_a_dead_band_is_less_dry_friction_unless_wheels_turn_against_their_duties():
    # the upper half of the possible dead bands changes torques by more than they may miss: a quarter of the prior
    found = undone_dead_band(TORQUE_PART / (0.5 * LARGEST_DEAD_BAND))
    assert found.confidence == pytest.approx(1.0 - 0.25 * ADDS_ONE, abs=0.005)
    assert found.value == 0.0
    # the largest that is possible is harmless
    assert undone_dead_band(0.99 * TORQUE_PART / LARGEST_DEAD_BAND).confidence > 0.99
    # in a log that drives with 1 % of full duty, a motor may lose twice that
    lost, none = (undone_dead_band(0.5, full_duty=full_duty).confidence for full_duty in (100.0, 20.0))
    assert lost < CONFIDENT < none
    assert undone_dead_band(math.nan).confidence < CONFIDENT


@pytest.mark.parametrize("added", [0.0, 0.3])
def test_a_dead_band_shows_where_wheels_turn_against_their_duties(added):
    """The wheels' speed lags what they need, so that they often turn against their duties."""
    random, t = np.random.default_rng(3), INTERVAL * np.arange(6000)
    needed = np.column_stack([np.sin(2.0 * t + k) + 0.5 * np.sin(3.1 * t - k) for k in range(3)])
    speed = np.column_stack([np.sin(2.0 * t + k - 1.2) + 0.5 * np.sin(3.1 * t - k - 1.2) for k in range(3)])
    friction = np.stack([np.sign(speed), speed, np.sign(speed) * np.exp(-np.abs(speed))], axis=-1)
    acting = needed + 0.2 * np.sign(speed) + 0.2 * random.standard_normal(needed.shape)
    u = np.sign(acting) * np.maximum(np.abs(acting) - added, 1e-6)
    driving = Driving(
        torque=u,
        needed=needed,
        friction=friction,
        turning=np.ones_like(u),
        block=(t // 1.0).astype(np.intp),
    )
    own = Assignment(
        wheels=(0, 1, 2), signs=(1, 1, 1), explained=1.0, advantage=9.0, next_best="", confidence=1.0
    )
    signs = np.repeat(np.sign(u)[:, None, :], 3, axis=1)
    found = dead_band_estimate(driving, own, signs, u.std(axis=0))
    assert found is not None
    assert found.informative
    # duties below the dead band have lost their size, which makes it seem larger or smaller
    assert found.value * found.size == pytest.approx(added, abs=0.1)
    # without a gain of the commands there is no size of what drives
    assert dead_band_estimate(driving, own, signs, np.full(3, math.nan)) is None


def test_a_dead_band_that_the_motion_shows_is_undone_where_it_matters():
    without, large, unknown = (
        DeadBandEstimate(value=value, error=error, size=1.0)
        for value, error in ((-0.7, 0.1), (0.8, 0.1), (0.0, 50.0))
    )
    against = 0.8
    assert undone_dead_band(against).confidence < CONFIDENT
    assert undone_dead_band(against, unknown).confidence == pytest.approx(
        undone_dead_band(against).confidence, abs=0.01
    )
    # play makes the estimate negative where there is no dead band
    assert undone_dead_band(against, without).confidence > CONFIDENT
    assert undone_dead_band(against, without).value == 0.0
    shown = undone_dead_band(0.5, large)
    assert shown.probability > 0.5
    assert 0.1 < shown.value < 0.8
    assert shown.confidence > CONFIDENT
    # where it is harmless, none is undone
    assert undone_dead_band(0.2, large).value == 0.0
    # an estimate beyond all expectation shows nothing
    strange = DeadBandEstimate(value=1e3, error=0.1, size=1.0)
    assert undone_dead_band(against, strange).confidence == undone_dead_band(against).confidence


@given(
    against=st.floats(0.0, 5.0),
    value=st.floats(-1e6, 1e6),
    error=st.floats(0.0, 1e6),
    full_duty=st.floats(0.0, 1e4),
)
def test_an_undone_dead_band_is_never_negative_and_within_the_largest(against, value, error, full_duty):
    estimate = DeadBandEstimate(value=value, error=error, size=1.0)
    found = undone_dead_band(against, estimate, full_duty=full_duty)
    assert 0.0 <= found.value <= max(LARGEST_DEAD_BAND, LARGEST_DUTY * full_duty)
    assert 0.0 <= found.confidence <= 1.0
    assert 0.0 <= found.probability <= 1.0


@pytest.mark.parametrize(("per_ampere", "determined"), [(0.75, True), (0.87, False)])
def test_a_torque_is_told_from_a_current_by_a_quarter_not_by_an_eighth(per_ampere, determined):
    """The robot file's masses and torque constant are not known to an eighth, and a log gives no more than they do."""
    robot = Robot.load("alten")
    robot = robot.replace(drive=replace(robot.drive, gear_ratio=per_ampere / robot.drive.torque_constant))
    seen = Response(gain=1.07, gain_error=0.03, damping=0.03, damping_error=0.01)
    commands = 0.6 * np.sin(np.arange(300.0)).reshape(100, 3)
    found = unit_probabilities(robot, seen, commands, named_kind=None, named_unit=None)
    torque = sum(p for one, p in found.items() if one.kind == "torque")
    assert next(iter(found)).kind == "torque"
    assert (torque > CONFIDENT) == determined


def test_few_whole_numbers_are_a_duty_rather_than_a_torque():
    """Full duty of 255 is the motor's torque limit, and here a number is as much torque as 1 mN m of the motor."""
    robot = Robot.load("alten")
    robot = robot.replace(drive=replace(robot.drive, gear_ratio=1e3 * robot.drive.torque_limit / 255.0))
    number = robot.drive.torque_limit / 255.0
    emf = back_emf_damping(robot)
    seen = Response(
        gain=1.07 / number, gain_error=0.03, damping=emf, damping_error=emf
    )  # too little to decide

    def torque(largest: float) -> float:
        commands = np.round(largest * np.sin(np.arange(300.0))).reshape(100, 3)
        found = unit_probabilities(robot, seen, commands, named_kind=None, named_unit=None)
        return sum(p for one, p in found.items() if one.kind == "torque")

    few, many = torque(30.0), torque(150.0)
    assert few < 0.5 * many
    assert few > 0.01  # and no proof


def test_a_duty_of_a_motor_stronger_than_the_torque_limit_leaves_the_full_scale_open():
    """At 255, such a motor gives nearly the torque of one that just gives the limit, at 100; its braking shows it."""
    robot = Robot.load("kugle")
    stronger = 3.3
    emf = stronger * back_emf_damping(robot)
    gain = 255.0 / (stronger * robot.drive.torque_limit)
    seen = Response(gain=gain, gain_error=0.02, damping=emf + 0.015, damping_error=0.001)
    commands = np.round(40.0 * np.sin(np.arange(300.0))).reshape(100, 3)
    found = unit_probabilities(robot, seen, commands, named_kind="duty", named_unit=None)
    by_scale = {round(1.0 / one.scale): p for one, p in found.items() if one.kind == "duty"}
    assert by_scale[100] < CONFIDENT
    assert by_scale[255] > by_scale[100]


@pytest.mark.parametrize(("largest", "limited"), [(255.0, True), (280.0, False)])
def test_a_duty_is_limited_at_a_full_scale_only_if_it_goes_no_further(largest, limited):
    commands = np.minimum(np.abs(np.round(300.0 * np.sin(np.arange(30000.0)))), largest).reshape(-1, 3)
    found = unit_probabilities(Robot.load("alten"), None, commands, named_kind="duty", named_unit=None)
    by_scale = {round(1.0 / one.scale): p for one, p in found.items() if one.kind == "duty"}
    assert (by_scale[255] > 1.5 * by_scale[1000]) == limited


@pytest.mark.parametrize("seed", [0, 3, 5])
def test_commands_of_motors_alike_are_told_apart_even_if_the_robot_moves_along_one_line(seed):
    """Along a line the wheels need 1, -1/2 and -1/2 of a torque: with gains of their own, u1 = n2 and u2 = n1 as well
    are u1 = -n1/2 and u2 = -2 n2."""
    random = np.random.default_rng(seed)
    rows, seconds = 25, 12
    along = random.standard_normal(rows * seconds)
    needed = along[:, None] * np.array([1.0, -0.5, -0.5])
    # across the line a fiftieth, less than the noise of the differentiated signals
    needed[:, 1:] += 0.02 * random.standard_normal(rows * seconds)[:, None] * np.array([1.0, -1.0])
    noisy = needed + 0.1 * random.standard_normal(needed.shape)
    speeds = random.standard_normal(needed.shape)
    friction = np.stack([np.sign(speeds), speeds, np.sign(speeds) * np.exp(-np.abs(speeds))], axis=-1)
    driving = Driving(
        torque=0.4 * needed[:, [1, 0, 2]],
        needed=noisy,
        friction=friction,
        turning=np.ones_like(needed),
        block=np.repeat(np.arange(seconds), rows),
    )
    # the names say that commands and encoders are numbered alike, and are wrong
    found = assign(driving, [(0, 1), (1, 1), (2, 1)])
    assert (found.wheels, found.signs) == ((1, 0, 2), (1, 1, 1))
    assert found.confidence > CONFIDENT
    # the noise is 0.1 of a need of 0.7, root mean square: 0.02 of its variance, and more of the smaller two
    assert found.explained > 0.96
