"""One log, several or several by name, in memory or in files: every function takes them alike."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st

from ballbot.errors import InputError
from ballbot.log import Log, as_logs

LOG = Log({"t": np.arange(3.0), "x": np.zeros(3)})
NAMES = st.text("abc123 _-", min_size=1, max_size=5).filter(lambda name: name.strip(" ") == name)


@pytest.fixture
def files(tmp_path):
    paths = [tmp_path / "square.csv", tmp_path / "hold.csv"]
    for path in paths:
        LOG.write(path)
    return paths


def test_one_log_has_no_name_and_one_file_its_stem(files):
    assert as_logs(LOG) == {"": LOG}
    assert as_logs([LOG]) == {"": LOG}
    for given_as in (files[0], str(files[0]), [files[0]], (str(files[0]),)):
        (name,) = found = as_logs(given_as)
        assert name == "square"
        assert found[name].names == ("t", "x")


def test_several_are_named_by_number_or_stem(files):
    assert list(as_logs([LOG, LOG])) == ["log 1", "log 2"]
    assert list(as_logs([LOG, *files])) == ["log 1", "square", "hold"]
    assert list(as_logs(iter(files))) == ["square", "hold"]
    assert list(as_logs(files[0].parent.glob("*.csv"))) == [
        path.stem for path in files[0].parent.glob("*.csv")
    ]


def test_a_log_csv_is_named_by_its_folder(tmp_path, monkeypatch):
    paths = [tmp_path / "one" / "log.csv", tmp_path / "two" / "log.csv"]
    for path in paths:
        path.parent.mkdir()
        LOG.write(path)
    assert list(as_logs(paths)) == ["one", "two"]
    monkeypatch.chdir(paths[0].parent)
    assert list(as_logs("log.csv")) == ["one"]


def test_names_that_recur_have_their_folders(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    paths = [Path("one/run.csv"), Path("two/run.csv")]
    for path in paths:
        path.parent.mkdir()
        LOG.write(path)
    assert list(as_logs(paths)) == [str(path.with_suffix("")) for path in paths]
    with pytest.raises(InputError, match="given twice"):
        as_logs([paths[0], paths[0]])


@pytest.mark.parametrize(
    ("given_as", "sentence"),
    [
        ([], "No log is given"),
        ({}, "No log is given"),
        (3, "object of type int; give a Log or the path"),
        ([LOG, None], "object of type NoneType"),
        ({"a": np.zeros(3)}, r"type ndarray.*makes a log of arrays"),
        (np.zeros((3, 2)), r"type ndarray.*makes a log of arrays"),
        ({1: LOG}, "A log is named 1"),
        ("nowhere.csv", "nowhere.csv cannot be read"),
    ],
)
def test_what_is_no_log_is_refused(given_as, sentence):
    with pytest.raises(InputError, match=sentence):
        as_logs(given_as)
