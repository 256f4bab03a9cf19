"""Sizes are known before memory is asked for them, and what is no file of a sensible size is refused in a sentence."""

import os
import re
import resource
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot import InputError
from ballbot.arrays import MOST_CELLS, MOST_ROWS, rows_between
from ballbot.cli.main import main
from ballbot.identification.quantities import read_bounds
from ballbot.robot import Robot
from ballbot.robot.file import robot_text
from tests.test_file_formats import READERS

TOML: dict[str, Callable[[Path], object]] = {
    **{kind: read for kind, read in READERS.items() if kind != "results"},
    "bounds": read_bounds,
}


@pytest.fixture(autouse=True)
def little_memory() -> Iterator[None]:
    """Give the test 3 GB beside what the process has, so that an allocation by a wrong number fails at once."""
    here = int(re.search(r"VmSize:\s*(\d+)", Path("/proc/self/status").read_text())[1]) * 1024
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (here + 3 * 2**30, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


def refused(capsys, *arguments: str | Path) -> str:
    """Run a command that must end in one sentence; return the sentence."""
    assert main(list(map(str, arguments))) == 2
    said = capsys.readouterr().err
    assert said.startswith("ballbot: ")
    assert said.count("\n") == 1
    return said


@pytest.mark.parametrize("row", [1, 812])
def test_one_stray_time_is_reported(tmp_path, capsys, row):
    """A clock that was set after the first row, or before the last."""
    t, path = 0.005 * np.arange(813.0), tmp_path / "log.csv"
    t[row:] += 1.7e9
    path.write_text("t,u1,theta\n" + "".join(f"{one!r},0.1,0.2\n" for one in t.tolist()))
    said = refused(capsys, "check-log", path)
    assert "log.csv: The log spans 54 years: t jumps from " in said
    assert f"at row {row + 1}. Correct that time" in said


def test_sample_time_of_nanoseconds_is_refused(tmp_path, capsys):
    robot, scenario = tmp_path / "robot.toml", tmp_path / "scenario.toml"
    entry = 'sample_time = { value = 5e-9, unit = "s", source = "measured" }'
    robot.write_text(re.sub(r"(?m)^sample_time = .*$", entry, robot_text(Robot.load("alten"))))
    assert "sensors.sample_time" in refused(capsys, "check", robot)
    scenario.write_text("[sensors]\nsample_time = 5e-9\n")
    assert "sensors.sample_time" in refused(capsys, "record", scenario, "--out", tmp_path / "out")


@pytest.mark.parametrize("name", TOML)
@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"a = " + b"[" * 100_000, "nested too deeply|not valid"),
        (b"a = " + b"9" * 5000, "not valid"),
        (b"#" * 1_000_001, "at most 1 MB are read|not valid"),
        ("a = 1".encode("utf-16"), "in UTF-16; save it as UTF-8"),
        (b"\xff\xfd", "is not a text file in UTF-8"),
        (b"\x00\x01\x02", "not valid"),
    ],
)
def test_deeply_nested_settings_are_refused(tmp_path, name, content, words):
    path = tmp_path / "any.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        TOML[name](path)
    assert "any.toml" in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (Path.mkdir, "Is a directory"),
        (os.mkfifo, "is a pipe"),
        (lambda path: path.symlink_to("/dev/zero"), "is a device"),
        (lambda _: None, "No such file"),
    ],
)
def test_path_without_a_file_is_refused(tmp_path, capsys, make, words):
    make(tmp_path / "a.csv")
    assert words in refused(capsys, "check-log", tmp_path / "a.csv")


def test_path_with_a_zero_byte_is_refused(tmp_path, capsys):
    assert "zero byte" in refused(capsys, "check-log", tmp_path / "a\0b.csv")


def test_log_of_too_many_columns_is_refused(tmp_path, capsys):
    columns = 1001
    path = tmp_path / "wide.csv"
    names = [f"c{k}" for k in range(columns - 1)]
    path.write_text(f"t,{','.join(names)}\n" + f"0{',1' * (columns - 1)}\n1{',1' * (columns - 1)}\n")
    assert f"wide.csv has {columns:,} columns; at most 1,000" in refused(capsys, "check-log", path)
    assert "columns; at most 1,000" in refused(capsys, "check-log", path, "--robot", "alten")
    path.write_text("t,u1\n" + f"0{',1' * (columns - 1)}\n")
    assert "line 2: the row has 1001 cells" in refused(capsys, "check-log", path)


@given(st.floats(0.0, 1e12), st.floats(1e-12, 1e3), st.integers(1, 1000))
def test_rows_are_counted_or_refused(span, interval, columns):
    try:
        rows = rows_between(span, interval, columns=columns, source="It")
    except InputError:
        assert span / interval > min(MOST_CELLS // columns, MOST_ROWS)
    else:
        assert rows * columns <= MOST_CELLS
        assert abs(rows - span / interval) <= 1.0
