"""Pages whose commands and Python code run when the site is built.

Each block of ``sh`` and ``python`` of a tutorial becomes a cell of a notebook, in the page's own folder; a command that
fails ends the build. What ran once is taken from a cache until the page or Ballbot's source has changed. A line
``<!-- page: found/report.html -->`` shows a page that the commands wrote. GitHub shows the blocks as code.
"""

import hashlib
import os
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx

#: the folder of the pages that run, and the name of the magic that runs commands
FOLDER, MAGIC = "tutorials/", "%%commands"
_COLOURS = ("CLICOLOR", "CLICOLOR_FORCE", "FORCE_COLOR")
_FRONT = "---\nfile_format: mystnb\nkernelspec:\n  name: python3\n---\n"
_BLOCK = re.compile(r"^```(sh|python)\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)
_PAGE = re.compile(r"^<!-- page: (\S+) -->$", flags=re.MULTILINE)


def work_folder(page: str) -> Path:
    """Return the folder in which a page's commands run."""
    return Path(os.environ["BALLBOT_SITE_WORK"]) / page


@cache
def source_hash(root: Path) -> str:
    """Return what changes when Ballbot's source, examples or dependencies do."""
    total = hashlib.sha256((root / "pyproject.toml").read_bytes() + Path(__file__).read_bytes())
    for folder in ("src", "examples"):
        for path in sorted((root / folder).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts and ".egg-info" not in str(path):
                total.update(path.read_bytes())
    return total.hexdigest()[:16]


def read(app: Sphinx, page: str, source: list[str]) -> None:
    """Turn the blocks of a page that runs into cells, and the marks of pages into frames."""
    text = source[0]
    if page.startswith(FOLDER):
        first = (
            "```{code-cell}\n:tags: [remove-cell]\n"
            f"# Ballbot's source: {source_hash(Path(app.srcdir).parent)}\n"
            f"import executed_pages\nexecuted_pages.start({page!r})\n```\n"
        )
        heading, _, rest = text.partition("\n")
        text = f"{_FRONT}{heading}\n\n{first}\n{_BLOCK.sub(_cell, rest)}"
    depth = "../" * page.count("/")
    source[0] = _PAGE.sub(
        lambda found: (
            f'```{{raw}} html\n<iframe class="made" src="{depth}made/{page}/{found[1]}" title="{found[1]}" '
            f'loading="lazy"></iframe>\n<p><a href="{depth}made/{page}/{found[1]}">Open it alone</a></p>\n```'
        ),
        text,
    )


def _cell(found: re.Match[str]) -> str:
    magic = f"{MAGIC}\n" if found[1] == "sh" else ""
    return f"```{{code-cell}}\n{magic}{found[2]}```"


def start(page: str) -> None:
    """Begin a page's notebook, within it: in its empty folder, with the magic for commands."""
    from IPython.core.magic import register_cell_magic

    folder = work_folder(page)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    os.chdir(folder)
    register_cell_magic("commands")(_run)


def _run(_: str, commands: str) -> None:
    """Run commands as a shell does, show their output, and fail if one fails."""
    # a notebook's kernel asks programs for colours, which makes them draw as on a terminal
    environment = {name: value for name, value in os.environ.items() if name not in _COLOURS}
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", commands],
        check=False,
        stdin=subprocess.DEVNULL,
        env={**environment, "TERM": "dumb"},
        capture_output=True,
        text=True,
    )
    print(done.stdout, end="")
    if done.returncode != 0:
        raise SystemError(f"exit code {done.returncode} of:\n{commands}\n{done.stdout}\n{done.stderr}")


def show_commands(_: Sphinx, tree: nodes.document) -> None:
    """Show the cells of commands as the commands alone."""
    for block in tree.findall(nodes.literal_block):
        if block.astext().startswith(MAGIC):
            text = block.astext().removeprefix(MAGIC).strip()
            block.children = [nodes.Text(text)]
            block.rawsource, block["language"] = text, "sh"


def copy_pages(app: Sphinx, error: Exception | None) -> None:
    """Put the pages that the commands wrote beside the site's own."""
    if error is not None or app.builder.format != "html":
        return
    for page in app.env.found_docs:
        for name in _PAGE.findall(app.env.doc2path(page).read_text(encoding="utf-8")):
            target = Path(app.outdir) / "made" / page / name
            target.parent.mkdir(parents=True, exist_ok=True)
            if page == app.config.root_doc:
                target.write_text(replay_of_the_demo(), encoding="utf-8")
            else:
                shutil.copyfile(work_folder(page) / name, target)


def replay_of_the_demo() -> str:
    """Return the page with the runs that ship with Ballbot."""
    from ballbot.report.demo import read_runs, robot_of_runs
    from ballbot.viewer.page import replay_page

    return replay_page(read_runs(), robot_of_runs(), title="One robot, two controllers, the same square")


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect the steps above."""
    app.connect("source-read", read)
    app.connect("doctree-read", show_commands)
    app.connect("build-finished", copy_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
