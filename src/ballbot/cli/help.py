"""`ballbot help`: all commands, or one of them."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

from ballbot.cli.app import build_app


def help(*command: Annotated[str, Parameter(allow_leading_hyphen=True)]) -> None:
    """Explain a command, or list all of them.

    Example: `ballbot help study`

    Example: `ballbot help run wiring`

    Parameters
    ----------
    command
        The command's name, such as study; nothing for the list of all.
    """
    words = (*command, "--help")
    build_app(words).meta(words, exit_on_error=False, print_error=False, result_action="return_value")
