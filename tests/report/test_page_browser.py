"""A report in a browser: nothing is wider than a phone, plots zoom and show values, and nothing is fetched.

The pictures that it takes are kept in the folder that BALLBOT_SCREENSHOTS names, for people to look at.
"""

from contextlib import contextmanager

import numpy as np
import pytest
from matplotlib.figure import Figure

from ballbot.report.blocks import (
    Cell,
    Paragraph,
    Provenance,
    Result,
    Sheet,
    SourceFile,
    Verbatim,
    details,
    section,
)
from ballbot.report.page import page_of
from ballbot.report.series import Line, Panel, TimeSeries
from ballbot.report.style import drawn_picture
from tests.support.browser import new_tab

pytestmark = pytest.mark.browser

#: what is wider than the window and does not scroll within a box of its own
TOO_WIDE = """
[...document.querySelectorAll("body *")]
  .filter((one) => !one.parentElement.closest(".scroll, svg") && one.getBoundingClientRect().right > innerWidth + 0.5)
  .map((one) => `${one.tagName}.${one.className}`)
"""


def figure() -> Figure:
    made = Figure(figsize=(7.4, 2.0))
    made.subplots().plot([0, 1], [0, 1])
    return made


def wide_sheet() -> Sheet:
    """Return a table of many columns."""
    rows = [(Cell("c", "Coulomb (dry, at speed)"), "N m", *("0.0912 ± 0.0034",) * 6)]
    headings = ("parameter", "unit", *(f"wheel {k}" for k in range(1, 7)))
    return Sheet(headings, rows, "A caption of some length. " * 4)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    t = np.arange(2000) * 0.01
    lines = [
        Line("measured", np.sin(t), "measured"),
        Line("a model with a name that is rather long for a telephone", np.cos(t), "second"),
    ]
    made = Provenance(
        command="ballbot study " + "a/very/long/folder/" * 8 + "log.csv",
        files=(SourceFile(name="a/very/long/folder/" * 5 + "log.csv", sha256="0123456789abcdef" * 4),),
        seed=0,
        versions={"numpy": "2"},
    )
    report = Result(
        title="a_name_without_a_space_that_is_longer_than_a_telephone_is_wide: friction",
        lead="A study.",
        verdict=[("Where the gain comes from", "From everything."), ("", "A sentence.")],
        sections=[
            section(
                "A section",
                Paragraph("Some words."),
                wide_sheet(),
                Sheet(("state", "error"), [("x", "1.5"), ("y", "2.5")]),
                drawn_picture(
                    "one", "A figure, with a caption that is longer than a line of a telephone.", figure
                ),
                Verbatim("A = [ " + "0.0000  " * 12 + "]"),
                TimeSeries(
                    t,
                    [Panel("x [m]", lines), Panel("y [m]", lines[:1], levels=(0.5,))],
                    "Over time.",
                    shaded=[(2.0, 4.0)],
                    shade="held out",
                    level="limit",
                ),
            ),
            details("Folded", TimeSeries(t, [Panel("x [m]", lines[:1])], "More.")),
        ],
        undecided=["Much."],
        provenance=made,
        findings=(),
    )
    file = tmp_path_factory.mktemp("report") / "report.html"
    file.write_text(page_of(report), encoding="utf-8")
    return file


@contextmanager
def opened(browser, path, **options):
    """Open the report and wait for its plots."""
    with new_tab(browser, **options) as tab:
        tab.page.goto(path.as_uri())
        tab.wait("document.querySelectorAll('.uplot').length === 3")
        yield tab


@pytest.mark.parametrize("dark", [False, True])
def test_nothing_is_wider_than_a_phone_and_plots_can_be_read(browser, path, dark):
    with opened(browser, path, size=(390, 844), dark=dark, phone=True) as tab:
        assert tab.run("document.documentElement.scrollWidth") == 390
        assert tab.run(TOO_WIDE) == []
        ground = tab.run("getComputedStyle(document.body).backgroundColor")
        assert ground == ("rgb(20, 25, 30)" if dark else "rgb(255, 255, 255)")
        tab.keep(f"report-phone-{'dark' if dark else 'light'}", whole=True)
        assert tab.complaints == []


def test_plots_zoom_together_and_show_values(browser, path):
    with opened(browser, path, size=(1280, 900)) as tab:
        tab.run("document.querySelector('.u-over').scrollIntoView({block: 'center'})")
        x, y, width, height = tab.page.locator(".u-over").first.bounding_box().values()
        tab.page.mouse.move(x + width / 2, y + height / 2)
        reading = "[...document.querySelectorAll('.reading')].slice(0, 2).map((one) => one.innerText)"
        tab.wait(f"({reading}).every((one) => one.includes('s'))")
        first, second = tab.run(reading)
        # the middle of 20 s; a dot of the screen is a fiftieth of a second
        t = float(first.split()[0])
        assert t == pytest.approx(10.0, abs=0.1)
        assert float(first.split()[2].replace("−", "-")) == pytest.approx(np.sin(t), abs=2e-3)
        assert float(second.split()[0]) == t  # both panels read at one time
        tab.drag((x + 0.25 * width, y + height / 2), (x + 0.5 * width, y + height / 2))
        ticks = "document.querySelectorAll('.u-axis').length"
        assert tab.run(ticks) > 0
        tab.page.mouse.move(x + 2, y + height / 2)
        tab.wait(f"parseFloat(({reading})[0]) > 4")  # zoomed to 5 s and on
        tab.run("[...document.querySelectorAll('.zoom button')].find((b) => b.textContent === 'All').click()")
        tab.page.mouse.move(x + 3, y + height / 2)
        tab.wait(f"parseFloat(({reading})[0]) < 1")
        tab.keep("report-wide", whole=True)
        assert [one for one in tab.requests if not one.startswith(("file:", "data:"))] == []
        assert tab.complaints == []


def test_heading_sorts_its_table_and_a_folded_plot_is_as_wide_as_the_page(browser, path):
    with opened(browser, path, size=(420, 900), phone=True) as tab:
        table = "document.querySelectorAll('table')[1]"
        column = f"[...{table}.tBodies[0].rows].map((row) => row.cells[1].textContent.trim())"
        assert tab.run(column) == ["1.5", "2.5"]
        for expected in (["1.5", "2.5"], ["2.5", "1.5"]):
            tab.run(f"{table}.querySelectorAll('th')[1].click()")
            assert tab.run(column) == expected
        tab.run("document.querySelector('details').open = true")
        tab.wait("[...document.querySelectorAll('.uplot')].every((one) => one.clientWidth > 300)")
        assert tab.run("document.documentElement.scrollWidth") == 420
