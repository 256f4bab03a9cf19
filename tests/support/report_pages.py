"""What a reader finds on a report's page."""

import re

#: what a page with ten long plots, or with two replays and a dozen figures, may have [characters]
LARGEST_PAGE = 2_500_000


def shown_text(page: str) -> str:
    """Return a page without its figures, scripts and styles."""
    return re.sub(r"<(svg|script|style)\b.*?</\1>", "", page, flags=re.DOTALL)


def figure_count(page: str) -> int:
    """Return how many figures a page has: drawings, and time series, which a script draws."""
    return page.count('<figure class="picture"') + page.count('data-ballbot-chart="')
