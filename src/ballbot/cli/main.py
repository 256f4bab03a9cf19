"""The `ballbot` command: runs a command line, and reports errors in one sentence."""

from __future__ import annotations

import io
import json
import os
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress

from cyclopts import (
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
)

from ballbot.cli import ARGV, OUTPUT, Output
from ballbot.cli.app import (
    COMMANDS,
    OUTPUT_OPTIONS,
    REMOVED_OPTIONS,
    RENAMED_OPTIONS,
    START,
    VERSION_FLAGS,
    build_app,
    version,
)
from ballbot.errors import InputError, missing_package, nearest, suggest
from ballbot.printable import printable_line

#: characters of a refusal
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
    "distributed": "cluster",
    "serial": "link",
    "cobs": "link",
    "fastcrc": "link",
    "websockets": "view",
}


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
    except UnknownCommandError as error:
        return _refuse(_unknown_command(error))
    except UnknownOptionError as error:
        return _refuse(f"{_unknown_option(error)} Try: {_help_of(tokens)}")
    except MissingArgumentError as error:
        return _refuse(f"{_missing(error, tokens)} Try: {_help_of(tokens)}")
    except UnusedCliTokensError as error:
        return _refuse(f"{_unused(error)} Try: {_help_of(tokens)}")
    except CoercionError as error:
        return _refuse(f"{_wrong_number(error)} Try: {_help_of(tokens)}")
    except CycloptsError as error:
        return _refuse(f"{' '.join(str(error).split())} Try: {_help_of(tokens)}")
    except ModuleNotFoundError as error:
        if error.name not in _EXTRAS:
            raise
        return _refuse(str(missing_package("This", error.name, extra=_EXTRAS[error.name])))
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
    named = [token for token in tokens if token not in OUTPUT_OPTIONS]
    if not named:
        print(START, end="")
        return 0
    if named[0] in VERSION_FLAGS or named == ["version"]:
        print(json.dumps({"version": version()}) if "--json" in tokens else version())
        return 0
    tokens = _with_new_names(tokens, command=named[0])
    app = build_app(named)
    output = Output()
    running, printing = ARGV.set(tuple(tokens)), OUTPUT.set(output)
    try:
        app.meta(tokens, exit_on_error=False, print_error=False, result_action="return_value")
    finally:
        ARGV.reset(running)
        OUTPUT.reset(printing)
        if output.json:
            print(output.results, end="")
    if sys.stdout is not None:  # as with `>&-`
        sys.stdout.flush()
    return 0


def _with_new_names(tokens: Sequence[str], *, command: str) -> list[str]:
    """Return the command line with renamed options under their new names, and print a hint for each."""
    renamed = []
    for token in tokens:
        option, equals, value = token.partition("=")
        gone = REMOVED_OPTIONS.get((command, option))
        if gone:
            raise InputError(f"{option} is no longer an option of {command}: {gone}.")
        new = RENAMED_OPTIONS.get((command, option))
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


def _unknown_command(error: UnknownCommandError) -> str:
    """Return the sentence on a word that is no command of a group of commands, such as `ballbot twin`."""
    group, word = " ".join(error.command_chain or ()), (error.unused_tokens or [""])[0]
    if word.startswith("-"):
        return _no_option(word, ["--help", "--version", *OUTPUT_OPTIONS])
    names = [name for name in error.app or () if not name.startswith("-")]
    return f"There is no command {f'{group} {word}'.strip()!r}; {suggest(word, names, otherwise='the commands are')}"


def _unknown_option(error: UnknownOptionError) -> str:
    option = (error.token.keyword or error.token.value).partition("=")[0]
    names = [name for one in error.argument_collection if one.parse for name in one.names]
    if option == "--out" and "OUT" in names:
        return "There is no option --out: the file to write is the second argument, without a name."
    argument = option.lstrip("-").upper()
    if argument in names:
        return f"There is no option {option}: write {argument} without a name, in its place."
    return _no_option(option, [*names, *OUTPUT_OPTIONS, "--help"])


def _missing(error: MissingArgumentError, tokens: Sequence[str]) -> str:
    """Return the sentence on what a command line lacks; a misspelt option or robot in it comes first."""
    argument = error.argument
    if argument is None or error.app is None or error.keyword is not None:
        return " ".join(str(error).split())  # an option without its value
    names = [name for one in error.app.assemble_argument_collection() if one.parse for name in one.names]
    for token in tokens:
        option = token.partition("=")[0]
        if option.startswith("--") and option not in (*names, *OUTPUT_OPTIONS, "--help", "--"):
            return _no_option(option, names)
    chain = error.command_chain or ()
    given = tokens[len(chain)] if len(tokens) > len(chain) else ""
    if names[:1] == ["ROBOT"] and given and not given.startswith("-"):
        from ballbot.robot import Robot

        try:
            Robot.load(given)
        except InputError as wrong:
            return str(wrong)
    if argument.name == "LOGS":
        from ballbot.log.collection import NO_LOG

        return NO_LOG
    needed = argument.name if argument.name != "--out" else "--out FOLDER"
    return f"{' '.join(chain)} needs {needed}."


def _unused(error: UnusedCliTokensError) -> str:
    """Return the sentence on a word beyond a command's arguments."""
    word = (error.unused_tokens or [""])[0]
    return f"{' '.join(error.command_chain or ('ballbot',))} takes no further argument, so {word!r} is left over."


def _no_option(option: str, names: Sequence[str]) -> str:
    bare = {name.lstrip("-"): name for name in names}  # dashes make any two options alike
    near = nearest(option.lstrip("-"), bare)
    hint = f"; did you mean {bare[near[0]]}?" if near else "."
    return f"There is no option {option}{hint}"


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


if __name__ == "__main__":
    sys.exit(main())
