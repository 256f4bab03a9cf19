"""The commands: options and a few calls each. `app` lists them, `main` runs one; `context` has what they share."""

from contextvars import ContextVar
from dataclasses import dataclass

from ballbot.cli.waiting import Waiting


@dataclass(kw_only=True)
class Output:
    """How the command that runs prints, and what it has to print at its end."""

    json: bool = False  #: results as JSON on standard output, and nothing else there
    quiet: bool = False  #: no results and no progress
    results: str = ""  #: JSON text, for standard output
    waiting: Waiting | None = None  #: the line until the command prints something

    def begin(self) -> None:
        """Make room for what the command prints."""
        if self.waiting is not None:
            self.waiting.end()


#: the words of the command line that runs, after `ballbot`; set by `ballbot.cli.main`
ARGV: ContextVar[tuple[str, ...]] = ContextVar("ballbot command line", default=())
#: of the command line that runs; set by `ballbot.cli.main`
OUTPUT: ContextVar[Output] = ContextVar("ballbot output", default=Output())  # noqa: B039 (read only by default)
