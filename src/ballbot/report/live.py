"""A live robot as tables and lines: its samples while it runs, its wiring check, and two controllers in turn."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from ballbot.control.safety import StopReason
from ballbot.firmware.records import SelfTestOutcome
from ballbot.link.live import Sample
from ballbot.link.messages import State
from ballbot.link.session import stop_reason
from ballbot.link.wiring import Turn, WiringCheck
from ballbot.report.blocks import Sheet, table
from ballbot.report.console import finding_line
from ballbot.rounding import percent, unit_heading
from ballbot.workflows.alternation import Alternation, PairedGain
from ballbot.workflows.controller_prediction import SHOWN

_SELF_TESTS = {
    SelfTestOutcome.NOT_RUN: "not run",
    SelfTestOutcome.RUNNING: "running",
    SelfTestOutcome.PASSED: "passed",
    SelfTestOutcome.HOLD_UPRIGHT: "waits for the robot upright",
    SelfTestOutcome.TILT_FORWARD: "waits for a tilt forward",
    SelfTestOutcome.TILT_LEFT: "waits for a tilt to the left",
    SelfTestOutcome.TURN_LEFT: "waits for a turn to the left",
    SelfTestOutcome.IMU_PASSED: "the IMU's axes are right",
    SelfTestOutcome.IMU_AXES: "failed (the IMU's axes)",
    SelfTestOutcome.IMU_GYRO: "failed (the gyro)",
}


def sample_line(sample: Sample, *, torque_limit: float) -> str:
    """Return a sample in one line."""
    x, y, psi = sample.state[[0, 1, 4]]
    return (
        f"{sample.t:.1f} s, at ({x:+.3f}, {y:+.3f}) m, psi {math.degrees(psi):+.1f} degrees, "
        f"{1e3 * _distance(sample):.0f} mm from the reference, lean {math.degrees(_lean(sample)):.1f} degrees, "
        f"torque {percent(_share(sample, torque_limit))} of the limit"
    )


def sample_table(sample: Sample, *, torque_limit: float) -> Sheet:
    """Return a sample as a table for a terminal."""
    x, y, psi = sample.state[[0, 1, 4]]
    rows = [
        ("time", f"{sample.t:.1f} s"),
        ("position", f"{x:+.3f}  {y:+.3f} m"),
        ("heading", f"{math.degrees(psi):+.1f} degrees"),
        ("distance from the reference", f"{1e3 * _distance(sample):.0f} mm"),
        ("lean", f"{math.degrees(_lean(sample)):.2f} degrees"),
        ("torques", "  ".join(f"{one:+.2f}" for one in sample.torques) + " N m"),
        ("largest torque", f"{percent(_share(sample, torque_limit))} of the limit"),
    ]
    return table("Armed (Ctrl-C disarms)", ("", ""), rows)


def bench_line(sample: Sample, *, torque_limit: float) -> str:
    """Return a sample of a held robot in one line."""
    speeds = " ".join(f"{one:+.1f}" for one in sample.wheel_speeds)
    torques = " ".join(f"{one:+.2f}" for one in sample.torques)
    return (
        f"{sample.t:.1f} s, torques {torques} N m ({percent(_share(sample, torque_limit))} of the limit), "
        f"wheel speeds {speeds} rad/s"
    )


def bench_table(sample: Sample, *, torque_limit: float) -> Sheet:
    """Return a sample of a held robot as a table for a terminal."""
    rows = [
        ("time", f"{sample.t:.1f} s"),
        ("torques", "  ".join(f"{one:+.2f}" for one in sample.torques) + " N m"),
        ("largest torque", f"{percent(_share(sample, torque_limit))} of the limit"),
        ("wheel speeds", "  ".join(f"{one:+.2f}" for one in sample.wheel_speeds) + " rad/s"),
    ]
    return table("Armed and held (Ctrl-C disarms)", ("", ""), rows)


@dataclass(frozen=True, kw_only=True)
class View:
    """What a monitor shows of a sample: a line, or a table on a terminal; both take the torque limit [N m]."""

    line: SampleText
    table: SampleTable


class SampleText(Protocol):
    """Returns a sample in one line."""

    def __call__(self, sample: Sample, *, torque_limit: float) -> str: ...


class SampleTable(Protocol):
    """Returns a sample as a table."""

    def __call__(self, sample: Sample, *, torque_limit: float) -> Sheet: ...


BALANCING = View(line=sample_line, table=sample_table)
HELD = View(line=bench_line, table=bench_table)


def state_line(state: State, *, wheel_count: int) -> str:
    """Return a state in one line."""
    theta, phi, psi = np.degrees(state.attitude)
    stop = stop_reason(state)
    return (
        f"{'armed' if state.armed else 'disarmed'}, self-test {_self_test(state)}, "
        f"theta {theta:+.1f}, phi {phi:+.1f}, psi {psi:+.1f} degrees, counts "
        f"{' '.join(map(str, state.wheel_counts[:wheel_count].tolist()))}"
        + (f", stopped: {_words(stop)}" if stop else "")
    )


def state_table(state: State, *, wheel_count: int) -> Sheet:
    """Return a state as a table for a terminal."""
    rows = [
        ("self-test", _self_test(state)),
        ("stop", _words(stop_reason(state))),
        ("theta, phi, psi", "  ".join(f"{one:+7.2f}" for one in np.degrees(state.attitude)) + " degrees"),
        ("gyro", "  ".join(f"{one:+7.3f}" for one in state.gyro) + " rad/s"),
        ("encoder counts", "  ".join(map(str, state.wheel_counts[:wheel_count].tolist()))),
        ("wheel speeds", "  ".join(f"{one:+7.2f}" for one in state.wheel_speeds[:wheel_count]) + " rad/s"),
    ]
    title = "Armed" if state.armed else "Disarmed"
    return table(f"{title} (Ctrl-C ends the monitor)", ("", ""), rows)


def _self_test(state: State) -> str:
    return _SELF_TESTS.get(SelfTestOutcome(state.self_test), f"failed (wheel {state.self_test_wheel})")


def _words(stop: StopReason | None) -> str:
    return "none" if stop is None else str(stop)


def _distance(sample: Sample) -> float:
    return float(np.hypot(*(sample.state[:2] - sample.reference[:2])))


def _lean(sample: Sample) -> float:
    return math.acos(min(1.0, math.cos(sample.state[2]) * math.cos(sample.state[3])))


def _share(sample: Sample, torque_limit: float) -> float:
    return float(np.abs(sample.torques).max()) / torque_limit


def wiring_parts(check: WiringCheck) -> Iterator[RenderableType]:
    """Yield a wiring check: what each sensor measured of each movement, and what is wrong."""
    yield Text("The wiring is right." if check.passed else "The wiring is not right.", style="bold")
    rows = [(one.movement.words, *_turn_cells(one)) for one in check.turns]
    yield table(
        "Turns about x, y, z, and of each wheel",
        ("the robot was", "attitude [deg]", "gyro [deg]", "wheels [deg]"),
        rows,
    )
    for finding in check.findings:
        yield finding_line(finding)


def wiring_results(check: WiringCheck) -> dict[str, object]:
    """Return what results.json holds of a wiring check."""
    return {
        "passed": check.passed,
        "lean": check.lean,
        "turns": [
            {
                "movement": one.movement.words,
                "attitude": one.attitude,
                "gyro": one.gyro,
                "wheels": one.wheels,
            }
            for one in check.turns
        ],
        "wheel_scales": check.wheel_scales,
    }


def _turn_cells(turn: Turn) -> tuple[str, str, str]:
    # zero is added to a rounded number so that it is never written as -0
    cells = (
        "  ".join(f"{one:.0f}" for one in np.round(np.degrees(values)) + 0.0) for values in _measured(turn)
    )
    attitude, gyro, wheels = cells
    return attitude, gyro, wheels


def _measured(turn: Turn) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return turn.attitude, turn.gyro, turn.wheels


_GAIN_NAMES = {name: one.words for name, one in SHOWN.items()} | {"torque_margin": "torque used"}


def alternation_parts(found: Alternation) -> Iterator[RenderableType]:
    """Yield two controllers in turn: every run, the factors with the drift removed, and the verdicts."""
    runs = range(1, len(found.performances) + 1)
    rows = [
        (
            unit_heading(shown.words, shown.unit),
            *(shown.shown(getattr(one, name)) for one in found.performances),
        )
        for name, shown in SHOWN.items()
    ]
    headings = ("quantity", *(f"{k} {'after' if k % 2 == 0 else 'before'}" for k in runs))
    yield table("Runs in turn", headings, rows)
    rows = [
        (
            _GAIN_NAMES[name],
            f"{gain.factor:.2f}",
            f"{gain.low:.2f} to {gain.high:.2f}",
            gain.verdict,
            f"{round(100.0 * (gain.drift - 1.0)):+d} %",
        )
        for name, gain in found.gains.items()
    ]
    yield table(
        "After over before, the drift removed",
        ("quantity", "factor", "95 % interval", "", "drift from run to run"),
        rows,
    )
    for k, one in enumerate(found.verdicts, start=1):
        yield Text(f"Run {2 * k} against the prediction: {one.recommendation}. {one.reason}")
    yield Text(conclusion(found), style="bold")


def alternation_results(found: Alternation) -> dict[str, object]:
    """Return what results.json holds of two controllers in turn."""
    return {
        "recommendation": found.recommendation,
        "conclusion": conclusion(found),
        "runs": found.performances,
        "gains": {name: _gain_results(gain) for name, gain in found.gains.items()},
        "verdicts": [
            {
                "recommendation": one.recommendation,
                "reason": one.reason,
                "outside": [quantity.name for quantity in one.outside],
            }
            for one in found.verdicts
        ],
    }


def _gain_results(gain: PairedGain) -> dict[str, object]:
    return {
        "factor": gain.factor,
        "interval": [gain.low, gain.high],
        "verdict": gain.verdict,
        "drift": gain.drift,
    }


def conclusion(found: Alternation) -> str:
    """Return the result of runs in turn in one or two sentences."""
    advice = f"{found.recommendation.capitalize()} the controller by the study's prediction."
    gain = found.gains.get("peak_error")
    if gain is None:
        return f"{advice} A run ended before it settled, so that the errors are not compared."
    size = f"The peak error is {gain.factor:.2f} times as large ({gain.low:.2f} to {gain.high:.2f})"
    if gain.verdict == "undecided":
        return f"{advice} {size}, which decides nothing; repeat the comparison with more --rounds."
    return f"{advice} {size}."


def counts_line(host: Sequence[int], robot: Sequence[int]) -> str | None:
    """Return a line on frames that either side refused, by the layers' counts; None if there are none."""
    if not (any(host) or any(robot)):
        return None
    return (
        f"Frames refused: {sum(host)} by this computer, {sum(robot)} by the robot; the cable, the baud rate or the "
        "radio loses bytes."
    )
