"""Every link of the built site leads somewhere within it, so that any static host can have it in any folder.

Links of all pages are followed, those of pages that commands wrote and of the theme too: an address on this site is
relative, its file is there, and what stands behind ``#`` is an element of that page. One that is not ends the build.
"""

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError


class Page(HTMLParser):
    """The addresses that a page has, and the names of its elements."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.names: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take the addresses and the name of an element."""
        del tag
        for name, value in attrs:
            if name in ("href", "src") and value:
                self.links.append(value)
            elif name in ("id", "name") and value:
                self.names.add(value)


def lost_links(site: Path) -> list[str]:
    """Return the links of a folder of pages that lead nowhere, each with its page.

    Parameters
    ----------
    site : Path
        The folder.
    """
    pages = {path: Page(path) for path in sorted(site.resolve().rglob("*.html"))}
    lost = []
    for path, page in pages.items():
        for link in page.links:
            to = urlsplit(link)
            if to.scheme or to.netloc:
                continue
            target = (path.parent / unquote(to.path)).resolve() if to.path else path
            names = pages[target].names if target in pages else set()
            known = not to.fragment or target.suffix != ".html" or unquote(to.fragment) in names
            if to.path.startswith("/") or not target.is_file() or not known:
                lost.append(f"{path.relative_to(site.resolve())}: {link}")
    return sorted(set(lost))


def check(app: Sphinx, error: Exception | None) -> None:
    """End the build if a link leads nowhere."""
    if error is None and app.builder.format == "html" and (lost := lost_links(Path(app.outdir))):
        raise ExtensionError("links of the site that lead nowhere:\n" + "\n".join(lost))


def setup(app: Sphinx) -> dict[str, bool]:
    """Check after all pages are written, those of commands too."""
    app.connect("build-finished", check, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
