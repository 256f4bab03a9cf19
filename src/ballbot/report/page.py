"""The one page of every command: a `Result` as HTML that opens from disk, needs no network, and prints.

The page has no address of anything else: scripts, styles and data are in it. Its Content-Security-Policy allows its own
scripts by their SHA-256 and nothing more, so that no script that a log's name could bring runs, and nothing is sent or
fetched.

`web/` has the style sheet, `charts.js` and `theme.js`, and uPlot, which draws time series. uPlot has the MIT licence,
whose text is beside it and in each page that contains it.
"""

from __future__ import annotations

import base64
import re
from functools import cache
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from ballbot.file_formats import results_text
from ballbot.files import write_text
from ballbot.printable import printable
from ballbot.report.blocks import PAGE, RESULTS, Film, Result
from ballbot.report.palette import themed
from ballbot.report.series import TimeSeries
from ballbot.report.words import RAISED, with_symbols
from ballbot.viewer.page import hash_source, web_file

_POWER = re.compile(r"\^(-?\d)\b")


def render(result: Result, folder: Path, *, paged: bool = True) -> None:
    """Write a result into a folder: its results.json, and its page unless it is not `paged`."""
    write_text(folder / RESULTS, results_text(result.to_dict()))
    if paged:
        write_text(folder / PAGE, page_of(result))


def page_of(report: Result) -> str:
    """Return the page of what a command found, as HTML."""
    anchors = [_anchor(place, one.heading) for place, one in enumerate(report.present)]
    contents = list(zip(anchors, (one.heading for one in report.present), strict=True))
    contents += [("undecided", "What the data cannot decide")]
    contents += [("checks", "Checks of the inputs")] if report.findings is not None else []
    contents += [("reproduce", "How to reproduce this")] if report.made else []
    blocks = [block for one in report.present for block in one.blocks]
    films = [block.part for block in blocks if isinstance(block, Film)][:1]
    charts = any(isinstance(block, TimeSeries) for block in blocks)
    environment = Environment(
        loader=PackageLoader("ballbot.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_printable_text,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {"symbols": with_symbols, "themed": _themed, "words": _typeset}
    scripts = [_script(charts), *(film.script for film in films)]
    policy = (
        f"default-src 'none'; script-src {' '.join(map(hash_source, scripts))}; style-src 'unsafe-inline'; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )
    return environment.get_template("report.html.j2").render(
        title=report.title,
        lead=report.lead,
        verdict=[(heading, with_symbols(words)) for heading, words in report.verdict],
        contents=contents,
        sections=report.present,
        anchors=anchors,
        next_step=report.next_step,
        undecided=[with_symbols(words) for words in report.undecided],
        errors=[one for one in report.findings or () if report.accepted and one.severity == "error"],
        accepted=report.accepted,
        findings=report.findings,
        made=report.made,
        policy=policy,
        style=Markup(_style(charts) + "".join(film.style for film in films)),
        scripts=[Markup(one) for one in scripts],
    )


def _anchor(place: int, heading: str) -> str:
    """Return a section's name in addresses: its heading's letters, different for each section."""
    words = re.sub(r"[^a-z0-9]+", "-", heading.lower()).strip("-")
    return f"{words or 'section'}-{place + 1}"


def _printable_text(value: object) -> object:
    """Return what a template puts into the page: text of others' making with nothing hidden in it."""
    return printable(value) if type(value) is str else value


def _typeset(text: str) -> Markup:
    """Return a text, escaped unless it is markup, with `commands` as code and kg m^2 as kg m²."""
    escaped = str(escape(_printable_text(text)))
    raised = _POWER.sub(lambda found: found[1].translate(RAISED), escaped)
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", raised))


def _themed(svg: str) -> Markup:
    return Markup(themed(svg))


def _web(name: str) -> str:
    return web_file(name, "ballbot.report")


@cache
def _style(charts: bool) -> str:
    return (_web("uPlot.min.css") if charts else "") + _web("report.css")


@cache
def _script(charts: bool) -> str:
    if not charts:
        return f'(() => {{\n"use strict";\n{_web("theme.js")}\n}})();'
    licence = f"/*! uPlot:\n{_web('uPlot.LICENSE')}*/"
    parts = (licence, _web("uPlot.iife.min.js"), web_file("packing.js"), _web("charts.js"), _web("theme.js"))
    return "(() => {{\n{}\n}})();".format("\n".join(parts))


def picture_data(png: bytes) -> str:
    """Return a PNG as an element of a page, for a `Picture`."""
    return f'<img alt="" src="data:image/png;base64,{base64.b64encode(png).decode()}">'
