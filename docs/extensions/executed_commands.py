"""The commands and Python code of the how-to pages, run when the site is built.

A page's commands run in order in a folder of their own; one that fails ends the build. A page is not run again until
its commands or Ballbot's source have changed. ``docs/executed_commands.toml`` says what a page begins with, which of
its words are replaced to make a run shorter, and which commands cannot run in a build, and why. The tutorials run as
notebooks (`executed_pages`) and show what their commands print.
"""

import hashlib
import os
import re
import shutil
import subprocess
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from executed_pages import source_hash
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util import logging

#: [s] that a page's commands may take
LIMIT = 900
_BLOCK = re.compile(r"^```([^\n]*)\n(.*?)^```$|^((?:    [^\n]+\n)+)", flags=re.DOTALL | re.MULTILINE)
#: in a block of no language, lines that begin with these words are commands
_FIRST = ("ballbot ", "python examples/")
_PROMPT = ">>> "
#: a file that a reason names
_FILE = re.compile(r"[\w/]+\.(?:py|md)\b")


@dataclass(frozen=True, kw_only=True)
class PageRun:
    """What of a page runs: a script for the shell."""

    page: str
    script: str
    #: files and folders of `Runs.start` that it begins with
    begins_with: tuple[str, ...]
    commands: int
    left_out: int  #: commands


@dataclass(frozen=True, kw_only=True)
class Runs:
    """The script that makes what pages begin with, and the pages."""

    start: str
    pages: tuple[PageRun, ...]


def runs(docs: Path) -> Runs:
    """Return what runs of all how-to pages.

    Parameters
    ----------
    docs : Path
        The folder of the documents.

    Raises
    ------
    ExtensionError
        If ``executed_commands.toml`` names a page, a word, a command or, in a reason, a file that is not there.
    """
    with (docs / "executed_commands.toml").open("rb") as file:
        settings = tomllib.load(file)
    of_pages = settings["page"]
    found = [_page_run(path, of_pages.get(path.stem, {})) for path in sorted(docs.glob("*.md"))]
    unknown = sorted(set(of_pages) - {one.page for one in found})
    if unknown:
        raise ExtensionError(f"executed_commands.toml: no page {', '.join(unknown)}")
    return Runs(start=settings["start"], pages=tuple(one for one in found if one.commands or one.left_out))


def _page_run(path: Path, settings: dict) -> PageRun:
    page = path.stem
    unknown = sorted(set(settings) - {"begins_with", "replaced", "not_run"})
    if unknown:
        raise ExtensionError(f"executed_commands.toml, page.{page}: unknown {', '.join(unknown)}")
    replaced, reasons = settings.get("replaced", {}), settings.get("not_run", {})
    steps, left_out, used = [], 0, set()
    for step in _steps(path.read_text(encoding="utf-8")):
        reason = next((begin for begin in reasons if step.startswith(begin)), None)
        if reason is not None:
            left_out += 1
            used.add(reason)
            continue
        for old, new in replaced.items():
            if old in step:
                step = step.replace(old, new)
                used.add(old)
        steps.append(step)
    missing = [words for words in (*replaced, *reasons) if words not in used]
    if missing:
        raise ExtensionError(
            f"executed_commands.toml, page.{page}: the page's commands do not have {missing}"
        )
    named = [name for reason in reasons.values() for name in _FILE.findall(reason)]
    lost = [name for name in named if not any((folder / name).exists() for folder in path.parents[:2])]
    if lost:
        raise ExtensionError(f"executed_commands.toml, page.{page}: there is no file {', '.join(lost)}")
    return PageRun(
        page=page,
        script="\n".join(steps),
        begins_with=tuple(settings.get("begins_with", ())),
        commands=len(steps),
        left_out=left_out,
    )


def _steps(text: str) -> Iterator[str]:
    """Yield the commands of a page, and its Python code as commands."""
    prompted = ""
    for found in _BLOCK.finditer(text):
        language, block = found[1], found[2] or found[3]
        if language == "python" and _PROMPT in block:
            prompted += f"{block}\n"
        elif language == "python":
            yield f"python - <<'END'\n{block}END"
        else:
            lines = "\n".join(line.removeprefix("    ") for line in block.splitlines())
            for line in lines.replace("\\\n", " ").splitlines():
                if line.strip() and (language == "sh" or (not language and line.startswith(_FIRST))):
                    yield line
    if prompted:
        yield f"cat > page.txt <<'END'\n{prompted}END\npython -m doctest page.txt"


def run_pages(app: Sphinx) -> None:
    """Run the pages whose commands or whose Ballbot have changed, as many at once as there are cores."""
    docs, work = Path(app.srcdir), Path(os.environ["BALLBOT_SITE_WORK"]) / "how-to"
    source = source_hash(docs.parent)
    work.mkdir(parents=True, exist_ok=True)
    found = runs(docs)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        start = pool.submit(_run, "start", found.start, work, source, docs.parent)
        running = [start]
        # those that begin in an empty folder need not wait
        for one in sorted(found.pages, key=lambda one: bool(one.begins_with)):
            if one.begins_with:
                start.result()
            if one.commands:
                running.append(pool.submit(_page, one, work, f"{source} {found.start}", docs.parent))
        for page in running:
            page.result()
    run, left_out = sum(one.commands for one in found.pages), sum(one.left_out for one in found.pages)
    logging.getLogger(__name__).info("how-to pages: %d commands run, %d are left out", run, left_out)


def _page(one: PageRun, work: Path, source: str, root: Path) -> None:
    copies = [f"cp -r ../start/{name} ." for name in one.begins_with]
    _run(one.page, "\n".join([*copies, one.script]), work, source, root)


def _run(name: str, script: str, work: Path, source: str, root: Path) -> None:
    """Run a script in an empty folder of its name, unless the same one has run there with the same source."""
    digest = hashlib.sha256(f"{source}\n{script}\n{Path(__file__).read_text()}".encode()).hexdigest()
    done, folder = work / f"{name}.done", work / name
    if done.is_file() and done.read_text() == digest:
        return
    done.unlink(missing_ok=True)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / "examples").symlink_to(root / "examples")
    began = perf_counter()
    ended = subprocess.run(
        ["timeout", str(LIMIT), "bash", "-euxo", "pipefail", "-c", script],
        check=False,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "TERM": "dumb", "MPLBACKEND": "agg", "BROWSER": "true", "HOME": str(folder)},
        text=True,
    )
    if ended.returncode != 0:
        raise ExtensionError(f"docs/{name}.md: exit code {ended.returncode}:\n{ended.stdout[-4000:]}")
    logging.getLogger(__name__).info("docs/%s.md: its commands ran in %.0f s", name, perf_counter() - began)
    done.write_text(digest)


def setup(app: Sphinx) -> dict[str, bool]:
    """Run the pages before any of them is read."""
    app.connect("builder-inited", run_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
