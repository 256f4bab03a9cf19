"""A recorded run of the twin: the log, what was true, what cameras saw, and all that made it.

log.csv              what a real robot would have logged
truth.csv            the same rows with the true state in place of the measured one
motion_capture.csv   the cameras' view, in their own frame and time
controller.toml      the controller that balanced
results.json         how far it strayed, and how far its sensors erred
record.toml          scenario, seed, reference, the cameras' frame and clock: how to make it again
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tomli_w

from ballbot.control.controller import Controller
from ballbot.control.file import write_controller
from ballbot.control.references import Reference
from ballbot.files import write_text
from ballbot.log import STATE_NAMES, Log
from ballbot.simulation.run import simulate
from ballbot.twin.motion_capture import MotionCapture
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import Twin

LogFormat = Literal["csv", "parquet"]

_HEADER = """\
# How this run of the twin was made. Equal values make an equal run, bit for bit.
# motion_capture: t_camera = (1 + clock_rate) t + clock_offset; p_camera = R_camera_world p + origin;
# rotation_wxyz is the quaternion of R_camera_world.

"""


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A run of the twin and what made it."""

    log: Log  #: measured state, and the true one in columns true_*
    motion_capture: Log  #: t, x, y, z, qw, qx, qy, qz in the cameras' frame and time
    cameras: MotionCapture
    scenario: Scenario
    controller: Controller
    seed: int


def record(
    twin: Twin,
    controller: Controller,
    reference: Reference,
    *,
    duration: float,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
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
        Where the duration is not at least a sample, or the controller's sample time is not one of the twin's.
    """
    log = simulate(twin, controller, reference, duration=duration, seed=seed, progress=progress)
    cameras = MotionCapture.drawn(seed)
    return Recording(
        log=log,
        motion_capture=cameras.film(log.truth(), ball_radius=twin.robot.ball.radius),
        cameras=cameras,
        scenario=twin.scenario,
        controller=controller,
        seed=seed,
    )


def write_recording(
    recording: Recording, folder: str | Path, *, reference_name: str, log_format: LogFormat = "csv"
) -> list[Path]:
    """Write a recording's files and return their paths; see the module for their names.

    Parameters
    ----------
    recording : Recording
    folder : str or Path
        Made where it is not there.
    reference_name : str
        What record.toml calls the reference.
    log_format : {"csv", "parquet"}
        Of the log, the truth and the motion capture.

    Raises
    ------
    InputError
        Where a file cannot be written.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    logs = {
        "log": recording.log.without_truth(),
        "truth": recording.log.truth(),
        "motion_capture": recording.motion_capture,
    }
    paths = [folder / f"{name}.{log_format}" for name in logs]
    for path, log in zip(paths, logs.values(), strict=True):
        log.write(path)
    write_controller(recording.controller, folder / "controller.toml")
    write_text(folder / "results.json", json.dumps(results(recording.log), indent=2) + "\n")
    write_text(folder / "record.toml", _HEADER + tomli_w.dumps(_description(recording, reference_name)))
    return [*paths, *(folder / name for name in ("controller.toml", "results.json", "record.toml"))]


def results(log: Log) -> dict[str, object]:
    """Return a simulated run in numbers.

    Parameters
    ----------
    log : Log
        With its truth.

    Returns
    -------
    dict
        `ended`: why it stopped early, or None; `peak_position_error`, `rms_position_error` [m]: true position
        from the reference; `sensor_rms_error`: of each measured state, SI units.
    """
    truth = log.truth()
    error = np.hypot(truth["x"] - log["ref_x"], truth["y"] - log["ref_y"])
    sensors = np.sqrt(np.mean((log.states - truth.states) ** 2, axis=0))
    return {
        "ended": log.ended,
        "peak_position_error": float(error.max()),
        "rms_position_error": float(np.sqrt(np.mean(error**2))),
        "sensor_rms_error": dict(zip(STATE_NAMES, sensors.tolist(), strict=True)),
    }


def _description(recording: Recording, reference_name: str) -> dict[str, object]:
    log = recording.log
    run = {
        "robot": recording.controller.robot.name,
        "seed": recording.seed,
        "reference": reference_name,
        "compensation": recording.controller.compensation,
        "duration": float(log.t[-1] - log.t[0]),
        "ended": log.ended or "at its time",
    }
    return {"run": run, "scenario": asdict(recording.scenario), "motion_capture": asdict(recording.cameras)}
