"""Mapping files: foreign tables become logs with the right columns, units, signs, delays, torques and attitude."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.imu_angles import QUATERNION_ANGLES, from_roll_pitch_yaw, quaternion_angles
from ballbot.log.mapping import read_mapping
from ballbot.log.pose import wheel_speeds_of_states, with_position
from ballbot.log.signals import without_holes, without_resets
from ballbot.mechanics.geometry import rotation
from ballbot.robot import Robot

_PRESET = Robot.load("rob311")
OF_2_5_OHM = _PRESET.replace(drive=replace(_PRESET.drive, resistance=2.5))
ROB311 = """
[file]
separator = "blanks"

[columns]
t = "t_now"
theta = { from = "theta_x", unit = "deg" }
phi = { from = "theta_y", unit = "deg", sign = -1 }
theta_dot = { derivative_of = "theta" }

[wheels]
order = [1, 3, 2]
sign = [1, 1, -1]
angle = { from = ["psi_1", "psi_2", "psi_3"] }
speed = { derivative_of = "angle" }

[input]
kind = "pwm"
from = ["u1", "u2", "u3"]
supply_voltage = 11.1
torque_constant = 0.01
back_emf_constant = 0.02
gear_ratio = 70.0
dead_band = 0.03
duty_limit = 0.25
"""


def read(folder: Path, table: str, mapping: str, *, name: str = "log.txt") -> Log:
    (folder / name).write_text(table)
    (folder / "mapping.toml").write_text(mapping)
    return Log.read(folder / name, mapping=folder / "mapping.toml", robot=OF_2_5_OHM)


def csv_of(names: str, *columns: np.ndarray) -> str:
    """Return columns as CSV; NaN is a missing value."""
    return "\n".join([names, *(",".join(map(repr, row)) for row in np.column_stack(columns).tolist())])


def refused(folder: Path, mapping: str) -> str:
    (folder / "mapping.toml").write_text(mapping)
    with pytest.raises(InputError) as caught:
        read_mapping(folder / "mapping.toml")
    sentence = str(caught.value)
    assert sentence.startswith(str(folder / "mapping.toml"))
    assert "\n" not in sentence
    return sentence


def test_a_log_like_rob311s(tmp_path):
    t = 0.0115 * np.arange(200)
    wheels = np.column_stack([np.sin(t), 2.0 * t, t**2])
    duty = np.column_stack([0.1 + 0 * t, 0.2 + 0 * t, 0.3 * np.cos(t)])
    lean = np.column_stack([3.0 * np.sin(t), 2.0 * np.cos(t)])  # degrees
    rows = np.column_stack([np.arange(200), t, duty, lean, wheels])
    header = (
        "i t_now u1 u2 u3 theta_x theta_y psi_1 psi_2 psi_3 \n"  # the robot's own leaves a blank at the end
    )
    table = header + "\n".join(" ".join(map(repr, row)) + " " for row in rows.tolist())
    log = read(tmp_path, table, ROB311)

    np.testing.assert_array_equal(log.t, t)
    np.testing.assert_allclose(log["theta"], np.radians(lean[:, 0]), rtol=1e-14)
    np.testing.assert_allclose(log["phi"], -np.radians(lean[:, 1]), rtol=1e-14)
    # Ballbot's wheels 1, 2, 3 are the file's 1st, 3rd (turned round) and 2nd
    np.testing.assert_array_equal(log["wheel2"], -wheels[:, 2])
    np.testing.assert_array_equal(log["wheel3"], wheels[:, 1])
    # central differences are exact for t^2 and 2 t (1e-9: rounding over 11.5 ms)
    np.testing.assert_allclose(log["wheel2_dot"][1:-1], -2.0 * t[1:-1], atol=1e-9)
    np.testing.assert_allclose(log["wheel3_dot"], 2.0, atol=1e-9)
    # u = n k_t (d V - k_e n w) / R, by hand, for the file's second wheel at duty 0.2 + 0.03 and 2 rad/s
    np.testing.assert_allclose(log["u3"], 70.0 * 0.01 * (0.23 * 11.1 - 0.02 * 70.0 * 2.0) / 2.5, atol=1e-9)
    assert log["u1"][0] == pytest.approx(0.28 * (0.13 * 11.1 - 1.4 * log["wheel1_dot"][0]), rel=1e-12)
    # at the limit of the duty
    assert log["u2"][0] == pytest.approx(0.28 * (0.25 * 11.1 - 1.4 * log["wheel2_dot"][0]), rel=1e-12)


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ('{ from = "a", unit = "deg" }', np.pi),
        ('{ from = "a", unit = "turn" }', 360.0 * np.pi),
        ('{ from = "a", unit = "counts", counts_per_turn = 720 }', np.pi / 2),
        ('{ from = "a", scale = 0.5, sign = -1, offset = 1.0 }', -89.0),
        ('"a"', 180.0),
    ],
)
def test_units_scales_signs_and_offsets(tmp_path, entry, value):
    log = read(tmp_path, "time,a\n0,180\n1000,0\n", f'[columns]\nt={{from="time",unit="ms"}}\npsi={entry}\n')
    assert log["psi"][0] == pytest.approx(value, rel=1e-15)
    np.testing.assert_array_equal(log.t, [0.0, 1.0])


@given(delay=st.floats(-0.4, 0.4))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_a_sensors_delay_is_undone(tmp_path, delay):
    t = 0.01 * np.arange(101)
    # a straight line survives linear interpolation exactly: seen `delay` late, it is 3 (t - delay)
    table = "t,late\n" + "\n".join(f"{a!r},{3.0 * (a - delay)!r}" for a in t.tolist())
    log = read(tmp_path, table, f'[columns]\nt="t"\nx={{from="late",delay={delay!r}}}\n', name="log.csv")
    # rows that rounding moves past the file's end by up to 1e-9 s are kept, with the end's value
    np.testing.assert_allclose(log["x"], 3.0 * log.t, atol=4e-9)
    # what is cut is what the delay asks for, to within a row
    assert abs(len(log) - (101 - abs(delay) / 0.01)) <= 1.0


# at 10 Hz, and 3 * 0.1 - 0.2 is a little less than 0.1: a whole delay must not slip by a row
@pytest.mark.parametrize(("delay", "lag", "first"), [(0.2, 2, 2), (0.15, 2, 2), (0.1, 1, 1)])
def test_a_commands_delay_holds_it_until_the_next(tmp_path, delay, lag, first):
    t = 0.1 * np.arange(6)
    table = "t,i\n" + "\n".join(f"{a!r},{10 * k}" for k, a in enumerate(t.tolist()))
    mapping = f"""
[columns]
t = "t"
[input]
kind = "current"
from = ["i"]
delay = {delay}
torque_constant = 0.5
gear_ratio = 4.0
efficiency = 0.8
"""
    log = read(tmp_path, table, mapping, name="log.csv")
    # a command of t acts from t + delay on, until the next does; u = 4 * 0.5 * 0.8 * i
    np.testing.assert_array_equal(log.t, t[first:])
    np.testing.assert_allclose(log["u1"], 16.0 * np.arange(6 - lag), rtol=1e-15)


def test_a_header_that_is_wrong_can_be_replaced_and_missing_values_named(tmp_path):
    mapping = """
[file]
separator = "semicolon"
header_lines = 2
names = ["time", "lean", "spare"]
missing = ["NA"]
[columns]
t = "time"
theta = "lean"
"""
    log = read(tmp_path, "# robot 7\nt;x\n0;0.1;9\n1;NA;9\n", mapping)
    np.testing.assert_array_equal(log["theta"], [0.1, np.nan])
    assert log.names == ("t", "theta")


def test_missing_file_column_is_reported_with_the_nearest_name(tmp_path):
    with pytest.raises(InputError, match=r"log\.csv: .* theta from column 'rol', .* did you mean 'roll'"):
        read(tmp_path, "t,roll\n0,1\n", '[columns]\nt="t"\ntheta="rol"\n', name="log.csv")


@pytest.mark.parametrize(
    ("mapping", "sentence"),
    [
        ('theta = "a"', "lacks t, the time"),
        ('t = { form = "t" }', "columns.t.form is not a key of a mapping file; did you mean 'from'?"),
        ('t = "t"\nthetadot = "a"', "not a column of a log; did you mean 'theta_dot'?"),
        ('t = "t"\nu1 = "a"', "map torques in [input]"),
        ('t = "t"\ntheta = { from = "a", unit = "m" }', "cannot be converted to rad; the units that can"),
        ('t = "t"\npsi = { from = "a", unit = "counts" }', "needs counts_per_turn"),
        ('t = "t"\ntheta_dot = { derivative_of = "theta" }', "is the derivative of 'theta'"),
        ('t = "t"\npsi = "a"\npsi_dot = { derivative_of = "psi", sign = -1 }', "which allows no other key"),
        ('t = "t"\n[wheels]\nangle = { from = ["a", "b"] }\norder = [1, 1]', "order is [1, 1]"),
        ('t = "t"\n[wheels]\nangle = { from = ["a", "b"] }\nsign = [1]', "one for each of 2 columns"),
        ('t = "t"\n[wheels]\nspeed = { unit = "rpm" }', "[wheels] speed needs from"),
        ('t = "t"\n[wheels]\nspeed = { derivative_of = "angle" }', "[wheels] speed needs from"),
        ('t = "t"\n[wheels]\nspeed = { from = ["a"], wrap = 4096 }', "speed cannot have wrap"),
        ('t = "t"\ntheta = "a"\n[attitude]\nfrom = ["a", "a"]', "has theta, which [attitude] provides"),
        ('t = "t"\n[file]\nheader_lines = 0', "header_lines = 0 and therefore needs names"),
        ('t = "t"\n[time]\nkeep = [[2.0, 1.0]]', "write the earlier time first"),
    ],
)
def test_a_bad_mapping_ends_in_a_sentence(tmp_path, mapping, sentence):
    assert sentence in refused(tmp_path, f"[columns]\n{mapping}\n")


def test_the_michigan_log_reads_through_a_mapping(shared_data, tmp_path):
    (tmp_path / "mapping.toml").write_text(ROB311)
    log = Log.read(
        shared_data / "rob311" / "main_control_1.txt", mapping=tmp_path / "mapping.toml", robot="rob311"
    )
    assert len(log) == 5124
    assert log.sample_time == pytest.approx(0.0115, abs=2e-4)  # "11.5 ms" of the data's README
    # the largest lean of the file is -35.6 degrees
    assert np.degrees(np.abs(log["theta"]).max()) == pytest.approx(35.607, abs=1e-3)
    assert np.isfinite(log.torques).all()
    # differenced angles have no glitches, unlike the logged speeds: the motors cannot do 30 rad/s
    assert np.abs(log.wheel_speeds).max() < 30.0


def test_commands_have_a_zero_and_directions(tmp_path):
    table = "t,a,b,c,d\n0,138,1,90,1\n1,118,0,91,-1\n2,128,,93,0\n"
    mapping = """
[columns]
t = "t"

[wheels]
order = [2, 1]

[input]
kind = "torque"
from = ["a", "c"]
sign = [1, -1]
scale = 0.5
"""
    log = read(tmp_path, table, mapping + "zero = [128, 90]\n")
    np.testing.assert_array_equal(log["u2"], [5.0, -5.0, 0.0])
    np.testing.assert_array_equal(log["u1"], [0.0, -0.5, -1.5])
    log = read(tmp_path, table, mapping + 'direction = ["b", "d"]\n')
    np.testing.assert_array_equal(log["u2"], [69.0, -59.0, np.nan])
    np.testing.assert_array_equal(log["u1"], [-45.0, 45.5, 46.5])
    with pytest.raises(InputError, match="takes u2 from column 'q', which does not exist"):
        read(tmp_path, table, mapping + 'direction = ["q", "d"]\n')


def test_the_angles_of_speeds_are_their_integrals(tmp_path):
    """By the trapezoid rule over the file's rows; missing in a long hole, and continued after it."""
    t = 0.01 * np.arange(100)
    speed = np.sin(3.0 * t)
    logged = 60.0 * speed / (2.0 * np.pi)
    logged[[20, *range(50, 70)]] = np.nan
    mapping = """
[columns]
t = "t"

[wheels]
order = [2, 1]
sign = [-1, 1]
speed = { from = ["a", "b"], unit = "rpm", delay = 0.01 }
angle = { integral_of = "speed" }
"""
    log = read(tmp_path, csv_of("t,a,b", t, logged, np.ones(100)), mapping)
    np.testing.assert_allclose(np.diff(log["wheel1"]), 2.0 * np.pi / 60.0 * 0.01, rtol=1e-9)
    np.testing.assert_allclose(log["wheel2_dot"][:15], -speed[1:16], rtol=1e-9)
    # h^2 / 12 times the change of the slope, at most 6, is 5e-5
    np.testing.assert_allclose(log["wheel2"][:45], (np.cos(3.0 * t[1:46]) - 1.0) / 3.0, atol=1e-4)
    assert np.isnan(log["wheel2"][50:68]).all()
    assert np.isfinite(log["wheel2"][70:]).all()


def test_an_encoder_that_begins_again_is_continued_in_the_files_numbers(tmp_path):
    counts = 4000 + 90 * np.arange(60)
    rows = "\n".join(f"{0.01 * k:.2f},{count % 4096},{-count % 4096}" for k, count in enumerate(counts))
    mapping = """
[columns]
t = "t"

[wheels]
sign = [1, -1]
angle = { from = ["a", "b"], unit = "counts", counts_per_turn = 20480, wrap = 4096 }
speed = { derivative_of = "angle" }
"""
    log = read(tmp_path, f"t,a,b\n{rows}\n", mapping)
    for name in ("wheel1", "wheel2"):
        turned = log[name] - log[name][0]
        np.testing.assert_allclose(turned, (counts - counts[0]) * 2.0 * np.pi / 20480.0, atol=1e-12)


@given(
    roll=st.floats(-1.0, 1.0), pitch=st.floats(-1.0, 1.0), yaw=st.floats(-3.0, 3.0), turn=st.floats(-3.0, 3.0)
)
def test_an_imus_angles_become_the_same_rotation(roll, pitch, yaw, turn):
    theta, phi, psi = from_roll_pitch_yaw(np.array([[roll, pitch, yaw]]), turn=turn)[0]
    imu = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    # the IMU's x axis stands at `turn` in the body's frame
    body = imu * Rotation.from_euler("z", turn).inv()
    np.testing.assert_allclose(
        Rotation.from_euler("XYZ", [theta, phi, psi]).as_matrix(), body.as_matrix(), atol=1e-12
    )


@given(
    attitude=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-3.0, 3.0)),
    size=st.floats(0.5, 2.0),
    sign=st.sampled_from([1.0, -1.0]),
)
def test_a_quaternion_of_any_norm_and_sign_gives_the_angles_of_its_rotation(attitude, size, sign):
    body = Rotation.from_euler("ZYX", attitude[::-1])
    x, y, z, w = sign * size * body.as_quat()
    found = quaternion_angles(np.array([[w, x, y, z], [np.nan, x, y, z], [0.0, 0.0, 0.0, 0.0]]))
    angles = np.column_stack([found[name] for name in QUATERNION_ANGLES])
    np.testing.assert_allclose(angles[0], attitude, atol=1e-12)
    assert np.isnan(angles[1:]).all()


def test_rows_out_of_order_are_dropped_but_two_runs_are_not_mixed(tmp_path):
    """Run 2 lacks the seconds 4 to 6, so that the longest series in order would be of both runs."""
    first, second = 0.005 * np.arange(4001), 0.005 * np.arange(5001)
    second = second[(second < 4.0) | (second > 6.0)]

    mapping = '[file]\nunordered_rows = "drop"\n[columns]\nt = "t"\nx = "x"\n'
    late = first.copy()
    late[700] += 0.5
    assert len(read(tmp_path, csv_of("t,x", late, late), mapping)) == 4000
    joined = np.concatenate([first, second])
    both = csv_of("t,x", joined, joined)
    with pytest.raises(InputError, match=r"starts again at row 4002; split the log, or give .file. rows"):
        read(tmp_path, both, mapping)
    cut = mapping.replace("[columns]", "rows = [1, 4001]\n[columns]")
    assert len(read(tmp_path, both, cut)) == 4001


def test_a_mapping_takes_four_columns_for_a_quaternion(tmp_path):
    t = 0.01 * np.arange(200)
    attitude = np.column_stack([0.1 * np.sin(3.0 * t), 0.2 * np.cos(2.0 * t), 4.0 * t])  # past half a turn
    over = Rotation.from_euler("ZYX", attitude[:, ::-1]) * Rotation.from_euler("x", np.pi)
    table = csv_of("t,roll,pitch,yaw,x,y,z,w", t, attitude, over.as_quat())
    head, tail = '[columns]\nt = "t"\n[attitude]\nturn = 30.0\n', "\n"
    by_angles = read(tmp_path, table, head + 'from = ["roll", "pitch", "yaw"]' + tail)
    four = 'from = ["w", "x", "y", "z"]\nupside_down = true'
    by_quaternion = read(tmp_path, table, head + four + tail)
    for name in ("theta", "phi", "psi"):
        np.testing.assert_allclose(by_quaternion[name], by_angles[name], atol=1e-9)
    with pytest.raises(InputError, match="quaternion w, x, y, z, which has no unit"):
        read(tmp_path, table, head + four + '\nunit = "deg"' + tail)


def test_even_rows_read_sensors_between_and_keep_the_commands_impulse(tmp_path):
    t = np.cumsum(np.random.default_rng(2).uniform(0.008, 0.016, 300))
    u = np.sign(np.sin(9.0 * t))
    mapping = (
        '[time]\nsample_time = 0.01\n[columns]\nt = "time"\nx = "a"\n[input]\nkind = "torque"\nfrom = ["u"]\n'
    )
    log = read(tmp_path, csv_of("time,a,u", t, 2.0 * t, u), mapping)
    np.testing.assert_allclose(np.diff(log.t), 0.01, atol=1e-12)
    np.testing.assert_allclose(log["x"], 2.0 * log.t, atol=1e-12)  # a line is read exactly between its rows
    held = np.sum(u[:-1] * np.diff(t))
    # the last even row's command goes on past the file
    assert np.sum(log["u1"]) * 0.01 == pytest.approx(held, abs=0.02)


def test_a_held_command_of_a_delay_acts_later(tmp_path):
    table = "time,u\n" + "\n".join(f"{0.01 * k!r},{float(k >= 50)!r}" for k in range(100))
    mapping = '[time]\nsample_time = 0.01\n[columns]\nt = "time"\n[input]\nkind="torque"\nfrom=["u"]\ndelay = 0.025\n'
    log = read(tmp_path, table, mapping)
    u = dict(zip(np.round(log.t, 6).tolist(), log["u1"].tolist(), strict=True))
    # it rises at 0.500 s and acts from 0.525 s: over half of the row at 0.52
    assert [u[0.51], u[0.52], u[0.53]] == pytest.approx([0.0, 0.5, 1.0], abs=1e-9)


@pytest.mark.parametrize("jump", [-400.0, 30.0])
def test_an_encoders_reset_is_carried_on(jump):
    t = 0.01 * np.arange(500)
    angle = 3.0 * np.sin(t)
    broken = angle + jump * (t > 2.0)
    found = without_resets(t, broken, 40.0)
    # the step over the jump is lost: at most a row's motion
    np.testing.assert_allclose(found, angle, atol=0.031)


def test_spans_and_damaged_rows(tmp_path):
    rows = [f"{0.01 * k!r} {k}" for k in range(100)]
    rows[40] = "0.4 40 41"
    rows[41] = "0.41 oops"
    mapping = (
        '[file]\nseparator = "blanks"\ndamaged_rows = "drop"\nrows = [1, 90]\n'
        "[time]\nkeep = [[0.105, 0.205], [0.305, 0.505]]\n"
        '[columns]\nt = "time"\nx = "a"\n'
    )
    log = read(tmp_path, "time a\n" + "\n".join(rows) + "\nend\n", mapping)
    expected = [*range(11, 21), *(k for k in range(31, 51) if k not in (40, 41))]
    assert log["x"].tolist() == expected
    with pytest.raises(InputError, match="selects no row"):
        read(
            tmp_path,
            "time a\n0 1\n1 2\n",
            '[file]\nseparator="blanks"\n[time]\nkeep=[[5.0, 6.0]]\n[columns]\nt="time"\n',
        )


@pytest.mark.parametrize("turn", [0.0, 160.0])
def test_without_yaw_and_gyro_the_wheels_give_the_heading(tmp_path, turn):
    """`alten` leans while it turns by half a turn, so that no term of the transformation is small."""
    robot = Robot.load("alten")
    t = 0.005 * np.arange(1601)
    theta, phi, psi = 0.2 * np.sin(2.0 * t), 0.15 * np.sin(3.1 * t), 0.4 * t - 0.5 * np.sin(t) ** 2
    states = np.column_stack([np.zeros_like(t)] * 2 + [theta, phi, psi])
    states = np.column_stack([states, np.gradient(states, t, axis=0)])
    states[:, 5:7] = np.column_stack([0.3 * np.sin(1.3 * t), 0.2 * np.cos(0.9 * t)])
    speeds = wheel_speeds_of_states(states, robot)
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    R = rotation(theta, phi, psi) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    roll, pitch = np.arctan2(R[:, 2, 1], R[:, 2, 2]), -np.arcsin(R[:, 2, 0])
    table = csv_of("t,a,b,w1,w2,w3", t, roll, pitch, speeds)
    mapping = f"""
[columns]
t = "t"
wheel1_dot = "w1"
wheel2_dot = "w2"
wheel3_dot = "w3"
theta_dot = {{ derivative_of = "theta" }}
phi_dot = {{ derivative_of = "phi" }}
psi_dot = {{ derivative_of = "psi" }}
[attitude]
from = ["a", "b"]
turn = {turn}
"""
    mapped = read(tmp_path, table, mapping)
    assert "psi" not in mapped
    assert "psi_dot" not in mapped
    log = with_position(mapped, robot)
    # differences over 10 ms of signals of up to 3 rad/s: 4e-5 of the rates, and three times that of the heading in 8 s
    for name, truth in (("theta", theta), ("phi", phi), ("psi", psi)):
        np.testing.assert_allclose(log[name] - log[name][0], truth - truth[0], atol=2e-4)
    np.testing.assert_allclose(log["x_dot"][2:-2], states[2:-2, 5], atol=2e-4)


def test_without_a_yaw_the_heading_is_the_gyros_integral(tmp_path):
    t = 0.01 * np.arange(301)
    table = "\n".join(["t,roll,pitch,gx,gy,gz", *(f"{s:.4f},0,0,0,0,{0.5 + 0.2 * s:.6f}" for s in t)])
    attitude = '[attitude]\nfrom = ["roll", "pitch"]\nrates = { from = ["gx", "gy", "gz"], unit = "rad/s" }\n'
    log = read(tmp_path, table, f'[columns]\nt = "t"\n{attitude}')
    # the trapezoidal rule is exact for a rate that grows evenly; the table has six decimals
    np.testing.assert_allclose(log["psi"], 0.5 * log.t + 0.1 * log.t**2, atol=1e-5)
    np.testing.assert_allclose(log["psi_dot"], 0.5 + 0.2 * log.t, atol=1e-5)


def test_short_holes_are_filled_and_long_ones_are_not():
    t = np.arange(100) / 100
    values = 2.0 * t
    values[[10, 11, *range(40, 60)]] = np.nan
    filled, held = without_holes(t, values), without_holes(t, values, held=True)
    assert filled[10:12] == pytest.approx([0.2, 0.22])
    assert held[10:12] == pytest.approx([0.18, 0.18])
    assert np.isnan(filled[40:60]).all()
    assert np.isnan(held[40:60]).all()
