"""The page on published models, put together from its sources' parts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ballbot.experiments.published import kugle, others, rezero, thesis_page
from ballbot.files import write_text
from ballbot.robot import Robot

COMMAND = "python -m ballbot.experiments.published --out docs/published_models.md"

_HEAD = f"""\
# Published models: what they print, what they should print, and why

Computed by `{COMMAND}`; nothing on this page is written by hand but the words.

Each table has what the source *prints*; what our equations give with the source's own convention or mistake switched on
(*reproduced*); and what is *right*, by the exact equations of design section 5. A number "comes out to its last digit"
where the reproduced one rounds to the printed one. Items are those of design section 10.
"""


def published_page(*, progress: Callable[[float], None] | None = None) -> str:
    """Return the whole page in Markdown; about a minute, most of it to derive the thesis's mixtures.

    Parameters
    ----------
    progress : callable, optional
        Called with the share that is done, from 0 to 1.
    """
    load = Robot.load
    parts = [
        _HEAD,
        thesis_page.section(load("alten"), progress=progress),
        kugle.section(load("kugle")),
        rezero.section(load("rezero")),
        others.section(load("rob311"), load("cmu")),
        others.presets_section(),
    ]
    return "\n".join(parts)


def write_published_page(path: Path, *, progress: Callable[[float], None] | None = None) -> None:
    """Compute the page and write it.

    Raises
    ------
    InputError
        Where the file cannot be written.
    """
    write_text(path, published_page(progress=progress))
