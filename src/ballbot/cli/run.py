"""`ballbot run`: a live robot, from its wiring check to a comparison of two controllers on it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from hashlib import sha256
from pathlib import Path

import numpy as np
from cyclopts import App
from numpy.typing import NDArray

from ballbot.cli import options
from ballbot.cli.context import CommandResult, Content, open_result
from ballbot.cli.output import emit, notice_output, standard_output
from ballbot.cli.robot_link import Connection, LinkOptions, Monitor, Port, connected
from ballbot.control.file import read_controller
from ballbot.errors import InputError
from ballbot.firmware.export import check_belongs, export_controller
from ballbot.link.bench import bench_log, bench_parameters, check_balancing_parameters, stir, sweep_of
from ballbot.link.lines import bench_line, counts_line, sample_line
from ballbot.link.live import Commander, FollowReference, LiveRun, Sample, TorqueProgram, recorded_run
from ballbot.link.recorder import SUFFIX, check_no_recording
from ballbot.link.references import KEYBOARD, live_reference
from ballbot.link.wiring import check_turns, measure_turns
from ballbot.report.blocks import finding_line
from ballbot.report.comparison import alternation_report
from ballbot.report.run import live_run_report, wiring_report
from ballbot.results import to_results
from ballbot.robot import Robot
from ballbot.simulation.held_robot import SWEEP_PERIOD
from ballbot.workflows.alternation import MIN_RUNS, alternate
from ballbot.workflows.controller_prediction import check_controller, evaluate_log, read_prediction
from ballbot.workflows.metrics import SETTLE, Performance, performance_of, settled

ABOUT = """Run a live robot over a serial port: check it, record it, balance it, compare controllers on it.

Every command takes the robot's port, such as /dev/ttyACM0, or --emulated in its place.
docs/tutorials/hardware.md and docs/bring_up.md have the commands in the order in which a new robot needs them.

Example: ballbot run /dev/ttyACM0 --reference square --duration 32 --out run1

Example: ballbot run wiring --emulated
"""

run = App(name="run", help=ABOUT)


_LINK = LinkOptions()


@run.default
def balance(
    port: Port = None,
    /,
    *,
    link: LinkOptions = _LINK,
    controller: Path | None = None,
    lean: options.LeanLimit = 0.35,
    reference: str = "hold",
    duration: options.Positive = 30.0,
    ramp: float = 0.0,
    out: Path | None = None,
) -> None:
    """Balance a robot: self-test, arming after a confirmation at this terminal, a reference, a log, disarming.

    Ctrl-C disarms. While the robot runs, every row of the log is on the disk within 100 ms: of a run that was cut off,
    log.recording.csv stays.

    Example: ballbot run /dev/ttyACM0 --reference square --duration 32 --out run1

    Example: ballbot run --emulated --reference square --duration 32 --out run1

    Parameters
    ----------
    controller
        A controller file; needs --robot. It is sent if the robot has another one. If not given, the robot's own
        controller runs.
    reference
        hold, square, change_pose, circle, figure_eight, a file with t, ref_x, ref_y and ref_psi; keyboard (arrow keys,
        comma and full stop turn, e ends). It begins where the robot stands.
    duration
        Longest time from arming on [s].
    ramp
        Time over which the torque limit rises from zero [s], for a first balance on a tether.
    out
        The folder for report.html, log.csv and results.json; nothing is written if it is not given.
    """
    parameters, then = None, f"identify {link.name} LOG --out identified"
    if controller is not None:
        if link.described is None:
            raise InputError("--controller needs the robot that it is for: give --robot.")
        check_belongs(controller, link.described)
        parameters = export_controller(read_controller(controller, link.described), lean=lean).parameters
        if (study := controller.with_name("results.json")).exists():
            then = f"validate --prediction {study} LOG"
    with (
        closing(live_reference(reference)) as driven,
        connected(port, link, real_time=reference == KEYBOARD) as connection,
    ):
        robot = connection.robot
        if parameters is not None:
            robot.use_parameters(parameters)
        check_balancing_parameters(robot.parameters)
        commander = FollowReference(driven, sample_time=robot.sample_time)
        _record(connection, commander, duration, out, then, ramp=ramp, controller=controller)


@run.command
def monitor(port: Port = None, /, *, link: LinkOptions = _LINK, duration: options.Positive = 60.0) -> None:
    """Show a robot's sensors, self-test and stops, and what it runs; nothing is driven.

    Example: ballbot run monitor /dev/ttyACM0

    Example: ballbot run monitor --emulated --duration 10

    Parameters
    ----------
    duration
        How long [s]; Ctrl-C ends it as well.
    """
    console = standard_output()
    with connected(port, link, real_time=console.is_terminal) as connection:
        robot = connection.robot
        lines = robot.parameter_lines()
        emit({"parameters": lines})
        for line in lines:
            console.print(line, soft_wrap=True)
        with Monitor(console) as shown:
            robot.watch(shown.states_of(robot), duration=duration)


@run.command
def wiring(port: Port = None, /, *, link: LinkOptions = _LINK, out: Path | None = None) -> None:
    """Check the wiring: IMU axes and encoders while you move the robot by hand, then each motor with its encoder.

    Example: ballbot run wiring /dev/ttyACM0 --out wiring

    Example: ballbot run wiring --emulated

    Parameters
    ----------
    out
        The folder for report.html and results.json; nothing is written if it is not given.
    """
    console = standard_output()
    with connected(port, link, imu_checked=False) as connection:
        robot = connection.robot
        with Monitor(console) as shown:
            turns = measure_turns(robot, connection.operator, watch=shown.states_of(robot))
        check = check_turns(turns, robot.ball_from_wheels)
        page = wiring_report(check, about=connection.words)
        printed = [*page.parts(), *map(finding_line, check.findings)]
        with open_result(out, command="run wiring", inputs=[link.robot, link.scenario]) as result:
            result.write(page, printed=printed)
        if check.passed:
            robot.test(connection.operator)
            console.print("Every motor turns its own encoder forward: the self-test passed.")
            console.print("Next: `ballbot run PORT --duration 30 --out run`")
    if not check.passed:
        raise InputError(f"{check.findings[0].text} Correct it, and repeat the check.")


@run.command
def sweep(
    port: Port = None,
    /,
    *,
    link: LinkOptions = _LINK,
    duration: options.Positive = 2.0 * SWEEP_PERIOD,
    torque: float = 1.0,
    out: options.Out,
) -> None:
    """Record a torque sweep with the wheels off the ball, for `ballbot identify-driveline`.

    Hold the robot so that its wheels turn freely. All torques follow a sine of 62.83 s.

    Example: ballbot run sweep /dev/ttyACM0 --out sweep

    Example: ballbot run sweep --emulated --out sweep

    Parameters
    ----------
    duration
        Length of the sweep [s].
    torque
        Its largest torque [N m].
    """
    with connected(port, link, hold="in_air") as connection:
        then = f"identify-driveline {link.name} LOG --out driveline"
        _bench(connection, sweep_of(connection.robot, torque), duration, out, then)


@run.command
def upside_down(
    port: Port = None, /, *, link: LinkOptions = _LINK, duration: options.Positive = 60.0, out: options.Out
) -> None:
    """Record the robot upside down with the ball on its wheels, for `ballbot identify-upside-down`.

    Clamp the robot upside down, lay the ball on its wheels and film it. `ballbot spin VIDEO --log log.csv` adds the
    ball's angular velocity to the log. An emulated robot has a camera of its own.

    Example: ballbot run upside-down /dev/ttyACM0 --out upside_down

    Example: ballbot run upside-down --emulated --out upside_down

    Parameters
    ----------
    duration
        Length of the run [s].
    """
    with connected(port, link, hold="upside_down") as connection:
        then = f"identify-upside-down {link.name} LOG --out identified"
        _bench(connection, stir(connection.robot, link.seed), duration, out, then)


def _bench(
    connection: Connection,
    torques: Callable[[float], NDArray[np.float64]],
    duration: float,
    out: Path,
    then: str,
) -> None:
    """Record given torques of a robot that is held, without a limit of its lean; then restore the limit."""
    robot, own = connection.robot, connection.robot.parameters
    robot.use_parameters(bench_parameters(own))
    try:
        _record(connection, TorqueProgram(torques, sample_time=robot.sample_time), duration, out, then)
    finally:
        if robot.session.connected:
            robot.use_parameters(own)


@run.command
def compare(
    port: Port = None,
    /,
    *,
    link: LinkOptions = _LINK,
    prediction: Path,
    rounds: options.WholeNumber = MIN_RUNS // 2,
    lean: options.LeanLimit = 0.35,
    out: options.Out,
) -> None:
    """Compare a study's controller with the one before it on the robot: runs in turn on the same course, A B A B.

    What drifts from run to run, such as battery and floor, is not counted as a gain. Every run of the study's
    controller is compared with the study's prediction, as `ballbot validate --prediction` does. Put the robot back to
    its start before each run.

    Example: ballbot run compare /dev/ttyACM0 --prediction found/results.json --out compared

    Example: ballbot run compare --emulated --prediction found/results.json --out compared

    Parameters
    ----------
    prediction
        The results.json of a study, with controller.toml, previous_controller.toml and robot.toml beside it.
    rounds
        Runs of each controller, two or more.
    """
    if rounds < MIN_RUNS // 2:
        raise InputError(f"There are {rounds} rounds; runs in turn need {MIN_RUNS // 2} or more.")
    predicted = read_prediction(prediction)
    described = Robot.load(prediction.with_name("robot.toml"))
    files = [prediction.with_name(name) for name in ("previous_controller.toml", "controller.toml")]
    controllers = [read_controller(path, described) for path in files]
    check_controller(predicted, controllers[1])
    names = [f"{k + 1}_{'after' if k % 2 else 'before'}" for k in range(2 * rounds)]
    for name in names:
        check_no_recording(out / f"{name}{SUFFIX}")
    with open_result(
        out,
        command="run compare",
        writes=[f"{name}.csv" for name in names],
        inputs=[prediction, files, link.robot, link.scenario],
        seed=link.seed,
    ) as result:
        logs = []
        with connected(port, link) as connection:
            about = _about_run(connection, result) | {"robot": described.name}
            for k, name in enumerate(names):
                result.console.print(f"Run {k + 1} of {len(names)}: {files[k % 2]}", soft_wrap=True)
                parameters = export_controller(controllers[k % 2], lean=lean).parameters
                connection.robot.use_parameters(parameters)
                course = live_reference(predicted.course.name)
                commander = FollowReference(course, sample_time=connection.robot.sample_time)
                recording = out / f"{name}{SUFFIX}"
                made = _made(connection, commander, duration=predicted.course.duration, recording=recording)
                _finish(connection, made)
                result.console.print(made.ending.text, soft_wrap=True)
                logs.append(made.whole_log())
        performances = [performance_of(log, controllers[k % 2]) for k, log in enumerate(logs)]
        verdicts = [evaluate_log(predicted, log, controllers[1]) for log in logs[1::2]]
        found, compared = alternate(performances, verdicts), (str(files[0]), str(files[1]))
        page = alternation_report(found, logs, controllers=compared, about=connection.words, origin=about)
        written: dict[str, Content] = {
            f"{name}.csv": log.write for name, log in zip(names, logs, strict=True)
        }
        step = {
            "keep": f"go on with {files[1]}.",
            "weaken": "`ballbot design ROBOT --compensation-gain 0.8 --out weaker`",
            "revert": f"go back to {files[0]}.",
        }[found.recommendation]
        result.write(page, files=written, next_step=step)
        for name in names:
            (out / f"{name}{SUFFIX}").unlink(missing_ok=True)


def _record(
    connection: Connection,
    commander: Commander,
    duration: float,
    out: Path | None,
    then: str,  # the command that takes the log, LOG, next
    *,
    ramp: float = 0.0,
    controller: Path | None = None,
) -> None:
    """Make a run, and write its log and results into a folder if there is one; the log so far if the link is lost."""
    recording, link = None if out is None else out / f"log{SUFFIX}", connection.link
    if recording is not None:
        check_no_recording(recording)
    files = [link.robot, controller, link.scenario]
    with open_result(out, command="run", writes=["log.csv"], inputs=files, seed=link.seed) as result:
        made = _made(connection, commander, duration=duration, ramp=ramp, recording=recording)
        log, held = made.whole_log(), isinstance(commander, TorqueProgram)
        summary: dict[str, object] = {}
        if held:
            log = connection.camera.added_to(bench_log(log)) if connection.camera else bench_log(log)
            summary["peak_wheel_speed"] = float(np.abs(log.wheel_speeds).max())
        elif settled(log, SETTLE).any():
            summary["performance"] = Performance.of(log, torque_limit=connection.robot.torque_limit)
        results = {
            "rows": len(log),
            "sample_time": connection.robot.sample_time,
            "ended": made.ending.kind,
            "reason": made.ending.text,
            **summary,
            "provenance": _about_run(connection, result),
        }
        page = live_run_report(
            log,
            link.described,
            held=held,
            ending=made.ending.text,
            about=connection.words,
            data=results,
        )
        step = f"`ballbot {then.replace('LOG', result.path('log.csv'))}`" if out else ""
        result.write(page, files={"log.csv": log.write}, named=["log.csv"], next_step=step)
        if recording is not None:
            recording.unlink(missing_ok=True)
    _finish(connection, made)


def _made(
    connection: Connection,
    commander: Commander,
    *,
    duration: float,
    ramp: float = 0.0,
    recording: Path | None = None,
) -> LiveRun:
    """Make a run, watched by the monitor; see `recorded_run`."""
    monitor = Monitor(standard_output())
    line = bench_line if isinstance(commander, TorqueProgram) else sample_line

    def watch(sample: Sample) -> None:
        monitor.show(sample.t, lambda: line(sample, torque_limit=connection.robot.torque_limit))
        if connection.camera is not None:
            connection.camera.watch(sample.t)

    with monitor:
        return recorded_run(
            connection.robot,
            commander,
            operator=connection.operator,
            duration=duration,
            ramp=ramp,
            watch=watch,
            recording=recording,
        )


def _about_run(connection: Connection, result: CommandResult) -> dict[str, object]:
    """Return the provenance of a log: how it was made, on which robot, with which parameters, in which session."""
    described = connection.link.described
    return to_results(result.origin) | {
        "robot": described.name if described else None,
        "port": connection.address,
        "session": connection.robot.session_name,
        "parameters_sha256": sha256(connection.robot.parameters.tobytes()).hexdigest(),
    }


def _finish(connection: Connection, made: LiveRun) -> None:
    """Print what went wrong in a run; InputError if the link was lost, KeyboardInterrupt if it was interrupted."""
    if made.trouble:
        notice_output().print(made.trouble, style="yellow", soft_wrap=True)
    if made.ending.kind == "interrupt":
        raise KeyboardInterrupt("interrupted; the robot is disarmed.")
    if made.ending.kind == "link":
        raise InputError(made.ending.text)
    refused = counts_line(connection.robot.session.counts.refused, connection.robot.refused_frames())
    if refused:
        notice_output().print(refused, style="yellow", soft_wrap=True)
