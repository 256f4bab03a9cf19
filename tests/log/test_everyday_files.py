"""Files as people have them are read, with a finding on what is left out, or refused as what they are."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.checks import check
from ballbot.log.formats import is_foreign
from ballbot.log.formats.text import infer_text_table
from ballbot.log.mapping import parse_mapping
from ballbot.log.proposal import evaluate, propose
from ballbot.robot import Robot
from tests.support.log_examples import smooth_log, with_wheels

ALTEN = Robot.load("alten")
NAMES = ("t", "u1", "u2", "u3", "theta", "phi", "psi")


def rows(count: int = 60) -> list[list[str]]:
    log = smooth_log(rows=count)
    return [[f"{log[name][k]:.6f}" for name in NAMES] for k in range(count)]


def write(tmp_path: Path, header: str, lines: list[list[str]], *, end: str = "\n") -> Path:
    path = tmp_path / "log.csv"
    path.write_text("\n".join([header, *(",".join(line) for line in lines)]) + end)
    return path


def left_out(log: Log) -> list[str]:
    return [one.text for one in log.changes if one.code == "file"]


@pytest.mark.parametrize(
    ("header", "factor"),
    [
        ("# recorded on Monday\n# robot: alten\nt,u1,u2,u3,theta,phi,psi", 1.0),
        ("T,u1,u2,u3,theta,phi,psi", 1.0),
        ("t,u1,u2,u3,theta [deg],phi,psi", np.pi / 180.0),
        ("t [s],u1 [Nm],u2 (N m),u3,theta (mrad),phi [rad],psi", 1e-3),
    ],
)
def test_ballbots_names_are_ballbots(tmp_path, header, factor):
    path = write(tmp_path, header, rows())
    assert not is_foreign(path)
    log = Log.read(path)
    assert log.names == NAMES
    np.testing.assert_allclose(log["theta"], smooth_log(rows=60)["theta"] * factor, atol=1e-6)
    assert bool(left_out(log)) == ("[" in header or "T" in header)


@pytest.mark.parametrize("words", ["False", "BALANCING", "run, left"])
def test_a_column_of_words_is_left_out_and_named(tmp_path, words):
    path = write(tmp_path, ",".join([*NAMES, "mode"]), [[*row, f'"{words}"'] for row in rows()])
    log = Log.read(path)
    assert "mode" not in log
    assert any("mode" in text for text in left_out(log))
    table = infer_text_table(path)
    assert list(table.columns) == list(NAMES)
    assert any("mode" in text for text in table.notes)


def test_a_word_in_an_unused_column_is_not_in_the_way_and_one_in_a_used_column_is_refused(tmp_path):
    lines = [[*row, ""] for row in rows()]
    lines[7][-1] = "start"
    assert "note" not in Log.read(write(tmp_path, ",".join([*NAMES, "note"]), lines))
    lines[7][4] = "oops"
    with pytest.raises(InputError, match="line 9: 'oops' in column theta is not a number"):
        Log.read(write(tmp_path, ",".join([*NAMES, "note"]), lines))


@pytest.mark.parametrize("cut", [1, 3, 12, 16])
def test_a_last_row_that_is_cut_short_is_left_out(tmp_path, cut):
    path = write(tmp_path, ",".join(NAMES), rows(), end="")
    whole = Log.read(path)
    text = path.read_text().replace("-", "")
    path.write_text(text[: len(text) - 8 * 2 - cut])
    log = Log.read(path)
    assert len(log) == len(whole) - 1
    assert len(left_out(log)) == 1


def test_a_repeated_row_and_rows_without_a_time_are_left_out_and_counted(tmp_path):
    lines = rows()
    lines[20:20] = [lines[19]]
    lines[40] = [""] * len(NAMES)
    log = Log.read(write(tmp_path, ",".join(NAMES), lines))
    assert len(log) == 59
    assert [text.split(",")[0] for text in left_out(log)] == [
        "Left out: 1 row without a time",
        "Left out: 1 row with the time and all values of the row before",
    ]


def test_cells_in_quotes_may_have_decimal_commas(tmp_path):
    path = tmp_path / "log.csv"
    names = ["time_s", "roll_deg", "pitch_deg"]
    lines = [[f'"{0.005 * k:.3f}"'.replace(".", ","), '"1,25"', '"-0,5"'] for k in range(20)]
    path.write_text("\n".join([",".join(names), *(",".join(line) for line in lines)]))
    table = infer_text_table(path)
    assert list(table.columns) == names
    np.testing.assert_allclose(table.columns["time_s"], 0.005 * np.arange(20))
    assert set(table.columns["roll_deg"]) == {1.25}
    text = '[file]\ndecimal = "comma"\n[columns]\nt = "time_s"\nphi = "pitch_deg"\n'
    mapping = parse_mapping(text, source="mine")
    np.testing.assert_array_equal(Log.read(path, mapping=mapping)["phi"], -0.5)


def test_a_time_of_day_over_midnight_keeps_all_rows(tmp_path):
    lines = []
    for k, row in enumerate(rows(400)):
        seconds = (86399.0 + 0.005 * k) % 86400.0
        clock = f"{int(seconds // 3600):02d}:{int(seconds // 60) % 60:02d}:{seconds % 60:09.6f}"
        lines.append([clock, *row[1:], *(f"{np.sin(0.05 * k + i) * 8.0:.4f}" for i in range(3))])
    path = write(tmp_path, "time,u1,u2,u3,theta,phi,psi,wheel1,wheel2,wheel3", lines)
    found = propose(path, ALTEN)
    assert found.base.layout.rows is None
    np.testing.assert_allclose(np.diff(found.base.cut["time"]), 0.005, atol=2e-6)
    assert any("begins again" in one.text for one in found.findings)


def test_a_log_of_an_imu_alone_is_usable_for_align(tmp_path):
    t = 0.01 * np.arange(300)
    lines = [[f"{one:.3f}", *(f"{0.02 * np.sin(one + i):.4f}" for i in range(3))] for one in t]
    path = write(tmp_path, "t,roll_deg,pitch_deg,yaw_deg", lines)
    found = evaluate(propose(path, ALTEN))
    assert found.what == "IMU only"
    assert "align" in found.refusal


@pytest.mark.parametrize(
    "text", ["t,x\n0,1\n0,{}\n", "t,x\n0,1\n{},2\n3,4\n", "t,{}\n0,1\n2,3\n", 't,x\n0,"{}']
)
def test_a_cell_that_is_too_long_ends_in_a_sentence(tmp_path, text):
    path = tmp_path / "log.csv"
    path.write_text(text.format('"' + "a" * 140_000 + '"'))
    with pytest.raises(InputError, match=r"line \d: (a cell has more than|'a+'? in column)"):
        Log.read(path)


@pytest.mark.parametrize("moving", [(), ("u1", "u2", "u3"), ("theta", "phi")])
def test_a_log_at_rest_gives_no_warning_of_numpy(moving):
    log = with_wheels(smooth_log(rows=2000), ALTEN)
    still = {name: log[name] if name in ("t", *moving) else np.zeros(len(log)) for name in log.names}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = [one for one in check(Log(still), robot=ALTEN) if one.code == "constant"]
    together = found[0].text.startswith("No measurement and no torque changes")
    assert together == (found[0].where.columns == log.names[1:]) == (not moving)
