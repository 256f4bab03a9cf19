"""Wrong logs of the bench are stopped with their cause, correct ones pass: sweeps of free wheels, and the ball."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot import Log, Robot
from ballbot.cli.main import main
from ballbot.identification.bench_checks import encoder_findings, sweep_findings, upside_down_findings
from ballbot.identification.driveline import friction_of, sweeps_of
from ballbot.simulation.driveline import Driveline, TorqueSpeedCurve, simulate_driveline

ALTEN = Robot.load("alten")
SAMPLE_TIME = 5e-3
TORQUES, SPEEDS = ("u1", "u2", "u3"), ("wheel1_dot", "wheel2_dot", "wheel3_dot")
BALL = ("ball_omega_x", "ball_omega_y", "ball_omega_z")
Columns = dict[str, NDArray[np.float64]]
Change = Callable[[Columns], Columns]


def swept(robot: Robot, *, phase: float = 0.4) -> Columns:
    """Return the columns of a sweep: sines of torque, each wheel's a little later, and speeds with noise."""
    t = np.arange(8000) * SAMPLE_TIME
    columns: Columns = {"t": np.asarray(t, dtype=np.float64)}
    limit = TorqueSpeedCurve(no_load_speed=27.6, stall_torque=200.0)
    random = np.random.default_rng(1)
    for wheel in range(robot.wheel_count):
        torque = np.sin(2.0 * np.pi * t / 20.0 - phase * wheel)
        line = Driveline(
            inertia=Driveline.of_wheel(robot, wheel).inertia,
            friction=friction_of(np.array([0.014, 0.1, 0.05, 0.6, 1.0])),
            speed_limit=limit,
        )
        speed = simulate_driveline(line, torque[:-1], sample_time=SAMPLE_TIME).speeds
        columns[f"u{wheel + 1}"] = torque
        # noise of an encoder's differences
        columns[f"wheel{wheel + 1}_dot"] = np.append(0.0, speed) + 0.02 * random.standard_normal(len(t))
    return columns


@pytest.fixture(scope="module")
def sweep() -> Columns:
    return swept(ALTEN)


@pytest.fixture(scope="module")
def ball(shared_data: Path) -> Columns:
    log = Log.read(shared_data / "bbr" / "upside_down.csv").between(0.0, 20.0)
    return {name: log[name] for name in ("t", *TORQUES, *SPEEDS, *BALL)}


def times(factor: float, *names: str) -> Change:
    return lambda columns: {name: factor * columns[name] for name in names}


def exchanged(first: str, second: str) -> Change:
    return lambda columns: {first: columns[second], second: columns[first]}


def noise(*names: str) -> Change:
    return lambda columns: {
        name: np.random.default_rng(i).standard_normal(len(columns["t"])) for i, name in enumerate(names)
    }


def frozen(*names: str, row: int) -> Change:
    """Return a change that repeats one row's values for two seconds."""

    def change(columns: Columns) -> Columns:
        held = {name: columns[name].copy() for name in names}
        for values in held.values():
            values[row : row + 400] = values[row]
        return held

    return change


#: what becomes of a sweep, and the finding with the start of its text
WRONG_SWEEPS: dict[str, tuple[Change, str, str]] = {
    "all torques negated": (times(-1.0, *TORQUES), "torque-sign", "The motion shows -1, -1 and -1 times"),
    "one torque negated": (times(-1.0, "u2"), "torque-sign", "The motion shows 1, -1 and 1 times"),
    "two torques exchanged": (exchanged("u2", "u3"), "torque-scale", "The motion shows 1, -0.2"),
    "torques in mN m": (times(1e3, *TORQUES), "torque-scale", "The motion shows 0.001, 0.001 and 0.001"),
    "dead motor": (times(0.0, "wheel2_dot"), "torque-scale", "The motion shows 1, 0 and 1 times"),
    "frozen encoder": (frozen("wheel3_dot", row=700), "stuck", "wheel3_dot repeats one value for 2"),
}


@pytest.mark.parametrize(("change", "code", "says"), WRONG_SWEEPS.values(), ids=WRONG_SWEEPS)
def test_wrong_sweeps_are_stopped_with_their_cause(sweep, change, code, says):
    findings = sweep_findings(ALTEN, sweeps_of(ALTEN, Log(sweep | change(sweep))))
    assert any(one.text.startswith(says) for one in findings if (one.code, one.severity) == (code, "error"))


@pytest.mark.parametrize(("preset", "phase"), [("alten", 0.0), ("alten", 0.4), ("cmu", 0.4)])
def test_correct_sweeps_pass(preset: str, phase: float) -> None:
    robot = Robot.load(preset)
    assert sweep_findings(robot, sweeps_of(robot, Log(swept(robot, phase=phase)))) == ()


def test_the_shared_sweep_passes(shared_data: Path) -> None:
    log = Log.read(shared_data / "bbr" / "driveline_sweep.csv")
    assert sweep_findings(ALTEN, sweeps_of(ALTEN, log)) == ()


#: what becomes of a log of the ball, and the finding with a part of its text
WRONG_BALLS: dict[str, tuple[Change, str, str]] = {
    "all torques negated": (times(-1.0, *TORQUES), "torque-sign", "The motion shows -"),
    "torques in mN m": (times(1e3, *TORQUES), "torque-scale", "The torques look like mN m"),
    "dead motor": (noise("u2"), "torque-scale", "0 if it was not logged or its motor is dead"),
    "random torques": (noise(*TORQUES), "torque-scale", "columns of another log"),
    "ball's x negated": (
        times(-1.0, BALL[0]),
        "ball-omega",
        "are (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0) and (0.0",
    ),
    "ball's x and y exchanged": (
        exchanged(BALL[0], BALL[1]),
        "ball-omega",
        "are (0.0, 1.0, 0.0), (1.0, 0.0, 0.0) and (0.0, 0.0, 1.0) times",
    ),
    "ball in rpm": (times(30.0 / np.pi, *BALL), "ball-omega", "ball_omega looks like rpm"),
    "camera lost the ball": (frozen(*BALL, row=1000), "stuck", "ball_omega_z repeat one value for 2 s"),
}


@pytest.mark.parametrize(("change", "code", "says"), WRONG_BALLS.values(), ids=WRONG_BALLS)
def test_wrong_logs_of_the_ball_are_stopped_with_their_cause(ball, change, code, says):
    findings = upside_down_findings(ALTEN, Log(ball | change(ball)))
    assert any(says in one.text for one in findings if (one.code, one.severity) == (code, "error")), findings


@pytest.mark.parametrize("without", [(), SPEEDS], ids=["with encoders", "without"])
def test_correct_logs_of_the_ball_pass(ball: Columns, without: tuple[str, ...]) -> None:
    log = Log({name: values for name, values in ball.items() if name not in without})
    assert upside_down_findings(ALTEN, log) == ()


def test_axes_of_the_ball_show_in_the_torques_without_encoders(ball: Columns) -> None:
    log = Log({name: ball[name] for name in ("t", *TORQUES, *BALL)} | times(-1.0, BALL[1])(ball))
    (found,) = upside_down_findings(ALTEN, log)
    assert found.severity == "error"
    assert "the ball's axes exchanged" in found.text


def test_estimated_radii_relax_the_encoder_check(ball: Columns) -> None:
    log = Log(ball | times(1.3, *SPEEDS)(ball))
    assert encoder_findings(ALTEN, log) != ()
    assert encoder_findings(ALTEN, log, like=(0.4, 2.5)) == ()


def test_the_command_stops_before_it_works(ball, tmp_path, capsys):
    angles = {f"wheel{i}": np.cumsum(ball[f"wheel{i}_dot"]) * SAMPLE_TIME for i in (1, 2, 3)}
    file, out = tmp_path / "up.csv", tmp_path / "out"
    Log(ball | angles | times(-1.0, *BALL)(ball)).write(file)
    assert main(["identify-geometry", "alten", "--upside-down", str(file), "--out", str(out)]) == 2
    message = capsys.readouterr().err
    assert "have the opposite sign" in message
    assert message.endswith("To continue despite this: --accept ball-omega.\n")
    assert not out.exists()
