"""The one page of every command: what it shows, what it escapes, and that it stays small and whole."""

import base64
import hashlib
import io
import json
import re
from html.parser import HTMLParser
from urllib.parse import unquote

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from ballbot import __version__
from ballbot.file_formats import read_results
from ballbot.findings import Finding, Place
from ballbot.report.blocks import (
    Bullets,
    Column,
    Paragraph,
    Picture,
    PlainConsole,
    Provenance,
    Result,
    Sheet,
    Verbatim,
    details,
    entries_of,
    section,
    sheet_of,
)
from ballbot.report.page import page_of, render
from ballbot.report.palette import BLUE, INK, themed
from ballbot.report.series import Line, Panel, TimeSeries, together
from ballbot.report.style import drawn_picture
from tests.support.packing import unpacked
from tests.support.report_pages import shown_text

MADE = Provenance(command="ballbot try", files=(), seed=3, versions={"python": "3"})


def result(*sections, verdict=(("It", "works."),), undecided=("everything else",), **more) -> Result:
    """Return a result of these sections."""
    given = {"title": "a title", "lead": "a lead", "provenance": MADE} | more
    return Result(**given, verdict=list(verdict), sections=list(sections), undecided=list(undecided))


def page(*blocks, **more) -> str:
    """Return a page with one section of these blocks."""
    return page_of(result(section("A section", *blocks), **more))


def series(t, *columns, **more) -> TimeSeries:
    """Return a plot of columns over a time, each in its own panel."""
    panels = [Panel("a [m]", [Line("a", one, "first")]) for one in columns]
    return TimeSeries(t, panels, "over time", **more)


def drawn_data(made: TimeSeries) -> dict:
    """Return what the page's script reads of a plot."""
    return json.loads(str(made.markup()))


class Balance(HTMLParser):
    """Counts elements that are opened and not closed."""

    VOID = frozenset(("meta", "img", "input", "br", "link"))

    def __init__(self):
        super().__init__()
        self.stack, self.ids = [], []

    def handle_starttag(self, tag, attrs):
        self.ids += [value for name, value in attrs if name == "id"]
        if tag not in self.VOID:
            self.stack.append(tag)

    def handle_endtag(self, tag):
        assert self.stack.pop() == tag


def test_page_has_verdict_contents_sections_doubts_and_the_command():
    text = page(
        Paragraph("Run `ballbot check` first."),
        Bullets(["theta_dot is small"]),
        Sheet(("name", "value"), [("b", "1.5")], "a table"),
        Verbatim("A = [ 1 ]"),
        series(np.arange(5.0), np.ones(5)),
        findings=[
            Finding(code="gap", severity="warning", text="rows are missing", where=Place(file="a.csv"))
        ],
    )
    assert text.startswith("<!doctype html>")
    parser = Balance()
    parser.feed(text)
    assert parser.stack == []
    assert len(parser.ids) == len(set(parser.ids))
    assert set(re.findall(r'href="#([^"]+)"', text)) <= set(parser.ids)
    shown = shown_text(text)
    for words in (
        "works.",
        "everything else",
        "a table",
        "rows are missing",
        "a.csv",
        "ballbot try",
        "Seed 3;",
    ):
        assert words in shown
    assert "<code>ballbot check</code>" in shown


@pytest.mark.parametrize("charts", [False, True])
def test_only_the_pages_own_scripts_are_allowed(charts):
    text = page(series(np.arange(5.0), np.ones(5))) if charts else page()
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', text)[1]
    scripts = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    assert len(scripts) == 1 + charts
    digests = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts]
    assert re.findall(r"sha256-([\w+/=]+)", policy) == digests
    assert not re.search(r"""(?:src|href)\s*=\s*["'](?!#|data:)""", shown_text(text))
    assert ("uPlot" in scripts[0]) == charts
    # the licence asks for its text in every copy
    assert ("Permission is hereby granted" in scripts[0]) == charts


def test_a_figure_takes_the_colors_of_the_theme():
    svg = f'<svg><path style="stroke: {BLUE}; fill: {INK}"/><path style="fill: #123456"/><a href="#22303c"/></svg>'
    assert themed(svg) == (
        '<svg><path style="stroke: var(--blue); fill: var(--ink)"/><path style="fill: #123456"/>'
        '<a href="#22303c"/></svg>'
    )
    assert "var(--blue)" in page(Picture(lambda: svg, "a figure"))


@settings(max_examples=30)
@given(st.integers(1, 30_000), st.integers(0, 2**31), st.floats(0.0, 1.0), st.sampled_from([-7.0, 7.0]))
def test_a_long_series_is_short_and_keeps_its_peaks_and_gaps(count, seed, share, peak):
    random = np.random.default_rng(seed)
    t = np.cumsum(random.uniform(0.5, 1.5, count))
    values, other = random.normal(size=count).clip(-5.0, 5.0), np.linspace(0.0, 1.0, count)
    place = int(share * (count - 1))
    values[place] = peak
    gap = slice(count // 3, count // 2)
    other[gap] = np.nan
    data = drawn_data(series(t, values, other))
    times = unpacked(data["t"])
    first, second = (unpacked(panel["lines"][0]["values"]) for panel in data["panels"])
    assert len(times) == len(first) == len(second) <= 4002  # two of each of 2000 pieces, and of the remainder
    assert np.all(np.diff(times) >= 0.0)
    # a number of 16 bits over a range of at most 14
    assert np.abs(first - peak).min() <= 14.0 / 65534
    # a piece of which some rows are known shows these; float32 times are off by a part in 2^24
    inside = (
        (times > t[gap.start] + 15.0 * 2) & (times < t[gap.stop - 1] - 15.0 * 2) if count > 100 else times < 0
    )
    assert np.isnan(second[inside]).all()


def test_no_name_ends_the_data_of_a_plot():
    line = Line("</script><b>", np.ones(3), "first")
    made = TimeSeries(np.arange(3.0), [Panel("<i>", [line])], "<u>")
    text = page(made)
    assert "</script><b>" not in text
    assert "<u>" not in text
    assert drawn_data(made)["panels"][0]["lines"][0]["name"] == "</script><b>"


def test_runs_of_different_length_share_the_longest_time():
    t, (short, long) = together(
        [("a", "first", np.arange(3.0), np.arange(3.0)), ("b", "second", np.arange(5.0), np.ones(5))]
    )
    np.testing.assert_array_equal(t, np.arange(5.0))
    np.testing.assert_array_equal(short.values, [0.0, 1.0, 2.0, np.nan, np.nan])
    np.testing.assert_array_equal(long.values, np.ones(5))


def test_a_terminal_shows_verdict_tables_and_doubts_of_a_page_but_no_figures():
    figure = Picture(lambda: "<svg/>", "a figure")
    shown = Sheet(("state", "RMSE"), groups=(("", 1), ("with", 1)), rows=[("y", "21.25")], caption="One.")
    report = result(
        section("Numbers", figure, shown, Bullets(["So."]), Verbatim("K = 1")),
        section("None", figure),
        verdict=[("It", "works."), ("", "Indeed.")],
    )
    assert printed(report.parts()) == [
        *("Numbers", "One.", "state with RMSE", "y 21.25", "- So.", "K = 1"),
        *("What the data cannot decide", "- everything else", "It: works.", "Indeed."),
    ]
    assert printed(report.parts(brief=True)) == [
        *("One.", "state with RMSE", "y 21.25", "- So."),
        *("What the data cannot decide", "- everything else", "It: works.", "Indeed."),
    ]


def test_a_column_is_in_the_table_and_in_results_json(tmp_path):
    columns = [
        Column("run", lambda row: row[0]),
        Column("peak [mm]", lambda row: row[1], lambda peak: f"{1e3 * peak:.0f}", key="peak"),
        Column(None, lambda row: 2.0 * row[1], key="twice"),
    ]
    rows = [("a", 0.25), ("b", 0.5)]
    found = result(
        section("Runs", sheet_of(rows, columns, shaded=lambda row: row[0] == "b")),
        data={name: entries_of((name, peak), columns) for name, peak in rows},
        verdict=[("", "It works.")],
        provenance=None,
    )
    render(found, tmp_path)
    assert ">500</td>" in shown_text((tmp_path / "report.html").read_text())
    results = read_results(tmp_path / "results.json")
    assert results == {
        "ballbot": __version__,
        "a": {"peak": 0.25, "twice": 0.5},
        "b": {"peak": 0.5, "twice": 1.0},
    }
    assert repr(found.summary()).splitlines()[1:] == [
        "  run  peak [mm]",
        "  a          250",
        "  b          500",
        "- It works.",
        "- everything else",
    ]


def printed(parts) -> list[str]:
    """Return the lines that a terminal shows, without their spaces."""
    out = io.StringIO()
    for part in parts:
        PlainConsole(file=out, width=60).print(part)
    return [" ".join(line.split()) for line in out.getvalue().splitlines() if line.strip()]


def test_a_page_folds_details_states_the_next_step_and_has_the_data_of_figures():
    figure = drawn_picture("one", "a figure", _line)
    report = result(
        section("First", figure),
        details("Second", Paragraph("folded"), result="In 2 m"),
        next_step="`ballbot check`",
    )
    text = page_of(report)
    assert "<dt>Next</dt><dd><code>ballbot check</code></dd>" in text
    assert re.search(r"<summary><h2>Second</h2> <span [^>]*>In 2 m</span></summary>.*folded", text, re.DOTALL)
    assert "Second" not in printed(report.parts())  # a terminal has no fold
    assert unquote(re.search(r'href="data:text/csv,([^"]+)"', text)[1]).splitlines() == [
        "panel,line,x,y",
        "1,a line,0,1",
        "1,a line,2,3",
    ]


def _line() -> Figure:
    made = Figure()
    axes = made.subplots()
    axes.plot([0.0, 2.0], [1.0, 3.0], label="a line")
    axes.axhline(0.0)
    return made


def test_a_result_leaves_out_what_it_does_not_have():
    friction, motion = section("Friction", Paragraph("Little.")), section("Motion", None, Bullets([]))
    found = result(
        friction, motion, verdict=[("Friction", "Little."), ("Law", "")], undecided=["", "The floor."]
    )
    assert found.verdict == [("Friction", "Little.")]
    assert found.sections == [friction]
    assert found.undecided == ["The floor."]
