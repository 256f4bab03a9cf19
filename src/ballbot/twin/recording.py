"""A recorded run of the twin: what a real robot would have logged, what was true, what cameras saw.

log                  what a real robot would have logged
truth                the same rows as they were
motion_capture       the cameras' view, in their own frame and time; not on the bench

`twin_findings` says whether the twin can simulate a robot and the nominal controller balance it: what `ballbot record`
would refuse.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from typing import Literal

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.presets import nominal_controller
from ballbot.control.references import Reference
from ballbot.errors import InputError
from ballbot.estimation.interface import state_errors
from ballbot.findings import Finding
from ballbot.log import Log
from ballbot.progress import ProgressCallback, ignore_progress
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.twin.bench import Bench, multisine_torques, run_bench, sweep_torques
from ballbot.twin.mjcf import twin_mjcf
from ballbot.twin.motion_capture import MotionCapture
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import Twin

#: balancing along a reference; the thesis's two experiments with the robot held
Experiment = Literal["balance", "driveline_sweep", "upside_down"]

_BENCHES: dict[str, Bench] = {"driveline_sweep": "stand", "upside_down": "upside_down"}

#: how long an experiment is where nobody says [s]; the sweep has two periods of 62.83 s
DURATIONS: dict[Experiment, float] = {"balance": 40.0, "driveline_sweep": 125.66, "upside_down": 60.0}


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A run of the twin."""

    logs: Mapping[str, Log]  #: by the names above
    results: Mapping[str, object]  #: the run in numbers, SI units
    ended: str | None  #: why it stopped early


def record_balance(
    twin: Twin,
    controller: Controller,
    reference: Reference,
    *,
    duration: float,
    seed: int = 0,
    progress: ProgressCallback = ignore_progress,
) -> Recording:
    """Run the twin in closed loop and film it.

    Parameters
    ----------
    twin : Twin
    controller : Controller
    reference : function of time
        f(t) -> (10,), where the robot is asked to be.
    duration : float
        [s]
    seed : int
        Of the twin, its noise, and the cameras' frame, clock and noise.
    progress : callable, optional
        Called with the share that is done, from 0 to 1, from time to time.

    Raises
    ------
    InputError
        If the duration is not at least a sample, or the controller's sample time is not one of the twin's.
    """
    run = simulate(twin, controller, reference, duration=duration, seed=seed, progress=progress)
    film = MotionCapture.drawn(seed).film(run.truth(), ball_radius=twin.robot.ball.radius)
    logs = {"log": run.without_truth(), "truth": run.truth(), "motion_capture": film}
    return Recording(logs=logs, results=results(run), ended=run.ended)


def record_bench(
    robot: Robot,
    scenario: Scenario,
    experiment: Experiment,
    *,
    duration: float,
    seed: int = 0,
    progress: ProgressCallback = ignore_progress,
) -> Recording:
    """Drive the motors of the robot held on the bench; see `ballbot.twin.bench`."""
    if experiment == "driveline_sweep":
        torques = sweep_torques(robot, scenario, duration=duration)
    else:
        torques = multisine_torques(robot, scenario, duration=duration, seed=seed)
    run = run_bench(robot, scenario, torques, bench=_BENCHES[experiment], seed=seed, progress=progress)
    speeds = run.truth.wheel_speeds
    found = {"ended": None, "peak_wheel_speed": float(np.abs(speeds).max())}
    return Recording(logs={"log": run.log, "truth": run.truth}, results=found, ended=None)


def results(log: Log) -> dict[str, object]:
    """Return a balancing run in numbers.

    Parameters
    ----------
    log : Log
        With its truth.

    Returns
    -------
    dict
        `ended`: why it stopped early, or None; `peak_position_error`, `rms_position_error` [m]: true position
        from the reference; `estimation_errors`: of the on-board state, see `ballbot.estimation.interface`, the drift
        None where the run is shorter than a minute, and all of it where it has a single row.
    """
    truth = log.truth()
    error = np.hypot(truth["x"] - log["ref_x"], truth["y"] - log["ref_y"])
    return {
        "ended": log.ended,
        "peak_position_error": float(error.max()),
        "rms_position_error": float(np.sqrt(np.mean(error**2))),
        "estimation_errors": _estimation_errors(log),
    }


def _estimation_errors(log: Log) -> dict[str, float | None] | None:
    if len(log) < 2:
        return None
    errors = asdict(state_errors(log.t, log.states, log.truth().states))
    return {name: value if math.isfinite(value) else None for name, value in errors.items()}


def twin_findings(robot: Robot) -> tuple[Finding, ...]:
    """Return what `ballbot record nominal` would refuse of a robot; empty if it records it."""
    findings = []
    refusal = _refusal(lambda: _made(robot))
    if refusal:
        text = f"The twin cannot simulate this robot, so `ballbot record` refuses it: {refusal}"
        findings.append(Finding(code="robot-twin", severity="warning", text=text))
    refusal = _refusal(lambda: nominal_controller(robot))
    if refusal:
        text = f"No nominal controller can be designed for this robot: {refusal}"
        findings.append(Finding(code="robot-balance", severity="error", text=text))
    return tuple(findings)


def _refusal(attempt: Callable[[], object]) -> str:
    try:
        attempt()
    except InputError as error:
        return str(error)
    return ""


def _made(robot: Robot) -> object:
    scenario = Scenario.nominal(robot)
    # without MuJoCo, the document is all that can be looked at
    return Twin(robot, scenario) if find_spec("mujoco") else twin_mjcf(robot, scenario)
