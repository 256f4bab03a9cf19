"""The page of every command: a `Result` as HTML that opens from disk, needs no network, and prints.

The page contains its scripts, styles and data and refers to nothing else. Its Content-Security-Policy allows only its
own scripts, by their SHA-256: a script injected through a log's name does not run, and nothing is sent or fetched.

`web/` has the style sheet, `charts.js` and `theme.js`. uPlot, which draws time series, is the replay's, too.
"""

import base64
import re
from functools import cache
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from ballbot.file_formats import results_text
from ballbot.files import write_text
from ballbot.printable import printable
from ballbot.report.blocks import PAGE, RESULTS, Animation, Result
from ballbot.report.palette import themed
from ballbot.report.series import TimeSeries
from ballbot.report.words import RAISED, with_symbols
from ballbot.viewer.page import hash_source, plot_script, web_file

_POWER = re.compile(r"\^(-?\d)\b")


def render(result: Result, folder: Path) -> None:
    """Write a result into a folder: its results.json and its page."""
    write_text(folder / RESULTS, results_text(result.to_dict()))
    write_text(folder / PAGE, page_of(result))


def page_of(report: Result) -> str:
    """Return a result's page as HTML."""
    # the letters and digits of a heading, and its number
    words = [re.sub(r"[^a-z0-9]+", "-", section.heading.lower()).strip("-") for section in report.sections]
    anchors = [f"{word or 'section'}-{number}" for number, word in enumerate(words, 1)]
    contents = [
        *zip(anchors, (section.heading for section in report.sections), strict=True),
        ("undecided", "What the data cannot decide"),
        *([("checks", "Checks of the inputs")] if report.findings is not None else []),
        *([("reproduce", "How to reproduce this")] if report.provenance else []),
    ]
    blocks = [block for section in report.sections for block in section.blocks]
    animations = [block.part for block in blocks if isinstance(block, Animation)][:1]
    charts = any(isinstance(block, TimeSeries) for block in blocks)
    environment = Environment(
        loader=PackageLoader("ballbot.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_printable_text,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {
        "kind": lambda block: type(block).__name__,
        "symbols": with_symbols,
        "themed": lambda svg: Markup(themed(svg)),
        "words": _typeset,
    }
    plotting = charts or animations
    scripts = [_script(charts), *(animation.script for animation in animations)]
    scripts = [plot_script(), *scripts] if plotting else scripts
    styles = [
        web_file("uPlot.min.css") if plotting else "",
        _web("report.css"),
        *(animation.style for animation in animations),
    ]
    policy = (
        f"default-src 'none'; script-src {' '.join(map(hash_source, scripts))}; style-src 'unsafe-inline'; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )
    return environment.get_template("report.html.j2").render(
        report=report,
        anchors=anchors,
        contents=contents,
        policy=policy,
        style=Markup("".join(styles)),
        scripts=[Markup(script) for script in scripts],
    )


def _printable_text(value: object) -> object:
    """Return a value for a template; a text has its invisible and control characters escaped."""
    return printable(value) if type(value) is str else value


def _typeset(text: str) -> Markup:
    """Return a text, escaped unless it is markup, with `commands` as code and kg m^2 as kg m²."""
    escaped = str(escape(_printable_text(text)))
    raised = _POWER.sub(lambda match: match[1].translate(RAISED), escaped)
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", raised))


def _web(name: str) -> str:
    return web_file(name, "ballbot.report")


@cache
def _script(charts: bool) -> str:
    drawing = (web_file("packing.js"), web_file("element.js"), _web("charts.js")) if charts else ()
    return "(() => {{\n{}\n}})();".format("\n".join((*drawing, web_file("page.js"), _web("theme.js"))))


def picture_data(png: bytes) -> str:
    """Return a PNG as an element of a page, for a `Picture`."""
    return f'<img alt="" src="data:image/png;base64,{base64.b64encode(png).decode()}">'
