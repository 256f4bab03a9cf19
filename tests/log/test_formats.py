"""Files of logs: values that come back to the last bit, and a sentence for each kind of bad file."""

import sys

import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.formats.text import TextLayout, read_text_table
from tests.support.log_examples import smooth_log

COLUMN_NAMES = st.text(st.characters(codec="utf-8", categories=["L", "N"]), min_size=1, max_size=12)


@st.composite
def logs(draw):
    rows = draw(st.integers(1, 12))
    steps = draw(hnp.arrays(np.float64, rows, elements=st.floats(1e-3, 10.0)))
    names = draw(st.lists(COLUMN_NAMES.filter(lambda name: name != "t"), max_size=4, unique=True))
    # every double there is, among them subnormal ones, infinities, NaN and minus zero
    values = hnp.arrays(np.float64, rows, elements=st.floats(allow_nan=True, allow_infinity=True, width=64))
    return Log({"t": np.cumsum(steps)} | {name: draw(values) for name in names})


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
# the folder is shared between examples, each of which overwrites the file
@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(log=logs())
def test_every_value_comes_back_to_the_bit(tmp_path, suffix, log):
    path = tmp_path / f"log{suffix}"
    log.write(path)
    again = Log.read(path)
    assert again.names == log.names
    for name in log:
        np.testing.assert_array_equal(again[name], log[name])
        known = ~np.isnan(log[name])
        np.testing.assert_array_equal(np.signbit(again[name][known]), np.signbit(log[name][known]))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "is empty"),
        ("\n \n", "is empty"),
        ("t,x\n", "a header and no rows"),
        ("0,1\n1,2\n", "line 1: this line has numbers; it must be the header"),
        ("t,x,x\n0,1,2\n", "line 1: the column name x appears twice"),
        ("t,,x\n0,1,2\n", "line 1: column 2 of the header has no name"),
        ("t,x\n0,1\n1,2,3\n", "line 3: the row has 3 cells, but the header has 2"),
        ("t,x\n0,1\n\n1\n", "line 4: the row has 1 cells, but the header has 2"),
        ("t,x,y\n0,1\n1,2\n", "line 2: the row has 2 cells, but the header has 3"),
        ("t,x\n0,1\n1,two\n", "line 3: 'two' in column x is not a number"),
        ("t,x\n0,1\n1,1_0\n", "line 3: '1_0' in column x is not a number"),
        ("t;x\n0;1\n", "line 1: the header is not separated by commas"),
        ("x,y\n0,1\n", "needs the column t"),
        ("t,x\n0,1\n,2\n", "The time t is missing or not finite at row 2"),
        ("t,x\n0,1\n0,2\n", "Time does not increase at row 2"),
        ("t,x\n1,1\n0,2\n", "Time decreases at row 2"),
    ],
)
def test_a_bad_csv_ends_in_a_sentence(tmp_path, text, sentence):
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=sentence) as caught:
        Log.read(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_missing_cells_become_nan_and_nothing_else_changes(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text('t , "x",y\r\n0,,1\r\n1, nan ,2\r\n2,3,\r\n')
    log = Log.read(path)
    np.testing.assert_array_equal(log["x"], [np.nan, np.nan, 3.0])
    np.testing.assert_array_equal(log["y"], [1.0, 2.0, np.nan])


@given(st.integers(0, 29), st.integers(0, 2))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_a_bad_cell_is_found_by_its_line_and_column(tmp_path, row, column):
    cells = [[f"{k}", "1.5", "2.5"] for k in range(30)]
    cells[row][column] = "oops"
    path = tmp_path / "log.csv"
    path.write_text("t,x,y\n" + "\n".join(",".join(line) for line in cells))
    with pytest.raises(InputError, match=f"line {row + 2}: 'oops' in column {'txy'[column]} is not"):
        Log.read(path)


def test_the_fast_and_the_patient_parser_agree(tmp_path):
    log = smooth_log(rows=200)
    path = tmp_path / "log.csv"
    log.write(path)
    fast = read_text_table(path, TextLayout())
    patient = read_text_table(path, TextLayout(missing=("none",)))  # a marker rules the compiled parser out
    for name in log:
        np.testing.assert_array_equal(fast[name], patient[name])


def test_files_of_other_kinds_are_refused(tmp_path):
    (tmp_path / "log.csv").write_bytes(b"\xff\xfe\x00\x80")
    (tmp_path / "log.parquet").write_text("t,x\n0,1\n")
    (tmp_path / "log.mat").write_text("")
    with pytest.raises(InputError, match="not a text file in UTF-8"):
        Log.read(tmp_path / "log.csv")
    with pytest.raises(InputError, match="not a complete Parquet file"):
        Log.read(tmp_path / "log.parquet")
    with pytest.raises(InputError, match="not a complete MATLAB file"):
        Log.read(tmp_path / "log.mat")
    (tmp_path / "log.xlsx").write_text("")
    with pytest.raises(InputError, match=r"give a file that ends in \.csv, .* \.parquet or \.mat"):
        Log.read(tmp_path / "log.xlsx")
    (tmp_path / "log.parqet").write_text("")
    with pytest.raises(InputError, match=r"did you mean \.parquet\?"):
        Log.read(tmp_path / "log.parqet")
    for name in ("absent.csv", "absent.parquet"):
        with pytest.raises(InputError, match="cannot be read: No such file"):
            Log.read(tmp_path / name)
    with pytest.raises(InputError, match=r"end in \.csv or \.parquet"):
        smooth_log(rows=2).write(tmp_path / "log.xlsx")
    with pytest.raises(InputError, match="cannot be written to CSV"):
        Log({"t": [0.0], "a,b": [1.0]}).write(tmp_path / "log.csv")


def test_parquet_text_column_is_refused_and_null_becomes_nan(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    parquet.write_table(pyarrow.table({"t": [0, 1], "x": [None, 2.0]}), tmp_path / "log.parquet")
    np.testing.assert_array_equal(Log.read(tmp_path / "log.parquet")["x"], [np.nan, 2.0])
    parquet.write_table(pyarrow.table({"t": [0, 1], "x": ["a", "b"]}), tmp_path / "log.parquet")
    with pytest.raises(InputError, match="column x contains string; it must contain numbers"):
        Log.read(tmp_path / "log.parquet")


def test_without_pyarrow_csv_works_and_parquet_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    log = smooth_log(rows=3)
    log.write(tmp_path / "log.csv")
    assert len(Log.read(tmp_path / "log.csv")) == 3
    with pytest.raises(InputError, match="need pyarrow"):
        log.write(tmp_path / "log.parquet")


def test_matlab_variables_as_long_as_time_are_the_columns_of_a_log(tmp_path):
    log = smooth_log(rows=5)
    scipy.io.savemat(tmp_path / "log.mat", {**log.columns, "gain": 3.0, "gains": np.ones((2, 10))})
    read = Log.read(tmp_path / "log.mat")
    assert read.names == log.names
    for name in log:
        np.testing.assert_array_equal(read[name], log[name])


@pytest.mark.parametrize(
    ("name", "rows", "columns"),
    [("square_soft", 20000, 26), ("driveline_sweep", 25132, 10), ("hold_soft_mocap", 7200, 8)],
)
def test_shared_logs_read_whole(shared_data, name, rows, columns):
    path = shared_data / "bbr" / f"{name}.csv"
    log = Log.read(path)
    assert (len(log), len(log.names)) == (rows, columns)
    last = path.read_text().splitlines()[-1].split(",")
    np.testing.assert_array_equal([log[name][-1] for name in log], [float(cell) for cell in last])
