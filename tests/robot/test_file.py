"""Robot files: exact round trips, units, and one clear sentence for every mistake."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot.errors import InputError
from ballbot.file_formats import without_format
from ballbot.robot import Ball, Body, Drive, Friction, Robot, Rollers, Sensors, Wheels
from ballbot.robot import file as file_module
from ballbot.robot import robot as robot_module
from ballbot.robot.components import PARAMETERS
from ballbot.robot.file import robot_text, write_robot
from ballbot.robot.parameters import SOURCES, UNITS, Parameter, from_si, to_si

PRESET = Path(robot_module.__file__).parent / "presets" / "alten.toml"
TEXT = PRESET.read_text(encoding="utf-8")


def size(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False)


@st.composite
def bodies(draw: st.DrawFn) -> Body:
    # positive sums of squares a, b, c make principal moments b+c, a+c, a+b, which any body could have
    a, b, c = (draw(size(0.01, 2.0)) for _ in range(3))
    turn, _ = np.linalg.qr(
        np.array([[draw(size(-1.0, 1.0)) for _ in range(3)] for _ in range(3)]) + 3.0 * np.eye(3)
    )
    central = turn @ np.diag([b + c, a + c, a + b]) @ turn.T
    mass, height = draw(size(0.5, 60.0)), draw(size(0.05, 1.0))
    about_ball = draw(st.booleans())
    j = central + (mass * height**2 * np.diag([1.0, 1.0, 0.0]) if about_ball else 0.0)
    return Body(
        mass=mass,
        center_of_mass=height,
        inertia=tuple(float(j[i, k]) for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))),  # type: ignore[arg-type]
        inertia_about="ball_center" if about_ball else "center_of_mass",
    )


@st.composite
def drives(draw: st.DrawFn) -> Drive:
    torque_constant = draw(size(1e-3, 1.0))
    return Drive(
        gear_ratio=draw(size(1.0, 200.0)),
        motor_inertia=draw(size(0.0, 1e-3)),
        gear_inertia=draw(size(0.0, 1e-3)),
        torque_constant=torque_constant,
        speed_constant=draw(size(0.5, 2.0)) / torque_constant,
        supply_voltage=draw(size(3.0, 80.0)),
        torque_limit=draw(size(0.1, 50.0)),
        backlash=draw(size(0.0, 0.1)),
    )


@st.composite
def robots(draw: st.DrawFn) -> Robot:
    count = draw(st.sampled_from([3, 4]))
    first = draw(size(-math.pi, math.pi))
    # within a third of a step of an even spread: never two wheels in one place
    azimuths = tuple((first + (i + draw(size(-0.3, 0.3))) * 2 * math.pi / count) % 6.28 for i in range(count))
    radius, mass = draw(size(0.02, 0.4)), draw(size(0.05, 20.0))
    wheel = draw(size(0.01, 0.2))
    each = st.tuples(*[size(0.0, 5.0)] * count)
    return Robot(
        name=draw(st.text("aZ09_- é\"\\'#", min_size=1)),
        ball=Ball(radius=radius, mass=mass, inertia=draw(size(0.4, 0.66)) * mass * radius**2),
        body=draw(bodies()),
        wheels=Wheels(
            radius=wheel,
            inertia=draw(size(0.0, 0.1)),
            tilt=draw(size(0.3, 1.3)),
            azimuths=azimuths,
            rollers=Rollers(
                rows=draw(st.integers(1, 3)),
                per_row=draw(st.integers(3, 20)),
                radius=0.3 * wheel,
                row_spacing=draw(size(0.0, 0.1)),
            ),
        ),
        drive=draw(drives()),
        sensors=Sensors(
            sample_time=draw(size(1e-4, 0.1)),
            encoder_counts=draw(st.integers(1, 10**6)),
            gyro_noise=draw(size(0.0, 0.5)),
            attitude_noise=draw(size(0.0, 0.1)),
            heading_drift=draw(size(-0.1, 0.1)),
        ),
        friction=Friction(
            viscous=draw(each),
            coulomb=draw(each),
            stribeck=draw(each),
            stribeck_speed=draw(size(1e-3, 10.0)),
            stribeck_exponent=draw(size(0.1, 5.0)),
            rolling=draw(size(0.0, 0.1)),
        ),
        gravity=draw(size(1.6, 25.0)),
        sources={
            one.name: f'{draw(st.sampled_from(SOURCES))}: "by" me'
            for one in PARAMETERS[::3]
            if one.default != ()
        },
    )


@settings(max_examples=30, deadline=None)
@given(robot=robots())
def test_what_is_written_reads_back_as_the_same_floats(
    robot: Robot, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("robots") / "robot.toml"
    robot.write(path)
    read = Robot.load(path)
    assert read == robot
    assert read.sources == {one.name: robot.sources.get(one.name, "assumed") for one in PARAMETERS}


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


@pytest.mark.parametrize("one", PARAMETERS, ids=lambda one: one.name)
def test_the_units_of_every_parameter_are_known(one: Parameter) -> None:
    assert one.unit in UNITS, f"{one.name}: add the unit {one.unit!r} to UNITS in robot/parameters.py"
    assert one.written_in in UNITS[one.unit], f"{one.name}: add {one.written_in!r} to UNITS[{one.unit!r}]"


def test_a_value_that_may_be_left_out_is_written_if_its_source_is_stated(monkeypatch, tmp_path: Path) -> None:
    optional = [
        replace(one, default=0.0, written="if changed") if one.name == "friction.rolling" else one
        for one in PARAMETERS
    ]
    monkeypatch.setattr(file_module, "PARAMETERS", optional)
    monkeypatch.setattr(file_module, "parameters_of_robot", lambda _: optional)
    robot = Robot.load("alten")
    assert "\nrolling = " not in robot_text(robot.annotated(sources={}))
    measured = robot.annotated(sources={"friction.rolling": "measured: none"})
    write_robot(measured, tmp_path / "robot.toml")
    assert Robot.load(tmp_path / "robot.toml").sources["friction.rolling"] == "measured: none"


def test_file_that_omits_a_parameter_gets_its_default(tmp_path: Path) -> None:
    gravity = 'gravity = { value = 9.81, unit = "m/s^2", source = "assumed" }'
    assert gravity in TEXT
    without = read(TEXT.replace(gravity, ""), tmp_path)
    assert without == Robot.load("alten")
    assert without.sources == Robot.load("alten").sources


def read(text: str, folder: Path) -> Robot:
    path = folder / "bad.toml"
    path.write_text(text, encoding="utf-8")
    return Robot.load(path)


def test_values_in_other_units_are_converted(tmp_path: Path) -> None:
    changed = TEXT.replace('value = 0.393, unit = "m"', 'value = 39.3, unit = "cm"')
    assert read(changed, tmp_path) == Robot.load("alten")


RADIUS = 'radius = { value = 0.11, unit = "m", source = "measured: thesis, Appendix III, tape measure" }'
COULOMB = 'coulomb = { value = [0.0, 0.0, 0.0], unit = "N m"'

#: what is changed in the preset's text, into what, and what the sentence must say
MISTAKES = [
    (RADIUS, "radius = 0.11", r"ball\.radius is 0\.11, without a unit and a source; write radius = \{"),
    (RADIUS, "", r"ball\.radius is missing; add radius = \{ value .* under \[ball\]"),
    (
        RADIUS,
        RADIUS.replace("radius =", "raduis ="),
        r"'ball\.raduis' is not a parameter.*did you mean 'radius'",
    ),
    ("[ball]", "[bal]", r"'bal' is not a parameter of a robot; did you mean 'ball'"),
    (
        RADIUS,
        RADIUS.replace("}", ', note = "x" }'),
        r"note is not a key of a parameter; the keys there are",
    ),
    (
        RADIUS,
        RADIUS.replace("0.11", '"0.11"'),
        r"ball\.radius: value is '0\.11'; it must be a number or a list",
    ),
    (RADIUS, RADIUS.replace("0.11", "[0.11]"), r"has the value \[0\.11\]; it must be one number"),
    (RADIUS, RADIUS.replace("0.11", "nan"), r"ball\.radius is nan m; it must be finite"),
    (RADIUS, RADIUS.replace("0.11", "9" * 400), r"ball\.radius\.value is a whole number too large"),
    (
        RADIUS,
        RADIUS.replace('"m"', '"inch"'),
        r"ball\.radius: the unit 'inch' .* write \"m\", \"cm\" or \"mm\"",
    ),
    (RADIUS, RADIUS.replace('unit = "m", ', ""), r'ball\.radius has no unit; write unit = "m"'),
    (RADIUS, RADIUS.replace("measured:", "mesured:"), r"source .* did you mean 'measured'"),
    (RADIUS, RADIUS.replace("0.11", "11"), r"is 11 m, .* did you mean 11 cm \(0\.11 m\)\?"),
    ("rows = { value = 2,", "rows = { value = 2.5,", r"rows has the value 2\.5; it must be one whole number"),
    (COULOMB, COULOMB.replace("0.0, ", "", 1), r"friction\.coulomb has 2 numbers, but .* lists 3 wheels"),
    ('about = "ball_center"', 'about = "ball"', r"body\.inertia\.about is 'ball'; write \"ball_center\""),
    ('about = "ball_center"', "", r"body\.inertia\.about is missing"),
    ('name = "alten"', "name = 3", r"name is 3; it must be a text in quotes"),
    ('name = "alten"', "", r"name is missing; add name = "),
    ('name = "alten"', "name = ", r"is not valid TOML: .*line 9"),
    ("[sensors]", "sensors = 3\n[sensor]", r".*"),
]


@pytest.mark.parametrize(("old", "new", "says"), MISTAKES)
def test_each_mistake_raises_one_sentence_naming_the_file(
    old: str, new: str, says: str, tmp_path: Path
) -> None:
    assert old in TEXT
    with pytest.raises(InputError, match=says) as caught:
        read(TEXT.replace(old, new, 1), tmp_path)
    assert str(caught.value).startswith(str(tmp_path / "bad.toml"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"\xff\xfe\x00", "not a text file in UTF-8"),
        (b"", "name is missing"),
        (b"a = " + b"[" * 100_000, "nested too deeply|not valid TOML"),
        (b"a = " + b"9" * 10_000, "not valid TOML"),
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


LINES = TEXT.splitlines()
GARBAGE = st.one_of(
    st.sampled_from(["", "[ball]", "[[ball]]", "gravity = 1", "x.y.z = 1", "= 3", '"" = 1', "radius = {}"]),
    st.builds(
        lambda key, value, unit: f'{key} = {{ value = {value}, unit = "{unit}", source = "measured" }}',
        st.sampled_from(sorted({one.key for one in PARAMETERS})),
        st.sampled_from(
            ["-1", "0", "1e308", "-inf", "nan", "[]", "[1, 2, 3, 4]", "1979-05-27", "{}", '"a"', "9"]
        ),
        st.sampled_from(["m", "kg", "deg", "1", "", "rpm/V", "kg m^2"]),
    ),
    st.text(max_size=20),
)


@settings(max_examples=150, deadline=None)
@given(place=st.integers(0, len(LINES) - 1), line=GARBAGE)
def test_any_changed_line_gives_a_robot_or_one_sentence(
    place: int, line: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    changed = "\n".join([*LINES[:place], line, *LINES[place + 1 :]])
    path = tmp_path_factory.mktemp("fuzz") / "robot.toml"
    path.write_bytes(changed.encode("utf-8", errors="surrogatepass"))
    try:
        assert isinstance(Robot.load(path), Robot)
    except InputError as error:
        assert str(error).startswith(str(path))  # noqa: PT017 (either outcome is right)
