"""Wrong records of an axis are stopped with their cause; friction below zero and added forces are dealt with."""

import re
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
from ballbot.identification.axis.inverse import free_inverse_fit
from ballbot.identification.axis.law_fits import initial_values
from ballbot.identification.axis.laws import AXIS_LAWS
from ballbot.identification.axis.model import Axis
from ballbot.identification.axis.motion import default_bandwidth
from ballbot.identification.axis.output_error import OutputErrorFit, sighting
from ballbot.identification.axis.prediction import AxisErrors, axis_errors, failure_findings
from ballbot.identification.axis.reading import read_axis_record
from ballbot.identification.axis.record import KnownLoad
from ballbot.identification.axis.residuals import residual_tests
from ballbot.identification.axis.structure import AxisModel
from ballbot.identification.axis.terms import select_terms
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


def test_friction_below_zero_is_held_at_zero() -> None:
    """An axis that a force along its speed pushes a little has less than no viscous friction."""
    fit = free_inverse_fit(closed_loop())
    speed = np.gradient(closed_loop().position, SAMPLE_TIME)
    force = np.asarray(closed_loop().force - 1.2 * fit.value("viscous") * speed, dtype=np.float64)
    pushed = replace(open_loop(), force=force)
    assert free_inverse_fit(pushed).value("viscous") < 0.0
    held = inverse_fit(pushed)
    assert held.value("viscous") == 0.0
    assert np.isnan(held.clustered_errors[held.names.index("viscous")])
    assert held.value("coulomb") > 0.0
    found = [one for one in record_findings(pushed) if one.code == "force-friction"]
    assert [one.severity for one in found] == ["warning"]
    # a law takes the values, which it refused below zero
    Axis(law=AXIS_LAWS["coulomb"], values=dict(zip(held.names, held.values.tolist(), strict=True))).open_loop(
        pushed.force[:100], position=0.0, speed=0.0, sample_time=SAMPLE_TIME
    )


def test_an_added_force_acts_in_closed_loop(tmp_path: Path) -> None:
    """A spring's force beside the motor's: the loop, simulated with it, gives the motor's force back."""
    t = np.arange(len(closed_loop())) * SAMPLE_TIME
    added = np.asarray(40.0 * np.sin(2.0 * np.pi * t / 2.0), dtype=np.float64)
    empty = replace(closed_loop(), added=added)
    axis = Axis(law=AXIS_LAWS["coulomb"], values=TRUTH)
    assert closed_loop().reference is not None
    start = float((closed_loop().reference[1] - closed_loop().reference[0]) / SAMPLE_TIME)
    moved = axis.closed_loop(empty, speed=start)
    file = tmp_path / "record.csv"
    Log(
        {
            "t": t,
            "position": moved.positions,
            "input": (moved.forces - added) / LOOP.force_per_input,
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
    again = axis.closed_loop(record, speed=start)
    # the file has its numbers in full
    np.testing.assert_allclose(again.forces, record.force, atol=1e-6)


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
    moved = Axis(law=AXIS_LAWS["coulomb"], values=values).closed_loop(empty, speed=0.0)
    noisy = moved.forces + 2.0 * np.random.default_rng(1).standard_normal(len(t))
    record = replace(empty, force=noisy, position=moved.positions, reference=None, loop=None)
    assert "speed-limit" not in {one.code for one in record_findings(record)}


def test_a_record_that_is_not_predicted_at_all_gives_a_warning() -> None:
    record = open_loop()
    good = AxisErrors(
        record=record.name,
        window_rmse=1e-4,
        open_loop_rmse=1e-3,
        inverse_force=0.1,
        closed_loop_force=None,
        closed_loop_position=None,
    )
    assert failure_findings([record], [good]) == []
    (found,) = failure_findings([record], [replace(good, inverse_force=12.2)])
    assert (found.code, found.severity) == ("not-predicted", "warning")
    assert "differs by 1220 % from the recorded force" in found.text
    for diverged in (np.inf, np.nan, 1e3):
        (found,) = failure_findings([record], [replace(good, open_loop_rmse=diverged)])
        assert "the simulation of the whole record diverges" in found.text


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
    model, _ = select_terms((pendulum,), AxisModel(law=AXIS_LAWS["coulomb"]))
    assert model.terms == ()
    fit = inverse_fit(pendulum, model=model)
    assert fit.value("mass") == pytest.approx(0.012, rel=0.05)
    assert fit.value("coulomb") == pytest.approx(0.02, rel=0.05)
    # the load's weight acts at each row, whether the recorded force is held or not
    assert fit.value("viscous") == pytest.approx(0.006, rel=0.15)


def test_the_angle_at_which_a_load_hangs_is_estimated() -> None:
    swinging = falling_pendulum()
    turned = replace(swinging, position=swinging.position + 0.4)
    (found,) = record_findings(turned)
    assert (found.code, found.severity) == ("axis-load", "warning")
    assert re.search(r"swings about an angle of about 0\.\d+ rad, .* --hanging", found.text)
    known = replace(turned, known_load=replace(turned.known_load, hanging=0.4))
    assert record_findings(known) == ()


def test_noise_under_a_heavy_load_is_no_wrong_force() -> None:
    """What an inertia sixty times its own requires is subtracted from the force, noise of the acceleration and all."""
    heavy = falling_pendulum(load=(1.5, 0.4), own=(0.004, 0.02, 0.03), rate=200.0, duration=15.0, noise=3e-4)
    assert record_findings(heavy) == ()
    fit = inverse_fit(heavy, moving=True)
    assert fit.value("mass") == pytest.approx(0.004, rel=0.1)
    assert fit.value("coulomb") == pytest.approx(0.03, rel=0.1)
    tests = residual_tests([heavy], AxisModel(law=AXIS_LAWS["coulomb"]))
    assert not [one.quantity for one in tests if one.dependent]


def test_a_pendulum_without_dry_friction_has_laws_to_start_from() -> None:
    free = falling_pendulum(own=(0.012, 0.004, 0.0), duration=10.0, noise=3e-4)
    starts = initial_values(
        [sighting(free, default_bandwidth(free))], AxisModel(law=AXIS_LAWS["coulomb"]), bandwidth=None
    )
    for name, values in starts.items():
        position = Axis(law=AXIS_LAWS[name], values=values).open_loop(
            free.force[:10], position=0.0, speed=0.0, sample_time=free.sample_time
        )
        assert np.all(np.isfinite(position)), name


def test_noise_of_the_position_is_no_failure() -> None:
    """Differentiated twice, 0.2 mm of noise exceed the force as far as the filter passes them."""
    noise_of_row = 2e-4 * np.random.default_rng(1).standard_normal(len(open_loop()))
    noisy = replace(open_loop(), position=open_loop().position + noise_of_row)
    model = AxisModel(law=AXIS_LAWS["coulomb"])
    fit = OutputErrorFit(model=model, values=TRUTH, standard_errors=TRUTH, rms=0.0)
    errors = axis_errors(fit, noisy, 0, bandwidth=default_bandwidth(noisy), horizon=0.2)
    assert errors.inverse_force < 0.25
    assert failure_findings([noisy], [errors]) == []


def test_the_error_relative_to_a_force_of_zero_is_no_finding() -> None:
    pendulum = falling_pendulum()
    errors = AxisErrors(
        record=pendulum.name,
        window_rmse=1e-4,
        open_loop_rmse=1e-3,
        inverse_force=np.nan,
        closed_loop_force=None,
        closed_loop_position=None,
    )
    assert failure_findings([pendulum], [errors]) == []


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
