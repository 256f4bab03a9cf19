"""References: their shape over time, that they ask for positions only, and their files."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.control import references
from ballbot.control.references import as_reference, read_reference, reference_text, square, write_reference
from ballbot.errors import InputError
from ballbot.log import Log

EVERY = {name: references.named_reference(name) for name in references.REFERENCES}
REST = [2, 3, 5, 6, 7, 8, 9]  # lean and all rates


@given(st.sampled_from(sorted(EVERY)), st.floats(0.0, 1e4))
def test_references_contain_only_position_and_heading(name, t):
    reference = EVERY[name](t)
    assert reference.shape == (10,)
    np.testing.assert_array_equal(reference[REST], 0.0)
    assert np.isfinite(reference).all()


def test_the_square_is_the_shared_logs_square(shared_data):
    log = Log.read(shared_data / "bbr" / "square_soft.csv")
    asked = np.array([references.square(side=0.5, period=32.0)(t) for t in log.t])
    # that log's clock was summed up from 5 ms steps, so some of its corners come one row late
    differ = np.any(asked != log.reference, axis=1)
    corners = np.abs(log.t / 8.0 - np.round(log.t / 8.0)) < 0.006 / 8.0
    assert not np.any(differ & ~corners)
    assert differ.sum() <= 12


def test_the_change_of_pose_is_the_shared_logs(shared_data):
    log = Log.read(shared_data / "bbr" / "thesis_step_soft.csv")
    asked = np.array([references.change_pose()(t) for t in log.t])
    # 1e-6: the log has seven digits
    np.testing.assert_allclose(asked, log.reference, atol=1e-6)


def test_a_square_turns_at_the_sample_though_the_clock_is_rounded():
    reference = references.square(side=1.0, period=4.0)
    # 1.0 comes out as 1.0000000000000007, 2.0 as 2.0000000000000013, ..
    clock = np.cumsum(np.full(400, 0.01))
    assert reference(clock[98])[0] == 0.0
    assert reference(clock[99])[0] == 1.0
    assert reference(1.0 - 1e-13)[0] == 1.0


def test_the_eight_crosses_itself_in_the_origin_and_fills_its_box():
    reference = references.figure_eight(length=2.0, width=1.0, period=8.0)
    path = np.array([reference(t)[:2] for t in np.linspace(0.0, 8.0, 801)])
    np.testing.assert_allclose(path.max(axis=0), [1.0, 0.5], rtol=1e-4)
    np.testing.assert_allclose(path.min(axis=0), [-1.0, -0.5], rtol=1e-4)
    np.testing.assert_allclose(path[[0, 400, 800]], 0.0, atol=1e-12)


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


def test_reference_names_and_files_are_distinguished(tmp_path):
    written(tmp_path / "square.csv")
    assert (as_reference("square")(9.0) == square()(9.0)).all()
    assert as_reference(str(tmp_path / "square.csv"))(0.0)[0] != 0.0
    assert references.named_reference("change-pose")(100.0)[4] == np.pi


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda _: as_reference("spiral"), "the names are hold, square, change_pose, circle, figure_eight"),
        (lambda _: references.square(period=0.0), "period is 0; it must be above zero"),
        (lambda _: references.change_pose(ramp=-1.0), "ramp is -1 s"),
        (lambda _: as_reference("sqare"), "There is no reference 'sqare'"),
        (lambda folder: as_reference(f"{folder}/none.csv"), "cannot be read"),
        (lambda folder: read_reference(folder / "a.csv"), "no column ref_psi"),
        (lambda folder: read_reference(folder / "b.csv"), "has no value at t = 1 s"),
    ],
)
def test_bad_references_end_in_a_sentence(make, sentence, tmp_path):
    t = np.arange(3.0)
    log = Log({"t": t, "ref_x": t, "ref_y": t})
    log.write(tmp_path / "a.csv")
    log.with_columns({"ref_psi": np.array([0.0, np.nan, 0.0])}).write(tmp_path / "b.csv")
    with pytest.raises(InputError, match=sentence):
        make(tmp_path)
