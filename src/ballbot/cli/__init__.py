"""The commands: options and a few calls each. `main` lists them; `context` has what they share."""

from contextvars import ContextVar

#: the words of the command line that runs, after `ballbot`; set by `ballbot.cli.main`
ARGV: ContextVar[tuple[str, ...]] = ContextVar("ballbot command line", default=())
