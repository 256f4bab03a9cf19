"""Wrong sweeps of free wheels are stopped with their cause; correct ones pass."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot import Log, Robot
from ballbot.identification.bench_checks import sweep_findings
from ballbot.identification.driveline import classical, sweeps_of
from ballbot.simulation.driveline import Driveline, TorqueSpeedCurve, simulate_driveline

ALTEN = Robot.load("alten")
SAMPLE_TIME = 5e-3
Columns = dict[str, NDArray[np.float64]]


def simulated(robot: Robot, *, period: float = 20.0, duration: float = 40.0, phase: float = 0.4) -> Columns:
    """Return the columns of a sweep: sines of torque, each wheel's a little later, and speeds with noise."""
    t = np.arange(round(duration / SAMPLE_TIME)) * SAMPLE_TIME
    columns: Columns = {"t": np.asarray(t, dtype=np.float64)}
    limit = TorqueSpeedCurve(no_load_speed=27.6, stall_torque=200.0)
    random = np.random.default_rng(1)
    for wheel in range(robot.wheel_count):
        torque = np.sin(2.0 * np.pi * t / period - phase * wheel)
        line = Driveline(
            inertia=Driveline.of_wheel(robot, wheel).inertia,
            friction=classical(np.array([0.014, 0.1, 0.05, 0.6])),
            speed_limit=limit,
        )
        speed = simulate_driveline(line, torque[:-1], sample_time=SAMPLE_TIME).speeds
        columns[f"u{wheel + 1}"] = torque
        # noise of an encoder's differences
        columns[f"wheel{wheel + 1}_dot"] = np.append(0.0, speed) + 0.02 * random.standard_normal(len(t))
    return columns


@cache
def good_sweep() -> Columns:
    """Return the columns of a sweep without a mistake; made when first needed, as it compiles."""
    return simulated(ALTEN)


TORQUES = ["u1", "u2", "u3"]


def times(factor: float, *names: str) -> Callable[[Columns], Columns]:
    return lambda columns: {name: factor * columns[name] for name in names}


def frozen(columns: Columns) -> Columns:
    speed = columns["wheel3_dot"].copy()
    first = int(np.argmax((speed > 10.0) & (speed < 20.0)))
    speed[first : first + 200] = speed[first]
    return {"wheel3_dot": speed}


#: what becomes of a sweep, and the finding with the start of its text
WRONG: dict[str, tuple[Callable[[Columns], Columns], str, str]] = {
    "all torques negated": (
        times(-1.0, *TORQUES),
        "torque-sign",
        "The motion shows -1, -1 and -1 times",
    ),
    "one torque negated": (times(-1.0, "u2"), "torque-sign", "The motion shows 1, -1 and 1 times"),
    "two torques exchanged": (
        lambda columns: {"u2": columns["u3"], "u3": columns["u2"]},
        "torque-scale",
        "The motion shows 1, -0.2",
    ),
    "torques in mN m": (
        times(1e3, *TORQUES),
        "torque-scale",
        "The motion shows 0.001, 0.001 and 0.001 times",
    ),
    "dead motor": (times(0.0, "wheel2_dot"), "torque-scale", "The motion shows 1, 0 and 1 times"),
    "frozen encoder": (frozen, "stuck", "wheel3_dot repeats one value for 1"),
}


@pytest.mark.parametrize(("change", "code", "says"), WRONG.values(), ids=WRONG)
def test_wrong_sweeps_are_stopped_with_their_cause(
    change: Callable[[Columns], Columns], code: str, says: str
) -> None:
    findings = sweep_findings(ALTEN, sweeps_of(ALTEN, Log(good_sweep() | change(good_sweep()))))
    texts = [one.text for one in findings if one.severity == "error" and one.code == code]
    assert any(text.startswith(says) for text in texts), findings


@pytest.mark.parametrize("phase", [0.0, 0.4])
@pytest.mark.parametrize("preset", ["alten", "cmu"])
def test_correct_sweeps_pass(preset: str, phase: float) -> None:
    robot = Robot.load(preset)
    assert sweep_findings(robot, sweeps_of(robot, Log(simulated(robot, phase=phase)))) == ()


def test_the_shared_sweep_passes(shared_data) -> None:
    log = Log.read(shared_data / "bbr" / "driveline_sweep.csv")
    assert sweep_findings(ALTEN, sweeps_of(ALTEN, log)) == ()
