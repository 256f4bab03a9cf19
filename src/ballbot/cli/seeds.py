"""Lists of seeds on the command line: 1-200 or 1,4,7-9."""

from __future__ import annotations

import re

from ballbot.errors import InputError

_MOST = 100_000


def parse_seeds(text: str) -> list[int]:
    """Return the seeds that a text lists, each once.

    Raises
    ------
    InputError
        Where it lists none, or too many.
    """
    seeds: dict[int, None] = {}
    for part in text.split(","):
        found = re.fullmatch(r"\s*(\d{1,9})(?:-(\d{1,9}))?\s*", part)
        first, last = (int(found[1]), int(found[2] or found[1])) if found else (1, 0)
        if last < first or last - first >= _MOST or len(seeds) > _MOST:
            raise InputError(
                f"The seeds are {text!r}; write them as 1-200 or 1,4,7-9, at most {_MOST} seeds."
            )
        seeds.update(dict.fromkeys(range(first, last + 1)))
    return list(seeds)
