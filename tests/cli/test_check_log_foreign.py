"""`ballbot check-log` on foreign files: what is undetermined exits with code 2, and --columns names the columns."""

import json

import numpy as np
import pytest

from ballbot.cli.main import main
from ballbot.log.mapping_file import dead_band_findings
from ballbot.robot.file import robot_text
from tests.support.foreign_log_examples import Habits, columns_of, small_robot, swaying_log, write_foreign


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with the robot, its log, and that log without names of units for its commands."""
    path = tmp_path_factory.mktemp("foreign")
    (path / "robot.toml").write_text(robot_text(small_robot()))
    columns = columns_of(swaying_log(), Habits())
    write_foreign(path / "run.txt", columns, Habits())
    write_foreign(path / "bare.txt", columns, Habits(names=()))
    still = {name: values for name, values in columns.items() if not name.startswith("u")}
    random = np.random.default_rng(0)
    still |= {f"u{i}": random.standard_normal(len(columns["t_now"])) for i in (1, 2, 3)}
    write_foreign(path / "unrelated.txt", still, Habits())
    return path


def test_a_log_whose_mapping_is_certain_suggests_the_next_command(folder, capsys):
    out = folder / "checked"
    words = ["check-log", str(folder / "run.txt"), "--robot", str(folder / "robot.toml"), "--out", str(out)]
    assert main([*words, "--dead-band", "0"]) == 0
    shown = capsys.readouterr().out
    assert "Next: ballbot identify" in shown
    results = json.loads((out / "results.json").read_text())
    assert results["undetermined"] == []
    assert all(max(one["confidence"], one["harmless"]) >= 0.9 for one in results["conclusions"])
    assert {"name", "value", "confidence", "evidence", "alternatives"} <= set(results["conclusions"][0])
    assert (out / "log.csv").exists()
    assert "complete" not in (out / "mapping.toml").read_text()


def test_what_cannot_be_determined_exits_with_two_and_a_line_to_fill_in(folder, capsys):
    out = folder / "asked"
    arguments = [
        "check-log",
        str(folder / "unrelated.txt"),
        "--robot",
        str(folder / "robot.toml"),
        "--out",
        str(out),
    ]
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert "cannot determine: " in printed.err
    assert str(out / "mapping.toml") in printed.err
    assert "Next:" not in printed.out
    text = (out / "mapping.toml").read_text()
    assert "# cannot determine: " in text
    assert "complete = false" in text
    assert not (out / "log.csv").exists()
    assert main(["check-log", str(folder / "unrelated.txt"), "--mapping", str(out / "mapping.toml")]) == 2
    assert "the mapping is not complete" in capsys.readouterr().err


def test_columns_names_those_of_a_file_without_a_header(folder, capsys):
    names = "_,t,u1,u2,u3,roll_deg,pitch_deg,yaw_deg,psi_1,psi_2,psi_3"
    arguments = ["check-log", str(folder / "bare.txt"), "--robot", str(folder / "robot.toml"), "--columns"]
    assert main([*arguments, names, "--dead-band", "0"]) == 0
    assert "by their names" in " ".join(capsys.readouterr().out.split())
    assert main([*arguments, "t,roll"]) == 2
    assert "has 11 columns, but 2 names were given" in capsys.readouterr().err


def test_dead_band_is_for_a_foreign_file_and_a_duty(folder, capsys):
    arguments = ["check-log", str(folder / "run.txt"), "--dead-band"]
    assert main([*arguments, "0.03"]) == 2
    assert "--dead-band is for a foreign table" in capsys.readouterr().err
    assert main([*arguments, "3", "--robot", str(folder / "robot.toml")]) == 2
    assert "must be a duty from 0 to below 1" in capsys.readouterr().err


def test_a_dead_band_that_is_not_given_counts_as_less_dry_friction(folder):
    out = folder / "not_given"
    words = ["check-log", str(folder / "run.txt"), "--robot", str(folder / "robot.toml"), "--out", str(out)]
    assert main(words) == 0
    found = {one["name"]: one for one in json.loads((out / "results.json").read_text())["conclusions"]}
    assert found["dead band"]["value"] == "counted as less dry friction"
    mapping = out / "mapping.toml"
    assert "# dead_band = 0.0 " in mapping.read_text()
    # with this mapping, commands say so, and no longer once it is stated
    (finding,) = dead_band_findings([mapping, None])
    assert (finding.code, finding.severity, finding.where.file) == ("dead-band", "warning", str(mapping))
    mapping.write_text(mapping.read_text().replace("# dead_band = ", "dead_band = "))
    assert dead_band_findings([mapping]) == ()


def test_a_given_dead_band_stands_in_the_mapping(folder):
    out = folder / "given"
    words = ["check-log", str(folder / "run.txt"), "--robot", str(folder / "robot.toml"), "--out", str(out)]
    assert main([*words, "--dead-band", "0.02"]) == 0
    assert "dead_band = 0.02 " in (out / "mapping.toml").read_text()
    assert json.loads((out / "results.json").read_text())["dead_band"] == 0.02


def test_a_voltage_has_no_dead_band(folder):
    """A mapping of voltages is one of duties of the supply, to which nothing is added: no command asks or warns."""
    columns = columns_of(swaying_log(), Habits())
    volts = {name: 12.0 * values for name, values in columns.items() if name.startswith("u")}
    named = {name.replace("u", "voltage") + "_V": values for name, values in volts.items()}
    kept = {name: values for name, values in columns.items() if name not in volts}
    path = write_foreign(folder / "volts.txt", kept | named, Habits())
    out = folder / "volts"
    words = ["check-log", str(path), "--robot", str(folder / "robot.toml"), "--out", str(out)]
    main(words)
    results = json.loads((out / "results.json").read_text())
    mapping = out / "mapping.toml"
    assert "voltage" in mapping.read_text()
    assert "dead band" not in [one["name"] for one in results["conclusions"]]
    assert dead_band_findings([mapping]) == ()


def shown_for(folder, capsys, columns) -> str:
    """Return what check-log says at its end on a foreign log with these columns, which it refuses."""
    path = write_foreign(folder / "changed.txt", columns, Habits())
    assert main(["check-log", str(path), "--robot", str(folder / "robot.toml"), "--dead-band", "0"]) == 2
    return capsys.readouterr().err


def test_commands_without_a_sign_are_refused_and_not_asked_for_order_and_signs(folder, capsys):
    columns = columns_of(swaying_log(), Habits())
    duties = {name: columns[name] for name in ("u1", "u2", "u3")}
    columns |= {name: np.abs(values) for name, values in duties.items()}
    said = shown_for(folder, capsys, columns)
    assert "the commands u1, u2, u3 never change sign" in said
    assert "cannot determine" not in said
    columns |= {f"dir{name[1]}": (values > 0.0) + 1.0 for name, values in duties.items()}
    assert "(is it in dir1, dir2, dir3?)" in shown_for(folder, capsys, columns)


@pytest.mark.parametrize(("zero", "full"), [(300.0, 127.0), (1750.0, 500.0)])
def test_commands_about_an_unusual_number_are_named_with_it(folder, capsys, zero, full):
    columns = columns_of(swaying_log(), Habits())
    columns |= {f"u{i}": np.round(zero + full * columns[f"u{i}"]) for i in (1, 2, 3)}
    said = shown_for(folder, capsys, columns)
    found = float(said.partition("whose zero is about ")[2].partition(":")[0])
    # the median of commands that balance is off by a hundredth of their range
    assert found == pytest.approx(zero, abs=0.01 * full)


def test_missing_cells_and_slow_rows_are_named_where_commands_show_no_effect(folder, capsys):
    columns = columns_of(swaying_log(), Habits())
    random = np.random.default_rng(0)
    columns |= {f"u{i}": random.standard_normal(len(columns["u1"])) for i in (1, 2, 3)}
    columns["theta_x"] = np.where(random.random(len(columns["u2"])) < 0.25, np.nan, columns["theta_x"])
    said = shown_for(folder, capsys, columns)
    assert "order and signs of the commands" in said
    assert "% of the rows lack a value" in said
    slow = {name: values[::8] for name, values in columns_of(swaying_log(), Habits()).items()}
    slow |= {f"u{i}": random.standard_normal(len(slow["u1"])) for i in (1, 2, 3)}
    said = shown_for(folder, capsys, slow)
    assert "rows come only every 92 ms" in said
