"""`ballbot run`: a live robot, from its wiring check to a comparison of two controllers on it."""

from collections.abc import Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import App, Parameter

from ballbot.cli import OUTPUT, options
from ballbot.cli.context import Content, open_result
from ballbot.cli.output import emit, notice, print_parts, standard_output
from ballbot.control.file import read_controller
from ballbot.errors import InputError
from ballbot.file_formats import read_results
from ballbot.firmware.export import export_controller, firmware_controller
from ballbot.link.bench import bench_log, check_balancing_parameters, held_parameters, stir, sweep_of
from ballbot.link.connection import Connection, LiveRun, Monitor, connect
from ballbot.link.emulated import emulated_robot
from ballbot.link.live import Commander, FollowReference, TorqueProgram
from ballbot.link.recorder import SUFFIX, check_no_recording
from ballbot.link.references import KEYBOARD, live_reference
from ballbot.link.stream import stream_address
from ballbot.link.transport import SerialTransport
from ballbot.link.tuning import TERMINAL, Change, Tuner, command_lines
from ballbot.link.wiring import check_turns, measure_turns
from ballbot.report.blocks import finding_line
from ballbot.report.comparison import alternation_report
from ballbot.report.run import live_run_report, wiring_report
from ballbot.results import to_results
from ballbot.robot import Robot
from ballbot.simulation.held_robot import SWEEP_PERIOD, Hold
from ballbot.twin.scenario_file import load_scenario
from ballbot.workflows.alternation import MIN_RUNS, alternate
from ballbot.workflows.controller_prediction import check_controller, evaluate_log, read_prediction
from ballbot.workflows.courses import PlantName
from ballbot.workflows.metrics import SETTLE, LogScore, settled

ABOUT = """Run a live robot over a serial port: check it, record it, balance it, compare controllers on it.

Every command takes the robot's port, such as /dev/ttyACM0, or --emulated in its place.
docs/tutorials/hardware.md and docs/bring_up.md have the commands in the order in which a new robot needs them.

Example: ballbot run /dev/ttyACM0 --reference square --duration 32 --out run1

Example: ballbot run wiring --emulated
"""

run = App(name="run", help=ABOUT)

_TUNE = (
    "Changes of the controller while it balances: terminal to type them, or a file with a time [s] and a command in "
    "each row. gain 0.3 gives the second gain this weight (or give a weight for each gain); compensation 0.8 is a "
    "share of what was exported; back is the setting before."
)
#: of an emulated robot whose file is not given
_EMULATED_ROBOT = "alten"

#: the robot's port
Port = Annotated[str | None, Parameter(help="A serial port such as /dev/ttyACM0?baud=921600.")]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class LinkOptions:
    """The robot to connect to."""

    emulated: Annotated[bool, Parameter(negative="")] = False
    """An emulated robot instead of one at a port: the firmware, compiled for this computer, with a simulated body."""

    plant: PlantName = "model"
    """The body of an emulated robot: the equations of motion (model) or the physics engine (twin)."""

    robot: str | None = None
    """A preset's name or a robot file. Needed if a controller is sent; for --emulated, alten by default."""

    scenario: options.Scenario = "nominal"

    seed: options.SeedNumber = 1
    """Random seed of an emulated robot, and of the torques upside down. The same seed gives the same run."""

    stream: str | None = None
    """Show the robot live in Foxglove, or in PlotJuggler by its Foxglove Bridge: foxglove, or ws://HOST:PORT of the
    server. An emulated robot then runs no faster than the clock."""

    @property
    def name(self) -> str:
        """The robot's name or file, as a command line has it."""
        return self.robot or (_EMULATED_ROBOT if self.emulated else "ROBOT")

    @property
    def described(self) -> Robot | None:
        """The robot's description; None if it is not known."""
        return Robot.load(self.name) if self.robot or self.emulated else None

    def connect(
        self,
        port: str | None,
        *,
        hold: Hold = "on_ball",
        real_time: bool = False,
        imu_checked: bool = True,
        weights: str = "",
    ) -> AbstractContextManager[Connection]:
        """Connect to a robot while a block runs; the keyword options are for an emulated robot.

        Raise InputError if there is no such robot, if both or neither of port and --emulated are given, or if the link
        fails.
        """
        if self.emulated == (port is not None):
            both = f", not both: {port} would be a port" if port else ""
            raise InputError(f"Give the robot's port, such as /dev/ttyACM0, or --emulated{both}.")
        stream = stream_address(self.stream) if self.stream else None
        if port is not None:
            return connect(SerialTransport(port), self.described, address=port, say=notice, stream=stream)
        described = Robot.load(self.name)
        emulated = emulated_robot(
            described,
            load_scenario(self.scenario, described),
            plant=self.plant,
            seed=self.seed,
            hold=hold,
            real_time=real_time or stream is not None,
            imu_checked=imu_checked,
            weights=weights,
        )
        filmed_by = self.seed if hold == "upside_down" else None
        return connect(
            emulated, described, address="emulated", say=notice, filmed_by=filmed_by, stream=stream
        )


_LINK = LinkOptions()


@run.default
def balance(
    port: Port = None,
    /,
    *,
    link: LinkOptions = _LINK,
    controller: str | None = None,
    mixed: options.Mixed = None,
    tune: Annotated[str | None, Parameter(help=_TUNE)] = None,
    lean: options.LeanLimit = 0.35,
    reference: str = "hold",
    duration: options.Positive = 30.0,
    ramp: float = 0.0,
    out: options.OptionalOut = None,
) -> None:
    """Balance a robot: self-test, arming after a confirmation at this terminal, a reference, a log, disarming.

    Ctrl-C disarms. While the robot runs, every row of the log is on the disk within 100 ms: if the run is cut off,
    log.recording.csv remains.

    Example: ballbot run /dev/ttyACM0 --reference square --duration 32 --out run1

    Example: ballbot run --emulated --reference square --duration 32 --out run1

    Example: ballbot run /dev/ttyACM0 --robot found/robot.toml --controller stiff.toml --with soft.toml --tune terminal

    Parameters
    ----------
    controller
        A controller as of ballbot check; needs --robot. It is sent if the robot has another one. If not given, the
        robot's own controller runs.
    reference
        hold, square, change_pose, circle, figure_eight, a file with t, ref_x, ref_y and ref_psi; keyboard (arrow keys,
        comma and full stop turn, e ends). It begins where the robot stands.
    duration
        Longest time from arming on [s].
    ramp
        Time over which the torque limit rises from zero [s], for a first balance on a tether.
    """
    if mixed and controller is None:
        raise InputError("--with needs the controller whose gain it is mixed with: give --controller.")
    if tune == TERMINAL and reference == KEYBOARD:
        raise InputError(
            "--tune terminal and --reference keyboard both read the terminal; give a file to one."
        )
    lines = None if tune is None else command_lines(tune)
    exported, then = None, f"identify {link.name} LOG --out identified"
    if controller is not None:
        if link.described is None:
            raise InputError("--controller needs the robot that it is for: give --robot.")
        read, *others = (
            firmware_controller(source, link.described) for source in (controller, *(mixed or ()))
        )
        exported = export_controller(read, others, described=link.described, lean=lean)
        study = Path(controller).with_name("results.json")
        results = read_results(study) if Path(controller).is_file() and study.exists() else None
        if isinstance(results, dict) and results.get("prediction"):  # a design's or a training's has none
            then = f"validate --prediction {study} LOG"
    with (
        closing(live_reference(reference)) as driven,
        link.connect(
            port,
            real_time=reference == KEYBOARD or tune == TERMINAL,
            weights=exported.weights if exported else "",
        ) as connection,
    ):
        robot = connection.robot
        if exported:
            robot.use_parameters(exported.parameters)
        check_balancing_parameters(robot.parameters)
        own = robot.parameters["law"]["tuning"][0]
        tuner = Tuner(lines, own, say=notice) if lines else None
        commander = FollowReference(driven, sample_time=robot.sample_time, tuner=tuner)
        changes = tuner.changes if tuner else ()
        _record(connection, commander, duration, out, then, seed=link.seed, ramp=ramp, changes=changes)


@run.command
def monitor(port: Port = None, /, *, link: LinkOptions = _LINK, duration: options.Positive = 60.0) -> None:
    """Show a robot's sensors, self-test, stops and controller; no torque is applied.

    Example: ballbot run monitor /dev/ttyACM0

    Example: ballbot run monitor --emulated --duration 10

    Parameters
    ----------
    duration
        How long [s]; Ctrl-C ends it as well.
    """
    console = standard_output()
    with link.connect(port, real_time=console.is_terminal) as connection:
        robot = connection.robot
        lines = robot.parameter_lines()
        emit({"parameters": lines})
        print_parts(lines, console)
        with _monitor().shown() as monitor:
            robot.watch(connection.states_shown(monitor), duration=duration)
        end = f"The robot sent its sensors for {duration:g} s; no torque was applied."
        print_parts([end, f"Next: `ballbot run wiring {port or '--emulated'}`"], console)


@run.command
def wiring(port: Port = None, /, *, link: LinkOptions = _LINK, out: options.OptionalOut = None) -> None:
    """Check the wiring: IMU axes and encoders while you move the robot by hand, then each motor with its encoder.

    Example: ballbot run wiring /dev/ttyACM0 --out wiring

    Example: ballbot run wiring --emulated
    """
    console = standard_output()
    with link.connect(port, imu_checked=False) as connection:
        robot = connection.robot
        with _monitor().shown() as monitor:
            turns = measure_turns(robot, connection.operator, watch=connection.states_shown(monitor))
        check = check_turns(turns, robot.ball_from_wheels)
        page = wiring_report(check, about=connection.words)
        printed = [*map(finding_line, check.findings), *page.parts()]
        with open_result(out, command="run wiring") as result:
            result.write(page, printed=printed)
        if check.passed:
            robot.test(connection.operator)
            step = f"Next: `ballbot run {port or '--emulated'} --duration 30 --out run`"
            end = "Every motor turns its own encoder forward: the self-test passed."
            print_parts([end, step], console)
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
    with link.connect(port, hold="in_air") as connection, held_parameters(connection.robot):
        then = f"identify-driveline {link.name} LOG --out driveline"
        _record(connection, sweep_of(connection.robot, torque), duration, out, then, seed=link.seed)


@run.command
def upside_down(
    port: Port = None, /, *, link: LinkOptions = _LINK, duration: options.Positive = 60.0, out: options.Out
) -> None:
    """Record the robot upside down with the ball on its wheels, for `ballbot identify-upside-down`.

    Clamp the robot upside down, lay the ball on its wheels and film it. `ballbot spin VIDEO --log log.csv --robot
    ROBOT` adds the ball's angular velocity to the log. An emulated robot has a camera of its own.

    Example: ballbot run upside-down /dev/ttyACM0 --out upside_down

    Example: ballbot run upside-down --emulated --out upside_down

    Parameters
    ----------
    duration
        Length of the run [s].
    """
    with link.connect(port, hold="upside_down") as connection, held_parameters(connection.robot):
        then = f"identify-upside-down {link.name} LOG --out identified"
        _record(connection, stir(connection.robot, link.seed), duration, out, then, seed=link.seed)


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
    """Compare a study's controller with the previous one on the robot: alternating runs on the same course, A B A B.

    Drift from run to run, such as of battery and floor, is not counted as a gain. Every run of the study's
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
        raise InputError(f"--rounds is {rounds}; the comparison needs {MIN_RUNS // 2} or more.")
    predicted = read_prediction(prediction)
    described = Robot.load(prediction.with_name("robot.toml"))
    files = [prediction.with_name(name) for name in ("previous_controller.toml", "controller.toml")]
    controllers = [read_controller(path, described) for path in files]
    check_controller(predicted, controllers[1])
    exported = [export_controller(controller, lean=lean) for controller in controllers]
    weights = next((firmware.weights for firmware in exported if firmware.weight_bytes), "")
    names = [f"{k + 1}_{'after' if k % 2 else 'before'}" for k in range(2 * rounds)]
    for name in names:
        check_no_recording(out / f"{name}{SUFFIX}")
    with open_result(
        out, command="run compare", writes=[f"{name}.csv" for name in names], beside=files, seed=link.seed
    ) as result:
        logs = []
        with link.connect(port, weights=weights) as connection:
            about = to_results(result.origin) | connection.provenance | {"robot": described.name}
            for k, name in enumerate(names):
                result.console.print(f"Run {k + 1} of {len(names)}: {files[k % 2]}", soft_wrap=True)
                connection.robot.use_parameters(exported[k % 2].parameters)
                course = live_reference(predicted.course.name)
                commander = FollowReference(course, sample_time=connection.robot.sample_time)
                recording, duration = out / f"{name}{SUFFIX}", predicted.course.duration
                live_run = connection.run(commander, _monitor(), duration=duration, recording=recording)
                _finish(connection, live_run)
                result.console.print(live_run.ending.text, soft_wrap=True)
                logs.append(live_run.whole_log())
        performances = [
            LogScore.of(log, torque_limit=controllers[k % 2].torque_limit) for k, log in enumerate(logs)
        ]
        verdicts = [evaluate_log(predicted, log, controllers[1]) for log in logs[1::2]]
        alternation, compared = alternate(performances, verdicts), (str(files[0]), str(files[1]))
        page = alternation_report(
            alternation, logs, controllers=compared, about=connection.words, origin=about
        )
        written: dict[str, Content] = {
            f"{name}.csv": log.write for name, log in zip(names, logs, strict=True)
        }
        step = {
            "keep": f"go on with {files[1]}.",
            "weaken": "`ballbot design ROBOT --compensation-gain 0.8 --out weaker`",
            "revert": f"go back to {files[0]}.",
        }[alternation.recommendation]
        result.write(page, files=written, next_step=step)
        for name in names:
            (out / f"{name}{SUFFIX}").unlink(missing_ok=True)


def _record(
    connection: Connection,
    commander: Commander,
    duration: float,
    out: Path | None,
    then: str,  # the next command, with LOG for the log
    *,
    seed: int,
    ramp: float = 0.0,
    changes: Sequence[Change] = (),  # of the controller, filled during the run
) -> None:
    """Run the robot, and write log and results into the folder, if any; if the link is lost, the log so far."""
    recording, held = None if out is None else out / f"log{SUFFIX}", isinstance(commander, TorqueProgram)
    if recording is not None:
        check_no_recording(recording)
    with open_result(out, command="run", writes=["log.csv"], seed=seed) as result:
        live_run = connection.run(commander, _monitor(), duration=duration, ramp=ramp, recording=recording)
        log = live_run.whole_log()
        summary: dict[str, object] = {}
        if held:
            log = connection.camera.added_to(bench_log(log)) if connection.camera else bench_log(log)
            summary["peak_wheel_speed"] = float(np.abs(log.wheel_speeds).max())
        elif settled(log, SETTLE).any():
            summary["performance"] = LogScore.of(log, torque_limit=connection.robot.torque_limit)
        results = {
            "rows": len(log),
            "sample_time": connection.robot.sample_time,
            "ended": live_run.ending.kind,
            "reason": live_run.ending.text,
            "changes": changes,
            **summary,
            "provenance": to_results(result.origin) | connection.provenance,
        }
        page = live_run_report(
            log,
            connection.described,
            held=held,
            ending=live_run.ending.text,
            about=connection.words,
            changes=changes,
            data=results,
        )
        step = f"`ballbot {then.replace('LOG', result.path('log.csv'))}`"
        step = step if out else "repeat the run with `--out run`, which keeps its log."
        result.write(page, files={"log.csv": log.write}, named=["log.csv"], next_step=step)
        if recording is not None:
            recording.unlink(missing_ok=True)
    _finish(connection, live_run)


def _monitor() -> Monitor:
    return Monitor(None if OUTPUT.get().quiet else standard_output())


def _finish(connection: Connection, live_run: LiveRun) -> None:
    """Print problems of a run; raise InputError if the link was lost, KeyboardInterrupt if it was interrupted."""
    for trouble in connection.troubles(live_run):
        notice(trouble, style="yellow")
