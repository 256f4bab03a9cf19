"""What a reader finds on a report's page."""

from __future__ import annotations

import re


def shown_text(page: str) -> str:
    """Return a page without its figures, scripts and styles."""
    return re.sub(r"<(svg|script|style)\b.*?</\1>", "", page, flags=re.DOTALL)


def figure_count(page: str) -> int:
    """Return how many figures a page has: drawings, and time series, which a script draws."""
    return page.count("<svg") + page.count('data-ballbot-chart="')
