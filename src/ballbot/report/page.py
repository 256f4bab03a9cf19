"""Rendering a page: the templates of this package, everything escaped but the figures."""

from __future__ import annotations

from collections.abc import Mapping

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ballbot.printable import printable


def render(template: str, values: Mapping[str, object]) -> str:
    """Return the page of a template of this package as HTML; a name that the template lacks is an error."""
    environment = Environment(
        loader=PackageLoader("ballbot.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(f"{template}.html.j2").render(values)


def _shown(value: object) -> object:
    """Return what a template puts into the page: text of others' making with nothing hidden in it."""
    return printable(value) if type(value) is str else value


def figure_markup(svg: str) -> Markup:
    """Return a figure as what a template puts into the page unescaped."""
    return Markup(svg)
