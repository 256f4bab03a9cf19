"""Text of others' making is shown and never obeyed: on the terminal, in reports, figures and command lines."""

import io
import os
import re
import unicodedata
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from ballbot.cli.main import main
from ballbot.files import write_text
from ballbot.findings import Finding
from ballbot.printable import printable, printable_line
from ballbot.report.blocks import (
    Bullets,
    Paragraph,
    PlainConsole,
    Provenance,
    Result,
    Sheet,
    SourceFile,
    section,
)
from ballbot.report.page import page_of
from ballbot.report.style import drawn, label_of

#: what a terminal obeys, markup, mathematics, what is no Unicode, and what is to be left as it is
NASTY = [
    "\x1b[2J",
    "\x9b31m",
    "\x07",
    "\r",
    "\u202eevil",
    "[/x]",
    "[bold]",
    ":smile:",
    r"$\frac$",
    "$x$",
    "\udcff",
]
OTHERS = ["_a", "\ud800", "'", '"', "\\", "\n", "é"]
CHARACTERS = st.one_of(st.sampled_from(NASTY), st.sampled_from(OTHERS), st.characters())
TEXTS = st.lists(CHARACTERS, max_size=12).map("".join)


def obeyed(text: str) -> set[str]:
    """Return the characters of a text that a terminal may obey."""
    bidirectional = "\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
    controls = {one for one in text if unicodedata.category(one) in ("Cc", "Cs", "Zl", "Zp")}
    return controls - {"\n", "\t"} | {one for one in text if one in bidirectional}


@given(text=TEXTS)
def test_control_sequences_in_text_are_escaped(text):
    assert not obeyed(printable(text))
    assert not obeyed(printable_line(text))
    assert "\n" not in printable_line(text)
    assert printable(printable(text)) == printable(text)
    if text.isprintable():
        assert printable(text) == text


@given(text=TEXTS)
def test_console_prints_markup_literally(text):
    out = io.StringIO()
    console = PlainConsole(file=out, width=10_000)
    console.print(text, soft_wrap=True)
    console.print(Sheet(caption=text, headings=[text, "b"], rows=[[text, "1"]]))
    assert not obeyed(out.getvalue())


@pytest.mark.parametrize("name", NASTY)
def test_a_nasty_name_can_be_drawn(name, tmp_path):
    def draw(label: str) -> Figure:
        figure = Figure(figsize=(2, 2))
        figure.suptitle(label)
        return figure

    svg = drawn(lambda: draw(label_of(name)), name="one")
    assert not obeyed(svg)
    write_text(tmp_path / "one.svg", svg)


def test_a_page_escapes_names(tmp_path):
    bad = "\udcff<b>`<i>`\x1b"
    command, files = "ballbot '<script>alert(1)</script>\x1b'", (SourceFile(name=bad, sha256="0"),)
    blocks = (Paragraph(bad), Bullets([bad]), Sheet((bad,), [(bad,)], bad))
    result = Result(
        title=bad,
        lead=bad,
        verdict=[(bad, bad)],
        sections=[section(bad, *blocks)],
        undecided=[bad],
        provenance=Provenance(command=command, files=files, seed=0, versions={}),
        findings=[Finding(code="gap", severity="error", text=bad)],
    )
    page = page_of(result)
    assert not obeyed(page)
    assert not any(tag in page for tag in ("<script>alert", "<b>", "<i>"))
    write_text(tmp_path / "page.html", page)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("name", ["\x1b[31m\n[/x]", os.fsdecode(b"\xff\xfe")])
def test_file_names_are_never_interpreted_as_options_or_markup(tmp_path, monkeypatch, capfd, name):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "mine", "--out", f"./{name}.toml"]) == 0
    assert main(["design", f"./{name}.toml", "--out", f"./{name}"]) == 0
    shown = capfd.readouterr()
    assert not obeyed(shown.out + shown.err)
    assert main(["design", f"./{name}.toml", "--out", f"./{name}.toml"]) == 2
    shown = capfd.readouterr()
    assert not obeyed(shown.err)
    assert shown.err.count("\n") == 1
    assert re.search("is a file; --out needs a folder", shown.err)
    assert (Path(f"./{name}") / "results.json").exists()
