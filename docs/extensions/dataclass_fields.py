"""List the fields of a dataclass as its parameters, each with the meaning and the unit that stand beside it.

Robot parameters and controller settings state both in the field's metadata; all others in a comment `#:` or a text
below the field, which autodoc lists itself if it documents the members.
"""

import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

from sphinx.application import Sphinx
from sphinx.ext.autodoc import ALL
from sphinx.pycode import ModuleAnalyzer


def stated(metadata: Any) -> str:
    """Return what the metadata of a field says of it; empty if it says nothing."""
    for one in metadata.values():
        words = getattr(one, "meaning", None) or getattr(one, "text", None)
        if words:
            return f"{words} [{one.unit}]" if one.unit not in ("", "1") else words
    parts = metadata.get("components") or {}
    units = {f"[{one.unit}]" for one in parts.values()}
    return " ".join([str(metadata.get("heading", "")), ", ".join(parts), *units]).strip()


def field_lines(kind: Any, *, comments: bool) -> Iterator[str]:
    """Yield a line for each documented field of a dataclass, with the comments beside fields if asked for."""
    beside: dict[str, list[str]] = {}
    for one in reversed(kind.__mro__[:-1]):  # all but object
        found = ModuleAnalyzer.for_module(one.__module__).find_attr_docs()
        beside |= {name: lines for (owner, name), lines in found.items() if owner == one.__name__}
    for one in fields(kind):
        words = stated(one.metadata)
        if comments and not words:
            words = " ".join(beside.get(one.name, [])).strip()
        if one.init and words:
            plain = re.sub(r"([|*])", r"\\\1", words)  # no marks of reStructuredText
            yield f":param {one.name}: {plain}"


def add_fields(_: Sphinx, what: str, name: str, kind: Any, options: Any, lines: list[str]) -> None:
    """Add the fields of a dataclass to its docstring, unless this has parameters of its own."""
    del name
    if what == "class" and is_dataclass(kind) and not any(line.startswith(":param") for line in lines):
        every_member = options.get("members") is ALL
        place = next((k for k, line in enumerate(lines) if line.startswith(":raises")), len(lines))
        added = ["", *field_lines(kind, comments=not every_member)]
        lines[place:place] = added if place < len(lines) else [*added, ""]


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the fields once the docstring is in Sphinx's own form."""
    app.connect("autodoc-process-docstring", add_fields, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
