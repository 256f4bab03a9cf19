"""What the commands of `ballbot run` share: the robot at the other end, the person at the terminal, and the monitor."""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Annotated

from cyclopts import Parameter
from rich.live import Live
from rich.text import Text

from ballbot.cli import OUTPUT, options
from ballbot.cli.output import notice_output
from ballbot.errors import InputError
from ballbot.fitting.run import check_seed
from ballbot.link.emulated import emulated_robot
from ballbot.link.lines import state_line
from ballbot.link.live import LiveRobot
from ballbot.link.messages import State
from ballbot.link.operators import UPRIGHT, EmulatedCamera, EmulatedOperator, Movement, Operator
from ballbot.link.session import Session
from ballbot.link.transport import Transport, open_transport
from ballbot.report.blocks import PlainConsole
from ballbot.robot import Robot
from ballbot.simulation.held_robot import Hold
from ballbot.twin.scenario_file import load_scenario
from ballbot.workflows.courses import PlantName

#: of an emulated robot whose file is not given
_EMULATED_ROBOT = "alten"
#: between two pictures of the monitor on a terminal, and between two lines of it elsewhere [s]
_PICTURE, _LINE = 0.1, 5.0
#: what is typed at the terminal to let the robot arm
_CONFIRMATION = "arm"


#: the robot's port
Port = Annotated[str | None, Parameter(help="A serial port such as /dev/ttyACM0?baud=921600.")]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class LinkOptions:
    """The robot at the other end."""

    emulated: Annotated[bool, Parameter(negative="")] = False
    """An emulated robot instead of one at a port: the firmware, compiled for this computer, with a simulated body."""

    plant: PlantName = "model"
    """The body of an emulated robot: the equations of motion (model) or the physics engine (twin)."""

    robot: str | None = None
    """A preset's name or a robot file. Needed if a controller is sent; of an emulated robot alten by default."""

    scenario: options.Scenario = "nominal"

    seed: options.WholeNumber = 1
    """Random seed of an emulated robot, and of the torques upside down. The same seed gives the same run."""

    @property
    def name(self) -> str:
        """The robot's name or file, as a command line has it."""
        return self.robot or (_EMULATED_ROBOT if self.emulated else "ROBOT")

    @property
    def described(self) -> Robot | None:
        """The robot's description; None if it is not known."""
        return Robot.load(self.name) if self.robot or self.emulated else None


@dataclass(frozen=True, kw_only=True)
class Connection:
    """A robot at the other end of a link, and the person beside it."""

    link: LinkOptions
    robot: LiveRobot
    operator: Operator
    address: str  #: port or "emulated"
    camera: EmulatedCamera | None = None  #: above an emulated robot that is upside down

    @property
    def words(self) -> str:
        """Which robot it is, and where, in a sentence."""
        described = self.link.described
        name = "A robot" if described is None else f"The robot {described.name}"
        where = ", emulated on this computer" if self.address == "emulated" else f" at {self.address}"
        return f"{name}{where}."


@contextmanager
def connected(
    port: str | None,  # None for an emulated robot
    link: LinkOptions,
    *,
    # how an emulated robot is held; in the air and upside down it stays so when it arms
    hold: Hold = "on_ball",
    # whether an emulated robot runs no faster than a real one, for a person who drives or watches it
    real_time: bool = False,
    imu_checked: bool = True,  # whether the IMU's axes of an emulated robot count as checked
) -> Iterator[Connection]:
    """Hold the link to a robot while the block runs.

    InputError if there is no such robot, both or neither of port and --emulated are given, or the link fails.
    """
    if link.emulated == (port is not None):
        both = f", not both: {port} would be a port" if port else ""
        raise InputError(f"Give the robot's port, such as /dev/ttyACM0, or --emulated{both}.")
    with ExitStack() as held:
        if port is not None:
            robot = _robot_at(open_transport(port), time.monotonic, held)
            yield Connection(link=link, robot=robot, operator=TerminalOperator(), address=port)
            return
        check_seed(link.seed)
        described = Robot.load(link.robot or _EMULATED_ROBOT)
        emulated = emulated_robot(
            described,
            load_scenario(link.scenario, described),
            plant=link.plant,
            hold=hold,
            seed=link.seed,
            real_time=real_time,
            imu_checked=imu_checked,
        )
        robot, camera = _robot_at(emulated, emulated.clock, held), None
        if hold == "upside_down":
            camera = EmulatedCamera(
                emulated.hand, clock=emulated.clock, sample_time=robot.sample_time, seed=link.seed
            )
        operator = EmulatedOperator(emulated.hand)
        yield Connection(link=link, robot=robot, operator=operator, address="emulated", camera=camera)


def _robot_at(transport: Transport, clock: Callable[[], float], held: ExitStack) -> LiveRobot:
    session = Session(transport, clock=clock)
    held.callback(session.close)
    session.connect()
    return LiveRobot(session, clock=clock)


class TerminalOperator:
    """The person at the terminal."""

    def __init__(self) -> None:
        self._console = notice_output()

    def confirm_arming(self) -> bool:
        """Let the person type the confirmation; nobody else can give it. InputError if the input is not a terminal."""
        if not sys.stdin.isatty():
            raise InputError("Arming is confirmed at a terminal, and the input of this command is none.")
        self._console.print(
            "The motors will be enabled. Is the robot where it should be, and is nobody in its way?"
        )
        self._console.print(
            f"Type {_CONFIRMATION} and press Enter within 10 s; anything else leaves it disarmed."
        )
        return sys.stdin.readline().strip() == _CONFIRMATION

    def hold_upright(self) -> None:
        """Print what to do."""
        self._console.print(UPRIGHT, soft_wrap=True)

    def move(self, movement: Movement) -> None:
        """Print what to do."""
        self._console.print(movement.prompt, soft_wrap=True)


class Monitor:
    """Shows a robot while it runs: a line that changes on a terminal, or a line every five seconds elsewhere."""

    def __init__(self, console: PlainConsole) -> None:
        self._live: Live | None = None
        if console.is_terminal:
            self._live = Live(console=console, auto_refresh=False, transient=True)
            # the first picture takes longer to draw than a robot waits; nobody sees this one
            PlainConsole(file=io.StringIO()).print(Text(""))
        #: when the next picture is due, by the clock; or the next line, by the robot's time [s]
        self._next = 0.0

    def __enter__(self) -> Monitor:
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the line from the terminal."""
        if self._live is not None:
            self._live.stop()

    def states_of(self, robot: LiveRobot) -> Callable[[State], None]:
        """Return what shows each state of a robot, armed or not."""
        return lambda state: self.show(
            1e-6 * (state.time % 2**32), lambda: state_line(state, wheel_count=robot.wheel_count)
        )

    def show(self, t: float, line: Callable[[], str]) -> None:
        """Show a line that is made at the robot's time t [s], if the last one is old."""
        now, interval = (t, _LINE) if self._live is None else (time.monotonic(), _PICTURE)
        # the robot's time begins again after 71 minutes
        if OUTPUT.get().quiet or self._next - interval <= now < self._next:
            return
        self._next = now + interval
        if self._live is None:
            print(f"ballbot: {line()}", file=sys.stderr, flush=True)
        else:
            self._live.start()  # not before there is something to show: the person may have to type first
            self._live.update(Text(line()), refresh=True)
