"""A force that acts later than its row: found by what the records predict, and undone."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ballbot.identification.axis import AXIS_LAWS, AxisOptions, force_timing, identify_axis
from ballbot.identification.axis.force_timing import (
    LinearDelay,
    delay_findings,
    delayed,
    force_delay,
    is_interpolated,
    remaining_delay,
)
from ballbot.identification.axis.law_fits import initial_values
from ballbot.identification.axis.motion import default_bandwidth
from ballbot.identification.axis.output_error import OutputErrorFit, sighting
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.selection import blocks_of
from ballbot.identification.axis.structure import AxisModel
from campaigns.axis_machines import Logging, Machine, record_of
from tests.support.axis_examples import simulated_record

TRUTH = {"mass": 0.0045, "viscous": 0.03, "coulomb": 0.06}
MOTOR = Machine(kind="motor", inertia=0.0045, viscous=0.03, coulomb=0.06)


@pytest.fixture(scope="module")
def motor() -> AxisRecord:
    """Return a small motor at 100 Hz, where one row of delay makes its viscous friction wrong by a fifth."""
    return record_of(MOTOR, Logging(duration=12.0, rate=100.0, amplitude=2.0, counts=65536.0), 1, "motor")


def late(record: AxisRecord, rows: int) -> AxisRecord:
    """Return a record whose forces are logged so many rows before they act."""
    return replace(record, force=np.append(record.force[rows:], np.full(rows, record.force[-1])))


def delay_of(record: AxisRecord) -> float:
    model = AxisModel(law=AXIS_LAWS["coulomb"])
    seen = [sighting(record, 4.0 if record.sample_time > 2e-3 else 20.0)]
    return force_delay(seen, model, initial_values(seen, model, bandwidth=None), blocks_of([record]))


@pytest.mark.parametrize("rows", [0, 1, 3])
def test_the_delay_of_a_force_is_found(motor: AxisRecord, rows: int) -> None:
    # halves of a row are tried; the force of a record at 100 Hz is held, so that its own delay is known to half a row
    assert delay_of(late(motor, rows)) == pytest.approx(rows, abs=0.5)


def test_the_time_of_a_force_is_found_in_spite_of_a_coarse_encoder() -> None:
    """Its noise hides the time in windows of a tenth of a second; 12 bits, rows of 5 ms, a loop at 1 kHz."""
    logging = Logging(duration=12.0, rate=200.0, held=False, amplitude=1.0, counts=4096.0)
    record = record_of(replace(MOTOR, inertia=0.08, viscous=0.15, coulomb=0.25), logging, 1)
    seen, blocks = [sighting(record, default_bandwidth(record))], blocks_of([record])
    model = AxisModel(law=AXIS_LAWS["coulomb"])
    assert is_interpolated(seen, model, initial_values(seen, model, bandwidth=None), blocks)


def test_a_force_that_fits_best_at_the_end_of_the_search_is_not_moved(motor: AxisRecord) -> None:
    """Such as a column that is no force at all; a delay of 9 rows is beyond those that are tried."""
    assert delay_of(late(motor, 9)) == 0.0


def test_a_wider_law_that_is_lost_does_not_hide_a_delay(
    motor: AxisRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the starts of late forces, the break-away force of a chirp ended far from the law within it."""
    usual = force_timing.fit_all

    def lost(model: AxisModel, *rest: Any, **options: Any) -> OutputErrorFit:
        fit = usual(model, *rest, **options)
        return fit if model.law.name == "coulomb" else replace(fit, rms=1.0)

    monkeypatch.setattr(force_timing, "fit_all", lost)
    assert delay_of(late(motor, 1)) == pytest.approx(1.0, abs=0.5)


def test_a_bus_s_delay_of_many_rows_of_a_fast_log_is_found() -> None:
    """12 ms are 12 rows at 1 kHz, more than the rows that are tried of a slow log."""
    record = record_of(MOTOR, Logging(duration=6.0, rate=1000.0, amplitude=2.0, counts=65536.0), 1)
    assert delay_of(late(record, 12)) == pytest.approx(12.0, abs=0.5)


def test_a_part_of_a_row_that_the_search_leaves_is_found(motor: AxisRecord) -> None:
    early = delayed(motor, -0.3)
    model = AxisModel(law=AXIS_LAWS["coulomb"])
    seen = [sighting(early, default_bandwidth(early))]
    starts = initial_values(seen, model, bandwidth=None)
    # of a force that is held, moving it by parts of a row smooths the steps
    assert remaining_delay(seen, model, starts, blocks_of([early])) == pytest.approx(0.3, abs=0.1)
    exact = [sighting(motor, default_bandwidth(motor))]
    assert abs(remaining_delay(exact, model, starts, blocks_of([motor]))) < 0.05


def test_stribeck_friction_is_not_taken_for_a_delay() -> None:
    machine = replace(MOTOR, stribeck=0.08, stribeck_speed=0.4)
    logging = Logging(duration=12.0, rate=200.0, amplitude=1.0, counts=4096.0)
    assert delay_of(record_of(machine, logging, 1, "motor")) == 0.0


def test_a_force_in_a_known_loop_is_not_moved() -> None:
    assert delay_of(late(simulated_record(duration=6.0), 3)) == 0.0


def test_a_force_moved_by_whole_and_half_rows(motor: AxisRecord) -> None:
    whole, half = delayed(motor, 2.0), delayed(motor, -0.5)
    np.testing.assert_array_equal(whole.force[2:], motor.force[:-2])
    np.testing.assert_allclose(half.force[:-1], 0.5 * (motor.force[:-1] + motor.force[1:]))
    assert delayed(motor, 0.0) is motor


def test_the_finding_on_a_delay_says_what_was_moved_and_how_clear_it_is(motor: AxisRecord) -> None:
    (moved,) = delay_findings([motor], 1.0)
    assert (
        "acts 10 ms (1 row) later than its row: so moved it predicts the position clearly better"
        in moved.text
    )
    assert "play" not in moved.text
    (unclear,) = delay_findings([motor], -0.5, clear=False)
    assert "acts 5 ms (0.5 rows) earlier than its row" in unclear.text
    assert "reverses too often to distinguish such a delay from play" in unclear.text
    assert not delay_findings([motor], 0.0, clear=False)


@pytest.mark.sample
def test_the_friction_of_a_record_with_a_late_force_is_right(motor: AxisRecord) -> None:
    found = identify_axis(
        late(motor, 1), options=AxisOptions(law="coulomb", harmonics=(), spring=False, drift=False)
    )
    assert "force-delay" in {one.code for one in found.findings}
    for name, truth in TRUTH.items():
        assert found.best.values[name] == pytest.approx(truth, rel=0.05)


@pytest.mark.parametrize(
    ("rows", "error", "refuted"), [(0.1, 0.2, True), (0.1, 0.5, False), (0.9, 0.05, False), (-0.1, 0.2, True)]
)
def test_a_delay_is_refuted_only_far_outside_the_interval(rows: float, error: float, refuted: bool) -> None:
    found = LinearDelay(rows=rows, error=error, p_value=0.5, improves=False)
    assert found.refutes(1.0) is refuted


def test_a_part_of_a_row_is_a_note(motor: AxisRecord) -> None:
    part, whole = (delay_findings([motor], rows, part=share) for rows, share in ((0.0, 0.1), (2.0, 0.0)))
    assert [(one.code, one.severity) for one in (*part, *whole)] == [
        ("force-delay", "note"),
        ("force-delay", "warning"),
    ]
    assert "acts 1 ms (0.1 rows) later than its row" in part[0].text
