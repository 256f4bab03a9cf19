"""What a mapping does beside units and signs: even rows, attitude, resets, spans, damage, duties."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.checks.kinematics import wheel_speeds_of_states
from ballbot.log.imu_angles import QUATERNION_ANGLES, from_roll_pitch_yaw, less_half_a_turn, quaternion_angles
from ballbot.log.mapping import DutyTable
from ballbot.log.pose import with_position
from ballbot.log.signals import without_holes, without_resets
from ballbot.mechanics.geometry import rotation
from ballbot.robot import Robot


def read(folder, table: str, mapping: str) -> Log:
    (folder / "log.csv").write_text(table)
    (folder / "mapping.toml").write_text(mapping)
    return Log.read(folder / "log.csv", mapping=folder / "mapping.toml")


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
def test_a_quaternion_and_an_imu_upside_down_become_the_same_rotation(attitude, size, sign):
    """A quaternion of any norm and sign gives the angles of its rotation; one turned over differs by half a roll."""
    body = Rotation.from_euler("ZYX", attitude[::-1])
    x, y, z, w = sign * size * body.as_quat()
    found = quaternion_angles(np.array([[w, x, y, z], [np.nan, x, y, z], [0.0, 0.0, 0.0, 0.0]]))
    angles = np.column_stack([found[name] for name in QUATERNION_ANGLES])
    np.testing.assert_allclose(angles[0], attitude, atol=1e-12)
    assert np.isnan(angles[1:]).all()
    imu = body * Rotation.from_euler("x", np.pi)
    yaw, pitch, roll = imu.as_euler("ZYX")
    righted = Rotation.from_euler("ZYX", [yaw, pitch, less_half_a_turn(np.array([roll]), np.pi)[0]])
    np.testing.assert_allclose(righted.as_matrix(), body.as_matrix(), atol=1e-12)


def test_rows_out_of_order_are_dropped_but_two_runs_are_not_mixed(tmp_path):
    """Run 2 lacks the seconds 4 to 6, so that the longest series in order would be of both runs."""
    first, second = 0.005 * np.arange(4001), 0.005 * np.arange(5001)
    second = second[(second < 4.0) | (second > 6.0)]

    def table(t: np.ndarray) -> str:
        return "t,x\n" + "\n".join(f"{time:.4f},{row}" for row, time in enumerate(t))

    mapping = '[file]\nunordered_rows = "drop"\n[columns]\nt = "t"\nx = "x"\n'
    late = first.copy()
    late[700] += 0.5
    assert len(read(tmp_path, table(late), mapping)) == 4000
    both = table(np.concatenate([first, second]))
    with pytest.raises(
        InputError, match=r"Time starts again at row 4002; split the log, or give .file. rows"
    ):
        read(tmp_path, both, mapping)
    cut = mapping.replace("[columns]", "rows = [1, 4001]\n[columns]")
    assert len(read(tmp_path, both, cut)) == 4001


def test_a_mapping_takes_four_columns_for_a_quaternion(tmp_path):
    t = 0.01 * np.arange(200)
    attitude = np.column_stack([0.1 * np.sin(3.0 * t), 0.2 * np.cos(2.0 * t), 4.0 * t])  # past half a turn
    over = Rotation.from_euler("ZYX", attitude[:, ::-1]) * Rotation.from_euler("x", np.pi)
    rows = np.column_stack([t, attitude, over.as_quat()]).tolist()
    table = "t,roll,pitch,yaw,x,y,z,w\n" + "\n".join(",".join(map(repr, row)) for row in rows)
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
    table = "time,a,u\n" + "\n".join(
        f"{k!r},{2.0 * k!r},{v!r}" for k, v in zip(t.tolist(), u.tolist(), strict=True)
    )
    mapping = (
        '[time]\nsample_time = 0.01\n[columns]\nt = "time"\nx = "a"\n[input]\nkind = "torque"\nfrom = ["u"]\n'
    )
    log = read(tmp_path, table, mapping)
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


def test_a_duty_with_a_dead_band():
    drive = DutyTable(
        kind="duty",
        sources=("u1",),
        supply_voltage=12.0,
        torque_constant=0.01,
        back_emf_constant=0.01,
        resistance=2.0,
        gear_ratio=70.0,
        dead_band=0.03,
        duty_limit=0.9,
    )
    assert drive.acting(np.array([-0.5, 0.0, 0.2, 0.89])).tolist() == [-0.53, 0.0, 0.23, 0.9]
    # by hand: 70 x 0.01 x (0.5 x 12 - 0.01 x 70 x 5) / 2
    assert drive.torque(np.array([0.5]), np.array([5.0]))[0] == pytest.approx(0.875)


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
    rows = np.column_stack([t, roll, pitch, speeds])
    table = "\n".join(["t,a,b,w1,w2,w3", *(",".join(f"{one:.12g}" for one in row) for row in rows)])
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
