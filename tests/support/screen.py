"""Results as a terminal and a notebook show them."""

from html import unescape

from ballbot.summary import HEIGHT, WIDTH, HasSummary


def assert_fits_a_screen(result: HasSummary) -> None:
    """Assert that the `repr` of a result fits 80 x 24 characters, and that a notebook is given all of it."""
    lines = repr(result).splitlines()
    assert 1 < len(lines) <= HEIGHT
    assert max(map(len, lines)) <= WIDTH, max(lines, key=len)
    page = result._repr_html_()  # pyright: ignore[reportAttributeAccessIssue]
    assert unescape(page).removeprefix("<pre>").removesuffix("</pre>") == str(result.summary())
