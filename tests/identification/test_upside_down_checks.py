"""Wrong logs of the ball on the clamped robot are stopped with their cause; correct ones pass."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot import Log, Robot
from ballbot.cli.main import main
from ballbot.identification.bench_checks import encoder_findings, upside_down_findings

ALTEN = Robot.load("alten")
TORQUES, SPEEDS = ("u1", "u2", "u3"), ("wheel1_dot", "wheel2_dot", "wheel3_dot")
BALL = ("ball_omega_x", "ball_omega_y", "ball_omega_z")
Columns = dict[str, NDArray[np.float64]]
Change = Callable[[Columns], Columns]


@pytest.fixture(scope="module")
def columns(shared_data: Path) -> Columns:
    log = Log.read(shared_data / "bbr" / "upside_down.csv").between(0.0, 20.0)
    return {name: log[name] for name in ("t", *TORQUES, *SPEEDS, *BALL)}


def times(factor: float, *names: str) -> Change:
    return lambda columns: {name: factor * columns[name] for name in names}


def noise(*names: str) -> Change:
    return lambda columns: {
        name: np.random.default_rng(i).standard_normal(len(columns["t"])) for i, name in enumerate(names)
    }


def frozen(columns: Columns) -> Columns:
    held = {name: columns[name].copy() for name in BALL}
    for values in held.values():
        values[1000:1400] = values[1000]
    return held


#: what becomes of a log, and the finding with a part of its text
WRONG: dict[str, tuple[Change, str, str]] = {
    "all torques negated": (times(-1.0, *TORQUES), "torque-sign", "The motion shows -"),
    "torques in mN m": (times(1e3, *TORQUES), "torque-scale", "0.001 if the torques are in mN m"),
    "dead motor": (noise("u2"), "torque-scale", "0 if it was not logged or its motor is dead"),
    "random torques": (noise(*TORQUES), "torque-scale", "columns of another log"),
    "ball's x negated": (
        times(-1.0, BALL[0]),
        "ball-omega",
        "are (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0) and (0.0",
    ),
    "ball's x and y exchanged": (
        lambda columns: {BALL[0]: columns[BALL[1]], BALL[1]: columns[BALL[0]]},
        "ball-omega",
        "are (0.0, 1.0, 0.0), (1.0, 0.0, 0.0) and (0.0, 0.0, 1.0) times",
    ),
    "ball in rpm": (times(30.0 / np.pi, *BALL), "ball-omega", "(rpm are 9.5 rad/s"),
    "camera lost the ball": (frozen, "stuck", "ball_omega_z repeat one value for 2 s"),
}


@pytest.mark.parametrize(("change", "code", "says"), WRONG.values(), ids=WRONG)
def test_wrong_logs_are_stopped_with_their_cause(
    columns: Columns, change: Change, code: str, says: str
) -> None:
    findings = upside_down_findings(ALTEN, Log(columns | change(columns)))
    assert any(says in one.text for one in findings if (one.code, one.severity) == (code, "error")), findings


@pytest.mark.parametrize("kept", [SPEEDS, ()], ids=["with encoders", "without"])
def test_correct_logs_pass(columns: Columns, kept: tuple[str, ...]) -> None:
    log = Log({name: values for name, values in columns.items() if name not in SPEEDS or name in kept})
    assert upside_down_findings(ALTEN, log) == ()


def test_axes_of_the_ball_show_in_the_torques_without_encoders(columns: Columns) -> None:
    log = Log({name: columns[name] for name in ("t", *TORQUES, *BALL)} | times(-1.0, BALL[1])(columns))
    (found,) = upside_down_findings(ALTEN, log)
    assert found.severity == "error"
    assert "the ball's axes exchanged" in found.text


def test_estimated_radii_relax_the_encoder_check(columns: Columns) -> None:
    log = Log(columns | times(1.3, *SPEEDS)(columns))
    assert encoder_findings(ALTEN, log) != ()
    assert encoder_findings(ALTEN, log, like=(0.4, 2.5)) == ()


def test_the_command_stops_before_it_works(
    columns: Columns, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    angles = {f"wheel{i}": np.cumsum(columns[f"wheel{i}_dot"]) * 5e-3 for i in (1, 2, 3)}
    file, out = tmp_path / "up.csv", tmp_path / "out"
    Log(columns | angles | times(-1.0, *BALL)(columns)).write(file)
    assert main(["identify-geometry", "alten", "--upside-down", str(file), "--out", str(out)]) == 2
    told = capsys.readouterr().err
    assert "have the opposite sign" in told
    assert told.endswith("To continue despite this: --accept ball-omega.\n")
    assert not out.exists()
