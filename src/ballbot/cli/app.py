"""The application: the list of commands, the text of `ballbot` alone, and the options that every command has.

A command's module is imported only when that command runs or prints its help, so that `ballbot --help` appears
immediately.
"""

import importlib
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple, cast

from cyclopts import App, Group, Parameter

from ballbot.cli import OUTPUT

_ABOUT = """Model, identify, validate and control ball-balancing robots.

Example: `ballbot study alten square.csv hold.csv --out found`
"""


#: printed by `ballbot` without arguments
START = """Ballbot models, identifies, validates and controls ball-balancing robots.

  ballbot demo                              two recorded runs in the browser, and the friction in one
  ballbot new mine --from alten             a robot file to fill in for your robot
  ballbot study mine.toml LOG --out found   friction, validation and a controller from your log

`ballbot help` lists all commands, and `ballbot help study` explains one of them.
"""


class Command(NamedTuple):
    """One command of `ballbot`: the function of its name, with _ for -, in the module of that name."""

    name: str
    group: str  #: its heading in `ballbot --help`
    summary: str  #: its line in `ballbot --help`

    @property
    def target(self) -> tuple[str, str]:
        """Its module, imported only if the command is named, and its function, or its App if it has subcommands."""
        function = self.name.replace("-", "_")
        module = "identify_parts" if self.name.startswith("identify-") else function
        return f"ballbot.cli.{module}", function


#: in the order of `ballbot --help`; a command is a function of its name and a line here
COMMANDS = (
    Command("study", "Main job", "Robot and logs in; friction, report and controller out."),
    Command("demo", "Main job", "Two recorded runs in the browser, and the friction in their log."),
    Command("new", "Robot", "Write a robot file to start from."),
    Command("check", "Robot", "Check a robot's parameters and print derived quantities."),
    Command("check-log", "Logs", "Check a log and show what it can be used for."),
    Command("convert", "Logs", "Write a log in another file format."),
    Command("simulate", "Logs", "Simulate a robot in closed loop and write a log."),
    Command("record", "Logs", "Record logs from the physics-engine twin."),
    Command("view", "Logs", "Show logs of a robot in three dimensions, in the browser."),
    Command("align", "Logs", "Compare a log's sensors with motion capture."),
    Command("spin", "Logs", "Measure the ball's velocity in a video of its seam."),
    Command("identify", "Identification", "Identify a robot's friction from its logs."),
    Command("identify-driveline", "Identification", "Identify driveline friction from a free-wheel sweep."),
    Command("identify-upside-down", "Identification", "Identify friction of the robot clamped upside down."),
    Command("identify-geometry", "Identification", "Identify geometry and IMU mounting from logs."),
    Command("identify-axis", "Identification", "Identify the mass and friction of any single axis."),
    Command("validate", "Validation", "Validate a model or a controller against logs."),
    Command("design", "Control", "Design a controller for a robot."),
    Command("export", "Control", "Write a controller as C firmware for its robot."),
    Command("plan", "Control", "Plan the fastest move within a robot's limits."),
    Command("learn", "Control", "Learn a controller on simulated robots, in seconds."),
    Command("run", "Control", "Run a live robot: wiring, sweep, balance, comparison."),
    Command("limits", "Control", "Find the largest tilts and impulses that a robot recovers from."),
    Command("compare", "Experiments", "Compare controllers on the same courses and seeds."),
    Command("excite", "Experiments", "Design an informative excitation within limits; try it on the twin."),
    Command("twin", "Experiments", "Write the twin's MuJoCo model or a scenario."),
    Command("reproduce", "Thesis", "Reproduce the thesis's figures and tables."),
    Command("completion", "Help", "Print a script that completes commands and options in a shell."),
)

#: headings of `ballbot --help`
_GROUPS = {name: Group.create_ordered(name) for name in dict.fromkeys(command.group for command in COMMANDS)}
_OUTPUT_GROUP = Group.create_ordered("Output of every command")


@Parameter(name="*", group=_OUTPUT_GROUP)
@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """What a command prints."""

    json: Annotated[bool, Parameter(negative="", show_default=False)] = False
    """Print the results as JSON on standard output, and nothing else there."""

    quiet: Annotated[bool, Parameter(negative="", show_default=False)] = False
    """Print no results and no progress; warnings, errors and questions remain, on standard error."""


_OUTPUT = OutputOptions()
#: as they stand in a command line
OUTPUT_OPTIONS = ("--json", "--quiet")


def build_app(tokens: Sequence[str] = (), *, unavailable: Collection[str] = ()) -> App:
    """Return the command-line application; `.meta` of it takes whole command lines.

    Only the command that `tokens`, the command line without the program's name, name is imported. The commands that are
    `unavailable`, because a package is not installed, are listed without their options.
    """
    app = App(
        name="ballbot",
        help=_ABOUT,
        help_format="markdown",
        version=version,
        version_flags=("--version", "-V"),
        default_parameter=Parameter(negative_iterable=(), show_default=_default_words),  # no --empty-OPTION
        group_commands=Group.create_ordered("This program"),
        suppress_keyboard_interrupt=False,
    )
    for index, command in enumerate(COMMANDS):
        name, (module, function) = command.name, command.target
        if name not in tokens[:1] or name in unavailable:
            target = _unavailable if name in unavailable else f"{module}:{function}"
            group = _GROUPS[command.group]
            app.command(target, name=name, help=command.summary, group=group, sort_key=index)
            continue
        imported = importlib.import_module(module)
        loaded = getattr(imported, function)
        if isinstance(loaded, App):  # a group of commands has its name already
            loaded.help = imported.ABOUT  # a list of all commands has left its line there
            app.command(loaded)
        else:
            app.command(loaded, name=name, sort_key=index)

    app.meta.suppress_keyboard_interrupt = False  # not inherited from the app

    @app.meta.default
    def launch(
        *words: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
        output: OutputOptions = _OUTPUT,
    ) -> None:
        shown = OUTPUT.get()
        shown.json, shown.quiet = output.json, output.quiet
        app(words, exit_on_error=False, print_error=False, result_action="return_value")

    return app


def _default_words(value: object) -> str | None:
    """Return a default as written on a command line; None for an empty value or a switch that is off."""
    if value is None or value is False or value in ("", ()):
        return None
    if isinstance(value, tuple):
        return " ".join(map(str, cast("tuple[object, ...]", value)))
    return "on" if value is True else str(value)


def _unavailable(*words: str) -> None:
    """Take the place of a command that cannot be imported."""


def version() -> str:
    """Return the version of the installed package."""
    from importlib import metadata

    return metadata.version("ballbot")
