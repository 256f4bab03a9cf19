"""A run of a live robot by a command: its monitor, its recording, and the log and results in a folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from ballbot.cli.context import PAGE, CommandResult, open_result
from ballbot.cli.output import notice_output, standard_output
from ballbot.cli.robot_link import Connection, LinkOptions, Monitor
from ballbot.errors import InputError
from ballbot.file_formats import results_text
from ballbot.files import write_text
from ballbot.link.live import Commander, Sample
from ballbot.link.messages import ControllerPlace
from ballbot.link.recorder import SUFFIX, check_no_recording
from ballbot.link.runs import LiveRun, recorded_run, require_log
from ballbot.log import Log
from ballbot.report.live import bench_line, counts_line, live_run_report, sample_line
from ballbot.results import to_results

#: what a recorded run leaves in its folder
WRITTEN = (PAGE, "log.csv", "results.json")


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What a run is."""

    commander: Commander
    controller: ControllerPlace
    duration: float  #: longest, from arming on [s]
    ramp: float = 0.0  #: over which the torque limit rises from zero [s]
    held: bool = False  #: whether the robot is held, and does not balance


def record_run(
    connection: Connection,
    link: LinkOptions,
    plan: Plan,
    *,
    out: Path,
    inputs: list[Path],
    kept: Callable[[Log], Log],
    summary: Callable[[Log], Mapping[str, object]],
) -> None:
    """Make a run, and write its log and results into a folder.

    Parameters
    ----------
    connection : Connection
    link : LinkOptions
    plan : Plan
    out : Path
    inputs : list of Path
        The files that the run is made from.
    kept : callable
        Makes the log of the recorded one.
    summary : callable
        Gives the run in numbers.

    Raises
    ------
    InputError
        If the folder cannot be used, the robot does not arm, or the link is lost; a log until then is written.
    KeyboardInterrupt
        If the run was interrupted, once the log is written.
    """
    recording = out / f"log{SUFFIX}"
    check_no_recording(recording)
    with open_result(out, command="run", writes=WRITTEN, inputs=inputs, seed=link.seed) as result:
        made = make_run(connection, plan, recording=recording)
        log = kept(require_log(made))
        results = {
            "rows": len(log),
            "sample_time": connection.robot.sample_time,
            "ended": made.ending.kind,
            "reason": made.ending.text,
            **summary(log),
            "provenance": about_run(connection, link, result),
        }
        with result.replaced() as new:
            log.write(new / "log.csv")
            write_text(new / "results.json", results_text(results))
            page = live_run_report(
                log,
                link.described,
                balancing=not plan.held,
                ending=made.ending.text,
                about=about_words(connection, link),
                made=result.origin,
            )
            result.write_page(page, new)
        recording.unlink(missing_ok=True)
    try:
        finish(connection, made)
    finally:
        result.show_file("log.csv", PAGE)


def make_run(connection: Connection, plan: Plan, *, recording: Path | None = None) -> LiveRun:
    """Make a run, watched by the monitor; see `recorded_run`."""
    monitor, line = Monitor(standard_output()), bench_line if plan.held else sample_line

    def watch(sample: Sample) -> None:
        monitor.show(sample.t, lambda: line(sample, torque_limit=connection.robot.torque_limit))
        if connection.camera is not None:
            connection.camera.watch(sample.t)

    with monitor:
        return recorded_run(
            connection.robot,
            plan.commander,
            operator=connection.operator,
            controller=plan.controller,
            duration=plan.duration,
            ramp=plan.ramp,
            watch=watch,
            recording=recording,
        )


def about_words(connection: Connection, link: LinkOptions) -> str:
    """Return which robot it is, and where, in a sentence."""
    described = link.described
    name = "A robot" if described is None else f"The robot {described.name}"
    where = ", emulated on this computer" if connection.address == "emulated" else f" at {connection.address}"
    return f"{name}{where}."


def about_run(connection: Connection, link: LinkOptions, result: CommandResult) -> dict[str, object]:
    """Return the provenance of a log: how it was made, on which robot, with which parameters, in which session."""
    described = link.described
    return to_results(result.origin) | {
        "robot": described.name if described else None,
        "port": connection.address,
        "session": connection.robot.session_name,
        "parameters_sha256": sha256(connection.robot.parameters.tobytes()).hexdigest(),
    }


def finish(connection: Connection, made: LiveRun) -> None:
    """Print how a run ended.

    Raises
    ------
    InputError
        If the link was lost.
    KeyboardInterrupt
        If the run was interrupted.
    """
    if made.trouble:
        notice_output().print(made.trouble, style="yellow", soft_wrap=True)
    if made.ending.kind == "interrupt":
        raise KeyboardInterrupt("interrupted; the robot is disarmed.")
    if made.ending.kind == "link":
        raise InputError(made.ending.text)
    standard_output().print(made.ending.text, soft_wrap=True)
    refused = counts_line(connection.robot.session.counts.refused, connection.robot.refused_frames())
    if refused:
        notice_output().print(refused, style="yellow", soft_wrap=True)
