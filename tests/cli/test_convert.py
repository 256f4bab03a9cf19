"""`ballbot convert`: a log from format to format, and what it refuses."""

import numpy as np
import pytest

from ballbot.cli.main import main
from ballbot.log import Log


@pytest.fixture
def log() -> Log:
    t = 0.005 * np.arange(40)
    columns = {"t": t, "u1": np.sin(t), "theta": 0.01 * np.cos(t), "wheel1": 3.0 * t, "gyro_x": t**2}
    return Log({name: np.asarray(one, float) for name, one in columns.items()})


def test_a_log_converts_from_format_to_format_by_one_command(tmp_path, capsys, log):
    first = tmp_path / "run.csv"
    log.write(first)
    path = first
    for name in ("a.mat", "b.mcap", "c.csv", "d.parquet"):
        out = tmp_path / name
        assert main(["convert", str(path), str(out)]) == 0
        assert capsys.readouterr().out.splitlines()[1] == str(out)
        path = out
    again = Log.read(path)
    for column in log:
        np.testing.assert_array_equal(again[column], log[column])


def test_convert_refuses_and_explains(tmp_path, capsys, log):
    path = tmp_path / "run.csv"
    log.write(path)
    refusals = {(str(path),): "already exists", (str(tmp_path / "run.xls"),): ".parquet"}
    for words, reason in refusals.items():
        assert main(["convert", str(path), *words]) == 2
        assert reason in capsys.readouterr().err
