"""Results as a terminal and a notebook show them."""

from html import unescape

from ballbot.printable import printable_line
from ballbot.summary import HEIGHT, WIDTH, Plotted, Summarized


def assert_fits_a_screen(result: Summarized, *, drawn: bool = True) -> None:
    """Assert that the `repr` of a result fits 80 x 24 characters, and that a notebook gets all of it and the figure."""
    lines = repr(result).splitlines()
    assert 1 < len(lines) <= HEIGHT
    assert max(map(len, lines)) <= WIDTH, max(lines, key=len)
    page = result._repr_html_()
    cells = [
        cell
        for _, value in result.summary().rows
        for cell in (value if isinstance(value, tuple) else (value,))
    ]
    for text in (result.summary().title, *cells, *result.summary().sentences):
        assert printable_line(text) in unescape(page)
    assert ("<svg" in page) == (isinstance(result, Plotted) and drawn)
