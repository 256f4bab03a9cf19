"""The documentation site: Sphinx with MyST and furo, built without a network by `make site`."""

import os
import sys
from pathlib import Path

DOCS = Path(__file__).parent
SOURCE, EXTENSIONS = DOCS.parent / "src", DOCS / "extensions"
sys.path[:0] = [str(EXTENSIONS), str(SOURCE)]

import ballbot  # noqa: E402

project, author = "Ballbot", "The Ballbot developers"
version = release = ballbot.__version__
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.githubpages",  # whose host would leave out folders that begin with a line below
    "sphinx.ext.napoleon",
    "api_lists",
    "dataclass_fields",
    "executed_commands",
    "executed_pages",
    "mathml",
    "site_links",
]
exclude_patterns = ["extensions"]

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 4  # headings have the anchors that GitHub gives them
highlight_language = "text"

# commands and cells of the tutorials, and commands of other pages, run when they or the source have changed; a failure
# ends the build
WORK = DOCS.parent / "build" / "site-work"
nb_execution_mode = "cache"
nb_execution_cache_path = str(WORK / "cache")
nb_execution_raise_on_error = True
nb_execution_timeout = 600
nb_merge_streams = True
os.environ |= {
    "BALLBOT_SITE_WORK": str(WORK),
    "COLUMNS": "88",
    "MPLBACKEND": "module://matplotlib_inline.backend_inline",
    "NO_COLOR": "1",
    "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    "PYTHONPATH": os.pathsep.join([str(EXTENSIONS), str(SOURCE), os.environ.get("PYTHONPATH", "")]),
}

nitpicky = True  # a reference that leads nowhere is a warning, and warnings are errors
# but not types in signatures: NumPy's and those of inner modules have no pages
nitpick_ignore_regex = [("py:.*", ".*")]
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings have types, shapes and units
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"Ballbot {version}"
html_copy_source = False
html_show_sphinx = html_show_copyright = False
html_static_path = ["_static"]
html_css_files, html_js_files = ["site.css"], [("site.js", {"defer": "defer"})]
html_favicon = "_static/icon.svg"
html_theme_options = {"footer_icons": []}
