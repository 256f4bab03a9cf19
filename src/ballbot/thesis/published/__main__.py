"""The command that regenerates docs/generated/published_models.md."""

from __future__ import annotations

import sys
from pathlib import Path

from cyclopts import run
from rich.progress import Progress as RichProgress

from ballbot.errors import InputError
from ballbot.thesis.published.page import write_published_page


def main(*, out: Path = Path("docs/generated/published_models.md")) -> int:
    """Compute the page on published models.

    Example: python -m ballbot.thesis.published --out docs/generated/published_models.md

    Parameters
    ----------
    out
        The Markdown file to write.
    """
    try:
        with RichProgress(transient=True) as bar:
            task = bar.add_task("published models", total=1.0)
            write_published_page(out, progress=lambda now: bar.update(task, completed=now.share))
    except InputError as error:
        print(f"ballbot: {error}", file=sys.stderr)
        return 2
    print(out)
    return 0


if __name__ == "__main__":
    run(main)
