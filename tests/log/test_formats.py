"""Files of logs: values that come back to the last bit, and a sentence for each kind of bad file."""

import io
import json
import tempfile
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ballbot.errors import InputError
from ballbot.files import LARGEST_TABLE
from ballbot.log import Log
from ballbot.log.formats import WRITTEN_SUFFIXES, is_foreign, read_columns, read_variables, write_columns
from ballbot.log.formats.text import infer_text_table, read_text_table
from tests.support.bags import column_messages, write_bag
from tests.support.log_examples import COLUMN_NAMES, any_logs, smooth_log

#: names that a format can hold, where it cannot hold all of these
NAMES_OF = {".mat": st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,62}", fullmatch=True)}
#: examples, fewer where a file takes milliseconds
EXAMPLES = {".csv": 50, ".parquet": 30, ".mat": 20, ".mcap": 15}


@pytest.mark.parametrize("suffix", WRITTEN_SUFFIXES)
def test_every_value_comes_back_to_the_bit(tmp_path, suffix):
    path = tmp_path / f"log{suffix}"

    @settings(max_examples=EXAMPLES[suffix], deadline=None)
    @given(log=any_logs(NAMES_OF.get(suffix, COLUMN_NAMES)))
    def check(log):
        log.write(path)
        assert_same(Log.read(path), log)

    check()


def assert_same(again: Log, log: Log) -> None:
    assert again.names == log.names
    for name in log:
        np.testing.assert_array_equal(again[name], log[name])
        known = ~np.isnan(log[name])
        np.testing.assert_array_equal(np.signbit(again[name][known]), np.signbit(log[name][known]))


@pytest.mark.parametrize(
    ("names", "foreign"),
    [
        ("t,u1,u2,u3,wheel1,wheel2,wheel3", False),
        ("t,u1,u2,u3,theta,phi,gyro_x,battery_V", False),
        ("t,roll,pitch,yaw,gyro_x,gyro_y,gyro_z,enc1,enc2,enc3,torque1_Nm,torque2_Nm,torque3_Nm", True),
        ("t,roll,pitch,yaw,wx,wheel1,wheel2,wheel3,cmd_1,cmd_2,cmd_3", True),
        ("t,theta,phi,psi,enc1,enc2,enc3,pwm1,pwm2,pwm3", True),
        ("time,u1,u2,u3", True),
    ],
)
def test_a_log_is_foreign_unless_most_names_are_ballbots(tmp_path, names, foreign):
    path = tmp_path / "log.csv"
    path.write_text(f"{names}\n" + "\n".join(",".join(["0.5"] * len(names.split(","))) for _ in range(3)))
    assert is_foreign(path) is foreign


def mat_bytes(columns: dict[str, np.ndarray]) -> bytes:
    stream = io.BytesIO()
    scipy.io.savemat(stream, columns)
    return stream.getvalue()


def json_bytes(columns: dict[str, np.ndarray]) -> bytes:
    return json.dumps({name: values.tolist() for name, values in columns.items()}).encode()


def bag_bytes(columns: dict[str, np.ndarray], *, ros: int) -> bytes:
    """Return a bag of ROS 1 or 2 with a topic for each column."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log"
        write_bag(path, column_messages(columns), ros=ros)
        return (path if ros == 1 else path / "log.db3").read_bytes()


#: contents of files in the formats that are only read
READ_ONLY = {".json": json_bytes, ".bag": partial(bag_bytes, ros=1), ".db3": partial(bag_bytes, ros=2)}
every_format = pytest.mark.parametrize("suffix", [*WRITTEN_SUFFIXES, *READ_ONLY])


def written(suffix: str, folder: Path, columns: dict[str, np.ndarray]) -> Path:
    path = folder / f"log{suffix}"
    if suffix in READ_ONLY:
        path.write_bytes(READ_ONLY[suffix](columns))
    else:
        write_columns(path, columns)
    return path


@every_format
def test_every_format_reads_missing_and_too_large_values_as_nan(tmp_path, suffix):
    values = np.array([1.0, np.nan, np.inf, -np.inf, 1e31, -2.5])
    read = read_columns(written(suffix, tmp_path, {"t": np.arange(6.0), "x": values}))
    assert [name.removesuffix(".data") for name in read] == ["t", "x"]
    t, x = read.values()
    np.testing.assert_array_equal(t, np.arange(6.0))
    np.testing.assert_array_equal(x, [1.0, np.nan, np.nan, np.nan, np.nan, -2.5])


@every_format
def test_every_format_reads_or_refuses_a_file_cut_or_changed_anywhere(tmp_path, suffix):
    random = np.random.default_rng(0)
    columns = {name: random.normal(size=5) for name in ("x", "u1")}
    path = written(suffix, tmp_path, {"t": np.sort(random.normal(size=5)), **columns})
    content = path.read_bytes()
    changes = [content[:size] for size in range(0, len(content), max(len(content) // 20, 1))]
    for _ in range(30):  # the campaign of damaged logs tries more
        changed = bytearray(content)
        for place in random.integers(0, len(content), 3):
            changed[place] = random.integers(256)
        changes.append(bytes(changed))
    refused = accepted = 0
    for change in changes:
        path.write_bytes(change)
        try:
            read = read_columns(path)
        except InputError as error:
            refused += str(error).startswith(str(path))
        else:
            assert len({len(values) for values in read.values()}) == 1
            assert all(values.dtype == np.float64 for values in read.values())
            accepted += 1
    assert refused + accepted == len(changes), "a refusal does not begin with the file's path"
    assert refused > 15


@every_format
def test_every_format_refuses_an_oversized_file_before_reading_it(tmp_path, suffix):
    path = tmp_path / f"log{suffix}"
    with path.open("wb") as stream:
        stream.truncate(LARGEST_TABLE + 1)
    with pytest.raises(InputError, match="at most 500 MB are read") as caught:
        read_columns(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize("suffix", WRITTEN_SUFFIXES)
def test_a_column_name_that_cannot_be_printed_is_not_written(tmp_path, suffix):
    path = tmp_path / f"log{suffix}"
    with pytest.raises(InputError, match="cannot be printed"):
        Log({"t": np.zeros(1), "a\x07": np.ones(1)}).write(path)
    assert not path.exists()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "is empty"),
        ("t,x\n", "a header and no rows"),
        ("0,1\n1,2\n", "line 1: this line has numbers; it must be the header"),
        ("t,x,x\n0,1,2\n", "the column name x appears twice"),
        ("t,x\n0,1\n\n1\n2,3\n", "line 4: the row has 1 cells, but the header has 2"),
        ("t,x\n0,1\n1,1_0\n", "line 3: '1_0' in column x is not a number"),
        ("time;x\n0;1\n", "--robot ROBOT --out checked` proposes a mapping"),
        ("x,y\n0,1\n", "needs the column t"),
        ("t,x\n,1\n,2\n", "The time t is missing or not finite at row 1"),
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


@pytest.mark.parametrize("header", ["t,a,b", "t,a,b,"])
@pytest.mark.parametrize("ends", [",", ", ", ",\r"])
def test_a_separator_at_the_end_of_rows_or_header_is_ignored(tmp_path, header, ends):
    path = tmp_path / "log.csv"
    path.write_text("\n".join([header, f"0.0,1,2{ends}", f"0.1,,{ends}", "0.2,3,4", f"0.3,5,6{ends}", ""]))
    for read in (read_text_table, lambda one: infer_text_table(one).columns):
        columns = read(path)
        assert list(columns) == ["t", "a", "b"]
        np.testing.assert_array_equal(columns["b"], [2.0, np.nan, 4.0, 6.0])
        np.testing.assert_array_equal(columns["a"], [1.0, np.nan, 3.0, 5.0])


def test_files_of_other_kinds_are_refused(tmp_path):
    for name, content, sentence in (
        ("log.csv", "t,Winkel [°]\n0,1\n".encode("latin-1"), "Latin-1, save it as UTF-8"),
        ("log.parquet", b"t,x\n0,1\n", "not a complete Parquet file"),
        ("log.csv.gz", b"\x1f\x8b", "is compressed; unpack it first"),
        ("log.xlsx", b"", r"give a file that ends in \.csv, .*\.parquet, .* or \.bag"),
        ("log.parqet", b"", r"did you mean \.parquet\?"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=sentence):
            Log.read(tmp_path / name)
    for suffix, kind in ((".csv", "CSV"), (".mat", "a MATLAB file")):
        with pytest.raises(InputError, match=f"cannot be written to {kind}"):
            Log({"t": [0.0], "a,b": [1.0]}).write(tmp_path / f"log{suffix}")


def test_parquet_text_column_is_refused_and_null_becomes_nan(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    parquet.write_table(pyarrow.table({"t": [0, 1], "x": [None, 2.0]}), tmp_path / "log.parquet")
    np.testing.assert_array_equal(Log.read(tmp_path / "log.parquet")["x"], [np.nan, 2.0])
    parquet.write_table(pyarrow.table({"t": [0, 1], "x": ["a", "b"]}), tmp_path / "log.parquet")
    with pytest.raises(InputError, match="column x contains string; it must contain numbers"):
        Log.read(tmp_path / "log.parquet")


def test_other_libraries_read_what_is_written(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    log = smooth_log(rows=5)
    for suffix in (".mat", ".parquet"):
        log.write(tmp_path / f"log{suffix}")
    table = parquet.read_table(tmp_path / "log.parquet")
    matlab = scipy.io.loadmat(tmp_path / "log.mat")
    for name in log:
        np.testing.assert_array_equal(matlab[name], log[name][:, None])
        np.testing.assert_array_equal(table.column(name).to_numpy(), log[name])


@pytest.mark.parametrize("turned", [False, True])
def test_long_matrices_of_a_matlab_file_are_columns(tmp_path, turned):
    t, wheel = 0.01 * np.arange(200.0), np.random.default_rng(0).standard_normal((200, 3))
    gain = np.ones((3, 10))  # no part of the log
    content = {"t": t[:, None], "wheel": wheel.T if turned else wheel, "gain": gain}
    (tmp_path / "log.mat").write_bytes(mat_bytes(content))
    columns = read_columns(tmp_path / "log.mat")
    assert set(columns) == {"t", "wheel_1", "wheel_2", "wheel_3"}
    np.testing.assert_array_equal(np.column_stack([columns[f"wheel_{k}"] for k in (1, 2, 3)]), wheel)
    np.testing.assert_array_equal(read_variables(tmp_path / "log.mat").columns["gain"], gain.ravel())


HEADED_TABLES = {
    "semicolons and decimal commas": "Zeit;Weg;Kraft\n0,5;1,25;-3\n1,5;2,5;4e-1\n",
    "tabs": "Zeit\tWeg\tKraft\n0.5\t1.25\t-3\n1.5\t2.5\t4e-1\n",
    "blanks": "Zeit Weg  Kraft\n0.5 1.25 -3\n1.5 2.5   4e-1\n",
    "commas and a row of units": "Zeit,Weg,Kraft\ns,mm,N m\n0.5,1.25,-3\n1.5,2.5,4e-1\n",
    "units in brackets": "Zeit;Weg;Kraft\n[s];[rad];[N*m]\n0,5;1,25;-3\n1,5;2,5;4e-1\n",
    "a title above the names": "Versuch 7\nZeit,Weg,Kraft\n0.5,1.25,-3\n1.5,2.5,4e-1\n",
    "an index without a name": ",Zeit,Weg,Kraft\n0,0.5,1.25,-3\n1,1.5,2.5,4e-1\n",
    "the mark of a comment": "# Zeit Weg Kraft\n0.5 1.25 -3\n1.5 2.5 4e-1\n",
}


@pytest.mark.parametrize("text", HEADED_TABLES.values(), ids=HEADED_TABLES)
def test_separator_decimal_sign_and_header_of_variables_are_inferred(tmp_path, text):
    path = tmp_path / "table.csv"
    path.write_text(text)
    table = read_variables(path)
    variables, units = table.columns, table.units
    values = [variables[name].tolist() for name in ("Zeit", "Weg", "Kraft")]
    assert values == [[0.5, 1.5], [1.25, 2.5], [-3.0, 0.4]]
    assert infer_text_table(path).layout.names == tuple(variables)
    if "[" not in text:
        assert units == ({"Zeit": "s", "Weg": "mm", "Kraft": "N m"} if "\ns,mm,N m\n" in text else {})


def test_the_fields_of_a_matlab_structure_are_columns(tmp_path):
    numbers = np.arange(60.0)
    fields = {"t": numbers, "roll": numbers + 1.0, "imu": {"pitch": numbers + 2.0}, "enc": np.eye(60)[:, :3]}

    def read(variables):
        scipy.io.savemat(tmp_path / "log.mat", variables)
        return read_variables(tmp_path / "log.mat").columns

    alone = read({"log": fields, "Ts": 0.01})
    assert {"t", "roll", "imu.pitch", "enc_1", "enc_2", "enc_3", "Ts"} <= set(alone)
    assert alone["imu.pitch"].tolist() == (numbers + 2.0).tolist()
    # two structures, or a variable of the same name, keep their names
    assert {"log.t", "other.t"} <= set(read({"log": fields, "other": {"t": numbers}}))
    assert {"log.roll", "roll"} <= set(read({"log": fields, "roll": 0.0}))
    # a structure of single numbers, as of parameters, is none of a log
    assert {"t", "roll", "robot.mass"} <= set(read({"log": fields, "robot": {"mass": 17.0, "gear": 26.0}}))


@given(
    start=st.datetimes(datetime(1971, 1, 1), datetime(2100, 1, 1)),
    mark=st.sampled_from(["T", " "]),
    zone=st.sampled_from(["", "Z", "+02:00", "-0530"]),
    decimal=st.sampled_from([".", ","]),
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_dates_with_times_are_seconds(tmp_path, start, mark, zone, decimal):
    path, separator = tmp_path / "run.csv", ";" if decimal == "," else ","
    moments = [start + timedelta(milliseconds=5 * k) for k in range(3)]
    stamps = [one.isoformat(mark, "microseconds").replace(".", decimal) + zone for one in moments]
    lines = [separator.join([stamp, f"1{decimal}5"]) for stamp in stamps]
    path.write_text("\n".join([f"stamp{separator}a", *lines]))
    columns = infer_text_table(path).columns
    assert np.diff(columns["stamp"]) == pytest.approx(0.005, abs=2e-6)
    offset = {"": 0.0, "Z": 0.0, "+02:00": 7200.0, "-0530": -19800.0}[zone]
    assert columns["stamp"][0] == pytest.approx(start.replace(tzinfo=UTC).timestamp() - offset, abs=2e-6)
    assert columns["a"].tolist() == [1.5, 1.5, 1.5]


def test_folder_and_misspelt_file_are_answered_by_the_log_that_is_meant(tmp_path):
    (tmp_path / "log.csv").write_text("t,x\n0,1\n1,2\n")
    with pytest.raises(InputError, match=r"Name a file in it, such as .*log\.csv"):
        Log.read(tmp_path)
    with pytest.raises(InputError, match=r"did you mean .*/log\.csv\?"):
        Log.read(tmp_path / "lg.csv")
