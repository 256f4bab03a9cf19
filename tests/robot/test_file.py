"""Robot files: exact round trips, units, and one clear sentence for every mistake."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.errors import InputError
from ballbot.file_formats import without_format
from ballbot.robot import Robot
from ballbot.robot import robot as robot_module
from ballbot.robot.components import PARAMETERS, Correlation
from ballbot.robot.file import robot_text
from ballbot.robot.parameters import SOURCES, UNITS, from_si, to_si, value_of
from ballbot.robot.variations import draw_robots

PRESET = Path(robot_module.__file__).parent / "presets" / "alten.toml"
TEXT = PRESET.read_text(encoding="utf-8")


@pytest.mark.parametrize("preset", ["rezero", "cmu"])  # three wheels, and four
def test_what_is_written_reads_back_as_the_same_floats(preset: str, tmp_path: Path) -> None:
    robot = Robot.load(preset)
    real = [one for one in PARAMETERS if one.shape != "whole number" and one.default != ()]
    spread = {one.name: (0.03 * np.abs(value_of(robot, one))).tolist() for one in real}
    known = {name: tuple(one) if isinstance(one, list) else one for name, one in spread.items()}
    drawn_robots = draw_robots(robot.annotated(standard_deviations=known), 15, seed=4)
    matrix = np.array([[1.0, -0.123456, 0.3], [-0.123456, 1.0, 0.0], [0.3, 0.0, 1.0]])
    correlation = Correlation.of_matrix(["body.mass", "ball.radius", "wheels.azimuths[1]"], matrix)
    for k, drawn in enumerate(drawn_robots):
        sources = {one.name: f'{SOURCES[k % len(SOURCES)]}: "by" me' for one in real[::3]}
        other = drawn.replace(name=f"aZ_- é\"\\'# {k}").annotated(
            sources=sources, standard_deviations=known, correlation=correlation
        )
        other.write(tmp_path / "robot.toml")
        read = Robot.load(tmp_path / "robot.toml")
        assert read == other
        assert read.standard_deviations == known
        assert read.correlation == correlation
        assert read.correlation.matrix() == pytest.approx(matrix, abs=1e-5)  # five decimals
        assert read.sources == {one.name: sources.get(one.name, "assumed") for one in PARAMETERS}


def test_the_preset_is_written_as_any_robot_is() -> None:
    # a preset states its format, and no version that wrote it
    assert without_format(robot_text(Robot.load("alten"))) == without_format(TEXT)


#: each unit against a number of SI units that a handbook would give
HANDBOOK = [
    (11.0, "cm", "m", 0.11),
    (110.0, "mm", "m", 0.11),
    (450.0, "g", "kg", 0.45),
    (24.2, "g cm^2", "kg m^2", 2.42e-6),
    (10.0, "kg cm^2", "kg m^2", 1e-3),
    (1.0, "g m^2", "kg m^2", 1e-3),
    (180.0, "deg", "rad", math.pi),
    (60.0, "rpm", "rad/s", 2.0 * math.pi),
    (303.0, "rpm/V", "rad/s/V", 303.0 * 2.0 * math.pi / 60.0),
    (31.5, "mN m/A", "N m/A", 0.0315),
    (5.0, "ms", "s", 0.005),
    (360.0, "deg/min", "rad/s", 2.0 * math.pi / 60.0),
    (90.0, "deg/s", "rad/s", 0.5 * math.pi),
    (30.0, "mN m s/rad", "N m s/rad", 0.03),
]


@pytest.mark.parametrize(("value", "unit", "si_unit", "expected"), HANDBOOK)
def test_units_convert(value: float, unit: str, si_unit: str, expected: float) -> None:
    # a few roundings of one part in 2^53 each
    assert to_si(value, unit, si_unit) == pytest.approx(expected, rel=1e-15)


@given(value=st.floats(allow_nan=False, allow_infinity=False), si_unit=st.sampled_from(sorted(UNITS)))
def test_from_si_round_trips_exactly_or_raises(value: float, si_unit: str) -> None:
    for unit in UNITS[si_unit]:
        written = from_si(value, unit, si_unit)
        assert written is None or to_si(written, unit, si_unit) == value
    assert from_si(value, si_unit, si_unit) == value


def read(text: str, folder: Path) -> Robot:
    path = folder / "bad.toml"
    path.write_text(text, encoding="utf-8")
    return Robot.load(path)


def test_values_in_other_units_are_converted(tmp_path: Path) -> None:
    changed = TEXT.replace('value = 0.393, unit = "m"', 'value = 39.3, unit = "cm"')
    assert read(changed, tmp_path) == Robot.load("alten")


RADIUS = 'radius = { value = 0.11, unit = "m", source = "measured: thesis, Appendix III, tape measure" }'

#: what is changed in the preset's text, into what, and what the sentence must say
MISTAKES = [
    (RADIUS, "radius = 0.11", r"ball\.radius is 0\.11, without a unit and a source; write radius = \{"),
    (RADIUS, "", r"ball\.radius is missing; add radius = \{ value .* under \[ball\]"),
    (RADIUS, RADIUS.replace("radius =", "raduis ="), r"'ball\.raduis' is not a .*did you mean 'radius'"),
    ("[ball]", "[bal]", r"'bal' is not a parameter of a robot; did you mean 'ball'"),
    (RADIUS, RADIUS.replace("}", ', note = "x" }'), r"note is not a key of a parameter; the keys there are"),
    (RADIUS, RADIUS.replace("0.11", '"0.11"'), r"ball\.radius: value is '0\.11'; it must be a number"),
    (RADIUS, RADIUS.replace("0.11", "[0.11]"), r"has the value \[0\.11\]; it must be one number"),
    (RADIUS, RADIUS.replace("0.11", "9" * 400), r"ball\.radius\.value is a whole number too large"),
    (RADIUS, RADIUS.replace('"m"', '"inch"'), r"ball\.radius: the unit 'inch' .* \"m\", \"cm\" or \"mm\""),
    (RADIUS, RADIUS.replace('unit = "m", ', ""), r'ball\.radius has no unit; write unit = "m"'),
    (RADIUS, RADIUS.replace("measured:", "mesured:"), r"source .* did you mean 'measured'"),
    ("rows = { value = 2,", "rows = { value = 2.5,", r"rows has the value 2\.5; it must be one whole number"),
    ('about = "ball_center"', 'about = "ball"', r"body\.inertia\.about is 'ball'; write \"ball_center\""),
    ('about = "ball_center"', "", r"body\.inertia\.about is missing"),
    ('name = "alten"', "name = 3", r"name is 3; it must be a text in quotes"),
    ('name = "alten"', "", r"name is missing; add name = "),
    ('name = "alten"', "name = ", r"is not valid TOML: .*line 9"),
    ("[sensors]", "sensors = 3\n[sensor]", r".*"),
]


@pytest.mark.parametrize(("old", "new", "says"), MISTAKES)
def test_each_mistake_raises_one_sentence_naming_the_file(old, new, says, tmp_path):
    assert old in TEXT
    with pytest.raises(InputError, match=says) as caught:
        read(TEXT.replace(old, new, 1), tmp_path)
    assert str(caught.value).startswith(str(tmp_path / "bad.toml"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "name is missing"),
        (b"ball = 3", r"ball must be a table: write its keys under a line \[ball\]"),
        (b"zzz = 3", "the top level has ball, body"),
        (b"[ball]\nqqq = 3", r"\[ball\] has radius, mass, inertia"),
    ],
)
def test_file_of_another_kind_is_refused_as_no_robot_file(content: bytes, says: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=says):
        Robot.load(path)
