"""`read_name`: any text has a reading, and a known name has one reading however it is written."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.log.mapping_search.names import UNITS, read_name, read_names
from ballbot.log.mapping_search.roles import roles_by_name

#: words, and what they say: kind, axis, number, input kind
KNOWN = {
    ("time",): ("time", None, None, None),
    ("timestamp",): ("time", None, None, None),
    ("roll",): ("attitude", "x", None, None),
    ("imu", "pitch"): ("attitude", "y", None, None),
    ("yaw",): ("attitude", "z", None, None),
    ("gyro", "x"): ("gyro", "x", None, None),
    ("gyro", "z"): ("gyro", "z", None, None),
    ("accel", "y"): ("accelerometer", "y", None, None),
    ("enc", "1"): ("wheel angle", None, 1, None),
    ("encoder", "3"): ("wheel angle", None, 3, None),
    ("wheel", "2", "speed"): ("wheel speed", None, 2, None),
    ("motor", "1", "current"): ("command", None, 1, "current"),
    ("torque", "2"): ("command", None, 2, "torque"),
    ("motor", "3", "pwm"): ("command", None, 3, "duty"),
    ("voltage", "1"): ("command", None, 1, "voltage"),
    ("loop", "count"): ("other", None, None, None),
    ("battery",): ("other", None, None, None),
}
STYLES = {
    "snake": "_".join,
    "camel": lambda words: "".join(word.capitalize() for word in words),
    "dots": ".".join,
    "dashes": "-".join,
    "capitals": lambda words: "_".join(word.upper() for word in words),
    "brackets": lambda words: "".join(f"[{word}]" if word.isdigit() else word for word in words),
}


@given(st.text())
def test_any_text_has_a_reading(name):
    found = read_name(name)
    assert found.name == name
    assert 0.0 <= found.weight <= 1.0


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("words", KNOWN, ids=" ".join)
def test_a_name_has_one_reading_however_it_is_written(words, style):
    if style == "brackets" and not any(word.isdigit() for word in words):
        return
    found = read_name(STYLES[style](list(words)))
    assert (found.kind, found.axis, found.index, found.input_kind) == KNOWN[words]


@given(
    st.sampled_from([("gyro_{}", "gyro"), ("{}_rate", "gyro")]),
    st.sampled_from(["x", "y", "z"]),
    st.sampled_from(["rad/s", "deg/s"]),
)
def test_a_unit_may_stand_in_brackets_or_at_the_end(form, axis, unit):
    word = axis if "gyro" in form[0] else {"x": "roll", "y": "pitch", "z": "yaw"}[axis]
    stem = form[0].format(word)
    for name in (
        f"{stem} ({unit})",
        f"{stem}[{unit}]",
        f"{stem}_{ {'rad/s': 'rad_s', 'deg/s': 'dps'}[unit] }",
    ):
        found = read_name(name)
        assert (found.kind, found.axis, found.unit) == ("gyro", axis, unit)


@pytest.mark.parametrize(
    ("name", "kind", "unit"),
    [
        ("Timestamp_us", "time", "us"),
        ("time_ms", "time", "ms"),
        ("Time (s)", "time", "s"),
        ("GyroX_dps", "gyro", "deg/s"),
        ("Motor1_current_A", "command", "A"),
        ("roll_deg", "attitude", "deg"),
        ("enc1_counts", "wheel angle", "counts"),
        ("u1 [N m]", "command", "N m"),
        ("duty2_pct", "command", "%"),
        ("wheel3_rpm", "wheel speed", "rpm"),
        ("T1", "command", None),
        ("theta_x", "attitude", None),
        ("psi_1", "wheel angle", None),
        ("Tx", "body command", None),
        ("PWM[2]", "command", None),
        ("ms", "time", "ms"),
        ("us", "time", "us"),
        ("p_roll", "other", None),
        ("theta_w1", "wheel angle", None),
        ("theta_w1_dot", "wheel speed", None),
        ("wheels_1", "wheel angle", None),
        ("e_x", "other", None),
    ],
)
def test_names_of_known_logs(name, kind, unit):
    found = read_name(name)
    assert (found.kind, found.unit) == (kind, unit)


@pytest.mark.parametrize("mark", ["ref", "target", "setpoint", "des", "goal"])
@given(st.sampled_from(["roll", "pitch", "enc1", "wheel2_speed", "x", "gyro_x", "psi"]), st.booleans())
def test_a_set_point_is_never_a_measurement(mark, name, before):
    assert read_name(f"{mark}_{name}" if before else f"{name}_{mark}").kind == "reference"


def test_commands_to_the_body_are_no_motor_commands():
    assert read_name("cmd_vel").kind == "reference"
    assert read_name("cmd_vel_x").kind == "reference"
    assert read_name("theta_d_x").kind == "reference"
    assert read_name("motor_cmd_1").kind == "command"


def test_every_unit_has_a_spelling_of_its_own():
    spellings = [spelling for words in UNITS.values() for spelling in words]
    assert len(spellings) == len(set(spellings))


@pytest.mark.parametrize(
    "form", ["I_{}_mA", "current_{}_mA", "cur_{}", "current_{}", "enc_{}", "enc{}", "M_{}_current"]
)
@pytest.mark.parametrize("letters", ["ABC", "abcd"])
def test_letters_that_number_a_series_are_no_unit(form, letters):
    """`cur_A` beside `cur_B` and `cur_C` is a motor's current, and alone a current in amperes."""
    if form == "enc{}" and letters.islower():
        return  # enca is a word
    names = [form.format(letter) for letter in letters]
    found = read_names(["t", *names])[1:]
    assert [one.name for one in found] == names
    assert [one.index for one in found] == list(range(1, len(letters) + 1))
    assert {(one.kind, one.unit) for one in found} == {
        ("wheel angle" if "enc" in form else "command", "mA" if "mA" in form else None)
    }


def test_a_letter_alone_or_beside_a_number_stays_what_it_is():
    (alone,) = read_names(["current_A"])
    assert (alone.unit, alone.index) == ("A", None)
    channels = read_names([f"M{motor}_{channel}" for motor in (1, 2, 3) for channel in "ABC"])
    assert channels == [read_name(one.name) for one in channels]


@pytest.mark.parametrize(
    ("name", "reading"),
    [
        ("torque_Nm_1", ("command", None, 1, "N m", "torque")),
        ("torque_N_m_2", ("command", None, 2, "N m", "torque")),
        ("current.A.3", ("command", None, 3, "A", "current")),
        ("enc_ticks_1", ("wheel angle", None, 1, "counts", None)),
        ("gyro_dps_x", ("gyro", "x", None, "deg/s", None)),
        ("Zeit [ms]", ("time", None, None, "ms", None)),
        ("Rollwinkel_Grad", ("attitude", "x", None, "deg", None)),
        ("Drehrate_x", ("gyro", "x", None, None, None)),
        ("Rad1_rad", ("wheel angle", None, 1, "rad", None)),
        ("Drehzahl2_rpm", ("wheel speed", None, 2, "rpm", None)),
        ("Moment1_Nm", ("command", None, 1, "N m", "torque")),
        ("Strom M1 [A]", ("command", None, 1, "A", "current")),
        ("Strom_Soll_1", ("command", None, 1, None, "current")),
        ("Couple1_Nm", ("command", None, 1, "N m", "torque")),
        ("Couple_Nm", ("other", None, None, "N m", "torque")),
        # revolutions or radians a second
        ("rpm1", ("wheel speed", None, 1, "rpm", None)),
        ("w1_rps", ("wheel speed", None, 1, "rps", None)),
        ("gyro_x_rps", ("gyro", "x", None, None, None)),
    ],
)
def test_units_within_a_name_german_words_and_units_that_say_the_kind(name, reading):
    found = read_name(name)
    assert (found.kind, found.axis, found.index, found.unit, found.input_kind) == reading


def test_a_german_set_point_is_never_a_measurement():
    assert read_name("Rollwinkel_Soll").kind == "reference"


@pytest.mark.parametrize("form", ["enc_{}", "enc{}", "{}_enc_counts"])
def test_corners_that_number_a_series_are_its_numbers_in_the_order_of_the_file(form):
    names = [form.format(corner) for corner in ("FL", "RL", "RR", "FR")]
    found = read_names(["t", *names])[1:]
    assert [(one.name, one.kind, one.index) for one in found] == [
        (name, "wheel angle", place) for place, name in enumerate(names, start=1)
    ]
    assert read_names(names[:3]) == [read_name(name) for name in names[:3]]


@pytest.mark.parametrize(
    ("name", "reading"),
    [
        ("wielhoek1 [rad]", ("wheel angle", None, 1, "rad", None)),
        ("motorkoppel2 [Nm]", ("command", None, 2, "N m", "torque")),
        ("/joint2/position", ("wheel angle", None, 2, None, None)),
        ("/joint1/cmd", ("command", None, 1, None, None)),
        ("/imu/gyro_x_rad/s", ("gyro", "x", None, "rad/s", None)),
        ("Stellgr\u00f6\u00dfe_2", ("command", None, 2, None, None)),
        ("Stellgroesse_M3", ("command", None, 3, None, None)),
        ("tijd [s]", ("time", None, None, "s", None)),
        ("Inkremente_Rad1", ("wheel angle", None, 1, None, None)),
        ("beccheggio_gradi", ("attitude", "y", None, "deg", None)),
        ("corrente_motore_3_mA", ("command", None, 3, "mA", "current")),
        ("\u00e2ngulo_roda1_rad", ("wheel angle", None, 1, "rad", None)),
        ("tens\u00e3o2", ("command", None, 2, None, "voltage")),
        ("k\u0105t_ko\u0142a_2", ("wheel angle", None, 2, None, None)),
        ("hjulvinkel1", ("wheel angle", None, 1, None, None)),
        ("motorstr\u00f6m1", ("command", None, 1, None, "current")),
        ("vitesse_roue_1", ("wheel speed", None, 1, None, None)),
        ("vesc1_tachometer", ("wheel angle", None, 1, None, None)),
        ("vesc1_duty_cycle", ("command", None, 1, None, "duty")),
        ("cycle_time", ("other", None, None, None, None)),
    ],
)
def test_words_of_other_languages_and_motor_controllers(name, reading):
    found = read_name(name)
    assert (found.kind, found.axis, found.index, found.unit, found.input_kind) == reading


def test_stamp_is_pitch_in_dutch_and_a_time_elsewhere():
    assert [one.kind for one in read_names(["rol", "stamp", "gier"])] == ["attitude"] * 3
    assert read_names(["header.stamp", "roll"])[0].kind == "time"


def test_an_effort_beside_position_and_velocity_is_in_newton_metres():
    joints = [f"/{k}/{word}" for k in (1, 2, 3) for word in ("position", "velocity", "effort")]
    roles = roles_by_name(["t", *joints], wheel_count=3)
    commands = roles.reading(roles.commands)
    assert commands is not None
    assert (commands.name, commands.unit) == ("/1/effort", "N m")
    alone = roles_by_name(["t", "effort1", "effort2", "effort3"], wheel_count=3)
    assert read_names(alone.commands, alone.units)[0].unit is None


def by_name(*names: str, units: dict[str, str] | None = None) -> dict[str, tuple]:
    found = read_names(names, units)
    return {one.name: (one.kind, one.axis, one.index, one.unit) for one in found}


@pytest.mark.parametrize(("form", "unit"), [("{}", None), ("{}_dps", "deg/s"), ("imu.{} [rad/s]", "rad/s")])
def test_p_q_and_r_are_a_gyro_together_and_nothing_alone(form, unit):
    names = [form.format(letter) for letter in "pqr"]
    assert list(by_name(*names).values()) == [("gyro", axis, None, unit) for axis in "xyz"]
    assert by_name(names[0])[names[0]][0] == "other"


def test_phi_beside_p_q_and_r_is_the_roll():
    found = by_name("phi", "theta", "psi", "p", "q", "r")
    assert [found[name][:2] for name in ("phi", "theta", "psi")] == [("attitude", axis) for axis in "xyz"]


def test_r_p_and_y_are_roll_pitch_and_yaw_together():
    found = by_name("ts", "r", "p", "y", "gx", "gy", "gz")
    assert [found[name][:2] for name in "rpy"] == [("attitude", axis) for axis in "xyz"]
    assert by_name("r", "y")["y"][0] == "ball position"


def test_y_beside_x_is_the_balls_place_and_no_yaw():
    found = by_name("t", "x", "y", "r", "p", "enc1", "enc2", "enc3")
    assert [found[name][:2] for name in "xy"] == [("ball position", axis) for axis in "xy"]


def test_sides_number_wheels():
    sides = ("front", "left", "right")
    names = [f"joint_states.{kind}.{side}" for kind in ("position", "velocity", "effort") for side in sides]
    found = roles_by_name(["t", *names], wheel_count=3)
    assert (found.angles, found.speeds, found.commands) == (
        tuple(names[:3]),
        tuple(names[3:6]),
        tuple(names[6:]),
    )
    assert by_name("enc_left", "enc_right")["enc_left"][2] is None


@pytest.mark.parametrize("name", ["gx_mdps", "gyro_x [mdeg/s]", "gyro_x_mdeg_s"])
def test_thousandths_of_a_degree_a_second_are_a_gyros_unit(name):
    assert by_name(name)[name] == ("gyro", "x", None, "mdeg/s")


def test_a_german_table_with_a_row_of_units_is_read_whole():
    names = ["Zeit", "Roll", "Nick", "Gier", "wx", "wy", "wz", "Weg1", "Weg2", "Weg3", "M1", "M2", "M3"]
    units = ["s", "deg", "deg", "deg", "deg/s", "deg/s", "deg/s", "deg", "deg", "deg", "Nm", "Nm", "Nm"]
    found = roles_by_name(names, wheel_count=3, units=dict(zip(names, units, strict=True)))
    assert (found.time, found.attitude) == ("Zeit", ("Roll", "Nick", "Gier"))
    assert (found.gyro, found.angles, found.commands) == (
        tuple(names[4:7]),
        tuple(names[7:10]),
        tuple(names[10:]),
    )
