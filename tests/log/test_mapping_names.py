"""`read_name`: any text has a reading, and a known name has one reading however it is written."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.log.columns import UNITS
from ballbot.log.mapping_search.names import read_name, read_names, roles_by_name

#: words, and what they say: kind, axis, number
KNOWN = {
    ("time",): ("time", None, None),
    ("roll",): ("attitude", "x", None),
    ("imu", "pitch"): ("attitude", "y", None),
    ("yaw",): ("attitude", "z", None),
    ("gyro", "x"): ("gyro", "x", None),
    ("enc", "1"): ("wheel angle", None, 1),
    ("wheel", "2", "speed"): ("wheel speed", None, 2),
    ("motor", "1", "current"): ("command", None, 1),
    ("motor", "3", "pwm"): ("command", None, 3),
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


@pytest.mark.parametrize("mark", ["ref", "target", "setpoint", "des", "goal"])
@given(st.sampled_from(["roll", "pitch", "enc1", "wheel2_speed", "x", "gyro_x", "psi"]), st.booleans())
def test_a_set_point_is_never_a_measurement(mark, name, before):
    assert read_name(f"{mark}_{name}" if before else f"{name}_{mark}").kind == "other"


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
    said = "wheel angle" if "enc" in form else "command", "mA" if "mA" in form else None
    assert {(one.kind, one.unit) for one in found} == {said}


def test_a_letter_alone_or_beside_a_number_stays_what_it_is():
    (alone,) = read_names(["current_A"], {})
    assert (alone.kind, alone.index) == ("other", None)
    channels = read_names([f"M{motor}_{channel}" for motor in (1, 2, 3) for channel in "ABC"], {})
    assert channels == [read_name(one.name) for one in channels]


#: what names of known logs and motor controllers say, in English and German: kind, axis, number and unit
NAMES = {
    "Timestamp_us": ("time", None, None, "us"),
    "Time (s)": ("time", None, None, "s"),
    "GyroX_dps": ("gyro", "x", None, "deg/s"),
    "Motor1_current_A": ("command", None, 1, "A"),
    "wheel3_rpm": ("wheel speed", None, 3, "rpm"),
    "theta_x": ("attitude", "x", None, None),
    "psi_1": ("wheel angle", None, 1, None),
    "Tx": ("other", None, None, None),
    "PWM[2]": ("command", None, 2, None),
    "ms": ("time", None, None, "ms"),
    "p_roll": ("other", None, None, None),
    "theta_w1_dot": ("wheel speed", None, 1, None),
    "motor_cmd_1": ("command", None, 1, None),
    "torque_Nm_1": ("command", None, 1, "N m"),
    "current.A.3": ("command", None, 3, "A"),
    "gyro_dps_x": ("gyro", "x", None, "deg/s"),
    "gx_mdps": ("gyro", "x", None, "mdeg/s"),
    "pitch_rate (rad/s)": ("gyro", "y", None, "rad/s"),
    "Zeit [ms]": ("time", None, None, "ms"),
    "Rollwinkel_Grad": ("attitude", "x", None, "deg"),
    "Drehzahl2_rpm": ("wheel speed", None, 2, "rpm"),
    "Strom M1 [A]": ("command", None, 1, "A"),
    "Couple_Nm": ("other", None, None, None),
    "w1_rps": ("wheel speed", None, 1, "rps"),
    "/joint2/position": ("wheel angle", None, 2, None),
    "/imu/gyro_x_rad/s": ("gyro", "x", None, "rad/s"),
    "Stellgr\u00f6\u00dfe_2": ("command", None, 2, None),
    "Inkremente_Rad1": ("wheel angle", None, 1, None),
    "vesc1_duty_cycle": ("command", None, 1, None),
    "cycle_time": ("other", None, None, None),
}


@pytest.mark.parametrize("name", NAMES)
def test_what_a_name_says(name):
    found = read_name(name)
    said = (found.kind, found.axis, found.index, found.unit)
    assert said == NAMES[name] or found.kind == NAMES[name][0] == "other"


@pytest.mark.parametrize("form", ["enc_{}", "enc{}", "{}_enc_counts"])
def test_corners_that_number_a_series_are_its_numbers_in_the_order_of_the_file(form):
    names = [form.format(corner) for corner in ("FL", "RL", "RR", "FR")]
    found = read_names(["t", *names], {})[1:]
    assert [(one.name, one.kind) for one in found] == [(name, "wheel angle") for name in names]
    assert [one.index for one in found] == [1, 2, 3, 4]
    assert [one.index for one in read_names(names[:2], {})] == [None, None]


def test_sides_number_wheels():
    sides = ("front", "left", "right")
    names = [f"joint_states.{kind}.{side}" for kind in ("position", "velocity", "effort") for side in sides]
    found = roles_by_name(["t", *names], wheel_count=3, units={})
    assert (found.angles, found.commands) == (tuple(names[:3]), tuple(names[6:]))
