"""One log, several or several by name, in memory or in files: every function takes them alike."""

from pathlib import Path

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.log import Log, as_logs

LOG = Log({"t": np.arange(3.0), "x": np.zeros(3)})


@pytest.fixture
def files(tmp_path):
    paths = [tmp_path / "square.csv", tmp_path / "hold.csv"]
    for path in paths:
        LOG.write(path)
    return paths


def test_logs_are_named_by_number_stem_or_folder(files, tmp_path, monkeypatch):
    assert as_logs(LOG) == as_logs([LOG]) == {"": LOG}
    assert list(as_logs(str(files[0]))) == list(as_logs((files[0],))) == ["square"]
    assert list(as_logs([LOG, LOG])) == ["log 1", "log 2"]
    assert list(as_logs(iter([LOG, *files]))) == ["log 1", "square", "hold"]
    monkeypatch.chdir(tmp_path)
    paths = [Path(folder) / name for folder in ("one", "two") for name in ("log.csv", "run.csv")]
    for path in paths:
        path.parent.mkdir(exist_ok=True)
        LOG.write(path)
    assert list(as_logs([paths[0], paths[2]])) == ["one", "two"]  # a log.csv is named by its folder
    assert list(as_logs([paths[1], paths[3]])) == ["one/run", "two/run"]
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
