"""The `ballbot` command: runs a command line, and reports errors in one sentence."""

import io
import os
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress

from cyclopts import CycloptsError, MissingArgumentError

from ballbot.cli import ARGV, OUTPUT, Output, Waiting
from ballbot.cli.app import COMMANDS, OUTPUT_OPTIONS, START, build_app
from ballbot.errors import InputError, missing_package
from ballbot.printable import printable_line

#: longest error message [characters]
_LONGEST_SENTENCE = 1000

#: packages that not every installation has, and the extra of Ballbot that brings each
_EXTRAS = {
    "mujoco": "twin",
    "cv2": "vision",
    "pyarrow": "formats",
    "mcap": "formats",
    "rosbags": "formats",
    "control": "interop",
    "sympy": "symbolic",
    "serial": "link",
    "cobs": "link",
    "fastcrc": "link",
    "websockets": "view",
    "foxglove": "stream",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line, without the program's name, and return its exit code; by default the process's own.

    0 for success; 2 for bad input or a missing package, with one sentence on standard error; 130 when interrupted.
    """
    tokens = list(sys.argv[1:] if argv is None else argv)
    _survive_narrow_encodings()
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            return _run(tokens)
    except InputError as error:
        return _refuse(str(error))
    except CycloptsError as error:
        known = [command.name for command in COMMANDS if command.name in tokens[:1]]
        return _refuse(
            f"{' '.join([*str(error).split(), *_meaning(error), 'Try: ballbot', *known, '--help'])}"
        )
    except ModuleNotFoundError as error:
        if error.name not in _EXTRAS:
            raise
        return _refuse(str(missing_package("This", error.name, extra=_EXTRAS[error.name])))
    except KeyboardInterrupt as interrupt:
        _say(str(interrupt) or "interrupted; files written so far are complete.")
        return 130
    except BrokenPipeError:  # the reader has ended (`ballbot check alten | head`)
        _close_standard_output()
        return 1
    except OSError as error:
        _close_standard_output()
        what = "standard output" if error.filename is None else repr(os.fspath(error.filename))
        return _refuse(f"{what} cannot be used: {error.strerror or error}.")


def _meaning(error: CycloptsError) -> list[str]:
    """Return the words of the first sentence of the help of an option that lacks its value."""
    argument = error.argument if isinstance(error, MissingArgumentError) else None
    text = (argument and argument.parameter.help) or ""
    return f"{text.partition('. ')[0].rstrip('.')}.".split() if text else []


def _run(tokens: list[str]) -> int:
    named = [token for token in tokens if token not in OUTPUT_OPTIONS]
    if not named:
        print(START, end="")
        return 0
    if named[0] == "help":
        tokens = named = [*named[1:], "--help"]
    quiet = len(named) < len(tokens)
    output = Output(waiting=None if quiet else Waiting(f"starting {named[0]}"))
    running, printing = ARGV.set(tuple(named)), OUTPUT.set(output)
    try:
        app = build_app(named)
        app.meta(tokens, exit_on_error=False, print_error=False, result_action="return_value")
    finally:
        output.begin()
        ARGV.reset(running)
        OUTPUT.reset(printing)
        if output.json:
            print(output.results, end="")
    if sys.stdout is not None:  # as with `>&-`
        sys.stdout.flush()
    return 0


def _show_warning(message: Warning | str, *_: object) -> None:
    """Print a warning as one line, without its location in the code."""
    OUTPUT.get().begin()
    print(f"ballbot: warning: {message}", file=sys.stderr)


def _refuse(sentence: str) -> int:
    if len(sentence) > _LONGEST_SENTENCE:  # it quotes the content of a file
        half = _LONGEST_SENTENCE // 2
        sentence = f"{sentence[:half]} [..] {sentence[-half:]}"
    _say(sentence)
    return 2


def _say(sentence: str) -> None:
    with suppress(OSError):  # standard error is closed
        print(f"ballbot: {printable_line(sentence)}", file=sys.stderr, flush=True)


def _close_standard_output() -> None:
    """Redirect standard output to nowhere, so that Python's exit does not fail to flush it again."""
    with suppress(OSError, AttributeError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _survive_narrow_encodings() -> None:
    """Replace characters that a terminal cannot show by question marks."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


if __name__ == "__main__":
    sys.exit(main())
