"""A run of a live robot: self-test, arming, the run, disarming, and the recording that becomes a log.

The recording (`ballbot.link.recorder`) is opened before the robot arms, so that a disk that cannot be written stops the
command and not the robot. Whatever ends the run, the robot is disarmed and the recording closed.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbot.errors import InputError
from ballbot.link.live import Commander, Ending, LiveRobot, Sample, log_columns
from ballbot.link.messages import ControllerPlace
from ballbot.link.operators import Operator
from ballbot.link.recorder import Recorder
from ballbot.log import Log


@dataclass(frozen=True, kw_only=True, eq=False)
class LiveRun:
    """What became of a run."""

    ending: Ending
    log: Log | None  #: None if the run ended before its first sample
    trouble: str | None  #: why the recording ends before the run, in one sentence


def recorded_run(
    robot: LiveRobot,
    commander: Commander,
    *,
    operator: Operator,
    controller: ControllerPlace,
    duration: float,
    ramp: float = 0.0,
    watch: Callable[[Sample], None],
    recording: Path | None = None,
) -> LiveRun:
    """Test and arm a robot, let it do what a commander says, disarm it, and return the log.

    Parameters
    ----------
    robot : LiveRobot
        Disarmed.
    commander : Commander
    operator : Operator
        Moves the robot for its self-test, and confirms that it may arm.
    controller : ControllerPlace
        Whose torques the robot obeys.
    duration : float
        [s]
    ramp : float
        Time over which the torque limit rises from zero [s].
    watch : callable
        Takes each sample.
    recording : Path, optional
        Where rows are kept while the robot runs; nowhere if it is not given.

    Raises
    ------
    InputError
        If the recording cannot be written, the self-test fails, arming is not confirmed, or the robot refuses.
    """
    columns = log_columns(robot.wheel_count)
    rows: list[Sequence[float]] = []
    robot.test(operator)
    with Recorder(recording, columns) if recording else nullcontext() as recorder:

        def record(row: Sequence[float]) -> None:
            rows.append(row)
            if recorder is not None:
                recorder.append(row)

        gc.collect()
        gc.freeze()  # a collection that walks all imported code takes longer than the robot waits
        try:
            robot.arm(operator.confirm_arming, controller=controller, ramp=ramp)
            ending = robot.run(commander, duration=duration, record=record, watch=watch)
        finally:
            gc.unfreeze()
            if recording and not rows:  # nothing to recover
                recording.unlink(missing_ok=True)
            robot.disarm()
    log = Log(dict(zip(columns, np.array(rows).T, strict=True))) if rows else None
    if log is not None and ending.early:
        log = Log(log.columns, ended=ending.text.removesuffix("."))
    return LiveRun(
        ending=ending,
        log=log,
        trouble=recorder.failure if recorder else None,
    )


def require_log(run: LiveRun) -> Log:
    """Return the log of a run; InputError if it ended before its first sample."""
    if run.log is None:
        raise InputError(run.ending.text)
    return run.log
