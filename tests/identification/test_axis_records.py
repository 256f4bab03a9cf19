"""Records of one axis from files: uneven rows, gaps, velocities; bad files answer with one clear sentence."""

from pathlib import Path

import numpy as np
import pytest
import scipy

from ballbot.errors import InputError
from ballbot.identification.axis.checks import record_findings
from ballbot.identification.axis.record import AxisColumns, read_axis_record, record_of_rows
from ballbot.log.formats.text import write_text_table

ROWS = 600
T = np.arange(ROWS, dtype=np.float64) * 2e-3
POSITION = 0.3 * np.sin(6.0 * T) + 0.1 * np.sin(17.0 * T)
FORCE = 4.0 * np.gradient(np.gradient(POSITION, T), T) + 2.0 * np.gradient(POSITION, T)


def written(path: Path, **columns: np.ndarray) -> Path:
    write_text_table(path, {"t": T, "position": POSITION, "force": FORCE} | columns)
    return path


def test_uneven_rows_become_even(tmp_path: Path) -> None:
    t = T + 5e-4 * np.sin(np.arange(ROWS))
    position = np.interp(t, T, POSITION)
    record = read_axis_record(written(tmp_path / "a.csv", t=t, position=position), AxisColumns())
    assert not record.even
    assert record.parts == ((0, len(record)),)
    # two straight lines over 2 ms of an acceleration of 30 m/s^2
    expected = np.interp(t[0] + record.t, T, POSITION)
    np.testing.assert_allclose(record.position[:-1], expected[:-1], atol=5e-5)


def test_fast_rows_are_merged_with_the_impulse_of_their_force() -> None:
    t = 2e-4 * np.arange(2003)
    gap = t + (t > 0.2)
    fast = record_of_rows("fast", gap, np.cos(50.0 * t), np.sin(t))
    thin = fast.thinned()
    assert (thin.sample_time, len(thin.parts)) == (pytest.approx(1e-3), 2)
    np.testing.assert_array_equal(thin.position, np.interp(thin.t, fast.t, fast.position))
    # the rows that fill no whole one are lost at the end of each part
    assert thin.force.sum() * 5.0 == pytest.approx(fast.force.sum(), abs=9.0)
    assert thin.thinned() is thin


def test_rows_without_times_come_at_the_interval_that_is_given(tmp_path: Path) -> None:
    """Public records often have their sample time in a text, or as a variable of one value."""
    path = tmp_path / "a.mat"
    variables = {"position": POSITION, "force": FORCE}
    scipy.io.savemat(path, variables | {"Ts": 2e-3})
    for time in ("0.002", "Ts"):
        record = read_axis_record(path, AxisColumns(time=time))
        assert record.even
        np.testing.assert_allclose(record.t, T, atol=1e-12)
    with pytest.raises(InputError, match="--time is 0: give a number above zero"):
        read_axis_record(path, AxisColumns(time="0"))


def test_missing_values_leave_a_gap_that_is_reported(tmp_path: Path) -> None:
    force = FORCE.copy()
    force[300:320] = np.nan
    record = read_axis_record(written(tmp_path / "a.csv", force=force), AxisColumns())
    assert record.parts == ((0, 300), (300, ROWS - 20))
    assert [one.code for one in record_findings(record) if one.severity == "note"] == ["gap"]


def test_a_position_is_the_integral_of_a_velocity(tmp_path: Path) -> None:
    velocity = np.gradient(POSITION, T)
    columns = AxisColumns(velocity="v")
    record = read_axis_record(written(tmp_path / "a.csv", v=velocity), columns)
    # differences over two rows, integrated by trapezoids: second order in 2 ms times 17 rad/s
    np.testing.assert_allclose(record.position, POSITION - POSITION[0], atol=2e-4)


def test_a_constant_column_is_a_number(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", kt=np.full(ROWS, 2.0))
    record = read_axis_record(path, AxisColumns(force_scale="kt"))
    np.testing.assert_allclose(record.force, 2.0 * FORCE, atol=1e-9)


def test_variables_that_are_not_named_are_all_asked_for_at_once(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    write_text_table(path, {"time": T, "a": POSITION, "b": FORCE})
    with pytest.raises(InputError, match=r"called t or force; .*--time NAME --force NAME \(or --time 0.001"):
        read_axis_record(path, AxisColumns(position="a"))


@pytest.mark.parametrize(
    ("columns", "changes", "sentence"),
    [
        ({"force": "pulses"}, {}, "called pulses; .*--force NAME"),
        (
            {"force_scale": "t"},
            {},
            "--force-scale is t: give a number other than zero, or a column with one value",
        ),
        ({}, {"force": np.where(np.arange(ROWS) % 2, FORCE, np.nan)}, "force is missing or .* in row 1"),
        ({}, {"t": T[::-1].copy()}, "Time decreases at row 2"),
        ({}, {"position": np.zeros(ROWS)}, "the position never changes"),
    ],
)
def test_bad_files_and_columns_answer_with_their_cause(tmp_path, columns, changes, sentence):
    path = written(tmp_path / "a.csv", **changes)
    with pytest.raises(InputError, match=sentence):
        read_axis_record(path, AxisColumns(**columns))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("names", "units", "columns", "factors"),
    [
        ("t,position,force", "[ms],[mm],[N]", {}, (1e-3, 1e-3, 1.0)),
        ("t,position,force", "s,°,mNm", {"unit": "rad"}, (1.0, np.pi / 180.0, 1e-3)),
        ("t,position [cm],force", "", {"position": "position [cm]"}, (1.0, 0.01, 1.0)),
        ("t,position,force", "s,deg,A", {"force_scale": "3", "unit": "rad"}, (1.0, np.pi / 180.0, 3.0)),
        ("t_ms,position_deg,force_mNm", "", {"unit": "rad"}, (1e-3, np.pi / 180.0, 1e-3)),
        ("t,position_m,force_A", "", {"unit": "rad"}, (1.0, 1.0, 1.0)),
    ],
)
def test_units_in_a_file_are_converted_unless_a_factor_is_given(tmp_path, names, units, columns, factors):
    rows = [f"{t:.9g},{x:.9g},{f:.9g}" for t, x, f in zip(T, POSITION, FORCE, strict=True)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([names, *([units] if units else []), *rows]))
    named = dict(zip(("time", "position", "force"), names.split(","), strict=True))
    record = read_axis_record(path, AxisColumns(**(named | columns)))  # type: ignore[arg-type]
    of_time, of_position, of_force = factors
    assert record.sample_time == pytest.approx(2e-3 * of_time)
    np.testing.assert_allclose(record.position, of_position * POSITION, atol=1e-9)
    np.testing.assert_allclose(record.force, of_force * FORCE, rtol=1e-6, atol=1e-9)
    assert ("unit" in {one.code for one in record.findings}) == (set(factors) != {1.0})


def test_a_mapping_gives_names_units_scales_delays_and_a_further_force(tmp_path: Path) -> None:
    columns, mapping = {"q": POSITION / 0.01, "late": FORCE / 2.0, "pulses": T}, tmp_path / "axis.toml"
    path = written(tmp_path / "a.csv", **columns)
    lines = (
        't = { from = "t", unit = "ms" }',
        'axis_angle = { from = "q", scale = 0.01 }',
        'axis_torque = { from = "late", scale = 2, delay = 4e-6 }',
        'axis_torque_added = "pulses"',
    )
    mapping.write_text("\n".join(["[columns]", *lines]))
    record = read_axis_record(path, mapping=mapping)
    assert (record.unit, record.sample_time) == ("rad", pytest.approx(2e-6))
    # two rows of delay, whose values lie past the last rows of the file
    np.testing.assert_allclose(record.position, POSITION[:-2], atol=1e-9)
    np.testing.assert_allclose(record.force, FORCE[2:] + T[:-2], atol=1e-6)
    with pytest.raises(InputError, match="leave out the options"):
        read_axis_record(path, AxisColumns(force="late"), mapping=mapping)


def test_failed_readings_of_a_position_are_missing(tmp_path: Path) -> None:
    position = 2.0 + POSITION
    position[::20] = 0.0
    record = read_axis_record(written(tmp_path / "a.csv", position=position), AxisColumns())
    assert record.position.min() > 1.0
    assert "missing" in {one.code for one in record.findings}


def test_a_unit_of_the_other_kind_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", position_rad=POSITION)
    with pytest.raises(InputError, match=r"the unit 'rad' cannot be converted to m; .*give --unit rad"):
        read_axis_record(path, AxisColumns(position="position_rad"))


@pytest.mark.parametrize(
    ("position", "scale", "period"),
    [
        (np.degrees(np.mod(20.0 * POSITION, 2.0 * np.pi)), np.radians(1.0), 2.0 * np.pi),
        (np.mod(20.0 * POSITION + np.pi, 2.0 * np.pi) - np.pi, 1.0, 2.0 * np.pi),
        (np.mod(np.round(20.0 * POSITION * 1000.0), 4096.0), 1e-3, 4.096),
        (np.degrees(np.mod(20.0 * POSITION, 2.0 * np.pi)), 1.0, 360.0),
    ],
    ids=["0 to 360", "pi", "counter", "degrees"],
)
def test_a_position_that_wraps_is_counted_on(tmp_path, position, scale, period):
    position[100] = np.nan
    path = written(tmp_path / "a.csv", position=position)
    mapping = tmp_path / "axis.toml"
    entries = f'axis_angle = {{ from = "position", scale = {scale} }}', 'axis_torque = "force"'
    mapping.write_text("\n".join(["[columns]", 't = "t"', *entries]))
    record = read_axis_record(path, mapping=mapping)
    assert np.abs(np.diff(record.position)).max() < 0.1 * period
    found = {one.code for one in record_findings(record) if one.severity != "error"}
    assert "wrap" in found
    assert ("unit" in found) == (scale == 1.0 and period == 360.0)


@pytest.mark.parametrize("jump", [2.0, 6.28])
def test_a_jump_that_is_no_turn_stays(tmp_path: Path, jump: float) -> None:
    """A jump of another size, and one beside steps that are nearly as large."""
    position = POSITION.copy() if jump == 2.0 else 30.0 * POSITION
    position[300:] += jump
    record = read_axis_record(written(tmp_path / "a.csv", position=position), AxisColumns(unit="rad"))
    assert record.findings == ()
    np.testing.assert_array_equal(record.position, position)
