"""The `ballbot` command: its list of commands and what becomes of errors.

A command's module is imported when that command is run or asked for help, and no sooner, so that
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

from cyclopts import App, CycloptsError, UnknownCommandError

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
}


@dataclass(frozen=True, kw_only=True)
class Command:
    """One command of `ballbot`."""

    name: str
    target: str  #: "module:function", below `ballbot.cli`
    summary: str  #: its line in `ballbot --help`


#: in the order of `ballbot --help`: the main job first, then the stages as one walks through them
COMMANDS = (
    Command(
        name="study", target="study:study", summary="Robot and logs in; friction, report and controller out."
    ),
    Command(name="new", target="new:new", summary="Write a robot file to start from."),
    Command(
        name="check",
        target="check:check",
        summary="Check a robot; print what follows from its parameters.",
    ),
    Command(
        name="check-log",
        target="check_log:check_log",
        summary="Check a log and show what it can be used for.",
    ),
    Command(
        name="simulate", target="simulate:simulate", summary="Simulate a robot in closed loop; write a log."
    ),
    Command(name="record", target="record:record", summary="Record logs from the physics-engine twin."),
    Command(name="twin", target="twin:twin", summary="Write the twin's MuJoCo model or a scenario."),
    Command(
        name="excite",
        target="excite:excite",
        summary="Design an informative excitation within limits; try it on the twin.",
    ),
    Command(
        name="identify", target="identify:identify", summary="Identify a robot's friction from its logs."
    ),
    Command(
        name="identify-axis",
        target="identify_axis:identify_axis",
        summary="Identify the mass and friction of any single axis.",
    ),
    Command(
        name="identify-driveline",
        target="identify_driveline:identify_driveline",
        summary="Identify driveline friction from a free-wheel sweep.",
    ),
    Command(
        name="identify-upside-down",
        target="identify_upside_down:identify_upside_down",
        summary="Identify friction of the robot clamped upside down.",
    ),
    Command(
        name="identify-geometry",
        target="identify_geometry:identify_geometry",
        summary="Identify geometry and IMU mounting from logs.",
    ),
    Command(name="validate", target="validate:validate", summary="Validate a robot's model against logs."),
    Command(name="align", target="align:align", summary="Compare a log's sensors with motion capture."),
    Command(name="spin", target="spin:spin", summary="Measure the ball's velocity in a video of its seam."),
    Command(name="design", target="design:design", summary="Design a controller for a robot."),
    Command(
        name="limits",
        target="limits:limits",
        summary="Find the tilts and impulses a robot recovers from.",
    ),
    Command(
        name="compare", target="compare:compare", summary="Compare controllers on the same courses and seeds."
    ),
    Command(
        name="reproduce", target="reproduce:reproduce", summary="Reproduce the thesis's figures and tables."
    ),
)


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
        suppress_keyboard_interrupt=False,
    )
    for place, command in enumerate(COMMANDS):
        if command.name in tokens[:1]:
            module, _, function = command.target.partition(":")
            loaded = getattr(importlib.import_module(f"ballbot.cli.{module}"), function)
            if isinstance(loaded, App):  # a group of commands has its name already
                app.command(loaded)
            else:
                app.command(loaded, name=command.name, sort_key=place)
        else:
            target = f"ballbot.cli.{command.target}"
            app.command(target, name=command.name, help=command.summary, sort_key=place)
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
    build_app(tokens)(tokens, exit_on_error=False, print_error=False, result_action="return_value")
    if sys.stdout is not None:  # as with `>&-`
        sys.stdout.flush()
    return 0


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
    """Let Python not find out again at exit that nothing can be written there."""
    with suppress(OSError, AttributeError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _unknown_command(tokens: list[str]) -> str:
    word, names = tokens[0], [command.name for command in COMMANDS]
    if word in names:  # a group
        return f"There is no command {' '.join(tokens[:2])!r}. Try: {_help_of(tokens)}"
    return f"There is no command {word!r}; {suggest(word, names, otherwise='the commands are')}"


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
