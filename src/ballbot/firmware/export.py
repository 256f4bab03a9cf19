"""What `ballbot export` writes: the library, a controller's numbers, build files and examples.

    src/                    the library: the C sources of `ballbot.firmware`, as they are, and in
      ballbot_policy_weights.h    the weights of a policy
      ballbot_parameters.h        the controller's numbers in single precision
      ballbot_hardware.h          seven functions that the application writes for its board
      robot.c, robot.h            sensors, library and motors put together
    examples/               main loops without an operating system (Arduino) and with one
    CMakeLists.txt, Makefile, library.json, library.properties, README.md

For a computer that runs Python, `ballbot.firmware.python_loop` replaces all but the library.

The same controller and robot give the same bytes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.friction_table import SPEEDS, friction_table
from ballbot.control.gain_set import GainSet, certified, tunable
from ballbot.control.linear import refuse_without_margin
from ballbot.control.safety import SafetyLimits
from ballbot.control.source import NAMED_CONTROLLERS, named_controller
from ballbot.errors import InputError
from ballbot.files import read_text, read_toml, write_text
from ballbot.firmware.header import (
    PARAMETERS_HEADER,
    SOURCES,
    WEIGHTS_HEADER,
    parameters_header,
    weights_header,
)
from ballbot.firmware.records import FIRMWARE, PARAMETERS, STATE, parameter_record
from ballbot.result_folder import result_folder
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.workflows.limits import refuse_weaker_gains

#: build files and examples
PROJECT = Path(__file__).parent / "project"
#: folder of the library in what is written
LIBRARY = "src"
#: frequency of the heading's lags [rad/s] whose fourth power and all products stay far within single precision
_LARGEST_FREQUENCY = 1e4
#: of a weight
_BYTES = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Export:
    """A controller as firmware."""

    parameters: NDArray[np.void]  #: (1,) of `PARAMETERS` in single precision
    weight_bytes: int  #: flash that the weights of its policy take; 0 without one
    files: Mapping[str, str]  #: text by path, in order
    limits: SafetyLimits
    gains: GainSet | None  #: if the controller has several

    def write(self, folder: str | Path) -> None:
        """Write the files into a folder, as `ballbot export` does; InputError if they cannot be."""
        with result_folder(folder, command="export", names=self.files) as held, held.replaced() as new:
            for name, text in self.files.items():
                write_text(new / name, text)

    @property
    def weights(self) -> str:
        """The library's header with the weights of the controller's policy."""
        return self.files[f"{LIBRARY}/{WEIGHTS_HEADER}"]

    @property
    def parameter_bytes(self) -> int:
        """Flash that the controller's numbers take, without a policy's weights."""
        return self.parameters.itemsize

    @property
    def state_bytes(self) -> int:
        """RAM that the state takes, without the stack."""
        return STATE.dtype("single").itemsize


def exported_names(project: Path = PROJECT) -> list[str]:
    """Return the paths of all files that an export writes."""
    return sorted([f"{LIBRARY}/{PARAMETERS_HEADER}", *_fixed_files(project)])


def export(controller: Controller | str | Path, robot: RobotLike, *, lean: float = 0.35) -> Export:
    """Return a controller as firmware for a robot; `write(folder)` writes it.

    Parameters
    ----------
    controller : Controller, its name or its file
    robot : Robot, preset or robot file
        With the uncertainty of its friction, which bounds the compensation while the robot runs.
    lean : float
        Largest magnitude of theta and phi [rad]; the safety layer stops beyond it.

    Returns
    -------
    Export

    Raises
    ------
    InputError
        As `export_controller`.

    Examples
    --------
    >>> made = export("nominal", "alten")
    >>> sorted(made.files)[:1]
    ['CMakeLists.txt']
    """
    described = as_robot(robot)
    return export_controller(firmware_controller(controller, described), described=described, lean=lean)


def export_controller(
    controller: Controller,  # with the robot that it was read for
    others: Sequence[Controller] = (),  # whose gains can be mixed with its own while the robot balances
    *,
    described: Robot | None = None,  # with the uncertainty of its friction, which bounds the compensation
    lean: float = 0.35,  # largest |theta| and |phi| [rad]; the safety layer stops beyond it
    project: Path = PROJECT,  # the folder of files that belong to a kind of computer
) -> Export:
    """Return a controller and its robot as firmware.

    InputError if the loop with the robot has no stability margin, the others differ in more than their gains, the gains
    share no Lyapunov function, one of the others recovers from smaller impulses, single precision cannot hold the
    controller, its policy is too large, the lean is not above zero and at most 1.2 rad, the torque limit does not
    overcome the friction, or the firmware would refuse a parameter (`ballbot.firmware.bounds`).
    """
    refuse_without_margin(controller)
    controller = tunable(controller, others, robot=described)
    gains = None
    if others:
        gains = certified(controller)
        refuse_weaker_gains(controller)
    planner = controller.parts.planner
    if planner and planner.yaw_frequency > _LARGEST_FREQUENCY:
        raise InputError(
            f"The planner has a yaw_frequency of {planner.yaw_frequency:g} rad/s; firmware can have up to "
            f"{_LARGEST_FREQUENCY:g} rad/s."
        )
    limits = SafetyLimits.on_robot(
        controller.robot,
        sample_time=controller.sample_time,
        lean=lean,
        torque_limit=controller.torque_limit,
    )
    record = parameter_record(controller, limits)
    comment = (
        f"Robot: {controller.robot.name}, {len(controller.gain)} wheels. Controller: every "
        f"{1e3 * controller.sample_time:g} ms, state of the estimator {controller.estimator!r}.\n"
        f"Records: SHA-256 {FIRMWARE.digest}."
    )
    friction = controller.robot.friction
    if friction.own_law and controller.compensation != "none":
        comment += (
            f"\nFriction: {friction.own_law.formula}, as a table of {SPEEDS} speeds with an error of at most "
            f"{100.0 * friction_table(controller.robot).error:.2g} %."
        )
    policy = controller.parts.policy
    if policy:
        comment += (
            f"\nPolicy: {policy.weights.size} weights in {LIBRARY}/{WEIGHTS_HEADER}; a library with "
            "other weights refuses these numbers."
        )
    files = _fixed_files(project) | {
        f"{LIBRARY}/{WEIGHTS_HEADER}": weights_header(policy),
        f"{LIBRARY}/{PARAMETERS_HEADER}": parameters_header(record, PARAMETERS, comment=comment),
    }
    return Export(
        parameters=record,
        weight_bytes=_BYTES * policy.weights.size if policy else 0,
        files=dict(sorted(files.items())),
        limits=limits,
        gains=gains,
    )


def _fixed_files(project: Path) -> dict[str, str]:
    """Return the files that are the same for every controller, by their paths."""
    files = {}
    for folder in (SOURCES, project):
        for path in folder.rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                name = path.relative_to(folder).as_posix()
                in_library = folder == SOURCES or (path.suffix in (".c", ".h") and path.parent == folder)
                files[f"{LIBRARY}/{name}" if in_library else name] = read_text(path)
    return files


def firmware_controller(source: Controller | str | Path, robot: Robot) -> Controller:
    """Return a robot's controller, by value, name or file; InputError if a file was designed for another robot."""
    if isinstance(source, Controller):
        return source
    if source not in NAMED_CONTROLLERS and Path(source).is_file() and Path(source).suffix != ".py":
        named = read_toml(Path(source)).get("robot")
        if isinstance(named, str) and named != robot.name:
            raise InputError(
                f"{source} was designed for the robot {named!r}, not for {robot.name!r}; design a controller for "
                f"{robot.name!r}, or correct the name in one of the files if they are the same robot."
            )
    return named_controller(source, robot)
