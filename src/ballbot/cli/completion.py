"""`ballbot completion`: a shell's completion of commands, options, their choices and names of presets."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Sequence
from typing import Literal

from cyclopts import App

from ballbot.cli.app import COMMANDS, Command, build_app
from ballbot.cli.output import emit, standard_output
from ballbot.control.references import REFERENCES
from ballbot.robot import Robot

Shell = Literal["bash", "zsh", "fish"]


def completion(shell: Shell, /) -> None:
    """Print a script that completes commands, options, their choices and the names of presets in a shell.

    Example: `ballbot completion bash >> ~/.bashrc`

    Example: `ballbot completion zsh > ~/.zfunc/_ballbot`, where ~/.zfunc is in fpath before compinit

    Example: `ballbot completion fish > ~/.config/fish/completions/ballbot.fish`

    The options of a command that needs an extra package are in the script if that package is installed.

    Parameters
    ----------
    shell
        The shell that reads the script.
    """
    unavailable = [command.name for command in COMMANDS if not _is_importable(command)]
    app = build_app(unavailable=unavailable)
    named = [(path, before, " ".join(names)) for path, before, names in _named(app, ())]
    script = app.generate_completion(shell=shell) + _WITH_NAMES[shell](named)
    emit({"shell": shell, "script": script})
    standard_output().print(script, end="", soft_wrap=True)


def _is_importable(command: Command) -> bool:
    try:
        importlib.import_module(command.module)
    except ModuleNotFoundError:  # of an extra
        return False
    return True


#: in place of the word before the one that is completed: any but an option, after a command's first argument
_SEVERAL = ""
#: a command's words, the word before the one that is completed, and the names that it may be
_Named = tuple[tuple[str, ...], str, str]


def _named(app: App, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], str, Sequence[str]]]:
    """Yield where names stand that are no choices, because a file may stand there too."""
    for name in app:
        if not name.startswith("-"):
            yield from _named(app[name], (*path, name))
    if not path or app.default_command is None:
        return
    for one in app.assemble_argument_collection():
        names = _names_of(one.names[0], path)
        if names and one.names[0].startswith("--"):
            yield path, one.names[0], names
        elif names and one.index == 0:
            yield path, path[-1], names
        elif names:  # the last argument, of which there may be several
            yield path, _SEVERAL, names


def _names_of(argument: str, path: tuple[str, ...]) -> Sequence[str]:
    """Return the names that an argument of a command may be, beside files."""
    if argument in ("--robot", "--like", "--from", "ROBOT", "SHOWN"):
        return Robot.presets()
    if path == ("help",):
        return [command.name for command in COMMANDS]
    if argument == "CONTROLLERS" or (path, argument) == (("view",), "--controller"):
        from ballbot.workflows.candidates import NAMED_CONTROLLERS

        return NAMED_CONTROLLERS
    if argument == "--controller" and path[0] in ("check", "excite", "record", "simulate"):
        from ballbot.control.presets import PRESETS

        return list(PRESETS)
    if argument == "--reference" and path != ("identify-axis",):  # there it is a column
        return list(REFERENCES)
    if argument in ("--scenario", "SCENARIO") or (path, argument) == (("twin", "scenario"), "SOURCE"):
        from ballbot.twin.scenario import Scenario

        return Scenario.names()
    return ()


def _cases(named: Sequence[_Named]) -> dict[str, list[str]]:
    """Return, by names, the first word of the command with the word before the one that is completed."""
    cases: dict[str, list[str]] = {}
    for path, before, names in named:
        case = f"'{path[0]} {before}'"
        if before != _SEVERAL and case not in cases.setdefault(names, []):
            cases[names].append(case)
    return cases


def _cases_of_several(named: Sequence[_Named]) -> dict[str, str]:
    """Return the patterns of lines that end in one of several arguments, by pattern; to stand after `_cases`."""
    several = [(path, names) for path, before, names in named if before == _SEVERAL]
    return {
        pattern: shown
        for path, names in several
        for pattern, shown in ((f"'{path[0]} -'*", ""), (f"'{path[0]} '*", names))
    }


def _with_names_in_bash(named: Sequence[_Named]) -> str:
    cases = [f"    {'|'.join(after)}) names='{names}' ;;" for names, after in _cases(named).items()]
    cases += [f"    {pattern}) names='{names}' ;;" for pattern, names in _cases_of_several(named).items()]
    return "\n".join(
        (
            "",
            "_ballbot_with_names() {",
            "  _ballbot",
            "  local names=''",
            '  case "${COMP_WORDS[1]} ${COMP_WORDS[COMP_CWORD-1]}" in',
            *cases,
            "  esac",
            '  COMPREPLY+=( $(compgen -W "$names" -- "${COMP_WORDS[COMP_CWORD]}") )',
            "}",
            "complete -o default -F _ballbot_with_names ballbot",  # files where no name fits
            "",
        )
    )


def _with_names_in_zsh(named: Sequence[_Named]) -> str:
    cases = [f"    {'|'.join(after)}) compadd -- {names} ;;" for names, after in _cases(named).items()]
    several = _cases_of_several(named)
    cases += [f"    {pattern}) {names and f'compadd -- {names} '};;" for pattern, names in several.items()]
    return "\n".join(
        (
            "",
            "_ballbot() {",
            '  case "${words[2]} ${words[CURRENT-1]}" in',
            "    'help help') ;;",
            f"    {'|'.join(case for after in _cases(named).values() for case in after)}) _files ;;",
            *(f"    {pattern}) {'_files ' if names else ''};;" for pattern, names in several.items()),
            "  esac",
            '  case "${words[2]} ${words[CURRENT-1]}" in',
            *cases,
            "  esac",
            '  _cyclopts_ballbot "$@"',
            "}",
            # as a file _ballbot in fpath this is the body of _ballbot when it is first called
            'if [[ "${funcstack[1]}" == _ballbot ]]; then _ballbot "$@"; else compdef _ballbot ballbot; fi',
            "",
        )
    )


def _with_names_in_fish(named: Sequence[_Named]) -> str:
    lines = []
    for path, before, names in named:
        condition = f"__fish_ballbot_using_command {' '.join(path)}"
        if before == _SEVERAL:
            after = f"test (__fish_ballbot_positional_index {len(path)}) -ge 1"
            lines.append(f"complete -c ballbot -n '{condition}; and {after}' -a '{names}'")
        elif before.startswith("--"):
            lines.append(f"complete -c ballbot -n '{condition}' -l {before[2:]} -r -a '{names}'")
        else:
            first = f"test (__fish_ballbot_positional_index {len(path)}) -eq 0"
            lines.append(f"complete -c ballbot -n '{condition}; and {first}' -a '{names}'")
    return "\n".join(("", *lines, ""))


_WITH_NAMES = {"bash": _with_names_in_bash, "zsh": _with_names_in_zsh, "fish": _with_names_in_fish}
