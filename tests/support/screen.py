"""Results as a terminal and a notebook show them."""

from ballbot.summary import HEIGHT, WIDTH, HasSummary


def assert_fits_a_screen(result: HasSummary) -> None:
    """Assert that the `repr` of a result fits 80 x 24 characters, and that a notebook is given the same rows."""
    lines = repr(result).splitlines()
    assert 1 < len(lines) <= HEIGHT
    assert max(map(len, lines)) <= WIDTH, max(lines, key=len)
    page = result.summary()._repr_html_()
    assert page.count("<tr") == len(result.summary().rows)
    assert result._repr_html_() == page  # pyright: ignore[reportAttributeAccessIssue]
