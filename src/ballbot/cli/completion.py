"""`ballbot completion`: a shell's completion of commands, options and their choices."""

from __future__ import annotations

from typing import Literal

from ballbot.cli.app import build_app
from ballbot.cli.output import emit, standard_output

Shell = Literal["bash", "zsh", "fish"]


def completion(shell: Shell, /) -> None:
    """Print a script that completes commands, options and their choices in a shell.

    Example: `ballbot completion bash >> ~/.bashrc`

    Example: `ballbot completion zsh > ~/.zfunc/_ballbot`, where ~/.zfunc is in fpath before compinit

    Example: `ballbot completion fish > ~/.config/fish/completions/ballbot.fish`

    Parameters
    ----------
    shell
        The shell that reads the script.
    """
    script = build_app().generate_completion(shell=shell)
    emit({"shell": shell, "script": script})
    standard_output().print(script, end="", soft_wrap=True)
