"""`ballbot export`: a controller as C firmware for its robot."""

from ballbot.cli import options
from ballbot.cli.context import open_result
from ballbot.cli.controllers import warn_of_idle_compensation
from ballbot.cli.findings import checked_robot
from ballbot.errors import InputError
from ballbot.firmware.export import PROJECT, export_controller, exported_names, firmware_controller
from ballbot.firmware.processor_load import check_clock, measure_load, what_to_install
from ballbot.firmware.python_loop import MODULE, PYTHON_PROJECT, python_module
from ballbot.log.mapping import read_mapping
from ballbot.progress import Progress
from ballbot.report.export import export_report


def export(
    controller: str,
    /,
    *,
    robot: options.Robot,
    mixed: options.Mixed = None,
    lean: options.LeanLimit = 0.35,
    clock: float = 72e6,
    python: bool = False,
    mapping: options.Mapping = None,
    accept: options.Accept = None,
    change: options.Changes = None,
    out: options.Out,
) -> None:
    """Write a controller as C99 firmware: sources, the controller's numbers, build files and examples.

    Example: ballbot export found/controller.toml --robot found/robot.toml --out firmware

    Example: ballbot export stiff.toml --with soft.toml --robot found/robot.toml --out firmware

    Example: ballbot export found/controller.toml --robot found/robot.toml --python --mapping mapping.toml --out loop

    The library has the estimator that the controller names, the control law with all its parts, and the safety layer.
    It computes in single precision, needs no operating system and no C library, and takes no memory. Start with
    README.md in the folder; ballbot_hardware.h has the seven functions to write for a board.

    With the packages ziglang and unicorn, the library is compiled for a Cortex-M4F and run on an emulator, which counts
    the instructions of an update. Cycles are an upper estimate for flash with two wait states.

    With --python, the same C is for a computer that runs Python, such as a Raspberry Pi: a module of the standard
    library compiles it at its first import. With --mapping it takes the columns of the robot's own logs, and gives
    those of the motors, in their units.

    Parameters
    ----------
    controller
        A controller file, or another controller, as of ballbot check.
    clock
        Clock of the processor [Hz], for the share of the period that an update takes.
    python
        Write a Python module in place of the files for a board.
    """
    check_clock(clock)
    if mapping and not python:
        raise InputError(
            "--mapping is for the module that --python writes; a board's own functions read its sensors."
        )
    described, findings = checked_robot(robot, change, accept=accept)
    read = firmware_controller(controller, described)
    others = [firmware_controller(source, described) for source in mixed or ()]
    module = {MODULE: python_module(read, read_mapping(mapping) if mapping else None)} if python else {}
    project = PYTHON_PROJECT if python else PROJECT
    with open_result(out, doing="writing the firmware", writes=exported_names(project)) as result:
        exported = export_controller(read, others, described=described, lean=lean, project=project)
        to_install = "Not measured: the emulated one is a microcontroller." if python else what_to_install()
        if not to_install:
            result.report(Progress(stage="counting instructions"))
        load = None if to_install else measure_load(read, exported, clock=clock)
        page = export_report(exported, read, load, to_install=to_install, findings=findings)
        named = "ROBOT" if change else robot  # `run` takes a file, in which the changes must stand
        step = f"build it as {result.path('README.md')} says; on the robot, `ballbot run wiring PORT --robot {named}`"
        step = f"copy the folder to the robot, as {result.path('README.md')} says" if python else step
        result.write(page, files={**exported.files, **module}, named=["README.md"], next_step=step)
    warn_of_idle_compensation(controller, read)
