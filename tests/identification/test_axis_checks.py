"""Wrong records of an axis are stopped with their cause; right ones pass."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.axis import AxisOptions, AxisRecord, identify_axis
from ballbot.identification.axis.checks import record_findings
from ballbot.identification.axis.record import AxisColumns, read_axis_record
from ballbot.identification.driveline import friction_of
from ballbot.simulation.driveline import Driveline, TorqueSpeedCurve, simulate_driveline
from tests.support.axis_examples import simulated_record
from tests.support.faulty_samples import friction_record


def open_loop() -> AxisRecord:
    return simulated_record(noise=1.0)


def noise(record: AxisRecord) -> NDArray[np.float64]:
    return 50.0 * np.random.default_rng(3).standard_normal(len(record))


Change = Callable[[AxisRecord], AxisRecord]
WRONG_OPEN: dict[str, tuple[Change, set[str]]] = {
    "force negated": (lambda r: replace(r, force=-r.force), {"force-sign"}),
    "magnitude of the force": (
        lambda r: replace(r, force=np.abs(r.force)),
        {"force-sign", "force-unrelated"},
    ),
    "random force": (lambda r: replace(r, force=noise(r)), {"force-unrelated"}),
    "time in ms": (lambda r: replace(r, sample_time=1.0), {"scale"}),
}


def error_texts(record: AxisRecord, code: str) -> list[str]:
    return [one.text for one in record_findings(record) if (one.code, one.severity) == (code, "error")]


@pytest.mark.parametrize(("change", "codes"), WRONG_OPEN.values(), ids=WRONG_OPEN)
def test_wrong_records_in_open_loop_are_stopped(change: Change, codes: set[str]) -> None:
    found = record_findings(change(open_loop()))
    assert {one.code for one in found if one.severity == "error"} & codes, found


@pytest.mark.parametrize("law", ["viscous", "coulomb", "stribeck"])
@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_the_friction_alone_determines_no_mass(law: str, seed: int) -> None:
    assert error_texts(friction_record(law, seed, noise=0.35)[0], "excitation")
    assert record_findings(friction_record(law, seed, noise=0.05, sound=True)[0]) == ()


def test_correct_records_pass() -> None:
    assert record_findings(open_loop()) == ()
    # as a wheel it turns by so little that gravity is a constant torque
    small = replace(open_loop(), position=0.01 * open_loop().position, unit="rad")
    assert record_findings(small) == ()


def test_the_benchmark_s_record_passes(shared_data: Path) -> None:
    columns = AxisColumns(position="qm", force="vir", force_scale="gtau")
    assert record_findings(read_axis_record(shared_data / "emps" / "DATA_EMPS.mat", columns)) == ()


def test_a_position_that_is_stuck_while_the_axis_moves_is_an_error() -> None:
    position = open_loop().position.copy()
    position[2000:2800] = position[2000]
    (text,) = error_texts(replace(open_loop(), position=position), "stuck")
    assert "without change for 0.8 s (from row 2001" in text


@cache
def limited_wheel() -> AxisRecord:
    """Return a wheel under a slow sine of torque whose supply limits its speed."""
    h, curve = 5e-3, TorqueSpeedCurve(no_load_speed=27.0, stall_torque=1e4)
    torque = np.sin(2.0 * np.pi * np.arange(12_000) * h / 30.0)
    friction = friction_of(np.array([0.014, 0.11, 0.0, 1.0, 1.0]))
    line = Driveline(inertia=0.01, friction=friction, speed_limit=curve)
    angles = np.append(0.0, simulate_driveline(line, torque[:-1], sample_time=h).angles)
    count = 2.0 * np.pi / 4096  # of the encoder
    return AxisRecord(
        name="sweep", sample_time=h, force=torque, position=count * np.round(angles / count), unit="rad"
    )


def test_a_speed_at_the_supply_s_limit_is_refused() -> None:
    with pytest.raises(InputError, match="the supply limits its speed"):
        identify_axis(limited_wheel(), options=AxisOptions(law="coulomb"))


def test_a_single_wild_position_is_named_by_its_row() -> None:
    position = open_loop().position.copy()
    position[1500] = 1e6
    (text,) = error_texts(replace(open_loop(), position=position), "spike")
    assert "jumps to 1e+06 m in row 1501 (1.5 s after the first one) and back" in text
