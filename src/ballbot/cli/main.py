"""The `ballbot` command: the list of commands, and how errors are reported.

A command's module is imported only when that command runs or prints its help, so that
`ballbot --help` is there at once.
"""

from __future__ import annotations

import importlib
import io
import os
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from cyclopts import App, CoercionError, CycloptsError, Group, Parameter, UnknownCommandError

from ballbot.cli import ARGV
from ballbot.errors import InputError, suggest
from ballbot.printable import printable_line

_ABOUT = """Model, identify, validate and control ball-balancing robots.

Example: `ballbot study alten square.csv hold.csv --out found`
"""


#: characters of a refusal
_LONGEST_SENTENCE = 1000

#: packages that not every installation has, and the extra of Ballbot that brings each
_EXTRAS = {
    "mujoco": "twin",
    "cv2": "vision",
    "pyarrow": "formats",
    "control": "interop",
    "sympy": "symbolic",
    "distributed": "cluster",
    "serial": "link",
    "cobs": "link",
    "fastcrc": "link",
}


@dataclass(frozen=True)
class Command:
    """One command of `ballbot`: the function of its name in the module of its name, with _ for -."""

    name: str
    group: str  #: its heading in `ballbot --help`
    summary: str  #: its line in `ballbot --help`

    @property
    def module(self) -> str:
        """Its module, which is imported only if the command is named."""
        return f"ballbot.cli.{self.function}"

    @property
    def function(self) -> str:
        """The function, or an App of several."""
        return self.name.replace("-", "_")


#: in the order of `ballbot --help`; a command is a module of its name and a line here
COMMANDS = (
    Command("study", "Main job", "Robot and logs in; friction, report and controller out."),
    Command("demo", "Main job", "Two recorded runs in the browser, and the friction in their log."),
    Command("new", "Robot", "Write a robot file to start from."),
    Command("check", "Robot", "Check a robot's parameters and print derived quantities."),
    Command("check-log", "Logs", "Check a log and show what it can be used for."),
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
    Command("run", "Control", "Run a live robot: wiring, sweep, balance, comparison."),
    Command("limits", "Control", "Find the largest tilts and impulses that a robot recovers from."),
    Command("compare", "Experiments", "Compare controllers on the same courses and seeds."),
    Command("excite", "Experiments", "Design an informative excitation within limits; try it on the twin."),
    Command(
        "twin",
        "Experiments",
        "Write the twin's MuJoCo model or a scenario; try the thesis's recommendations.",
    ),
    Command("reproduce", "Thesis", "Reproduce the thesis's figures and tables."),
)

#: options by their old names, which still work in this release: command, old name, new name
RENAMED_OPTIONS = {
    ("identify", "--free"): "--estimate",
    ("identify", "--judge-on"): "--holdout",
    ("identify", "--leave-out"): "--exclude-states",
    ("study", "--leave-out"): "--exclude-states",
    ("design", "--allow-pumping"): "--allow-overcompensation",
}

#: options that are gone: command, name, and what to do instead
REMOVED_OPTIONS = {
    (
        "identify-axis",
        "--horizon",
    ): "the length of the windows is now chosen by held-out errors; leave it out",
    (
        "identify-axis",
        "--window",
    ): "the blocks that are held out are now chosen from the record; leave it out",
}


def build_app(tokens: Sequence[str] = ()) -> App:
    """Return the command-line application.

    Parameters
    ----------
    tokens : sequence of str
        The command line, without the program's name. Only the command that it names is imported.
    """
    app = App(
        name="ballbot",
        help=_ABOUT,
        help_format="markdown",
        version=_version,
        default_parameter=Parameter(negative_iterable=()),  # no --empty-OPTION
        suppress_keyboard_interrupt=False,
    )
    groups = {name: Group.create_ordered(name) for name in dict.fromkeys(one.group for one in COMMANDS)}
    for place, command in enumerate(COMMANDS):
        group = groups[command.group]
        if command.name in tokens[:1]:
            loaded = getattr(importlib.import_module(command.module), command.function)
            if isinstance(loaded, App):  # a group of commands has its name already
                app.command(loaded)
            else:
                app.command(loaded, name=command.name, sort_key=place)
        else:
            target = f"{command.module}:{command.function}"
            app.command(target, name=command.name, help=command.summary, group=group, sort_key=place)
    return app


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit code.

    0 for success; 2 for bad input or a missing package, with one sentence on standard error; 130 when
    interrupted.

    Parameters
    ----------
    argv : sequence of str, optional
        The command line without the program's name; by default the process's own.
    """
    tokens = list(sys.argv[1:] if argv is None else argv)
    _survive_narrow_encodings()
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            return _run(tokens)
    except InputError as error:
        return _refuse(str(error))
    except UnknownCommandError:
        return _refuse(_unknown_command(tokens))
    except CoercionError as error:
        return _refuse(f"{_wrong_number(error)} Try: {_help_of(tokens)}")
    except CycloptsError as error:
        return _refuse(f"{' '.join(str(error).split())} Try: {_help_of(tokens)}")
    except ModuleNotFoundError as error:
        if error.name not in _EXTRAS:
            raise
        return _refuse(
            f"This needs {error.name}; install it with: pip install 'ballbot[{_EXTRAS[error.name]}]'"
        )
    except KeyboardInterrupt as interrupt:
        _say(str(interrupt) or "interrupted; files written so far are complete.")
        return 130
    except BrokenPipeError:  # the reader has gone (`ballbot check alten | head`)
        _close_standard_output()
        return 1
    except OSError as error:
        _close_standard_output()
        what = "standard output" if error.filename is None else repr(os.fspath(error.filename))
        return _refuse(f"{what} cannot be used: {error.strerror or error}.")


def _run(tokens: list[str]) -> int:
    tokens = _with_new_names(tokens)
    app = build_app(tokens)
    running = ARGV.set(tuple(tokens))
    try:
        app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
    finally:
        ARGV.reset(running)
    if sys.stdout is not None:  # as with `>&-`
        sys.stdout.flush()
    return 0


def _with_new_names(tokens: Sequence[str]) -> list[str]:
    """Return the command line with renamed options under their new names, and print a hint for each."""
    renamed = []
    for token in tokens:
        option, equals, value = token.partition("=")
        gone = REMOVED_OPTIONS.get((tokens[0], option))
        if gone:
            raise InputError(f"{option} is no longer an option of {tokens[0]}: {gone}.")
        new = RENAMED_OPTIONS.get((tokens[0], option))
        if new:
            _say(f"{option} is now called {new}; the old name goes with the next release.")
        renamed.append(f"{new}{equals}{value}" if new else token)
    return renamed


def _show_warning(message: Warning | str, *_: object) -> None:
    """Print a warning as one line, without the place in our code that it comes from."""
    print(f"ballbot: warning: {message}", file=sys.stderr)


def _refuse(sentence: str) -> int:
    if len(sentence) > _LONGEST_SENTENCE:  # it quotes what a file holds
        half = _LONGEST_SENTENCE // 2
        sentence = f"{sentence[:half]} [..] {sentence[-half:]}"
    _say(sentence)
    return 2


def _say(sentence: str) -> None:
    with suppress(OSError):  # nobody is there to hear it
        print(f"ballbot: {printable_line(sentence)}", file=sys.stderr, flush=True)


def _close_standard_output() -> None:
    """Redirect standard output to nowhere, so that Python's exit does not fail to flush it again."""
    with suppress(OSError, AttributeError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _unknown_command(tokens: list[str]) -> str:
    word, names = tokens[0], [command.name for command in COMMANDS]
    if word in names:  # a group
        return f"There is no command {' '.join(tokens[:2])!r}. Try: {_help_of(tokens)}"
    return f"There is no command {word!r}; {suggest(word, names, otherwise='the commands are')}"


def _wrong_number(error: CoercionError) -> str:
    """Return the sentence on an option's value that is not of the option's type."""
    kind = {int: "a whole number", float: "a number"}.get(error.target_type or str)
    if error.msg is not None or error.token is None or error.token.keyword is None or kind is None:
        return " ".join(str(error).split())
    return f"{error.token.keyword} is {error.token.value!r}; it must be {kind}."


def _help_of(tokens: list[str]) -> str:
    known = [command.name for command in COMMANDS if command.name in tokens[:1]]
    return " ".join(["ballbot", *known, "--help"])


def _survive_narrow_encodings() -> None:
    """Let drawings and Greek letters become question marks on a terminal that cannot show them."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _version() -> str:
    from importlib.metadata import version

    return version("ballbot")


if __name__ == "__main__":
    sys.exit(main())
