"""Wrong records of an axis are stopped with their cause; friction below zero and added forces are dealt with."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot.cli.main import main
from ballbot.identification.axis import AxisRecord, inverse_fit
from ballbot.identification.axis.checks import record_findings
from ballbot.identification.axis.file_columns import AxisColumns
from ballbot.identification.axis.identify import select_forces
from ballbot.identification.axis.model import AXIS_LAWS, Axis, AxisModel
from ballbot.identification.axis.reading import read_axis_record
from ballbot.identification.axis.record import KnownLoad
from ballbot.log import Log
from tests.support.axis_examples import LOOP, SAMPLE_TIME, TRUTH, simulated_record


@cache
def closed_loop() -> AxisRecord:
    return simulated_record(duration=9.0, noise=1.0)


@cache
def open_loop() -> AxisRecord:
    return replace(closed_loop(), loop=None, reference=None)


def noise(record: AxisRecord) -> NDArray[np.float64]:
    return 50.0 * np.random.default_rng(3).standard_normal(len(record))


def looped(**changes: float) -> Callable[[AxisRecord], AxisRecord]:
    return lambda record: replace(record, loop=replace(LOOP, **changes))  # type: ignore[arg-type]


Change = Callable[[AxisRecord], AxisRecord]
WRONG_OPEN: dict[str, tuple[Change, str, str]] = {
    "force negated": (lambda r: replace(r, force=-r.force), "force-sign", "has the opposite sign"),
    "position negated": (lambda r: replace(r, position=-r.position), "force-sign", "has the opposite sign"),
    "random force": (lambda r: replace(r, force=noise(r)), "force-unrelated", "noise or from another run"),
    "time in ms": (lambda r: replace(r, sample_time=1.0), "scale", "t appears to be in milliseconds"),
}
WRONG_CLOSED: dict[str, tuple[Change, str, str]] = {
    "force negated": (
        lambda r: replace(r, force=-r.force),
        "force-sign",
        "the opposite sign of the control law",
    ),
    "force in mN": (
        lambda r: replace(r, force=1e3 * r.force),
        "axis-loop",
        "1000 times the force of the control law",
    ),
    "no force scale": (looped(force_per_input=1.0), "axis-loop", "35 times the force of the control law"),
    "position in mm": (
        lambda r: replace(r, position=1e3 * r.position),
        "axis-reference",
        "1/1000 times as far",
    ),
    "reference negated": (
        lambda r: replace(r, reference=-r.reference),
        "axis-reference",
        "negate one of them",
    ),
    "another column": (lambda r: replace(r, force=noise(r)), "axis-loop", "another column"),
    "time ten times": (lambda r: replace(r, sample_time=1e-2), "axis-loop", "the time base"),
    "position gain": (looped(position_gain=16.0), "axis-loop", "--position-gain is wrong by that factor"),
}


def error_texts(record: AxisRecord, code: str) -> list[str]:
    return [one.text for one in record_findings(record) if (one.code, one.severity) == (code, "error")]


@pytest.mark.parametrize(("change", "code", "message"), WRONG_OPEN.values(), ids=WRONG_OPEN)
def test_wrong_records_in_open_loop_are_stopped(change: Change, code: str, message: str) -> None:
    wrong = change(open_loop())
    assert any(message in text for text in error_texts(wrong, code)), record_findings(wrong)


@pytest.mark.parametrize(("change", "code", "message"), WRONG_CLOSED.values(), ids=WRONG_CLOSED)
def test_wrong_records_in_closed_loop_are_stopped(change: Change, code: str, message: str) -> None:
    wrong = change(closed_loop())
    assert any(message in text for text in error_texts(wrong, code)), record_findings(wrong)


@pytest.mark.parametrize("record", [open_loop, closed_loop], ids=["open loop", "closed loop"])
def test_correct_records_pass(record: Callable[[], AxisRecord]) -> None:
    assert record_findings(record()) == ()


def test_the_benchmark_s_record_passes(shared_data: Path) -> None:
    columns = AxisColumns(
        position="qm",
        force="vir",
        force_scale="gtau",
        reference="qg",
        position_gain="kp",
        velocity_gain="kv",
    )
    assert record_findings(read_axis_record(shared_data / "emps" / "DATA_EMPS.mat", columns)) == ()


def test_an_added_force_acts_in_closed_loop(tmp_path: Path) -> None:
    """A spring's force beside the motor's: the loop, simulated with it, gives the motor's force back."""
    t = np.arange(len(closed_loop())) * SAMPLE_TIME
    added = np.asarray(40.0 * np.sin(2.0 * np.pi * t / 2.0), dtype=np.float64)
    empty = replace(closed_loop(), added=added)
    axis = Axis(law=AXIS_LAWS["coulomb"], values=TRUTH)
    assert closed_loop().reference is not None
    start = float((closed_loop().reference[1] - closed_loop().reference[0]) / SAMPLE_TIME)
    positions, forces = axis.closed_loop(empty, speed=start)
    file = tmp_path / "record.csv"
    Log(
        {
            "t": t,
            "position": positions,
            "input": (forces - added) / LOOP.force_per_input,
            "spring": added,
            "wanted": closed_loop().reference,
        }
    ).write(file)
    columns = AxisColumns(
        force="input",
        force_scale=str(LOOP.force_per_input),
        added_force="spring",
        reference="wanted",
        position_gain=str(LOOP.position_gain),
        velocity_gain=str(LOOP.velocity_gain),
        limit=str(LOOP.limit),
    )
    record = read_axis_record(file, columns)
    assert record.loop is not None
    assert record.loop.span == 1
    assert record_findings(record) == ()
    _, again = axis.closed_loop(record, speed=start)
    # the file has its numbers in full
    np.testing.assert_allclose(again, record.force, atol=1e-6)


def test_the_command_stops_before_it_works(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.arange(len(open_loop())) * SAMPLE_TIME
    Log({"t": t, "position": open_loop().position, "force": -open_loop().force}).write(
        tmp_path / "record.csv"
    )
    out = tmp_path / "out"
    assert main(["identify-axis", str(tmp_path / "record.csv"), "--out", str(out)]) == 2
    printed = capsys.readouterr().err
    assert "the force, or the position, has the opposite sign" in printed
    assert printed.endswith("To continue despite this: --accept force-sign.\n")
    assert not out.exists()


def test_every_error_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.arange(len(open_loop())) * SAMPLE_TIME
    for name in ("one", "two"):
        file = tmp_path / f"{name}.csv"
        Log({"t": t, "position": open_loop().position, "force": -open_loop().force}).write(file)
    files = [str(tmp_path / f"{name}.csv") for name in ("one", "two")]
    assert main(["identify-axis", *files, "--out", str(tmp_path / "out")]) == 2
    printed = " ".join("".join(capsys.readouterr()).split())
    assert printed.count("the force, or the position, has the opposite sign") == 2
    assert "(1 more error: see above)" in printed


def swept_wheel(limit: float, *, duration: float = 60.0) -> AxisRecord:
    """Return a wheel under a slow sine of torque whose supply limits its speed, by Euler's steps."""
    h, inertia, b, c = 5e-3, 0.01, 0.014, 0.11
    t = np.arange(round(duration / h)) * h
    torque = np.sin(2.0 * np.pi * t / 30.0)
    angle, angles, speed = 0.0, np.empty(len(t)), 0.0
    for k, u in enumerate(torque):
        angles[k] = angle
        free = speed + h / inertia * (u - b * speed)
        stopped = np.sign(free) * max(abs(free) - h / inertia * c, 0.0)
        speed = float(np.clip(stopped, -limit, limit))
        angle += h * speed
    count = 2.0 * np.pi / 4096  # of the encoder
    return AxisRecord(
        name="sweep", sample_time=h, force=torque, position=count * np.round(angles / count), unit="rad"
    )


@cache
def limited_wheel() -> AxisRecord:
    return swept_wheel(27.0)


def test_a_speed_at_the_supply_s_limit_is_stopped() -> None:
    (found,) = record_findings(limited_wheel())
    assert (found.code, found.severity) == ("speed-limit", "error")
    assert "The speed stays at its maximum, 27 rad/s" in found.text
    # it enters the limit with b w + c = 0.49 N m, and goes on to 1
    assert "the force changes from 0.5" in found.text


def test_a_record_without_the_rows_at_the_limit_passes() -> None:
    wheel = limited_wheel()
    free = np.abs(np.gradient(wheel.position, wheel.sample_time)) < 26.0
    rest = replace(
        wheel,
        times=wheel.t[free],
        force=wheel.force[free],
        position=wheel.position[free],
    )
    assert {one.code for one in record_findings(rest)} <= {"gap"}


def test_a_wheel_below_its_limit_passes() -> None:
    assert record_findings(swept_wheel(100.0)) == ()


@pytest.mark.parametrize("gravity", [0.0, 30.0])
def test_a_constant_speed_under_a_loop_is_no_limit(gravity: float) -> None:
    """A slide or an arm that goes to and fro at one speed most of the time; gravity changes its force meanwhile."""
    t = np.arange(round(12.0 / SAMPLE_TIME)) * SAMPLE_TIME
    speed = np.clip(20.0 * np.sin(2.0 * np.pi * t / 3.0), -2.0, 2.0)
    wanted = np.cumsum(speed) * SAMPLE_TIME
    empty = replace(closed_loop(), force=np.zeros(len(t)), position=wanted, reference=wanted, unit="rad")
    values = TRUTH | ({"sin_1": gravity, "cos_1": 0.0} if gravity else {})
    position, force = Axis(law=AXIS_LAWS["coulomb"], values=values).closed_loop(empty, speed=0.0)
    noisy = force + 2.0 * np.random.default_rng(1).standard_normal(len(t))
    record = replace(empty, force=noisy, position=position, reference=None, loop=None)
    assert "speed-limit" not in {one.code for one in record_findings(record)}


@cache
def falling_pendulum(
    *,
    load: tuple[float, float] = (0.5, 0.3),
    own: tuple[float, float, float] = (0.012, 0.006, 0.02),
    rate: float = 100.0,
    duration: float = 20.0,
    noise: float = 0.0,
) -> AxisRecord:
    """Return a pendulum that swings freely under a load (kg, m), by small Euler's steps; `own` is its M, b and c."""
    h, (mass, viscous, dry), fine = 1.0 / rate, own, 20
    inertia, weight = load[0] * load[1] ** 2, load[0] * 9.81 * load[1]
    angle, speed, angles = 1.9, 0.0, []
    for _ in range(round(duration / h)):
        angles.append(angle)
        for _ in range(fine):
            pull = -weight * np.sin(angle) - viscous * speed
            free = speed + h / fine * pull / (mass + inertia)
            speed = np.sign(free) * max(abs(free) - h / fine * dry / (mass + inertia), 0.0)
            angle += h / fine * speed
    angles = np.array(angles) + noise * np.random.default_rng(4).standard_normal(len(angles))
    count = 2.0 * np.pi / 4096  # of the encoder
    return AxisRecord(
        name="pendulum",
        sample_time=h,
        force=np.zeros(len(angles)),
        position=count * np.round(angles / count),
        unit="rad",
        known_load=KnownLoad(inertia=inertia, weight=weight),
    )


def test_a_pendulum_that_only_its_load_moves_passes() -> None:
    """Gravity or a spring of its own, with a mass below zero, would cancel the load's weight."""
    pendulum = falling_pendulum()
    assert record_findings(pendulum) == ()
    model, _ = select_forces((pendulum,), AxisModel(law=AXIS_LAWS["coulomb"]))
    assert model.terms == ()
    fit = inverse_fit(pendulum, model, moving=True)
    assert fit.value("mass") == pytest.approx(0.012, rel=0.05)
    assert fit.value("coulomb") == pytest.approx(0.02, rel=0.05)
    # the load's weight acts at each row, whether the recorded force is held or not
    assert fit.value("viscous") == pytest.approx(0.006, rel=0.15)


@pytest.mark.parametrize(
    ("step", "cause"),
    [
        (2.0, "milliseconds (0.002 s): --time-scale 0.001."),
        (2e3, "microseconds (0.002 s): --time-scale 1e-06."),
        (1e9, "check the unit of t and --time-scale."),
    ],
)
def test_the_unit_of_time_that_fits_is_named(step: float, cause: str) -> None:
    (text,) = error_texts(replace(open_loop(), sample_time=step), "scale")
    assert text.endswith(cause)


def test_a_single_wild_position_is_named_by_its_row() -> None:
    position = open_loop().position.copy()
    position[1500] = 1e6
    (text,) = error_texts(replace(open_loop(), position=position), "spike")
    assert "jumps to 1e+06 m in row 1501 (1.5 s after the first one) and back" in text


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (
            ["--accept", "foo"],
            "the codes are axis-loop, axis-reference, force-sign, force-unrelated, scale, sp",
        ),
        (["--separate", "c"], "--separate coulomb: a parameter can be separate only between several records"),
    ],
)
def test_options_of_the_command_are_answered_in_its_terms(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], sentence: str
) -> None:
    t = np.arange(len(open_loop())) * SAMPLE_TIME
    Log({"t": t, "position": open_loop().position, "force": open_loop().force}).write(tmp_path / "record.csv")
    assert (
        main(["identify-axis", str(tmp_path / "record.csv"), "--out", str(tmp_path / "out"), *options]) == 2
    )
    assert sentence in " ".join(capsys.readouterr().err.split())
