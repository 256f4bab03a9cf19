"""References as files: what is written is what is followed."""

import numpy as np
import pytest

from ballbot import Log
from ballbot.cli.main import main
from ballbot.control.references import read_reference, reference_from, reference_text, square, write_reference
from ballbot.errors import InputError


def written(path):
    times = 0.005 * np.arange(41, dtype=np.float64)
    poses = np.random.default_rng(3).normal(size=(41, 3))
    write_reference(times, poses, path)
    return times, poses


def test_a_row_holds_until_the_next_and_the_last_one_from_there_on(tmp_path):
    times, poses = written(tmp_path / "ref.csv")
    reference = read_reference(tmp_path / "ref.csv")
    for k in (0, 7, 40):
        for late in (0.0, 1e-12, -1e-12, 0.004):  # rounding of k * 0.005 must not give the row before
            assert (reference(times[k] + late)[[0, 1, 4]] == poses[k]).all()
    assert (reference(9.0)[[0, 1, 4]] == poses[-1]).all()
    assert (reference(0.1)[[2, 3, 5, 6, 7, 8, 9]] == 0.0).all()


def test_a_text_reads_back_to_the_same_bits(tmp_path):
    _, poses = written(tmp_path / "ref.parquet")
    (tmp_path / "again.csv").write_text(reference_text(tmp_path / "ref.parquet"))
    again = Log.read(tmp_path / "again.csv")
    assert (np.column_stack([again[f"ref_{name}"] for name in ("x", "y", "psi")]) == poses).all()


def test_names_and_files_are_told_apart(tmp_path):
    written(tmp_path / "square.csv")
    assert (reference_from("square")(9.0) == square()(9.0)).all()
    assert reference_from(str(tmp_path / "square.csv"))(0.0)[0] != 0.0
    with pytest.raises(InputError, match="There is no reference 'sqare'"):
        reference_from("sqare")
    with pytest.raises(InputError, match="cannot be read"):
        reference_from(str(tmp_path / "none.csv"))


def test_a_file_without_a_column_or_value_is_refused(tmp_path):
    t = np.arange(3.0)
    Log({"t": t, "ref_x": t, "ref_y": t}).write(tmp_path / "a.csv")
    Log({"t": t, "ref_x": t, "ref_y": t, "ref_psi": np.array([0.0, np.nan, 0.0])}).write(tmp_path / "b.csv")
    with pytest.raises(InputError, match="no column ref_psi"):
        read_reference(tmp_path / "a.csv")
    with pytest.raises(InputError, match="has no value at t = 1 s"):
        read_reference(tmp_path / "b.csv")


def test_a_recorded_folder_has_its_reference_and_can_be_made_again(tmp_path, monkeypatch):
    pytest.importorskip("mujoco")
    _, poses = written(tmp_path / "mine.csv")
    options = ["--reference", str(tmp_path / "mine.csv"), "--duration", "0.1", "--out", str(tmp_path / "one")]
    assert main(["record", "nominal", *options]) == 0
    log = Log.read(tmp_path / "one" / "log.csv")
    assert (log["ref_psi"] == poses[: len(log), 2]).all()
    command = (tmp_path / "one" / "record.toml").read_text().split('command = "ballbot ')[1].split('"')[0]
    monkeypatch.chdir(tmp_path / "one")
    assert main(command.split()) == 0
    assert (tmp_path / "one" / "log.csv").read_bytes() == (
        tmp_path / "one" / "again" / "log.csv"
    ).read_bytes()
