"""Corrupted rows and blows are named as such, and not as play, as a delay or as friction near rest."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot import Log
from ballbot.identification.axis import AXIS_LAWS, AxisOptions, AxisRecord
from ballbot.identification.axis.checks import record_findings
from ballbot.identification.axis.file_columns import AxisColumns
from ballbot.identification.axis.law_fits import initial_values
from ballbot.identification.axis.motion import default_bandwidth
from ballbot.identification.axis.outliers import outlier_findings
from ballbot.identification.axis.output_error import sighting
from ballbot.identification.axis.preparation import Bench, prepared_records
from ballbot.identification.axis.reading import read_axis_record
from ballbot.identification.axis.selection import blocks_of, fit_all
from ballbot.identification.axis.spikes import spike_rows
from ballbot.identification.axis.structure import AxisModel
from campaigns.axis_machines import Logging, Machine, record_of

JOINT = Machine(kind="joint", inertia=1.0, viscous=1.0, coulomb=2.0)
LOGGING = Logging(duration=10.0, rate=200.0, amplitude=1.0, fastest=1.2, counts=65536.0, force_noise=0.04)
ROWS = [400, 811, 1207, 1208 + 200, 1700]
RANDOM = np.random.default_rng(5)
N = 4000
T = 0.005 * np.arange(N)


def joint(*, force: NDArray[np.float64] | float = 0.0) -> AxisRecord:
    record = record_of(JOINT, LOGGING, 0)
    return replace(record, force=record.force + force)


def blow() -> AxisRecord:
    """Return a record in which something held the joint for 0.1 s against 40 N m that the log has."""
    force = np.zeros(len(joint()))
    force[1000:1020] = 40.0
    return joint(force=force)


@pytest.mark.parametrize(
    "signal",
    [
        RANDOM.standard_normal(N),
        RANDOM.standard_t(4.0, N),
        np.sign(RANDOM.standard_normal(N)),  # a motor that is switched to and fro
        np.floor(200.0 * np.sin(T)) / 200.0,  # a coarse encoder
        np.abs(np.sin(T)),  # a bounce off a stop
        np.where(np.arange(N) < 2000, 0.0, 3.0),  # a step
        np.where(np.arange(N) % 50 == 0, 5.0, 0.1 * np.sin(T)),  # regular pulses
        np.zeros(N),
    ],
)
def test_motion_and_noise_are_no_spikes(signal: NDArray[np.float64]) -> None:
    assert not len(spike_rows(signal))


@pytest.mark.parametrize("count", [1, 3, 5])
@pytest.mark.parametrize("column", ["position", "force"])
def test_spikes_are_replaced_and_named(tmp_path: Path, column: str, count: int) -> None:
    record, rows = joint(), ROWS[:count]
    columns = {"t": record.t, "position": record.position + 2.0, "force": record.force.copy()}
    truth = columns[column].copy()
    columns[column][rows] = 0.0 if column == "position" else 300.0
    file = tmp_path / "joint.csv"
    Log(columns).write(file)
    found = read_axis_record(file, AxisColumns(unit="rad"))
    # a neighbour's mean: the noise, and a step of the controller
    tolerance = 1e-3 if column == "position" else 4.0
    np.testing.assert_allclose(getattr(found, column), truth, atol=tolerance)
    assert [(one.column, one.row) for one in found.spikes] == [(column, row) for row in rows]
    (finding,) = record_findings(found)
    assert (finding.code, finding.severity) == ("spike", "warning")
    assert f"the {column} is {'0 rad' if column == 'position' else '300 N m'} in row 401 (2 s" in finding.text
    assert ("row 812 (4.055 s)" in finding.text or "rows 812 (4.055 s)" in finding.text) == (count > 1)
    assert ("and 1 more" in finding.text) == (count == 5)


def test_a_blow_is_an_outlier_and_no_play() -> None:
    """By a fit of all rows, and by one without those near reversals, it is most of the error."""
    record = blow()
    bench = Bench(records=(record,), others=(), bandwidth=None)
    options = AxisOptions(harmonics=(), spring=False, drift=False, load_friction="none")
    found = prepared_records(bench, options, blocks_of([record]))
    assert found.play is None
    assert found.delay == 0.0


def found_in(record: AxisRecord, whole: AxisRecord) -> list[str]:
    seen, blocks = [sighting(record, default_bandwidth(record))], blocks_of([record])
    model = AxisModel(law=AXIS_LAWS["coulomb"])
    fit = fit_all(model, initial_values(seen, model, bandwidth=None)["coulomb"], seen, blocks, 0.1)
    found = outlier_findings(fit, seen, [whole], blocks, 0.1)
    assert all((one.code, one.severity) == ("outliers", "warning") for one in found)
    return [one.text for one in found]


def test_the_window_of_a_blow_is_named() -> None:
    """It acts from row 1001, 5 s after the first one, to row 1020."""
    (text,) = found_in(blow(), blow())
    first, last = map(int, re.findall(r"rows (\d+) to (\d+)", text)[0])
    assert 980 < first <= 1001 < last < 1040
    assert found_in(joint(), joint()) == []


def test_times_and_rows_are_those_of_the_whole_record() -> None:
    record = blow()
    late = slice(220, None)
    cut = replace(record, force=record.force[late], position=record.position[late], times=record.t[late])
    (text,) = found_in(cut, record)
    first, last = map(int, re.findall(r"rows (\d+) to (\d+)", text)[0])
    assert 980 < first < 1020 < last + 20 < 1060
    start = float(re.findall(r": ([\d.]+) to", text)[0])
    assert start == pytest.approx((first - 1) / 200.0, abs=0.005)
