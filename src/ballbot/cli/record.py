"""`ballbot record`: a run of the twin, as files."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from rich.progress import Progress

from ballbot.cli.output import standard_output
from ballbot.control.file import read_controller
from ballbot.control.nominal import nominal_controller
from ballbot.control.references import named
from ballbot.robot import Robot
from ballbot.twin import Scenario, Twin
from ballbot.twin.recording import LogFormat, write_recording
from ballbot.twin.recording import record as record_run


def record(
    scenario: str,
    /,
    *,
    robot: str = "alten",
    reference: str = "square",
    duration: float = 40.0,
    seed: int = 1,
    compensation: Literal["none", "full", "partial"] = "none",
    controller: Path | None = None,
    format: LogFormat = "csv",
    out: Path,
) -> None:
    """Record a log from the twin, a MuJoCo robot with real rollers, sensors and faults.

    Example: ballbot record nominal --robot alten --reference square --duration 40 --seed 1 --out run1

    Parameters
    ----------
    scenario
        What is true of the twin and unknown to its controller: nominal, ideal or wide_rows.
    robot
        A preset's name or a robot file. Its friction is what the controller compensates, not what the twin has.
    reference
        Where the robot is asked to be: hold, square, change_pose, circle or figure_eight.
    duration
        How long [s].
    seed
        Equal seeds give equal recordings, bit for bit.
    compensation
        What the controller does about the friction in the robot's file.
    controller
        A controller file, in place of the nominal gain and the compensation.
    format
        Of the log, the truth and the motion capture.
    out
        The folder to write into.
    """
    described = Robot.load(robot)
    twin = Twin(described, Scenario.named(scenario, described))
    chosen = (
        read_controller(controller, described)
        if controller
        else nominal_controller(described, compensation=compensation)
    )
    path = named(reference)
    console = standard_output()
    with Progress(console=console, disable=not console.is_terminal, transient=True) as bar:
        task = bar.add_task(f"recording {duration:g} s", total=1.0)

        def advance(share: float) -> None:
            bar.update(task, completed=share)

        run = record_run(twin, chosen, path, duration=duration, seed=seed, progress=advance)
    for written in write_recording(run, out, reference_name=reference, log_format=format):
        console.print(str(written), soft_wrap=True)
    if run.log.ended:
        console.print(f"The run ended early: {run.log.ended}.", soft_wrap=True)
