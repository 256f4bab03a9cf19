"""`ballbot completion`: a script for a shell that completes commands, options and their choices, by cyclopts."""

import importlib
from typing import Literal

from ballbot.cli.app import COMMANDS, Command, build_app
from ballbot.cli.output import emit, standard_output

Shell = Literal["bash", "zsh", "fish"]


def completion(shell: Shell, /) -> None:
    """Print a script that completes commands, options and their choices in a shell.

    Example: `ballbot completion bash >> ~/.bashrc`

    Example: `ballbot completion zsh > ~/.zfunc/_ballbot`, where ~/.zfunc is in fpath before compinit

    Example: `ballbot completion fish > ~/.config/fish/completions/ballbot.fish`

    The options of a command that needs an extra package are in the script if that package is installed.

    Parameters
    ----------
    shell
        The shell that reads the script.
    """
    app = build_app(unavailable=[command.name for command in COMMANDS if not _is_importable(command)])
    script = app.generate_completion(shell=shell)
    emit({"shell": shell, "script": script})
    standard_output().print(script, end="", soft_wrap=True)


def _is_importable(command: Command) -> bool:
    try:
        importlib.import_module(command.target[0])
    except ModuleNotFoundError:  # of an extra
        return False
    return True
