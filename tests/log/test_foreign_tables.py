"""Clocks and dialects of other people's logs are read, or refused by what helps; their sound twins are read."""

from pathlib import Path

import numpy as np
import pytest

from ballbot.cli.main import main
from ballbot.errors import InputError
from ballbot.identification.axis.record import AxisColumns, read_axis_record
from ballbot.log.pose import read_motion_capture
from ballbot.log.proposal import propose
from tests.support.foreign_tables import KINDS, ROBOT, outcome, pair_of


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", KINDS)
def test_file_of_a_kind_and_its_twin_are_read(tmp_path, kind, seed):
    file, twin = pair_of(kind, seed)
    result, words = outcome(file, tmp_path / "run.csv")
    assert (result, file.refusal in words) == ("refused" if file.refusal else "right", True), words
    assert outcome(twin, tmp_path / "twin.csv") == ("right", "")


#: by file: its rows and their usual interval [s]
CASES = {
    "sec_nanosec.csv": (300, 0.01),
    "bursts.csv": (300, 0.01),
    "matlab_timetable.csv": (300, 0.01),
    "foxglove_long.csv": (60, 0.01),
    "arduino_labels.csv": (100, 0.01),
    "bool_column.csv": (400, 0.005),
    "state_column.csv": (400, 0.005),
    "quoted_decimal_comma.csv": (300, 0.005),
    "sparse_two_rates.csv": (300, 0.005),
    "midnight.csv": (351, 0.005),
    "imu_only.csv": (600, 0.0102),
}


@pytest.fixture
def cases(shared_data: Path) -> Path:
    """Return the folder of inputs that users had trouble with, or skip the test without it."""
    folder = shared_data.parent / "cases"
    return folder if folder.is_dir() else pytest.skip(f"no inputs at {folder}")


@pytest.mark.parametrize("name", CASES)
def test_input_that_was_refused_is_read(cases, name):
    base = propose(cases / name, ROBOT).base
    assert (len(base.t), float(np.median(np.diff(base.t)))) == pytest.approx(CASES[name], abs=2e-5)


#: by file: the words after it, and what is said; `tests/log/test_everyday_files.py` remakes them
SAID = {
    "held_in_hands.txt": ("check-log --robot rob311", "held by hand"),
    "one_way_ramp.txt": (
        "check-log --robot rob311 --columns n,t,theta_x,theta_y,T1,T2,T3,phi_x,phi_y,phi_z,psi_1,psi_2,psi_3",
        "usable for identify-driveline",
    ),
    "ros1_header.bag": ("check-log --robot alten", "not a complete ROS 1 bag"),
    "units_in_header_native_names.csv": ("check-log --robot alten", "theta [deg] is read as theta"),
    "latin1_header.csv": ("check-log --robot alten", "as Latin-1, save it as UTF-8"),
    "bare_value.toml": ("check", 'write radius = { value = 0.11, unit = "m"'),
    "one_empty_cell.csv": ("check-log --robot alten", "2 of 479 values missing"),
    "u2_zero_from_8s.csv": ("check-log --robot alten", "u2: one value repeats for 23.9 s"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SAID)
def test_input_is_answered_by_what_is_wrong_with_it(cases, capsys, name):
    (command, *words), sentence = SAID[name][0].split(), SAID[name][1]
    main([command, str(cases / name), *words])
    said = capsys.readouterr()
    assert sentence in " ".join(f"{said.out} {said.err}".split())


def test_comments_are_no_header_and_names_are_given(cases):
    path = cases / "percent_comments.txt"
    with pytest.raises(InputError, match=r"no header.*--columns t,roll"):
        propose(path, ROBOT)
    with pytest.raises(InputError, match=r"no header.*--columns t,position,force"):
        read_axis_record(path, AxisColumns())
    record = read_axis_record(path, AxisColumns(columns="t,_,_,_,position,_,_,force,_,_"))
    assert record.sample_time == pytest.approx(0.01)


def test_export_of_motion_capture_is_read(cases):
    mocap = read_motion_capture(cases / "motive.csv")
    assert mocap.sample_time == pytest.approx(1.0 / 119.997491, rel=1e-4)
    wxyz = np.column_stack([mocap[name] for name in ("qw", "qx", "qy", "qz")])
    np.testing.assert_allclose(np.linalg.norm(wxyz, axis=1), 1.0, atol=1e-5)
    assert mocap["z"][0] == 1651.926598


def test_positions_of_an_export_are_converted_by_the_unit_in_their_names(cases, tmp_path):
    text = (cases / "motive.csv").read_text()
    named = text.replace(
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,", "Frame,Time (Seconds),X,Y,Z,W,X [mm],Y [mm],Z [mm],"
    )
    (tmp_path / "mocap.csv").write_text(named)
    assert read_motion_capture(tmp_path / "mocap.csv")["z"][0] == pytest.approx(1.651926598)
