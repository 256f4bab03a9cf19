"""`read_name`: any text has a reading, and a known name has one reading however it is written."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.log.mapping_search.names import UNITS, read_name, read_names
from ballbot.log.mapping_search.roles import roles_by_name

#: words, and what they say: kind, axis, number
KNOWN = {
    ("time",): ("time", None, None),
    ("timestamp",): ("time", None, None),
    ("roll",): ("attitude", "x", None),
    ("imu", "pitch"): ("attitude", "y", None),
    ("yaw",): ("attitude", "z", None),
    ("gyro", "x"): ("gyro", "x", None),
    ("gyro", "z"): ("gyro", "z", None),
    ("enc", "1"): ("wheel angle", None, 1),
    ("encoder", "3"): ("wheel angle", None, 3),
    ("wheel", "2", "speed"): ("wheel speed", None, 2),
    ("motor", "1", "current"): ("command", None, 1),
    ("torque", "2"): ("command", None, 2),
    ("motor", "3", "pwm"): ("command", None, 3),
    ("voltage", "1"): ("command", None, 1),
    ("loop", "count"): ("other", None, None),
    ("battery",): ("other", None, None),
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
    assert (found.kind, found.axis, found.index) == KNOWN[words]


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
        ("Tx", "other", None),
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
    assert read_name(f"{mark}_{name}" if before else f"{name}_{mark}").kind == "other"


def test_commands_to_the_body_are_no_motor_commands():
    assert read_name("cmd_vel").kind == "other"
    assert read_name("cmd_vel_x").kind == "other"
    assert read_name("theta_d_x").kind == "other"
    assert read_name("motor_cmd_1").kind == "command"


def test_every_unit_has_a_spelling_of_its_own():
    spellings = [spelling for words in UNITS.values() for spelling in words.split()]
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
    found = read_names(["t", *names], {})[1:]
    assert [one.name for one in found] == names
    assert [one.index for one in found] == list(range(1, len(letters) + 1))
    assert {(one.kind, one.unit) for one in found} == {
        ("wheel angle" if "enc" in form else "command", "mA" if "mA" in form else None)
    }


def test_a_letter_alone_or_beside_a_number_stays_what_it_is():
    (alone,) = read_names(["current_A"], {})
    assert (alone.kind, alone.index) == ("other", None)
    channels = read_names([f"M{motor}_{channel}" for motor in (1, 2, 3) for channel in "ABC"], {})
    assert channels == [read_name(one.name) for one in channels]


@pytest.mark.parametrize(
    ("name", "reading"),
    [
        ("torque_Nm_1", ("command", None, 1, "N m")),
        ("torque_N_m_2", ("command", None, 2, "N m")),
        ("current.A.3", ("command", None, 3, "A")),
        ("enc_ticks_1", ("wheel angle", None, 1, "counts")),
        ("gyro_dps_x", ("gyro", "x", None, "deg/s")),
        ("Zeit [ms]", ("time", None, None, "ms")),
        ("Rollwinkel_Grad", ("attitude", "x", None, "deg")),
        ("Drehrate_x", ("gyro", "x", None, None)),
        ("Rad1_rad", ("wheel angle", None, 1, "rad")),
        ("Drehzahl2_rpm", ("wheel speed", None, 2, "rpm")),
        ("Moment1_Nm", ("command", None, 1, "N m")),
        ("Strom M1 [A]", ("command", None, 1, "A")),
        ("Strom_Soll_1", ("command", None, 1, None)),
        ("Couple_Nm", ("other", None, None, None)),
        # revolutions or radians a second
        ("rpm1", ("wheel speed", None, 1, "rpm")),
        ("w1_rps", ("wheel speed", None, 1, "rps")),
        ("gyro_x_rps", ("gyro", "x", None, None)),
    ],
)
def test_units_within_a_name_german_words_and_units_that_say_the_kind(name, reading):
    found = read_name(name)
    assert (found.kind, found.axis, found.index, found.unit) == reading


def test_a_german_set_point_is_never_a_measurement():
    assert read_name("Rollwinkel_Soll").kind == "other"


@pytest.mark.parametrize("form", ["enc_{}", "enc{}", "{}_enc_counts"])
def test_corners_that_number_a_series_are_its_numbers_in_the_order_of_the_file(form):
    names = [form.format(corner) for corner in ("FL", "RL", "RR", "FR")]
    found = read_names(["t", *names], {})[1:]
    assert [(one.name, one.kind, one.index) for one in found] == [
        (name, "wheel angle", place) for place, name in enumerate(names, start=1)
    ]
    assert [one.index for one in read_names(names[:2], {})] == [None, None]


@pytest.mark.parametrize(
    ("name", "reading"),
    [
        ("/joint2/position", ("wheel angle", None, 2, None)),
        ("/joint1/cmd", ("command", None, 1, None)),
        ("/imu/gyro_x_rad/s", ("gyro", "x", None, "rad/s")),
        ("Stellgr\u00f6\u00dfe_2", ("command", None, 2, None)),
        ("Stellgroesse_M3", ("command", None, 3, None)),
        ("Inkremente_Rad1", ("wheel angle", None, 1, None)),
        ("vesc1_tachometer", ("wheel angle", None, 1, None)),
        ("vesc1_duty_cycle", ("command", None, 1, None)),
        ("cycle_time", ("other", None, None, None)),
    ],
)
def test_paths_and_words_of_motor_controllers(name, reading):
    found = read_name(name)
    assert (found.kind, found.axis, found.index, found.unit) == reading


def test_an_effort_is_in_newton_metres():
    joints = [f"/{k}/{word}" for k in (1, 2, 3) for word in ("position", "velocity", "effort")]
    roles = roles_by_name(["t", *joints], wheel_count=3, units={})
    assert (roles.commands[0], roles.unit(roles.commands)) == ("/1/effort", "N m")


def by_name(*names: str, units: dict[str, str] | None = None) -> dict[str, tuple]:
    found = read_names(names, units or {})
    return {one.name: (one.kind, one.axis, one.index, one.unit) for one in found}


def test_sides_number_wheels():
    sides = ("front", "left", "right")
    names = [f"joint_states.{kind}.{side}" for kind in ("position", "velocity", "effort") for side in sides]
    found = roles_by_name(["t", *names], wheel_count=3, units={})
    assert (found.angles, found.commands) == (tuple(names[:3]), tuple(names[6:]))
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
